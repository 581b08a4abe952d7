//! Meshes as files: PLY, OBJ, binary glTF, and heightmaps as PGM. Writers take any `Write`; the caller opens files.

mod gltf;
mod heights;
mod obj;
mod ply;

pub use gltf::write_glb;
pub use heights::write_heights;
pub use obj::write_obj;
pub use ply::write_ply;
