//! One demo, from the first frame to the figures.

use super::camera::DemoCamera;
use super::config::{DemoConfig, facing_name};
use super::home::{Return, Spoken, to_floor_plan, walk_back};
use super::out::walk_out;
use crate::failure::Failure;
use crate::progress::Progress;
use crate::surface::Surface;
use cairn_eval::{Align, EvalOptions, Evaluation, Percentiles, Stages, evaluate, process, tracked_fraction};
use cairn_geometry::{Trajectory, Vec2, Vec3};
use cairn_guide::Route;
use serde::Serialize;
use std::time::Instant;

/// Largest distance to the start that counts as arrived, metres.
const ARRIVAL_M: f64 = 1.0;

/// Farther than this from the path walked out, words have misled, metres: corridors are 2 to 3 m wide.
const MISLED_M: f64 = 2.0;

/// Landmarks are drawn when at least this many key frames observe them.
const MIN_OBSERVATIONS_SHOWN: usize = 3;

/// The figures of a demo.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    pub seed: u64,
    pub facing: &'static str,
    pub sensor: &'static str,
    /// The guide announced arrival and the walker's true position is within a metre of the start.
    pub arrived: bool,
    /// True distance of the walker from the start.
    pub arrival_error_m: f64,
    /// Whether the guide announced arrival.
    pub told_arrival: bool,
    /// True length of the outbound walk, metres.
    pub walked_out_m: f64,
    /// Length of the route as recorded, with the sway of the gait in it.
    pub recorded_m: f64,
    /// Length after cleaning.
    pub cleaned_m: f64,
    /// Number of turns on the return.
    pub turns: usize,
    /// True length of the return, metres.
    pub walked_home_m: f64,
    /// Duration of the return.
    pub home_s: f64,
    /// Number of frames in which a wall or an obstacle blocked the walker.
    pub held_up: usize,
    /// How many things were put in the way after the route was recorded.
    pub obstacles: usize,
    /// How often the walker touched something that was put in his way.
    pub touched: usize,
    /// How often he was stopped for something in the way, and how often nothing was there.
    pub way_stops: usize,
    pub false_stops: usize,
    /// Where the guide gave up directions before the walker had arrived, and why.
    pub stopped: Option<String>,
    /// Farthest that the walker got from the path walked out, metres, by the truth.
    pub farthest_off_m: f64,
    /// Whether the words misled: arrival was announced elsewhere, or they led far off the path.
    pub misled: bool,
    /// Root mean square of the distances to the ground truth, out and back, after SE3 alignment (Sim3 where the map has a
    /// unit of its own: then `metric` is false).
    pub ate_m: f64,
    /// Whether lengths in the map are metres.
    pub metric: bool,
    /// Share of frames with a pose.
    pub coverage: f64,
    pub frames: usize,
    /// When tracking was lost (seconds), and for how many frames.
    pub lost: Vec<(f64, usize)>,
    pub keyframes: usize,
    pub landmarks: usize,
    /// Milliseconds from image to pose, per frame.
    pub ms: Option<Percentiles>,
    pub stages: Stages,
    pub peak_rss_mb: Option<f64>,
    /// Simulated time of the whole walk.
    pub walk_s: f64,
    /// Wall-clock time of the demo.
    pub wall_s: f64,
    pub said: Vec<Line>,
}

/// One line of the transcript.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// Seconds since the first frame of the outbound walk.
    pub t_s: f64,
    pub words: String,
    /// The walker's true position, metres in the world frame.
    pub at: [f64; 2],
    /// Whether it interrupted the previous announcement.
    pub interrupts: bool,
}

/// Everything the report needs.
pub struct Demo {
    pub figures: Figures,
    pub evaluation: Evaluation,
    pub estimate: Trajectory,
    pub truth: Trajectory,
    pub route: Route,
    pub step_ms: Vec<f64>,
    /// Walls of the world, metres.
    pub walls: Vec<[Vec2; 2]>,
    /// Landmarks observed by several key frames, aligned to the world frame, metres.
    pub landmarks: Vec<Vec2>,
    /// The recorded route, aligned to the world frame.
    pub recorded: Vec<Vec2>,
    /// The cleaned route, aligned to the world frame.
    pub cleaned: Vec<Vec2>,
    /// The walker's true path on the return.
    pub path_home: Vec<Vec2>,
    /// Where the walk started.
    pub start: Vec2,
    /// Where the walker turned back.
    pub far_end: Vec2,
    /// The surface of what was seen, where it was wanted.
    pub surface: Option<Surface>,
}

/// Runs the walk out and the return.
///
/// # Errors
/// When the session or the renderer fails, nothing was recorded, or the trajectory cannot be evaluated.
pub fn once(config: &DemoConfig) -> Result<Demo, Failure> {
    let begin = Instant::now();
    let progress = Progress::new(Some(100));
    let mut camera = DemoCamera::new(config)?;
    let out = walk_out(&mut camera, config, &progress)?;
    let start = camera.world().routes().first().and_then(|w| w.points.first()).copied().unwrap_or_default();
    let home = walk_back(&mut camera, &out, config, &progress)?;
    drop(progress);
    let estimate = camera.estimate()?;
    // Without depth and IMU the map has a unit of its own.
    let align = if camera.session().status().metric { Align::Se3 } else { Align::Sim3 };
    let options = EvalOptions { align, max_difference_s: 1e-6, ..EvalOptions::default() };
    let aligned = camera.snapshot().is_gravity_aligned_throughout();
    let surface = camera.dense.as_mut().map(|mapper| Surface::of(mapper, aligned)).transpose()?;
    let evaluation = evaluate(&camera.truth, &estimate, &options)
        .map_err(|e| Failure::new("the demo", e.to_string(), "try another --seed"))?;
    let world_from_map = evaluation.reference_from_estimate;
    let place = |p: &Vec3| world_from_map * *p;
    let map = camera.snapshot();
    let recorded: Vec<Vec3> = (out.route.resolve(|a| cairn_session::anchor_in_map(&map, a)).iter())
        .map(|p| p.frame_from_camera.translation)
        .collect();
    let last = home.path.last().copied().unwrap_or(out.turning_point.0);
    let arrival_error_m = (last - start).norm();
    let farthest_off_m = home.path.iter().map(|p| distance_to(&out.corners, *p)).fold(0.0, f64::max);
    let figures = Figures {
        seed: config.seed,
        facing: facing_name(config.facing),
        sensor: config.sensor.name(),
        arrived: home.arrived && arrival_error_m <= ARRIVAL_M,
        arrival_error_m,
        told_arrival: home.arrived,
        walked_out_m: out.walked_m,
        recorded_m: home.cleaned.before_m,
        cleaned_m: home.cleaned.after_m,
        turns: home.turns,
        walked_home_m: home.path.windows(2).map(|w| (w[1] - w[0]).norm()).sum(),
        home_s: home.took_s,
        held_up: home.blocked,
        obstacles: home.obstacles.count,
        touched: home.obstacles.touched,
        way_stops: home.obstacles.stops,
        false_stops: home.obstacles.false_stops,
        misled: (home.arrived && arrival_error_m > ARRIVAL_M) || farthest_off_m > MISLED_M,
        stopped: home.stopped,
        farthest_off_m,
        ate_m: evaluation.ate_m.rmse,
        metric: align == Align::Se3,
        coverage: tracked_fraction(camera.truth.stamps_ns(), &estimate),
        frames: camera.truth.len(),
        lost: camera.lost.clone(),
        keyframes: map.key_frame_count(),
        landmarks: map.landmark_count(),
        ms: Percentiles::of(&camera.step_ms),
        stages: camera.times.summary(),
        peak_rss_mb: process::peak_rss_mb(),
        walk_s: camera.truth.duration_s(),
        wall_s: begin.elapsed().as_secs_f64(),
        said: home.said.iter().map(line).collect(),
    };
    let Return { cleaned, path, .. } = home;
    Ok(Demo {
        figures,
        estimate,
        step_ms: std::mem::take(&mut camera.step_ms),
        walls: camera.world().plan().iter().map(|(a, b)| [*a, *b]).collect(),
        landmarks: (map.landmarks().filter(|l| l.observations.len() >= MIN_OBSERVATIONS_SHOWN))
            .map(|l| place(&l.position).xy())
            .collect(),
        recorded: to_floor_plan(&recorded, place),
        cleaned: to_floor_plan(&cleaned.points, place),
        path_home: path,
        start,
        far_end: out.turning_point.0,
        surface,
        route: out.route,
        truth: std::mem::take(&mut camera.truth),
        evaluation,
    })
}

/// The distance of a place from a line through corners, metres.
pub fn distance_to(corners: &[Vec2], place: Vec2) -> f64 {
    let to_leg = |leg: &[Vec2]| {
        let d = leg[1] - leg[0];
        let share = ((place - leg[0]).dot(&d) / d.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        (leg[0] + d * share - place).norm()
    };
    corners.windows(2).map(to_leg).fold(f64::INFINITY, f64::min)
}

fn line(said: &Spoken) -> Line {
    Line { t_s: said.t_s, words: said.words.clone(), at: said.at.into(), interrupts: said.interrupts }
}
