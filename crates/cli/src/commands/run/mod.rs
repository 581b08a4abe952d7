//! `cairn run`: SLAM on any source; trajectories, a recorded way, a report in JSON and as a page.

mod page;
mod tally;

use crate::failure::Failure;
use crate::output::Output;
use crate::progress::Progress;
use cairn_engine::{Config, Engine, Runner, SensorMode, record_input};
use cairn_eval::{RunReport, to_tum, write_whole};
use cairn_geometry::{Se3, Trajectory};
use cairn_guide::{Ground, Recorder, RecorderSetting, WayHeader, WayWriter};
use cairn_sensor::{Rig, Source, Stamp};
use cairn_sources::{OpenOptions, Paced, open, read_rig};
use std::path::{Path, PathBuf};
use std::time::Instant;
use tally::Tally;

/// SLAM on any source: poses, a map, a recorded way, a report.
///
/// SOURCE is the folder of a recording (EuRoC, TUM-VI, TUM RGB-D, KITTI, 7-Scenes) or sim:WORLD; its kind is found by
/// looking.
#[derive(clap::Args)]
pub struct Arguments {
    /// The recording or the simulated world.
    source: String,
    /// Which sensors to use; without it, all that the source has.
    #[arg(long, value_enum, value_name = "WHICH")]
    sensor: Option<Sensor>,
    /// A calibration in place of the source's own.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Settings that differ from the default, see cairn config.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Writes every tracked frame, corrected at the end, in TUM form.
    #[arg(long, value_name = "OUT.tum")]
    trajectory: Option<PathBuf>,
    /// Writes the poses as they were given at the time, in TUM form.
    #[arg(long, value_name = "OUT.tum")]
    live_trajectory: Option<PathBuf>,
    /// Whose poses the trajectories hold.
    #[arg(long, value_enum, default_value = "body", value_name = "WHOSE")]
    frame: Whose,
    /// Records the way that was gone; an existing file is refused.
    #[arg(long, value_name = "WAY")]
    record: Option<PathBuf>,
    /// One stage after the other, the same bits every time, whatever else the machine does (the default).
    #[arg(long, conflicts_with = "realtime")]
    lockstep: bool,
    /// Plays the source as a camera would; mapping has its own thread, frames that come too fast are dropped.
    #[arg(long)]
    realtime: bool,
    /// Begins so many seconds after the first image.
    #[arg(long, default_value_t = 0.0, value_name = "S")]
    start: f64,
    /// Takes at most so many frames.
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Writes the report as JSON.
    #[arg(long, value_name = "OUT.json")]
    report: Option<PathBuf>,
    /// Writes the report as one HTML file with its figures.
    #[arg(long, value_name = "OUT.html")]
    report_html: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Sensor {
    /// The first camera; the scale stays unknown.
    Mono,
    /// The first two cameras.
    Stereo,
    /// The first camera and the depth sensor.
    Rgbd,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Whose {
    /// The rig's body (EuRoC: the IMU).
    Body,
    /// The first camera.
    Cam0,
}

impl Sensor {
    pub fn mode(self) -> SensorMode {
        match self {
            Self::Mono => SensorMode::Mono,
            Self::Stereo => SensorMode::Stereo,
            Self::Rgbd => SensorMode::Rgbd,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Mono => "mono",
            Self::Stereo => "stereo",
            Self::Rgbd => "rgbd",
        }
    }

    /// All that a rig has.
    pub fn of(rig: &Rig) -> Self {
        match (&rig.depth, rig.cameras.len()) {
            (Some(_), _) => Self::Rgbd,
            (None, 0 | 1) => Self::Mono,
            (None, _) => Self::Stereo,
        }
    }

    /// The rig without the cameras and the depth that are not asked for, so that they are not even read; `None`
    /// when nothing is left out.
    fn only(self, rig: &Rig) -> Option<Rig> {
        let cameras = if self == Self::Stereo { 2 } else { 1 };
        let depth = rig.depth.is_some() && self != Self::Rgbd;
        (rig.cameras.len() > cameras || depth).then(|| Rig {
            cameras: rig.cameras.iter().take(cameras).cloned().collect(),
            depth: rig.depth.clone().filter(|_| !depth),
            imu: rig.imu.clone(),
        })
    }
}

/// Runs the engine over the source, then writes what was asked for. `began` is when the process started.
pub fn run(a: &Arguments, output: &Output, began: Instant) -> Result<(), Failure> {
    targets_can_be_written(a)?;
    let config = a.config.as_deref().map_or_else(|| Ok(Config::default()), read_config)?;
    let (source, sensor) = open_source(a)?;
    let rig = source.rig().clone();
    let runner = if a.realtime { Runner::Threaded } else { Runner::Lockstep };
    let mut engine =
        Engine::new(&rig, sensor.mode(), source.info().rate_hz, runner, &config).map_err(|e| {
            Failure::new(
                &a.source,
                e.to_string(),
                "choose another --sensor, or give a calibration with --rig",
            )
        })?;
    let mut recorder = a.record.as_deref().map(|path| begin_way(path, sensor, &a.source)).transpose()?;
    let mut tally = Tally::new(began);
    let truth = source.info().truth.clone();
    let name = source.info().name.clone();
    let skipped = if a.realtime {
        let mut paced = Paced::new(source);
        drive(&mut paced, &mut engine, &mut tally, &mut recorder, a)?;
        tally.dropped = paced.dropped();
        paced.skipped().to_vec()
    } else {
        let mut source = source;
        drive(&mut *source, &mut engine, &mut tally, &mut recorder, a)?;
        source.skipped().to_vec()
    };
    tally.finished(engine.finish());
    warn_of_skipped(&skipped);
    if let (Some(recorder), Some(path)) = (recorder, &a.record) {
        end_way(path, recorder)?;
    }
    let mut report = tally.report(&engine, &config, &skipped);
    (report.source, report.sensor) = (name, sensor.name().to_owned());
    report.accuracy = tally::accuracy(&truth, &engine, sensor.mode());
    write_reports(a, &engine, &report, &tally)?;
    if report.tracked == 0 {
        let why = tally.last_state.clone().unwrap_or_else(|| "it gave no frame".into());
        return Err(Failure::new(&a.source, format!("no frame got a pose: {why}"), NO_POSE));
    }
    write_trajectories(a, &rig, &engine)?;
    output.result(&report, |r| tally::text(r, a.realtime))
}

const NO_POSE: &str =
    "check the calibration (cairn rig check), give a longer stretch, or let the camera see more texture";

fn open_source(a: &Arguments) -> Result<(Box<dyn Source>, Sensor), Failure> {
    let options = |rig: Option<Rig>| OpenOptions { rig, start_s: a.start, frames: a.frames };
    let given = a.rig.as_deref().map(read_rig).transpose()?;
    let source = open(&a.source, options(given))?;
    let sensor = a.sensor.unwrap_or_else(|| Sensor::of(source.rig()));
    // A world renders what its own address says.
    let fewer = sensor.only(source.rig()).filter(|_| !a.source.starts_with("sim:"));
    match fewer {
        Some(rig) => {
            drop(source);
            Ok((open(&a.source, options(Some(rig)))?, sensor))
        }
        None => Ok((source, sensor)),
    }
}

pub fn read_config(path: &Path) -> Result<Config, Failure> {
    let shown = path.display().to_string();
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::new(&shown, e.to_string(), "check the path, or see cairn config"))?;
    Config::from_toml(&text).map_err(|e| {
        let place = e.line.map_or_else(|| shown.clone(), |line| format!("{shown}, line {line}"));
        Failure::new(place, e.why, "cairn config prints every entry with its meaning")
    })
}

/// Finds out before the work rather than after it that a result could not be written.
fn targets_can_be_written(a: &Arguments) -> Result<(), Failure> {
    let targets = [&a.trajectory, &a.live_trajectory, &a.record, &a.report, &a.report_html];
    for path in targets.into_iter().flatten() {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            let why = format!("its folder {} does not exist", folder.display());
            return Err(Failure::new(path.display().to_string(), why, "make the folder first"));
        }
        if path.is_dir() {
            return Err(Failure::new(path.display().to_string(), "is a folder", "name a file"));
        }
    }
    Ok(())
}

fn begin_way(path: &Path, sensor: Sensor, source: &str) -> Result<Recorder, Failure> {
    let (metric, ground) = (sensor != Sensor::Mono, Ground::first_camera());
    let header = WayHeader::new(metric, &ground, source);
    let writer = WayWriter::create(path, &header).map_err(|e| way_failed(path, &e))?;
    Ok(Recorder::new(RecorderSetting::default(), metric, &ground, source).with_writer(writer))
}

/// Everything to disk; a way without a single point leaves no file behind.
fn end_way(path: &Path, recorder: Recorder) -> Result<(), Failure> {
    let (way, synced) = recorder.finish();
    let done = if way.points.is_empty() { std::fs::remove_file(path) } else { synced };
    done.map_err(|e| way_failed(path, &e))
}

fn way_failed(path: &Path, error: &std::io::Error) -> Failure {
    let hint = match error.kind() {
        std::io::ErrorKind::AlreadyExists => "a record is never overwritten: give another name",
        _ => "check that its folder may be written and has room",
    };
    Failure::new(path.display().to_string(), error.to_string(), hint)
}

fn drive(
    source: &mut dyn Source,
    engine: &mut Engine,
    tally: &mut Tally,
    recorder: &mut Option<Recorder>,
    a: &Arguments,
) -> Result<(), Failure> {
    let progress = Progress::new(source.info().frames);
    while let Some(packet) = source.next_packet()? {
        match engine.on_packet(&packet) {
            Ok(done) => {
                if let Some(cause) = &done.died {
                    progress.warn(cause);
                }
                if let (Some(recorder), Some(path)) = (recorder.as_mut(), &a.record) {
                    recorder.observe(&record_input(&done)).map_err(|e| way_failed(path, &e))?;
                }
                tally.frame(&packet, &done);
            }
            Err(e) => tally.unseen(&packet, &e),
        }
        progress.step(tally.frames);
    }
    Ok(())
}

fn warn_of_skipped(skipped: &[String]) {
    const SHOWN: usize = 5;
    for line in skipped.iter().take(SHOWN) {
        eprintln!("warning: skipped: {line}");
    }
    if skipped.len() > SHOWN {
        eprintln!("warning: skipped: and {} more, all in the report", skipped.len() - SHOWN);
    }
}

fn write_reports(a: &Arguments, engine: &Engine, report: &RunReport, tally: &Tally) -> Result<(), Failure> {
    if let Some(path) = &a.report {
        report.save(path)?;
    }
    if let Some(path) = &a.report_html {
        write_whole(path, &page::of(report, tally, &engine.trajectory()))?;
    }
    Ok(())
}

fn write_trajectories(a: &Arguments, rig: &Rig, engine: &Engine) -> Result<(), Failure> {
    let of_frame = |poses: Vec<(Stamp, Se3)>| {
        let body_from = match a.frame {
            Whose::Body => Se3::identity(),
            Whose::Cam0 => rig.cameras.first().map_or_else(Se3::identity, |c| c.body_from_camera),
        };
        let moved =
            poses.into_iter().map(|(t, world_from_body)| (t.0, world_from_body * body_from)).collect();
        // The engine gives each frame once and in order.
        Trajectory::from_unsorted(moved)
            .map_err(|e| Failure::new("trajectory", e.to_string(), "report it with the recording"))
    };
    if let Some(path) = &a.trajectory {
        write_whole(path, &to_tum(&of_frame(engine.trajectory())?))?;
    }
    if let Some(path) = &a.live_trajectory {
        write_whole(path, &to_tum(&of_frame(engine.live_trajectory())?))?;
    }
    Ok(())
}
