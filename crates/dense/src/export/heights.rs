//! A heightmap: for each cell of the plane across gravity, the height of the highest surface that faces up. Floors, steps and
//! tables do; a ceiling faces down and hides nothing.
//!
//! The file is a PGM of 16 bits, whose comments say what its pixels are:
//!
//! ```text
//! P5
//! # height_m = 0.001 * (pixel - 1) + OFFSET; 0: unknown
//! # cell_m 0.05
//! # x_axis X Y Z
//! # y_axis X Y Z
//! # up X Y Z
//! # lower_left_m U V
//! WIDTH HEIGHT
//! 65535
//! ```
//!
//! Columns go along `x_axis`, rows from the top against `y_axis`, both directions in the frame of the mesh; `lower_left_m` is the corner of
//! the lower left cell along the two.

use crate::Mesh;
use cairn_geometry::Vec3;
use std::io::{self, Write};

/// Edge of a cell in metres.
const CELL_M: f64 = 0.05;
/// Metres of a pixel's unit.
const UNIT_M: f64 = 0.001;
/// A surface faces up when its normal is within 60 degrees of it.
const FACES_UP: f64 = 0.5;
/// Cells, at most: a square of 400 m.
const MOST_CELLS: f64 = 64e6;

/// Writes the heights of a mesh along `up`, the direction against gravity in its frame.
///
/// # Errors
/// A direction that is none, a mesh without a surface that faces up, or one that is too large or too high for the form; and what the
/// file says.
pub fn write_heights(mesh: &Mesh, up: [f64; 3], to: &mut impl Write) -> io::Result<()> {
    let refused = |why: &str| io::Error::new(io::ErrorKind::InvalidInput, why.to_owned());
    let up = Vec3::from(up).try_normalize(1e-9).filter(|u| u.iter().all(|v| v.is_finite()));
    let up = up.ok_or_else(|| refused("no direction is up"))?;
    // Along x of the mesh, or along z where that points up.
    let level = |v: Vec3| (v - up * up.dot(&v)).try_normalize(0.1);
    let x_axis = level(Vec3::x()).or_else(|| level(Vec3::z()));
    let x_axis = x_axis.ok_or_else(|| refused("no direction is up"))?;
    let y_axis = up.cross(&x_axis);
    let place = |i: u32| {
        let p = mesh.positions.get(i as usize)?.map(f64::from);
        let p = Vec3::from(p);
        Some(Vec3::new(x_axis.dot(&p), y_axis.dot(&p), up.dot(&p)))
    };
    let facing_up: Vec<[Vec3; 3]> = (mesh.triangles.iter())
        .filter_map(|t| Some([place(t[0])?, place(t[1])?, place(t[2])?]))
        .filter(|[a, b, c]| {
            (b - a).cross(&(c - a)).try_normalize(0.0).is_some_and(|n| n.z > FACES_UP && n.z.is_finite())
        })
        .collect();
    if facing_up.is_empty() {
        return Err(refused("no surface faces up"));
    }
    let corners = || facing_up.iter().flatten();
    let low = corners().fold(Vec3::repeat(f64::MAX), |a, p| a.inf(p));
    let high = corners().fold(Vec3::repeat(f64::MIN), |a, p| a.sup(p));
    let first = [low.x, low.y].map(|v| (v / CELL_M).floor());
    let size = [high.x / CELL_M - first[0], high.y / CELL_M - first[1]].map(|v| v.floor() + 1.0);
    if !(size[0] * size[1] <= MOST_CELLS && high.z - low.z < UNIT_M * 65_534.0) {
        return Err(refused("the surface is too large for a heightmap"));
    }
    let [width, height] = size.map(|v| v as usize);
    let mut pixels = vec![0u16; width * height];
    for triangle in &facing_up {
        heights_in(triangle, first, |[x, y], z| {
            // The edge of a triangle may lie on that of the map.
            if x < width && y < height {
                let pixel = &mut pixels[(height - 1 - y) * width + x];
                *pixel = (*pixel).max(((z - low.z) / UNIT_M).round().clamp(0.0, 65_534.0) as u16 + 1);
            }
        });
    }
    writeln!(to, "P5\n# height_m = {UNIT_M} * (pixel - 1) + {}; 0: unknown", low.z)?;
    writeln!(to, "# cell_m {CELL_M}")?;
    for (name, axis) in [("x_axis", x_axis), ("y_axis", y_axis), ("up", up)] {
        // Adding zero turns -0 into 0.
        writeln!(to, "# {name} {} {} {}", axis.x + 0.0, axis.y + 0.0, axis.z + 0.0)?;
    }
    writeln!(to, "# lower_left_m {} {}", first[0] * CELL_M, first[1] * CELL_M)?;
    writeln!(to, "{width} {height}\n65535")?;
    let bytes: Vec<u8> = pixels.iter().flat_map(|p| p.to_be_bytes()).collect();
    to.write_all(&bytes)
}

/// Gives the height of a triangle over the centre of each cell in it, and the cell counted from the first.
fn heights_in([a, b, c]: &[Vec3; 3], first: [f64; 2], mut give: impl FnMut([usize; 2], f64)) {
    let cell = |v: f64, k: usize| v / CELL_M - first[k] - 0.5;
    let (low, high) = (a.inf(b).inf(c), a.sup(b).sup(c));
    let range =
        |k: usize| cell(low[k], k).ceil().max(0.0) as usize..=cell(high[k], k).floor().max(-1.0) as usize;
    let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if cell(high.x, 0) < 0.0 || cell(high.y, 1) < 0.0 || area <= 0.0 {
        return;
    }
    for y in range(1) {
        for x in range(0) {
            let p = [x, y].map(|v| v as f64 + 0.5);
            let (px, py) = ((p[0] + first[0]) * CELL_M, (p[1] + first[1]) * CELL_M);
            let u = ((px - a.x) * (c.y - a.y) - (py - a.y) * (c.x - a.x)) / area;
            let v = ((b.x - a.x) * (py - a.y) - (b.y - a.y) * (px - a.x)) / area;
            if u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9 {
                give([x, y], a.z + u * (b.z - a.z) + v * (c.z - a.z));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quad over a rectangle of the plane, facing up or down, as two triangles; `up` is -y, as in a camera's world.
    fn quad(mesh: &mut Mesh, [x0, z0, x1, z1]: [f32; 4], height: f32, faces_up: bool) {
        let at = mesh.positions.len() as u32;
        mesh.positions.extend([[x0, -height, z0], [x1, -height, z0], [x1, -height, z1], [x0, -height, z1]]);
        let turned = |t: [u32; 3]| if faces_up { t } else { [t[0], t[2], t[1]] };
        mesh.triangles.extend([turned([at, at + 1, at + 2]), turned([at, at + 2, at + 3])]);
    }

    fn written(mesh: &Mesh) -> (String, [usize; 2], Vec<u16>) {
        let mut bytes = Vec::new();
        write_heights(mesh, [0.0, -1.0, 0.0], &mut bytes).expect("a heightmap");
        let head = bytes.windows(6).position(|w| w == b"65535\n").expect("a PGM") + 6;
        let text = String::from_utf8(bytes[..head].to_vec()).expect("text");
        let size =
            text.lines().rev().nth(1).expect("a size").split(' ').map(|n| n.parse().expect("a number"));
        let size: Vec<usize> = size.collect();
        let pixels = bytes[head..].as_chunks::<2>().0.iter().map(|b| u16::from_be_bytes(*b)).collect();
        (text, [size[0], size[1]], pixels)
    }

    #[test]
    fn floor_and_table_have_their_heights_and_the_ceiling_hides_nothing() {
        let mut mesh = Mesh::default();
        quad(&mut mesh, [0.0, 0.0, 2.0, 1.0], -1.5, true);
        quad(&mut mesh, [0.5, 0.25, 1.0, 0.5], -0.75, true);
        quad(&mut mesh, [0.0, 0.0, 2.0, 1.0], 1.0, false);
        let (text, [width, height], pixels) = written(&mesh);
        assert!(text.contains("+ -1.5; 0: unknown") && text.contains("# cell_m 0.05"), "{text}");
        assert!(text.contains("# y_axis 0 0 1") && text.contains("# lower_left_m 0 0"), "{text}");
        assert!((40..=41).contains(&width) && (20..=21).contains(&height), "{width} x {height}");
        // The cell that holds this place of the plane, counted from above.
        let at = |x: f64, z: f64| pixels[(height - 1 - (z / 0.05) as usize) * width + (x / 0.05) as usize];
        assert_eq!([at(0.12, 0.12), at(1.9, 0.9), at(0.72, 0.37), at(0.72, 0.62)], [1, 1, 751, 1]);
        assert_eq!(pixels.iter().filter(|p| **p == 751).count(), 10 * 5);
        assert_eq!(pixels.iter().filter(|p| **p > 0).count(), 40 * 20);
    }

    #[test]
    fn what_is_not_seen_is_unknown_and_bad_input_is_refused() {
        let mut mesh = Mesh::default();
        quad(&mut mesh, [0.0, 0.0, 0.5, 0.5], 0.0, true);
        quad(&mut mesh, [1.0, 1.0, 1.5, 1.5], 0.2, true);
        assert_eq!(written(&mesh).2.iter().filter(|p| **p > 0).count(), 200);
        let refused =
            |mesh: &Mesh, up| write_heights(mesh, up, &mut Vec::new()).expect_err("bad input").to_string();
        assert_eq!(refused(&mesh, [0.0; 3]), "no direction is up");
        assert_eq!(refused(&mesh, [f64::NAN, 0.0, 1.0]), "no direction is up");
        assert_eq!(refused(&mesh, [0.0, 1.0, 0.0]), "no surface faces up");
        assert_eq!(refused(&Mesh::default(), [0.0, 0.0, 1.0]), "no surface faces up");
        quad(&mut mesh, [1e5, 1e5, 1e5 + 1.0, 1e5 + 1.0], 0.2, true);
        assert_eq!(refused(&mesh, [0.0, -1.0, 0.0]), "the surface is too large for a heightmap");
        mesh.triangles.push([0, 1, 99]);
        mesh.positions[0] = [f32::NAN; 3];
        mesh.positions.truncate(8);
        mesh.triangles.truncate(4);
        assert!(write_heights(&mesh, [0.0, -1.0, 0.0], &mut Vec::new()).is_ok(), "the rest of it");
    }
}
