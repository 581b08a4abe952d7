//! Calibrations: cameras, an IMU, and the rig that they make.

use crate::arrays::{matrix, pose};
use crate::errors::{RigError, raise};
use crate::interrupt::on_thread;
use cairn::geometry::Se3;
use cairn::sensor::{self, DepthSensor, Distortion, ImuNoise, ImuSensor, RigCamera};
use cairn::sources::{read_rig_for, write_rig};
use numpy::PyArray2;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::PathBuf;

/// A calibrated camera and where it sits on the body.
///
/// The camera frame has x to the right, y down and z forward; pixel centres are at whole coordinates.
///
/// Args:
///     width, height: Size of its images in pixels.
///     fx, fy: Focal lengths in pixels.
///     cx, cy: Principal point in pixels.
///     distortion: "none", "radial-tangential" (k1 k2 p1 p2 [k3]), "rational" (k1 k2 p1 p2 k3 k4 k5 k6),
///         "inverse-radial-tangential" (k1 k2 p1 p2 k3), "equidistant" (k1 k2 k3 k4), "fov" (w) or
///         "double-sphere" (xi alpha).
///     coefficients: Those of the distortion.
///     body_from_camera: 4x4 matrix from camera to body coordinates; the identity where none is given.
///     name: Name in messages and files.
///
/// Raises:
///     RigError: When a number is impossible for a camera.
///
/// >>> cairn.Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
/// Camera(640x480, fx=525, fy=525, cx=319.5, cy=239.5, none)
#[pyclass(frozen, module = "cairn", eq)]
#[derive(Clone, PartialEq)]
pub struct Camera {
    pub inner: RigCamera,
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, *, distortion="none", coefficients=None, body_from_camera=None, name="cam0"))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        width: u32,
        height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: &str,
        coefficients: Option<Vec<f64>>,
        body_from_camera: Option<&Bound<'_, PyAny>>,
        name: &str,
    ) -> PyResult<Self> {
        let distortion = lens(distortion, &coefficients.unwrap_or_default())?;
        let camera = sensor::Camera {
            distortion,
            ..sensor::Camera::pinhole(width as usize, height as usize, fx, fy, cx, cy)
        };
        camera.validate().map_err(|e| RigError::new_err(format!("{name}: {e}")))?;
        let body_from_camera = transform(body_from_camera, "body_from_camera")?;
        Ok(Self { inner: RigCamera { name: name.into(), camera, body_from_camera } })
    }

    fn __repr__(&self) -> String {
        let c = &self.inner.camera;
        format!(
            "Camera({}x{}, fx={}, fy={}, cx={}, cy={}, {})",
            c.width,
            c.height,
            c.fx,
            c.fy,
            c.cx,
            c.cy,
            c.distortion.name()
        )
    }

    /// Name in messages and files.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// Width of its images in pixels.
    #[getter]
    fn width(&self) -> usize {
        self.inner.camera.width
    }

    /// Height of its images in pixels.
    #[getter]
    fn height(&self) -> usize {
        self.inner.camera.height
    }

    /// Focal length along x in pixels.
    #[getter]
    fn fx(&self) -> f64 {
        self.inner.camera.fx
    }

    /// Focal length along y in pixels.
    #[getter]
    fn fy(&self) -> f64 {
        self.inner.camera.fy
    }

    /// Principal point, x, in pixels.
    #[getter]
    fn cx(&self) -> f64 {
        self.inner.camera.cx
    }

    /// Principal point, y, in pixels.
    #[getter]
    fn cy(&self) -> f64 {
        self.inner.camera.cy
    }

    /// Name of the lens model.
    #[getter]
    fn distortion(&self) -> &'static str {
        self.inner.camera.distortion.name()
    }

    /// Coefficients of the lens model.
    #[getter]
    fn coefficients(&self) -> Vec<f64> {
        self.inner.camera.distortion.coefficients()
    }

    /// 4x4 matrix from camera to body coordinates.
    #[getter]
    fn body_from_camera<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.inner.body_from_camera)
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let c = &self.inner.camera;
        let names = PyDict::new(py);
        names.set_item("distortion", c.distortion.name())?;
        names.set_item("coefficients", c.distortion.coefficients())?;
        names.set_item("body_from_camera", self.body_from_camera(py)?)?;
        names.set_item("name", &self.inner.name)?;
        Ok(((c.width, c.height, c.fx, c.fy, c.cx, c.cy).into_pyobject(py)?, names))
    }
}

/// The lens model of a name with its coefficients.
fn lens(name: &str, given: &[f64]) -> PyResult<Distortion> {
    let wrong =
        |wanted: &str| RigError::new_err(format!("{name} takes {wanted} coefficients, not {}", given.len()));
    fn exactly<const N: usize>(given: &[f64]) -> Option<[f64; N]> {
        given.try_into().ok()
    }
    match name {
        "none" if given.is_empty() => Ok(Distortion::None),
        "none" => Err(wrong("no")),
        "radial-tangential" => {
            let all = match *given {
                [k1, k2, p1, p2] => Some([k1, k2, p1, p2, 0.0]),
                _ => exactly(given),
            };
            all.map(Distortion::RadialTangential).ok_or_else(|| wrong("4 or 5"))
        }
        "rational" => exactly(given).map(Distortion::Rational).ok_or_else(|| wrong("8")),
        "inverse-radial-tangential" => {
            exactly(given).map(Distortion::InverseRadialTangential).ok_or_else(|| wrong("5"))
        }
        "equidistant" => exactly(given).map(Distortion::Equidistant).ok_or_else(|| wrong("4")),
        "fov" => exactly(given).map(|[w]| Distortion::Fov(w)).ok_or_else(|| wrong("1")),
        "double-sphere" => {
            let made = exactly(given).map(|[xi, alpha]| Distortion::DoubleSphere { xi, alpha });
            made.ok_or_else(|| wrong("2"))
        }
        _ => Err(RigError::new_err(format!(
            "the lens model {name:?} is not known: none, radial-tangential, rational, inverse-radial-tangential, \
             equidistant, fov, double-sphere are"
        ))),
    }
}

/// The transform of an optional matrix.
fn transform(any: Option<&Bound<'_, PyAny>>, what: &str) -> PyResult<Se3> {
    any.map_or(Ok(Se3::identity()), |m| pose(m, what))
}

/// An inertial sensor and where it sits on the body.
///
/// Noise densities are those of the data sheet or of an Allan deviation; Kalibr's names are in brackets.
///
/// Args:
///     gyro_noise: White noise in rad/s/sqrt(Hz) (gyroscope_noise_density).
///     gyro_walk: Random walk of the bias in rad/s^2/sqrt(Hz) (gyroscope_random_walk).
///     accel_noise: White noise in m/s^2/sqrt(Hz) (accelerometer_noise_density).
///     accel_walk: Random walk of the bias in m/s^3/sqrt(Hz) (accelerometer_random_walk).
///     rate_hz: Readings a second.
///     body_from_imu: 4x4 matrix from IMU to body coordinates; the identity where none is given.
///     offset_s: Seconds to add to an IMU time to get the images' clock; Kalibr's timeshift_cam_imu is its negative.
///         Times passed to `Slam.track` are taken as they are: apply it before, or leave it 0.
#[pyclass(frozen, module = "cairn", eq)]
#[derive(Clone, PartialEq)]
pub struct Imu {
    pub inner: ImuSensor,
}

#[pymethods]
impl Imu {
    #[new]
    #[pyo3(signature = (*, gyro_noise=1.7e-4, gyro_walk=1.9e-5, accel_noise=2.0e-3, accel_walk=3.0e-3, rate_hz=200.0, body_from_imu=None, offset_s=0.0))]
    fn new(
        gyro_noise: f64,
        gyro_walk: f64,
        accel_noise: f64,
        accel_walk: f64,
        rate_hz: f64,
        body_from_imu: Option<&Bound<'_, PyAny>>,
        offset_s: f64,
    ) -> PyResult<Self> {
        let noise = ImuNoise { gyro: gyro_noise, gyro_walk, accel: accel_noise, accel_walk };
        let body_from_imu = transform(body_from_imu, "body_from_imu")?;
        Ok(Self { inner: ImuSensor { body_from_imu, rate_hz, noise, offset_s } })
    }

    fn __repr__(&self) -> String {
        let n = &self.inner.noise;
        format!(
            "Imu(gyro_noise={:e}, gyro_walk={:e}, accel_noise={:e}, accel_walk={:e}, rate_hz={})",
            n.gyro, n.gyro_walk, n.accel, n.accel_walk, self.inner.rate_hz
        )
    }

    /// White noise of the gyroscope in rad/s/sqrt(Hz).
    #[getter]
    fn gyro_noise(&self) -> f64 {
        self.inner.noise.gyro
    }

    /// Random walk of the gyroscope's bias in rad/s^2/sqrt(Hz).
    #[getter]
    fn gyro_walk(&self) -> f64 {
        self.inner.noise.gyro_walk
    }

    /// White noise of the accelerometer in m/s^2/sqrt(Hz).
    #[getter]
    fn accel_noise(&self) -> f64 {
        self.inner.noise.accel
    }

    /// Random walk of the accelerometer's bias in m/s^3/sqrt(Hz).
    #[getter]
    fn accel_walk(&self) -> f64 {
        self.inner.noise.accel_walk
    }

    /// Readings a second.
    #[getter]
    fn rate_hz(&self) -> f64 {
        self.inner.rate_hz
    }

    /// Seconds to add to an IMU time to get the images' clock.
    #[getter]
    fn offset_s(&self) -> f64 {
        self.inner.offset_s
    }

    /// 4x4 matrix from IMU to body coordinates.
    #[getter]
    fn body_from_imu<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.inner.body_from_imu)
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let names = PyDict::new(py);
        names.set_item("gyro_noise", self.gyro_noise())?;
        names.set_item("gyro_walk", self.gyro_walk())?;
        names.set_item("accel_noise", self.accel_noise())?;
        names.set_item("accel_walk", self.accel_walk())?;
        names.set_item("rate_hz", self.rate_hz())?;
        names.set_item("body_from_imu", self.body_from_imu(py)?)?;
        names.set_item("offset_s", self.offset_s())?;
        Ok((PyTuple::empty(py), names))
    }
}

/// All sensors of a device.
///
/// Args:
///     cameras: One camera, or a list of them; the first is the reference. One for mono and RGB-D, two for stereo.
///     depth_scale: Metres per unit of a uint16 depth image, where there is a depth sensor whose images are registered to
///         the first camera: 0.001 for millimetres.
///     depth_camera: The depth sensor's own calibration, where its images are not registered; needs `depth_scale` too.
///     imu: The inertial sensor, where there is one.
///
/// Raises:
///     RigError: When the rig is impossible; the message names the number.
///
/// >>> camera = cairn.Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
/// >>> cairn.Rig(camera, depth_scale=0.001)
/// Rig(1 camera, depth)
#[pyclass(frozen, module = "cairn", eq)]
#[derive(Clone, PartialEq)]
pub struct Rig {
    pub inner: cairn::Rig,
}

/// One camera or several.
#[derive(FromPyObject)]
enum Cameras<'py> {
    One(Bound<'py, Camera>),
    Several(Vec<Bound<'py, Camera>>),
}

#[pymethods]
impl Rig {
    #[new]
    #[pyo3(signature = (cameras, *, depth_scale=None, depth_camera=None, imu=None))]
    fn new(
        cameras: Cameras<'_>,
        depth_scale: Option<f64>,
        depth_camera: Option<&Bound<'_, Camera>>,
        imu: Option<&Bound<'_, Imu>>,
    ) -> PyResult<Self> {
        let cameras: Vec<RigCamera> = match cameras {
            Cameras::One(camera) => vec![camera.get().inner.clone()],
            Cameras::Several(all) => all.iter().map(|c| c.get().inner.clone()).collect(),
        };
        let depth = match (depth_scale, depth_camera, cameras.first()) {
            (None, None, _) => None,
            (None, Some(_), _) => return Err(RigError::new_err("depth_camera needs depth_scale")),
            (Some(metres_per_unit), Some(own), _) => {
                let RigCamera { camera, body_from_camera: body_from_depth, .. } = own.get().inner;
                Some(DepthSensor { camera, body_from_depth, metres_per_unit, registered: false })
            }
            (Some(metres_per_unit), None, Some(first)) => Some(DepthSensor {
                camera: first.camera,
                body_from_depth: first.body_from_camera,
                metres_per_unit,
                registered: true,
            }),
            (Some(_), None, None) => None,
        };
        let inner = cairn::Rig { cameras, depth, imu: imu.map(|i| i.get().inner.clone()) };
        inner.validate().map_err(raise)?;
        Ok(Self { inner })
    }

    /// Reads a calibration: Cairn's own TOML, EuRoC, Kalibr, ORB-SLAM settings, KITTI, or the folder of a recording.
    ///
    /// Args:
    ///     path: File or folder.
    ///     size: Width and height of the images, for files that do not state it.
    ///
    /// Raises:
    ///     SourceError: When it cannot be read; the message names file, line and remedy.
    #[staticmethod]
    #[pyo3(signature = (path, *, size=None))]
    fn load(py: Python<'_>, path: PathBuf, size: Option<[u32; 2]>) -> PyResult<Self> {
        let size = size.map(|s| s.map(|v| v as usize));
        on_thread(py, move || Ok(Self { inner: read_rig_for(path, size).map_err(raise)? }))
    }

    /// The rig as text of Cairn's own TOML, which `Rig.load` reads.
    ///
    /// Raises:
    ///     SourceError: When it cannot be written as TOML.
    fn to_toml(&self) -> PyResult<String> {
        write_rig(&self.inner).map_err(raise)
    }

    /// Writes the rig as Cairn's own TOML; a file of that name is replaced.
    ///
    /// Raises:
    ///     OSError: When the file cannot be written.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        let text = self.to_toml()?;
        std::fs::write(&path, text).map_err(|e| PyOSError::new_err(format!("{}: {e}", path.display())))
    }

    fn __repr__(&self) -> String {
        let cameras = self.inner.cameras.len();
        let s = if cameras == 1 { "" } else { "s" };
        let depth = if self.inner.depth.is_some() { ", depth" } else { "" };
        let imu = if self.inner.imu.is_some() { ", IMU" } else { "" };
        format!("Rig({cameras} camera{s}{depth}{imu})")
    }

    /// The cameras.
    #[getter]
    fn cameras(&self) -> Vec<Camera> {
        self.inner.cameras.iter().map(|c| Camera { inner: c.clone() }).collect()
    }

    /// The inertial sensor, or None.
    #[getter]
    fn imu(&self) -> Option<Imu> {
        self.inner.imu.as_ref().map(|i| Imu { inner: i.clone() })
    }

    /// Metres per unit of a uint16 depth image, or None without a depth sensor.
    #[getter]
    fn depth_scale(&self) -> Option<f64> {
        self.inner.depth.as_ref().map(|d| d.metres_per_unit)
    }

    /// The depth sensor's camera, or None.
    #[getter]
    fn depth_camera(&self) -> Option<Camera> {
        let depth = self.inner.depth.as_ref()?;
        let inner =
            RigCamera { name: "depth".into(), camera: depth.camera, body_from_camera: depth.body_from_depth };
        Some(Camera { inner })
    }

    /// Whether depth images are registered to the first camera.
    #[getter]
    fn depth_is_registered(&self) -> bool {
        self.inner.depth.as_ref().is_some_and(|d| d.registered)
    }

    /// What is possible but unusual, one line each.
    #[getter]
    fn doubts(&self) -> Vec<String> {
        self.inner.doubts()
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let names = PyDict::new(py);
        names.set_item("depth_scale", self.depth_scale())?;
        let own = self.depth_camera().filter(|_| !self.depth_is_registered());
        names.set_item("depth_camera", own)?;
        names.set_item("imu", self.imu())?;
        Ok(((self.cameras(),).into_pyobject(py)?, names))
    }
}
