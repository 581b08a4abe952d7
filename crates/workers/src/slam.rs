//! The SLAM process: frames from the ring in, poses out, every commit of the map into the journal.
//!
//! It begins in the map of the journal, where there is one: tracking then starts lost and relocalises with the first frame
//! that shows a known place. Everything it knows that is worth keeping is in the journal; it may be killed at any moment.

use crate::depth_log::DepthWriter;
use crate::journal::{JournalWriter, recover};
use crate::message::{
    Anchored, Failure, Finished, Frame, Opened, Order, Outcome, Place, Report, SurfaceInput, Tracked,
    first_order, read, write,
};
use crate::ring::{Borrowed, Ring};
use crate::seen::Seen;
use crate::{mode_of, pixels};
use cairn_atlas::{Change, KeyFrameId, Mirror, Published, Snapshot, Subscription};
use cairn_dense::{PackedDepth, PackedGray};
use cairn_engine::{Config, Engine, Joined, Offered, OfferedDepth, Runner, Verdict, Views, record_input};
use cairn_sensor::{FramePacket, ImuSample, Stamp};
use cairn_session::TrackedPlace;
use cairn_sources::std_host;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::Path;

/// The map at the end of the run, in the journal's folder.
pub const FINAL_MAP: &str = "final.cairn";

/// Frames without a pose that may get one later: initialisation with one camera takes no longer.
const MOST_UNPOSED: usize = 1000;

/// Runs until the frames have ended or the supervisor is gone.
pub fn run(mut from: impl Read, mut to: impl Write, config: &Config, runner: Runner) {
    let Some(Order::Map { ring, folder, opened, start, surfaces, session }) = first_order(&mut from, &mut to)
    else {
        return;
    };
    let whole = session.is_some();
    let config = &session.map_or_else(|| config.clone(), |setup| setup.into_config());
    let said = Slam::begin(&ring, &folder, &opened, start, config, runner)
        .map(|slam| match surfaces {
            Some(what) => slam.with_depth(what),
            None => slam,
        })
        .map(|slam| Slam { whole, ..slam })
        .and_then(|slam| slam.work(&mut from, &mut to));
    if let Err(why) = said {
        // Without a supervisor there is nobody to tell.
        let _ = write(&mut to, &Report::Failed(why));
    }
}

struct Slam<'a> {
    engine: Engine,
    ring: Ring,
    folder: &'a Path,
    journal: JournalWriter,
    commits: Subscription,
    /// Where the depth of key frames is written, if it is wanted.
    depth: Option<DepthOf>,
    /// Why it is written no longer, until that is told.
    depth_failed: Option<Failure>,
    /// IMU samples of frames that the ring no longer had: the next frame takes them.
    imu: Vec<ImuSample>,
    /// Frames of this process that were told without a pose: number and index in the engine's log.
    unposed: Vec<(u64, usize)>,
    finished: Finished,
    start: u64,
    /// It is in a map of the journal and has had no frame yet.
    resumes: bool,
    /// It works for a session, which needs all of a frame's output.
    whole: bool,
    bytes: Vec<u8>,
}

/// The depth of frames that may become key frames, and where that of key frames goes.
struct DepthOf {
    to: DepthWriter,
    what: SurfaceInput,
    offered: OfferedDepth,
    /// The map as far as its commits were written, and whose depth is kept.
    mirror: Mirror,
    views: Views,
}

impl DepthOf {
    /// Goes on in the file of a folder, for a map that is this by now.
    fn begin(folder: &Path, map: &Snapshot, what: SurfaceInput) -> Result<Self, crate::JournalError> {
        let to = DepthWriter::open(folder, map)?;
        let mut views = Views::default();
        to.key_frames().for_each(|id| views.add(id));
        Ok(Self { to, what, offered: OfferedDepth::default(), mirror: Mirror::of(map), views })
    }

    fn offer(&mut self, packet: &FramePacket) {
        let Some(depth) = &packet.depth else { return };
        let gray = packet.images.first().filter(|_| self.what == SurfaceInput::DepthAndGray);
        self.offered.offer(Offered { stamp: packet.stamp, depth: depth.clone(), gray: gray.cloned() });
    }

    /// Writes the depth of the key frames that a commit adds, and drops that of those it removes where it is superfluous; to be called
    /// before the commit is written.
    fn write(&mut self, commit: &Published) -> Result<(), crate::JournalError> {
        let Self { to, offered, mirror, views, .. } = self;
        let mut written = Ok(());
        to.settle();
        mirror.take_with(commit, |mirror, change, _| {
            let said = match change {
                Change::AddKeyFrame(k) => Self::add(to, offered, views, k.id, k.stamp),
                Change::RemoveKeyFrame(id) if views.drop_if_spare(*id, mirror) => to.drop_spare(*id),
                _ => Ok(()),
            };
            if written.is_ok() {
                written = said;
            }
        });
        written
    }

    fn add(
        to: &mut DepthWriter,
        offered: &mut OfferedDepth,
        views: &mut Views,
        id: KeyFrameId,
        stamp: Stamp,
    ) -> Result<(), crate::JournalError> {
        let Some(Offered { depth, gray, .. }) = offered.take(stamp) else { return Ok(()) };
        let gray = gray.map(|gray| PackedGray::pack(&gray));
        to.append(id, stamp, &PackedDepth::pack(&depth), gray.as_ref())?;
        views.add(id);
        Ok(())
    }
}

fn depth_failed(e: crate::JournalError) -> Failure {
    Failure::new("the depth of key frames", e, "free some shared memory, or run without --mesh and --dense")
}

impl<'a> Slam<'a> {
    fn begin(
        ring: &Path,
        folder: &'a Path,
        opened: &Opened,
        start: u64,
        config: &Config,
        runner: Runner,
    ) -> Result<Self, Failure> {
        let ring =
            Ring::open(ring).map_err(|e| Failure::new("the shared frames", e, "start the run again"))?;
        let rig = crate::rig_of(folder, opened)?;
        let mut config = config.clone();
        let mode;
        (mode, config.inertial.enabled) = mode_of(&opened.sensor)?;
        let stored = |e: &dyn std::fmt::Display| {
            Failure::new("the journal of the map", e, "free some shared memory, or run without --isolated")
        };
        let unsuitable = |e: &dyn std::fmt::Display| Failure::new(&opened.name, e, "choose another --sensor");
        let recovered = recover(folder).map_err(|e| stored(&e))?;
        let rate_hz = opened.rate_hz;
        let (mut engine, journal) = match &recovered {
            Some(r) => {
                let engine = Engine::in_map(&rig, mode, rate_hz, runner, &config, &std_host(), &r.file);
                (
                    engine.map_err(|e| unsuitable(&e))?.0,
                    JournalWriter::resume(folder, r).map_err(|e| stored(&e))?,
                )
            }
            None => {
                let engine = Engine::new(&rig, mode, rate_hz, runner, &config, &std_host())
                    .map_err(|e| unsuitable(&e))?;
                let base = engine.to_save("cairn", BTreeMap::new());
                (engine, JournalWriter::begin(folder, &base).map_err(|e| stored(&e))?)
            }
        };
        let commits =
            engine.subscribe().ok_or_else(|| Failure::new("mapping", "it does not run", "try again"))?;
        Ok(Self {
            engine,
            ring,
            folder,
            journal,
            commits,
            depth: None,
            depth_failed: None,
            imu: Vec::new(),
            unposed: Vec::new(),
            finished: Finished::default(),
            start,
            resumes: recovered.is_some(),
            whole: false,
            bytes: Vec::new(),
        })
    }

    /// With the depth of its key frames in a file of the folder.
    fn with_depth(self, what: SurfaceInput) -> Self {
        match DepthOf::begin(self.folder, &self.commits.start, what) {
            Ok(depth) => Self { depth: Some(depth), ..self },
            Err(e) => Self { depth_failed: Some(depth_failed(e)), ..self },
        }
    }

    /// Writes the depth of the key frames that a commit adds, then the commit. Without room for the depth there are no surfaces,
    /// and the map goes on.
    fn append(&mut self, commit: &Published) -> Result<(), crate::JournalError> {
        if let Some(Err(e)) = self.depth.as_mut().map(|depth| depth.write(commit)) {
            (self.depth, self.depth_failed) = (None, Some(depth_failed(e)));
        }
        self.journal.append(commit)
    }

    /// `Ok` when all is done or the supervisor is gone.
    fn work(mut self, from: &mut impl Read, to: &mut impl Write) -> Result<(), Failure> {
        let snapshot = self.engine.snapshot();
        let ready = Report::Ready { key_frames: snapshot.key_frame_count(), version: snapshot.version() };
        drop(snapshot);
        let mut reports = vec![ready];
        loop {
            reports.extend(self.depth_failed.take().map(Report::NoSurfaces));
            for report in reports.drain(..) {
                if write(to, &report).is_err() {
                    return Ok(());
                }
            }
            match read(from) {
                Ok(Some(Order::Frame(frame))) => {
                    let tracked = self.frame(&frame)?;
                    reports.extend(self.amended().into_iter().chain([Report::Tracked(Box::new(tracked))]));
                }
                Ok(Some(Order::Ping)) => {
                    self.flush()?;
                    reports.push(Report::Pong);
                }
                Ok(Some(Order::End)) => reports.push(self.end()?),
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => return Ok(()),
            }
        }
    }

    fn frame(&mut self, frame: &Frame) -> Result<Tracked, Failure> {
        let mut tracked = Tracked {
            number: frame.number,
            stamp: frame.stamp,
            outcome: Outcome::Overtaken,
            pose: None,
            metric: false,
            ms: 0.0,
            place: None,
            seen: None,
        };
        self.imu.extend(frame.imu_samples());
        let found = self.ring.read(frame.number, &mut self.bytes);
        let found = found.map_err(|e| Failure::new("the shared frames", e, "start the run again"))?;
        let images = match found {
            Borrowed::Whole(()) => pixels::read(&self.bytes),
            Borrowed::Overtaken { .. } => return Ok(tracked),
            Borrowed::Unwritten | Borrowed::Torn => None,
        };
        let Some((images, depth)) = images else {
            return Ok(Tracked { outcome: Outcome::Torn, ..tracked });
        };
        let (stamp, imu) = (Stamp(frame.stamp), std::mem::take(&mut self.imu));
        let packet = FramePacket { stamp, images, depth, imu, decode_ms: frame.decode_ms };
        if std::mem::take(&mut self.resumes) {
            self.engine.resume(stamp);
        }
        match self.engine.on_packet(&packet) {
            Ok(output) => {
                self.count(output.verdicts());
                if let (Some(depth), true) = (&mut self.depth, output.key_frame_requested) {
                    depth.offer(&packet);
                }
                tracked.outcome = Outcome::State(format!("{:?}", output.state));
                tracked.pose = output.pose.as_ref().map(|pose| Anchored::of(&pose.anchored));
                let seen = record_input(&output, &self.engine.snapshot());
                tracked.place = TrackedPlace::of(&output, &seen).map(|p| Place::of(&p, self.start));
                tracked.seen = self.whole.then(|| Box::new(Seen::of(&output, self.start)));
                (tracked.metric, tracked.ms) = (output.is_metric(), output.timings.step_ms());
                if tracked.pose.is_none() && self.unposed.len() < MOST_UNPOSED {
                    self.unposed.push((frame.number, self.engine.log().frames().len() - 1));
                }
            }
            Err(e) => tracked.outcome = Outcome::Refused(e.to_string()),
        }
        self.flush()?;
        Ok(tracked)
    }

    /// Earlier frames whose poses are known by now, as after the initialisation with one camera.
    fn amended(&mut self) -> Vec<Report> {
        let frames = self.engine.log().frames();
        let mut reports = Vec::new();
        self.unposed.retain(|(number, index)| match frames.get(*index).and_then(|f| f.anchored) {
            Some(pose) => {
                reports.push(Report::Amended { number: *number, pose: Anchored::of(&pose) });
                false
            }
            None => true,
        });
        reports
    }

    /// Appends what was committed since.
    fn flush(&mut self) -> Result<(), Failure> {
        let failed =
            |e: crate::JournalError| Failure::new("the journal of the map", e, "free some shared memory");
        while let Ok(commit) = self.commits.changes.try_recv() {
            self.append(&commit).map_err(failed)?;
        }
        if self.journal.is_long() {
            let map = self.engine.to_save("cairn", BTreeMap::new());
            // Only where all its commits are in the journal; with mapping on threads the next try may be better.
            let behind = self.commits.behind(map.snapshot.version());
            let more: Vec<_> = self.commits.changes.try_iter().collect();
            for commit in &more {
                self.append(commit).map_err(failed)?;
            }
            if behind == 0 && more.is_empty() {
                self.journal.rebase(map).map_err(failed)?;
            }
        }
        Ok(())
    }

    fn count<'v>(&mut self, verdicts: impl Iterator<Item = &'v Verdict>) {
        for joined in verdicts.filter_map(|v| v.result.as_ref().ok()).map(|a| &a.joined) {
            match joined {
                Joined::Loop => self.finished.loops += 1,
                Joined::Merge { .. } => self.finished.merges += 1,
            }
        }
    }

    /// Finishes the map and saves it.
    fn end(&mut self) -> Result<Report, Failure> {
        let finished = self.engine.finish();
        self.count(finished.verdicts());
        self.flush()?;
        let map = self.engine.to_save("cairn", BTreeMap::new());
        map.save(&self.folder.join(FINAL_MAP))
            .map_err(|e| Failure::new("the map", e, "free some shared memory"))?;
        Ok(Report::Finished(self.finished))
    }
}
