//! Vertical spans of free and occupied space in each cell of a window.

use crate::{DenseError, Occupancy};
use cairn_geometry::{Se3, Vec3};

/// The window to sample, in a level frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Pose of the level frame (z up) in the map.
    pub world_from_level: Se3,
    /// Half of the window's side in metres, along x and y.
    pub half_m: f64,
    /// Edge of a cell in metres.
    pub cell_m: f64,
    /// Lowest and highest height, in metres.
    pub heights_m: [f64; 2],
    /// Vertical distance between two samples in metres: half of a voxel misses nothing.
    pub step_m: f64,
}

/// A vertical span of a column that is entirely free or entirely occupied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Lower end, in metres of the level frame.
    pub low_m: f32,
    /// Upper end, in metres of the level frame.
    pub high_m: f32,
    /// True when occupied, false when free.
    pub occupied: bool,
}

/// The columns of a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Columns {
    window: Window,
    side: usize,
    spans: Vec<Span>,
    /// Index of the first span of each cell, and the total at the end.
    starts: Vec<u32>,
}

/// A window that needs more samples than this is refused.
const MOST_LOOKS: f64 = 5e7;

impl Columns {
    /// Samples each cell of a window from below; unknown space belongs to no span.
    ///
    /// # Errors
    /// An invalid window, or one that needs too many samples.
    pub fn look(window: Window, at: impl Fn(&Vec3) -> Occupancy) -> Result<Self, DenseError> {
        let Window { world_from_level, half_m, cell_m, heights_m, step_m } = window;
        let side = (2.0 * half_m / cell_m).round();
        let looks = side * side * (heights_m[1] - heights_m[0]) / step_m;
        let positive = half_m > 0.0 && cell_m > 0.0 && step_m > 0.0 && heights_m[1] > heights_m[0];
        if !(positive && (1.0..=MOST_LOOKS).contains(&looks) && world_from_level.is_finite()) {
            return Err(DenseError::Config(format!("a window of {looks:.0} looks: {window:?}")));
        }
        let side = side as usize;
        let levels = ((heights_m[1] - heights_m[0]) / step_m).round().max(1.0) as usize;
        let mut out = Self { window, side, spans: Vec::new(), starts: vec![0] };
        let up = world_from_level.rotation * Vec3::z() * step_m;
        for i in 0..side * side {
            let [x, y] = out.centre_m(i % side, i / side);
            let mut p = world_from_level * Vec3::new(x, y, heights_m[0] + 0.5 * step_m);
            let mut open: Option<Span> = None;
            for level in 0..levels {
                let low_m = (heights_m[0] + level as f64 * step_m) as f32;
                let high_m = (heights_m[0] + (level + 1) as f64 * step_m) as f32;
                let known = match at(&p) {
                    Occupancy::Unknown => None,
                    what => Some(what == Occupancy::Occupied),
                };
                open = match (open, known) {
                    (Some(span), Some(occupied)) if span.occupied == occupied => {
                        Some(Span { high_m, ..span })
                    }
                    (before, known) => {
                        out.spans.extend(before);
                        known.map(|occupied| Span { low_m, high_m, occupied })
                    }
                };
                p += up;
            }
            out.spans.extend(open);
            out.starts.push(out.spans.len() as u32);
        }
        Ok(out)
    }

    /// Cells along each side.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Spans of a cell from below; none outside the window.
    pub fn spans(&self, x: usize, y: usize) -> &[Span] {
        if x >= self.side || y >= self.side {
            return &[];
        }
        let i = y * self.side + x;
        &self.spans[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// Centre of a cell in the level frame, in metres.
    pub fn centre_m(&self, x: usize, y: usize) -> [f64; 2] {
        [x, y].map(|v| (v as f64 + 0.5) * self.window.cell_m - self.window.half_m)
    }
}
