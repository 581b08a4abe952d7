//! The whole system on one page: what happens to a packet.

use crate::Config;
use crate::depth_link::Link;
use crate::digest::Digest;
use crate::journal::{FrameRecord, Header, Journal, ReplayError};
use crate::log::{Log, Logged};
use crate::mapping::{Done, Mapping, Replayed, Runner};
use crate::output::{Finished, Output};
use crate::scale::{Scale, is_adrift, map_of, scale_of};
use crate::sensors::has_colours;
use crate::status::{FrameResult, Status, StatusTracker};
use cairn_atlas::{KeyFrameId, Readout, Snapshot, Subscription};
use cairn_geometry::{Body, Pose, Se3, World};
use cairn_mapping::{Closer, DepthViews, Mapper, ScaleVerdict};
use cairn_sensor::{FramePacket, Rig, RigError, Stamp};
use cairn_tracking::{AnchoredPose, KeyFrameRequest, MeasuredMotion, State, Tracked, Tracker};
use cairn_vision::{Frame, FrontEnd, FrontEndError, SensorMode};
use nalgebra::SMatrix;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// The engine: packets in, poses and a map out.
pub struct Engine {
    front_end: FrontEnd,
    tracker: Tracker,
    mapping: Mapping,
    pub(crate) mode: SensorMode,
    /// Whether the first camera shows the pixels of the depth.
    has_colours: bool,
    /// True where the map must stay unchanged.
    pub(crate) localize_only: bool,
    /// The journal header, except for the source and the map.
    header: Header,
    log: Log,
    status_tracker: StatusTracker,
    /// Whether the IMU contradicts the scale of the map at present.
    scale_contradicted: bool,
    stage_failed: Option<String>,
    /// Where a search by depth finds a lost camera, if a dense mapper looks for it.
    depth_link: Option<Link>,
    /// Takes the depth of key frames, where there is a depth sensor.
    depth_views: Option<DepthViews>,
    pub(crate) find_by_depth_s: f64,
}

impl Engine {
    /// An engine without a map, for packets at about `rate_hz`.
    ///
    /// # Errors
    ///
    /// [`RigError`] when the rig cannot serve the mode.
    pub fn new(
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
    ) -> Result<Self, RigError> {
        let front_end = FrontEnd::new(rig, mode, config.front_end_for(rig))?;
        let snapshot = Snapshot::with_octaves(front_end.octaves());
        Ok(Self::around(front_end, snapshot, rig, mode, rate_hz, runner, config))
    }

    /// The stages around a front end and a map.
    pub(crate) fn around(
        front_end: FrontEnd,
        snapshot: Snapshot,
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
    ) -> Self {
        let model = *front_end.model();
        let mut snapshot = snapshot.continued_by(config.robot);
        // Opened and checked before the first image rather than at it.
        cairn_vision::bow::Vocabulary::current();
        let size = rig.cameras.first().map_or([0; 2], |c| [c.camera.width, c.camera.height]);
        let features = config.front_end_for(rig).orb.features;
        let tracker = Tracker::new(model, features, rate_hz, config.tracker).with_size(size);
        let depth = rig.depth.as_ref().filter(|_| mode == SensorMode::Rgbd);
        let depth = depth.map(|sensor| (sensor, model.body_from_camera.inverse() * sensor.body_from_depth));
        let tracker = match depth {
            Some((sensor, camera_from_depth)) => tracker.with_depth(sensor, camera_from_depth),
            None => tracker,
        };
        let mut mapper = config.mapper;
        if mode != SensorMode::Stereo {
            mapper.window.right_offset_sigma = 0.0;
        }
        mapper.window.hold_poses |= config.tracker.dense && mode == SensorMode::Rgbd;
        // Poses that stay where depth put them are not aligned again.
        let aligned = depth.filter(|_| !mapper.window.hold_poses);
        let closer = Closer::new(model, config.closer, mapper.window);
        let (mut tracker, mut mapper) = (tracker, Mapper::new(model, mapper));
        let mut closer = closer.with_motion_links(mapper.motion_links());
        let depth_views =
            aligned.and_then(|(sensor, camera_from_depth)| DepthViews::new(sensor, camera_from_depth));
        if let Some(views) = &depth_views {
            mapper = mapper.with_depth_views(views.clone());
            closer = closer.with_depth_views(views.clone());
        }
        let imu = rig.imu.as_ref().filter(|_| config.inertial.enabled);
        let status_tracker =
            StatusTracker::new(model.has_depth(), imu.map(|imu| 1.0 / imu.rate_hz), &snapshot);
        if let Some(imu) = imu {
            let (imu_from_camera, inertial) =
                (imu.body_from_imu.inverse() * model.body_from_camera, config.inertial);
            tracker = tracker.with_imu(imu, imu_from_camera, inertial.noise_times);
            mapper = mapper.with_imu(imu, imu_from_camera, inertial);
            closer = closer.with_imu(imu, imu_from_camera, inertial);
            snapshot = snapshot.with_imu_from_camera(imu_from_camera);
        }
        let header = Header::of(mode, rate_hz, rig, config);
        let mapping = Mapping::new(runner, mapper, closer, snapshot);
        Self {
            front_end,
            tracker,
            mapping,
            mode,
            has_colours: has_colours(rig),
            localize_only: false,
            header,
            log: Log::default(),
            status_tracker,
            scale_contradicted: false,
            stage_failed: None,
            depth_link: None,
            depth_views,
            find_by_depth_s: config.tracker.find_by_depth_s,
        }
    }

    /// In a map that another engine made until a moment ago, of the same camera: it is looked for where it was then, before any
    /// other place. To be called before the first packet, with its stamp.
    pub fn resume(&mut self, now: Stamp) {
        self.tracker.resume(&self.mapping.latest(), now);
    }

    /// The link to the search by depth.
    pub(crate) fn depth_link(&mut self) -> Link {
        self.depth_link.get_or_insert_default().clone()
    }

    /// Whether mapping runs on threads.
    pub(crate) fn is_threaded(&self) -> bool {
        matches!(self.mapping, Mapping::Thread(_))
    }

    /// Tells tracking where a search by depth has found the camera; whether it has.
    fn pass_on_found(&mut self) -> bool {
        let found = self.depth_link.as_ref().and_then(|link| link.lock().found.take());
        let is_found = found.is_some();
        if let Some(found) = found {
            self.tracker.found_by_depth(found);
        }
        is_found
    }

    /// Tells the search by depth what came of the place it found, and what it has to know of gravity.
    fn tell_search(&self, frame: &Frame, tracked: &Tracked, was_told: bool, snapshot: &Snapshot) {
        let Some(link) = &self.depth_link else { return };
        let is_lost = matches!(tracked.state, State::Lost { .. });
        if !was_told && !is_lost {
            return;
        }
        let mut shared = link.lock();
        shared.taken[usize::from(is_lost)] += usize::from(was_told);
        shared.up = self.tracker.up(tracked.stamp);
        shared.is_of_use = self.tracker.may_believe_depth(frame);
        let gravity_aligned =
            snapshot.maps().map(|(map, _)| map).filter(|map| snapshot.is_gravity_aligned(*map));
        shared.gravity_aligned = gravity_aligned.collect();
    }

    /// Tells what other sensors (the wheels of a robot) measured of the motion of the body since the packet before; to be
    /// called before [`Engine::on_packet`] for each packet, and used with depth cameras. It is the first guess and a prior of
    /// the pose, poses that contradict it are not taken, and it carries the pose where too little is seen
    /// ([`State::Coasting`]). A journal does not hold it: a run with measured motions cannot be replayed.
    pub fn motion_measured(&mut self, motion: &MeasuredMotion) {
        self.tracker.motion_measured(Some(motion));
    }

    /// The readout time of the camera's rows (rolling shutter); its standard deviation is zero where it is not estimated.
    pub fn readout(&self) -> Readout {
        self.tracker.readout(&self.snapshot())
    }

    /// Processes one packet: extract features, track, and submit key frames to mapping.
    ///
    /// # Errors
    ///
    /// [`FrontEndError`] when the images of the packet do not fit the rig; the engine can go on with the next
    /// packet.
    pub fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, FrontEndError> {
        let start = Instant::now();
        let extracted = self.front_end.extract(packet);
        let frame = extracted
            .inspect_err(|e| self.status_tracker.refuse(packet.stamp, &packet.imu, e.to_string()))?;
        let frame = Arc::new(frame);
        let extract_ms = start.elapsed().as_secs_f64() * 1e3;
        let mut done = Done::default();
        let (snapshot, idle) = self.mapping.snapshot_for(packet.stamp, &mut done);
        let version = snapshot.version();
        let tracking_start = Instant::now();
        let gray = packet.images.first().filter(|_| self.has_colours).cloned();
        self.tracker.depth_seen(packet.depth.clone(), gray);
        let was_told = self.pass_on_found();
        let mut tracked = self.tracker.step(frame.clone(), &packet.imu, &snapshot, idle, !self.localize_only);
        self.tell_search(&frame, &tracked, was_told, &snapshot);
        // In the snapshot used for tracking: mapping may gravity-align and scale the map before this frame is
        // reported.
        let gravity_aligned = tracked
            .pose
            .and_then(|p| map_of(&snapshot, p.reference))
            .is_some_and(|w| snapshot.is_gravity_aligned(w));
        drop(snapshot);
        let track_ms = tracking_start.elapsed().as_secs_f64() * 1e3;
        let mut digest = Digest::default();
        for (stamp, anchored) in tracked.earlier.drain(..) {
            digest.anchored(Some(&anchored));
            self.log.amend(stamp, anchored);
        }
        let key_frame_requested = tracked.request.is_some() && !self.localize_only;
        if let (Some(views), Some(depth)) = (&self.depth_views, &packet.depth)
            && key_frame_requested
        {
            views.offer(packet.stamp, depth.clone());
        }
        let map_created = self.submit(&mut tracked, &mut done);
        digest.state(tracked.state);
        digest.anchored(tracked.pose.as_ref());
        let digest = digest.value();
        self.mapping.record_frame(&FrameRecord { stamp: packet.stamp, version, idle, map_created, digest });
        self.mapping.poll(&mut done);
        let snapshot = self.snapshot();
        if let Some(check) = done.scale_check {
            self.scale_contradicted = check.verdict == ScaleVerdict::Contradicted;
        }
        let metric = tracked.pose.is_some() && (gravity_aligned || self.front_end.model().has_depth());
        let scale_supported = tracked.scale_supported;
        self.log.push(Logged {
            stamp: tracked.stamp,
            state: tracked.state,
            anchored: tracked.pose,
            odometry: self.tracker.odometry(),
            metric,
            scale_supported,
        });
        let depth = self.front_end.model().has_depth();
        let scale = tracked
            .pose
            .and_then(|p| map_of(&snapshot, p.reference))
            .map(|map| Scale { metric, ..scale_of(&snapshot, map, depth, scale_supported) })
            .map(|scale| {
                let is_doubtful = self.scale_contradicted || (!depth && is_adrift(&tracked.state));
                Scale { supported: scale.supported && !is_doubtful, ..scale }
            });
        let unreadable = || snapshot.read_fault().map(|fault| format!("the map cannot be read: {fault}"));
        let stage_failed = done.stage_failed.or_else(unreadable).filter(|_| self.stage_failed.is_none());
        self.stage_failed = self.stage_failed.take().or_else(|| stage_failed.clone());
        self.status_tracker.update(&FrameResult {
            stamp: tracked.stamp,
            imu: &packet.imu,
            imu_fault: self.tracker.imu_fault(),
            state: tracked.state,
            map: tracked
                .pose
                .and_then(|p| map_of(&snapshot, p.reference))
                .map(|w| (w, snapshot.is_gravity_aligned(w))),
            metric,
            map_created: map_created.is_some(),
            others: snapshot.maps().nth(1).is_some(),
            points: tracked.evidence.inliers,
            attempt: done.attempt.as_ref(),
            scale_check: done.scale_check,
            verdicts: &done.verdicts,
            stage_failed: self.stage_failed.as_deref(),
            mapping: !self.localize_only,
        });
        Ok(Output {
            stamp: tracked.stamp,
            frame,
            state: tracked.state,
            world_from_body: tracked.pose.map(|p| self.body(&p.world_from_camera, metric)),
            odometry: self.tracker.odometry(),
            metric,
            scale,
            attempt: done.attempt,
            scale_check: done.scale_check,
            anchored: tracked.pose,
            covariance: tracked.covariance,
            evidence: tracked.evidence,
            key_frame_requested,
            extract_ms,
            track_ms,
            map_ms: done.ms,
            close_ms: done.close_ms,
            verdicts: done.verdicts,
            stage_failed,
            status: self.status_tracker.status().clone(),
        })
    }

    /// Submits the tracking result to mapping; when a map is created, the frame gets its pose from it.
    /// Returns the version of the map after that.
    fn submit(&mut self, tracked: &mut Tracked, done: &mut Done) -> Option<u64> {
        if self.localize_only {
            return None;
        }
        if !tracked.seen.is_empty() {
            self.mapping.note(std::mem::take(&mut tracked.seen));
        }
        let request = tracked.request.take()?;
        let earlier = match &request {
            KeyFrameRequest::Pair { first, .. } => Some(first.clone()),
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
        if let (Some(first), Some(anchored)) = (earlier, root) {
            self.log.amend(first.stamp, anchored);
        }
        Some(snapshot.version())
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
        self.status_tracker.status()
    }

    /// The results of all frames.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// A flag that ends long work early once it is set: adjustments of whole maps, the final one too, are left without
    /// changes. For a user who does not want to wait; a journal then lacks its end.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        self.mapping.stop().clone()
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
        self.stage_failed = self.stage_failed.take().or(done.stage_failed);
        Finished { map_ms: done.ms, close_ms: done.close_ms, verdicts: done.verdicts }
    }
}

/// The pose of a key frame, anchored to itself.
fn at_key_frame(snapshot: &Snapshot, id: KeyFrameId) -> Option<AnchoredPose> {
    Some(AnchoredPose::at(id, snapshot.world_from_camera(id)?))
}
