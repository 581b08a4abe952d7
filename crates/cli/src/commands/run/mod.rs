//! `cairn run`: SLAM on any source; writes trajectories, maps, routes, and a report as JSON and HTML.

mod arguments;
mod events;
mod history;
mod isolated;
mod journal;
mod map;
mod mcap;
mod observer;
mod outcome;
mod page;
mod picture;
mod problems;
mod rerun;
mod results;
mod route;
mod say;
mod sensor;
mod status;
mod surface;
mod tally;

use super::given::{read_config, rig_of};
use super::team::join::Sharing;
use crate::failure::Failure;
use crate::interrupt;
use crate::map_lock::MapLock;
use crate::output::{Output, note, warn};
use crate::outputs::Outputs;
use crate::terminal::Terminal;
pub use arguments::{Arguments, FrontEnd, Kind};
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Journal, Runner, SensorMode, Sensors, Status, with_found_lens};
use cairn_files::MIB;
use cairn_guide::{AnnouncerConfig, RouteConfig};
use cairn_rerun::viewer;
use cairn_sensor::{Rig, Skips, Source, Stamp};
use cairn_session::{
    Age, Command, FileConfig, Inbox, Item, RouteChoice, Script, Session, SessionConfig, drive_live,
    drive_lockstep, feed,
};
use cairn_sources::{OpenOptions, Paced, Picked, Validator, is_live, open, waiting_for};
use cairn_vision::bow::Vocabulary;
use cairn_voice::SpeechConfig;
use events::Events;
use observer::RunObserver;
use outcome::Outcome;
use say::Say;
pub use sensor::sensors;
use status::StatusLines;
use std::path::Path;
use std::time::{Duration, Instant};
use tally::Tally;
use tracing::debug;

/// Runs the engine over the source, then writes the requested results. `began` is when the process started.
///
/// # Errors
/// When an input cannot be used, the run fails or gives no pose, or a result cannot be written. Once a frame has been
/// processed, every result is written all the same.
pub fn run(a: &Arguments, output: &Output, began: Instant) -> Result<(), Failure> {
    if a.isolated.worker.is_some() {
        return isolated::work(a);
    }
    let outputs = results::checked(a)?;
    if a.isolated.isolated
        && let Some(parent) = isolated::shared_memory(a)?
    {
        return isolated::supervise(a, &outputs, output, began, parent);
    }
    let _lock = outputs.file("--map-out").map(MapLock::take).transpose()?;
    if let Some(path) = &a.vocabulary {
        vocabulary(path)?;
    }
    a.guide.as_deref().map(route::check).transpose()?;
    let FileConfig { engine: mut config, route: settings } =
        a.config.as_deref().map_or_else(|| Ok(FileConfig::default()), read_config)?;
    config.robot = a.robot.unwrap_or(config.robot);
    let mut script = a.script.as_deref().map_or_else(|| Ok(Script::default()), read_script)?;
    let live = is_live(&a.source);
    let say = a.say.clone().unwrap_or(match live || a.guide.is_some() || a.script.is_some() || a.lines {
        true => Say::Text,
        false => Say::None,
    });
    let speech = speech_of(a);
    say.check(speech)?;
    if live && (a.journal.is_some() || a.replay.is_some()) {
        return Err(Failure::new(
            &a.source,
            "a live source cannot be replayed",
            "record it first and run the recording",
        ));
    }
    let replayed = journal::opened(a)?;
    let mut map_in = map::opened(a)?;
    let (source, sensor) = open_source(a, &mut config, map_in.as_ref())?;
    // A camera that nobody calibrated: its focal length is looked for, and its rows may be exposed one after the other.
    let is_guessed = source.info().assumed.is_some() && sensor == Sensors::MonoImu;
    let source = match is_guessed && !live && map_in.is_none() {
        true => with_found_lens(source, &config)?,
        false => source,
    };
    let source: Box<dyn Source> = Box::new(Validator::new(source, warn));
    let rig = source.rig().clone();
    let info = source.info();
    debug!(source = %info.name, frames = ?info.frames, rate_hz = info.rate_hz, sensor = sensor.name(), "opened");
    config.inertial.enabled = sensor.has_imu();
    config.tracker.estimate_readout |= is_guessed && config.tracker.readout_s == 0.0;
    config.tracker.clocks_by_flow |= is_guessed;
    if sensor.has_imu() && rig.imu.is_none() {
        let why = format!("--sensor {} needs an IMU, but the rig has none", sensor.name());
        return Err(Failure::new(&a.source, why, "give a rig with an IMU using --rig, or leave out -imu"));
    }
    if let Some(which) = a.front_end {
        config.tracker.dense = which == FrontEnd::Dense;
    }
    if config.tracker.dense && sensor.mode() != SensorMode::Rgbd {
        let why = format!("the dense front end needs a depth sensor, not --sensor {}", sensor.name());
        return Err(Failure::new(&a.source, why, "use --sensor rgbd, or leave out --front-end dense"));
    }
    let mut status = a.status.then(StatusLines::default);
    if let Some(lines) = &mut status {
        lines.update(&Status::default(), Age::default());
    }
    let runner = if a.realtime || live { Runner::Threaded } else { Runner::Lockstep };
    let rate_hz = source.info().rate_hz;
    let engine = map::engine(a, map_in.as_ref(), &rig, sensor.mode(), rate_hz, runner, &config)?;
    let stamps = replayed.as_ref().map(Journal::stamps);
    let mut engine = journal::engine(a, &outputs, engine, &source.info().name, replayed)?;
    let mut events = Events::begin(outputs.file("--events"), &mut engine)?;
    let mut mcap = mcap::Recording::begin(outputs.file("--mcap"))?;
    let show_in = a.rerun.as_deref().filter(|to| viewer(to).is_some()).or(outputs.file("--rerun"));
    let mut rerun = rerun::Scene::begin(show_in, &rig, &source.info().name)?;
    let mut dense = surface::begin(a, &mut engine, &rig, map_in.as_mut())?;
    let voice = say.voice(speech, outputs.file("--say wav:"), output.is_json())?;
    let mut session = Session::new(engine, session_config(a, &outputs, live, settings));
    surface::watch_way(a, &mut session, &rig, sensor.mode())?;
    if let Some(lines) = &mut status {
        lines.update(&session.engine_status(), session.age());
    }
    begin(&mut session, a, &outputs, map_in.as_ref())?;
    let sharing = sharing(a, &outputs)?;
    if interrupt::requested() {
        return Err(Failure::new("the run", "interrupted before its first frame", "start it again"));
    }
    interrupt::in_order();
    // An adjustment of the whole map is not waited for.
    interrupt::sets(session.engine().stop_flag());
    let mut tally = Tally::new(began);
    let truth = source.info().truth.clone();
    let name = source.info().name.clone();
    let terminal = Terminal::new(a.lines, a.realtime || live, a.speaking.language);
    let saver = map::Saver::new(a, outputs.file("--map-out"), map_in);
    let mut observer =
        RunObserver::new(&mut tally, source.info().frames, voice, terminal, saver, &mut events, status)
            .with_mcap(mcap.as_mut())
            .with_rerun(rerun.as_mut())
            .with_dense(dense.as_mut());
    let (driven, skips, skipped) = if live {
        let inbox = Inbox::new();
        feed(source, inbox.clone())
            .map_err(|e| Failure::new(&a.source, e.to_string(), "close other programs and try again"))?;
        let driven = drive_live(&mut session, &inbox, &mut script, &mut observer);
        inbox.close();
        observer.tally.dropped = inbox.dropped();
        // A stream's child process ends with it; without one that listens, its port would stay taken.
        let ended = Instant::now();
        while interrupt::requested() && ended.elapsed() < Duration::from_millis(300) {
            if matches!(inbox.take(Duration::from_millis(20)), Item::Ended(_)) {
                break;
            }
        }
        (driven, Skips::default(), Vec::new())
    } else if a.realtime {
        let mut paced = Paced::new(source).cancelled_by(interrupt::cancel());
        let driven = drive_lockstep(&mut session, &mut paced, &mut script, &mut observer);
        observer.tally.dropped = paced.dropped();
        (driven, paced.skips(), paced.skipped().to_vec())
    } else if let Some(stamps) = stamps {
        let mut picked = Picked::new(source, stamps);
        let driven = drive_lockstep(&mut session, &mut picked, &mut script, &mut observer);
        observer.tally.dropped = picked.passed();
        (driven, picked.skips(), picked.skipped().to_vec())
    } else {
        let mut source = source;
        let driven = drive_lockstep(&mut session, &mut *source, &mut script, &mut observer);
        (driven, source.skips(), source.skipped().to_vec())
    };
    let aloud = matches!(say, Say::Speech);
    let (saver, voice_ended) = observer.end(aloud);
    let finished = session.engine_mut().finish();
    let last = session.engine().log().frames().last().map_or(Stamp::default(), |f| f.stamp);
    tally.after(&finished, last);
    tally.history.size(last, &session.engine().snapshot());
    let events = events.map_or(Ok(()), |mut events| {
        events.write(last, finished.verdicts());
        events.end()
    });
    let mcap = mcap.map_or(Ok(()), |mcap| mcap.end(session.engine()));
    let rerun = rerun.map_or(Ok(()), |rerun| rerun.end(&session, dense.as_ref()));
    let journal_ended = journal::end(a, session.engine());
    warn_of_skipped(&skipped);
    let closed = session
        .close()
        .map_err(|why| Failure::new("recording", why.to_string(), "free some space on the disk"));
    let saved = saver.end(&session, dense.as_mut());
    let shared = sharing.map_or(Ok(()), Sharing::end);
    // Nothing above or below keeps the rest from being written; all failures are reported together.
    let driven = driven.map(drop).map_err(Failure::from);
    let mut failures: Vec<Failure> =
        [driven, voice_ended, closed, saved, shared, events, mcap, rerun, journal_ended]
            .into_iter()
            .filter_map(Result::err)
            .collect();
    let engine = session.engine();
    let interrupted = interrupt::requested();
    let mut report = tally.report(engine, &FileConfig { engine: config, route: settings }, &skips);
    (report.source, report.sensor) = (name, sensor.name().to_owned());
    // No figure without ground truth, or where it has no time in common with the run.
    report.accuracy = cairn::accuracy(engine, &truth).ok();
    report.live = tally::live(&truth, engine);
    report.scale = tally::scale(&truth, engine);
    let problems = problems::of(&report);
    let searches = dense.as_ref().map(|d| d.search_counts()).filter(|counts| counts.attempts > 0);
    let ended = Outcome { report: &report, interrupted, problems, searches };
    if failures.is_empty() || report.frames > 0 {
        failures.extend(results::write_reports(&outputs, engine, &ended, &tally));
    }
    if report.tracked > 0 {
        let surface = surface::write(dense.as_mut(), &outputs, a, engine);
        failures.extend(surface.err());
        failures.extend(results::write_trajectories(&outputs, a.frame, &rig, engine));
    } else if interrupted {
        warn("interrupted before the first pose: there is no trajectory to write");
    } else if failures.is_empty() {
        let why = tally.last_state.clone().unwrap_or_else(|| "it has no frames".into());
        failures.push(Failure::new(&a.source, format!("no frame got a pose: {why}"), NO_POSE));
    }
    // A live camera may well show nothing for long; a recording that is lost cannot be relied on. A try of a few frames ends
    // before one camera has seen enough to begin.
    let enough = report.frames >= 100 && !live && !interrupted;
    if failures.is_empty() && enough && 2 * report.tracked < report.frames {
        output.text(&tally::text(&ended, a.realtime))?;
        let why = format!("only {} of {} frames got a pose", report.tracked, report.frames);
        failures.push(Failure::new(&a.source, why, NO_POSE));
    }
    Failure::all(failures)?;
    output.result(&ended, |ended| tally::text(ended, a.realtime || live))
}

/// Begins to share the map with the team, where --team asks for it.
fn sharing(a: &Arguments, outputs: &Outputs) -> Result<Option<Sharing>, Failure> {
    let Some(team) = &a.team else {
        let given = !a.reach.peer.is_empty()
            || a.reach.listen.is_some()
            || a.reach.secret.is_some()
            || a.reach.send_limit.is_some();
        let options = "--peer, --listen, --secret and --send-limit";
        return match given {
            true => Err(Failure::usage(options, "need --team", "add --team NAME")),
            false => Ok(None),
        };
    };
    match (a.robot, outputs.file("--map-out"), outputs.file("--team-map")) {
        (Some(robot), Some(map), Some(out)) => Sharing::begin(robot, team, &a.reach, map, out).map(Some),
        _ => Err(Failure::usage("--team", "needs --robot, --map-out and --team-map", "add them")),
    }
}

fn session_config(a: &Arguments, outputs: &Outputs, live: bool, route: RouteConfig) -> SessionConfig {
    SessionConfig {
        folder: a.routes.clone(),
        record_to: outputs.file("--record").map(Path::to_owned),
        source: a.source.clone(),
        // With --record, --guide or --script the user decides what is recorded.
        auto_record: (live && a.record.is_none() && a.guide.is_none() && a.script.is_none())
            .then_some(AUTO_RECORD),
        facing: a.facing.facing(),
        map_is_loaded: a.map_in.is_some(),
        phrases: a.speaking.phrases(),
        announcer: announcer_of(a),
        route,
    }
}

fn announcer_of(a: &Arguments) -> AnnouncerConfig {
    let announcer = a.speaking.announcer();
    AnnouncerConfig { rate: a.rate.unwrap_or(announcer.rate), volume: a.volume, ..announcer }
}

fn speech_of(a: &Arguments) -> SpeechConfig {
    SpeechConfig { language: a.speaking.language, rate: announcer_of(a).rate, volume: a.volume }
}

/// A live run is recorded automatically after this many tracked frames.
const AUTO_RECORD: usize = 100;

/// Starts recording and guidance as the arguments ask, before the first frame.
fn begin(
    session: &mut Session,
    a: &Arguments,
    outputs: &Outputs,
    map: Option<&MapFile>,
) -> Result<(), Failure> {
    if let (Some(path), Some(map)) = (outputs.file("--record").filter(|path| path.exists()), map) {
        session.resume_recording(route::resume(path, map, session.config().route.recorder)?, path);
    } else if a.record.is_some() {
        let started = session.command(&Command::Record);
        started.map_err(|why| Failure::new("recording", why.words, "give another --record"))?;
        // The announcement "Recording" is discarded: the user asked for it on the command line.
        session.events();
    }
    let Some(path) = &a.guide else { return Ok(()) };
    let commands = [
        Command::Load(RouteChoice::File(path.clone())),
        Command::Guide { facing: Some(a.facing.facing()), again: !a.back },
    ];
    for command in &commands {
        session.command(command).map_err(|why| {
            let hint =
                "load its map with --map-in, or use --script to guide along a route recorded in this run";
            Failure::new(path.display().to_string(), why.words, hint)
        })?;
    }
    Ok(())
}

fn read_script(path: &Path) -> Result<Script, Failure> {
    let shown = path.display().to_string();
    let text = cairn_files::read_text(path, 16 * MIB)
        .map_err(|e| Failure::new(&shown, e.to_string(), "check the path"))?;
    Script::parse(&text)
        .map_err(|e| Failure::new(format!("{shown}, line {}", e.line), e.why, "see cairn run --help"))
}

const NO_POSE: &str = "check the calibration (cairn rig check), use a longer part of the recording, or show the camera more texture";

/// Opens the source and chooses its sensors: those of --sensor, those the map was made with if it has them, or all it has.
fn open_source(
    a: &Arguments,
    config: &mut Config,
    map: Option<&MapFile>,
) -> Result<(Box<dyn Source>, Sensors), Failure> {
    open_part(a, (a.start, a.frames), config, map)
}

/// The same from another second on, and another number of frames.
fn open_part(
    a: &Arguments,
    (start_s, frames): (f64, Option<usize>),
    config: &mut Config,
    map: Option<&MapFile>,
) -> Result<(Box<dyn Source>, Sensors), Failure> {
    let options = |rig: Option<Rig>| OpenOptions {
        rig,
        kind: a.kind.map(Kind::kind),
        start_s,
        frames,
        topics: a.topics.clone(),
        number_frames_hz: a.number_frames,
        cancel: interrupt::cancel(),
    };
    let given = a.rig.as_deref().map(|path| rig_of(path, &a.source, config)).transpose()?;
    let of_live = a.sensor.filter(|_| is_live(&a.source));
    let given = match of_live {
        Some(sensor) => given.map(|rig| sensor.live_rig(rig)),
        None => given,
    };
    if let Some(message) = waiting_for(&a.source) {
        note(&message);
    }
    let source = open(&a.source, options(given))?;
    let of_map = |map: &MapFile| Sensors::with(map.about.sensor, source.rig().imu.is_some());
    let of_map = map.map(of_map).filter(|sensor| sensor.is_in(source.rig()));
    let sensor = a.sensor.or(of_map).unwrap_or_else(|| Sensors::of(source.rig()));
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

/// Makes the words of this vocabulary those of the run.
fn vocabulary(path: &Path) -> Result<(), Failure> {
    let fail = |why: String| {
        Failure::new(
            path.display().to_string(),
            why,
            "give a file of cairn vocab train or cairn vocab import",
        )
    };
    let bytes = cairn_files::read(path, 1024 * MIB).map_err(|e| fail(e.to_string()))?;
    let vocabulary = Vocabulary::open(bytes).map_err(|e| fail(e.to_string()))?;
    Vocabulary::install(vocabulary).map_err(|_| fail("another vocabulary is in use".into()))
}

fn warn_of_skipped(skipped: &[String]) {
    const SHOWN: usize = 5;
    for line in skipped.iter().take(SHOWN) {
        warn(&format!("skipped: {line}"));
    }
    if skipped.len() > SHOWN {
        warn(&format!("skipped: and {} more", skipped.len() - SHOWN));
    }
}
