//! Walkers are guided home through a simulated flat with things in their way that their route does not know: depth
//! images, watch, guide and words together, with true poses.

mod scenes;
mod traced;

use super::ObstacleMonitor;
use super::watch::{ObstacleScan, Watch};
use cairn_geometry::{Camera, Pose, Se3, Vec2, Vec3};
use cairn_guide::{
    Announcer, AnnouncerConfig, Confidence, Facing, Ground, Guide, GuideConfig, GuideInput, GuideState,
    ManeuverPlan, ManeuverPlanConfig, PhraseConfig,
};
use cairn_sensor::Stamp;
use cairn_sim::{Effects, LiveRig, SimConfig, SimSensor, WorldKind};
use cairn_trial::Walker;
use cairn_trial::way::{Body, Obstacles};
use traced::Traced;

const RATE_HZ: f64 = 20.0;
/// Metres of the flat's route that are walked.
const LENGTH_M: f64 = 20.0;
/// A walk that takes longer is given up, seconds.
const LONGEST_S: f64 = 400.0;
/// A walker who has stood this long has been given up, seconds.
const STOOD_S: f64 = 40.0;

/// How a walk went, by the truth.
struct Walked {
    arrived: bool,
    /// The last words were that no way past is found.
    told: bool,
    error_m: f64,
    /// Metres from the walker's middle to the nearest thing, the least of the walk.
    nearest_m: f64,
    walked_m: f64,
    seconds: f64,
    obstacles: Obstacles,
    said: Vec<String>,
}

/// The corners of the flat's route, cut off.
fn corners(points: &[Vec2]) -> Vec<Vec2> {
    let mut left = LENGTH_M;
    let mut out: Vec<Vec2> = points.first().copied().into_iter().collect();
    for leg in points.windows(2) {
        let d = leg[1] - leg[0];
        let share = (left / d.norm()).min(1.0);
        out.push(leg[0] + d * share);
        left -= d.norm();
        if left <= 0.0 {
            break;
        }
    }
    out
}

/// How the way is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sensor {
    /// Rays in the plane.
    Traced,
    /// Depth images, of structured light with its projector so far from the camera, metres.
    Depth { projector_m: Option<f64> },
}

/// Guides a walker home past this many things.
fn walk(seed: u64, things: usize, sensor: Sensor) -> Walked {
    let config = SimConfig {
        sensor: SimSensor::Rgbd,
        imu: None,
        camera: cairn_sensor::Camera::pinhole(240, 180, 157.5, 157.5, 119.5, 89.5),
        rate_hz: RATE_HZ,
        body_from_camera: Se3::identity(),
        effects: Effects {
            blur_s: 0.0,
            projector_m: match sensor {
                Sensor::Depth { projector_m } => projector_m,
                Sensor::Traced => None,
            },
            ..Effects::default()
        },
        ..SimConfig::new(WorldKind::Demo, seed)
    };
    let mut rig = LiveRig::new(&config).expect("a flat");
    let world = std::sync::Arc::clone(rig.world());
    let mut back = corners(&world.routes()[0].points);
    back.reverse();
    let line: Vec<Vec3> = back.iter().map(|p| Vec3::new(p.x, p.y, 1.3)).collect();
    let ground = Ground::z_up();
    let plan = ManeuverPlan::new(&line, &ground, &ManeuverPlanConfig::default()).expect("a plan");
    let mut guide = Guide::new(plan, ground, GuideConfig::default()).expect("a guide");
    let mut watch =
        ObstacleMonitor::new(rig.rig(), &Se3::identity()).expect("a depth camera").expect("depth");
    let (mut traced, mut plane) = (Traced::default(), Watch::new());
    let (mut voice, phrases) = (Announcer::new(AnnouncerConfig::default()), PhraseConfig::default());
    // Facing away from home, as on the way out.
    let out = back[0] - back[1];
    let walker = Walker::new(seed, (back[0].x, back[0].y, out.y.atan2(out.x)));
    let mut body = Body::new(walker, config.walker.clone());
    let mut obstacles = Obstacles::along(&back, things, seed);
    rig.put(obstacles.things());
    let mut walked = Walked {
        arrived: false,
        told: false,
        error_m: f64::INFINITY,
        nearest_m: f64::INFINITY,
        walked_m: 0.0,
        seconds: 0.0,
        obstacles: Obstacles::default(),
        said: Vec::new(),
    };
    let (mut stood_s, mut before) = (0.0, body.place());
    for tick in 1..(LONGEST_S * RATE_HZ) as i64 {
        let now = Stamp::from_seconds(tick as f64 / RATE_HZ);
        let pose: Pose<cairn_geometry::Odom, Camera> =
            Pose::new(body.step(&world, &obstacles, 1.0 / RATE_HZ, now));
        if obstacles.step(&body.place(), body.walker.is_standing(), 1.0 / RATE_HZ) {
            rig.put(obstacles.things());
        }
        walked.nearest_m = walked.nearest_m.min(obstacles.clearance(&body.place()));
        walked.walked_m += (body.place() - before).norm();
        before = body.place();
        walked.seconds = now.seconds();
        if sensor == Sensor::Traced {
            traced.look(&world, &obstacles.things(), body.place(), body.walker.pose().2);
        } else {
            let packet = rig.packet(now, &pose.se3).expect("a frame");
            watch.observe(&packet, &pose.se3, 0, &ground);
        }
        let hazard = Facing::Home.heading(&ground, &pose).and_then(|walker| {
            let found = if sensor == Sensor::Traced {
                let sight = ObstacleScan {
                    obstacles: traced.obstacles(&walker.position, 4.4),
                    reach_m: 4.4,
                    chest_m: 1.1,
                    drop_along: &|_, _, _| None,
                };
                plane.look(&guide, &walker, sight, now)
            } else {
                watch.look(&guide, &walker, now)
            };
            found.tell(&mut guide)
        });
        let cue = guide.step(&GuideInput {
            now,
            pose_stamp: now,
            odom_from_camera: pose,
            confidence: Confidence::Good,
            speed: None,
            hazard,
        });
        if let Some((words, cue)) = cue.and_then(|cue| Some((phrases.words(&cue)?, cue))) {
            voice.push(words, cue.priority(), now);
        }
        if let Some(said) = voice.poll(now) {
            body.walker.hear(&said.text, now);
            let heading = body.walker.pose().2;
            obstacles.hear(&said.text, &world, &body.place(), heading, &back);
            let at = body.place();
            walked.said.push(format!("{:6.1} ({:5.2} {:5.2})  {}", now.seconds(), at.x, at.y, said.text));
        }
        walked.arrived = guide.state() == GuideState::Arrived;
        stood_s = if body.walker.is_standing() { stood_s + 1.0 / RATE_HZ } else { 0.0 };
        if stood_s > if walked.arrived { 2.0 } else { STOOD_S } {
            break;
        }
    }
    walked.told = walked.said.last().is_some_and(|said| said.contains("find a way past"));
    walked.error_m = (body.place() - back[back.len() - 1]).norm();
    walked.obstacles = obstacles;
    walked
}

/// What some walks came to.
#[derive(Debug, Default)]
struct Total {
    walks: usize,
    /// Within a metre of the end.
    arrived: usize,
    /// Told that no way past is found.
    told: usize,
    touched: usize,
    stops: usize,
    false_stops: usize,
    metres: f64,
}

/// Walks these seeds and prints a table.
fn table(seeds: std::ops::RangeInclusive<u64>, things: usize, sensor: Sensor) -> Total {
    println!("seed  things  arrived   told  error m  touched  stops  false  nearest m  walked m  seconds");
    let mut total = Total::default();
    for seed in seeds {
        let w = walk(seed, things, sensor);
        let Obstacles { count, touched: touches, stops, false_stops, .. } = w.obstacles;
        println!(
            "{seed:4}  {count:6}  {:7}  {:5}  {:7.2}  {touches:7}  {stops:5}  {false_stops:5}  {:9.2}  {:8.1}  {:7.0}",
            w.arrived, w.told, w.error_m, w.nearest_m, w.walked_m, w.seconds
        );
        w.said.iter().for_each(|said| println!("    {said}"));
        total.walks += 1;
        total.arrived += usize::from(w.arrived && w.error_m <= 1.0);
        total.told += usize::from(w.told);
        total.touched += touches;
        total.stops += stops;
        total.false_stops += false_stops;
        total.metres += w.walked_m;
    }
    println!("{total:?}");
    total
}

#[test]
fn a_walker_gets_past_what_was_put_in_his_way() {
    let Total { arrived, touched, false_stops, .. } = table(1..=1, 3, Sensor::Depth { projector_m: None });
    assert_eq!((arrived, touched, false_stops), (1, 0, 0));
}

/// Where a side was not kept, and a step planned while the last was made, both stood before the first box until they were given up.
#[test]
fn walkers_get_past_boxes_beside_which_there_is_little_room() {
    let Total { arrived, touched, false_stops, .. } = table(3..=4, 3, Sensor::Traced);
    assert_eq!((arrived, touched, false_stops), (2, 0, 0));
}

/// Where he faced what was free and a little beside it was not, he was neither sent on nor told to step back, and was given up.
#[test]
fn a_walker_who_may_not_be_sent_where_he_faces_steps_back() {
    let Total { arrived, touched, false_stops, .. } = table(16..=16, 3, Sensor::Traced);
    assert_eq!((arrived, touched, false_stops), (1, 0, 0));
}

/// Prints a table: `CAIRN_WALKS=1-50 cargo test --release -p cairn-session --lib -- --ignored --nocapture many_walks`, with
/// `CAIRN_THINGS` (3) things in the way, `CAIRN_PROJECTOR_M=0.075` for depth as structured light
/// measures it, and `CAIRN_TRACED=1` for rays in the plane instead of depth images, in a twentieth of the time.
#[test]
#[ignore = "takes minutes"]
fn many_walks_past_what_was_put_in_the_way() {
    let given = |name: &str| std::env::var(name).ok();
    let walks = given("CAIRN_WALKS").unwrap_or_else(|| "1-10".into());
    let (first, last) = walks.split_once('-').unwrap_or((&walks, &walks));
    let number = |text: &str| text.parse::<u64>().expect("a number");
    let things = given("CAIRN_THINGS").map_or(3, |n| number(&n) as usize);
    let projector_m = given("CAIRN_PROJECTOR_M").map(|m| m.parse().expect("metres"));
    let sensor = match given("CAIRN_TRACED") {
        Some(_) => Sensor::Traced,
        None => Sensor::Depth { projector_m },
    };
    let total = table(number(first)..=number(last), things, sensor);
    assert_eq!((total.arrived + total.told, total.touched), (total.walks, 0));
    assert!(total.false_stops as f64 <= 1.0 + total.metres / 200.0);
}
