//! The rig: calibration of its cameras, depth sensor and IMU, and their extrinsics.

use crate::error::RigError;
use crate::{Camera, Distortion};
use cairn_geometry::{Mat3, Se3, Vec2};

/// By how much of the image's size the centre of projection may be off its middle. A calibration for images of half the size has it at a
/// quarter; no calibration of `data/rigs` and of the recordings is off by more than 0.05.
const MOST_OFF_CENTRE: f64 = 0.2;
/// A larger share of an image without a ray is told: calibrations of other people have rays for all of it, or lack 5 % and more.
const MOST_WITHOUT_RAY: f64 = 0.01;

/// One camera of the rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RigCamera {
    /// Name in the source ("cam0").
    pub name: String,
    /// Intrinsics.
    pub camera: Camera,
    /// Extrinsics: maps camera coordinates to body coordinates.
    pub body_from_camera: Se3,
}

impl RigCamera {
    /// Warnings about values that are possible but unusual.
    fn doubts(&self) -> Vec<String> {
        let (c, name) = (&self.camera, &self.name);
        let mut warnings = Vec::new();
        let (w, h) = (c.width as f64, c.height as f64);
        for (axis, f) in [("x", c.fx / w), ("y", c.fy / h)] {
            if !(0.15..=8.0).contains(&f) {
                warnings.push(format!(
                    "{name}: the focal length along {axis} is {f:.2} of the image, 0.3 to 2 are usual"
                ));
            }
        }
        if !(0.8..=1.25).contains(&(c.fx / c.fy)) {
            warnings.push(format!(
                "{name}: the focal lengths {} and {} differ: are the pixels not square?",
                c.fx, c.fy
            ));
        }
        if (c.cx / w - 0.5).abs() > MOST_OFF_CENTRE || (c.cy / h - 0.5).abs() > MOST_OFF_CENTRE {
            warnings.push(format!(
                "{name}: the centre {:.1} {:.1} is far from the middle of {w}x{h}",
                c.cx, c.cy
            ));
        }
        if let Some(v) = c.distortion.coefficients().iter().find(|v| v.abs() > 50.0) {
            warnings.push(format!("{name}: a {} coefficient is {v}", c.distortion.name()));
        }
        if c.distortion == Distortion::Equidistant([0.0; 4]) {
            warnings.push(format!(
                "{name}: all coefficients of its equidistant lens are 0: is it a pinhole without distortion?"
            ));
        }
        let without = self.share_without_ray();
        if without > MOST_WITHOUT_RAY {
            warnings.push(format!(
                "{name}: {:.0} % of the image have no ray, as its {} coefficients bend back towards the edge: calibrate with \
                 the pattern in the corners too",
                100.0 * without,
                c.distortion.name()
            ));
        }
        warnings
    }

    /// The share of the pixels of a grid over the image that see nothing; of a fisheye, whose circle may be smaller, none.
    fn share_without_ray(&self) -> f64 {
        let c = &self.camera;
        if !matches!(c.distortion, Distortion::RadialTangential(_) | Distortion::Rational(_)) {
            return 0.0;
        }
        let side = |i: usize, pixels: usize| (pixels - 1) as f64 * i as f64 / 16.0;
        let grid = (0..17 * 17).map(|i| Vec2::new(side(i % 17, c.width), side(i / 17, c.height)));
        grid.filter(|px| c.unproject(px).is_none()).count() as f64 / (17.0 * 17.0)
    }
}

/// A depth sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthSensor {
    /// Intrinsics; equal to the first camera's where depth is registered to it.
    pub camera: Camera,
    /// Extrinsics: maps depth sensor coordinates to body coordinates.
    pub body_from_depth: Se3,
    /// Metres per unit of the depth image.
    pub metres_per_unit: f64,
    /// True when each depth pixel belongs to the same pixel of the first camera.
    pub registered: bool,
}

/// Continuous-time noise densities of an IMU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuNoise {
    /// Gyroscope white noise in rad/s/sqrt(Hz).
    pub gyro: f64,
    /// Gyroscope bias random walk in rad/s^2/sqrt(Hz).
    pub gyro_walk: f64,
    /// Accelerometer white noise in m/s^2/sqrt(Hz).
    pub accel: f64,
    /// Accelerometer bias random walk in m/s^3/sqrt(Hz).
    pub accel_walk: f64,
}

impl ImuNoise {
    /// Scales the white noise of gyroscope and accelerometer; the bias random walks are unchanged.
    pub fn times(&self, [gyro, accel]: [f64; 2]) -> Self {
        Self { gyro: self.gyro * gyro, accel: self.accel * accel, ..*self }
    }
}

/// An inertial sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuSensor {
    /// Extrinsics: maps IMU coordinates to body coordinates; identity where the body frame is the IMU's.
    pub body_from_imu: Se3,
    /// Nominal rate in samples per second.
    pub rate_hz: f64,
    /// Noise densities.
    pub noise: ImuNoise,
    /// Seconds to add to an IMU stamp to get the image clock: `t_imu + offset = t_image`. Kalibr's `timeshift_cam_imu`
    /// is its negative. The merge of the streams applies it ([`crate::Merge`]); the rig passed on after that has an
    /// offset of 0.
    pub offset_s: f64,
}

impl ImuSensor {
    /// A phone's as browsers provide it: 60 Hz, noise of a low-cost sensor, in the camera's axes.
    pub fn of_phone() -> Self {
        let noise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
        Self { body_from_imu: Se3::identity(), rate_hz: 60.0, noise, offset_s: 0.0 }
    }
}

/// All sensors of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Cameras in order; the first is the reference. One for mono and RGB-D, two for stereo.
    pub cameras: Vec<RigCamera>,
    /// The depth sensor, if any.
    pub depth: Option<DepthSensor>,
    /// The inertial sensor, if any.
    pub imu: Option<ImuSensor>,
}

impl Rig {
    /// A rig with one camera at the body's origin.
    pub fn mono(camera: Camera) -> Self {
        let cam0 = RigCamera { name: "cam0".into(), camera, body_from_camera: Se3::identity() };
        Self { cameras: vec![cam0], depth: None, imu: None }
    }

    /// Checks that the rig is possible.
    ///
    /// # Errors
    /// Without a camera; when a number is not finite; for focal lengths that are not positive, a principal point far
    /// outside the image, extrinsics of more than 10 m, two cameras at the same position, a depth unit, rate or noise
    /// that is not positive, and for noise densities or a time offset that no sensor has.
    pub fn validate(&self) -> Result<(), RigError> {
        if self.cameras.is_empty() {
            return Err(RigError("the rig has no camera".into()));
        }
        for c in &self.cameras {
            c.camera.validate().map_err(|e| RigError(format!("{}: {e}", c.name)))?;
            check_rigid(&c.name, &c.body_from_camera)?;
        }
        for (i, a) in self.cameras.iter().enumerate() {
            for b in &self.cameras[i + 1..] {
                let baseline = (a.body_from_camera.translation - b.body_from_camera.translation).norm();
                if baseline < 1e-4 {
                    return Err(RigError(format!(
                        "{} and {} are {baseline:.6} m apart: no baseline",
                        a.name, b.name
                    )));
                }
            }
        }
        if let Some(d) = &self.depth {
            d.camera.validate().map_err(|e| RigError(format!("depth: {e}")))?;
            check_rigid("depth", &d.body_from_depth)?;
            if !(d.metres_per_unit.is_finite() && d.metres_per_unit > 0.0) {
                return Err(RigError(format!(
                    "depth: {} metres per unit is not a positive number",
                    d.metres_per_unit
                )));
            }
        }
        if let Some(imu) = &self.imu {
            check_rigid("imu", &imu.body_from_imu)?;
            for (name, v) in [
                ("rate", imu.rate_hz),
                ("gyro noise", imu.noise.gyro),
                ("gyro walk", imu.noise.gyro_walk),
                ("accel noise", imu.noise.accel),
                ("accel walk", imu.noise.accel_walk),
            ] {
                if !(v.is_finite() && v > 0.0) {
                    return Err(RigError(format!("imu: {name} {v} is not a positive number")));
                }
            }
            for (name, v, possible, _) in densities(&imu.noise) {
                if v < possible[0] || v > possible[1] {
                    return Err(RigError(format!(
                        "imu: {name} {v:e} is impossible, sensors have {:e} to {:e}: is the unit right?",
                        possible[0], possible[1]
                    )));
                }
            }
            if !imu.offset_s.is_finite() || imu.offset_s.abs() > 10.0 {
                return Err(RigError(format!(
                    "imu: an offset of {} s to the images is impossible, is the unit seconds?",
                    imu.offset_s
                )));
            }
        }
        Ok(())
    }

    /// Warnings about values that are possible but unusual, with numbers, one line each.
    pub fn doubts(&self) -> Vec<String> {
        let mut warnings: Vec<String> = self.cameras.iter().flat_map(|c| c.doubts()).collect();
        if let Some(d) = &self.depth
            && !(1e-5..=0.1).contains(&d.metres_per_unit)
        {
            warnings.push(format!(
                "depth: {:e} m per unit, so that its 65535 units reach {:e} m: 0.001 and 0.0002 are usual",
                d.metres_per_unit,
                65535.0 * d.metres_per_unit
            ));
        }
        if let [a, b, ..] = &self.cameras[..] {
            let baseline = (a.body_from_camera.translation - b.body_from_camera.translation).norm();
            if !(0.01..=3.0).contains(&baseline) {
                warnings.push(format!(
                    "{} and {} are {baseline:.4} m apart: is the unit metres?",
                    a.name, b.name
                ));
            }
        }
        if let [a, b, ..] = &self.cameras[..] {
            let a_from_b = a.body_from_camera.inverse() * b.body_from_camera;
            // A rectified pair, by which depth is measured to the right.
            if a_from_b.rotation.angle() < 1e-6 && a_from_b.translation.x < 0.0 {
                warnings.push(format!(
                    "{} is {:.4} m to the left of {}: is the sign of the baseline right, or are left and right exchanged?",
                    b.name, -a_from_b.translation.x, a.name
                ));
            }
        }
        let Some(imu) = &self.imu else { return warnings };
        // Browsers give 60 a second, which is enough for the motions of a walker.
        if imu.rate_hz < 55.0 || imu.rate_hz > 4000.0 {
            warnings.push(format!(
                "imu: {} samples per second, 60 to 1000 are usual and 60 are needed",
                imu.rate_hz
            ));
        }
        for (name, v, _, usual) in densities(&imu.noise) {
            if v < usual[0] || v > usual[1] {
                warnings.push(format!(
                    "imu: {name} {v:e} is unusual, most sensors have {:e} to {:e}: a density has the unit of the \
                     measurement over sqrt(Hz)",
                    usual[0], usual[1]
                ));
            }
        }
        if imu.offset_s.abs() > 0.1 {
            warnings.push(format!(
                "imu: an offset of {:+.3} s to the images is large; t_imu + offset = t_image",
                imu.offset_s
            ));
        }
        if imu.noise.gyro > imu.noise.accel {
            warnings.push(format!(
                "imu: the gyroscope's noise {:e} is above the accelerometer's {:e}: are they exchanged?",
                imu.noise.gyro, imu.noise.accel
            ));
        }
        warnings
    }
}

/// Noise densities with the possible range and the usual one; the usual range includes inflated values.
fn densities(n: &ImuNoise) -> [(&'static str, f64, [f64; 2], [f64; 2]); 4] {
    [
        ("gyro noise", n.gyro, [1e-8, 0.5], [1e-5, 2e-2]),
        ("gyro walk", n.gyro_walk, [1e-10, 0.1], [1e-7, 5e-3]),
        ("accel noise", n.accel, [1e-7, 5.0], [1e-4, 0.3]),
        ("accel walk", n.accel_walk, [1e-9, 5.0], [1e-6, 0.1]),
    ]
}

/// Checks that extrinsics are finite and at most 10 m long.
fn check_rigid(name: &str, t: &Se3) -> Result<(), RigError> {
    if !t.is_finite() {
        return Err(RigError(format!("{name}: the extrinsics contain a number that is not finite")));
    }
    if t.translation.norm() > 10.0 {
        return Err(RigError(format!(
            "{name}: {:.1} m from the body, is the unit metres?",
            t.translation.norm()
        )));
    }
    Ok(())
}

/// A depth sensor this near to a camera is at the same place: metres and radians.
const SAME_PLACE: f64 = 1e-4;

/// Whether the pixels of a depth image are those of a camera: both are at one place and have the same size, focal lengths and
/// centre.
pub fn is_registered(camera: &Camera, depth: &Camera, camera_from_depth: &Se3) -> bool {
    let (distance, angle) = (camera_from_depth.translation.norm(), camera_from_depth.rotation.angle());
    let pinhole = |c: &Camera| [c.fx, c.fy, c.cx, c.cy];
    let is_same = pinhole(camera).iter().zip(pinhole(depth)).all(|(a, b)| (a - b).abs() < 1e-3);
    is_same
        && (camera.width, camera.height) == (depth.width, depth.height)
        && distance.max(angle) < SAME_PLACE
}

/// Checks that a 3x3 block is a rotation; file readers call it before [`Se3::from_matrix`].
///
/// # Errors
/// When it is not, with the deviation from orthogonality and the determinant.
pub fn check_rotation(name: &str, r: &Mat3) -> Result<(), RigError> {
    let deviation = (r.transpose() * r - Mat3::identity()).norm();
    if !(deviation < 1e-2 && r.determinant() > 0.0) {
        return Err(RigError(format!(
            "{name}: not a rotation (|R'R - I| = {deviation:.3}, det = {:.3})",
            r.determinant()
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    #[test]
    fn values_that_no_camera_has_are_doubted() {
        let camera = Camera::pinhole(640, 480, 600.0, 601.0, 320.0, 240.0);
        let depth = |metres_per_unit| {
            let body_from_depth = Se3::identity();
            let sensor = DepthSensor { camera, body_from_depth, metres_per_unit, registered: true };
            Rig { depth: Some(sensor), ..Rig::mono(camera) }.doubts()
        };
        assert!(depth(0.001).is_empty() && depth(0.0002).is_empty());
        assert!(depth(1e-308)[0].contains("1e-308 m per unit"), "{:?}", depth(1e-308));
        for (camera, word) in [
            (Camera { fx: 6.0, ..camera }, "focal length along x"),
            (Camera { fy: 900.0, ..camera }, "not square"),
            (Camera { cx: 20.0, ..camera }, "far from the middle"),
        ] {
            let told = Rig::mono(camera).doubts();
            assert!(told.iter().any(|t| t.contains(word)), "{told:?}");
        }
    }

    #[test]
    fn depth_is_registered_where_its_pixels_are_those_of_the_camera() {
        let camera = Camera::pinhole(640, 480, 600.0, 601.0, 320.0, 240.0);
        let at = |x: f64, angle: f64| Se3::new(So3::exp(&Vec3::new(0.0, angle, 0.0)), Vec3::new(x, 0.0, 0.0));
        assert!(is_registered(&camera, &camera, &at(1e-5, 1e-5)));
        assert!(!is_registered(&camera, &camera, &at(1e-3, 0.0)));
        assert!(!is_registered(&camera, &camera, &at(0.0, 1e-3)));
        for other in [
            Camera { width: 641, ..camera },
            Camera { height: 481, ..camera },
            Camera { fx: 600.1, ..camera },
            Camera { cy: 240.1, ..camera },
        ] {
            assert!(!is_registered(&camera, &other, &Se3::identity()), "{other:?}");
        }
    }
}
