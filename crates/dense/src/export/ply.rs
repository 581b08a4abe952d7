//! Binary little-endian PLY (Turk, "The PLY polygon file format", 1994).

use crate::Mesh;
use std::io::{self, BufWriter, Write};

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
    // In pieces: a large mesh is not held a second time.
    let mut out = BufWriter::new(out);
    for (i, (p, n)) in mesh.positions.iter().zip(&mesh.normals).enumerate() {
        p.iter().chain(n).try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
        mesh.colours.get(i).map_or(Ok(()), |colour| out.write_all(colour))?;
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        triangle.iter().try_for_each(|i| out.write_all(&(*i as i32).to_le_bytes()))?;
    }
    out.flush()
}
