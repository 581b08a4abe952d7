//! `--isolated`: the run as processes of this program under a supervisor, each of which may die.
//!
//! The same command line runs them all: the supervisor adds `--worker ROLE` for each process that it starts.

use super::Arguments;
use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::processes;
use std::path::Path;
use std::time::Instant;

/// The folder in which processes can share memory; `None` where there is none, which is said: the run then is one process.
///
/// # Errors
/// For a live source.
pub fn shared_memory(a: &Arguments) -> Result<Option<&'static Path>, Failure> {
    if cairn_sources::is_live(&a.source) {
        let hint = "leave out --isolated, or record it first and run the recording";
        return Err(Failure::usage("--isolated", "live sources are not supported yet", hint));
    }
    Ok(processes::shared_memory())
}

#[cfg(unix)]
pub use unix::{supervise, work};

/// There is no shared memory ([`shared_memory`]), and nobody starts a worker.
#[cfg(not(unix))]
pub fn work(_: &Arguments) -> Result<(), Failure> {
    Err(Failure::usage("--worker", "it needs Unix", "leave it out"))
}

/// As [`work`].
#[cfg(not(unix))]
pub fn supervise(_: &Arguments, _: &Outputs, _: &Output, _: Instant, _: &Path) -> Result<(), Failure> {
    Err(Failure::usage("--isolated", "it needs Unix", "leave it out"))
}

#[cfg(unix)]
mod unix {
    use super::super::outcome::Outcome;
    use super::super::say::Say;
    use super::super::{map, open_part, open_source, problems, results, tally};
    use super::*;
    use crate::commands::given::read_config;
    use crate::commands::map::failed;
    use crate::interrupt;
    use crate::map_lock::MapLock;
    use crate::output::warn;
    use crate::processes::{SHARED_MEMORY, folder_in, line, this_program};
    use crate::progress::Progress;
    use crate::surface::{Surface, form};
    use cairn_atlas::store::MapFile;
    use cairn_engine::{DenseMapper, PoseTime, Runner};
    use cairn_eval::{Align, EvalOptions, Lost, Percentiles, RunReport, evaluate};
    use cairn_geometry::{Se3, Trajectory};
    use cairn_guide::{Cue, CueKind, Route, StopReason, Travel};
    use cairn_sensor::{SkipKind, Source, Stamp};
    use cairn_session::{FileConfig, RouteGuide};
    use cairn_sources::Validator;
    use cairn_voice::Voice;
    use cairn_workers::capture::{Delivered, rest_of};
    use cairn_workers::guide::{RecordTo, Work};
    use cairn_workers::message::{OfKeyFrames, Said, Tracked};
    use cairn_workers::{Death, Role, RunFolder, Supervised, Supervision, Told, dense};
    use serde::Serialize;
    use std::collections::BTreeMap;
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;
    use std::time::Duration;

    /// In real time SLAM has done a frame after this time, or the guide says stop.
    const LATE: Duration = Duration::from_millis(250);

    /// What the result says of the processes.
    #[derive(Serialize)]
    struct Processes<'a> {
        #[serde(flatten)]
        outcome: &'a Outcome<'a>,
        /// Each process that died or was killed because it hung.
        deaths: Vec<DeathReport<'a>>,
        /// After each death of SLAM: frames without a pose, and seconds until the next pose.
        relocalised: Vec<RelocalisedReport>,
    }

    #[derive(Serialize)]
    struct DeathReport<'a> {
        process: &'static str,
        why: &'a str,
        at_frame: u64,
        t_s: f64,
    }

    #[derive(Serialize)]
    struct RelocalisedReport {
        frames: usize,
        after_s: f64,
    }

    /// Does the work of one process.
    ///
    /// # Errors
    /// When the role is unknown. What fails later is told to the supervisor.
    pub fn work(a: &Arguments) -> Result<(), Failure> {
        let name = a.isolated.worker.as_deref().unwrap_or_default();
        let role = Role::named(name).ok_or_else(|| {
            Failure::usage(
                "--worker",
                format!("'{name}' is unknown"),
                "leave it out: --isolated starts workers",
            )
        })?;
        cairn_workers::die_with_parent();
        if let Err(e) = cairn_workers::limit_memory(a.isolated.worker_memory * 1_000_000) {
            warn(&format!("the memory of {name} is not limited: {e}"));
        }
        let mut config = config_of(a)?.engine;
        let (from, to) = (std::io::stdin(), std::io::stdout());
        match role {
            Role::Capture => cairn_workers::capture::run(from, to, a.realtime, |delivered| {
                let told = |e: Failure| cairn_workers::message::Failure::new(e.what, e.why, e.hint);
                let map_in = map::opened(a).map_err(told)?;
                let part = delivered.map_or((a.start, a.frames), |d| rest(a, &d));
                let (source, sensor) = open_part(a, part, &mut config, map_in.as_ref()).map_err(told)?;
                let source = match &delivered {
                    Some(delivered) => rest_of(source, delivered)?,
                    None => source,
                };
                let source: Box<dyn Source> = Box::new(Validator::new(source, warn));
                Ok((source, sensor.name().to_owned()))
            }),
            Role::Slam => {
                if let Some(path) = &a.vocabulary {
                    super::super::vocabulary(path)?;
                }
                cairn_workers::slam::run(from, to, &config, runner(a));
            }
            Role::Dense => cairn_workers::dense::run(from, to, || dense_of(a)),
            Role::Guide => cairn_workers::guide::run(from, to, a.realtime, || match &a.record {
                Some(path) => Ok(Work::Record(record_to(a, path)?)),
                None => guide_of(a).map(|guide| Work::Guide(Box::new(guide))),
            }),
            // Of `cairn serve` only.
            Role::Walk => {}
        }
        Ok(())
    }

    /// Where to begin reading again, seconds, and how many frames: a second before what was delivered last, since the first
    /// packet of a source has no earlier IMU samples.
    fn rest(a: &Arguments, delivered: &Delivered) -> (f64, Option<usize>) {
        let start_s = a.start + (delivered.last - delivered.first - 1.0).max(0.0);
        // With --frames from the beginning: how many frames that second has is not known. A simulated world, too: it would
        // end later.
        match a.frames.is_some() || a.source.starts_with("sim:") {
            true => (a.start, a.frames),
            false => (start_s, None),
        }
    }

    type Mesh = Box<dyn FnMut(&mut DenseMapper, bool) -> Result<Vec<u8>, cairn_workers::message::Failure>>;

    /// Surfaces, from the depth of --map-in on.
    fn dense_of(a: &Arguments) -> Result<dense::Work<Mesh>, cairn_workers::message::Failure> {
        let told = |e: Failure| cairn_workers::message::Failure::new(e.what, e.why, e.hint);
        let saved = match map::opened(a).map_err(told)? {
            Some(mut file) => file
                .take_depth()
                .map_err(|e| cairn_workers::message::Failure::new("--map-in", e, "see cairn map repair"))?,
            None => Vec::new(),
        };
        let surface = a.mesh.clone().map(|path| -> Mesh {
            Box::new(move |mapper, gravity_aligned| {
                let write = form(&path).map_err(told)?;
                let surface = Surface::of(mapper, gravity_aligned).map_err(told)?;
                surface.bytes(write, &path.display().to_string()).map_err(told)
            })
        });
        Ok(dense::Work { config: super::super::surface::config(a), saved, surface })
    }

    /// The route of --record.
    fn record_to(a: &Arguments, path: &Path) -> Result<RecordTo, cairn_workers::message::Failure> {
        let config = config_of(a).map_err(|e| cairn_workers::message::Failure::new(e.what, e.why, e.hint))?;
        Ok(RecordTo {
            path: path.to_owned(),
            exists: a.map_in.is_some() && path.exists(),
            without_map: a.map_in.is_none(),
            source: a.source.clone(),
            config: config.route.recorder,
            language: a.speaking.language,
        })
    }

    /// The guide along the route of --guide.
    fn guide_of(a: &Arguments) -> Result<RouteGuide, cairn_workers::message::Failure> {
        let told = |what: String, why: String| {
            cairn_workers::message::Failure::new(what, why, "give a file that cairn run --record wrote")
        };
        let path = a.guide.as_ref().ok_or_else(|| told("--guide".into(), "there is no route".into()))?;
        let shown = path.display().to_string();
        let route = Route::load(path).map_err(|e| told(shown.clone(), e.to_string()))?;
        let travel = if a.back { Travel::Home } else { Travel::Again };
        let config = config_of(a).map_err(|e| told(e.what, e.why))?.route;
        let announcer = super::super::announcer_of(a);
        Ok(RouteGuide::new(route, travel, a.facing.facing(), config, a.speaking.phrases(), announcer))
    }

    fn config_of(a: &Arguments) -> Result<FileConfig, Failure> {
        let mut config = a.config.as_deref().map_or_else(|| Ok(FileConfig::default()), read_config)?;
        config.engine.robot = a.robot.unwrap_or(config.engine.robot);
        Ok(config)
    }

    fn runner(a: &Arguments) -> Runner {
        if a.realtime { Runner::Threaded } else { Runner::Lockstep }
    }

    /// Runs the processes in a folder under `parent`, then writes the results.
    ///
    /// # Errors
    /// When an input cannot be used, a process dies again and again, no frame gets a pose, or a result cannot be written.
    pub fn supervise(
        a: &Arguments,
        outputs: &Outputs,
        output: &Output,
        began: Instant,
        parent: &Path,
    ) -> Result<(), Failure> {
        let _lock = outputs.file("--map-out").map(MapLock::take).transpose()?;
        let config = config_of(a)?;
        a.guide.as_deref().map(super::super::route::check).transpose()?;
        a.mesh.as_deref().map(form).transpose()?;
        if a.colour && !makes_surfaces(a) {
            let hint = "add --mesh or --dense";
            return Err(Failure::usage("--colour", "colours are those of surfaces", hint));
        }
        if a.guide.is_some() && a.map_in.is_none() {
            let hint = "load its map with --map-in";
            return Err(Failure::usage("--guide", "the route needs the map it was recorded in", hint));
        }
        if a.guide.is_some() && a.record.is_some() {
            let hint = "record in one run and be guided in another";
            return Err(Failure::usage("--isolated", "one process guides or records", hint));
        }
        let say = a.say.clone().unwrap_or(if a.guide.is_some() { Say::Text } else { Say::None });
        let speech = super::super::speech_of(a);
        say.check(speech)?;
        if let (Some(path), Some(map)) = (a.record.as_ref().filter(|path| path.exists()), map::opened(a)?) {
            // It fits, or the run ends here.
            super::super::route::resume(path, &map, config.route.recorder)?;
        }
        let folder = folder_in(parent)?;
        let attached = begin_in(a, &folder)?;
        interrupt::in_order();
        let stop = Arc::new(AtomicBool::new(false));
        interrupt::sets(stop.clone());
        let hang_limit = hang_limit(a);
        let late_limit = if a.realtime { LATE } else { hang_limit };
        let how = Supervision {
            command: Box::new(this_program),
            hang_limit,
            late_limit,
            guide: a.guide.is_some() || a.record.is_some(),
            records: a.record.is_some(),
            surfaces: makes_surfaces(a).then_some(match a.colour {
                true => OfKeyFrames::DepthAndGray,
                false => OfKeyFrames::Depth,
            }),
        };
        let voice = say.voice(speech, outputs.file("--say wav:"), output.is_json())?;
        let mut monitor = Monitor::new(a, began, voice);
        let run = cairn_workers::supervise(&how, &folder, &stop, &mut |told| monitor.tell(&told));
        let mut run = run.map_err(|e| match e {
            cairn_workers::SuperviseError::Worker(e) => Failure::new(e.what, e.why, e.cure),
            e => Failure::new("the run", e.to_string(), "run without --isolated to see where it fails"),
        })?;
        let heard = monitor.voice.end().map_err(super::super::say::fail);
        run.map.attached.extend(attached);
        drop(std::mem::replace(&mut monitor.progress, Progress::hidden()));
        let report = report(a, &run, &monitor, &config, began);
        let surface = || {
            let path = folder.path().join(dense::SURFACE);
            std::fs::read(&path)
                .map_err(|e| Failure::new("the surface", e.to_string(), "free some shared memory"))
        };
        let written = written(a, outputs, output, &run, &report, &surface);
        heard.and(written)
    }

    /// The sentence that stops the walker.
    fn stop_words(a: &Arguments, reason: StopReason) -> Option<String> {
        let cue = Cue { stamp: Stamp::default(), facing: a.facing.facing(), kind: CueKind::Stop(reason) };
        a.speaking.phrases().words(&cue)
    }

    /// Lockstep adjusts whole maps between two frames, which takes seconds in a large one.
    fn hang_limit(a: &Arguments) -> Duration {
        Duration::from_secs(if a.realtime { 2 } else { 30 })
    }

    /// Begins the journal with the map of --map-in; returns what is attached to it.
    fn begin_in(a: &Arguments, folder: &RunFolder) -> Result<BTreeMap<String, Vec<u8>>, Failure> {
        let Some(file) = map::opened(a)? else { return Ok(BTreeMap::new()) };
        let base = MapFile { attached: BTreeMap::new(), ..file };
        cairn_workers::journal::JournalWriter::begin(folder.path(), &base)
            .map_err(|e| Failure::new(SHARED_MEMORY, e.to_string(), "free some of it"))?;
        let Some(mut file) = map::opened(a)? else { return Ok(BTreeMap::new()) };
        if makes_surfaces(a) {
            // Dense goes on from it, and gives it back with what it adds.
            let path = a.map_in.as_deref().unwrap_or(Path::new("--map-in"));
            file.take_depth().map_err(|e| failed(path, &e))?;
        }
        Ok(file.attached)
    }

    fn makes_surfaces(a: &Arguments) -> bool {
        a.mesh.is_some() || a.dense
    }

    /// What is shown and counted while the run goes on.
    struct Monitor {
        began: Instant,
        progress: Progress,
        frames: usize,
        first_pose_s: Option<f64>,
        first: Option<Stamp>,
        /// Seconds from the first frame to the last.
        t_s: f64,
        voice: Box<dyn Voice>,
        /// What is said when the guide itself has died.
        guide_died: String,
    }

    impl Monitor {
        fn new(a: &Arguments, began: Instant, voice: Box<dyn Voice>) -> Self {
            let language = a.speaking.language;
            Self {
                began,
                progress: Progress::new(None),
                frames: 0,
                first_pose_s: None,
                first: None,
                t_s: 0.0,
                voice,
                guide_died: stop_words(a, StopReason::StageDied)
                    .unwrap_or_else(|| language.text("stop-stage-died")),
            }
        }

        fn died(&mut self, death: &Death) {
            if death.role == Role::Guide {
                self.voice.say(&self.guide_died, self.t_s, true);
            }
        }

        fn said(&mut self, said: &Said) {
            match said {
                Said::Words { text, t_s, interrupts } => self.voice.say(text, *t_s, *interrupts),
                Said::Sound { earcon, bearing_rad, t_s } => {
                    if let Some(earcon) = cairn_workers::guide::earcon_of(*earcon) {
                        self.voice.sound(earcon, *bearing_rad, *t_s);
                    }
                }
            }
        }

        fn tell(&mut self, told: &Told) {
            line(told).iter().for_each(|line| self.progress.note(line));
            match told {
                Told::Opened(opened) => self.progress = Progress::new(opened.frames),
                Told::Tracked(frame) => {
                    self.frames += 1;
                    let stamp = Stamp(frame.stamp);
                    self.t_s = stamp - *self.first.get_or_insert(stamp);
                    self.voice.pass(self.t_s);
                    if frame.pose.is_some() {
                        self.first_pose_s.get_or_insert(self.began.elapsed().as_secs_f64());
                    }
                    self.progress.step(self.frames);
                }
                Told::Died(death) => self.died(death),
                Told::Said(said) => self.said(said),
                _ => {}
            }
        }
    }

    fn report(
        a: &Arguments,
        run: &Supervised,
        monitor: &Monitor,
        config: &FileConfig,
        began: Instant,
    ) -> RunReport {
        let snapshot = &run.map.snapshot;
        let ms: Vec<f64> = run.frames.iter().map(|f| f.ms).collect();
        let (skips, dropped) = (run.left_out.skips(), run.left_out.dropped);
        let skipped = skips.count(SkipKind::Frame);
        let mut report = RunReport {
            version: env!("CARGO_PKG_VERSION").into(),
            source: run.opened.name.clone(),
            sensor: run.opened.sensor.clone(),
            skipped,
            skips: skips.iter().map(tally::skip_report).collect(),
            dropped,
            lost: lost(&run.frames),
            maps: snapshot.maps().count(),
            loops: run.finished.loops,
            merges: run.finished.merges,
            keyframes: snapshot.key_frame_count(),
            landmarks: snapshot.landmark_count(),
            ms: Percentiles::of(&ms),
            first_pose_s: monitor.first_pose_s,
            config: tally::as_printed(config),
            accuracy: accuracy(a, run, config),
            ..RunReport::default()
        };
        let tracked = run.frames.iter().filter(|f| f.pose.is_some()).count();
        report.set_frames(run.frames.len() + dropped + skipped, tracked);
        // Those of the supervisor would say nothing of the run.
        report.wall_s = began.elapsed().as_secs_f64();
        report
    }

    /// Where tracking was lost.
    fn lost(frames: &[Tracked]) -> Vec<Lost> {
        let gaps = frames.windows(2).filter(|w| w[0].pose.is_some() && w[1].pose.is_none());
        gaps.map(|w| Lost { t: Stamp(w[1].stamp).seconds(), reason: format!("{:?}", w[1].outcome) }).collect()
    }

    /// Against the ground truth of the source, where it has any.
    fn accuracy(a: &Arguments, run: &Supervised, config: &FileConfig) -> Option<cairn_eval::Evaluation> {
        let (source, _) = open_source(a, &mut config.engine.clone(), None).ok()?;
        let metric = run.map.snapshot.is_metric(&run.map.about.camera);
        let arm = if metric { Se3::identity() } else { run.map.about.camera.body_from_camera };
        let arm = arm.translation;
        let truth = source.info().truth.iter().map(|(t, body)| (t.0, Se3::new(body.rotation, *body * arm)));
        let estimate = run.trajectory(PoseTime::Corrected).into_iter().map(|(t, pose)| (t.0, pose));
        let truth = Trajectory::from_unsorted(truth.collect()).ok()?;
        let estimate = Trajectory::from_unsorted(estimate.collect()).ok()?;
        let align = if metric { Align::Se3 } else { Align::Sim3 };
        evaluate(&truth, &estimate, &EvalOptions { align, ..EvalOptions::default() }).ok()
    }

    /// Writes the results, all that can be written.
    fn written(
        a: &Arguments,
        outputs: &Outputs,
        output: &Output,
        run: &Supervised,
        report: &RunReport,
        surface: &dyn Fn() -> Result<Vec<u8>, Failure>,
    ) -> Result<(), Failure> {
        let (interrupted, problems) = (interrupt::requested(), problems::of(report));
        let outcome = Outcome { report, interrupted, problems, searches: None };
        let deaths = run.deaths.iter().map(|d| DeathReport {
            process: d.role.name(),
            why: &d.how,
            at_frame: d.at_frame,
            t_s: d.t_s,
        });
        let relocalised = run
            .relocalised
            .iter()
            .map(|(frames, after_s)| RelocalisedReport { frames: *frames, after_s: *after_s });
        let ended =
            Processes { outcome: &outcome, deaths: deaths.collect(), relocalised: relocalised.collect() };
        let json = || {
            let text = serde_json::to_string_pretty(&ended)
                .map_err(|e| Failure::new("report", e.to_string(), "leave out --report"))?;
            Ok((text + "\n").into_bytes())
        };
        let mut failures: Vec<Failure> = outputs.write("--report", json).err().into_iter().collect();
        let map =
            || run.map.write().map_err(|e| Failure::new("the map", e.to_string(), "leave out --map-out"));
        if run.map.snapshot.key_frame_count() > 0 {
            failures.extend(outputs.write("--map-out", map).err());
        }
        if report.tracked > 0 {
            failures.extend(results::write_poses(outputs, &|time| run.trajectory(time)));
        } else if failures.is_empty() {
            let why =
                run.frames.last().map_or_else(|| "it has no frames".into(), |f| format!("{:?}", f.outcome));
            failures.push(Failure::new(
                &a.source,
                format!("no frame got a pose: {why}"),
                super::super::NO_POSE,
            ));
        }
        match &run.surfaces {
            Ok(()) => failures.extend(outputs.write("--mesh", surface).err()),
            Err(e) => failures.push(Failure::new(e.what.clone(), e.why.clone(), e.cure.clone())),
        }
        match &run.recorded {
            Some(Err(why)) => {
                failures.push(Failure::new("recording", why.clone(), "free some space on the disk"))
            }
            None if a.record.is_some() => {
                failures.push(Failure::new(
                    "recording",
                    "the process that records died too often",
                    "run without --isolated",
                ));
            }
            _ => {}
        }
        Failure::all(failures)?;
        output.result(&ended, |ended| {
            let mut text = tally::text(ended.outcome, a.realtime);
            for d in &ended.deaths {
                text += &format!("died      {} at frame {}: {}\n", d.process, d.at_frame, d.why);
            }
            text
        })
    }
}
