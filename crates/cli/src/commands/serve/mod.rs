//! `cairn serve`: the web page for a phone or another screen.

#[cfg(unix)]
mod isolated;

use super::given::{read_config, rig_of};
use super::run::sensors;
use crate::failure::Failure;
use crate::interrupt;
use crate::output::{Output, note};
use crate::processes;
use crate::speaking::Speaking;
use crate::terminal::Terminal;
use cairn_engine::Sensors;
use cairn_guide::Facing;
use cairn_sensor::{Rig, Source};
use cairn_session::{Command, FileConfig, LibraryError, SessionConfig};
use cairn_sources::{OpenOptions, Paced, Validator, is_live, open, waiting_for};
use cairn_voice::{Espeak, EspeakVoice, SpeechConfig, Voice};
use cairn_web::{
    Aloud, CameraSource, MOST_CONNECTIONS, ServeConfig, Server, StartSlam, WebError, engine_here, qr,
};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Serves an accessible web page over HTTPS: use a phone's camera for guidance, or watch from another screen.
///
/// Without SOURCE the images come from the browser's camera: open the address on the phone (scan the QR code shown with
/// --lan) and start the camera there. With SOURCE its images are used, played in real time, and the page gives the
/// commands. Every recorded route is kept with its map, and can be named, loaded and walked another day. On a terminal
/// keys give commands too; they are listed below.
#[derive(clap::Args)]
#[command(after_long_help = crate::speaking::keys())]
pub struct Arguments {
    /// A recording, sim:WORLD or video, as for cairn run, used instead of the browser's camera.
    source: Option<String>,
    /// Accepts connections from the local network (needed for a phone); otherwise only from this machine.
    #[arg(long)]
    lan: bool,
    /// Signs the page's certificate by an authority of this machine, kept in the data folder, and says how a phone comes to
    /// trust it. An iPhone refuses web sockets without; the page then goes on with plain requests.
    #[arg(long)]
    ca: bool,
    /// Makes another key for the page's address: bookmarks and phones of before have to be paired again.
    #[arg(long)]
    new_key: bool,
    /// The port to listen on.
    #[arg(long, default_value_t = 8443)]
    port: u16,
    /// A calibration file, or the name of a built-in rig; "list" shows their names.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Which sensors of SOURCE to use; by default all it has.
    #[arg(long, value_parser = sensors(), value_name = "WHICH")]
    sensor: Option<Sensors>,
    /// Configuration entries that differ from the defaults; see cairn config.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Reads commands from standard input, one per line (for screen readers), instead of single keys.
    #[arg(long)]
    lines: bool,
    /// The folder in which the certificate, maps and routes are kept for another day; by default the user's data folder.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Keeps maps and routes in this folder instead of the data folder's "routes".
    #[arg(long, alias = "ways", value_name = "DIR")]
    routes: Option<PathBuf>,
    /// Makes surfaces of the depth of key frames, and shows them on the page as they grow; needs a SOURCE with depth.
    #[arg(long, requires = "source")]
    dense: bool,
    #[command(flatten)]
    speaking: Speaking,
    /// Runs the page with its walk and SLAM as processes under a supervisor: one that dies or hangs is started again, the
    /// guide says stop meanwhile, and the walk goes on in the map of a moment ago. Needs /dev/shm.
    #[arg(long)]
    isolated: bool,
    /// Memory that each process may use, MB; one that needs more dies and is started again.
    #[arg(long, default_value_t = 8000, value_name = "MB", requires = "isolated")]
    #[arg(value_parser = clap::value_parser!(u64).range(50..=1_000_000))]
    worker_memory: u64,
    /// What this process does for its supervisor.
    #[arg(long, hide = true, requires = "run_folder", overrides_with = "worker")]
    worker: Option<String>,
    /// The folder that the processes share.
    #[arg(long, hide = true)]
    run_folder: Option<PathBuf>,
}

/// Serves until the source ends or the program is stopped.
///
/// # Errors
/// When the configuration, the rig or the source cannot be used, or the server cannot start.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    if a.isolated
        && a.worker.is_none()
        && let Some(parent) = processes::shared_memory()
    {
        return supervise(parent);
    }
    let FileConfig { engine: mut config, route: settings } =
        a.config.as_deref().map_or_else(|| Ok(FileConfig::default()), read_config)?;
    if a.worker.is_some() {
        begin_work(a);
    }
    #[cfg(unix)]
    if a.worker.as_deref() == Some("slam") {
        isolated::work(&config);
        return Ok(());
    }
    #[cfg(unix)]
    if a.worker.as_deref() == Some("dense") {
        isolated::surfaces();
        return Ok(());
    }
    let source = a.source.as_deref().unwrap_or_default();
    let rig = a.rig.as_deref().map(|path| rig_of(path, source, &mut config)).transpose()?;
    let data = a.data.clone().or_else(data_folder);
    let beside = data.as_ref().map_or_else(|| PathBuf::from("routes"), |data| data.join("routes"));
    let routes = a.routes.clone().unwrap_or(beside);
    crate::outputs::folder_later(&routes)?;
    let session = SessionConfig {
        folder: routes.clone(),
        facing: Facing::Home,
        phrases: a.speaking.phrases(),
        announcer: a.speaking.announcer(),
        route: settings,
        ..SessionConfig::default()
    };
    let camera = match &a.source {
        None => CameraSource::Page { rig: rig.map(Box::new) },
        Some(source) => camera_of(source, rig, a.sensor),
    };
    let (slam, token, port) = begun(a);
    let is_first = token.is_none();
    let config = ServeConfig {
        slam,
        token,
        survives: a.run_folder.as_ref().map(|folder| folder.join("walk.json")),
        lan: a.lan,
        port,
        keep: data,
        new_key: a.new_key,
        authority: a.ca,
        routes: Some(routes.clone()),
        camera,
        dense: a.dense,
        connections: connections(),
        tell: Arc::new(note),
        aloud: aloud(a.speaking.announcer().rate),
        config,
        session,
    };
    let server = Server::start(config).map_err(|e| {
        let cure = match &e {
            WebError::Port { .. } => "give another --port, or stop the program that uses it",
            WebError::Routes(LibraryError::Busy(_)) => {
                "stop the other program, or give another folder with --data"
            }
            WebError::Routes(_) => "give another folder with --data",
            WebError::Machine(_) => "try again",
        };
        Failure::new("the page", e.to_string(), cure)
    })?;
    if let Some(why) = server.not_kept() {
        eprintln!(
            "certificate or key could not be saved, the browser will ask again at the next start: {why}"
        );
    }
    #[cfg(unix)]
    if let Some(folder) = &a.run_folder {
        isolated::tie(folder, &server)?;
    }
    if is_first {
        invite(a, &server, &routes, output)?;
    }
    // A signal ends the walk as the command does: what was recorded is complete.
    let remote = server.remote();
    interrupt::in_order();
    interrupt::at_request(move || remote.command(Command::Quit));
    let remote = server.remote();
    // Dropping it restores the terminal.
    let mut terminal = Terminal::new(a.lines, true, a.speaking.language);
    terminal.forward(move |command| remote.command(command));
    Ok(server.wait()?)
}

/// Speaks by the machine's own voice, where it has one; what is said is shown as well.
fn aloud(rate: f64) -> Aloud {
    let voice = Espeak::find(SpeechConfig { rate, ..SpeechConfig::default() }).ok().map(EspeakVoice::new);
    let voice = Mutex::new(voice);
    Arc::new(move |language, text| {
        if let Some(voice) = voice.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            voice.set_language(language);
            voice.say(text, 0.0, true);
        }
    })
}

/// Descriptors that are kept for the walk itself: its source, maps, routes and processes had 20 open at most (a simulated flat
/// with --isolated --dense; 14 with a EuRoC recording).
const KEPT_FILES: u64 = 96;

/// How many connections may be open, so that the walk never lacks a descriptor.
fn connections() -> usize {
    #[cfg(unix)]
    let files = cairn_workers::raise_open_files();
    #[cfg(not(unix))]
    let files = u64::MAX;
    (files.saturating_sub(KEPT_FILES) as usize).clamp(8, MOST_CONNECTIONS)
}

/// Says how the page is reached.
fn invite(a: &Arguments, server: &Server, routes: &Path, output: &Output) -> Result<(), Failure> {
    let invitation = server.invitation();
    let mut shown =
        serde_json::json!({ "urls": invitation.urls, "token": invitation.token, "routes": routes });
    if let Some(authority) = server.authority() {
        shown["authority"] =
            serde_json::json!({ "urls": invitation.authority_urls(), "sha256": authority.fingerprint() });
    }
    output.result(&shown, |_| {
        let mut text = if a.lan { invitation.qr() } else { String::new() };
        for url in &invitation.urls {
            text += &format!("{url}\n");
        }
        if a.lan {
            text += "Without the code: open the address up to its # on the phone, and type the six digits that are said here then.\n";
        }
        text += &format!("Maps and routes are kept in {}.\n", routes.display());
        text += &match server.authority() {
            Some(authority) => {
                let shown = if a.lan { qr(&invitation.authority_urls()[0]) } else { String::new() };
                shown + &invitation.trust_steps(authority, a.speaking.language)
            }
            None => "The certificate is self-signed: the browser asks once whether to trust it; --ca makes one that phones can trust.\n".into(),
        };
        text + if a.lan { "" } else { "Only this machine can connect; use --lan to connect from a phone.\n" }
    })
}

/// In processes under a supervisor.
#[cfg(unix)]
fn supervise(parent: &Path) -> Result<(), Failure> {
    match isolated::supervise(parent)? {
        0 => Ok(()),
        _ if interrupt::requested() => Ok(()),
        // What is wrong was said by the process that ended.
        code => std::process::exit(code),
    }
}

/// There is no shared memory.
#[cfg(not(unix))]
fn supervise(_: &Path) -> Result<(), Failure> {
    Err(Failure::usage("--isolated", "it needs Unix", "leave it out"))
}

/// Bounds the memory of this process and ties its life to that of its supervisor.
fn begin_work(a: &Arguments) {
    #[cfg(unix)]
    {
        cairn_workers::die_with_parent();
        if let Err(e) = cairn_workers::limit_memory(a.worker_memory * 1_000_000) {
            crate::output::warn(&format!("the memory of a process is not limited: {e}"));
        }
    }
    #[cfg(not(unix))]
    let _ = a;
}

/// Where SLAM runs, and the token and the port of a process of this walk before.
fn begun(a: &Arguments) -> (StartSlam, Option<String>, u16) {
    #[cfg(unix)]
    if let Some(folder) = &a.run_folder {
        let before = isolated::before(folder);
        let port = before.as_ref().map_or(a.port, |s| s.port);
        return (isolated::slam_elsewhere(folder.clone()), before.map(|s| s.token), port);
    }
    (engine_here(), None, a.port)
}

/// The user's data folder; `None` where the system defines none.
pub fn data_folder() -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let base = match cfg!(windows) {
        true => named("LOCALAPPDATA"),
        // The XDG base directory specification, by which relative paths are ignored.
        false => (named("XDG_DATA_HOME").filter(|p| p.is_absolute()))
            .or_else(|| named("HOME").map(|home| home.join(".local/share"))),
    };
    base.map(|base| base.join("cairn"))
}

fn camera_of(source: &str, rig: Option<Rig>, sensor: Option<Sensors>) -> CameraSource {
    let name = source.to_owned();
    let rig = match sensor.filter(|_| is_live(source)) {
        Some(sensor) => rig.map(|rig| sensor.live_rig(rig)),
        None => rig,
    };
    if let Some(message) = waiting_for(source) {
        eprintln!("{message}");
    }
    let address = name.clone();
    let open = move || {
        let (cancel, told) = (interrupt::cancel(), Some(note as fn(&str)));
        let source = open(&address, OpenOptions { rig, cancel, told, ..OpenOptions::default() })?;
        let sensor = sensor.unwrap_or_else(|| Sensors::of(source.rig()));
        let (mode, has_imu) = (sensor.mode(), sensor.has_imu());
        let source: Box<dyn Source> = Box::new(Validator::new(source, crate::output::warn));
        // A live source sets its own pace; a recording is played in real time.
        let source: Box<dyn Source> = if is_live(&address) {
            source
        } else {
            Box::new(Paced::new(source).cancelled_by(interrupt::cancel()))
        };
        Ok((source, mode, has_imu))
    };
    CameraSource::Source { name, open: Box::new(open) }
}
