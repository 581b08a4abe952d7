//! A walker is guided along a corridor while the map is corrected: tracking, odometry, route and guide together, on a
//! synthetic map.

use crate::guidance::Guiding;
use crate::place::Place;
use crate::reference_path::{Moved, ReferencePath};
use crate::synthetic::{FEATURES, RATE_HZ, World, off, stereo};
use cairn_atlas::{Atlas, Change, KeyFrameId, Snapshot};
use cairn_geometry::{Pose, Se3, Sim3, Similarity, So3, Vec2, Vec3};
use cairn_guide::{
    Anchor, Announcer, AnnouncerConfig, Confidence, Facing, Ground, GuideState, PhraseConfig, Route,
    RouteConfig, RouteHeader, RoutePoint, Side, Stretch, Travel, camera_pose, wrap,
};
use cairn_random::Random;
use cairn_sensor::Stamp;
use cairn_tracking::{Tracker, TrackerConfig};
use cairn_trial::{Walker, side_of};

const STEP_S: f64 = 1.0 / RATE_HZ;
/// A corridor of 24 m and, after a turn to the left, 14 m more.
const CORNER_M: f64 = 24.0;
const END: [f64; 2] = [CORNER_M, 14.0];
/// Where the correction happens.
const CORRECTED_AT_M: f64 = 12.0;

/// The camera's poses along the corridor, `step` metres apart; the second leg has this length.
fn path(step: f64, leg_m: f64) -> Vec<Se3> {
    let along = |length: f64| (0..=(length / step).round() as usize).map(move |k| k as f64 * step);
    let turn = (1..=12).map(|k| camera_pose(CORNER_M, 0.0, f64::from(k) * 0.195, 0.0));
    let first = along(CORNER_M).map(|x| camera_pose(x, 0.0, 0.0, 0.0));
    first.chain(turn).chain(along(leg_m).map(|y| camera_pose(CORNER_M, y, 1.57, 0.0))).collect()
}

/// Points on both sides of the corridor.
fn corridor() -> World {
    let mut world = World::around(stereo(), 71);
    let mut random = Random::new(72);
    let mut within = |low, high| random.uniform(low, high);
    for point in &mut world.points {
        *point = loop {
            let p = Vec3::new(within(-4.0, 34.0), within(-7.0, 27.0), within(0.0, 3.0));
            let beside = p.y.abs() > 1.5 || p.x > CORNER_M + 1.5;
            if beside && (p.y < 0.0 || (p.x - CORNER_M).abs() > 1.5 || p.y > END[1] + 5.0) {
                break p;
            }
        };
    }
    world
}

/// The corridor mapped twice: exactly for the route, and again today with a drift that is not known yet.
struct Corridor {
    world: World,
    atlas: Atlas,
    route: Route,
    today: Vec<KeyFrameId>,
    /// From the true frame to today's map.
    drift: Se3,
}

impl Corridor {
    fn new(drift: Se3) -> Self {
        let world = corridor();
        let path = path(0.3, END[1]);
        let (mut atlas, ids) = world.exact_map(&path);
        let point = |(k, (id, pose)): (usize, (&KeyFrameId, &Se3))| RoutePoint {
            stamp: Stamp::from_seconds(0.5 * k as f64),
            anchor: Anchor { robot: 0, seq: id.index() as u32 },
            anchor_from_camera: Se3::identity(),
            odom_from_camera: *pose,
            stretch: Stretch::Tracked,
            quality: 1.0,
        };
        let points = ids.iter().zip(&path).enumerate().map(point).collect();
        let route = Route { points, ..Route::new(RouteHeader::new(true, &Ground::z_up(), "test")) };
        // Today's map goes beyond the end, for walkers who miss it.
        let mut path = self::path(0.3, END[1] + 4.0);
        path.extend((0..24).map(|k| camera_pose(END[0], END[1] + 1.0, 1.57 + 0.26 * f64::from(k), 0.0)));
        let views = world.walk(&path, 1000.0, 0.5);
        let drifted = Sim3::new(drift.rotation, drift.translation, 1.0);
        let today = world.map(&mut atlas, &views, &path, ids.last().copied(), |_| drifted);
        Self { world, atlas, route, today, drift }
    }

    /// The loop is closed: what was mapped today moves to its true place.
    fn correct(&mut self) {
        let back = self.drift.inverse();
        let snapshot: Snapshot = (**self.atlas.latest()).clone();
        let mut changes = Vec::new();
        for k in snapshot.key_frames().filter(|k| k.id >= self.today[0]) {
            changes.push(Change::MoveKeyFrame(k.id, back * k.world_from_camera));
        }
        let of_today = |key_frame: KeyFrameId| key_frame >= self.today[0];
        for l in snapshot.landmarks().filter(|l| of_today(l.observations[0].key_frame)) {
            changes.push(Change::MoveLandmark(l.id, back * l.position));
        }
        assert_eq!(self.atlas.commit(changes).dropped, 0);
    }
}

/// Where the needed turn is at least this far to the other side, the direction sends the walker away from the route,
/// radians.
const AWAY_RAD: f64 = 0.3;

/// An utterance, and the turn that truly led to the route 3 m ahead when it was said: radians, positive left.
struct Said {
    t_s: f64,
    words: String,
    turn_rad: f64,
    /// On the first leg, more than 4 m before the corner; from there on directions concern the turn of the route.
    is_in_corridor: bool,
}

/// The result of a walk.
struct Walked {
    arrived: bool,
    /// True distance from the end, metres.
    error_m: f64,
    /// The greatest error of a motion in the odometry, and in the map.
    step_m: f64,
    jump_m: f64,
    corrected_s: f64,
    said: Vec<Said>,
}

impl Walked {
    fn transcript(&self) -> String {
        self.said.iter().map(|s| format!("{:6.1}  {}\n", s.t_s, s.words)).collect()
    }

    /// A direction said within ten seconds after the correction that contradicts the previous one: it sends the
    /// walker to the other side before the walker can have followed, or away from where the route truly is.
    fn contradiction(&self) -> Option<&str> {
        // What is announced for later ("In 6 metres, turn left.") is not a direction to follow now.
        let is_for_now = |s: &&Said| !s.words.contains("In ") && !s.words.contains(", then ");
        let sides = (self.said.iter().filter(is_for_now))
            .filter_map(|s| Some((s, side_of(&s.words, cairn_phrases::Language::English)?)));
        let sides: Vec<(&Said, Side)> = sides.collect();
        let near = |s: &Said| (self.corrected_s..self.corrected_s + 10.0).contains(&s.t_s);
        let other =
            |w: &&[(&Said, Side)]| w[1].0.is_in_corridor && w[1].0.t_s - w[0].0.t_s < 2.5 && w[0].1 != w[1].1;
        let followed = sides.windows(2).filter(other).map(|w| w[1].0);
        let away =
            sides.iter().filter(|(s, side)| s.turn_rad.abs() > AWAY_RAD && Side::of(s.turn_rad) != *side);
        followed.chain(away.map(|(s, _)| *s)).find(|s| near(s)).map(|s| s.words.as_str())
    }
}

/// Guides a walker along the route; in the middle of the corridor the map is corrected.
fn walk(drift: Se3, seed: u64) -> Walked {
    let mut corridor = Corridor::new(drift);
    let mut tracker = Tracker::new(corridor.world.camera, FEATURES, RATE_HZ, TrackerConfig::default());
    tracker.map_created(corridor.atlas.latest(), corridor.today[0]);
    // The walker starts where today's map places the route's start.
    let start = drift.inverse() * camera_pose(0.0, 0.0, 0.0, 0.0);
    let heading = Ground::z_up().heading(&start).unwrap();
    let mut walker = Walker::new(seed, (start.translation.x, start.translation.y, heading));
    let (mut voice, phrases) = (Announcer::new(AnnouncerConfig::default()), PhraseConfig::default());
    let mut guiding: Option<Guiding> = None;
    let mut last: Option<(Se3, Se3, Se3)> = None;
    let mut place: Option<Place> = None;
    let mut walked = Walked {
        arrived: false,
        error_m: f64::NAN,
        step_m: 0.0,
        jump_m: 0.0,
        corrected_s: f64::NAN,
        said: Vec::new(),
    };
    for tick in 0..2400 {
        let t_s = 2000.0 + STEP_S * f64::from(tick);
        let now = Stamp::from_seconds(t_s);
        let (x, y, heading) = walker.step(STEP_S, now);
        let truth = camera_pose(x, y, heading, 0.0);
        let at_m = last.map_or(0.0, |(_, _, world)| world.translation.x);
        if walked.corrected_s.is_nan() && at_m > CORRECTED_AT_M {
            walked.corrected_s = t_s;
            corridor.correct();
        }
        let view = corridor.world.see(&truth, t_s);
        let tracked = tracker.step(view.frame, &[], corridor.atlas.latest(), true, false);
        if let Some((found, odometry)) = tracked.pose.zip(tracker.odometry()) {
            let (odom, world) = (odometry.odom_from_body.se3, found.world_from_camera);
            if let Some((before, odom_before, world_before)) = last.replace((truth, odom, world)) {
                let motion = before.inverse() * truth;
                walked.step_m = walked.step_m.max(off(&(odom_before.inverse() * odom), &motion).0);
                walked.jump_m = walked.jump_m.max(off(&(world_before.inverse() * world), &motion).0);
            }
            place = Some(Place {
                stamp: now,
                world_from_camera: Pose::new(world),
                // The camera of the synthetic world coincides with the body.
                odom_from_camera: Pose::new(odom),
                world_from_odom: odometry.world_from_odom,
                segment: odometry.segment,
                anchor: Anchor { robot: 0, seq: u32::try_from(found.reference.index()).unwrap() },
                anchor_from_camera: found.reference_from_camera,
            });
        }
        let Some(place) = place else { panic!("not tracked from the beginning: {:?}", tracked.state) };
        let confidence = if tracked.pose.is_some() { Confidence::Good } else { Confidence::Lost };
        let (map, route) = (corridor.atlas.latest(), &corridor.route);
        let guiding = guiding.get_or_insert_with(|| {
            Guiding::begin(
                map,
                route,
                Travel::Again,
                Facing::Home,
                Some(&place),
                now,
                &RouteConfig::default(),
            )
            .expect("a route")
        });
        let cue = guiding.step(map, route, &place, confidence, None, now);
        if let Some((words, priority)) = cue.and_then(|c| Some((phrases.words(&c)?, c.priority()))) {
            voice.push(words, priority, now);
        }
        if let Some(said) = voice.poll(now) {
            walker.hear(&said.text, now);
            let is_in_corridor = x < CORNER_M - 4.0;
            let turn_rad = if is_in_corridor { wrap((-y).atan2(3.0) - heading) } else { 0.0 };
            walked.said.push(Said { t_s, words: said.text, turn_rad, is_in_corridor });
        }
        walked.arrived = guiding.guide.state() == GuideState::Arrived;
        if walked.arrived && walker.is_standing() {
            break;
        }
    }
    let (x, y, _) = walker.pose();
    walked.error_m = (Vec2::new(x, y) - Vec2::from(END)).norm();
    walked
}

/// A drift of this many metres to the left and degrees, as it is in the middle of the corridor.
fn drift(left_m: f64, degrees: f64) -> Se3 {
    let turn = So3::exp(&(Vec3::z() * degrees.to_radians()));
    let middle = Vec3::new(CORRECTED_AT_M, 0.0, 0.0);
    Se3::new(turn, middle - turn * middle + Vec3::new(0.0, left_m, 0.0))
}

#[test]
fn a_correction_of_one_metre_and_five_degrees_in_mid_corridor_contradicts_no_cue() {
    for (left_m, degrees) in [(1.0, 5.0), (-1.0, -5.0), (1.0, -5.0), (-1.0, 5.0)] {
        for seed in 0..2 {
            let walked = walk(drift(left_m, degrees), seed);
            let transcript = walked.transcript();
            println!(
                "drift {left_m} m {degrees} deg, walker {seed}: odometry within {:.5} m, map jumps {:.2} m, arrival {} {:.2} m\n{transcript}",
                walked.step_m, walked.jump_m, walked.arrived, walked.error_m
            );
            assert!(walked.jump_m > 0.9, "the map was corrected by {} m", walked.jump_m);
            assert!(walked.step_m < 2e-3, "a step of {} m in the odometry", walked.step_m);
            assert_eq!(walked.contradiction(), None, "{transcript}");
            assert!(!transcript.contains("Correction") && !transcript.contains("Wrong way"), "{transcript}");
            assert!(
                walked.arrived && walked.error_m < 1.0,
                "{} m from the end:\n{transcript}",
                walked.error_m
            );
        }
    }
}

/// A place a metre along a route, in a segment of odometry whose unit has turned out to be this many metres.
fn near_the_start(route: &Route, unit_m: f64, t_s: f64) -> Place {
    let world_from_camera = camera_pose(1.0, 0.0, 0.0, 0.0);
    let in_odom = Se3::new(world_from_camera.rotation, world_from_camera.translation / unit_m);
    Place {
        stamp: Stamp::from_seconds(t_s),
        world_from_camera: Pose::new(world_from_camera),
        odom_from_camera: Pose::new(in_odom),
        world_from_odom: Similarity::new(Sim3::new(So3::identity(), Vec3::zeros(), unit_m)),
        segment: 1,
        anchor: route.points[0].anchor,
        anchor_from_camera: Se3::identity(),
    }
}

#[test]
fn a_route_that_becomes_a_third_longer_under_guidance_has_lost_its_distances() {
    let mut corridor = Corridor::new(Se3::identity());
    let route = corridor.route.clone();
    let begun = near_the_start(&route, 1.0, 1.0);
    let (facing, config) = (Facing::Home, RouteConfig::default());
    let map = corridor.atlas.latest();
    let mut guiding =
        Guiding::begin(map, &route, Travel::Again, facing, Some(&begun), begun.stamp, &config).unwrap();
    // As the map settles, and as it does whose scale was wrong.
    for (n, (longer, is_lost)) in [(1.0, false), (1.03, false), (1.3, true)].into_iter().enumerate() {
        let snapshot: Snapshot = (**corridor.atlas.latest()).clone();
        let scaled = |pose: &Se3| Se3::new(pose.rotation, pose.translation * longer);
        let moves = snapshot.key_frames().map(|k| Change::MoveKeyFrame(k.id, scaled(&k.world_from_camera)));
        assert_eq!(corridor.atlas.commit(moves.collect()).dropped, 0);
        let now = near_the_start(&route, 1.0, 3.0 + 2.0 * n as f64);
        guiding.step(corridor.atlas.latest(), &route, &now, Confidence::Good, None, now.stamp);
        assert_eq!(guiding.has_lost_distances, is_lost, "{longer} times as long");
    }
}

#[test]
fn a_metric_route_stays_in_metres_when_a_map_with_a_guessed_unit_finds_its_scale() {
    let corridor = Corridor::new(Se3::identity());
    let (map, route) = (corridor.atlas.latest(), &corridor.route);
    let place = |unit_m: f64, t_s: f64| near_the_start(route, unit_m, t_s);
    let (guessed, config) = (place(1.0, 1.0), RouteConfig::default());
    let mut path = ReferencePath::new(map, route, Travel::Again, Some(&guessed), guessed.stamp, &config);
    let before = path.plan().unwrap().length();
    assert!(path.follow(map, route, &guessed, Stamp::from_seconds(2.5)).is_none(), "nothing has changed");
    for (n, unit_m) in [0.5, 0.52, 1.6].into_iter().enumerate() {
        let now = place(unit_m, 3.0 + n as f64);
        match (path.follow(map, route, &now, now.stamp), unit_m) {
            (Some(Moved::Segment(plan)), 0.5 | 1.6) => {
                assert!((plan.length() - before).abs() < 0.1, "{unit_m}: {} m of {before} m", plan.length());
                assert!((path.metres_per_unit() - unit_m).abs() < 1e-9);
            }
            (None | Some(Moved::Corrected { .. }), 0.52) => {}
            _ => panic!("{unit_m}: the unit was not followed"),
        }
    }
}
