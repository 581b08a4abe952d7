//! Wavefront OBJ: text, with colours after the positions, which most readers accept.

use crate::Mesh;
use std::io::{self, Write};

/// Writes a mesh.
///
/// # Errors
/// I/O errors of the writer.
pub fn write_obj(mesh: &Mesh, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "# metres, in the map's frame")?;
    for (i, p) in mesh.positions.iter().enumerate() {
        write!(out, "v {} {} {}", p[0], p[1], p[2])?;
        if let Some(c) = mesh.colours.get(i) {
            let [r, g, b] = c.map(|v| f32::from(v) / 255.0);
            write!(out, " {r:.4} {g:.4} {b:.4}")?;
        }
        writeln!(out)?;
    }
    for n in &mesh.normals {
        writeln!(out, "vn {:.4} {:.4} {:.4}", n[0], n[1], n[2])?;
    }
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| i + 1);
        writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
    }
    Ok(())
}
