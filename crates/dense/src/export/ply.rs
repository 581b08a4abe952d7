//! Binary little-endian PLY (Turk, "The PLY polygon file format", 1994).

use super::PointCloud;
use crate::Mesh;
use std::io::{self, Write};

/// Writes a mesh.
///
/// # Errors
/// I/O errors of the writer.
pub fn write_ply(mesh: &Mesh, out: &mut impl Write) -> io::Result<()> {
    header(mesh.positions.len(), !mesh.colours.is_empty(), Some(mesh.triangles.len()), out)?;
    vertices(&mesh.positions, &mesh.normals, &mesh.colours, out)?;
    let mut bytes = Vec::with_capacity(13 * mesh.triangles.len());
    for triangle in &mesh.triangles {
        bytes.push(3);
        triangle.iter().for_each(|i| bytes.extend((*i as i32).to_le_bytes()));
    }
    out.write_all(&bytes)
}

/// Writes a point cloud.
///
/// # Errors
/// I/O errors of the writer.
pub fn write_ply_points(points: &PointCloud, out: &mut impl Write) -> io::Result<()> {
    header(points.positions.len(), !points.colours.is_empty(), None, out)?;
    vertices(&points.positions, &points.normals, &points.colours, out)
}

fn header(vertices: usize, colours: bool, faces: Option<usize>, out: &mut impl Write) -> io::Result<()> {
    writeln!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment metres, in the map's frame\nelement vertex {vertices}"
    )?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property float {name}")?;
    }
    for name in ["red", "green", "blue"].iter().filter(|_| colours) {
        writeln!(out, "property uchar {name}")?;
    }
    if let Some(faces) = faces {
        writeln!(out, "element face {faces}\nproperty list uchar int vertex_indices")?;
    }
    writeln!(out, "end_header")
}

fn vertices(
    positions: &[[f32; 3]],
    normals: &[[f32; 3]],
    colours: &[[u8; 3]],
    out: &mut impl Write,
) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(27 * positions.len());
    for (i, (p, n)) in positions.iter().zip(normals).enumerate() {
        p.iter().chain(n).for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend(colours.get(i).into_iter().flatten());
    }
    out.write_all(&bytes)
}
