//! Meshes and point clouds as files: PLY, OBJ, binary glTF, PCD, and heightmaps as PGM. Writers take any `Write`; the caller opens files.

mod gltf;
mod heights;
mod obj;
mod pcd;
mod ply;

pub use gltf::write_glb;
pub use heights::write_heights;
pub use obj::write_obj;
pub use pcd::write_pcd;
pub use ply::{write_ply, write_ply_points};

use crate::Mesh;

/// Points with normals, and colours where available (else empty).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals; one for each position.
    pub normals: Vec<[f32; 3]>,
    /// Red, green, blue of each position, or empty.
    pub colours: Vec<[u8; 3]>,
}

impl From<Mesh> for PointCloud {
    /// The vertices of a mesh as a point cloud.
    fn from(mesh: Mesh) -> Self {
        Self { positions: mesh.positions, normals: mesh.normals, colours: mesh.colours }
    }
}
