//! Walked ground: the recorded segments in a grid, for the distance of a point from the nearest of them.

use cairn_geometry::Vec3;
use std::collections::HashMap;

/// Recorded segments by cell; cells are only looked up, never iterated.
pub(crate) struct Tracks {
    cell: f64,
    segments: Vec<(Vec3, Vec3)>,
    cells: HashMap<(i64, i64, i64), Vec<u32>>,
}

impl Tracks {
    /// Takes the walked segments; `reach` is the largest distance that will be queried, in metres.
    pub fn new(walked: impl Iterator<Item = (Vec3, Vec3)>, reach: f64) -> Self {
        let mut tracks = Self { cell: 1.5 * reach.max(0.1), segments: Vec::new(), cells: HashMap::new() };
        for (a, b) in walked {
            let id = tracks.segments.len() as u32;
            tracks.segments.push((a, b));
            // Each point of the segment is within a quarter of a cell of a sample, and a query reaches two
            // thirds of a cell: a sample of every segment within reach lies in a neighbouring cell.
            let steps = ((b - a).norm() / (0.5 * tracks.cell)).ceil().max(1.0) as usize;
            for k in 0..=steps {
                let key = tracks.key(&(a + (b - a) * (k as f64 / steps as f64)));
                let list = tracks.cells.entry(key).or_default();
                if list.last() != Some(&id) {
                    list.push(id);
                }
            }
        }
        tracks
    }

    fn key(&self, p: &Vec3) -> (i64, i64, i64) {
        let k = |v: f64| (v / self.cell).floor() as i64;
        (k(p.x), k(p.y), k(p.z))
    }

    /// True when the point lies within `reach` (at most the one passed to [`Self::new`]) of walked ground.
    pub fn near(&self, p: &Vec3, reach: f64) -> bool {
        let (x, y, z) = self.key(p);
        let span = || -1..=1i64;
        span().any(|dx| {
            span().any(|dy| {
                span().any(|dz| {
                    self.cells.get(&(x + dx, y + dy, z + dz)).is_some_and(|list| {
                        list.iter().any(|&id| {
                            let (a, b) = self.segments[id as usize];
                            to_segment(p, &a, &b) <= reach
                        })
                    })
                })
            })
        })
    }

    /// True when the straight line from `a` to `b`, sampled every 5 cm, lies within `reach` of walked ground.
    pub fn covers(&self, a: &Vec3, b: &Vec3, reach: f64) -> bool {
        const STEP: f64 = 0.05;
        let steps = ((b - a).norm() / STEP).ceil().max(1.0) as usize;
        (0..=steps).all(|k| self.near(&(a + (b - a) * (k as f64 / steps as f64)), reach))
    }
}

/// The distance from a point to a segment, in metres.
pub(crate) fn to_segment(p: &Vec3, a: &Vec3, b: &Vec3) -> f64 {
    let d = b - a;
    let n = d.norm_squared();
    let t = if n > 0.0 { ((p - a).dot(&d) / n).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + d * t)).norm()
}
