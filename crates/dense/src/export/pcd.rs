//! Binary PCD 0.7, the Point Cloud Library's format: x y z, normals, and packed colours where there are any.

use super::PointCloud;
use std::io::{self, Write};

/// Writes a point cloud.
///
/// # Errors
/// I/O errors of the writer.
pub fn write_pcd(points: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    let colours = !points.colours.is_empty();
    let (name, four, kind, one) = if colours { (" rgb", " 4", " U", " 1") } else { ("", "", "", "") };
    let n = points.positions.len();
    writeln!(
        out,
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z normal_x normal_y normal_z{name}\n\
         SIZE 4 4 4 4 4 4{four}\nTYPE F F F F F F{kind}\nCOUNT 1 1 1 1 1 1{one}\nWIDTH {n}\nHEIGHT 1\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary"
    )?;
    let mut bytes = Vec::with_capacity(28 * n);
    for (i, (p, normal)) in points.positions.iter().zip(&points.normals).enumerate() {
        p.iter().chain(normal).for_each(|v| bytes.extend(v.to_le_bytes()));
        if let Some(&[r, g, b]) = points.colours.get(i) {
            bytes.extend([b, g, r, 0]);
        }
    }
    out.write_all(&bytes)
}
