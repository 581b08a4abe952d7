//! What the arguments ask of the session: routes, recording, guidance, words.

use super::arguments::Arguments;
use super::route;
use super::say::Say;
use crate::failure::Failure;
use crate::outputs::Outputs;
use cairn_atlas::store::MapFile;
use cairn_files::MIB;
use cairn_guide::{AnnouncerConfig, RouteConfig};
use cairn_session::{Command, RouteChoice, Script, Session, SessionConfig};
use cairn_voice::SpeechConfig;
use std::path::Path;

/// A live run is recorded automatically after this many tracked frames.
const AUTO_RECORD: usize = 100;

/// The configuration of the session.
pub fn session_config(a: &Arguments, outputs: &Outputs, live: bool, route: RouteConfig) -> SessionConfig {
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

/// How what is said is given, by default as text if there are `words` to be expected.
///
/// # Errors
/// When the speech program is missing.
pub fn say_of(a: &Arguments, words: bool) -> Result<Say, Failure> {
    let say = a.say.clone().unwrap_or(if words { Say::Text } else { Say::None });
    say.check(speech_of(a))?;
    Ok(say)
}

/// How what is said is timed.
pub fn announcer_of(a: &Arguments) -> AnnouncerConfig {
    let announcer = a.speaking.announcer();
    AnnouncerConfig { rate: a.rate.unwrap_or(announcer.rate), volume: a.volume, ..announcer }
}

/// How it is spoken.
pub fn speech_of(a: &Arguments) -> SpeechConfig {
    SpeechConfig { language: a.speaking.language, rate: announcer_of(a).rate, volume: a.volume }
}

/// Starts recording and guidance as the arguments ask, before the first frame.
///
/// # Errors
/// When a route cannot be read, written or followed.
pub fn begin(
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

/// The commands of --script.
///
/// # Errors
/// When the file cannot be read, or a line is no command.
pub fn script(a: &Arguments) -> Result<Script, Failure> {
    let Some(path) = &a.script else { return Ok(Script::default()) };
    let shown = path.display().to_string();
    let text = cairn_files::read_text(path, 16 * MIB)
        .map_err(|e| Failure::new(&shown, e.to_string(), "check the path"))?;
    Script::parse(&text)
        .map_err(|e| Failure::new(format!("{shown}, line {}", e.line), e.why, "see cairn run --help"))
}
