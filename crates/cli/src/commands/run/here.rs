//! A run in this process.

use super::arguments::Arguments;
use super::events::Events;
use super::outcome::Outcome;
use super::played::{self, Played};
use super::poses::Poses;
use super::sink::{Here, Run};
use super::sinks::{Follow, Sinks};
use super::status::{StatusLines, Watch};
use super::tally::Tally;
use super::{foxglove, journal, map, rerun, results, route, source, surface, team, truth, walker};
use crate::commands::map::attach_doubts;
use crate::failure::Failure;
use crate::interrupt;
use crate::map_lock::MapLock;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::progress::Progress;
use crate::terminal::Terminal;
use cairn::map_file;
use cairn_atlas::store::MapFile;
use cairn_engine::{Engine, Finished, Journal, PoseTime, Runner, Sensors};
use cairn_geometry::Se3;
use cairn_rerun::viewer;
use cairn_sensor::{SkipKind, Skips, Source, SourceInfo, Stamp};
use cairn_session::{FileConfig, Script, Session};
use cairn_sources::is_live;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// Runs the engine over the source, then writes the requested results. `began` is when the process started.
///
/// # Errors
/// When an input cannot be used, the run fails or gives no pose, or a result cannot be written. Once a frame has been
/// processed, every result is written all the same.
pub fn run(a: &Arguments, outputs: &Outputs, output: &Output, began: Instant) -> Result<(), Failure> {
    let _lock = outputs.file("--map-out").map(MapLock::take).transpose()?;
    if let Some(path) = &a.vocabulary {
        source::vocabulary(path)?;
    }
    a.guide.as_deref().map(route::check).transpose()?;
    let mut config = source::config_of(a)?;
    let mut script = walker::script(a)?;
    let live = is_live(&a.source);
    let say = walker::say_of(a, live || a.guide.is_some() || a.script.is_some() || a.lines)?;
    let replayed = journal::opened(a)?;
    let stamps = replayed.as_ref().map(Journal::stamps);
    let mut map = map::opened(a)?;
    let (source, sensor) = source::fitted(a, &mut config.engine, map.as_ref())?;
    let (info, rig) = (source.info().clone(), source.rig().clone());

    let mut status = a.status.then(StatusLines::begin);
    // Status lines and a progress bar would disturb each other.
    let progress = if a.status { Progress::hidden() } else { Progress::new(info.frames) };
    let mut sinks = Sinks::new(progress);
    let runner = if a.realtime || live { Runner::Threaded } else { Runner::Lockstep };
    let engine = map::engine(a, map.as_ref(), &rig, sensor.mode(), info.rate_hz, runner, &config.engine)?;
    let mut engine = journal::engine(a, outputs, engine, &info.name, replayed)?;
    sinks.add(Events::begin(outputs.file("--events"), &mut engine)?);
    sinks.add(foxglove::Scene::begin(outputs.file("--mcap"), a.foxglove, &rig)?);
    let show_in = a.rerun.as_deref().filter(|to| viewer(to).is_some()).or(outputs.file("--rerun"));
    sinks.add(rerun::Scene::begin(show_in, &rig, &info.name)?);
    let dense = surface::begin(a, &mut engine, &rig, map.as_mut())?;
    sinks.add(Some(say.voice(walker::speech_of(a), outputs.file("--say wav:"), output.is_json())?));
    let mut session = Session::new(engine, walker::session_config(a, outputs, live, config.route));
    surface::watch_way(a, &mut session, &rig, sensor.mode())?;
    status.iter_mut().for_each(|lines| lines.update_from(&session));
    let is_timed = a.realtime || live;
    let watched = status.as_ref().filter(|_| is_timed).map(|lines| lines.watch(info.rate_hz)).transpose()?;
    sinks.add(status);
    walker::begin(&mut session, a, outputs, map.as_ref())?;
    sinks.at_end(move |ended| journal::end(a, ended));
    sinks.at_end(|ended| ended.run.close_recording());
    let sharing = team::begin(a, outputs)?;
    let attached = map.map_or_else(BTreeMap::new, |file| file.attached);
    sinks.add(map::Saver::begin(a, outputs.file("--map-out"), attached, sinks.progress.clone()));
    if let Some(sharing) = sharing {
        sinks.at_end(move |_| sharing.end());
    }
    results::add(&mut sinks, a, outputs);

    if interrupt::requested() {
        return Err(Failure::new("the run", "interrupted before its first frame", "start it again"));
    }
    interrupt::in_order();
    // An adjustment of the whole map is not waited for.
    interrupt::sets(session.engine().stop_flag());
    let here = Here { session, dense, finished: Finished::default(), last: Stamp::default() };
    let mut run = OneProcess {
        here,
        tally: Tally::new(began),
        config,
        cam0: source::cam0(a, &rig),
        sensor,
        info,
        skips: Skips::default(),
    };
    let played = run.play(a, source, stamps, &mut script, &mut sinks, watched)?;
    results::conclude(a, output, sinks.end(&mut run, played.driven.err().map(Failure::from)))
}

/// The run, with what its report says of it.
struct OneProcess {
    here: Here,
    tally: Tally,
    config: FileConfig,
    /// Where the first camera is on the body, if poses are asked for of it.
    cam0: Option<Se3>,
    sensor: Sensors,
    info: SourceInfo,
    skips: Skips,
}

impl OneProcess {
    fn engine(&self) -> &Engine {
        self.here.session.engine()
    }

    /// From the first frame to the last, and the work after it.
    fn play(
        &mut self,
        a: &Arguments,
        source: Box<dyn Source>,
        stamps: Option<Vec<Stamp>>,
        script: &mut Script,
        sinks: &mut Sinks,
        watched: Option<Watch>,
    ) -> Result<Played, Failure> {
        let live = is_live(&a.source);
        let terminal = Terminal::new(a.lines, a.realtime || live, a.speaking.language);
        let session = &mut self.here.session;
        let mut follow = Follow::new(sinks, &mut self.tally, self.here.dense.as_mut(), terminal);
        let played = match live {
            true => played::live(a, source, session, script, &mut follow)?,
            false => played::recorded(a, source, stamps, session, script, &mut follow),
        };
        drop((follow, watched));
        self.here.finished = self.here.session.engine_mut().finish();
        self.here.last = self.engine().log().frames().last().map_or(Stamp::default(), |f| f.stamp);
        self.tally.dropped = played.dropped;
        self.tally.after(&self.here);
        self.skips = played.skips.clone();
        played.warn();
        Ok(played)
    }
}

impl Run for OneProcess {
    fn poses(&self, time: PoseTime) -> Poses {
        let engine = self.engine();
        Poses { of_camera: engine.camera_poses(time), cam0: self.cam0, frames: engine.log().frames().len() }
    }

    fn map(&mut self, attached: &BTreeMap<String, Vec<u8>>) -> Option<MapFile> {
        let mut file = map_file(&self.here.session, attached)?;
        if let Some(dense) = &mut self.here.dense {
            let depth = dense.to_save(&file.snapshot);
            file.add_depth(&depth);
        }
        let assumed =
            self.info.assumed.iter().map(|what| format!("no calibration was given, assumed was: {what}"));
        let others = self.skips.iter().filter(|s| s.kind == SkipKind::Other).map(|s| s.first.clone());
        attach_doubts(&mut file, assumed.chain(others));
        Some(file)
    }

    fn surface(&mut self, path: &Path) -> Result<Vec<u8>, Failure> {
        let aligned = self.engine().snapshot().is_gravity_aligned_throughout();
        let none = || Failure::new("the surface", "there is no depth", "use --sensor rgbd");
        surface::bytes(self.here.dense.as_mut().ok_or_else(none)?, aligned, path)
    }

    fn close_recording(&mut self) -> Result<(), Failure> {
        let closed = self.here.session.close();
        closed.map_err(|why| Failure::new("recording", why.to_string(), "free some space on the disk"))
    }

    fn outcome(&mut self) -> Outcome {
        let engine = self.here.session.engine();
        let tracked = engine.log().tracked();
        let mut report = self.tally.report(&engine.snapshot(), tracked, &self.config, &self.skips);
        report.set_usage(report.wall_s);
        (report.source, report.sensor) = (self.info.name.clone(), self.sensor.name().to_owned());
        // No figure without ground truth, or where it has no time in common with the run.
        report.accuracy = self.poses(PoseTime::Corrected).accuracy(&self.info.truth);
        report.live = truth::live(&self.info.truth, &self.poses(PoseTime::Live));
        report.scale = truth::scale(&self.info.truth, engine);
        if engine.front_end().model().has_depth() {
            self.tally.contradict_metres(&mut report.scale);
        }
        let searches = self.here.dense.as_ref().map(|d| d.search_counts());
        Outcome { searches: searches.filter(|counts| counts.attempts > 0), ..self.tally.outcome(report) }
    }

    fn here(&mut self) -> Option<&mut Here> {
        Some(&mut self.here)
    }
}
