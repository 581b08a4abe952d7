//! The triangles of a cell for each set of inside corners: derived, not listed.
//!
//! Lorensen and Cline, "Marching cubes" (SIGGRAPH 1987). Corner `i` lies at `(i & 1, i >> 1 & 1, i >> 2)`. On each
//! face of the cell, every run of inside corners is cut off by one segment, so two inside corners on a diagonal stay
//! separate. This rule depends on the face alone: the two cells that share a face agree, and the surface has no
//! holes. The segments of all faces join into loops around the inside, and each loop becomes a fan of triangles.

use std::sync::LazyLock;

/// An edge: axis times four, plus the index of its lower corner among the four corners where an edge of that axis may
/// start.
pub type Edge = u8;

/// Triangles for all 256 sets of inside corners; counter-clockwise as seen from outside.
pub static TRIANGLES: LazyLock<Vec<Vec<[Edge; 3]>>> = LazyLock::new(|| (0..256).map(triangles).collect());

/// The edge between two corners that differ in one coordinate.
fn edge_between(a: usize, b: usize) -> Edge {
    let (low, axis) = (a.min(b), (a ^ b).trailing_zeros() as usize);
    // The two other coordinates of the lower corner, packed.
    let (below, above) = (low & ((1 << axis) - 1), low >> (axis + 1));
    (axis * 4 + (below | above << axis)) as Edge
}

/// Axis and lower corner of an edge.
pub fn edge_start(edge: Edge) -> (usize, usize) {
    let (axis, place) = (edge as usize / 4, edge as usize % 4);
    let below = place & ((1 << axis) - 1);
    (axis, below | (place >> axis) << (axis + 1))
}

/// Corners of a face, counter-clockwise as seen from outside the cell.
fn face(axis: usize, upper: bool) -> [usize; 4] {
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let at = if upper { 1 << axis } else { 0 };
    if upper { [at, at | u, at | u | v, at | v] } else { [at, at | v, at | u | v, at | u] }
}

fn triangles(inside: usize) -> Vec<[Edge; 3]> {
    let is_inside = |corner: usize| inside >> corner & 1 == 1;
    // For each edge crossed into a run of inside corners: the edge on the same face by which the run is left.
    let mut next = [None; 12];
    for (axis, upper) in [(0, false), (0, true), (1, false), (1, true), (2, false), (2, true)] {
        let corners = face(axis, upper);
        for i in 0..4 {
            let (before, first) = (corners[i], corners[(i + 1) % 4]);
            if is_inside(before) || !is_inside(first) {
                continue;
            }
            let mut last = i + 1;
            while is_inside(corners[(last + 1) % 4]) {
                last += 1;
            }
            let leave = edge_between(corners[last % 4], corners[(last + 1) % 4]);
            next[edge_between(before, first) as usize] = Some(leave);
        }
    }
    let mut out = Vec::new();
    for start in 0..12 {
        let Some(mut at) = next[start].take() else { continue };
        let mut ring = vec![start as Edge];
        while at as usize != start {
            ring.push(at);
            let Some(following) = next[at as usize].take() else { break };
            at = following;
        }
        out.extend((1..ring.len() - 1).map(|i| [ring[0], ring[i], ring[i + 1]]));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn edges_and_corners_name_each_other() {
        for edge in 0..12 {
            let (axis, corner) = edge_start(edge);
            assert_eq!(corner >> axis & 1, 0);
            assert_eq!(edge_between(corner, corner | 1 << axis), edge);
        }
    }

    /// The surface in a cell ends only on the cell's faces, and every crossed edge is used.
    #[test]
    fn every_case_is_a_surface_without_a_hole() {
        for inside in 0..256usize {
            let crossed: Vec<Edge> = (0..12)
                .filter(|&e| {
                    let (axis, corner) = edge_start(e);
                    (inside >> corner & 1) != (inside >> (corner | 1 << axis) & 1)
                })
                .collect();
            let mut used: Vec<Edge> = TRIANGLES[inside].iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            assert_eq!(used, crossed, "case {inside}");
            let mut sides: BTreeMap<(Edge, Edge), i32> = BTreeMap::new();
            for t in &TRIANGLES[inside] {
                for k in 0..3 {
                    let (a, b) = (t[k], t[(k + 1) % 3]);
                    *sides.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
                }
            }
            // A side that is not shared lies between two edges of one face.
            for ((a, b), balance) in sides {
                assert!(balance.abs() <= 1);
                if balance != 0 {
                    assert!(share_a_face(a, b), "case {inside}: {a} {b}");
                }
            }
        }
    }

    fn share_a_face(a: Edge, b: Edge) -> bool {
        let ends = |e: Edge| {
            let (axis, corner) = edge_start(e);
            [corner, corner | 1 << axis]
        };
        (0..3).any(|axis| {
            [0, 1].iter().any(|&side| ends(a).iter().chain(&ends(b)).all(|c| c >> axis & 1 == side))
        })
    }

    #[test]
    fn triangles_face_away_from_the_inside() {
        for corner in 0..8usize {
            let middle = |e: Edge| {
                let (axis, c) = edge_start(e);
                let mut p = [0, 1, 2].map(|k| (c >> k & 1) as f64);
                p[axis] = 0.5;
                nalgebra::Vector3::from(p)
            };
            let [a, b, c] = TRIANGLES[1 << corner][0].map(middle);
            let at = nalgebra::Vector3::from([0, 1, 2].map(|k| (corner >> k & 1) as f64));
            assert!((b - a).cross(&(c - a)).dot(&(a - at)) > 0.0, "corner {corner}");
        }
    }
}
