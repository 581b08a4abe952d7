//! A way past what is in the way, back to the route beyond it, in what a walker who goes by words does: he turns about as far as people
//! turn who are told to bear, walks straight on, steps half a metre back and to a side, or a little to a side.
//!
//! Dijkstra's search over where he would stand after such moves: on until he would be stopped again, until a straight leg leads past
//! the obstacle. Moves cost what it takes to say and to make them; a leg with little room beside it costs more, and so does passing the
//! obstacle on the other side than before. The first of the cheapest moves is told, and after it the search is made anew, from where it
//! ended: nobody steps or turns exactly.

use super::strip::direction;
use cairn_geometry::Vec2;
use cairn_guide::{FreeWay, Guide, Heading, Step, wrap};
use std::f64::consts::FRAC_PI_2;

/// What is in the way is passed so far beyond where it begins, metres, as far as can be seen.
const PAST_M: f64 = 0.75;
const FARTHEST_M: f64 = 4.0;
/// Past it he is sent in a heading at most so far off the route's, radians, and before that in one at most so far off.
const MOST_AWAY_RAD: f64 = 0.45;
const FARTHEST_RAD: f64 = 1.2;
/// Nobody is led farther aside from the route than this, metres: what lies behind the walls is unknown, not free.
const ASIDE_M: f64 = 1.3;
/// Who faces nearer than this to a heading is not turned to it, radians: a turn that people make by words ends no nearer.
pub(super) const NEARLY_RAD: f64 = 0.17;
/// People who are told to bear turn by about this, radians; they are told up to so many times.
const BEAR_RAD: f64 = 0.33;
const BEARS: i32 = 3;
/// A step back and to a side: halfway between the two, radians, metres, and what must be free beyond it.
const STEP_RAD: f64 = 0.75 * std::f64::consts::PI;
const STEP_M: f64 = 0.5;
const BESIDE_M: f64 = 0.35;
/// A small step to a side.
const SMALL_M: f64 = 0.22;
const BESIDE_SMALL_M: f64 = 0.3;
/// Who walks until he is stopped before something stands so far before it, metres.
const STOPPED_M: f64 = 0.8;
/// Half of the strips in which he is sent past something, metres, wider than the one for which he is stopped, since he veers; what it
/// costs where one has no room, in moves.
const ROOM_M: [f64; 2] = [0.38, 0.33];
const NARROW: f64 = 0.75;
/// What a turn costs besides the walk after it, each time he is told to bear, and a metre.
const TURN: f64 = 1.5;
const BEAR: f64 = 0.2;
const METRE: f64 = 0.2;
/// What it costs to pass on the other side than before, and to step back to where he has just come from.
const OTHER_SIDE: f64 = 1.5;
const TO_AND_FRO: f64 = 1.0;
/// It is the same obstacle while it is no farther than this from where it was, metres.
const SAME_M: f64 = 0.8;
/// At most so many places are looked at; two are the same within this, metres.
const MOST_PLACES: usize = 250;
const SAME_PLACE_M: f64 = 0.1;
/// Within this of where a step could not be made, metres, and of its direction (the cosine), it is not tried again.
const FAILED_M: f64 = 0.2;
const FAILED_COS: f64 = 0.7;

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
    Step(Step),
}

/// Where a step leads a walker with a heading, from where he is.
pub(super) fn of_step(step: &Step, heading: f64) -> Vec2 {
    match step {
        Step::BackAside(left) => direction(heading + left * STEP_RAD) * STEP_M,
        Step::Aside(left) => direction(heading + left * FRAC_PI_2) * SMALL_M,
    }
}

/// Searches ways past obstacles.
#[derive(Default)]
pub(super) struct Past {
    /// Where the obstacle that he is led past was when he was first led, and on which side: plus one where he passes to the left of it.
    side: Option<(Vec2, f64)>,
    /// Steps that could not be made: from where, and where they would have led.
    failed: Vec<(Vec2, Vec2)>,
}

/// What a way is searched for.
pub(super) struct Blocking<'a> {
    pub guide: &'a Guide,
    pub walker: &'a Heading,
    /// Obstacles are known this far, metres.
    pub reach_m: f64,
    /// What is in the way lies this far along it, metres; `None` where only the way to the route is not free.
    pub along_m: Option<f64>,
    /// Where it is.
    pub at: Option<Vec2>,
    pub free: &'a FreeWay,
    /// Metres that are free straight ahead from a place in a heading, in a strip of half this width.
    pub free_from: &'a dyn Fn(&Vec2, f64, f64) -> f64,
    /// Whether turns from where he stands are exact enough.
    pub turns: bool,
    /// The last that he was told to do, where that was a step.
    pub last: Option<Step>,
}

/// A place where a walker would stand after some moves.
#[derive(Clone, Copy)]
struct Standing {
    at: Vec2,
    heading: f64,
    cost: f64,
    /// The first of the moves.
    first: Option<Plan>,
}

/// Moves that lead past it.
struct Way {
    cost: f64,
    first: Plan,
    /// On which side: plus one to the left of it.
    side: Option<f64>,
}

/// A search under way.
struct Search<'a> {
    what: &'a Blocking<'a>,
    past: &'a Past,
    /// The heading of the route beside the obstacle, and points of it there.
    route: f64,
    near: Vec<Vec2>,
    /// Metres beyond where he stands, along the route, at which he has passed it.
    past_m: f64,
    open: Vec<Standing>,
    best: Option<Way>,
}

impl Past {
    /// Nothing is in the way any more: the next obstacle may be passed on either side.
    pub fn passed(&mut self) {
        *self = Self::default();
    }

    /// A step was not made, from a place to another.
    pub fn failed(&mut self, from: Vec2, to: Vec2) {
        self.failed.push((from, to - from));
    }

    /// The first move of what leads past it, if anything does.
    pub fn plan(&mut self, what: &Blocking) -> Option<Plan> {
        let at_m = what.guide.place()?.along_m + what.along_m.unwrap_or(0.0);
        let plan = what.guide.plan();
        let leg = plan.point_at((at_m + 0.3).min(plan.length())) - plan.point_at((at_m - 0.3).max(0.0));
        let route = leg.y.atan2(leg.x);
        // Free so far, he has passed it.
        let past_m = what.along_m.map_or(0.0, |m| (m + PAST_M).min(FARTHEST_M)).max(what.free.needed_m());
        if wrap(what.walker.course - route).abs() > MOST_AWAY_RAD + 2.0 * BEAR_RAD {
            return Some(Plan::Walk(Leg { heading: route, free_m: past_m }));
        }
        let from_m = (at_m - what.reach_m).max(0.0);
        let samples = 4.0 * (2.0 * what.reach_m).min(plan.length() - from_m).max(0.0);
        let near = (0..=samples as usize).map(|k| plan.point_at(from_m + 0.25 * k as f64)).collect();
        let is_same = |(before, _): &(Vec2, f64)| what.at.is_none_or(|at| (before - at).norm() < SAME_M);
        self.side = self.side.filter(is_same);
        let way = Search { what, past: self, route, near, past_m, open: Vec::new(), best: None }.run()?;
        self.side = what.at.zip(way.side).or(self.side);
        Some(way.first)
    }
}

impl Search<'_> {
    fn run(mut self) -> Option<Way> {
        let walker = self.what.walker;
        self.open.push(Standing { at: walker.position, heading: walker.course, cost: 0.0, first: None });
        let mut closed: Vec<Standing> = Vec::new();
        while let Some(next) =
            (0..self.open.len()).min_by(|a, b| self.open[*a].cost.total_cmp(&self.open[*b].cost))
        {
            let from = self.open.swap_remove(next);
            if closed.len() >= MOST_PLACES
                || self.best.as_ref().is_some_and(|way| way.cost <= from.cost + 1.0)
            {
                break;
            }
            let is_same = |other: &Standing| {
                (other.at - from.at).norm() < SAME_PLACE_M
                    && wrap(other.heading - from.heading).abs() < 0.5 * BEAR_RAD
            };
            if !closed.iter().any(is_same) {
                closed.push(from);
                (-BEARS..=BEARS).for_each(|bears| self.walk(&from, bears));
                for step in
                    [1.0, -1.0].into_iter().flat_map(|left| [Step::BackAside(left), Step::Aside(left)])
                {
                    self.step(&from, step);
                }
            }
        }
        self.best
    }

    /// He bears so many times to the left and walks on: past it, or until he is stopped again.
    fn walk(&mut self, from: &Standing, bears: i32) {
        let what = self.what;
        let heading = wrap(from.heading + f64::from(bears) * BEAR_RAD);
        let away = wrap(heading - self.route).abs();
        let is_first = from.first.is_none();
        // Where he faces he is sent as the guide judges it: else he would stand there without a word.
        let is_barred = is_first && if bears == 0 { !what.free.admits(heading) } else { !what.turns };
        let (free_m, needed_m) = ((what.free_from)(&from.at, heading, 0.0), what.free.needed_m());
        if is_barred || free_m < needed_m || away > FARTHEST_RAD {
            return;
        }
        let turn = if bears == 0 { 0.0 } else { TURN + BEAR * f64::from(bears.abs()) };
        let cost = from.cost + 1.0 + turn;
        let gone_m = (from.at - what.walker.position).dot(&direction(self.route));
        let ahead_m = ((self.past_m - gone_m) / away.cos()).max(needed_m);
        let first = |free_m: f64| from.first.unwrap_or(Plan::Walk(Leg { heading, free_m }));
        if away <= MOST_AWAY_RAD && free_m >= ahead_m {
            let side = what.at.map(|at| -direction(heading).perp(&(at - from.at)).signum());
            let has_room = |half_m: &f64| (what.free_from)(&from.at, heading, *half_m) >= ahead_m;
            let narrow = NARROW * ROOM_M.iter().position(has_room).unwrap_or(ROOM_M.len()) as f64;
            let is_other = self.past.side.zip(side).is_some_and(|((_, before), side)| side != before);
            let cost = cost + narrow + away + if is_other { OTHER_SIDE } else { 0.0 };
            if self.best.as_ref().is_none_or(|way| cost < way.cost) {
                let free_m = if is_first && bears == 0 { needed_m } else { ahead_m };
                self.best = Some(Way { cost, first: first(free_m), side });
            }
        } else if free_m < what.reach_m {
            let metres = free_m - STOPPED_M;
            let (at, cost) = (from.at + direction(heading) * metres, cost + 1.0 + METRE * metres);
            self.push(Standing { at, heading, cost, first: Some(first(needed_m)) });
        }
    }

    /// He makes a step.
    fn step(&mut self, from: &Standing, step: Step) {
        let by = of_step(&step, from.heading);
        let beside_m = if matches!(step, Step::Aside(_)) { BESIDE_SMALL_M } else { BESIDE_M };
        let failed = |(at, to): &(Vec2, Vec2)| {
            (at - from.at).norm() < FAILED_M && to.dot(&by) > FAILED_COS * to.norm() * by.norm()
        };
        if (self.what.free_from)(&from.at, by.y.atan2(by.x), 0.0) < by.norm() + beside_m
            || self.past.failed.iter().any(failed)
        {
            return;
        }
        let returns = |last: Step| of_step(&last, from.heading).dot(&by) < 0.0;
        let to_and_fro = from.first.is_none() && self.what.last.is_some_and(returns);
        let cost = from.cost + 1.0 + if to_and_fro { TO_AND_FRO } else { 0.0 };
        let first = Some(from.first.unwrap_or(Plan::Step(step)));
        self.push(Standing { at: from.at + by, cost, first, ..*from });
    }

    fn push(&mut self, to: Standing) {
        let aside_m = |at: &Vec2| self.near.iter().map(|p| (p - at).norm()).fold(f64::INFINITY, f64::min);
        if aside_m(&to.at) <= ASIDE_M.max(aside_m(&self.what.walker.position)) {
            self.open.push(to);
        }
    }
}
