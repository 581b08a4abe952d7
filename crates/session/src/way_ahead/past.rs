//! A way past what is in the way, back to the route beyond it, in what a walker who goes by words does exactly: he walks straight
//! on, and he steps back and to a side without turning. Turns end somewhere about where they should.
//!
//! So the first that leads past is taken: straight on; up to three steps aside, then straight on; another heading, with room for
//! the error of the turn to it. Where none does, the way is searched on a grid of what is seen (A*), with as much clearance as
//! there is, and walked in straight legs.

use super::direction;
use cairn_dense::walk::{Blocked, LocalSpace};
use cairn_geometry::{Se2, Vec2};
use cairn_guide::{FreeWay, Guide, Heading, wrap};
use cairn_plan::search::{self, AStar, free_cell};
use cairn_plan::{Cell, DistanceField, Grid, GridFrame, Passable};

/// Distances of the way past an obstacle from what is seen, metres: the first that leaves a way. The last is a gap as wide as
/// a narrow door.
const CLEARANCES_M: [f64; 4] = [0.7, 0.55, 0.42, 0.32];
/// The way back to the route is searched up to this far beyond the obstacle, metres.
const BEYOND_M: [f64; 2] = [0.6, 2.4];
/// ... and no farther aside from it, metres: what lies behind the walls is unknown, not free.
const ASIDE_M: f64 = 1.3;
/// The way is searched this far around the walker, metres.
const SEARCHED_M: f64 = 3.6;
/// Side of the cells that are searched, metres.
const CELL_M: f64 = 0.05;
/// A leg of the way is looked for within this angle of where the way leads, degrees ...
const LEG_DEG: f64 = 60.0;
/// ... so free on both sides, degrees: people who are told to bear or to stop turning end up about so far from where they should.
const OFF_DEG: [f64; 3] = [12.0, 8.0, 5.0];

/// What is in the way is passed so far beyond where it begins, metres, as far as can be seen.
const PAST_M: f64 = 0.75;
const FARTHEST_M: f64 = 4.0;
/// Straight on is along the route within this angle, degrees; steps aside are made by who faces along it.
const ALONG_DEG: f64 = 25.0;
const STEPS_DEG: f64 = 15.0;
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
}

/// What a way is searched for.
pub(super) struct Blocking<'a> {
    pub guide: &'a Guide,
    pub walker: &'a Heading,
    pub obstacles: &'a [Blocked],
    /// What is in the way lies this far along it, metres; `None` where only the way to the route is not free.
    pub along_m: Option<f64>,
    pub free: &'a FreeWay,
    /// Metres that are free straight ahead from a place in a heading.
    pub free_from: &'a dyn Fn(&Vec2, f64) -> f64,
}

impl Past {
    pub fn new() -> Self {
        Self { search: AStar::new() }
    }

    /// What leads past it, if anything does.
    pub fn plan(&mut self, space: &LocalSpace, what: &Blocking) -> Option<Plan> {
        let at = what.guide.place()?.along_m + what.along_m.unwrap_or(0.0);
        let plan = what.guide.plan();
        let leg = plan.point_at((at + 0.3).min(plan.length())) - plan.point_at((at - 0.3).max(0.0));
        let (course, route) = (what.walker.course, leg.y.atan2(leg.x));
        // Free so far, he has passed it.
        let past_m = what.along_m.map_or(0.0, |m| (m + PAST_M).min(FARTHEST_M)).max(what.free.needed_m());
        let ahead = |heading: f64| (what.free_from)(&what.walker.position, heading) >= past_m;
        let aligned = |limit_deg: f64| wrap(course - route).abs() < limit_deg.to_radians();
        // As the guide judges it too: else he would stand there without a word.
        if aligned(ALONG_DEG) && ahead(course) && what.free.admits(course) {
            return Some(Plan::Walk(Leg { heading: course, free_m: what.free.needed_m() }));
        }
        if aligned(STEPS_DEG)
            && let Some(side) = steps_aside(what, course, past_m)
        {
            return Some(Plan::StepBack(side));
        }
        let turned = |off_deg: f64| turned(what, route, past_m, off_deg).map(Plan::Walk);
        let other = turned(OFF_DEG[0]).or_else(|| {
            let turns = !aligned(STEPS_DEG) && steps_aside(what, route, past_m).is_some();
            turns.then_some(Plan::Walk(Leg { heading: route, free_m: past_m }))
        });
        let other = other.or_else(|| turned(OFF_DEG[1])).or_else(|| turned(OFF_DEG[2]));
        let leg = other.or_else(|| self.leg(space, what).map(Plan::Walk));
        leg.or_else(|| step_back(what).map(Plan::StepBack))
    }

    /// The first leg of a way that is searched.
    fn leg(&mut self, space: &LocalSpace, what: &Blocking) -> Option<Leg> {
        let Blocking { guide, walker, obstacles, along_m, free: way, .. } = *what;
        let (place, plan) = (guide.place()?, guide.plan());
        let begin = place.along_m + along_m.unwrap_or(0.0);
        let reach = space.config().reach_m.min(SEARCHED_M);
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
                if !beside(&frame.centre(cell)) {
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
                    let leg = leg(&path.points(&frame), &walker.position, way);
                    if leg.is_some() {
                        return leg;
                    }
                    break;
                }
                ahead += 0.3;
            }
        }
        None
    }
}

/// The side to step back to, up to three times, so that the way straight ahead in a heading is free.
fn steps_aside(what: &Blocking, heading: f64, past_m: f64) -> Option<f64> {
    let from = what.walker.position;
    let fits = |side: f64, steps: i32| {
        let far = STEP_M * f64::from(steps);
        let back = heading + side * STEP_RAD;
        let there = from + direction(back) * far;
        let ahead_m = (what.free_from)(&there, heading) - far * STEP_RAD.cos().abs();
        ((what.free_from)(&from, back) >= far + BESIDE_M && ahead_m >= past_m).then_some((ahead_m, side))
    };
    let best = (1..=3).find_map(|steps| {
        let sides = [1.0, -1.0].into_iter().filter_map(|side| fits(side, steps));
        sides.max_by(|a, b| a.0.total_cmp(&b.0))
    });
    best.map(|(_, side)| side)
}

/// Where something is so near that no straight leg leads past it: the side on which there is more room to step back to.
fn step_back(what: &Blocking) -> Option<f64> {
    let course = what.walker.course;
    let free = |heading: f64| (what.free_from)(&what.walker.position, heading);
    let room = |side: f64| free(course + side * STEP_RAD);
    let enough = |side: &f64| room(*side) >= STEP_M + BESIDE_M;
    let side = if room(1.0) > room(-1.0) { 1.0 } else { -1.0 };
    Some(side).filter(enough).filter(|_| free(course) < TOO_NEAR_M)
}

/// A heading near the route's in which what is in the way is passed, also when the turn ends `off_deg` beside it: the one for
/// which the walker turns the least.
fn turned(what: &Blocking, route: f64, past_m: f64, off_deg: f64) -> Option<Leg> {
    let far = what.free.requiring(past_m);
    let course = what.walker.course;
    let headings = (-30..=30).map(|k| route + f64::from(2 * k).to_radians());
    let free = headings.filter(|heading| far.admits_within(*heading, off_deg.to_radians()));
    let nearest = free.min_by(|a, b| wrap(a - course).abs().total_cmp(&wrap(b - course).abs()))?;
    Some(Leg { heading: wrap(nearest), free_m: past_m })
}

/// A straight leg along a path: free to the farthest point of the path that is in a straight line from here, also when the walker
/// does not turn to it exactly, and near to where the path leads.
fn leg(path: &[Vec2], from: &Vec2, way: &FreeWay) -> Option<Leg> {
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
