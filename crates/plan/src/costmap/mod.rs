//! Costs of cells, from layers: known static obstacles, their inflation by exact distance, unknown ground, walked
//! ground, and moving objects.
//!
//! Costs are those of [`crate::search::WeightedAStar`]: [`CostConfig::open`] on open ground, more near obstacles, less
//! where someone walked, [`BLOCKED`] where the robot does not fit. The distance field is kept beside them, for the
//! followers.

mod dynamic;

pub use dynamic::{Detection, DynamicConfig, DynamicLayer, Observed, Track};

use crate::distance::{DistanceField, NO_OBSTACLE, least_squared};
use crate::grid::{Cell, Grid, GridFrame};
use crate::passable::Passable;
use crate::search::BLOCKED;

/// Radii and weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostConfig {
    /// Radius of the robot or walker in metres.
    pub radius_m: f64,
    /// Margin that paths keep beyond the radius, in metres, because following is not exact. Half the diagonal of a cell
    /// is added.
    pub margin_m: f64,
    /// Distance from which an obstacle has no effect, in metres.
    pub inflation_m: f64,
    /// Cost of open ground.
    pub open: u8,
    /// Cost of walked ground; below `open`, it is preferred. The extra cost of walls beside it is divided by four.
    pub walked: u8,
    /// Cost where the robot just fits; it falls exponentially to `open` at the inflation distance.
    pub near: u8,
    /// Cost of unknown ground; `None` if it may not be entered.
    pub unknown: Option<u8>,
}

impl Default for CostConfig {
    fn default() -> Self {
        Self {
            radius_m: 0.2,
            margin_m: 0.05,
            inflation_m: 0.8,
            open: 20,
            walked: 12,
            near: 100,
            unknown: None,
        }
    }
}

impl CostConfig {
    /// Distance between the centre of the robot and that of an obstacle cell below which they may touch, in metres.
    pub fn touch_m(&self, resolution_m: f64) -> f64 {
        self.radius_m + std::f64::consts::FRAC_1_SQRT_2 * resolution_m
    }
}

/// Unusable configuration or layer.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CostError {
    /// A radius or margin is NaN, infinite or negative, or the inflation is less than both.
    #[error(
        "radius {radius_m} m and inflation {inflation_m} m: need 0 <= radius + margin <= inflation, all finite"
    )]
    Radius {
        /// Radius of the robot.
        radius_m: f64,
        /// Inflation distance.
        inflation_m: f64,
    },
    /// A cost is 0 or [`BLOCKED`].
    #[error("a cost is 0 or 255; costs are 1 to 254")]
    Cost,
    /// A layer has another size or pose.
    #[error("a layer has another frame than the map")]
    OtherGrid,
}

/// Costs, distances, and which cells may be entered.
#[derive(Clone, Debug)]
pub struct Costmap {
    config: CostConfig,
    /// Values as in ROS `OccupancyGrid`, as last given.
    map: Grid<i8>,
    walked: Grid<bool>,
    obstacles: Grid<bool>,
    field: DistanceField,
    costs: Grid<u8>,
    /// Cost by squared distance in cells; beyond its end the ground is open.
    by_distance: Vec<u8>,
}

impl Costmap {
    /// From a map of 0 (free) to 100, negative for unknown. Cells of 65 and more are obstacles, and so are unknown ones
    /// unless they have a cost.
    ///
    /// # Errors
    /// When radii or costs are unusable.
    pub fn new(map: Grid<i8>, config: CostConfig) -> Result<Self, CostError> {
        let CostConfig { radius_m, margin_m, inflation_m, open, walked, near, unknown } = config;
        let sound = radius_m >= 0.0 && margin_m >= 0.0 && inflation_m >= radius_m + margin_m;
        if !(sound && inflation_m.is_finite()) {
            return Err(CostError::Radius { radius_m, inflation_m });
        }
        if [open, walked, near, unknown.unwrap_or(1)].iter().any(|&c| c == 0 || c == BLOCKED) {
            return Err(CostError::Cost);
        }
        let obstacles = map.map(|v| is_obstacle(v, &config));
        let field = DistanceField::new(&obstacles);
        let frame = *map.frame();
        let by_distance = cost_by_distance(&config, &frame);
        let (walked, costs) = (Grid::filled(frame, false), Grid::filled(frame, BLOCKED));
        let mut costmap = Self { config, map, walked, obstacles, field, costs, by_distance };
        costmap.price(0..frame.height());
        Ok(costmap)
    }

    /// Sets which ground was walked.
    ///
    /// # Errors
    /// When the layer has another frame.
    pub fn set_walked(&mut self, walked: Grid<bool>) -> Result<(), CostError> {
        if walked.frame() != self.map.frame() {
            return Err(CostError::OtherGrid);
        }
        self.walked = walked;
        self.price(0..self.map.frame().height());
        Ok(())
    }

    /// Takes changed cells and computes only the affected rows again. The result is that of a new map. Cells outside
    /// are ignored. Returns the number of rows whose costs were computed again.
    pub fn update(&mut self, changes: &[(Cell, i8)]) -> usize {
        let mut changed = Vec::new();
        let mut rows = Vec::new();
        for &(cell, value) in changes {
            if self.map.set(cell, value) {
                rows.push(cell.y as usize);
                let obstacle = is_obstacle(value, &self.config);
                if self.obstacles.get(cell) != Some(obstacle) {
                    self.obstacles.set(cell, obstacle);
                    changed.push(cell);
                }
            }
        }
        rows.extend(self.field.update(&self.obstacles, &changed));
        rows.sort_unstable();
        rows.dedup();
        rows.iter().for_each(|&y| self.price(y..y + 1));
        rows.len()
    }

    /// The configuration.
    pub fn config(&self) -> &CostConfig {
        &self.config
    }

    /// Size, resolution and pose of the grid.
    pub fn frame(&self) -> &GridFrame {
        self.map.frame()
    }

    /// Costs for a weighted search.
    pub fn costs(&self) -> &Grid<u8> {
        &self.costs
    }

    /// The map the costs were computed from.
    pub fn map(&self) -> &Grid<i8> {
        &self.map
    }

    /// Distances to the nearest obstacle.
    pub fn field(&self) -> &DistanceField {
        &self.field
    }

    /// The cells that may be entered.
    pub fn passable(&self) -> Passable {
        Passable::from_values(&self.costs, |c| c != BLOCKED)
    }

    /// Computes the costs of some rows.
    fn price(&mut self, rows: std::ops::Range<usize>) {
        let (width, config) = (self.map.frame().width(), self.config);
        let range = rows.start * width..rows.end * width;
        let layers = self.map.values()[range.clone()].iter().zip(&self.walked.values()[range.clone()]);
        let squared = &self.field.squared()[range.clone()];
        let costs = &mut self.costs.values_mut()[range];
        for (cost, ((&map, &walked), &squared)) in costs.iter_mut().zip(layers.zip(squared)) {
            let near = if squared == NO_OBSTACLE { None } else { self.by_distance.get(squared as usize) };
            let near = near.copied().unwrap_or(config.open);
            let ground = match (map < 0, config.unknown) {
                (true, Some(unknown)) => near.max(unknown),
                // Where someone walked, the extra cost of walls beside is divided by four.
                _ if walked => {
                    config.walked.saturating_add(near.saturating_sub(config.open) / 4).min(BLOCKED - 1)
                }
                _ => near,
            };
            *cost = if near == BLOCKED { BLOCKED } else { ground };
        }
    }
}

fn is_obstacle(value: i8, config: &CostConfig) -> bool {
    value >= 65 || (value < 0 && config.unknown.is_none())
}

/// Costs by squared distance, from 0 until open ground is reached, or the longest distance on the map.
fn cost_by_distance(config: &CostConfig, frame: &GridFrame) -> Vec<u8> {
    let resolution_m = frame.resolution_m();
    let keep_m = config.touch_m(resolution_m) + config.margin_m;
    let blocked_below = least_squared(keep_m, resolution_m);
    let end = (config.inflation_m / resolution_m).powi(2) as u32;
    let longest = ((frame.width() - 1).pow(2) + (frame.height() - 1).pow(2)) as u32;
    let (open, near) = (f64::from(config.open), f64::from(config.near));
    // Falls to a hundredth at the inflation distance.
    let rate = 100f64.ln() / (config.inflation_m - keep_m).max(1e-9);
    let cost = |squared: u32| {
        let beyond_m = f64::from(squared).sqrt() * resolution_m - keep_m;
        (open + (near - open) * (-rate * beyond_m).exp()).round().clamp(1.0, 254.0) as u8
    };
    let all = 0..=end.max(blocked_below).min(longest);
    all.map(|s| if s < blocked_below { BLOCKED } else { cost(s) }).collect()
}
