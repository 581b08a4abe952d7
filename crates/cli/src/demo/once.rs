//! One demo from the first frame to the figures.

use super::camera::DemoCamera;
use super::config::{DemoConfig, facing_name, sensor_name};
use super::home::{CameHome, Spoken, come_home, on_floor};
use super::out::walk_out;
use crate::failure::Failure;
use crate::progress::Progress;
use cairn_eval::{Align, EvalOptions, Evaluation, Percentiles, Stages, evaluate, process};
use cairn_geometry::{Trajectory, Vec2, Vec3};
use cairn_guide::Route;
use serde::Serialize;
use std::time::Instant;

/// Arrived means: within this of where the walker set out, metres.
const ARRIVAL_M: f64 = 1.0;

/// Landmarks are drawn when so many key frames see them.
const SHOWN_BY: usize = 3;

/// The figures of a demo.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    pub seed: u64,
    pub facing: &'static str,
    pub sensor: &'static str,
    /// The guide said so, and the walker truly stands within a metre of where he set out.
    pub arrived: bool,
    /// True distance from the walker to where he set out.
    pub arrival_error_m: f64,
    /// The guide said that the way has ended.
    pub told_arrival: bool,
    /// Metres truly walked on the way out.
    pub walked_out_m: f64,
    /// Length of the way as recorded, with the gait in it.
    pub recorded_m: f64,
    /// Length after cleaning.
    pub cleaned_m: f64,
    /// Turns on the way home.
    pub turns: usize,
    /// Metres truly walked on the way home.
    pub walked_home_m: f64,
    /// Seconds of the way home.
    pub home_s: f64,
    /// Frames in which a wall or a thing held the walker up.
    pub held_up: usize,
    /// Root mean square of the distances to the truth, out and home, after SE3 alignment.
    pub ate_m: f64,
    /// Share of frames with a pose.
    pub coverage: f64,
    pub frames: usize,
    /// Seconds at which tracking was lost, and for how many frames.
    pub lost: Vec<(f64, usize)>,
    pub keyframes: usize,
    pub landmarks: usize,
    /// Milliseconds from image to pose.
    pub ms: Option<Percentiles>,
    pub stages: Stages,
    pub peak_rss_mb: Option<f64>,
    /// Seconds of the walk.
    pub walk_s: f64,
    /// Seconds that the demo took.
    pub wall_s: f64,
    pub said: Vec<Line>,
}

/// One line of the transcript.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// Seconds from the first frame of the way out.
    pub t_s: f64,
    pub words: String,
    /// Where the walker truly was, metres in the world.
    pub at: [f64; 2],
    /// It broke off what was being said.
    pub interrupts: bool,
}

/// Everything that a report draws on.
pub struct Demo {
    pub figures: Figures,
    pub evaluation: Evaluation,
    pub estimate: Trajectory,
    pub truth: Trajectory,
    pub route: Route,
    pub step_ms: Vec<f64>,
    /// Walls of the world, metres.
    pub walls: Vec<[Vec2; 2]>,
    /// Landmarks that several key frames see, laid onto the world, metres.
    pub landmarks: Vec<Vec2>,
    /// The recorded way laid onto the world.
    pub recorded: Vec<Vec2>,
    /// The cleaned way laid onto the world.
    pub cleaned: Vec<Vec2>,
    /// Where the walker truly went on the way home.
    pub path_home: Vec<Vec2>,
    /// Where he set out.
    pub start: Vec2,
    /// Where he turned back.
    pub far_end: Vec2,
}

/// Walks out and home.
pub fn once(config: &DemoConfig) -> Result<Demo, Failure> {
    let begin = Instant::now();
    let progress = Progress::new(Some(100));
    let mut camera = DemoCamera::new(&config.sim, config.source())?;
    let out = walk_out(&mut camera, config, &progress)?;
    let start = camera.world().routes().first().and_then(|w| w.points.first()).copied().unwrap_or_default();
    let home = come_home(&mut camera, &out, config, &progress)?;
    drop(progress);
    let estimate = camera.estimate()?;
    let options = EvalOptions { align: Align::Se3, max_difference_s: 1e-6, ..EvalOptions::default() };
    let evaluation = evaluate(&camera.truth, &estimate, &options)
        .map_err(|e| Failure::new("the demo", e.to_string(), "try another --seed"))?;
    let world_from_map = evaluation.reference_from_estimate;
    let place = |p: &Vec3| world_from_map * *p;
    let map = camera.snapshot();
    let recorded: Vec<Vec3> = (out.route.resolve(|a| cairn_session::standing(&map, a)).iter())
        .map(|p| p.frame_from_camera.translation)
        .collect();
    let last = home.path.last().copied().unwrap_or(out.stands.0);
    let arrival_error_m = (last - start).norm();
    let figures = Figures {
        seed: config.seed,
        facing: facing_name(config.facing),
        sensor: sensor_name(config.sim.sensor),
        arrived: home.arrived && arrival_error_m <= ARRIVAL_M,
        arrival_error_m,
        told_arrival: home.arrived,
        walked_out_m: out.walked_m,
        recorded_m: home.cleaned.before_m,
        cleaned_m: home.cleaned.after_m,
        turns: home.turns,
        walked_home_m: home.path.windows(2).map(|w| (w[1] - w[0]).norm()).sum(),
        home_s: home.took_s,
        held_up: home.held_up,
        ate_m: evaluation.ate_m.rmse,
        coverage: evaluation.coverage,
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
    let CameHome { cleaned, path, .. } = home;
    Ok(Demo {
        figures,
        estimate,
        step_ms: std::mem::take(&mut camera.step_ms),
        walls: camera.world().plan().iter().map(|(a, b)| [*a, *b]).collect(),
        landmarks: (map.landmarks().filter(|l| l.observations.len() >= SHOWN_BY))
            .map(|l| place(&l.position).xy())
            .collect(),
        recorded: on_floor(&recorded, place),
        cleaned: on_floor(&cleaned.points, place),
        path_home: path,
        start,
        far_end: out.stands.0,
        route: out.route,
        truth: std::mem::take(&mut camera.truth),
        evaluation,
    })
}

fn line(said: &Spoken) -> Line {
    Line { t_s: said.t_s, words: said.words.clone(), at: said.at.into(), interrupts: said.interrupts }
}
