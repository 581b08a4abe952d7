//! What is in the walker's way: from live depth and the route to a reason to stop, and to a way past it.
//!
//! In: depth images with odometry, and the guide's plan. Out: for each step of the guide whether the walker must stop, or
//! which heading leads past an obstacle. All in the odometry frame: no correction of the map moves an obstacle.
//!
//! Two strips are watched. One follows the route from where the walker is, as far as he walks until he has heard "stop"
//! and stands: what is there was put there after the route was recorded. The other goes straight ahead, for the second
//! that is left to warn of what he is about to walk into, wherever he was led. A way past an obstacle is searched on a grid
//! of what is seen (A*), with as much clearance as there is, up to [`CLEARANCES_M`].

use cairn_dense::DenseError;
use cairn_dense::walk::{Blocked, Hit, LocalConfig, LocalSpace, first_hit};
use cairn_geometry::{Se2, Se3, So3, Vec2};
use cairn_guide::{Ground, Guide, GuideState, Heading, Obstacle, StopReason};
use cairn_plan::search::{self, AStar, free_cell};
use cairn_plan::{DistanceField, Grid, GridFrame, Passable};
use cairn_sensor::{FramePacket, Rig, Stamp};
use std::collections::VecDeque;
use std::time::Instant;

/// Half of the strip that must be free: half the width of a person, and five centimetres.
const HALF_M: f64 = 0.30;
/// The walker is stopped this far before an obstacle, metres, ...
const MARGIN_M: f64 = 0.7;
/// ... and as much earlier as he walks in this time, seconds: a third of a second to say "stop", up to 1.2 s to react.
const STOP_S: f64 = 1.9;
/// Who stands may walk on at this speed before he hears of anything, m/s.
const WALKING_M_S: f64 = 0.6;
/// Straight ahead he is stopped before this is left, metres, ...
const NEAR_M: f64 = 0.45;
/// ... and as much earlier as he walks in this time, seconds: to say "stop" and to react; past an obstacle, where he is led by
/// words close to it, in the longer one.
const NEAR_S: [f64; 2] = [1.5, 1.75];
/// An obstacle has at least so many voxels of five centimetres within a quarter of a metre.
const CLUSTER_VOXELS: u32 = 4;
/// What was in the way is gone when the strip has been free this far, metres, for this long, seconds.
const HELD_M: f64 = 3.0;
const FREE_S: f64 = 0.5;
/// Slower than this the walker stands, m/s.
const STANDING_M_S: f64 = 0.15;
/// A walker who was stopped is led past the obstacle once he has stood for this long, seconds.
const STOOD_S: f64 = 1.5;
/// Distances of the way past an obstacle from what is seen, metres: the first that leaves a way. The last is a gap as wide as
/// a narrow door.
const CLEARANCES_M: [f64; 4] = [0.7, 0.55, 0.42, 0.32];
/// A way that was found is not given up because it is not found for a moment, seconds: what is seen has noise.
const FOUND_S: f64 = 0.6;
/// The point of the way past an obstacle that the walker is led to, metres ahead.
const AIM_M: f64 = 0.9;
/// The way back to the route is searched up to this far beyond the obstacle, metres.
const BEYOND_M: [f64; 2] = [0.6, 2.4];
/// ... and no farther aside from it, metres: what lies behind the walls is unknown, not free.
const ASIDE_M: f64 = 1.3;
/// Side of the cells that are searched, metres.
const CELL_M: f64 = 0.05;
/// A sensor that gave no usable depth for this long is blind, seconds.
const BLIND_S: f64 = 1.0;
/// Speed is measured over this time, seconds.
const SPEED_S: f64 = 0.4;

/// Watches the way of one walker.
pub(crate) struct WayAhead {
    space: LocalSpace,
    camera_from_depth: Se3,
    segment: Option<u32>,
    /// The last usable depth, and the first image since guidance began.
    seen: Option<Stamp>,
    began: Option<Stamp>,
    /// Positions of the last moments.
    track: VecDeque<(Stamp, Vec2)>,
    /// Since when the walker stands.
    standing: Option<Stamp>,
    /// Since when the strip has been free, while there is an obstacle.
    free: Option<Stamp>,
    /// When a way past it was last found, and its heading.
    way: Option<(Stamp, f64)>,
    state: State,
    search: AStar,
    /// Milliseconds that the last image and the steps since took: for reports only, nothing is decided by it.
    pub cost_ms: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Free,
    /// Something is in the way and the walker was told.
    Stopped,
    /// The walker is led past it.
    Passing,
}

/// What a step found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Found {
    pub stop: Option<StopReason>,
    /// A heading past an obstacle, radians.
    pub detour: Option<f64>,
}

impl WayAhead {
    /// For a rig with depth; `None` without a depth sensor.
    ///
    /// # Errors
    /// An invalid depth camera.
    pub fn new(rig: &Rig, body_from_camera: &Se3) -> Result<Option<Self>, DenseError> {
        let Some(sensor) = &rig.depth else { return Ok(None) };
        let space = LocalSpace::new(LocalConfig::default(), sensor.camera, sensor.metres_per_unit)?;
        Ok(Some(Self {
            space,
            camera_from_depth: body_from_camera.inverse() * sensor.body_from_depth,
            segment: None,
            seen: None,
            began: None,
            track: VecDeque::new(),
            standing: None,
            free: None,
            way: None,
            state: State::Free,
            search: AStar::new(),
            cost_ms: 0.0,
        }))
    }

    /// Forgets what was seen: guidance has ended.
    pub fn reset(&mut self) {
        if self.began.is_some() {
            self.space.clear();
            (self.segment, self.seen, self.began, self.state) = (None, None, None, State::Free);
            (self.standing, self.free, self.way) = (None, None, None);
            self.track.clear();
        }
    }

    /// Adds the depth of a packet, seen from a pose of the camera in the odometry frame, in metres; `segment` names that
    /// frame, `ground` its ground plane.
    pub fn observe(&mut self, packet: &FramePacket, odom_from_camera: &Se3, segment: u32, ground: &Ground) {
        let begin = Instant::now();
        self.began.get_or_insert(packet.stamp);
        if self.segment.replace(segment).is_some_and(|before| before != segment) {
            self.space.clear();
            self.track.clear();
        }
        if let Some(depth) = &packet.depth {
            let pose = *odom_from_camera * self.camera_from_depth;
            if self.space.observe(depth, &pose, &level(ground)).is_ok() {
                self.seen = Some(packet.stamp);
            }
        }
        self.cost_ms = begin.elapsed().as_secs_f64() * 1e3;
    }

    /// Looks at the way of a walker who goes where his camera looks, before a step of his guide.
    pub fn look(&mut self, guide: &Guide, walker: &Heading, now: Stamp) -> Found {
        let begin = Instant::now();
        let found = self.found(guide, walker, now);
        self.cost_ms += begin.elapsed().as_secs_f64() * 1e3;
        found
    }

    fn found(&mut self, guide: &Guide, walker: &Heading, now: Stamp) -> Found {
        let speed = self.speed(walker.position, now);
        if speed > STANDING_M_S {
            self.standing = None;
        } else {
            self.standing.get_or_insert(now);
        }
        let last = self.seen.max(self.began);
        if last.is_some_and(|last| now - last > BLIND_S) {
            return Found { stop: Some(StopReason::UnknownGround), detour: None };
        }
        let obstacles = self.space.obstacles();
        let turning = guide.state() == GuideState::Turning;
        // He stands or is about to; the strip is looked at when he sets out, from where he stands then.
        let waits = turning && self.state == State::Free;
        let line = strip(guide, walker).filter(|_| !waits);
        let Some(line) = line else { return Found::default() };
        let stop_m = MARGIN_M + STOP_S * speed.max(WALKING_M_S);
        if self.space.drop_along(&line, HALF_M, stop_m.min(2.5)).is_some() {
            self.state = State::Stopped;
            return Found { stop: Some(StopReason::Drop), detour: None };
        }
        // What he was stopped for stays in view while he stands: by then he would be stopped for less.
        let reach = if self.state == State::Free { stop_m } else { stop_m.max(HELD_M) };
        let on_route = first_hit(&obstacles, &line, HALF_M, reach, CLUSTER_VOXELS);
        let straight = [walker.position, walker.position + direction(walker.course) * 4.0];
        let near_s = NEAR_S[usize::from(self.state != State::Free)];
        let near = (speed > STANDING_M_S)
            .then(|| first_hit(&obstacles, &straight, HALF_M - 0.02, NEAR_M + near_s * speed, CLUSTER_VOXELS))
            .flatten();
        self.decide(guide, walker, &obstacles, on_route, near, now)
    }

    fn decide(
        &mut self,
        guide: &Guide,
        walker: &Heading,
        obstacles: &[Blocked],
        on_route: Option<Hit>,
        near: Option<Hit>,
        now: Stamp,
    ) -> Found {
        let chest_m = self.space.config().chest_m;
        let stop = |hit: &Hit| {
            let to = hit.at - walker.position;
            let (ahead, left) = (to.dot(&direction(walker.heading)), walker.to_left(&hit.at));
            Found {
                stop: Some(StopReason::Obstacle(Obstacle::at(ahead.max(0.0), left, hit.low_m > chest_m))),
                detour: None,
            }
        };
        let way = |ahead: &mut Self| {
            let found = ahead.past(guide, walker, obstacles, on_route);
            ahead.hold(found, now)
        };
        let stood = self.standing.is_some_and(|since| now - since >= STOOD_S);
        if on_route.is_none() {
            self.free.get_or_insert(now);
        } else {
            self.free = None;
        }
        match self.state {
            State::Free => match near.or(on_route) {
                Some(hit) => {
                    self.state = State::Stopped;
                    stop(&hit)
                }
                None => Found::default(),
            },
            _ if self.free.is_some_and(|since| now - since >= FREE_S) && near.is_none() => {
                self.state = State::Free;
                Found::default()
            }
            State::Stopped => {
                let hit = near.or(on_route);
                let passing = stood.then(|| self.past(guide, walker, obstacles, on_route)).flatten();
                self.way = passing.map(|heading| (now, heading));
                match (passing, hit) {
                    (Some(heading), _) => {
                        self.state = State::Passing;
                        Found { stop: None, detour: Some(heading) }
                    }
                    (None, Some(hit)) => stop(&hit),
                    // Free since a moment: the reason stays until that is sure.
                    (None, None) => Found { stop: stopped_for(guide), detour: None },
                }
            }
            State::Passing => match (near, way(self)) {
                (None, Some(heading)) => Found { stop: None, detour: Some(heading) },
                // The way straight back to the route is free, but not for long enough yet.
                (None, None) if on_route.is_none() => Found { stop: None, detour: guide.detour_heading() },
                (near, _) => {
                    self.state = State::Stopped;
                    near.or(on_route).map_or_else(Found::default, |hit| stop(&hit))
                }
            },
        }
    }

    /// A way that was found, or the one from a moment ago.
    fn hold(&mut self, found: Option<f64>, now: Stamp) -> Option<f64> {
        if let Some(heading) = found {
            self.way = Some((now, heading));
        }
        self.way.filter(|(at, _)| now - *at <= FOUND_S).map(|(_, heading)| heading)
    }

    /// The heading of a way past what is in the way, back to the route beyond it.
    fn past(
        &mut self,
        guide: &Guide,
        walker: &Heading,
        obstacles: &[Blocked],
        on_route: Option<Hit>,
    ) -> Option<f64> {
        let (place, plan) = (guide.place()?, guide.plan());
        let begin = place.along_m + on_route.map_or(0.0, |hit| hit.along_m);
        let reach = self.space.config().reach_m;
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
            let start = free_cell(&passable, search::Place::Start, walker.position).ok()?;
            let mut ahead = BEYOND_M[0];
            while ahead <= BEYOND_M[1] {
                let goal = plan.point_at((begin + ahead).min(plan.length()));
                if let Ok(goal) = free_cell(&passable, search::Place::Goal, goal)
                    && let Ok(path) = self.search.search(&passable, start, goal)
                {
                    return aim_along(&path.points(&frame), &walker.position);
                }
                ahead += 0.3;
            }
        }
        None
    }

    fn speed(&mut self, at: Vec2, now: Stamp) -> f64 {
        if self.track.back().is_none_or(|(t, _)| *t < now) {
            self.track.push_back((now, at));
        }
        while self.track.len() > 2 && self.track.get(1).is_some_and(|(t, _)| now - *t > SPEED_S) {
            self.track.pop_front();
        }
        match (self.track.front(), self.track.back()) {
            (Some((t0, a)), Some((t1, b))) if *t1 - *t0 > 0.05 => (b - a).norm() / (*t1 - *t0),
            _ => 0.0,
        }
    }
}

/// Frees the cells within half a metre of the walker that are no nearer to an obstacle than he is himself.
fn free_around(free: &mut Grid<bool>, distances: &DistanceField, clearance_m: f64, here: cairn_plan::Cell) {
    let at_least = clearance_m.min(distances.distance_m(here).unwrap_or(0.0) - 0.5 * CELL_M);
    let reach = (0.5 / CELL_M) as i64;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (x, y) = (i64::from(here.x) + dx, i64::from(here.y) + dy);
            if dx * dx + dy * dy > reach * reach || x < 0 || y < 0 {
                continue;
            }
            let cell = cairn_plan::Cell::new(x as u32, y as u32);
            if distances.distance_m(cell).is_some_and(|d| d >= at_least && d > 0.0) {
                free.set(cell, true);
            }
        }
    }
}

/// What in the way the guide has stopped for, if for that.
fn stopped_for(guide: &Guide) -> Option<StopReason> {
    match guide.state() {
        GuideState::Stopped(reason) if reason.is_in_the_way() => Some(reason),
        _ => None,
    }
}

/// The heading to the point of a path that is [`AIM_M`] away.
fn aim_along(path: &[Vec2], from: &Vec2) -> Option<f64> {
    let aim = path.iter().find(|p| (*p - from).norm() >= AIM_M).or(path.last())?;
    let d = aim - from;
    (d.norm() > 0.05).then(|| d.y.atan2(d.x))
}

/// The line that the walker will follow: to where he is led, then along the route.
fn strip(guide: &Guide, walker: &Heading) -> Option<Vec<Vec2>> {
    let (aim_m, aim) = guide.aim_point()?;
    let plan = guide.plan();
    let mut line = vec![walker.position];
    if (aim - walker.position).norm() > 0.1 {
        line.push(aim);
    }
    let mut along = aim_m + 0.25;
    while along < plan.length() && along < aim_m + 4.0 {
        line.push(plan.point_at(along));
        along += 0.25;
    }
    (line.len() > 1).then_some(line)
}

fn direction(heading: f64) -> Vec2 {
    Vec2::new(heading.cos(), heading.sin())
}

/// The rotation from the odometry frame to the level frame whose x and y are those of the ground plane.
fn level(ground: &Ground) -> So3 {
    let axes = [Vec2::x(), Vec2::y()].map(|axis| ground.point(&axis, 0.0));
    let here_from_level = nalgebra::Matrix3::from_columns(&[axes[0], axes[1], ground.up()]);
    So3::from_matrix(&here_from_level).inverse()
}
