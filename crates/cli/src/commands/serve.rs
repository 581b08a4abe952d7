//! `cairn serve`: the page for phone and screen.

use super::run::{Sensor, read_config};
use crate::failure::Failure;
use crate::output::Output;
use crate::terminal::Terminal;
use cairn_engine::Config;
use cairn_guide::Facing;
use cairn_sensor::{Rig, Source};
use cairn_session::SessionConfig;
use cairn_sources::{OpenOptions, Paced, Validator, is_live, named_rig, open, read_rig, waiting_for};
use cairn_web::{CameraSource, ServeConfig, Server, WebError};
use std::path::{Path, PathBuf};

/// One accessible page over HTTPS: a phone's browser walks with it, a screen elsewhere watches.
///
/// Without SOURCE the page's own camera sees; open the address on the phone (by the QR code, with --lan) and start the
/// camera there. With SOURCE that is seen, played in real time, and the page gives the commands.
#[derive(clap::Args)]
pub struct Arguments {
    /// A recording, sim:WORLD or video, as for cairn run, instead of the page's camera.
    source: Option<String>,
    /// Lets the local network in, where the phone is; without it only this machine.
    #[arg(long)]
    lan: bool,
    /// The port.
    #[arg(long, default_value_t = 8443)]
    port: u16,
    /// A calibration, or the name of a rig (phone-854x480).
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Which sensors of SOURCE to use; without it, all that it has.
    #[arg(long, value_enum, value_name = "WHICH")]
    sensor: Option<Sensor>,
    /// Settings that differ from the default, see cairn config.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Takes commands from standard input, a line each, for screen readers; on a terminal, keys give them.
    #[arg(long)]
    lines: bool,
    /// Where recorded ways are kept.
    #[arg(long, alias = "ways", value_name = "DIR", default_value = "routes")]
    routes: PathBuf,
}

/// Serves until the source ends or the program is ended.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let mut config = a.config.as_deref().map_or_else(|| Ok(Config::default()), read_config)?;
    let rig = a.rig.as_deref().map(|path| rig_of(path, &mut config)).transpose()?;
    let session = SessionConfig {
        folder: a.routes.clone(),
        auto_record: Some(100),
        facing: Facing::Home,
        ..SessionConfig::default()
    };
    let camera = match &a.source {
        None => CameraSource::Page { rig: rig.map(Box::new) },
        Some(source) => eyes_of(source, rig, a.sensor),
    };
    let config = ServeConfig { lan: a.lan, port: a.port, keep: data_folder(), camera, config, session };
    let server = Server::start(config).map_err(|e| {
        let cure = match &e {
            WebError::Port { .. } => "give another --port, or end the program that has it",
            WebError::Machine(_) => "try again",
        };
        Failure::new("the page", e.to_string(), cure)
    })?;
    if let Some(why) = server.not_kept() {
        eprintln!("the certificate is not kept, the browser will ask again at the next start: {why}");
    }
    let invitation = server.invitation();
    let shown = serde_json::json!({ "urls": invitation.urls, "token": invitation.token });
    output.result(&shown, |_| {
        let mut text = if a.lan { invitation.qr() } else { String::new() };
        for url in &invitation.urls {
            text += &format!("{url}\n");
        }
        text += "The certificate is this machine's own: the browser asks once whether to trust it.\n";
        text + if a.lan { "" } else { "Only this machine is let in; --lan opens it to the phone.\n" }
    })?;
    let remote = server.remote();
    // As before when this is dropped.
    let mut terminal = Terminal::new(a.lines, true);
    terminal.forward(move |command| remote.command(command));
    Ok(server.wait()?)
}

/// Where this user's programs keep their data; `None` where the system names no such place.
fn data_folder() -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let base = match cfg!(windows) {
        true => named("LOCALAPPDATA"),
        // The XDG base directory specification, which has no use for a relative path.
        false => (named("XDG_DATA_HOME").filter(|p| p.is_absolute()))
            .or_else(|| named("HOME").map(|home| home.join(".local/share"))),
    };
    base.map(|base| base.join("cairn"))
}

/// A rig by name or file; a named one brings its number of features, unless the configuration has one.
pub fn rig_of(path: &Path, config: &mut Config) -> Result<Rig, Failure> {
    if let Some(named) = path.to_str().and_then(named_rig).filter(|_| !path.exists()) {
        if config.front_end.orb.features == 0 {
            config.front_end.orb.features = named.features;
        }
        return Ok(named.rig);
    }
    Ok(read_rig(path)?)
}

fn eyes_of(source: &str, rig: Option<Rig>, sensor: Option<Sensor>) -> CameraSource {
    let name = source.to_owned();
    if let Some(waits) = waiting_for(source) {
        eprintln!("{waits}");
    }
    let address = name.clone();
    let open = move || {
        let source = open(&address, OpenOptions { rig, ..OpenOptions::default() })?;
        let sensor = sensor.unwrap_or_else(|| Sensor::of(source.rig()));
        let (mode, has_imu) = (sensor.mode(), sensor.has_imu());
        let source: Box<dyn Source> = Box::new(Validator::new(source, |doubt| eprintln!("warning: {doubt}")));
        // What is live comes when it comes; a recording is played as a camera would give it.
        let source: Box<dyn Source> = if is_live(&address) { source } else { Box::new(Paced::new(source)) };
        Ok((source, mode, has_imu))
    };
    CameraSource::Source { name, open: Box::new(open) }
}
