//! What a walker is told of the things around him: from obstacles seen from above and the route to a reason to stop, and to a way
//! past it.
//!
//! In: the obstacles around the walker, the guide's plan, where he is. Out: [`Found`]. Nothing here knows where the obstacles come from.

use super::attempts::Attempts;
use super::pace::Pace;
use super::past::{Blocking, Leg, NEARLY_RAD, Past, Plan};
use super::stepping::{Outcome, Stepping};
use super::strip::{STRAIGHT_HALF_M, direction, half_within, stopped_for, strip};
use super::turns::Turns;
use cairn_dense::walk::{Blocked, Hit, first_hit, free_around};
use cairn_geometry::Vec2;
use cairn_guide::{ANSWER_S, FreeWay, Guide, GuideState, Heading, Obstacle, Step, StopReason};
use cairn_sensor::Stamp;

/// Half of the strip that must be free along the route: half the width of a person, and five centimetres.
const HALF_M: f64 = 0.30;
/// The walker is stopped this far before an obstacle on the route, metres, ...
const MARGIN_M: f64 = 0.7;
/// ... and as much earlier as he walks in this time, seconds: a third of a second to say "stop", up to 1.2 s to react, and the time
/// until a thing counts as seen.
const STOP_S: f64 = 1.9;
/// Straight ahead he is stopped before this is left, metres: half a body, and 0.2 m for what is seen too late or too far, ...
const NEAR_M: f64 = 0.45;
/// ... and as much earlier as he walks in this time, seconds: to say "stop" and to react.
const NEAR_S: f64 = 1.6;
/// He is sent only where so much more is free, metres.
const SPARE_M: f64 = 0.15;
/// Who was told to slow down walks at this share of his pace, but not slower than the other, m/s.
const SLOWED: (f64, f64) = (0.8, 0.4);
/// He is stopped at the end of the route: what lies farther beyond it, metres, is not reached.
const BEYOND_END_M: f64 = 0.75;
/// Headings that are looked at around the walker.
const HEADINGS: usize = 144;
/// Within this angle of the end of a turn, after which he goes on by himself, the way behind the turn is looked at, radians.
const TURNS_RAD: f64 = 0.8;
/// An obstacle has at least so many voxels of five centimetres within a quarter of a metre.
const CLUSTER_VOXELS: u32 = 4;
/// What was in the way is gone when the strip has been free this far, metres, for this long, seconds.
const HELD_M: f64 = 3.0;
const FREE_S: f64 = 0.5;
/// A walker who was stopped is led past the obstacle once he has stood for this long, seconds, and after a step for this long.
const STOOD_S: f64 = 1.5;
const STEPPED_S: f64 = 0.7;
/// Who was told to turn so long ago, seconds, and faces the way this exactly, radians, has turned to it.
const FACED_S: f64 = 3.0;
const FACES_RAD: f64 = 0.09;
/// A way past is searched at this interval, seconds: a walker who stands has time, and the search takes some.
const SEARCH_S: f64 = 0.2;
/// Who stands is led past something for so long, seconds.
const LED_S: f64 = 12.0;
/// Facing nearer than this to where he is to go, radians, he faces about there.
const ABOUT_RAD: f64 = 0.5;
/// Turns end about so far from where they should, degrees.
const ABOUT_DEG: [f64; 6] = [-20.0, -13.0, -7.0, 7.0, 13.0, 20.0];
/// A leg stays free when it is shorter by this than when it was found, metres.
const SLACK_M: f64 = 0.1;
/// A way that was found is not given up because it is not found for a moment, seconds: what is seen has noise.
const FOUND_S: f64 = 0.6;

/// What a step found.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Found {
    pub stop: Option<StopReason>,
    /// A heading past an obstacle, radians.
    pub detour: Option<f64>,
    /// Where the walker may be sent.
    pub free: Option<FreeWay>,
    /// From where he stands nothing leads past something: the step that he is to make.
    pub step: Option<Step>,
    /// He goes elsewhere than the step leads that he was told to make.
    pub is_astray: bool,
}

impl Found {
    /// Tells the guide; why the walker must stop, if he must.
    pub fn tell(self, guide: &mut Guide) -> Option<StopReason> {
        guide.detour(self.detour);
        guide.free_way(self.free);
        guide.take_step(self.step);
        if self.is_astray {
            guide.went_astray();
        }
        self.stop
    }
}

/// Metres along a line at which the ground drops, within half a strip's width and a length.
type DropAlong<'a> = dyn Fn(&[Vec2], f64, f64) -> Option<f64> + 'a;

/// What a sensor shows around the walker.
pub(super) struct ObstacleScan<'a> {
    pub obstacles: Vec<Blocked>,
    /// Obstacles are known this far, metres.
    pub reach_m: f64,
    /// From this height on the lower end of an obstacle hangs, metres.
    pub chest_m: f64,
    pub drop_along: &'a DropAlong<'a>,
}

/// Watches for obstacles on the way of one walker.
pub(super) struct Watch {
    pace: Pace,
    /// Since when the strip has been free, while there is an obstacle.
    free: Option<Stamp>,
    way: Option<Way>,
    state: State,
    /// When a way past was last searched.
    searched: Option<Stamp>,
    step: Option<Stepping>,
    /// The last that he was told to do, where that was a step.
    last_step: Option<Step>,
    turns: Turns,
    tries: Attempts,
    past: Past,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Free,
    /// Something is in the way and the walker was told.
    Stopped,
    /// The walker is led past it.
    Passing,
}

/// The way past an obstacle on which a walker is.
#[derive(Clone, Copy, Debug)]
struct Way {
    /// Since when he is led there, and when it was last found to be free.
    since: Stamp,
    found: Stamp,
    leg: Leg,
}

/// What is seen at a step.
struct Seen<'a> {
    guide: &'a Guide,
    walker: &'a Heading,
    now: Stamp,
    sight: ObstacleScan<'a>,
    /// Metres that are free in each heading.
    free_m: Vec<f64>,
    /// The first obstacle on the route, and the one straight ahead of a walker who walks.
    on_route: Option<Hit>,
    near: Option<Hit>,
    /// The heading in which he would be led along the route.
    route_heading: Option<f64>,
}

impl Watch {
    pub fn new() -> Self {
        Self {
            pace: Pace::new(),
            free: None,
            way: None,
            state: State::Free,
            searched: None,
            step: None,
            last_step: None,
            turns: Turns::default(),
            tries: Attempts::default(),
            past: Past::default(),
        }
    }

    /// The frame of the positions has changed.
    pub fn begin_segment(&mut self) {
        self.pace.clear();
    }

    /// The walker is here now.
    pub fn walked(&mut self, guide: &Guide, walker: &Heading, now: Stamp) {
        self.pace.push(walker.position, now, guide.motion().standing_m_s);
        if let Some(place) = guide.place() {
            self.tries.step(place.along_m, self.state != State::Free, now);
        }
    }

    /// Looks at the way of a walker, before a step of his guide.
    pub fn look(&mut self, guide: &Guide, walker: &Heading, sight: ObstacleScan, now: Stamp) -> Found {
        self.walked(guide, walker, now);
        let obstacles = &sight.obstacles;
        let half_m = half_within(obstacles, &walker.position, STRAIGHT_HALF_M[1]);
        let reach_m = sight.reach_m;
        let free_m = free_around(obstacles, &walker.position, half_m, reach_m, CLUSTER_VOXELS, HEADINGS);
        let turning = guide.state() == GuideState::Turning;
        // About where he is to go, by turns that end somewhere about it.
        let aim = self.way.filter(|_| self.state == State::Passing).map(|way| way.leg.heading);
        let route_heading = guide.route_heading(walker, now);
        let aim = aim.or(route_heading);
        let about = aim.is_some_and(|aim| walker.turn_to(aim).abs() < ABOUT_RAD);
        self.turns.step(walker.position, turning && self.pace.stands(), about, now);
        let speed = self.pace.speed().max(self.expected());
        let near_m = self.needed(guide, walker, speed);
        let along = |heading: f64, half_m: f64| {
            let line = [walker.position, walker.position + direction(heading) * (reach_m + 0.5)];
            first_hit(obstacles, &line, half_m, near_m, CLUSTER_VOXELS)
        };
        // After a turn at a corner he goes on by himself: then what is squarely in the way behind it counts.
        let behind = route_heading.filter(|h| {
            turning && guide.goes_on() && self.pace.stands() && walker.turn_to(*h).abs() < TURNS_RAD
        });
        let near = match behind {
            Some(heading) => along(heading, STRAIGHT_HALF_M[0]),
            None if !self.pace.stands() || guide.goes_on() && !turning => along(walker.course, half_m),
            None => None,
        };
        // Who walks follows a direction from where he will be by then.
        let walks = (!self.pace.stands()).then(|| {
            let there = walker.position + direction(walker.course) * (ANSWER_S * self.pace.speed());
            let half_m = half_within(obstacles, &there, STRAIGHT_HALF_M[1]);
            free_around(obstacles, &there, half_m, reach_m, CLUSTER_VOXELS, HEADINGS)
        });
        let mut seen = Seen { guide, walker, now, sight, free_m, on_route: None, near, route_heading };
        // Who turns at a corner is looked at when he sets out, from where he stands then.
        let faces = route_heading.is_some_and(|h| walker.turn_to(h).abs() < FACES_RAD);
        let turned = faces && !guide.goes_on() && self.pace.has_stood(FACED_S, now);
        let waits = turning && self.state == State::Free && !turned && !self.turns.are_in_vain();
        let found = match strip(guide, walker).filter(|_| !waits) {
            Some(line) => self.on_line(&mut seen, &line),
            None if waits && seen.near.is_some() => self.decide(&seen),
            None => Found::default(),
        };
        let mut free = self.free_way(&seen, self.expected());
        // Past something he is sent where the whole leg is free.
        if let Some(Way { leg, .. }) = self.way.filter(|_| found.detour.is_some() && self.pace.stands()) {
            free = free.requiring(free.needed_m().max(leg.free_m - SLACK_M));
        }
        if let Some(free_m) = walks {
            free = free.answered(free_m);
        }
        Found { free: Some(free), ..found }
    }

    /// What the strip along the route says.
    fn on_line(&mut self, seen: &mut Seen, line: &[Vec2]) -> Found {
        let stop_m = MARGIN_M + STOP_S * self.pace.speed().max(self.expected());
        if (seen.sight.drop_along)(line, HALF_M, stop_m.min(2.5)).is_some() {
            self.state = State::Stopped;
            return Found { stop: Some(StopReason::Drop), ..Found::default() };
        }
        // What he was stopped for stays in view while he stands: by then he would be stopped for less.
        let reach = if self.state == State::Free { stop_m } else { stop_m.max(HELD_M) };
        seen.on_route = first_hit(&seen.sight.obstacles, line, HALF_M, reach, CLUSTER_VOXELS);
        if seen.on_route.is_some() {
            self.free = None;
        } else {
            self.free.get_or_insert(seen.now);
        }
        self.decide(seen)
    }

    fn decide(&mut self, seen: &Seen) -> Found {
        let hit = seen.near.or(seen.on_route);
        // Whoever stands is sent on along the route only where that is free for as long as he needs to stop; who faces it, where he
        // faces: the guide sends him there, or says nothing.
        let way = self.free_way(seen, self.pace.pace());
        let may_turn_to = |h: f64| {
            let faces = seen.walker.turn_to(h).abs() < FACES_RAD;
            way.admits(h) && (!faces || way.admits(seen.walker.course))
        };
        let may_go = !self.pace.stands()
            || seen.guide.goes_on()
            || !self.turns.are_in_vain() && seen.route_heading.is_none_or(may_turn_to);
        let is_free = self.free.is_some_and(|since| seen.now - since >= FREE_S);
        match self.state {
            State::Free if hit.is_none() && may_go => Found::default(),
            State::Free => {
                self.state = State::Stopped;
                self.stop(seen)
            }
            _ if is_free && seen.near.is_none() && may_go => {
                (self.state, self.step, self.last_step) = (State::Free, None, None);
                self.past.passed();
                Found::default()
            }
            State::Stopped => {
                // A step is made before the next is planned.
                let here = seen.walker.position;
                if let Some(stepping) = self.step.take() {
                    match stepping.outcome(&here, self.pace.stands(), seen.now) {
                        Outcome::Due => {
                            self.step = Some(stepping);
                            return Found { step: Some(stepping.step), ..self.stop(seen) };
                        }
                        Outcome::Made => {}
                        Outcome::Failed => self.past.failed(stepping.from, stepping.to),
                        Outcome::Astray => {
                            self.past.failed(stepping.from, stepping.to);
                            return Found { is_astray: true, ..self.stop(seen) };
                        }
                    }
                }
                let stood_s = if self.last_step.is_some() { STEPPED_S } else { STOOD_S };
                let searches = self.search_is_due(seen.now)
                    && self.pace.has_stood(stood_s, seen.now)
                    && !self.tries.are_exhausted();
                let plan = searches.then(|| self.search(seen)).flatten();
                if searches {
                    self.tries.searched(plan.is_some(), seen.now);
                }
                match plan {
                    Some(Plan::Walk(leg)) => {
                        self.way = Some(Way { since: seen.now, found: seen.now, leg });
                        (self.state, self.last_step) = (State::Passing, None);
                        self.turns.clear();
                        Found { detour: Some(leg.heading), ..Found::default() }
                    }
                    Some(Plan::Step(step)) => {
                        self.step = Some(Stepping::new(step, seen.walker, seen.now));
                        self.last_step = Some(step);
                        Found { step: Some(step), ..self.stop(seen) }
                    }
                    None if self.pace.stands() && self.tries.have_failed(seen.now) => {
                        Found { stop: Some(StopReason::NoWayPast), ..Found::default() }
                    }
                    None => self.stop(seen),
                }
            }
            State::Passing => match self.passing(seen) {
                Some(leg) if seen.near.is_none() => Found { detour: Some(leg.heading), ..Found::default() },
                _ => {
                    self.state = State::Stopped;
                    self.stop(seen)
                }
            },
        }
    }

    /// The leg on which the walker is; where he stands and it is not free any more, another one.
    fn passing(&mut self, seen: &Seen) -> Option<Leg> {
        let Way { since, found, leg } = self.way?;
        // He was led there for long and stands: he is told anew, whatever kept him.
        if self.turns.are_in_vain() && self.pace.stands() && !seen.guide.goes_on()
            || seen.now - since > LED_S && self.pace.has_stood(LED_S, seen.now)
        {
            return None;
        }
        let free = self.free_way(seen, self.slowed());
        let free = free.requiring(free.needed_m().max(leg.free_m - SLACK_M));
        if !self.pace.stands() || free.admits(leg.heading) {
            // He has turned to it, and it is not free there: turns end beside where they should.
            let faces = seen.walker.turn_to(leg.heading).abs() < NEARLY_RAD && seen.now - since > FACED_S;
            let stands = self.pace.stands() && !seen.guide.goes_on();
            self.way = Some(Way { since, found: seen.now, leg });
            return (!(stands && faces) || free.admits(seen.walker.course)).then_some(leg);
        }
        let plan = if self.search_is_due(seen.now) { self.search(seen) } else { None };
        if let Some(Plan::Walk(leg)) = plan {
            self.way = Some(Way { since, found: seen.now, leg });
            return Some(leg);
        }
        (seen.now - found <= FOUND_S).then_some(leg)
    }

    /// Stops the walker for what is in the way; where it has been free since a moment, the reason stays until that is sure.
    fn stop(&self, seen: &Seen) -> Found {
        let chest_m = seen.sight.chest_m;
        let ahead = |heading: f64| {
            let line = [seen.walker.position, seen.walker.position + direction(heading) * 4.0];
            first_hit(&seen.sight.obstacles, &line, HALF_M, 4.0, CLUSTER_VOXELS)
        };
        // Or what is nearest about where he would go.
        let about = |heading: f64| {
            let hits = ABOUT_DEG.iter().filter_map(|deg: &f64| ahead(heading + deg.to_radians()));
            hits.min_by(|a, b| a.along_m.total_cmp(&b.along_m))
        };
        let hit = seen.near.or(seen.on_route).or_else(|| {
            let heading = seen.route_heading?;
            ahead(heading).or_else(|| about(heading))
        });
        let obstacle = hit.map(|hit| {
            let to = hit.at - seen.walker.position;
            let (ahead, left) = (to.dot(&direction(seen.walker.heading)), seen.walker.to_left(&hit.at));
            StopReason::Obstacle(Obstacle::at(ahead.max(0.0), left, hit.low_m > chest_m))
        });
        Found { stop: obstacle.or_else(|| stopped_for(seen.guide)), ..Found::default() }
    }

    /// Whether a way past may be searched again.
    fn search_is_due(&self, now: Stamp) -> bool {
        self.searched.is_none_or(|last| now - last >= SEARCH_S)
    }

    /// What leads past what is in the way.
    fn search(&mut self, seen: &Seen) -> Option<Plan> {
        self.searched = Some(seen.now);
        let free = self.free_way(seen, self.slowed());
        let along_m = seen.on_route.map(|hit| hit.along_m);
        let Seen { guide, walker, sight: ObstacleScan { obstacles, reach_m, .. }, .. } = seen;
        let reach_m = *reach_m;
        let free_from = |from: &Vec2, heading: f64, widest_m: f64| {
            let half_m = half_within(obstacles, from, widest_m.max(STRAIGHT_HALF_M[1]));
            let line = [*from, from + direction(heading) * reach_m];
            first_hit(obstacles, &line, half_m, reach_m, CLUSTER_VOXELS).map_or(reach_m, |hit| hit.along_m)
        };
        let at = seen.on_route.map(|hit| hit.at);
        let what = Blocking {
            guide,
            walker,
            reach_m,
            along_m,
            at,
            free: &free,
            free_from: &free_from,
            turns: !self.turns.are_in_vain(),
            last: self.last_step,
        };
        self.past.plan(&what)
    }

    /// Where a walker with this pace may be sent, m/s.
    fn free_way(&self, seen: &Seen, pace: f64) -> FreeWay {
        let needed_m = self.needed(seen.guide, seen.walker, pace) + SPARE_M;
        FreeWay::new(seen.free_m.clone(), needed_m)
    }

    /// Metres straight ahead that must be free at a speed.
    fn needed(&self, guide: &Guide, walker: &Heading, speed: f64) -> f64 {
        let to_end = (guide.plan().end() - walker.position).norm();
        let ends = guide.aim_point().is_some_and(|(along, _)| along >= guide.plan().length() - 0.1);
        let most = if ends { to_end + BEYOND_END_M } else { f64::INFINITY };
        (NEAR_M + NEAR_S * speed).min(most)
    }

    /// The speed that he will have when he walks: past an obstacle he was told to slow down.
    fn expected(&self) -> f64 {
        if self.state == State::Free { self.pace.pace() } else { self.slowed() }
    }

    fn slowed(&self) -> f64 {
        (SLOWED.0 * self.pace.pace()).max(SLOWED.1)
    }
}
