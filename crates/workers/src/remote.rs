//! SLAM for a session that is in another process: packets go through the ring, outputs come through a pipe, the map comes
//! from its journal.
//!
//! The session is never kept waiting longer than [`LATE`]. Where SLAM is late, dead or being started again, a packet has no
//! result and the guide says stop ([`Slam::away`]). A process that died is started again in the map of the journal. Packets
//! that come meanwhile are not tracked, since a direction from an old picture guides nobody; the readings of those that a
//! process which lives had no time for go to it with the next.

mod frames;
mod map;

use crate::journal::{self, JournalWriter, recover};
use crate::message::{Failure, Opened, Order, Report, SlamSetup, SurfaceInput, Tracked};
use crate::process::{Event, EventKind, Process, Start};
use crate::remote_dense::RemoteDense;
use crate::ring::Ring;
use crate::run_folder::ring_in;
use crate::supervision::{Death, EventSink, RunEvent};
use crate::worker::Worker;
use crate::{Role, capture, depth_log, pixels, sensor_name};
use cairn_atlas::Snapshot;
use cairn_atlas::store::MapFile;
use cairn_dense::SubmapConfig;
use cairn_engine::{Config, DenseSetupError, Engine, Host, OpenMapError, Output, Runner, SensorMode, Status};
use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_session::{DepthWanted, NotTracked, Slam, Surfaces};
use cairn_vision::RectifiedCamera;
use frames::Frames;
use map::FollowedMap;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// A frame that has no result after this time is late.
const LATE: Duration = Duration::from_millis(200);
/// SLAM that gives no sign of life for so long is killed: it tracks in real time, and adjusts whole maps on a thread.
const HANG_LIMIT: Duration = Duration::from_secs(2);
/// A process that has not begun its work after this time hangs: a large map takes seconds to read.
const BEGIN_LIMIT: Duration = Duration::from_secs(60);

/// What SLAM is started with.
pub struct RemoteSetup<'a> {
    /// The folder of the run: its ring, its rig, the journal of its map.
    pub folder: &'a Path,
    /// Kind and location of the source.
    pub name: String,
    /// The rig.
    pub rig: &'a Rig,
    /// Which of its cameras are used.
    pub mode: SensorMode,
    /// Whether its IMU is used.
    pub imu: bool,
    /// Packets a second, about.
    pub rate_hz: f64,
    /// The engine's configuration.
    pub config: Config,
    /// Whether surfaces of its map will be asked for.
    pub dense: bool,
    /// Starts workers.
    pub command: Start,
    /// Hears what becomes of them.
    pub tell: EventSink,
}

/// SLAM in a process of its own. Dropped, it ends the process.
pub struct RemoteSlam {
    launch: Launch,
    tell: EventSink,
    /// Who makes surfaces, once they were asked for.
    dense: Option<RemoteDense>,
    events: Receiver<Event>,
    to: Sender<Event>,
    worker: Worker,
    /// When it was looked after last.
    looked: Instant,
    starts: u64,
    began: Instant,
    camera: RectifiedCamera,
    map: FollowedMap,
    status: Status,
    frames: Frames,
    away: Option<String>,
    /// It died or was late, frames without a pose since, and when.
    recovering: Option<(Instant, usize, Instant)>,
    given_up: bool,
}

/// What each process is started with.
struct Launch {
    command: Start,
    folder: PathBuf,
    ring: PathBuf,
    opened: Opened,
    config: Config,
    /// What SLAM writes for surfaces.
    surfaces: Option<SurfaceInput>,
}

impl Launch {
    /// What the process number `start` is told first.
    fn order(&self, start: u64) -> Order {
        Order::Map {
            ring: self.ring.clone(),
            folder: self.folder.clone(),
            opened: self.opened.clone(),
            start,
            surfaces: self.surfaces,
            session: Some(Box::new(SlamSetup::new(self.config.clone()))),
        }
    }
}

impl RemoteSlam {
    /// Starts SLAM and waits until it has begun, in the map of the folder's journal where there is one, else in this one.
    /// Also returns small differences between the camera of the map and this one.
    ///
    /// # Errors
    /// As `Engine::in_map`; also when the process cannot be started or says that it cannot go on.
    pub fn begin(setup: RemoteSetup, map: Option<&MapFile>) -> Result<(Self, Vec<String>), OpenMapError> {
        let RemoteSetup { folder, name, rig, mode, imu, rate_hz, config, dense, command, tell } = setup;
        let why = |e: &dyn std::fmt::Display| OpenMapError::Process(e.to_string());
        let mut checked = config.clone();
        checked.inertial.enabled = imu;
        // An engine that tracks nothing: it says whether the map fits, and which camera the poses are of.
        let begin = |map: Option<&MapFile>| match map {
            Some(file) => Engine::in_map(rig, mode, rate_hz, Runner::Lockstep, &checked, &Host::bare(), file),
            None => {
                Ok((Engine::new(rig, mode, rate_hz, Runner::Lockstep, &checked, &Host::bare())?, Vec::new()))
            }
        };
        let followed = recover(folder).map_err(|e| why(&e))?.and_then(|r| begin(Some(&r.file)).ok());
        let goes_on = followed.is_some();
        if !goes_on {
            // That of another camera, if any.
            journal::remove(folder).map_err(|e| why(&e))?;
            depth_log::remove(folder).map_err(|e| why(&e))?;
        }
        let (engine, notes) = followed.map_or_else(|| begin(map), Ok)?;
        let (camera, base) = (*engine.front_end().model(), engine.to_save("cairn", BTreeMap::new()));
        drop(engine);
        if !goes_on && map.is_some() {
            JournalWriter::begin(folder, &base).map_err(|e| why(&e))?;
        }
        let ring_path = ring_in(folder);
        let ring = shared(&ring_path, pixels::slot_bytes(rig)).map_err(|e| why(&e))?;
        let rig = cairn_sources::write_rig(rig).map_err(|e| why(&e))?;
        let (to, events) = channel();
        let launch = Launch {
            command,
            folder: folder.to_owned(),
            ring: ring_path,
            opened: Opened { name, frames: None, rate_hz, rig, sensor: sensor_name(mode, imu) },
            config,
            surfaces: dense.then_some(SurfaceInput::Depth),
        };
        let mut remote = Self {
            launch,
            tell,
            dense: None,
            events,
            to,
            worker: Worker::new(),
            looked: Instant::now(),
            starts: first_start(folder).map_err(|e| why(&e))?,
            began: Instant::now(),
            camera,
            map: FollowedMap::new(base),
            status: Status::default(),
            frames: Frames::new(ring),
            away: None,
            recovering: None,
            given_up: false,
        };
        remote.start();
        while !remote.worker.ready && !remote.given_up {
            let waited = remote.events.recv_timeout(Duration::from_millis(20));
            waited.into_iter().for_each(|event| remote.event(event));
            remote.look();
        }
        match remote.away.take().filter(|_| remote.given_up) {
            Some(why) => Err(OpenMapError::Process(why)),
            None => Ok((remote, notes)),
        }
    }

    fn start(&mut self) {
        self.starts += 1;
        let (role, start) = (Role::Slam, self.starts);
        let started = Process::start((self.launch.command)(role), role, start, self.to.clone());
        let process = match started {
            Ok(process) => process,
            Err(e) => return self.fails(format!("the process for slam cannot be started: {e}")),
        };
        process.order(self.launch.order(start));
        (self.tell)(RunEvent::Started { role, id: process.id() });
        self.worker.started(process, start);
    }

    fn event(&mut self, event: Event) {
        if event.start != self.worker.start || self.worker.process.is_none() {
            return;
        }
        match event.kind {
            EventKind::Said(report) => {
                self.worker.heard = Instant::now();
                self.report(report);
            }
            EventKind::Closed(why) => self.died(why),
        }
    }

    fn report(&mut self, report: Report) {
        match report {
            Report::Ready { key_frames, .. } => {
                self.worker.ready = true;
                self.away = None;
                self.follow();
                if let Some((died, ..)) = self.recovering {
                    (self.tell)(RunEvent::Resumed { key_frames, after_s: died.elapsed().as_secs_f64() });
                }
            }
            Report::Tracked(tracked) => {
                let is_new = self.frames.answered(tracked);
                if is_new {
                    self.worker.progress = true;
                    self.worker.backoff.calm();
                    self.away = None;
                }
            }
            Report::Failed(Failure { what, why, cure }) => {
                self.died(Some(format!("{what}: {why}; {cure}")));
            }
            Report::NoSurfaces(why) => (self.tell)(RunEvent::NoSurfaces(&why)),
            _ => {}
        }
    }

    /// Takes what has come, pings, and starts again what died or hangs.
    fn look(&mut self) {
        // Nobody looked for a while, before the first packet or while this process was stopped: it had no chance to answer.
        if self.looked.elapsed() > Duration::from_secs(1) {
            self.worker.heard = Instant::now();
        }
        self.looked = Instant::now();
        while let Ok(event) = self.events.try_recv() {
            self.event(event);
        }
        if self.worker.take_due() {
            self.start();
        }
        self.worker.ping();
        let limit = if self.worker.ready { HANG_LIMIT } else { BEGIN_LIMIT };
        if self.worker.process.is_some() && self.worker.heard.elapsed() > limit {
            let why = format!("it did not answer for {:.1} s and was killed", limit.as_secs_f64());
            self.died(Some(why));
        }
    }

    /// The process has ended, or is ended here for the reason `why`.
    fn died(&mut self, why: Option<String>) {
        let Some(process) = self.worker.process.take() else { return };
        let status = process.end();
        let how = why.unwrap_or(status);
        let role = Role::Slam;
        let (at_frame, t_s) = (self.frames.next, self.began.elapsed().as_secs_f64());
        (self.tell)(RunEvent::Died(&Death { role, how: how.clone(), at_frame, t_s }));
        self.worker.ready = false;
        self.frames.died();
        self.recovering.get_or_insert((Instant::now(), 0, Instant::now()));
        self.away = Some(format!("SLAM is started again: {how}"));
        let had_done_work = self.worker.has_done_work();
        match self.worker.backoff.after_death(had_done_work) {
            Some(delay) => {
                if !delay.is_zero() {
                    let times = self.worker.backoff.times();
                    (self.tell)(RunEvent::Waits { role, delay_s: delay.as_secs_f64(), times });
                }
                self.worker.due = Some(Instant::now() + delay);
                if delay.is_zero() {
                    self.look();
                }
            }
            None => {
                (self.tell)(RunEvent::GivenUp { role });
                self.fails(format!("SLAM died {} times in a row: {how}", self.worker.backoff.times()));
            }
        }
    }

    /// For good.
    fn fails(&mut self, why: String) {
        (self.given_up, self.away) = (true, Some(why));
    }

    /// Reads what SLAM has written since.
    fn follow(&mut self) {
        if let Err(e) = self.map.follow(&self.launch.folder) {
            self.fails(format!("the journal of the map: {e}"));
        }
    }

    fn not_tracked(&mut self) -> NotTracked {
        if let Some((_, frames, _)) = &mut self.recovering {
            *frames += 1;
        }
        NotTracked::Away(self.away.clone().unwrap_or_default())
    }

    fn output(&mut self, tracked: &Tracked) -> Result<Output, NotTracked> {
        self.follow();
        let refused = |why: &str| NotTracked::Refused(why.to_owned());
        let Some(seen) = &tracked.seen else { return Err(refused(&format!("{:?}", tracked.outcome))) };
        let output = seen.to_output(Stamp(tracked.stamp)).ok_or_else(|| refused("a pose is none"))?;
        self.status = output.status.clone();
        match &mut self.recovering {
            Some((died, frames, resumed)) if output.pose.is_some() => {
                let (frames, after_s) = (*frames, died.elapsed().as_secs_f64());
                let resumed_s = resumed.elapsed().as_secs_f64();
                (self.tell)(RunEvent::Relocalised { frames, after_s, resumed_s });
                self.recovering = None;
            }
            Some((_, frames, _)) => *frames += 1,
            None => {}
        }
        Ok(output)
    }
}

impl Slam for RemoteSlam {
    fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked> {
        self.look();
        if self.away.is_some() || self.frames.in_hand() {
            self.frames.keep_readings(packet);
            return Err(self.not_tracked());
        }
        let frame = self.frames.give(packet)?;
        self.worker.order(Order::Frame(frame));
        let late = Instant::now() + LATE;
        while self.frames.in_hand() {
            let left = late.saturating_duration_since(Instant::now());
            match self.events.recv_timeout(left) {
                Ok(event) => self.event(event),
                Err(_) => {
                    self.away = Some("SLAM is late".into());
                    return Err(self.not_tracked());
                }
            }
        }
        match self.frames.take_answer() {
            Some(tracked) => self.output(&tracked),
            None => Err(self.not_tracked()),
        }
    }

    fn look_after(&mut self) {
        self.look();
        // An answer that came late tells nothing of now but that SLAM lives.
        self.frames.take_answer();
    }

    fn end(&mut self) {
        // Its process is killed, and none is due any more.
        self.worker = Worker::new();
        self.dense = None;
        // Else the next would begin in this map.
        let removed = journal::remove(&self.launch.folder);
        self.fails(removed.err().map_or_else(|| "ended".into(), |e| e.to_string()));
    }

    fn away(&self) -> Option<&str> {
        self.away.as_deref()
    }

    fn snapshot(&self) -> Arc<Snapshot> {
        self.map.snapshot.clone()
    }

    fn camera(&self) -> &RectifiedCamera {
        &self.camera
    }

    fn status(&self) -> &Status {
        &self.status
    }

    fn surfaces(&mut self, rig: &Rig, _: SubmapConfig) -> Result<Surfaces, DenseSetupError> {
        if rig.depth.is_none() || !self.launch.opened.sensor.starts_with("rgbd") {
            return Err(DenseSetupError::NoDepth);
        }
        let Launch { command, folder, ring, opened, .. } = &self.launch;
        let (ring, folder, command, tell) =
            (ring.clone(), folder.clone(), command.clone(), self.tell.clone());
        let wanted = Arc::new(DepthWanted::default());
        let begun = RemoteDense::begin(ring, folder, opened.clone(), command, tell, wanted.clone());
        let (dense, changes) = begun.map_err(|_| DenseSetupError::NoMapping)?;
        self.dense = Some(dense);
        Ok(Surfaces::Elsewhere { changes, wanted })
    }

    fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        self.map.to_save(program, attached)
    }
}

/// The ring of a run: that of a session before this one, where its frames are as large.
fn shared(path: &Path, slot_bytes: u64) -> Result<Ring, crate::ring::RingError> {
    match Ring::open(path) {
        Ok(ring) if ring.slot_bytes() == slot_bytes => Ok(ring),
        _ => Ring::create(path, capture::SLOTS, slot_bytes),
    }
}

/// How many processes the sessions of a run have started before this one, so that no segment of odometry has the number
/// of another: kept in the folder, in steps, as a file that is replaced at each session.
fn first_start(folder: &Path) -> std::io::Result<u64> {
    const STEP: u64 = 100;
    let path = folder.join("sessions");
    let sessions: u64 =
        std::fs::read_to_string(&path).ok().and_then(|text| text.trim().parse().ok()).unwrap_or(0);
    std::fs::write(&path, (sessions + 1).to_string())?;
    Ok(sessions * STEP)
}
