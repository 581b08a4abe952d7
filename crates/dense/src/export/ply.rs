//! Binary little-endian PLY (Turk, "The PLY polygon file format", 1994).

use crate::Mesh;
use std::io::{self, Write};

/// Writes a mesh.
///
/// # Errors
/// I/O errors of the writer.
pub fn write_ply(mesh: &Mesh, out: &mut impl Write) -> io::Result<()> {
    let vertices = mesh.positions.len();
    writeln!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment metres, in the map's frame\nelement vertex {vertices}"
    )?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property float {name}")?;
    }
    for name in ["red", "green", "blue"].iter().filter(|_| !mesh.colours.is_empty()) {
        writeln!(out, "property uchar {name}")?;
    }
    let faces = mesh.triangles.len();
    writeln!(out, "element face {faces}\nproperty list uchar int vertex_indices\nend_header")?;
    let mut bytes = Vec::with_capacity(27 * vertices + 13 * faces);
    for (i, (p, n)) in mesh.positions.iter().zip(&mesh.normals).enumerate() {
        p.iter().chain(n).for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend(mesh.colours.get(i).into_iter().flatten());
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        triangle.iter().for_each(|i| bytes.extend((*i as i32).to_le_bytes()));
    }
    out.write_all(&bytes)
}
