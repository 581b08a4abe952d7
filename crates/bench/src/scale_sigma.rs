//! `scale-sigma`: whether the scale of one camera and an IMU is as uncertain as it says: errors over stated standard deviations,
//! for windows of several lengths that start every two seconds.
//!
//! The motions of `imu-truth` with poses of the truth and noise instead of a camera, and recordings and simulated walks whose
//! poses are those of a map made by images alone, so that nothing of the readings is in them.

use crate::inertial::data::{self, ImuRecording};
use crate::inertial::reference::Reference;
use crate::{MeasureError, RunOptions, Sensors};
use cairn_adjust::ImuModel;
use cairn_atlas::KeyFrame;
use cairn_engine::{Engine, Runner};
use cairn_geometry::{Se3, So3, Vec3, umeyama};
use cairn_inertial::{
    Attempt, Bias, GateKind, ImuBuffer, InitialiseConfig, Preintegrated, Scale, Seen, SeenPose, initialise,
    of_data_sheet,
};
use cairn_mapping::{CameraAndImu, initialise_key_frames};
use cairn_random::Random;
use cairn_sensor::{ImuSample, ImuSensor, Source, Stamp};
use cairn_sources::{OpenOptions, open, std_host};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Lengths of the windows, seconds.
const WINDOWS_S: [f64; 4] = [3.0, 6.0, 12.0, 20.0];
/// Seconds between the starts of windows.
const START_S: f64 = 2.0;
/// Seconds between the key frames of the motions of `imu-truth`.
const KEY_FRAME_S: f64 = 0.25;
/// Windows that state more than this are not counted: the engine does not use them.
const MOST_SIGMA: f64 = 0.1;
/// What is left of the clocks' offset where it was compared, seconds.
const OFFSET_SIGMA_S: f64 = 0.002;

/// Windows of one length.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Recording.
    pub name: String,
    /// Length, seconds.
    pub seconds: f64,
    /// How many passed the tests of an initialisation (but perhaps those of the standard deviations).
    pub windows: usize,
    /// Root mean square of the logarithm of scale's error, percent.
    pub error_percent: f64,
    /// Its mean, percent: what all windows have in common.
    pub mean_percent: f64,
    /// Median of the stated standard deviation, percent.
    pub sigma_percent: f64,
    /// Root mean square of error over standard deviation.
    pub normalised: f64,
}

/// The error of a window's logarithm of scale, and its stated standard deviation.
type Judged = [f64; 2];

fn judged(attempt: &Attempt, truth: f64) -> Option<Judged> {
    let found = attempt.good_but_for(&[GateKind::ScaleSigma, GateKind::GravitySigma])?;
    (found.scale_sigma <= MOST_SIGMA).then_some([(found.scale / truth).ln(), found.scale_sigma])
}

fn row(name: &str, seconds: f64, all: &[Judged]) -> Row {
    let n = all.len().max(1) as f64;
    let rms = |of: &dyn Fn(&Judged) -> f64| (all.iter().map(|j| of(j).powi(2)).sum::<f64>() / n).sqrt();
    let mut sigmas: Vec<f64> = all.iter().map(|j| 100.0 * j[1]).collect();
    sigmas.sort_by(f64::total_cmp);
    Row {
        name: name.into(),
        seconds,
        windows: all.len(),
        error_percent: 100.0 * rms(&|j| j[0]),
        mean_percent: 100.0 * all.iter().map(|j| j[0]).sum::<f64>() / n,
        sigma_percent: sigmas.get(sigmas.len() / 2).copied().unwrap_or(f64::NAN),
        normalised: rms(&|j| j[0] / j[1]),
    }
}

/// A motion of `imu-truth`: true poses with noise of 0.1 degrees and 2 mm for each axis, stated so.
///
/// # Errors
/// When the recording cannot be read.
pub fn motion(data: &Path, name: &'static str) -> Result<Vec<Row>, MeasureError> {
    let (rotation_sigma, position_sigma) = (0.1f64.to_radians(), 0.002);
    let motion = ImuRecording::read(data, name)?;
    let (reference, buffer, camera) = (Reference::of(&motion), motion.buffer(), data::imu_from_camera());
    let (first, last) = motion.span();
    let windows = WINDOWS_S.map(|seconds| {
        let (mut found, mut from, mut stream) = (Vec::new(), first.plus_seconds(START_S), 0);
        while last - from > seconds + 0.5 {
            let count = (seconds / KEY_FRAME_S) as usize;
            let stamps: Vec<Stamp> = (0..=count).map(|k| from.plus_seconds(KEY_FRAME_S * k as f64)).collect();
            let mut random = Random::stream(5, stream);
            let mut noise = |sigma: f64| Vec3::from_fn(|_, _| random.standard_normal()) * sigma;
            let pose = |t: &Stamp| {
                let truth = reference.pose(&motion, *t)? * camera;
                let rotation = truth.rotation * So3::exp(&noise(rotation_sigma));
                let world_from_camera = Se3::new(rotation, truth.translation + noise(position_sigma));
                Some(SeenPose { stamp: *t, world_from_camera })
            };
            let poses: Option<Vec<SeenPose>> = stamps.iter().map(pose).collect();
            if let (Some(poses), Some(links)) = (poses, data::links(&buffer, Bias::default(), &stamps)) {
                let seen = Seen { poses: &poses, rotation_sigma, position_sigma };
                let config = InitialiseConfig {
                    noise_times: 1.0,
                    offset_sigma_s: OFFSET_SIGMA_S,
                    ..InitialiseConfig::default()
                };
                found.extend(judged(&initialise(&seen, &links, &camera, Scale::Free, &config), 1.0));
            }
            from = from.plus_seconds(START_S);
            stream += 1;
        }
        row(name, seconds, &found)
    });
    Ok(windows.into())
}

/// A source with a camera and an IMU: poses of the key frames of the largest map made by the camera alone.
///
/// # Errors
/// When the source or the engine fails.
pub fn source(name: &str, address: &str) -> Result<Vec<Row>, MeasureError> {
    let mut source = open(address, OpenOptions::default())?;
    by_images(name, source.as_mut())
}

fn by_images(name: &str, source: &mut dyn Source) -> Result<Vec<Row>, MeasureError> {
    let options = RunOptions::new(Sensors::Mono);
    let (rig, rate_hz) = (source.rig().clone(), source.info().rate_hz);
    let sensor = rig.imu.clone().ok_or("no IMU")?;
    let mut engine =
        Engine::new(&rig, options.sensor.mode(), rate_hz, Runner::Lockstep, &options.config, &std_host())?;
    let mut readings: Vec<ImuSample> = Vec::new();
    while let Some(packet) = source.next_packet()? {
        engine.on_packet(&packet)?;
        readings.extend(
            packet.imu.iter().map(|s| ImuSample { stamp: s.stamp.plus_seconds(sensor.offset_s), ..*s }),
        );
    }
    engine.finish();
    readings.sort_by_key(|s| s.stamp);
    readings.dedup_by_key(|s| s.stamp);
    let sensor = ImuSensor { noise: of_data_sheet(&sensor.noise), ..sensor };
    let mut buffer = ImuBuffer::new(&sensor, 0.1);
    buffer.push(&readings);
    let snapshot = engine.snapshot();
    let model = *engine.front_end().model();
    let truth: BTreeMap<Stamp, Se3> = source.info().truth.iter().copied().collect();
    let camera_at = |t: Stamp| {
        let (before, after) = (truth.range(..=t).next_back()?, truth.range(t..).next()?);
        let part = if after.0 > before.0 { (t - *before.0) / (*after.0 - *before.0) } else { 0.0 };
        let body = before.1.translation + (after.1.translation - before.1.translation) * part;
        (*after.0 - *before.0 < 0.1).then_some(body + before.1.rotation * model.body_from_camera.translation)
    };
    let imu = ImuModel {
        imu_from_camera: sensor.body_from_imu.inverse() * model.body_from_camera,
        noise: sensor.noise,
        others_times: 1.0,
    };
    let of = CameraAndImu { camera: &model, imu: &imu, offset_sigma_s: OFFSET_SIGMA_S, lever_arm_sigma: 0.0 };
    let largest = snapshot.maps().map(|(m, _)| m).max_by_key(|m| snapshot.key_frames_of(*m).count());
    let mut frames: Vec<&KeyFrame> = snapshot.key_frames_of(largest.ok_or("no map")?).collect();
    frames.sort_by_key(|k| k.stamp);
    let first = frames.first().ok_or("no key frames")?.stamp;
    let last = frames[frames.len() - 1].stamp;
    let windows = WINDOWS_S.map(|seconds| {
        let (mut found, mut from) = (Vec::new(), first);
        while last - from >= seconds {
            let inside: Vec<&KeyFrame> =
                (frames.iter().copied()).filter(|k| k.stamp >= from && k.stamp - from <= seconds).collect();
            let judge = || {
                let link = |w: &[&KeyFrame]| {
                    let near = w[1].stamp - w[0].stamp < 5.0;
                    near.then(|| buffer.preintegrate(Bias::default(), w[0].stamp, w[1].stamp).ok())?
                };
                let links: Option<Vec<Preintegrated>> = inside.windows(2).map(link).collect();
                let real: Option<Vec<Vec3>> = inside.iter().map(|k| camera_at(k.stamp)).collect();
                let seen: Vec<Vec3> = inside.iter().map(|k| k.world_from_camera.translation).collect();
                let unit = umeyama(&real?, &seen, true).ok()?.scale;
                judged(&initialise_key_frames(&snapshot, &of, &inside, &links?)?, unit)
            };
            found.extend(judge());
            from = from.plus_seconds(START_S);
        }
        row(name, seconds, &found)
    });
    Ok(windows.into())
}

/// Everything whose name contains `only`; what is missing is told on stderr.
///
/// # Errors
/// When a recording cannot be read or a run fails.
pub fn run(data: &Path, only: Option<&str>, seeds: u64) -> Result<Vec<Row>, MeasureError> {
    let chosen = |name: &str| only.is_none_or(|part| name.contains(part));
    let mut rows = Vec::new();
    let is_there = |folder: &str| {
        let there = data.join(folder).exists();
        if !there {
            eprintln!("skipped: {folder} is not in {}", data.display());
        }
        there
    };
    for name in data::NAMES.into_iter().filter(|n| chosen(n)) {
        if is_there(&format!("imu-truth/{name}")) {
            rows.extend(motion(data, name)?);
        }
    }
    for name in ["euroc-mh01", "atrium"].into_iter().filter(|n| chosen(n)) {
        if is_there(name) {
            rows.extend(source(name, &data.join(name).to_string_lossy())?);
        }
    }
    for seed in 1..=seeds {
        let name = format!("demo {seed}");
        if chosen(&name) {
            let address = format!(
                "sim:demo?detail=0.5&seed={seed}&sensor=mono-imu&resolution=480x360&focal=270&rate=20&duration=30"
            );
            rows.extend(source(&name, &address)?);
        }
    }
    Ok(rows)
}

/// The rows in Markdown.
pub fn table(rows: &[Row]) -> String {
    let mut t = String::from(
        "| recording | window s | windows | scale error %, RMS | mean | stated sigma %, median | error / sigma, RMS |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for r in rows.iter().filter(|r| r.windows > 0) {
        // Writing to a string cannot fail.
        let _ = writeln!(
            t,
            "| {} | {} | {} | {:.2} | {:+.2} | {:.2} | {:.2} |",
            r.name, r.seconds, r.windows, r.error_percent, r.mean_percent, r.sigma_percent, r.normalised
        );
    }
    t
}
