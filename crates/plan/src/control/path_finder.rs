//! The path that a [`Navigator`](super::Navigator) follows: out of ground that is too near to a wall, over the costmap, around what
//! moves if waiting has taken as long, smoothed, to the exact goal.

use super::config::NavigatorConfig;
use super::reference::ReferencePath;
use super::way_out::way_out;
use crate::costmap::{Costmap, DynamicLayer};
use crate::grid::{Cell, Grid};
use crate::search::{BLOCKED, NoPath, Place, WeightedAStar};
use crate::smooth::{SmoothConfig, smooth};
use cairn_geometry::{Se2, Vec2};

/// Finds paths; keeps the memory of its search.
pub(super) struct PathFinder {
    search: WeightedAStar,
}

impl PathFinder {
    pub(super) fn new() -> Self {
        Self { search: WeightedAStar::new() }
    }

    /// The path from a pose to a goal; with `moving`, around it where that takes no longer than has been waited (seconds).
    pub(super) fn find(
        &mut self,
        config: &NavigatorConfig,
        pose: &Se2,
        goal: Vec2,
        costs: &Costmap,
        moving: Option<(&DynamicLayer, f64)>,
    ) -> Result<ReferencePath, NoPath> {
        let frame = costs.frame();
        if !goal.iter().all(|v| v.is_finite()) {
            return Err(NoPath::NotFinite(Place::Goal));
        }
        let goal_cell = frame.cell_at(goal).ok_or(NoPath::Outside(Place::Goal))?;
        let own = frame.cell_at(pose.translation).ok_or(NoPath::Outside(Place::Start))?;
        let out = way_out(costs, own, config.way_out_m);
        let out = out.ok_or(NoPath::Blocked { place: Place::Start, cell: own })?;
        let start = out.last().copied().unwrap_or(own);
        let past = self.search.search(costs.costs(), start, goal_cell)?;
        let path = match moving {
            Some((moving, waited_s)) => {
                let mut around = costs.costs().clone();
                block_moving(&mut around, moving, costs.config().radius_m, [start, goal_cell]);
                let longest_m = past.length_m(frame) + waited_s * config.pursuit.limits.linear;
                let around = self.search.search(&around, start, goal_cell).ok();
                around.filter(|path| path.length_m(frame) <= longest_m).unwrap_or(past)
            }
            None => past,
        };
        let keep_m = costs.config().touch_m(frame.resolution_m()) + costs.config().margin_m;
        let clearance_m = keep_m + config.room_m;
        let smoothing = SmoothConfig { radius_m: keep_m, clearance_m, ..config.smooth };
        let mut points = smooth(costs.field(), &path.cells, &smoothing).points;
        // The path runs from where the body stands, over its way out, to the exact goal.
        let out = out.iter().skip(1).map(|cell| frame.centre(*cell));
        points.splice(..points.len().min(1), std::iter::once(pose.translation).chain(out));
        if points.len() > 1 {
            points.pop();
        }
        points.push(goal);
        ReferencePath::new(&points).ok_or(NoPath::NotFinite(Place::Start))
    }
}

/// Blocks the cells where something moves now; start and goal stay as they are, and a body that is too near already is not shut in.
fn block_moving(costs: &mut Grid<u8>, moving: &DynamicLayer, radius_m: f64, ends: [Cell; 2]) {
    let frame = *costs.frame();
    for track in moving.tracks() {
        let middle = frame.in_cells(track.position);
        let start = Vec2::new(f64::from(ends[0].x) + 0.5, f64::from(ends[0].y) + 0.5);
        let reach = (track.radius_m + radius_m + 0.1) / frame.resolution_m();
        let reach = reach.min((start - middle).norm() - 1.5);
        let from = |v: f64| (v - reach).floor().max(0.0) as u32;
        let to = |v: f64, len: usize| (v + reach).ceil().clamp(0.0, len as f64) as u32;
        for y in from(middle.y)..to(middle.y, frame.height()) {
            for x in from(middle.x)..to(middle.x, frame.width()) {
                let off = Vec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - middle;
                if off.norm() <= reach && !ends.contains(&Cell::new(x, y)) {
                    costs.set(Cell::new(x, y), BLOCKED);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::costmap::{Detection, DynamicConfig};
    use crate::grid::GridFrame;

    #[test]
    fn a_body_close_to_someone_plans_away_from_him_and_around_him() {
        let frame = GridFrame::new(100, 60, 0.05, Se2::identity()).unwrap();
        let mut moving = DynamicLayer::new(DynamicConfig::default());
        moving.observe(0.0, &[Detection { position: Vec2::new(2.5, 1.5), radius_m: 0.3 }]);
        let cell = |x: f64, y: f64| frame.cell_at(Vec2::new(x, y)).unwrap();
        let costs = |from: Cell, to: Cell| {
            let mut costs = Grid::filled(frame, 10u8);
            block_moving(&mut costs, &moving, 0.2, [from, to]);
            costs
        };
        for x in [2.1, 1.8, 0.5] {
            let (from, to) = (cell(x, 1.5), cell(4.5, 1.5));
            let costs = costs(from, to);
            assert_eq!(costs.get(cell(2.5, 1.5)), Some(BLOCKED), "from {x} m");
            let way = WeightedAStar::new().search(&costs, from, to).unwrap();
            let nearest = way.cells.iter().map(|c| (frame.centre(*c) - Vec2::new(2.5, 1.5)).norm());
            assert!(nearest.fold(f64::INFINITY, f64::min) > (2.5f64 - x).min(0.6) - 0.15, "from {x} m");
        }
    }
}
