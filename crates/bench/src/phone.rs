//! The recordings of a real phone that nobody calibrated, begun at every second: whether there is one map, when it has metres and how
//! well it says it knows them, what is found of clocks, rows and lens, and whether the unit of length changes unsaid.

use crate::{MeasureError, Sensors, run};
use cairn_atlas::MapId;
use cairn_engine::{Config, Engine, Odometry, Output, Runner, StageEvent, State, with_found_lens};
use cairn_geometry::So3;
use cairn_lens::LensProblem;
use cairn_sensor::Stamp;
use cairn_session::Slam;
use cairn_sources::{OpenOptions, open};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

/// The recordings and the last second to begin at.
const RECORDINGS: [(&str, u32); 2] = [("phone/a", 0), ("phone/b", 15)];
/// Seconds over which the pace is averaged.
const PACE_S: f64 = 2.0;

/// What is measured.
#[derive(Clone, Debug, Default)]
pub struct Chosen {
    /// Only recordings whose name contains this.
    pub only: Option<String>,
    /// Seconds to begin at; by default every one.
    pub starts: Vec<u32>,
    /// Configuration of the engine.
    pub config: Config,
    /// Prints every frame on stderr.
    pub verbose: bool,
}

/// The figures of one run.
#[derive(Clone, Debug)]
pub struct Figures {
    /// The recording.
    pub recording: &'static str,
    /// The second it was begun at.
    pub start_s: u32,
    /// Share of the frames that have a pose at the end.
    pub coverage: f64,
    /// Maps that were begun, and those that hold poses at the end.
    pub maps: [usize; 2],
    /// Seconds from the first frame to the first metres, with the relative standard deviation stated then.
    pub metric: Option<(f64, f64)>,
    /// The one stated at the end.
    pub sigma: Option<f64>,
    /// Share of the frames from the first metres on that have metres.
    pub metric_share: f64,
    /// Seconds to add to the stamps of the IMU.
    pub offset_s: f64,
    /// Readout time of the rows, seconds.
    pub readout_s: f64,
    /// Focal length that the images are read with, and by the map at its end, pixels.
    pub focal: [Option<f64>; 2],
    /// Length of the final trajectory, in metres where the map has them.
    pub path: f64,
    /// The fastest pace over the slowest of each two seconds in one stretch of odometry, whose unit nobody said had changed.
    pub pace_ratio: f64,
}

/// Runs what is chosen, in lockstep.
///
/// # Errors
/// When a recording cannot be read or a run fails.
pub fn run(data: &Path, chosen: &Chosen) -> Result<Vec<Figures>, MeasureError> {
    let mut all = Vec::new();
    for (recording, last) in RECORDINGS {
        if chosen.only.as_ref().is_some_and(|only| !recording.contains(only.as_str())) {
            continue;
        }
        let starts = if chosen.starts.is_empty() { (0..=last).collect() } else { chosen.starts.clone() };
        for start_s in starts.into_iter().filter(|s| *s <= last) {
            let figures = once(data, recording, start_s, chosen)?;
            eprint!("{}", row(&figures));
            all.push(figures);
        }
    }
    Ok(all)
}

fn once(
    data: &Path,
    recording: &'static str,
    start_s: u32,
    chosen: &Chosen,
) -> Result<Figures, MeasureError> {
    let options = OpenOptions { start_s: f64::from(start_s), ..OpenOptions::default() };
    let mut source = open(&data.join(recording).to_string_lossy(), options)?;
    let (sensor, rate_hz) = (Sensors::MonoImu, source.info().rate_hz);
    let mut config = chosen.config.clone();
    // As `cairn run` does.
    let may_roll = source.info().assumed.is_some();
    if may_roll {
        source = with_found_lens(source, &config)?;
    }
    config.tracker.estimate_readout |= may_roll && config.tracker.readout_s == 0.0;
    config.tracker.clocks_by_flow |= may_roll;
    let mut engine = run::engine(source.rig(), sensor, rate_hz, Runner::Lockstep, &config)?;
    let (mut frames, mut with_metres, mut known) = (0, 0, BTreeSet::<MapId>::new());
    let (mut first, mut metric, mut moved) = (None, None, Vec::new());
    while let Some((packet, out)) = run::step(source.as_mut(), &mut engine, frames)? {
        frames += 1;
        let first = *first.get_or_insert(packet.stamp);
        if chosen.verbose {
            eprintln!("{}", line(packet.stamp - first, &out, &engine));
        }
        known.extend(engine.snapshot().maps().map(|(map, _)| map));
        if out.is_metric() {
            metric.get_or_insert((packet.stamp - first, frames, stated(&engine).unwrap_or(f64::NAN)));
            with_metres += 1;
        }
        moved.extend(out.pose.map(|pose| (packet.stamp, pose.odometry)));
    }
    engine.finish();
    let poses = engine.trajectory();
    let inside = poses.iter().filter(|(t, _)| first.is_some_and(|first| *t >= first)).count();
    let since_metric = metric.map_or(0, |(_, at, _)| frames + 1 - at);
    Ok(Figures {
        recording,
        start_s,
        coverage: inside as f64 / frames.max(1) as f64,
        maps: [known.len(), engine.snapshot().maps().count()],
        metric: metric.map(|(at, _, sigma)| (at, sigma)),
        sigma: stated(&engine),
        metric_share: f64::from(with_metres) / since_metric.max(1) as f64,
        offset_s: engine.snapshot().imu_offset(),
        readout_s: engine.readout().seconds,
        focal: focal(&engine),
        path: poses.windows(2).map(|w| (w[1].1.translation - w[0].1.translation).norm()).sum(),
        pace_ratio: pace_ratio(&moved),
    })
}

/// The relative standard deviation of scale that is stated for the newest map.
fn stated(engine: &Engine) -> Option<f64> {
    let map = engine.snapshot();
    map.stated_scale_sigma(map.newest_key_frame()?.map)
}

/// The focal length that the images are read with, and what the newest map makes of it.
fn focal(engine: &Engine) -> [Option<f64>; 2] {
    let (map, camera) = (engine.snapshot(), Slam::camera(engine));
    let imu_from_camera = map.imu_from_camera().map_or_else(So3::identity, |pose| pose.rotation);
    let problem = map.newest_key_frame().and_then(|k| LensProblem::of(&map, k.map, camera, &imu_from_camera));
    let found = problem.and_then(|problem| problem.solve()).map(|found| found.lens.focal * camera.fx);
    [Some(camera.fx), found]
}

/// The fastest pace over the slowest within a segment of odometry.
fn pace_ratio(moved: &[(Stamp, Odometry)]) -> f64 {
    let mut worst: f64 = 1.0;
    for segment in moved.chunk_by(|a, b| a.1.segment == b.1.segment) {
        let mut paces = Vec::new();
        let (mut from, mut far) = (0, 0.0);
        for i in 1..segment.len() {
            let place = |k: usize| segment[k].1.odom_from_body.se3.translation;
            far += (place(i) - place(i - 1)).norm();
            let seconds = segment[i].0 - segment[from].0;
            if seconds >= PACE_S {
                paces.push(far / seconds);
                (from, far) = (i, 0.0);
            }
        }
        let (least, most) = paces.iter().fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.min(*p), b.max(*p)));
        if most > 0.0 {
            worst = worst.max(most / least);
        }
    }
    worst
}

/// A frame, in words.
fn line(at_s: f64, out: &Output, engine: &Engine) -> String {
    let state = match out.state {
        State::Tracking => "tracking".to_owned(),
        other => format!("{other:?}"),
    };
    let mut text = format!(
        "{at_s:6.2} {state} matched {} inliers {} {} key frames {} offset {:.1} readout {:.1}",
        out.evidence.matched,
        out.evidence.inliers,
        if out.is_metric() { "metres" } else { "-" },
        engine.snapshot().key_frame_count(),
        1e3 * engine.snapshot().imu_offset(),
        1e3 * engine.readout().seconds,
    );
    if let Some(scale) = out.pose.map(|pose| pose.scale) {
        let _ = write!(text, " map {:?} supported {}", scale.map, scale.supported);
    }
    if let Some(check) = out.events.iter().find_map(StageEvent::scale_check) {
        let _ = write!(text, "\n    {check:?}");
    }
    if let Some(attempt) = out.events.iter().find_map(StageEvent::attempt) {
        let failed: Vec<String> = attempt.failed().map(ToString::to_string).collect();
        let found = attempt.found.as_ref().map(|f| {
            format!(
                "scale {:.4} ({:.3}) residual {:.2} noise {:.1?} offset {:.1} ({:.1})",
                f.scale,
                f.scale_sigma,
                f.residual,
                f.noise_times,
                1e3 * f.offset_s,
                1e3 * f.offset_sigma_s
            )
        });
        let _ = write!(text, "\n    {}; failed: {}", found.unwrap_or_default(), failed.join("; "));
    }
    text
}

/// The table.
pub fn table(all: &[Figures]) -> String {
    let head = "| recording | from s | coverage | maps begun (left) | metres after s (sigma %) | sigma at the end % | frames with metres since | offset ms | readout ms | focal px (by the map) | path m | pace ratio |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    all.iter().fold(head.to_owned(), |text, figures| text + &row(figures))
}

fn row(f: &Figures) -> String {
    let or = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    format!(
        "| {} | {} | {:.3} | {} ({}) | {} ({}) | {} | {:.3} | {:.1} | {:.1} | {} ({}) | {:.2} | {:.1} |\n",
        f.recording,
        f.start_s,
        f.coverage,
        f.maps[0],
        f.maps[1],
        or(f.metric.map(|(at, _)| at), 1),
        or(f.metric.map(|(_, sigma)| 100.0 * sigma), 1),
        or(f.sigma.map(|sigma| 100.0 * sigma), 1),
        f.metric_share,
        1e3 * f.offset_s,
        1e3 * f.readout_s,
        or(f.focal[0], 0),
        or(f.focal[1], 0),
        f.path,
        f.pace_ratio,
    )
}
