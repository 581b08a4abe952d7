//! Hazards in a walker's path, as plain data.

use super::{Columns, Ground, Surface};

/// The strip ahead in which hazards are searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HazardConfig {
    /// How far ahead, in metres.
    pub ahead_m: f64,
    /// Half of the strip's width, in metres.
    pub half_width_m: f64,
    /// Cells nearer than this are ignored (the walker's own body, or out of view), in metres.
    pub from_m: f64,
    /// Fewer cells of a kind than this count as noise.
    pub least_cells: usize,
}

impl Default for HazardConfig {
    fn default() -> Self {
        Self { ahead_m: 2.5, half_width_m: 0.35, from_m: 0.3, least_cells: 2 }
    }
}

/// Kind of hazard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HazardKind {
    /// An obstacle on the ground.
    Obstacle,
    /// An obstacle at chest or head height that a cane passes under.
    HeadHeight,
    /// The ground ends (a drop).
    StepDown,
    /// The ground was not seen.
    UnknownGround,
}

/// The nearest hazard of its kind in the strip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hazard {
    /// Its kind.
    pub kind: HazardKind,
    /// Distance ahead of its nearest cell, in metres.
    pub ahead_m: f64,
    /// Mean lateral offset of the nearest cells from the strip's centre line, in metres: positive to the left,
    /// negative to the right.
    pub left_m: f64,
    /// Number of cells of this kind in the strip.
    pub cells: usize,
}

/// The nearest hazard of each kind in the strip that starts at the middle of the window and points in a direction
/// (radians from the level frame's x towards y), nearest first.
pub fn hazards(columns: &Columns, ground: &Ground, heading_rad: f64, config: &HazardConfig) -> Vec<Hazard> {
    let (sin, cos) = heading_rad.sin_cos();
    let cell_m = columns.window().cell_m;
    let mut found: Vec<(HazardKind, Vec<[f64; 2]>)> = Vec::new();
    for (i, cell) in ground.cells.iter().enumerate() {
        let [x, y] = columns.centre_m(i % ground.side, i / ground.side);
        let (ahead, left) = (x * cos + y * sin, y * cos - x * sin);
        if !(config.from_m..=config.ahead_m).contains(&ahead) || left.abs() > config.half_width_m {
            continue;
        }
        let kind = match cell.surface {
            Surface::Walkable => continue,
            Surface::Obstacle => HazardKind::Obstacle,
            Surface::Overhead => HazardKind::HeadHeight,
            Surface::Drop => HazardKind::StepDown,
            Surface::Unknown => HazardKind::UnknownGround,
        };
        match found.iter_mut().find(|(k, _)| *k == kind) {
            Some((_, cells)) => cells.push([ahead, left]),
            None => found.push((kind, vec![[ahead, left]])),
        }
    }
    let mut out: Vec<Hazard> = found
        .into_iter()
        .filter(|(_, cells)| cells.len() >= config.least_cells)
        .map(|(kind, cells)| {
            let ahead_m = cells.iter().map(|c| c[0]).fold(f64::INFINITY, f64::min);
            let near: Vec<f64> =
                cells.iter().filter(|c| c[0] < ahead_m + 2.0 * cell_m).map(|c| c[1]).collect();
            let left_m = near.iter().sum::<f64>() / near.len().max(1) as f64;
            Hazard { kind, ahead_m, left_m, cells: cells.len() }
        })
        .collect();
    out.sort_by(|a, b| a.ahead_m.total_cmp(&b.ahead_m));
    out
}
