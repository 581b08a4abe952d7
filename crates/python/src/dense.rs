//! Dense surfaces from depth images with known poses: voxels and meshes as arrays.

use crate::arrays::{self, Channels, pose, rgb, rows};
use crate::errors::{DenseError, raise_dense};
use crate::rig::Camera;
use cairn::dense::{
    ColourImage, DepthConfig, DepthPreparer, MeshConfig, Mesher, TsdfConfig, TsdfVolume, raycast, write_glb,
    write_obj, write_ply,
};
use cairn::eval::write_bytes_whole;
use cairn::sensor::{DepthImage, Image};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Mutex;

/// A truncated signed distance field: depth images with poses in, the surface out.
///
/// Poses are `world_from_camera` of the depth camera, in metres: `output.world_from_body @ camera.body_from_camera`.
///
/// Args:
///     camera: The depth camera.
///     depth_scale: Metres per unit of uint16 depth images.
///     voxel_m: Edge of a voxel in metres, 0.005 to 0.2.
///     farthest_m: Farther depths are left out, metres.
///     color: Whether voxels keep colours.
///
/// Raises:
///     DenseError: For a setting out of range.
///
/// >>> import numpy as np
/// >>> camera = cairn.Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
/// >>> volume = cairn.DenseVolume(camera)
/// >>> volume.integrate(np.full((48, 64), 1.5, np.float32), np.eye(4))
/// >>> mesh = volume.mesh()
/// >>> bool(np.allclose(mesh.vertices[:, 2], 1.5, atol=1e-3)), mesh.triangles.shape[1]
/// (True, 3)
#[pyclass(frozen, module = "cairn")]
pub struct DenseVolume {
    camera: cairn::sensor::Camera,
    depth_scale: f64,
    color: bool,
    inner: Mutex<Inner>,
}

struct Inner {
    preparer: DepthPreparer,
    volume: TsdfVolume,
}

/// A depth image of the caller.
enum Depth {
    Units(DepthImage),
    Metres(Image<f32>),
}

impl DenseVolume {
    /// Runs a closure on the field while the interpreter is released.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Inner) -> T + Send) -> PyResult<T> {
        let inner = &self.inner;
        // Locked while the interpreter is released: another thread that holds the lock may need it.
        let done = py.detach(move || inner.lock().ok().map(|mut inner| work(&mut inner)));
        done.ok_or_else(|| DenseError::new_err("an earlier call was stopped by an error of the program"))
    }
}

#[pymethods]
impl DenseVolume {
    #[new]
    #[pyo3(signature = (camera, *, depth_scale=0.001, voxel_m=0.02, farthest_m=5.0, color=false))]
    fn new(
        camera: &Bound<'_, Camera>,
        depth_scale: f64,
        voxel_m: f64,
        farthest_m: f64,
        color: bool,
    ) -> PyResult<Self> {
        let camera = camera.get().inner.camera;
        let config = DepthConfig { farthest_m, ..DepthConfig::default() };
        let preparer = DepthPreparer::new(config, camera, depth_scale).map_err(raise_dense)?;
        let volume = TsdfVolume::new(TsdfConfig { voxel_m, colour: color, ..TsdfConfig::default() });
        let inner = Inner { preparer, volume: volume.map_err(raise_dense)? };
        Ok(Self { camera, depth_scale, color, inner: Mutex::new(inner) })
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (blocks, voxel_m) = self.with(py, |d| (d.volume.blocks(), d.volume.config().voxel_m))?;
        Ok(format!("DenseVolume({blocks} blocks of 8x8x8 voxels of {voxel_m} m)"))
    }

    /// Fuses a depth image.
    ///
    /// Args:
    ///     depth: (height, width): uint16 in units of `depth_scale` metres, or floats in metres. 0 and what is not finite
    ///         are no measurement.
    ///     world_from_camera: Pose of the depth camera, 4x4, metres.
    ///     image: Colours of the same pixels, (height, width[, 3]) of uint8; only where the volume keeps colours.
    ///     color: Order of its channels, "rgb" or "bgr".
    ///
    /// Raises:
    ///     DenseError: When hardly a pixel has a depth in range, or the pose is out of range; the volume is as it was.
    ///     ValueError: For shapes that do not fit the camera, and matrices that are no rigid transforms.
    #[pyo3(signature = (depth, world_from_camera, *, image=None, color="rgb"))]
    fn integrate(
        &self,
        py: Python<'_>,
        depth: &Bound<'_, PyAny>,
        world_from_camera: &Bound<'_, PyAny>,
        image: Option<&Bound<'_, PyAny>>,
        color: &str,
    ) -> PyResult<()> {
        let order = Channels::parse(color)?;
        let pose = pose(world_from_camera, "world_from_camera")?;
        let depth = match arrays::is_float(depth, "depth")? {
            true => Depth::Metres(arrays::metres(depth, &self.camera)?),
            false => Depth::Units(arrays::depth(depth, &self.camera, self.depth_scale, None)?),
        };
        if image.is_some() && !self.color {
            return Err(PyValueError::new_err(
                "image: this volume keeps no colours, it was made without color=True",
            ));
        }
        let image = image.map(|image| rgb(image, "image", &self.camera, order)).transpose()?;
        let image = image.as_ref().map(ColourImage::from_rgb);
        let fused = self.with(py, move |Inner { preparer, volume }| {
            let frame = match &depth {
                Depth::Units(units) => preparer.prepare(units)?,
                Depth::Metres(metres) => preparer.prepare_metres(metres)?,
            };
            volume.integrate(frame, image.as_ref(), &pose)
        })?;
        fused.map(drop).map_err(raise_dense)
    }

    /// The surface as triangles.
    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        let inner = self.with(py, |d| Mesher::new(MeshConfig::default()).whole(&d.volume))?;
        Ok(Mesh { inner })
    }

    /// All voxels that were seen.
    fn voxels(&self, py: Python<'_>) -> PyResult<Voxels> {
        self.with(py, |d| {
            let mut out = Voxels { voxel_m: d.volume.config().voxel_m, ..Voxels::default() };
            for key in d.volume.changed_since(0) {
                for i in 0..SIDE.pow(3) {
                    let local = [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE];
                    let index: [i32; 3] = std::array::from_fn(|k| SIDE * key.0[k] + local[k]);
                    if let Some((distance_m, weight)) = d.volume.voxel(index) {
                        out.indices.push(index);
                        out.distances.push(distance_m as f32);
                        out.weights.push(weight);
                    }
                }
            }
            out
        })
    }

    /// What a camera would see: depth in metres (height, width) and normals (height, width, 3) in the camera's frame, both
    /// float32 and 0 where no surface is met.
    ///
    /// Args:
    ///     camera: The camera.
    ///     world_from_camera: Its pose, 4x4, metres.
    ///     farthest_m: Rays end here.
    #[pyo3(signature = (camera, world_from_camera, *, farthest_m=5.0))]
    fn raycast<'py>(
        &self,
        py: Python<'py>,
        camera: &Bound<'py, Camera>,
        world_from_camera: &Bound<'py, PyAny>,
        farthest_m: f64,
    ) -> PyResult<Seen<'py>> {
        if !(farthest_m > 0.0 && farthest_m <= 1000.0) {
            return Err(PyValueError::new_err(format!(
                "farthest_m must be above 0 and at most 1000, not {farthest_m}"
            )));
        }
        let (camera, pose) = (camera.get().inner.camera, pose(world_from_camera, "world_from_camera")?);
        let seen =
            self.with(py, move |d| raycast(&d.volume, &camera, &pose, farthest_m))?.map_err(raise_dense)?;
        let normals = rows(py, seen.normals.data().to_vec())?.reshape([camera.height, camera.width, 3])?;
        Ok((arrays::pixels(py, &seen.depth_m)?, normals))
    }
}

/// Depths and normals.
type Seen<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray3<f32>>);

/// Voxels along an edge of a block.
const SIDE: i32 = 8;

/// Triangles over shared vertices, in the frame of the volume.
#[pyclass(frozen, module = "cairn")]
pub struct Mesh {
    inner: cairn::dense::Mesh,
}

#[pymethods]
impl Mesh {
    fn __repr__(&self) -> String {
        format!("Mesh({} vertices, {} triangles)", self.inner.positions.len(), self.inner.triangles.len())
    }

    /// Positions in metres, (N, 3) of float32.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, self.inner.positions.clone())
    }

    /// Normals of length one, towards free space, (N, 3) of float32.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, self.inner.normals.clone())
    }

    /// Red, green, blue of each vertex, (N, 3) of uint8; None without colours.
    #[getter]
    fn colors<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<u8>>>> {
        (!self.inner.colours.is_empty()).then(|| rows(py, self.inner.colours.clone())).transpose()
    }

    /// Vertices of each triangle, counter-clockwise as seen from free space, (M, 3) of uint32.
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        rows(py, self.inner.triangles.clone())
    }

    /// Writes a file; its ending chooses the form: .ply, .obj or .glb. A file of that name is replaced.
    ///
    /// Raises:
    ///     OSError: When it cannot be written.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let write: fn(&cairn::dense::Mesh, &mut Vec<u8>) -> std::io::Result<()> = match ending.as_deref() {
            Some("ply") => |mesh, to| write_ply(mesh, to),
            Some("obj") => |mesh, to| write_obj(mesh, to),
            // The world frame of a camera starts with y down.
            Some("glb") => |mesh, to| write_glb(mesh, [0.0, -1.0, 0.0], to),
            _ => return Err(PyValueError::new_err("the name must end in .ply, .obj or .glb")),
        };
        py.detach(|| {
            let mut bytes = Vec::new();
            write(&self.inner, &mut bytes).map_err(|e| PyOSError::new_err(e.to_string()))?;
            write_bytes_whole(&path, &bytes).map_err(|e| PyOSError::new_err(e.to_string()))
        })
    }
}

/// Voxels of a signed distance field as arrays.
#[pyclass(frozen, module = "cairn", sequence)]
#[derive(Default)]
pub struct Voxels {
    voxel_m: f64,
    indices: Vec<[i32; 3]>,
    distances: Vec<f32>,
    weights: Vec<i32>,
}

#[pymethods]
impl Voxels {
    fn __len__(&self) -> usize {
        self.indices.len()
    }

    fn __repr__(&self) -> String {
        format!("Voxels({} of {} m)", self.indices.len(), self.voxel_m)
    }

    /// Edge of a voxel in metres.
    #[getter]
    fn voxel_m(&self) -> f64 {
        self.voxel_m
    }

    /// Index of each along x, y, z, (N, 3) of int32; its centre is at `(index + 0.5) * voxel_m`.
    #[getter]
    fn indices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i32>>> {
        rows(py, self.indices.clone())
    }

    /// Centres in metres, (N, 3).
    #[getter]
    fn centers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, self.indices.iter().map(|i| i.map(|v| (f64::from(v) + 0.5) * self.voxel_m)).collect())
    }

    /// Signed distance to the surface in metres, positive in free space, (N,) of float32.
    #[getter]
    fn distances<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.distances)
    }

    /// Weight of each, (N,) of int32.
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i32>> {
        PyArray1::from_slice(py, &self.weights)
    }
}
