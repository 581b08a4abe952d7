//! A map file, two points, and a path between them: the work of the command `cairn plan`.

use crate::costmap::{CostConfig, CostError, Costmap};
use crate::grid::{Cell, Grid};
use crate::map_server::{self, MapFileError};
use crate::moving_ai::{self, MovingAiError};
use crate::search::{AStar, GridPath, JumpPoint, LazyTheta, NoPath, Place, WeightedAStar, free_cell};
use crate::smooth::{SmoothConfig, SmoothPath, smooth};
use cairn_geometry::Vec2;
use std::path::Path;

/// Which search is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Search {
    /// Over the costmap: prefers wide passages.
    Costs,
    /// Shortest grid path, by A*.
    AStar,
    /// Shortest grid path, by jump point search.
    JumpPoint,
    /// Any-angle path, by Lazy Theta*.
    AnyAngle,
}

/// A map that could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Files of `map_server` that could not be read.
    #[error(transparent)]
    MapServer(#[from] MapFileError),
    /// A Moving AI map that could not be read.
    #[error("{file}: {source}")]
    MovingAi {
        /// The file.
        file: String,
        /// The line and what is wrong.
        source: MovingAiError,
    },
}

/// Opens a `map_server` map by its YAML, or a Moving AI map by its extension `.map` (cells of one metre, first row at y
/// = 0).
///
/// # Errors
/// When a file is missing or malformed.
pub fn open_map(path: &Path) -> Result<Grid<i8>, OpenError> {
    if path.extension().is_none_or(|e| e != "map") {
        return Ok(map_server::load(path)?.0);
    }
    let file = path.display().to_string();
    let text = cairn_files::read_text_lossy(path, map_server::MAX_BYTES)
        .map_err(|source| MapFileError::File { file: path.to_owned(), source })?;
    let map = moving_ai::read_map(&text);
    Ok(map.map_err(|source| OpenError::MovingAi { file, source })?.map(|free| if free { 0 } else { 100 }))
}

/// A planned path, before and after smoothing.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedPath {
    /// The path of the search.
    pub path: GridPath,
    /// The smoothed path, to be followed.
    pub smooth: SmoothPath,
}

/// Why no route was planned.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Radii or costs are unusable.
    #[error(transparent)]
    Costs(#[from] CostError),
    /// No path.
    #[error(transparent)]
    Path(#[from] NoPath),
}

/// Plans a path between two points (metres, world) for a body with the radius of the costmap.
///
/// # Errors
/// When the costs are unusable, or there is no path.
pub fn plan(
    map: &Grid<i8>,
    config: &CostConfig,
    search: Search,
    from: Vec2,
    to: Vec2,
) -> Result<PlannedPath, PlanError> {
    let costs = Costmap::new(map.clone(), *config)?;
    let passable = costs.passable();
    if passable.free() == 0 {
        return Err(NoPath::NoFreeCell.into());
    }
    let start: Cell = free_cell(&passable, Place::Start, from)?;
    let goal = free_cell(&passable, Place::Goal, to)?;
    let path = match search {
        Search::Costs => WeightedAStar::new().search(costs.costs(), start, goal),
        Search::AStar => AStar::new().search(&passable, start, goal),
        Search::JumpPoint => JumpPoint::new().search(&passable, start, goal),
        Search::AnyAngle => LazyTheta::new().search(&passable, start, goal),
    }?;
    let keep_m = config.touch_m(map.frame().resolution_m()) + config.margin_m;
    let smoothing = SmoothConfig {
        radius_m: keep_m,
        clearance_m: if search == Search::Costs { keep_m + 0.2 } else { keep_m },
        spacing_m: (2.0 * map.frame().resolution_m()).max(0.1),
        ..SmoothConfig::default()
    };
    let smooth = smooth(costs.field(), &path.cells, &smoothing);
    Ok(PlannedPath { path, smooth })
}
