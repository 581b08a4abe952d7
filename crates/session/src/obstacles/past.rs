//! A way past what is in the way, back to the route beyond it, in what a walker who goes by words does exactly: he walks straight
//! on, and he steps back and to a side without turning. Turns end somewhere about where they should.
//!
//! On which side of it he is led past is decided by a way that is searched on a grid of what is seen (A*), with as much clearance
//! as there is, and kept as long as there is one on that side. Of the moves that lead past on that side the fewest are taken: turns
//! by as much as people turn who are told to bear, then steps back and aside, then straight on. Where none do, he comes nearer,
//! passes it on the other side, steps back from it, or follows the way that was searched in straight legs.

use super::strip::direction;
use cairn_dense::walk::Blocked;
use cairn_geometry::{Se2, Vec2};
use cairn_guide::{FreeWay, Guide, Heading, wrap};
use cairn_plan::search::{self, AStar, free_cell};
use cairn_plan::{Cell, DistanceField, Grid, GridFrame, Passable};
use std::f64::consts::FRAC_PI_2;

/// Distances of the way past an obstacle from what is seen, metres: the first that leaves a way. The last is a gap as wide as
/// a narrow door.
const CLEARANCES_M: [f64; 4] = [0.7, 0.55, 0.42, 0.32];
/// The way back to the route is searched up to this far beyond the obstacle, metres.
const BEYOND_M: [f64; 2] = [0.6, 2.4];
/// ... and no farther aside from it, metres: what lies behind the walls is unknown, not free.
const ASIDE_M: f64 = 1.3;
/// The way is searched this far around the walker, metres.
const SEARCHED_M: f64 = 4.4;
/// Side of the cells that are searched, metres.
const CELL_M: f64 = 0.05;
/// A leg of the way is looked for within this angle of where the way leads, degrees ...
const LEG_DEG: f64 = 60.0;
/// ... so free on both sides, degrees: people who are told to bear or to stop turning end up about so far from where they should.
const OFF_DEG: [f64; 3] = [12.0, 8.0, 5.0];

/// What is in the way is passed so far beyond where it begins, metres, as far as can be seen.
const PAST_M: f64 = 0.75;
const FARTHEST_M: f64 = 4.0;
/// Past it he is sent in a heading at most so far off the route's, radians.
const MOST_AWAY_RAD: f64 = 0.45;
/// Who faces nearer than this to a heading is not turned to it, radians: a turn that people make by words ends no nearer.
pub(super) const NEARLY_RAD: f64 = 0.17;
/// People who are told to bear turn by about this, radians.
const BEAR_RAD: f64 = 0.33;
/// Half of the strip in which he is sent past something, metres: wider than the one for which he is stopped, since he veers.
const ROOM_M: f64 = 0.38;
/// At most so many steps aside.
const MOST_STEPS: i32 = 5;
/// A side is kept while what is in the way is no farther than this from where it was, metres; beside it the other side is closed
/// so far along the route.
const SAME_M: f64 = 0.8;
const CLOSED_M: f64 = 0.5;
/// A step back and to a side: halfway between the two, radians, half a metre, with so much free beyond it.
const STEP_RAD: f64 = 0.75 * std::f64::consts::PI;
const STEP_M: f64 = 0.5;
const BESIDE_M: f64 = 0.35;
/// From what is nearer than this straight ahead he steps back where no way leads past it, metres.
const TOO_NEAR_M: f64 = 2.0;
/// A leg is walked no farther than this before he is directed anew, metres: beyond it what is seen is too coarse.
const LONGEST_M: f64 = 3.2;

/// The first leg of a way past what is in the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leg {
    /// Radians on the ground plane.
    pub heading: f64,
    /// Metres that are free there.
    pub free_m: f64,
}

/// What a walker who stands before something is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Plan {
    Walk(Leg),
    /// Step back and to a side: plus one for left.
    StepBack(f64),
}

/// Searches ways past obstacles.
pub(super) struct Past {
    search: AStar,
    /// Where the obstacle that he is led past was when a side was chosen, and the side: plus one for left.
    side: Option<(Vec2, f64)>,
}

/// What a way is searched for.
pub(super) struct Blocking<'a> {
    pub guide: &'a Guide,
    pub walker: &'a Heading,
    pub obstacles: &'a [Blocked],
    /// They are known this far, metres.
    pub reach_m: f64,
    /// What is in the way lies this far along it, metres; `None` where only the way to the route is not free.
    pub along_m: Option<f64>,
    /// Where it is.
    pub at: Option<Vec2>,
    pub free: &'a FreeWay,
    /// Metres that are free straight ahead from a place in a heading, in a strip of half this width.
    pub free_from: &'a dyn Fn(&Vec2, f64, f64) -> f64,
}

impl Past {
    pub fn new() -> Self {
        Self { search: AStar::new(), side: None }
    }

    /// Nothing is in the way any more: the next obstacle may be passed on either side.
    pub fn passed(&mut self) {
        self.side = None;
    }

    /// What leads past it, if anything does.
    pub fn plan(&mut self, what: &Blocking) -> Option<Plan> {
        let at = what.guide.place()?.along_m + what.along_m.unwrap_or(0.0);
        let plan = what.guide.plan();
        let leg = plan.point_at((at + 0.3).min(plan.length())) - plan.point_at((at - 0.3).max(0.0));
        let route = leg.y.atan2(leg.x);
        let path = self.path(what, route);
        let side = self.side.map(|(_, side)| side);
        // Free so far, he has passed it.
        let past_m = what.along_m.map_or(0.0, |m| (m + PAST_M).min(FARTHEST_M)).max(what.free.needed_m());
        let leg = || {
            let leg = first_leg(&path?, &what.walker.position, what.free)?;
            // Where he faces already, it leads past nothing.
            (what.walker.turn_to(leg.heading).abs() > NEARLY_RAD).then_some(Plan::Walk(leg))
        };
        moves(what, route, past_m, side)
            .or_else(|| approach(what, route))
            .or_else(|| side.and_then(|_| moves(what, route, past_m, None)))
            .or_else(|| step_back(what, side).map(Plan::StepBack))
            .or_else(leg)
    }

    /// A way past it that is searched: on the side that was chosen, as long as there is one.
    fn path(&mut self, what: &Blocking, route: f64) -> Option<Vec<Vec2>> {
        let Some(at) = what.at else { return self.search(what, None) };
        let left = direction(route + FRAC_PI_2);
        let kept = self.side.filter(|(before, _)| (before - at).norm() < SAME_M);
        if let Some((_, side)) = kept {
            // Beside the obstacle, the other side is closed.
            let closed = |p: &Vec2| {
                let d = p - at;
                side * d.dot(&left) < 0.0 && d.dot(&direction(route)).abs() < CLOSED_M
            };
            if let Some(path) = self.search(what, Some(&closed)) {
                return Some(path);
            }
        }
        let path = self.search(what, None);
        let beside = path.iter().flatten().min_by(|a, b| {
            let along = |p: &Vec2| (p - at).dot(&direction(route)).abs();
            along(a).total_cmp(&along(b))
        });
        self.side = beside.map(|p| (at, (p - at).dot(&left).signum()));
        path
    }

    /// The points of a way back to the route beyond it, outside of what is closed.
    fn search(&mut self, what: &Blocking, closed: Option<&dyn Fn(&Vec2) -> bool>) -> Option<Vec<Vec2>> {
        let Blocking { guide, walker, obstacles, reach_m, along_m, .. } = *what;
        let (place, plan) = (guide.place()?, guide.plan());
        let begin = place.along_m + along_m.unwrap_or(0.0);
        let reach = reach_m.min(SEARCHED_M);
        let side = (2.0 * reach / CELL_M) as usize;
        let corner = walker.position - Vec2::repeat(reach);
        let frame = GridFrame::new(side, side, CELL_M, Se2::from_xy_angle(corner.x, corner.y, 0.0)).ok()?;
        let mut blocked = Grid::filled(frame, false);
        for b in obstacles {
            if let Some(cell) = frame.cell_at(b.at) {
                blocked.set(cell, true);
            }
        }
        // The route where it passes through the window, with the way to it.
        let mut near: Vec<Vec2> = vec![walker.position];
        let window = (begin - reach).max(0.0)..(begin + reach).min(plan.length());
        let samples = ((window.end - window.start) / 0.25).max(0.0) as usize;
        near.extend((0..=samples).map(|k| plan.point_at(window.start + 0.25 * k as f64)));
        let beside = |at: &Vec2| near.iter().any(|p| (p - at).norm() <= ASIDE_M);
        let distances = DistanceField::new(&blocked);
        for clearance_m in CLEARANCES_M {
            let mut free = distances.at_least(clearance_m);
            // The walker stands where he stands: out of there in any direction.
            let here = frame.cell_at(walker.position)?;
            free_around(&mut free, &distances, clearance_m, here);
            for i in 0..side * side {
                let cell = frame.cell(i);
                let centre = frame.centre(cell);
                if !beside(&centre) || closed.is_some_and(|closed| closed(&centre)) {
                    free.set(cell, false);
                }
            }
            let passable = Passable::new(&free);
            let Ok(start) = free_cell(&passable, search::Place::Start, walker.position) else { continue };
            let mut ahead = BEYOND_M[0];
            while ahead <= BEYOND_M[1] {
                let goal = plan.point_at((begin + ahead).min(plan.length()));
                if let Ok(goal) = free_cell(&passable, search::Place::Goal, goal)
                    && let Ok(path) = self.search.search(&passable, start, goal)
                {
                    return Some(path.points(&frame));
                }
                ahead += 0.3;
            }
        }
        None
    }
}

/// The first of the fewest moves that lead past it, on `side` where that was chosen: turns by as much as people turn who are told to
/// bear, then steps back and aside, then straight on. Of equally many those with room beside the way.
fn moves(what: &Blocking, route: f64, past_m: f64, side: Option<f64>) -> Option<Plan> {
    let (from, course) = (what.walker.position, what.walker.course);
    let off = wrap(course - route);
    if off.abs() > MOST_AWAY_RAD + 2.0 * BEAR_RAD {
        return Some(Plan::Walk(Leg { heading: route, free_m: past_m }));
    }
    let mut best: Option<(f64, Plan)> = None;
    let mut offer = |cost: f64, plan: Plan| {
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, plan));
        }
    };
    for bears in -3..=3i32 {
        let heading = wrap(course + f64::from(bears) * BEAR_RAD);
        let away = wrap(heading - route).abs();
        if away > MOST_AWAY_RAD {
            continue;
        }
        let far_m = past_m / away.cos();
        for steps in -MOST_STEPS..=MOST_STEPS {
            let (aside, far) = (f64::from(steps.signum()), STEP_M * f64::from(steps.abs()));
            let back = heading + aside * STEP_RAD;
            let there = from + direction(back) * far;
            if steps != 0 && (what.free_from)(&from, back, 0.0) < far + BESIDE_M {
                continue;
            }
            let ahead_m = far_m - far * STEP_RAD.cos();
            let free = |half_m: f64| (what.free_from)(&there, heading, half_m) >= ahead_m;
            let narrow = match (free(ROOM_M), free(0.0)) {
                (true, _) => 0.0,
                (false, true) => 1.5,
                _ => continue,
            };
            let other = side
                .zip(what.at)
                .is_some_and(|(side, at)| side * direction(heading).perp(&(at - there)) > 0.0);
            if other {
                continue;
            }
            let cost = f64::from(bears.abs() + steps.abs()) + narrow + away;
            if bears != 0 {
                let free_m = if steps == 0 { ahead_m } else { what.free.needed_m() };
                offer(cost, Plan::Walk(Leg { heading, free_m }));
            } else if steps != 0 {
                offer(cost, Plan::StepBack(aside));
            } else if what.free.admits(course) {
                // As the guide judges it too: else he would stand there without a word.
                offer(cost, Plan::Walk(Leg { heading: course, free_m: what.free.needed_m() }));
            }
        }
    }
    best.map(|(_, plan)| plan)
}

/// Straight on towards it, where he faces along the route and has room to stop: from near by fewer steps and turns lead past it, and
/// an error of his heading matters less.
fn approach(what: &Blocking, route: f64) -> Option<Plan> {
    let course = what.walker.course;
    let faces = wrap(course - route).abs() < MOST_AWAY_RAD;
    let leg = Leg { heading: course, free_m: what.free.needed_m() };
    (what.at.is_some() && faces && what.free.admits(course)).then_some(Plan::Walk(leg))
}

/// Where something is so near that no straight leg leads past it, or he may not be sent where he faces: the side to step back to,
/// where there is room the one that was chosen.
fn step_back(what: &Blocking, side: Option<f64>) -> Option<f64> {
    let course = what.walker.course;
    let free = |heading: f64| (what.free_from)(&what.walker.position, heading, 0.0);
    let room = |side: f64| free(course + side * STEP_RAD);
    let enough = |side: &f64| room(*side) >= STEP_M + BESIDE_M;
    let wider = if room(1.0) > room(-1.0) { 1.0 } else { -1.0 };
    let side = side.filter(enough).or_else(|| Some(wider).filter(enough));
    // What is free straight ahead but not a little beside it leads past nothing either: the guide does not send him there.
    let is_kept = what.at.is_some() && !what.free.admits(course);
    side.filter(|_| free(course) < TOO_NEAR_M || is_kept)
}

/// A straight leg along a path: free to the farthest point of the path that is in a straight line from here, also when the walker
/// does not turn to it exactly, and near to where the path leads.
fn first_leg(path: &[Vec2], from: &Vec2, way: &FreeWay) -> Option<Leg> {
    let mut seen = path.iter().filter(|p| {
        let d = *p - from;
        d.norm() > 0.3 && way.free_m(d.y.atan2(d.x)) >= d.norm()
    });
    let to = seen.next_back().or(path.last())? - from;
    if to.norm() < 0.05 {
        return None;
    }
    let along = to.y.atan2(to.x);
    let mut candidates: Vec<f64> = (0..=(LEG_DEG / 2.0) as i32)
        .flat_map(|k| [along + f64::from(2 * k).to_radians(), along - f64::from(2 * k).to_radians()])
        .collect();
    candidates.retain(|heading| direction(*heading).dot(&to) > 0.0);
    // To the end of the leg, or at least as far as he needs to stop.
    let far = to.norm().clamp(way.needed_m(), LONGEST_M.max(way.needed_m()));
    [far, way.needed_m()].into_iter().find_map(|free_m| {
        let way = way.requiring(free_m);
        OFF_DEG.iter().find_map(|off_deg| {
            let off = off_deg.to_radians();
            let heading = candidates.iter().find(|heading| way.admits_within(**heading, off))?;
            Some(Leg { heading: wrap(*heading), free_m })
        })
    })
}

/// Frees the cells within half a metre of the walker that are no nearer to an obstacle than he is himself.
fn free_around(free: &mut Grid<bool>, distances: &DistanceField, clearance_m: f64, here: Cell) {
    let at_least = clearance_m.min(distances.distance_m(here).unwrap_or(0.0) - 0.5 * CELL_M);
    let reach = (0.5 / CELL_M) as i64;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (x, y) = (i64::from(here.x) + dx, i64::from(here.y) + dy);
            if dx * dx + dy * dy > reach * reach || x < 0 || y < 0 {
                continue;
            }
            let cell = Cell::new(x as u32, y as u32);
            if distances.distance_m(cell).is_some_and(|d| d >= at_least && d > 0.0) {
                free.set(cell, true);
            }
        }
    }
}
