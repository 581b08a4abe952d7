//! Occupancy from range rays: a grid of log odds (Moravec and Elfes 1985; Thrun, Burgard and Fox, Probabilistic
//! Robotics, table 9.1, with the clamping bounds of Hornung et al., OctoMap, 2013, equation 4).
//!
//! A cell that no ray reached stays unknown: cells never seen and cells seen with doubt are distinguished. Within one
//! scan a cell is updated once, and a hit outweighs the misses of neighbouring rays, so that walls seen at a grazing
//! angle stay.

use crate::grid::{Cell, Grid, GridFrame};
use crate::map_server::UNKNOWN;
use cairn_geometry::{Se2, Vec2};

/// Log odds of the sensor model, and thresholds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OccupancyConfig {
    /// Added where a ray ends (a hit).
    pub hit: f64,
    /// Added where a ray passes through (a miss); negative.
    pub miss: f64,
    /// Log odds are clamped to these two bounds, so that a cell can still change its state later.
    pub bounds: (f64, f64),
    /// Cells nearer than this to the sensor are not marked as free, in metres: what is too low to be seen by a camera
    /// close by must not be taken away. 0 for a laser that scans a plane.
    pub min_range_m: f64,
    /// Returns farther than this are not used as hits, in metres.
    pub max_range_m: f64,
    /// A cell is occupied above this probability.
    pub occupied_threshold: f64,
    /// A cell is free below this probability.
    pub free_threshold: f64,
}

impl Default for OccupancyConfig {
    fn default() -> Self {
        Self {
            hit: 1.4,
            miss: -0.7,
            bounds: (-2.0, 3.5),
            min_range_m: 0.0,
            max_range_m: 10.0,
            occupied_threshold: 0.65,
            free_threshold: 0.196,
        }
    }
}

/// What became of the rays of a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanReport {
    /// Rays that ended on something inside the grid.
    pub hits: usize,
    /// Rays that only show free cells: nothing within range, or the end outside the grid.
    pub passes: usize,
    /// Rays with a range that is NaN or not positive, or a bearing that is not finite: they are ignored.
    pub rejected: usize,
    /// Cells that became more likely occupied.
    pub cells_hit: usize,
    /// Cells that became more likely free.
    pub cells_passed: usize,
}

/// Why a whole scan was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScanRejected {
    /// The pose holds NaN or infinity.
    #[error("the pose of the scan is not finite")]
    Pose,
    /// The sensor is outside the grid.
    #[error("the sensor stands outside the grid")]
    Outside,
}

/// Log odds of unknown cells; no update can reach this value.
const NEVER: f32 = f32::NEG_INFINITY;

/// A grid of log odds.
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    log_odds: Grid<f32>,
    config: OccupancyConfig,
    /// The last scan that changed a cell: twice its number, plus one for a hit.
    touched: Vec<u32>,
    scan: u32,
}

impl OccupancyGrid {
    /// A grid with all cells unknown.
    pub fn new(frame: GridFrame, config: OccupancyConfig) -> Self {
        Self { log_odds: Grid::filled(frame, NEVER), config, touched: vec![0; frame.len()], scan: 0 }
    }

    /// From a map of 0 to 100, or unknown: to continue an earlier map.
    pub fn from_map(map: &Grid<i8>, config: OccupancyConfig) -> Self {
        let (low, high) = config.bounds;
        let odds = |p: f64| (p / (1.0 - p)).ln().clamp(low, high) as f32;
        let log_odds = map.map(|v| if (0..=100).contains(&v) { odds(f64::from(v) / 100.0) } else { NEVER });
        Self { log_odds, config, touched: vec![0; map.frame().len()], scan: 0 }
    }

    /// Size, resolution and pose of the grid.
    pub fn frame(&self) -> &GridFrame {
        self.log_odds.frame()
    }

    /// Probability that a cell is occupied; `None` where no ray has been, and outside.
    pub fn probability(&self, cell: Cell) -> Option<f64> {
        let odds = self.log_odds.get(cell).filter(|&l| l != NEVER)?;
        Some(1.0 / (1.0 + f64::from(-odds).exp()))
    }

    /// Inserts a planar scan: each ray is a bearing in radians and a range in metres, measured from
    /// `world_from_sensor`. A range beyond [`OccupancyConfig::max_range_m`], also infinity, marks everything up to that
    /// range as free.
    ///
    /// # Errors
    /// When the pose is not finite or outside the grid; nothing is changed then.
    pub fn insert_scan(
        &mut self,
        world_from_sensor: &Se2,
        rays: impl IntoIterator<Item = (f64, f64)>,
    ) -> Result<ScanReport, ScanRejected> {
        let (t, r) = (world_from_sensor.translation, world_from_sensor.rotation);
        if ![t.x, t.y, r.cos(), r.sin()].iter().all(|v| v.is_finite()) {
            return Err(ScanRejected::Pose);
        }
        self.frame().cell_at(t).ok_or(ScanRejected::Outside)?;
        self.next_scan();
        let mut report = ScanReport::default();
        for (bearing, range) in rays {
            if !bearing.is_finite() || range.is_nan() || range <= 0.0 {
                report.rejected += 1;
                continue;
            }
            let ends = range <= self.config.max_range_m;
            let reach = range.min(self.config.max_range_m);
            let end = *world_from_sensor * Vec2::new(reach * bearing.cos(), reach * bearing.sin());
            let hit = self.frame().cell_at(end).filter(|_| ends);
            if reach > self.config.min_range_m {
                let from = t + (end - t) * (self.config.min_range_m.max(0.0) / reach);
                self.pass(from, end, hit, &mut report);
            }
            match hit {
                Some(cell) => {
                    report.hits += 1;
                    report.cells_hit += usize::from(self.hit(cell));
                }
                None => report.passes += 1,
            }
        }
        Ok(report)
    }

    /// Marks walked ground as free: all cells within `radius_m` of the line through the points (metres, world). Points
    /// that are not finite interrupt the line. Returns how many cells were set to certainly free.
    pub fn mark_walked(&mut self, line: &[Vec2], radius_m: f64) -> usize {
        let (frame, low) = (*self.frame(), self.config.bounds.0 as f32);
        let finite = |p: &Vec2| p.x.is_finite() && p.y.is_finite();
        let mut marked = 0;
        for pair in line.windows(2).filter(|w| finite(&w[0]) && finite(&w[1])) {
            let [a, b] = [frame.in_cells(pair[0]), frame.in_cells(pair[1])];
            let reach = radius_m.max(0.0) / frame.resolution_m();
            let from = |v: f64| (v - reach).floor().max(0.0) as usize;
            let to = |v: f64, len: usize| ((v + reach).floor().max(-1.0) + 1.0).min(len as f64) as usize;
            for y in from(a.y.min(b.y))..to(a.y.max(b.y), frame.height()) {
                for x in from(a.x.min(b.x))..to(a.x.max(b.x), frame.width()) {
                    let middle = Vec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    let along = (b - a).dot(&(middle - a)) / (b - a).norm_squared().max(1e-12);
                    let near = a + (b - a) * along.clamp(0.0, 1.0);
                    let value = &mut self.log_odds.values_mut()[y * frame.width() + x];
                    if (middle - near).norm() <= reach.max(0.5) && *value != low {
                        *value = low;
                        marked += 1;
                    }
                }
            }
        }
        marked
    }

    /// The map as values of a ROS `OccupancyGrid`: 100 occupied, 0 free, else unknown, by the thresholds.
    pub fn to_map(&self) -> Grid<i8> {
        let odds = |p: f64| (p / (1.0 - p)).ln() as f32;
        let (occupied, free) = (odds(self.config.occupied_threshold), odds(self.config.free_threshold));
        self.log_odds.map(|l| match l {
            NEVER => UNKNOWN,
            l if l > occupied => 100,
            l if l < free => 0,
            _ => UNKNOWN,
        })
    }

    /// The map as values of a ROS `OccupancyGrid` without thresholds: the probability in percent, unknown where no ray
    /// has been.
    pub fn to_probabilities(&self) -> Grid<i8> {
        let percent = |l: f32| (100.0 / (1.0 + f64::from(-l).exp())).round() as i8;
        self.log_odds.map(|l| if l == NEVER { UNKNOWN } else { percent(l) })
    }

    /// The same cells in a larger frame that contains them all, with the same resolution and orientation.
    pub(crate) fn grown(self, frame: GridFrame) -> Self {
        let mut grown = Self::new(frame, self.config);
        let old = *self.frame();
        for y in 0..old.height() {
            let first = frame.cell_at(old.centre(Cell::new(0, y as u32))).and_then(|c| frame.index(c));
            let row = first.and_then(|at| grown.log_odds.values_mut().get_mut(at..at + old.width()));
            if let Some(row) = row {
                row.copy_from_slice(self.log_odds.row(y));
            }
        }
        grown
    }

    fn next_scan(&mut self) {
        self.scan += 1;
        if self.scan == u32::MAX / 2 {
            self.touched.fill(0);
            self.scan = 1;
        }
    }

    /// Lowers the odds of the cells of a ray before its end (Amanatides and Woo, "A Fast Voxel Traversal Algorithm",
    /// 1987).
    fn pass(&mut self, from: Vec2, to: Vec2, hit: Option<Cell>, report: &mut ScanReport) {
        let frame = *self.frame();
        let (a, b) = (frame.in_cells(from), frame.in_cells(to));
        let ray = b - a;
        let (mut x, mut y) = (a.x.floor() as i64, a.y.floor() as i64);
        let sign = |v: f64| if v > 0.0 { 1 } else { -1 };
        let (step_x, step_y) = (sign(ray.x), sign(ray.y));
        // Position on the ray (0 to 1) where the next cell border is crossed.
        let border = |p: f64, cell: i64, step: i64, d: f64| {
            if d == 0.0 { f64::INFINITY } else { ((cell + i64::from(step > 0)) as f64 - p) / d }
        };
        let (mut next_x, mut next_y) = (border(a.x, x, step_x, ray.x), border(a.y, y, step_y, ray.y));
        let (over_x, over_y) = (1.0 / ray.x.abs(), 1.0 / ray.y.abs());
        while x >= 0 && y >= 0 && (x as usize) < frame.width() && (y as usize) < frame.height() {
            if hit == Some(Cell::new(x as u32, y as u32)) {
                return;
            }
            report.cells_passed += usize::from(self.miss(y as usize * frame.width() + x as usize));
            if next_x.min(next_y) > 1.0 {
                return;
            }
            if next_x < next_y {
                (x, next_x) = (x + step_x, next_x + over_x);
            } else {
                (y, next_y) = (y + step_y, next_y + over_y);
            }
        }
    }

    fn miss(&mut self, index: usize) -> bool {
        let fresh = self.touched[index] / 2 != self.scan;
        if fresh {
            self.touched[index] = self.scan * 2;
            self.add(index, self.config.miss);
        }
        fresh
    }

    fn hit(&mut self, cell: Cell) -> bool {
        let Some(index) = self.frame().index(cell) else { return false };
        let touched = self.touched[index];
        if touched == self.scan * 2 + 1 {
            return false;
        }
        self.touched[index] = self.scan * 2 + 1;
        // Undoes an earlier miss of the same scan.
        let back = if touched == self.scan * 2 { -self.config.miss } else { 0.0 };
        self.add(index, self.config.hit + back);
        true
    }

    fn add(&mut self, index: usize, odds: f64) {
        let (low, high) = self.config.bounds;
        let value = &mut self.log_odds.values_mut()[index];
        let before = if *value == NEVER { 0.0 } else { f64::from(*value) };
        *value = (before + odds).clamp(low, high) as f32;
    }
}
