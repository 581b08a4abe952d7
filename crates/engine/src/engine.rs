//! The whole system on one page: what happens to a packet.

use crate::Config;
use crate::digest::Digest;
use crate::journal::{FrameRecord, Header, Journal};
use crate::log::{Log, Logged};
use crate::mapping::{Done, Mapping, Replayed, Runner};
use crate::status::{Seen, Status, Watch};
use cairn_atlas::{KeyFrameId, Map, Subscription, WorldId};
use cairn_geometry::{Body, Pose, Se3, Vec3, World};
use cairn_inertial::Attempt;
use cairn_mapping::{Closer, Mapper, Verdict};
use cairn_sensor::{FramePacket, Rig, RigError, Stamp};
use cairn_tracking::{Evidence, Offer, Placed, State, Tracked, Tracker};
use cairn_vision::{Eye, Frame, SeeError, SensorMode};
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

/// The engine: packets in, poses and a map out.
pub struct Engine {
    eye: Eye,
    tracker: Tracker,
    mapping: Mapping,
    pub(crate) mode: SensorMode,
    /// True where the map is only looked at.
    pub(crate) localize_only: bool,
    /// All but the source and the map of what a journal belongs to.
    header: Header,
    log: Log,
    watch: Watch,
    died: Option<String>,
}

/// What became of a packet.
#[derive(Clone, Debug)]
pub struct Output {
    /// Time of the packet.
    pub stamp: Stamp,
    /// What the eye saw.
    pub frame: Arc<Frame>,
    /// Where tracking stands.
    pub state: State,
    /// Where the body is, when that is known.
    pub world_from_body: Option<Pose<World, Body>>,
    /// The same, hanging on a key frame (of the eye, not of the body).
    pub placed: Option<Placed>,
    /// Whether lengths are metres where it is: always with depth, else once the inertial sensor has told.
    pub metric: bool,
    /// How gravity, scale and biases were sought last, where they were.
    pub attempt: Option<Attempt>,
    /// What speaks for the pose.
    pub evidence: Evidence,
    /// Milliseconds from the decoded image to features.
    pub see_ms: f64,
    /// Milliseconds from features to the pose.
    pub track_ms: f64,
    /// Milliseconds of each key frame that mapping finished meanwhile.
    pub map_ms: Vec<f64>,
    /// Milliseconds of each key frame in closing, and of each adjustment of a whole world.
    pub close_ms: Vec<f64>,
    /// What closing said of places that may have been seen before.
    pub verdicts: Vec<Verdict>,
    /// Why mapping died, once; tracking goes on with the map there is.
    pub died: Option<String>,
    /// All of it for people.
    pub status: Status,
}

/// What was done after the last packet.
#[derive(Clone, Debug, Default)]
pub struct Finished {
    /// As in [`Output`].
    pub map_ms: Vec<f64>,
    /// As in [`Output`].
    pub close_ms: Vec<f64>,
    /// As in [`Output`].
    pub verdicts: Vec<Verdict>,
}

impl Engine {
    /// An engine without a map, for packets at about `rate_hz`; refuses a rig that can not serve the mode.
    pub fn new(
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
    ) -> Result<Self, RigError> {
        let eye = Eye::new(rig, mode, config.eye_for(rig))?;
        let map = Map::with_octaves(eye.octaves());
        Ok(Self::around(eye, map, rig, mode, rate_hz, runner, config))
    }

    /// The stages around an eye and a map.
    pub(crate) fn around(
        eye: Eye,
        map: Map,
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
    ) -> Self {
        let model = *eye.model();
        // Opened and checked before the first picture rather than at it.
        cairn_vision::bow::Vocabulary::embedded();
        let tracker = Tracker::new(model, config.eye_for(rig).orb.features, rate_hz, config.tracker);
        let mut mapper = config.mapper;
        if mode != SensorMode::Stereo {
            mapper.window.right_offset_sigma = 0.0;
        }
        let closer = Closer::new(model, config.closer, mapper.window);
        let (mut tracker, mut mapper, mut closer) = (tracker, Mapper::new(model, mapper), closer);
        let imu = rig.imu.as_ref().filter(|_| config.inertial.enabled);
        let watch = Watch::new(model.has_depth(), imu.map(|imu| 1.0 / imu.rate_hz), &map);
        if let Some(imu) = imu {
            let (imu_from_eye, felt) = (imu.body_from_imu.inverse() * model.body_from_eye, config.inertial);
            tracker = tracker.feeling(imu, imu_from_eye, felt.noise_times);
            mapper = mapper.feeling(imu, imu_from_eye, felt);
            closer = closer.feeling(imu, imu_from_eye, felt);
        }
        let header = Header::of(mode, rate_hz, rig, config);
        let mapping = Mapping::new(runner, mapper, closer, map);
        Self {
            eye,
            tracker,
            mapping,
            mode,
            localize_only: false,
            header,
            log: Log::default(),
            watch,
            died: None,
        }
    }

    /// Takes one packet: see, track, and hand over what mapping should have.
    pub fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, SeeError> {
        let start = Instant::now();
        let seen = self.eye.see(packet);
        let frame = seen.inspect_err(|e| self.watch.refuse(packet.stamp, &packet.imu, e.to_string()))?;
        let frame = Arc::new(frame);
        let see_ms = start.elapsed().as_secs_f64() * 1e3;
        let mut done = Done::default();
        let (map, idle) = self.mapping.look(packet.stamp, &mut done);
        let version = map.version();
        let seen = Instant::now();
        let mut tracked = self.tracker.step(frame.clone(), &packet.imu, &map, idle, !self.localize_only);
        // In the map by which it was tracked: mapping may level and scale it before this frame is told.
        let level = tracked.pose.and_then(|p| world_of(&map, p.reference)).is_some_and(|w| map.is_level(w));
        drop(map);
        let track_ms = seen.elapsed().as_secs_f64() * 1e3;
        let mut digest = Digest::default();
        for (stamp, placed) in tracked.earlier.drain(..) {
            digest.placed(Some(&placed));
            self.log.amend(stamp, placed);
        }
        let begun = self.hand_over(&mut tracked, &mut done);
        digest.state(tracked.state);
        digest.placed(tracked.pose.as_ref());
        let digest = digest.value();
        self.mapping.tell(&FrameRecord { stamp: packet.stamp, version, idle, begun, digest });
        self.mapping.poll(&mut done);
        let map = self.map();
        let metric = tracked.pose.is_some() && (level || self.eye.model().has_depth());
        self.log.push(Logged { stamp: tracked.stamp, state: tracked.state, placed: tracked.pose, metric });
        let died = done.died.filter(|_| self.died.is_none());
        self.died = self.died.take().or_else(|| died.clone());
        self.watch.see(&Seen {
            stamp: tracked.stamp,
            imu: &packet.imu,
            state: tracked.state,
            world: tracked.pose.and_then(|p| world_of(&map, p.reference)).map(|w| (w, map.is_level(w))),
            metric,
            begun: begun.is_some(),
            beside: map.worlds().nth(1).is_some(),
            points: tracked.evidence.inliers,
            attempt: done.attempt.as_ref(),
            verdicts: &done.verdicts,
            died: self.died.as_deref(),
            mapping: !self.localize_only,
        });
        Ok(Output {
            stamp: tracked.stamp,
            frame,
            state: tracked.state,
            world_from_body: tracked.pose.map(|p| self.body(&p.world_from_eye, metric)),
            metric,
            attempt: done.attempt,
            placed: tracked.pose,
            evidence: tracked.evidence,
            see_ms,
            track_ms,
            map_ms: done.ms,
            close_ms: done.close_ms,
            verdicts: done.verdicts,
            died,
            status: self.watch.status().clone(),
        })
    }

    /// Gives mapping what tracking saw and offers; a start gives the frame its pose. Tells in which version of the map
    /// that was.
    fn hand_over(&mut self, tracked: &mut Tracked, done: &mut Done) -> Option<u64> {
        if self.localize_only {
            return None;
        }
        if !tracked.seen.is_empty() {
            self.mapping.note(std::mem::take(&mut tracked.seen));
        }
        let offer = tracked.offer.take()?;
        let earlier = match &offer {
            Offer::Pair { first, .. } => Some(first.clone()),
            _ => None,
        };
        let starting = !matches!(offer, Offer::Next { .. });
        let id = self.mapping.offer(offer, done).filter(|_| starting)?;
        let map = self.mapping.after_start(done);
        self.tracker.begun(&map, id);
        tracked.pose = standing_at(&map, id);
        tracked.state = State::Tracking;
        let root = map.key_frame(id).and_then(|k| standing_at(&map, k.world.root()));
        if let (Some(first), Some(placed)) = (earlier, root) {
            self.log.amend(first.stamp, placed);
        }
        Some(map.version())
    }

    /// The stream of changes to the map from now on, every commit in order; `None` when mapping has died. Where mapping
    /// has a thread, what it has in hand is waited for.
    pub fn subscribe(&mut self) -> Option<Subscription> {
        self.mapping.subscribe()
    }

    /// Writes into `to`, from the first packet on, what is needed to have the poses of this run again bit for bit;
    /// `source` names where the packets come from. In lockstep nothing is written: there a second run is the same anyway.
    pub fn write_journal(&self, source: &str, to: Box<dyn Write + Send>) {
        self.mapping.write_journal(to, &self.header_for(source));
    }

    /// Why the journal is not whole, if so.
    pub fn journal_failed(&self) -> Option<String> {
        self.mapping.journal_failed()
    }

    /// An engine that has seen nothing yet, made for lockstep, takes the packets whose stamps are in the journal and goes as
    /// the journal says. What the journal belongs to must be the same; else it is told in words.
    pub fn replay(self, source: &str, journal: Journal) -> Result<Self, String> {
        if let Some(why) = journal.header.differs(&self.header_for(source)) {
            return Err(why);
        }
        let mapping = self.mapping.replay(journal).ok_or("a journal is replayed in lockstep")?;
        Ok(Self { mapping, ..self })
    }

    /// How far a replay has come; `None` where there is none.
    pub fn replayed(&self) -> Option<&Replayed> {
        self.mapping.replayed()
    }

    fn header_for(&self, source: &str) -> Header {
        self.header.with(source, self.localize_only, &self.mapping.latest())
    }

    /// A digest of the map and of every frame's pose, as given and as the map sees it now: equal when all bits are.
    pub fn digest(&self) -> u64 {
        let mut digest = Digest::default();
        digest.map(&self.map());
        for frame in self.log.frames() {
            digest.state(frame.state);
            digest.placed(frame.placed.as_ref());
        }
        self.trajectory().iter().for_each(|(_, pose)| digest.pose(pose));
        digest.value()
    }

    /// The body's pose.
    fn body(&self, world_from_eye: &Se3, metric: bool) -> Pose<World, Body> {
        Pose::new(self.eye.model().world_from_body(world_from_eye, metric))
    }

    /// Whether lengths in the whole map are metres: the eyes have depth, or the inertial sensor has told.
    pub fn is_metric(&self) -> bool {
        self.map().is_metric(self.eye.model())
    }

    fn is_metric_at(&self, map: &Map, reference: KeyFrameId) -> bool {
        self.eye.model().has_depth() || world_of(map, reference).is_some_and(|w| map.is_level(w))
    }

    /// True poses of the body as [`Engine::trajectory`] tells them: without metric scale, at the first camera's place.
    pub fn comparable(&self, truth: &[(Stamp, Se3)]) -> Vec<(Stamp, Se3)> {
        let arm = if self.is_metric() { Vec3::zeros() } else { self.eye.model().body_from_eye.translation };
        truth.iter().map(|(t, body)| (*t, Se3::new(body.rotation, *body * arm))).collect()
    }

    /// The latest map.
    pub fn map(&self) -> Arc<Map> {
        self.mapping.latest()
    }

    /// The eye.
    pub fn eye(&self) -> &Eye {
        &self.eye
    }

    /// How it stands after the last packet, for people.
    pub fn status(&self) -> &Status {
        self.watch.status()
    }

    /// What became of every frame.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// Waits for mapping to finish what it has; call at the end of a run, before [`Engine::trajectory`]. Returns what was
    /// done meanwhile.
    pub fn finish(&mut self) -> Finished {
        let mut done = Done::default();
        if !self.localize_only {
            self.mapping.finish(&mut done);
        }
        let map = self.mapping.latest();
        let mut digest = Digest::default();
        digest.map(&map);
        self.mapping.tell_end(map.version(), digest.value());
        self.died = self.died.take().or(done.died);
        Finished { map_ms: done.ms, close_ms: done.close_ms, verdicts: done.verdicts }
    }

    /// Where the body was in every tracked frame, as the map sees it now.
    pub fn trajectory(&self) -> Vec<(Stamp, Se3)> {
        let map = self.mapping.latest();
        let place = |f: &Logged| {
            let p = f.placed?;
            let pose = map.stand(p.reference, &p.reference_from_eye)?;
            Some((f.stamp, self.body(&pose, self.is_metric_at(&map, p.reference)).se3))
        };
        self.log.frames().iter().filter_map(place).collect()
    }

    /// Where the body was as it was told at the time.
    pub fn live_trajectory(&self) -> Vec<(Stamp, Se3)> {
        let place = |f: &Logged| Some((f.stamp, self.body(&f.placed?.world_from_eye, f.metric).se3));
        self.log.frames().iter().filter_map(place).collect()
    }
}

/// The world that a key frame is in, or what became of it.
fn world_of(map: &Map, reference: KeyFrameId) -> Option<WorldId> {
    map.living(reference).and_then(|(id, _)| map.key_frame(id)).map(|k| k.world)
}

/// The pose of an eye that stands where a key frame does.
fn standing_at(map: &Map, id: KeyFrameId) -> Option<Placed> {
    Some(Placed::at(id, map.world_from_eye(id)?))
}
