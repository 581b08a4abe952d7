//! A walk out, a long turn on the spot to what the map does not show, and the first steps back, with one camera and the motion
//! sensors of a drawn phone; or the same walk home backwards, after a long stand where the way out ended. How far the live pose is
//! from the truth, frame by frame.

use crate::MeasureError;
use crate::drawn::DrawnPhone;
use crate::run::LiveScale;
use crate::source::{cut, phone};
use cairn_engine::{Config, Delays, Engine, Evidence, Odometry, Runner, SensorMode, StageEvent, State};
use cairn_eval::{Align, EvalOptions, evaluate};
use cairn_geometry::{Se3, Sim3, So3, Trajectory, Vec2, Vec3};
use cairn_lens::TurnFactor;
use cairn_random::Random;
use cairn_sensor::{Camera, Rig, Source, Stamp};
use cairn_sim::{ContinuousTrajectory, PhoneMotion, SimConfig, SimSource, Stride, Walker, WorldKind};
use cairn_sources::std_host;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;
use std::ops::Range;

/// Steps a second of the body.
const BODY_HZ: f64 = 50.0;
/// Greatest turn rate, rad/s, and turn acceleration, rad/s^2.
const TURNING: [f64; 2] = [0.7, 2.0];
/// Greatest speed, m/s, and acceleration, m/s^2.
const WALKING: [f64; 2] = [0.8, 0.8];

/// Metres of the way home, and seconds for which one who walks home backwards looks about before, in the table.
const BACK_M: f64 = 8.0;
/// See [`BACK_M`].
const STANDS_S: f64 = 18.0;
/// Longest time that a key frame keeps mapping busy with latencies, frames.
const MOST_FRAMES: u32 = 10;

/// What is to be walked.
#[derive(Clone, Copy, Debug)]
pub struct Walk {
    /// Seed of world, phone and turn.
    pub seed: u64,
    /// Metres out, and back.
    pub metres: [f64; 2],
    /// Whether he walks home backwards, and looks about for so many seconds where the way out ended; otherwise he turns round.
    pub backwards_after_s: Option<f64>,
    /// Only every nth picture of 10 to 15 a second comes, as with a machine that is too slow for more.
    pub every: usize,
    /// Whether the engine is given a guess of the lens instead of the lens; where the gyroscope contradicts it, it begins again with a
    /// better one.
    pub guessed_lens: bool,
    /// Latencies of mapping; lockstep without.
    pub delays: Option<Delays>,
}

/// Which walks are walked, each home and backwards.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// The seeds.
    pub seeds: Range<u64>,
    /// Seeds of latencies of mapping for each, beside lockstep.
    pub delays: u64,
    /// Metres out.
    pub metres: f64,
    /// See [`Walk::every`].
    pub every: usize,
    /// See [`Walk::guessed_lens`].
    pub guessed_lens: bool,
}

/// The table of all that is chosen; progress on stderr.
///
/// # Errors
/// When the phone or the engine fails.
pub fn table(chosen: &Chosen, config: &Config, verbose: bool) -> Result<String, MeasureError> {
    let mut out = HEAD.to_owned();
    let Chosen { metres, every, guessed_lens, .. } = *chosen;
    let latencies = || (1..=chosen.delays).map(|seed| Some(Delays { seed, most_frames: MOST_FRAMES }));
    for seed in chosen.seeds.clone() {
        for backwards_after_s in [None, Some(STANDS_S)] {
            for delays in std::iter::once(None).chain(latencies()) {
                let one =
                    Walk { seed, metres: [metres, BACK_M], backwards_after_s, every, guessed_lens, delays };
                let row = walk(&one, config, verbose)?.row();
                eprint!("{row}");
                out += &row;
            }
        }
    }
    Ok(out)
}

/// A walk, walked.
#[derive(Clone, Debug)]
pub struct Walked {
    /// The walk.
    pub walk: Walk,
    /// Pictures a second.
    pub rate_hz: f64,
    /// From the first picture to the first pose in metres, seconds.
    pub metric_s: Option<f64>,
    /// Pictures after the first pose in metres and before the turn that had no pose.
    pub lost_before: usize,
    /// Error of the scale that lays the way out, up to the turn, beside the truth, percent.
    pub scale_percent: Option<f64>,
    /// Whether lengths told as metres are metres.
    pub live: LiveScale,
    /// By how much the focal length is off in percent that the images are read with, and from how many seconds on.
    pub focal: Vec<[f64; 2]>,
    /// What was found at the end and is true: of the clocks' offset, and of the readout of the rows, seconds.
    pub offset_s: [f64; 2],
    /// See [`Walked::offset_s`].
    pub readout_s: [f64; 2],
    /// Frame by frame from the begin of the turn on.
    pub steps: Vec<Step>,
}

impl Walked {
    /// The greatest distance from the truth, and the last.
    pub fn off_m(&self) -> [Option<f64>; 2] {
        let off = || self.steps.iter().filter_map(|s| s.off).map(|off| off.norm());
        [off().reduce(f64::max), off().next_back()]
    }

    /// A row of the table below [`HEAD`].
    fn row(&self) -> String {
        let or = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
        let [most, last] = self.off_m().map(|m| or(m, 2));
        let lost = self.steps.iter().filter(|s| s.off.is_none()).count();
        let focal: Vec<String> =
            self.focal.iter().map(|[off, from_s]| format!("{off:.1} ({from_s:.1})")).collect();
        let ms = |[found, truth]: [f64; 2]| format!("{:.1} ({:+.1})", 1e3 * found, 1e3 * (found - truth));
        format!(
            "| {}{} | {} | {:.1} | {} | {} | {} | {} | {:.1} ({:.0}) | {:.1} | {most} | {last} | {lost} of {} | {} | {} |\n",
            self.walk.seed,
            self.walk.delays.map_or(String::new(), |d| format!(", delays {}", d.seed)),
            if self.walk.backwards_after_s.is_some() { "backwards" } else { "home" },
            self.rate_hz,
            or(self.metric_s, 1),
            self.lost_before,
            or(self.scale_percent, 1),
            focal.join(", "),
            100.0 * (self.live.worst_percent / 100.0).exp_m1(),
            self.live.worst_at_s,
            self.live.wrong_s,
            self.steps.len(),
            ms(self.offset_s),
            ms(self.readout_s),
        )
    }
}

/// Header of the table of walks.
const HEAD: &str = "| seed | walks home | pictures a second | metric after s | pictures without a pose before the turn | scale error of the way out % | focal length off % (from s on) | lengths told as metres: worst % (at s) | s more than 10 % off | most m off | last m off | pictures without a pose in metres from the turn on | clocks' offset ms (error) | readout ms (error) |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";

/// A frame after the turn has begun.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Seconds since the walker set out for home; negative before.
    pub t_s: f64,
    /// The engine's state.
    pub state: State,
    /// Matches that agree.
    pub inliers: usize,
    /// From the true position to the live one, metres, where the way out lies beside the truth as the map has it at that moment;
    /// `None` without a pose.
    pub off: Option<Vec3>,
}

/// The motion; with the seconds at which the turn begins and at which the walker sets out.
fn motion(corners: &[Vec2], walk: &Walk) -> (ContinuousTrajectory, f64, f64) {
    let Walk { seed, metres: [_, back_m], .. } = *walk;
    let walker = Walker { turn_rate: 0.8, ..Walker::default() };
    let out = walker.motion(corners);
    let dt = 1.0 / BODY_HZ;
    let mut body = PhoneMotion::new(dt, &out.pose(0.0));
    while body.end_s() < out.end() {
        body.step(&out.pose(body.end_s() + dt));
    }
    let begins = body.end_s() + 1.0;
    let mut random = Random::stream(seed, 0x5907);
    let (last, before) = (corners[corners.len() - 1], corners[corners.len() - 2]);
    let heading_to = |d: Vec2| d.y.atan2(d.x);
    let mut heading = heading_to(last - before);
    // Turns by the words: each ends some way off, and is corrected after some seconds of listening.
    let mut targets = vec![(4.0, heading)];
    if let Some(stands_s) = walk.backwards_after_s {
        targets.extend([-0.3, 0.25, 0.0].map(|off| (stands_s / 3.0, heading + off)));
    } else {
        let home = heading + PI * if random.unit() < 0.5 { 1.0 } else { -1.0 };
        for off in [1.2, -0.5, 0.3] {
            targets.push((random.uniform(2.0, 4.0), home + off * random.uniform(0.3, 1.0)));
        }
        targets.push((random.uniform(1.5, 3.0), home));
    }
    let mut stride = Stride::new(walker);
    let mut place = last;
    let (mut rate, mut speed) = (0.0, 0.0);
    let mut turn = |target: f64, heading: &mut f64| {
        let off = (target - *heading + PI).rem_euclid(2.0 * PI) - PI;
        let wanted = (2.0 * off).clamp(-TURNING[0], TURNING[0]);
        rate += (wanted - rate).clamp(-TURNING[1] * dt, TURNING[1] * dt);
        *heading += rate * dt;
        off
    };
    for (rest_s, target) in targets {
        let mut rested = 0.0;
        while rested < rest_s {
            let whole = target - heading;
            // The long turn goes the chosen way round.
            let aim = if whole.abs() > 1.0 { heading + whole.signum() } else { target };
            let off = turn(aim, &mut heading);
            rested += if off.abs() < 0.03 { dt } else { 0.0 };
            body.step(&stride.pose(place, heading, dt));
        }
    }
    let sets_out = body.end_s();
    let ahead = if walk.backwards_after_s.is_some() { -1.0 } else { 1.0 };
    let mut walked = 0.0;
    let mut next = corners.len() - 1;
    while walked < back_m && next > 0 {
        let to = corners[next - 1] - place;
        if to.norm() < 0.3 {
            next -= 1;
            continue;
        }
        let off = turn(heading_to(to * ahead), &mut heading);
        let wanted = if off.abs() < 0.4 { WALKING[0] } else { 0.0 };
        speed += f64::clamp(wanted - speed, -WALKING[1] * dt, WALKING[1] * dt);
        place += Vec2::new(heading.cos(), heading.sin()) * (ahead * speed * dt);
        walked += speed * dt;
        body.step(&stride.pose(place, heading, dt));
    }
    (body.motion().clone(), begins, sets_out)
}

/// Walks; what came of it. `verbose` prints every frame on stderr.
///
/// # Errors
/// When the phone or the engine fails.
pub fn walk(walk: &Walk, config: &Config, verbose: bool) -> Result<Walked, MeasureError> {
    let mut sim = SimConfig::new(WorldKind::Demo, walk.seed);
    sim.camera = Camera::pinhole(480, 360, 315.0, 315.0, 239.5, 179.5);
    let plain = SimSource::new(&sim)?;
    let route = plain.world().routes().first().ok_or("the world has no route")?.points.clone();
    let corners = cut(&route, walk.metres[0]);
    let traits = phone(walk.seed);
    let mut config = config.clone();
    config.inertial.enabled = true;
    config.tracker.estimate_readout = true;
    let (motion, begins, sets_out) = motion(&corners, walk);
    let mut source = DrawnPhone::new(&sim, plain.world(), motion, &traits, walk.every)?;
    let mut rig = source.rig().clone();
    if walk.guessed_lens {
        let Camera { width, height, .. } = traits.camera;
        rig = Rig { imu: rig.imu, ..Rig::mono(cairn_sensor::Camera::guessed(width, height)) };
    }
    let runner = walk.delays.map_or(Runner::Lockstep, Runner::Delayed);
    let rate_hz = source.info().rate_hz;
    let begin = |rig: &Rig| Engine::new(rig, SensorMode::Mono, rate_hz, runner, &config, &std_host());
    let mut engine = begin(&rig)?;
    let off = |rig: &Rig| 100.0 * (rig.cameras[0].camera.fx / traits.camera.fx).ln();
    let truth: BTreeMap<Stamp, Se3> = source.info().truth.iter().copied().collect();
    let first = *truth.keys().next().ok_or("no frames")?;
    let last = *truth.keys().next_back().ok_or("no frames")?;
    let turns = first.plus_seconds(begins);
    let mut walked = Walked {
        walk: *walk,
        rate_hz: (truth.len() - 1) as f64 / (last - first),
        metric_s: None,
        lost_before: 0,
        scale_percent: None,
        live: LiveScale::default(),
        focal: vec![[off(&rig), 0.0]],
        offset_s: [0.0, traits.stamp_delay_s],
        readout_s: [0.0, traits.readout_s],
        steps: Vec::new(),
    };
    let (mut moved, mut told) = (Vec::new(), BTreeSet::new());
    // What is known of the focal length, and the odometry's segments of engines before.
    let (mut known, mut segments) = (None, 0);
    while let Some(packet) = source.next_packet()? {
        let out = engine.on_packet(&packet)?;
        let moves = out.pose.map(|p| Odometry { segment: p.odometry.segment + segments, ..p.odometry });
        let metric = out.pose.filter(|pose| pose.scale.metric);
        moved.extend(moves.filter(|_| metric.is_some()).map(|o| (packet.stamp, o)));
        told.extend(metric.filter(|pose| pose.scale.is_known()).map(|_| packet.stamp));
        if let Some(cause) = out.stage_failed() {
            return Err(MeasureError::from(cause.to_owned()));
        }
        let t_s = packet.stamp - first;
        let pose = metric.map(|pose| pose.world_from_body);
        if pose.is_some() && walked.metric_s.is_none() {
            walked.metric_s = Some(t_s);
        }
        let before = pose.is_some().then(|| beside(&engine, &truth, turns)).flatten();
        let off_m = pose.zip(before).and_then(|(pose, before)| {
            Some(before * pose.se3.translation - truth.get(&packet.stamp)?.translation)
        });
        if verbose {
            let failed = out
                .events
                .iter()
                .filter_map(StageEvent::attempt)
                .flat_map(|a| a.failed())
                .map(|g| g.to_string())
                .collect::<Vec<_>>()
                .join(", ");
            let off = off_m.map_or("-".to_owned(), |off| format!("{:.3}", off.norm()));
            let Evidence { features, expected, matched, inliers } = out.evidence;
            let kind = match out.state {
                State::Tracking => "tracking",
                State::Coasting { .. } => "coasting",
                State::Lost { .. } => "lost",
                _ => "other",
            };
            eprintln!(
                "{t_s:6.2} {kind} {features} {expected} {matched} {inliers} off {off} offset {:.1} readout {:.1} key {} maps {} {failed}",
                1e3 * engine.snapshot().imu_offset(),
                1e3 * engine.readout().seconds,
                out.key_frame_requested,
                engine.snapshot().maps().count(),
            );
        }
        // As a session does, as long as nothing hangs on the map.
        let turned = (walk.guessed_lens && packet.stamp < turns).then(|| turn_factor(&engine)).flatten();
        if let Some(found) = turned.filter(|found| found.contradicts(known)) {
            let camera = &mut rig.cameras[0].camera;
            (camera.fx, camera.fy) = (camera.fx * found.factor, camera.fy * found.factor);
            known = Some(found.sigma_after());
            segments = moves.map_or(segments, |o| o.segment + 1);
            engine = begin(&rig)?;
            walked.focal.push([off(&rig), t_s]);
        }
        if packet.stamp < turns {
            walked.lost_before += usize::from(pose.is_none() && walked.metric_s.is_some());
            continue;
        }
        walked.steps.push(Step {
            t_s: t_s - sets_out,
            state: out.state,
            inliers: out.evidence.inliers,
            off: off_m,
        });
    }
    walked.live = LiveScale::of(first, &truth, &moved, &told);
    walked.offset_s[0] = engine.snapshot().imu_offset();
    walked.readout_s[0] = engine.readout().seconds;
    walked.scale_percent = scale_percent(&engine, &truth, turns);
    Ok(walked)
}

/// The turns of the newest map over those measured; the sensors' axes are those of the camera.
fn turn_factor(engine: &Engine) -> Option<TurnFactor> {
    let snapshot = engine.snapshot();
    let newest = snapshot.key_frames().max_by_key(|k| k.id)?.map;
    TurnFactor::of(&snapshot, newest, &So3::identity())
}

/// Ground truth and the engine's poses as the map has them now, up to an instant.
fn both(engine: &Engine, truth: &BTreeMap<Stamp, Se3>, until: Stamp) -> Option<[Trajectory; 2]> {
    let (mut there, mut here) = (Trajectory::new(), Trajectory::new());
    for (stamp, pose) in engine.trajectory().into_iter().take_while(|(stamp, _)| *stamp < until) {
        there.push(stamp.0, *truth.get(&stamp)?).ok()?;
        here.push(stamp.0, pose).ok()?;
    }
    Some([there, here])
}

/// What lays the way out, up to an instant, beside the truth as the map has it now.
fn beside(engine: &Engine, truth: &BTreeMap<Stamp, Se3>, until: Stamp) -> Option<Sim3> {
    let [there, here] = both(engine, truth, until)?;
    let options = EvalOptions { align: Align::Se3, ..EvalOptions::default() };
    Some(evaluate(&there, &here, &options).ok()?.reference_from_estimate)
}

/// By how much lengths of the way out are too large, percent.
fn scale_percent(engine: &Engine, truth: &BTreeMap<Stamp, Se3>, until: Stamp) -> Option<f64> {
    let [there, here] = both(engine, truth, until)?;
    let options = EvalOptions { align: Align::Sim3, ..EvalOptions::default() };
    let aligned = evaluate(&there, &here, &options).ok()?.reference_from_estimate;
    Some(100.0 * (aligned.scale.recip() - 1.0))
}
