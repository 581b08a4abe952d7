//! The whole system on one page: what happens to a packet.

use crate::depth_link::Link;
use crate::digest::Digest;
use crate::journal::{Header, Journal, ReplayError};
use crate::log::Log;
use crate::mapping::{Done, Mapping, Replayed};
use crate::observers::{DoneFrame, Observer, Observers, TrackedFrame, TrackingInput};
use crate::output::{Finished, FramePose, Output, StageEvent, Timings};
use crate::scale::{Scale, map_of, scale_of};
use crate::status::Status;
use cairn_atlas::{KeyFrameId, MapId, Readout, Snapshot, Subscription};
use cairn_geometry::{Body, Pose, Se3, World};
use cairn_sensor::{FramePacket, Host, Stamp};
use cairn_tracking::{
    AnchoredPose, HintOutcome, KeyFrameRequest, MeasuredMotion, PlaceHint, State, Tracked, Tracker,
};
use cairn_vision::{Frame, FrontEnd, FrontEndError, Misregistration, RegistrationCheck, SensorMode};
use nalgebra::SMatrix;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The engine: packets in, poses and a map out.
pub struct Engine {
    pub(crate) front_end: FrontEnd,
    pub(crate) tracker: Tracker,
    pub(crate) mapping: Mapping,
    pub(crate) observers: Observers,
    pub(crate) mode: SensorMode,
    /// Whether the first camera shows the pixels of the depth.
    pub(crate) has_colours: bool,
    /// Looks whether it does, where poses are by features and the rig says so.
    pub(crate) registration: Option<RegistrationCheck>,
    /// True where the map must stay unchanged.
    pub(crate) localize_only: bool,
    pub(crate) find_by_depth_s: f64,
    /// The journal header, except for the source and the map.
    pub(crate) header: Header,
    pub(crate) host: Host,
}

/// A frame between tracking and its output.
struct Step {
    tracked: Tracked,
    input: TrackingInput,
    /// Whether the map of the pose was in metres when the frame was tracked in it: mapping may gravity-align and scale it before
    /// the frame is reported.
    is_metric: bool,
    key_frame_requested: bool,
    extract_ms: f64,
    track_ms: f64,
}

/// The map that a frame began.
struct Creation {
    version: u64,
    /// The first frame of the pair that began it.
    first: Option<(Stamp, AnchoredPose)>,
}

impl Engine {
    /// Processes one packet: extract features, track, submit key frames to mapping, and tell who observes frames.
    ///
    /// # Errors
    ///
    /// [`FrontEndError`] when the images of the packet do not fit the rig; the engine can go on with the next
    /// packet.
    pub fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, FrontEndError> {
        let begin = self.host.clock.now();
        let extracted = self.front_end.extract(packet);
        let frame = extracted.inspect_err(|e| self.observers.refused(packet, &e.to_string()))?;
        let frame = Arc::new(frame);
        let extract_ms = self.host.clock.ms_since(begin);
        let found = self.check_depth(packet);
        let mut done = Done::default();
        let mut step = Step { extract_ms, ..self.track(packet, &frame, &mut done) };
        let created = self.submit(&mut step.tracked, &mut done);
        self.mapping.poll(&mut done);
        let mut output = self.observe(packet, frame, step, created, done);
        output.events.extend(found.map(StageEvent::Misregistered));
        Ok(output)
    }

    /// Takes poses from depth once it is certain that depths at features are those of other points: by what the packets show, so that
    /// whoever gives them gets the same poses. In a map that stays as it is features tell where the camera is, and the next depth would go
    /// on from there (the halves of the kitchen: 0.080 m by features, 0.092 by depth).
    fn check_depth(&mut self, packet: &FramePacket) -> Option<Misregistration> {
        if self.localize_only {
            return None;
        }
        let found = self.registration.as_mut()?.packet(packet)?;
        self.tracker.take_poses_from_depth();
        self.observers.depth_views = None;
        Some(found)
    }

    /// Tracks a frame in the map as it is.
    fn track(&mut self, packet: &FramePacket, frame: &Arc<Frame>, done: &mut Done) -> Step {
        let (snapshot, idle) = self.mapping.snapshot_for(packet.stamp, done);
        let begin = self.host.clock.now();
        let gray = packet.images.first().filter(|_| self.has_colours).cloned();
        self.tracker.depth_seen(packet.depth.clone(), gray);
        if let Some(found) = self.observers.search.found() {
            self.tracker.found_by_depth(found);
        }
        let tracked = self.tracker.step(frame.clone(), &packet.imu, &snapshot, idle, !self.localize_only);
        let map = tracked.pose.and_then(|p| map_of(&snapshot, p.reference));
        let key_frame_requested = tracked.request.is_some() && !self.localize_only;
        self.observers.tracked(&TrackedFrame {
            packet,
            frame,
            tracked: &tracked,
            tracker: &self.tracker,
            snapshot: &snapshot,
            key_frame_requested,
        });
        Step {
            input: TrackingInput { version: snapshot.version(), idle },
            is_metric: self.has_depth() || map.is_some_and(|map| snapshot.is_gravity_aligned(map)),
            tracked,
            key_frame_requested,
            extract_ms: 0.0,
            track_ms: self.host.clock.ms_since(begin),
        }
    }

    /// Submits the result of tracking to mapping; when a map is created, the frame gets its pose from it.
    fn submit(&mut self, tracked: &mut Tracked, done: &mut Done) -> Option<Creation> {
        if self.localize_only {
            return None;
        }
        if !tracked.seen.is_empty() {
            self.mapping.note(std::mem::take(&mut tracked.seen));
        }
        let request = tracked.request.take()?;
        let earlier = match &request {
            KeyFrameRequest::Pair { first, .. } => Some(first.stamp),
            _ => None,
        };
        let starting = !matches!(request, KeyFrameRequest::Next { .. });
        let id = self.mapping.submit(request, done).filter(|_| starting)?;
        let snapshot = self.mapping.after_start(done);
        self.tracker.map_created(&snapshot, id);
        tracked.pose = at_key_frame(&snapshot, id);
        tracked.covariance = Some(SMatrix::zeros());
        tracked.state = State::Tracking;
        let root = snapshot.key_frame(id).and_then(|k| at_key_frame(&snapshot, k.map.root()));
        Some(Creation { version: snapshot.version(), first: earlier.zip(root) })
    }

    /// Tells the observers of a frame, and what the packet has brought.
    fn observe(
        &mut self,
        packet: &FramePacket,
        frame: Arc<Frame>,
        step: Step,
        created: Option<Creation>,
        done: Done,
    ) -> Output {
        let snapshot = self.snapshot();
        let Step { tracked, input, is_metric, key_frame_requested, extract_ms, track_ms } = step;
        let map = tracked.pose.and_then(|p| map_of(&snapshot, p.reference));
        let stage_failed = done.stage_failed.clone();
        let (events, timings) = done.report();
        let mut output = Output {
            stamp: tracked.stamp,
            frame,
            state: tracked.state,
            pose: map.and_then(|map| self.pose(&tracked, is_metric, &snapshot, map)),
            evidence: tracked.evidence,
            key_frame_requested,
            events,
            timings: Timings { extract_ms, track_ms, ..timings },
            status: Status::default(),
        };
        let mut context = DoneFrame {
            packet,
            input,
            earlier: tracked.earlier,
            map_created: created.as_ref().map(|created| created.version),
            first_of_pair: created.and_then(|created| created.first),
            snapshot: &snapshot,
            map,
            scale_supported: tracked.scale_supported,
            stage_failed,
            mapping: &mut self.mapping,
        };
        self.observers.done(&mut context, &mut output);
        output
    }

    /// The pose of a frame, with what the latest map knows of its unit of length.
    fn pose(&self, tracked: &Tracked, metric: bool, snapshot: &Snapshot, map: MapId) -> Option<FramePose> {
        let anchored = tracked.pose?;
        Some(FramePose {
            world_from_body: self.body(&anchored.world_from_camera, metric),
            odometry: self.tracker.odometry()?,
            anchored,
            covariance: tracked.covariance,
            scale: Scale { metric, ..scale_of(snapshot, map, self.has_depth(), tracked.scale_supported) },
        })
    }

    /// Waits for mapping to finish its work and runs the final bundle adjustment; call at the end of a run,
    /// before [`Engine::trajectory`]. Returns the work finished meanwhile.
    pub fn finish(&mut self) -> Finished {
        let mut done = Done::default();
        if !self.localize_only {
            self.mapping.finish(&mut done);
        }
        let snapshot = self.mapping.latest();
        let mut digest = Digest::default();
        digest.snapshot(&snapshot);
        if !self.mapping.stop().load(Ordering::Relaxed) {
            self.mapping.record_end(snapshot.version(), digest.value());
        }
        let failed = done.stage_failed.clone();
        failed.iter().for_each(|why| self.observers.failed(why));
        let (mut events, timings) = done.report();
        events.extend(failed.map(StageEvent::Failed));
        Finished { events, timings }
    }
}

/// What else is done with an engine.
impl Engine {
    /// In a map that another engine made until a moment ago, of the same camera: it is looked for where it was then, before any
    /// other place. To be called before the first packet, with its stamp.
    pub fn resume(&mut self, now: Stamp) {
        self.tracker.resume(&self.mapping.latest(), now);
    }

    /// Tells what other sensors (the wheels of a robot) measured of the motion of the body since the packet before; to be
    /// called before [`Engine::on_packet`] for each packet, and used with depth cameras. It is the first guess and a prior of
    /// the pose, poses that contradict it are not taken, and it carries the pose where too little is seen
    /// ([`State::Coasting`]). A journal does not hold it: a run with measured motions cannot be replayed.
    pub fn motion_measured(&mut self, motion: &MeasuredMotion) {
        self.tracker.motion_measured(Some(motion));
    }

    /// Where the camera is said to be, in place of an earlier hint: it is looked for there from the next packet on, and no image
    /// that shows another place is believed, until one confirms the hint or some seconds have passed. A journal does not hold it: a
    /// run with hints cannot be replayed.
    pub fn hint(&mut self, hint: PlaceHint) {
        self.tracker.hint(hint);
    }

    /// What has become of the last hint; `None` where there was none.
    pub fn hint_outcome(&self) -> Option<HintOutcome> {
        self.tracker.hint_outcome()
    }

    /// The readout time of the camera's rows (rolling shutter); its standard deviation is zero where it is not estimated.
    pub fn readout(&self) -> Readout {
        self.tracker.readout(&self.snapshot())
    }

    /// The link to a search by depth.
    pub(crate) fn depth_link(&mut self) -> Link {
        self.observers.search.link()
    }

    /// Whether the camera measures depth.
    pub(crate) fn has_depth(&self) -> bool {
        self.front_end.model().has_depth()
    }

    /// Does the next slice of mapping and closing where they run in slices ([`Runner::Sliced`](crate::Runner::Sliced)): a few
    /// milliseconds of a desktop's processor. To be called between packets while it returns true; false when there was nothing to do.
    pub fn work(&mut self) -> bool {
        self.mapping.work()
    }

    /// The stream of all map changes from now on, every commit in order; `None` when mapping has failed.
    /// Where mapping runs on a thread, this waits for the work it has in hand.
    pub fn subscribe(&mut self) -> Option<Subscription> {
        self.mapping.subscribe()
    }

    /// Writes into `to`, from the first packet on, what is needed to reproduce the poses of this run bit for
    /// bit; `source` names where the packets come from. In lockstep nothing is written: a second run is
    /// identical anyway.
    pub fn write_journal(&self, source: &str, to: Box<dyn Write + Send>) {
        self.mapping.write_journal(to, &self.header_for(source));
    }

    /// Why the journal is incomplete, if so.
    pub fn journal_failed(&self) -> Option<String> {
        self.mapping.journal_failed()
    }

    /// Replays a journal in an engine made for lockstep that has not processed a packet yet. Feed it the
    /// packets whose stamps are in the journal.
    ///
    /// # Errors
    /// [`ReplayError`] when source, sensors, configuration or map are not those of the journal, or when the engine is not
    /// in lockstep.
    pub fn replay(self, source: &str, journal: Journal) -> Result<Self, ReplayError> {
        if let Some(why) = journal.header.differs(&self.header_for(source)) {
            return Err(ReplayError::Differs(why));
        }
        let mapping = self.mapping.replay(journal).ok_or(ReplayError::NotLockstep)?;
        Ok(Self { mapping, ..self })
    }

    /// Progress of a replay; `None` where there is none.
    pub fn replayed(&self) -> Option<&Replayed> {
        self.mapping.replayed()
    }

    fn header_for(&self, source: &str) -> Header {
        self.header.with(source, self.localize_only, &self.mapping.latest())
    }

    /// The body's pose.
    pub(crate) fn body(&self, world_from_camera: &Se3, metric: bool) -> Pose<World, Body> {
        Pose::new(self.front_end.model().world_from_body(world_from_camera, metric))
    }

    /// Whether lengths in all maps are metres: the camera has depth, or the IMU has been initialised.
    pub fn is_metric(&self) -> bool {
        self.snapshot().is_metric(self.front_end.model())
    }

    /// The latest snapshot.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.mapping.latest()
    }

    /// The front end.
    pub fn front_end(&self) -> &FrontEnd {
        &self.front_end
    }

    /// The status after the last packet, for people.
    pub fn status(&self) -> &Status {
        self.observers.status.status()
    }

    /// The results of all frames.
    pub fn log(&self) -> &Log {
        &self.observers.log
    }

    /// A flag that ends long work early once it is set: adjustments of whole maps, the final one too, are left without
    /// changes. For a user who does not want to wait; a journal then lacks its end.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        self.mapping.stop().clone()
    }
}

/// The pose of a key frame, anchored to itself.
fn at_key_frame(snapshot: &Snapshot, id: KeyFrameId) -> Option<AnchoredPose> {
    Some(AnchoredPose::at(id, snapshot.world_from_camera(id)?))
}
