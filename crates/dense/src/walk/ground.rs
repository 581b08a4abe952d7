//! The ground that can be reached on foot, with the obstacles on it and above it: a costmap layer.

use super::Columns;
use std::collections::VecDeque;

/// The walker's capabilities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundConfig {
    /// The ground under the walker is searched within this distance of the level frame's zero, in metres.
    pub start_m: f32,
    /// Greatest step between neighbouring cells that still counts as ground, in metres.
    pub step_m: f32,
    /// Clearance that the walker needs above the ground, in metres.
    pub head_m: f32,
    /// Nothing up to this height above the ground is an obstacle (noise, carpets, sills), in metres.
    pub clear_m: f32,
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self { start_m: 0.3, step_m: 0.12, head_m: 2.0, clear_m: 0.15 }
    }
}

/// Class of a cell for a walker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// Not seen, or not reached.
    Unknown,
    /// Ground that can be walked on.
    Walkable,
    /// An obstacle that stands on the ground, at a height where it meets a foot or the body.
    Obstacle,
    /// Free below, with an obstacle at chest or head height.
    Overhead,
    /// The ground ends: free to below a step's height.
    Drop,
}

/// A cell of the layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Its class.
    pub surface: Surface,
    /// Height of the ground in metres of the level frame; NaN where there is none.
    pub ground_m: f32,
    /// Greatest height difference to the four neighbouring cells, in metres; 0 where none is known.
    pub step_m: f32,
    /// Slope of the ground (rise over run) across the neighbouring cells.
    pub slope: f32,
    /// Clearance above the ground in metres, as far as it was seen; infinite where nothing hangs above.
    pub room_m: f32,
    /// Height above the ground of the lowest part of the obstacle, in metres; NaN where there is none.
    pub blocked_m: f32,
}

impl Default for Cell {
    fn default() -> Self {
        let none = f32::NAN;
        Self {
            surface: Surface::Unknown,
            ground_m: none,
            step_m: 0.0,
            slope: 0.0,
            room_m: f32::INFINITY,
            blocked_m: none,
        }
    }
}

/// The layer over a window; cell `x + side * y`, as in the window's columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Ground {
    /// Cells along each side.
    pub side: usize,
    /// Cells in row-major order.
    pub cells: Vec<Cell>,
}

/// An obstacle below this height above the ground is met by the legs; a higher one only by chest and head.
const CHEST_M: f32 = 1.1;

impl Ground {
    /// Follows the ground from the middle of the window, cell by cell, over steps that a walker can take.
    pub fn follow(columns: &Columns, config: &GroundConfig) -> Self {
        let side = columns.side();
        let mut cells = vec![Cell::default(); side * side];
        let mut waiting = VecDeque::new();
        // From the walker outwards: the ground at the feet is seldom in view, and obstacles hide parts of it.
        for start in by_distance(side) {
            if cells[start].surface != Surface::Unknown {
                continue;
            }
            let Some(ground) = top_near(columns, start % side, start / side, 0.0, config.start_m) else {
                continue;
            };
            enter(columns, config, &mut cells[start], start, ground);
            if cells[start].surface != Surface::Walkable {
                cells[start] = Cell::default();
                continue;
            }
            waiting.push_back(start);
            spread(columns, config, &mut cells, &mut waiting);
        }
        // An obstacle where no ground was seen still counts as one, as if the ground continued level.
        for (i, cell) in cells.iter_mut().enumerate().filter(|(_, c)| c.surface == Surface::Unknown) {
            if let Some((surface, blocked_m)) = wall_at(columns, i % side, i / side, 0.0, config) {
                *cell = Cell { surface, blocked_m, ..Cell::default() };
            }
        }
        add_slopes(&mut cells, side, columns.window().cell_m as f32);
        Self { side, cells }
    }

    /// The cell at a position; `None` outside the window.
    pub fn at(&self, x: usize, y: usize) -> Option<&Cell> {
        (x < self.side && y < self.side).then(|| &self.cells[y * self.side + x])
    }
}

/// Follows the ground from cell to cell until the queue is empty.
fn spread(columns: &Columns, config: &GroundConfig, cells: &mut [Cell], waiting: &mut VecDeque<usize>) {
    let side = columns.side();
    while let Some(i) = waiting.pop_front() {
        if cells[i].surface != Surface::Walkable {
            continue;
        }
        let from = cells[i].ground_m;
        for n in neighbours(i, side) {
            if cells[n].surface != Surface::Unknown {
                continue;
            }
            let (x, y) = (n % side, n / side);
            if let Some(ground) = top_near(columns, x, y, from, config.step_m) {
                enter(columns, config, &mut cells[n], n, ground);
                waiting.push_back(n);
            } else if let Some(low) = wall_at(columns, x, y, from, config) {
                cells[n] = Cell { surface: low.0, ground_m: from, blocked_m: low.1, ..Cell::default() };
            } else if drops(columns, x, y, from, config) {
                cells[n] = Cell { surface: Surface::Drop, ..Cell::default() };
            }
        }
    }
}

/// Cells ordered from the middle outwards.
fn by_distance(side: usize) -> Vec<usize> {
    let middle = (side as f64 - 1.0) / 2.0;
    let away = |i: usize| ((i % side) as f64 - middle).powi(2) + ((i / side) as f64 - middle).powi(2);
    let mut all: Vec<usize> = (0..side * side).collect();
    all.sort_by(|&a, &b| away(a).total_cmp(&away(b)).then(a.cmp(&b)));
    all
}

fn neighbours(i: usize, side: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (i % side, i / side);
    let all = [
        (x > 0, i.wrapping_sub(1)),
        (x + 1 < side, i + 1),
        (y > 0, i.wrapping_sub(side)),
        (y + 1 < side, i + side),
    ];
    all.into_iter().filter(|(inside, _)| *inside).map(|(_, n)| n)
}

/// Top of the occupied span that ends nearest to a given height.
fn top_near(columns: &Columns, x: usize, y: usize, height_m: f32, within_m: f32) -> Option<f32> {
    let tops = columns.spans(x, y).iter().filter(|s| s.occupied).map(|s| s.high_m);
    let near = tops.filter(|t| (t - height_m).abs() <= within_m);
    near.min_by(|a, b| (a - height_m).abs().total_cmp(&(b - height_m).abs()))
}

/// Fills in a cell whose ground is known.
fn enter(columns: &Columns, config: &GroundConfig, cell: &mut Cell, i: usize, ground: f32) {
    let (x, y) = (i % columns.side(), i / columns.side());
    cell.ground_m = ground;
    let above = columns.spans(x, y).iter().find(|s| s.occupied && s.low_m >= ground);
    cell.room_m = above.map_or(f32::INFINITY, |s| s.low_m - ground);
    let in_way = columns.spans(x, y).iter().find(|s| {
        s.occupied
            && s.low_m >= ground
            && s.high_m > ground + config.clear_m
            && s.low_m < ground + config.head_m
    });
    cell.surface = match in_way {
        None => Surface::Walkable,
        Some(s) if s.low_m - ground < CHEST_M => Surface::Obstacle,
        Some(_) => Surface::Overhead,
    };
    cell.blocked_m = in_way.map_or(f32::NAN, |s| s.low_m - ground);
}

/// An obstacle at the expected ground height, or above it where the ground was not seen: its class and the height of
/// its lower end.
fn wall_at(
    columns: &Columns,
    x: usize,
    y: usize,
    from: f32,
    config: &GroundConfig,
) -> Option<(Surface, f32)> {
    let in_way = |low: f32, high: f32| high > from + config.clear_m && low < from + config.head_m;
    let span = columns.spans(x, y).iter().find(|s| s.occupied && in_way(s.low_m, s.high_m))?;
    let low = (span.low_m - from).max(0.0);
    Some((if low < CHEST_M { Surface::Obstacle } else { Surface::Overhead }, low))
}

/// Whether space is free from about the ground's height to more than a step below.
fn drops(columns: &Columns, x: usize, y: usize, from: f32, config: &GroundConfig) -> bool {
    let spans = columns.spans(x, y);
    spans
        .iter()
        .any(|s| !s.occupied && s.low_m < from - config.step_m && s.high_m > from - 0.5 * config.step_m)
}

fn add_slopes(cells: &mut [Cell], side: usize, cell_m: f32) {
    let ground: Vec<f32> = cells.iter().map(|c| c.ground_m).collect();
    for (i, cell) in cells.iter_mut().enumerate() {
        if cell.ground_m.is_nan() {
            continue;
        }
        let steps = neighbours(i, side).map(|n| (ground[n] - ground[i]).abs()).filter(|s| s.is_finite());
        cell.step_m = steps.fold(0.0, f32::max);
        let (x, y) = (i % side, i / side);
        let rise = |a: Option<usize>, b: Option<usize>| match (a, b) {
            (Some(a), Some(b)) => (ground[b] - ground[a]) / (2.0 * cell_m),
            _ => f32::NAN,
        };
        let along_x = rise((x > 0).then(|| i - 1), (x + 1 < side).then_some(i + 1));
        let along_y = rise((y > 0).then(|| i - side), (y + 1 < side).then_some(i + side));
        let known = [along_x, along_y].into_iter().filter(|v| v.is_finite());
        cell.slope = known.map(|v| v * v).sum::<f32>().sqrt();
    }
}
