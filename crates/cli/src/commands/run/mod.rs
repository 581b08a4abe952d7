//! `cairn run`: SLAM on any source; writes trajectories, maps, routes, and a report as JSON and HTML.

mod arguments;
mod events;
mod face;
mod interrupt;
mod journal;
mod map;
mod page;
mod route;
mod sensor;
mod status;
mod tally;

use super::serve::rig_of;
use crate::failure::Failure;
use crate::output::Output;
use crate::terminal::Terminal;
pub use arguments::Arguments;
use arguments::Whose;
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Engine, Journal, PoseTime, Runner, Status};
use cairn_eval::{RunReport, to_tum, write_whole};
use cairn_geometry::{Se3, Trajectory};
use cairn_guide::{AnnouncerConfig, PhraseConfig};
use cairn_sensor::{Rig, Source, Stamp};
use cairn_session::{Command, Inbox, Script, Session, SessionConfig, drive_live, drive_lockstep, feed};
use cairn_sources::{OpenOptions, Paced, Picked, Validator, is_live, open, waiting_for};
use cairn_voice::SpeechConfig;
use events::Events;
use face::{RunFace, Say};
pub use sensor::Sensor;
use status::StatusLines;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tally::Tally;

/// Runs the engine over the source, then writes the requested results. `began` is when the process started.
///
/// # Errors
/// When an input cannot be used, the run fails or gives no pose, or a result cannot be written.
pub fn run(a: &Arguments, output: &Output, began: Instant) -> Result<(), Failure> {
    check_targets(a)?;
    let mut config = a.config.as_deref().map_or_else(|| Ok(Config::default()), read_config)?;
    let mut script = a.script.as_deref().map_or_else(|| Ok(Script::default()), read_script)?;
    let live = is_live(&a.source);
    let say = a.say.clone().unwrap_or(match live || a.guide.is_some() || a.script.is_some() || a.lines {
        true => Say::Text,
        false => Say::None,
    });
    let voice = say.voice(SpeechConfig { rate: a.rate, volume: a.volume }, output.is_json())?;
    if live && (a.journal.is_some() || a.replay.is_some()) {
        return Err(Failure::new(
            &a.source,
            "a live source cannot be replayed",
            "record it first and run the recording",
        ));
    }
    let replayed = journal::opened(a)?;
    let map_in = map::opened(a)?;
    let (source, sensor) = open_source(a, &mut config, map_in.as_ref())?;
    let source: Box<dyn Source> = Box::new(Validator::new(source, |doubt| eprintln!("warning: {doubt}")));
    let rig = source.rig().clone();
    config.inertial.enabled = sensor.has_imu();
    if sensor.has_imu() && rig.imu.is_none() {
        let why = format!("--sensor {} needs an IMU, but the rig has none", sensor.name());
        return Err(Failure::new(&a.source, why, "give a rig with an IMU using --rig, or leave out -imu"));
    }
    let mut status = a.status.then(StatusLines::default);
    if let Some(lines) = &mut status {
        lines.update(&Status::default());
    }
    let runner = if a.realtime || live { Runner::Threaded } else { Runner::Lockstep };
    let rate_hz = source.info().rate_hz;
    let engine = map::engine(a, map_in.as_ref(), &rig, sensor.mode(), rate_hz, runner, &config)?;
    let stamps = replayed.as_ref().map(Journal::stamps);
    let mut engine = journal::engine(a, engine, &source.info().name, replayed)?;
    let mut events = Events::begin(a.events.as_deref(), &mut engine)?;
    let mut session = Session::new(engine, session_config(a, live));
    if let Some(lines) = &mut status {
        lines.update(&session.standing());
    }
    begin(&mut session, a, map_in.as_ref())?;
    let mut tally = Tally::new(began);
    let truth = source.info().truth.clone();
    let name = source.info().name.clone();
    let terminal = Terminal::new(a.lines, a.realtime || live);
    let saver = map::Saver::new(a, map_in);
    let mut face =
        RunFace::new(&mut tally, source.info().frames, voice, terminal, saver, &mut events, status);
    let (driven, skipped) = if live {
        let inbox = Inbox::new();
        feed(source, inbox.clone())
            .map_err(|e| Failure::new(&a.source, e.to_string(), "close other programs and try again"))?;
        let driven = drive_live(&mut session, &inbox, &mut script, &mut face);
        inbox.close();
        face.tally.dropped = inbox.dropped();
        (driven, Vec::new())
    } else if a.realtime {
        let mut paced = Paced::new(source);
        let driven = drive_lockstep(&mut session, &mut paced, &mut script, &mut face);
        face.tally.dropped = paced.dropped();
        (driven, paced.skipped().to_vec())
    } else if let Some(stamps) = stamps {
        let mut picked = Picked::new(source, stamps);
        let driven = drive_lockstep(&mut session, &mut picked, &mut script, &mut face);
        face.tally.dropped = picked.passed();
        (driven, picked.skipped().to_vec())
    } else {
        let mut source = source;
        let driven = drive_lockstep(&mut session, &mut *source, &mut script, &mut face);
        (driven, source.skipped().to_vec())
    };
    let (saver, voice_ended) = face.end();
    let finished = session.engine_mut().finish();
    tally.after(&finished);
    let events = events.map_or(Ok(()), |mut events| {
        let last = session.engine().log().frames().last().map_or(Stamp::default(), |f| f.stamp);
        events.write(last, &finished.verdicts);
        events.end()
    });
    let journal_ended = journal::end(a, session.engine());
    warn_of_skipped(&skipped);
    let closed = session.close().map_err(|why| Failure::new("recording", why, "free some space on the disk"));
    // The map is saved however the run ended; the first failure is reported.
    let saved = saver.end(&session);
    driven?;
    voice_ended.and(closed).and(saved).and(events).and(journal_ended)?;
    let engine = session.engine();
    let mut report = tally.report(engine, &config, &skipped);
    (report.source, report.sensor) = (name, sensor.name().to_owned());
    // No figure without ground truth, or where it has no time in common with the run.
    report.accuracy = cairn::accuracy(engine, &truth).ok();
    report.live = tally::live(&truth, engine);
    report.scale = tally::scale(&truth, engine);
    write_reports(a, engine, &report, &tally)?;
    if report.tracked == 0 {
        let why = tally.last_state.clone().unwrap_or_else(|| "it has no frames".into());
        return Err(Failure::new(&a.source, format!("no frame got a pose: {why}"), NO_POSE));
    }
    write_trajectories(a, &rig, engine)?;
    output.result(&report, |r| tally::text(r, a.realtime || live))
}

fn session_config(a: &Arguments, live: bool) -> SessionConfig {
    SessionConfig {
        folder: a.routes.clone(),
        record_to: a.record.clone(),
        source: a.source.clone(),
        // With --record, --guide or --script the user decides what is recorded.
        auto_record: (live && a.record.is_none() && a.guide.is_none() && a.script.is_none())
            .then_some(AUTO_RECORD),
        facing: a.facing.facing(),
        map_is_loaded: a.map_in.is_some(),
        phrases: PhraseConfig { unit: a.unit.unit(), directions: a.directions.style(), metric: true },
        announcer: AnnouncerConfig { rate: a.rate, volume: a.volume, ..AnnouncerConfig::default() },
    }
}

/// A live run is recorded automatically after this many tracked frames.
const AUTO_RECORD: usize = 100;

/// Starts recording and guidance as the arguments ask, before the first frame.
fn begin(session: &mut Session, a: &Arguments, map: Option<&MapFile>) -> Result<(), Failure> {
    if let (Some(path), Some(map)) = (a.record.as_ref().filter(|path| path.exists()), map) {
        session.resume_recording(route::resume(path, map)?, path);
    } else if a.record.is_some() {
        let started = session.command(&Command::Record);
        started.map_err(|why| Failure::new("recording", why, "give another --record"))?;
        // The announcement "Recording" is discarded: the user asked for it on the command line.
        session.events();
    }
    let Some(path) = &a.guide else { return Ok(()) };
    let commands = [
        Command::Load(Some(path.clone())),
        Command::Guide { facing: Some(a.facing.facing()), again: !a.back },
    ];
    for command in &commands {
        session.command(command).map_err(|why| {
            let hint =
                "load its map with --map-in, or use --script to guide along a route recorded in this run";
            Failure::new(path.display().to_string(), why, hint)
        })?;
    }
    Ok(())
}

fn read_script(path: &Path) -> Result<Script, Failure> {
    let shown = path.display().to_string();
    let text =
        std::fs::read_to_string(path).map_err(|e| Failure::new(&shown, e.to_string(), "check the path"))?;
    Script::parse(&text)
        .map_err(|e| Failure::new(format!("{shown}, line {}", e.line), e.why, "see cairn run --help"))
}

const NO_POSE: &str = "check the calibration (cairn rig check), use a longer part of the recording, or show the camera more texture";

/// Opens the source and chooses its sensors: those of --sensor, those the map was made with, or all it has.
fn open_source(
    a: &Arguments,
    config: &mut Config,
    map: Option<&MapFile>,
) -> Result<(Box<dyn Source>, Sensor), Failure> {
    let options = |rig: Option<Rig>| OpenOptions { rig, start_s: a.start, frames: a.frames };
    let given = a.rig.as_deref().map(|path| rig_of(path, config)).transpose()?;
    if let Some(message) = waiting_for(&a.source) {
        eprintln!("{message}");
    }
    let source = open(&a.source, options(given))?;
    let of_map = |map: &MapFile| Sensor::with(map.about.sensor, source.rig().imu.is_some());
    let sensor = a.sensor.or(map.map(of_map)).unwrap_or_else(|| Sensor::of(source.rig()));
    // A simulated world renders the sensors in its address, and a live source has one camera.
    let fewer = sensor.only(source.rig()).filter(|_| !a.source.starts_with("sim:") && !is_live(&a.source));
    match fewer {
        Some(rig) => {
            drop(source);
            Ok((open(&a.source, options(Some(rig)))?, sensor))
        }
        None => Ok((source, sensor)),
    }
}

/// Reads a configuration file; entries it leaves out keep their defaults.
///
/// # Errors
/// When the file cannot be read or an entry is unknown or invalid.
pub fn read_config(path: &Path) -> Result<Config, Failure> {
    let shown = path.display().to_string();
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::new(&shown, e.to_string(), "check the path, or see cairn config"))?;
    Config::from_toml(&text).map_err(|e| {
        let place = e.line.map_or_else(|| shown.clone(), |line| format!("{shown}, line {line}"));
        Failure::new(place, e.why, "run cairn config to see every entry with its meaning")
    })
}

/// Checks before the run that every result can be written.
fn check_targets(a: &Arguments) -> Result<(), Failure> {
    let targets = [
        &a.trajectory,
        &a.live_trajectory,
        &a.record,
        &a.report,
        &a.report_html,
        &a.map_out,
        &a.events,
        &a.journal,
    ];
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
    // An existing route is continued if it was recorded in the opened map.
    let continued = |route: &&PathBuf| a.map_in.is_some() && route.exists();
    let Some(route) = a.record.as_ref().filter(|route| !continued(route)) else { return Ok(()) };
    // Created and removed again, to detect a folder that is not writable.
    let created =
        File::options().write(true).create_new(true).open(route).and_then(|_| std::fs::remove_file(route));
    created.map_err(|e| {
        let hint = match e.kind() {
            std::io::ErrorKind::AlreadyExists => "a recorded route is never overwritten: give another name",
            _ => "check that its folder is writable and the disk has room",
        };
        Failure::new(route.display().to_string(), e.to_string(), hint)
    })
}

fn warn_of_skipped(skipped: &[String]) {
    const SHOWN: usize = 5;
    for line in skipped.iter().take(SHOWN) {
        eprintln!("warning: skipped: {line}");
    }
    if skipped.len() > SHOWN {
        eprintln!("warning: skipped: and {} more", skipped.len() - SHOWN);
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
    let body_from = match a.frame {
        Whose::Body => Se3::identity(),
        Whose::Cam0 => rig.cameras.first().map_or_else(Se3::identity, |c| c.body_from_camera),
    };
    let poses = |time: PoseTime| {
        let poses = engine.mounted_trajectory(&body_from, time).into_iter();
        // The engine returns each frame once and in order.
        Trajectory::from_unsorted(poses.map(|(t, pose)| (t.0, pose)).collect())
            .map_err(|e| Failure::new("trajectory", e.to_string(), "report this with the recording"))
    };
    if let Some(path) = &a.trajectory {
        write_whole(path, &to_tum(&poses(PoseTime::Corrected)?))?;
    }
    if let Some(path) = &a.live_trajectory {
        write_whole(path, &to_tum(&poses(PoseTime::Live)?))?;
    }
    Ok(())
}
