//! The whole system on one page: what happens to a packet.

use crate::Config;
use crate::log::{Log, Logged};
use crate::mapping::{Done, Mapping, Runner};
use cairn_atlas::{KeyFrameId, Map};
use cairn_geometry::{Body, Pose, Se3, Vec3, World};
use cairn_mapping::{Closer, Mapper, Verdict};
use cairn_sensor::{FramePacket, Rig, RigError, Stamp};
use cairn_tracking::{Evidence, Offer, Placed, State, Tracked, Tracker};
use cairn_vision::{Eye, Frame, SeeError, SensorMode};
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
    log: Log,
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
        let tracker = Tracker::new(model, config.eye_for(rig).orb.features, rate_hz, config.tracker);
        let mut mapper = config.mapper;
        if mode != SensorMode::Stereo {
            mapper.window.right_offset_sigma = 0.0;
        }
        let closer = Closer::new(model, config.closer, mapper.window);
        let mapper = Mapper::new(model, mapper);
        let mapping = Mapping::new(runner, mapper, closer, map);
        Self { eye, tracker, mapping, mode, localize_only: false, log: Log::default(), died: None }
    }

    /// Takes one packet: see, track, and hand over what mapping should have.
    pub fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, SeeError> {
        let start = Instant::now();
        let frame = Arc::new(self.eye.see(packet)?);
        let seen = Instant::now();
        let map = self.mapping.latest();
        let mut tracked = self.tracker.step(frame.clone(), &map, self.mapping.idle(), !self.localize_only);
        drop(map);
        let track_ms = seen.elapsed().as_secs_f64() * 1e3;
        for (stamp, placed) in tracked.earlier.drain(..) {
            self.log.amend(stamp, placed);
        }
        let mut done = Done::default();
        self.hand_over(&mut tracked, &mut done);
        self.mapping.poll(&mut done);
        self.log.push(Logged { stamp: tracked.stamp, state: tracked.state, placed: tracked.pose });
        let died = done.died.filter(|_| self.died.is_none());
        self.died = self.died.take().or_else(|| died.clone());
        Ok(Output {
            stamp: tracked.stamp,
            frame,
            state: tracked.state,
            world_from_body: tracked.pose.map(|p| self.body(&p.world_from_eye)),
            placed: tracked.pose,
            evidence: tracked.evidence,
            see_ms: (seen - start).as_secs_f64() * 1e3,
            track_ms,
            map_ms: done.ms,
            close_ms: done.close_ms,
            verdicts: done.verdicts,
            died,
        })
    }

    /// Gives mapping what tracking saw and offers; a start gives the frame its pose.
    fn hand_over(&mut self, tracked: &mut Tracked, done: &mut Done) {
        if self.localize_only {
            return;
        }
        if !tracked.seen.is_empty() {
            self.mapping.note(std::mem::take(&mut tracked.seen));
        }
        let Some(offer) = tracked.offer.take() else { return };
        let earlier = match &offer {
            Offer::Pair { first, .. } => Some(first.clone()),
            _ => None,
        };
        let starting = !matches!(offer, Offer::Next { .. });
        let Some(id) = self.mapping.offer(offer, done).filter(|_| starting) else { return };
        let map = self.mapping.latest();
        self.tracker.begun(&map, id);
        tracked.pose = standing_at(&map, id);
        tracked.state = State::Tracking;
        let root = map.key_frame(id).and_then(|k| standing_at(&map, k.world.root()));
        if let (Some(first), Some(placed)) = (earlier, root) {
            self.log.amend(first.stamp, placed);
        }
    }

    /// The body's pose. A map without metric scale does not know how far the body is from the eye: there the body is
    /// told where the first camera is, in the body's own orientation.
    fn body(&self, world_from_eye: &Se3) -> Pose<World, Body> {
        let mut eye_from_body = self.eye.model().body_from_eye.inverse();
        if !self.is_metric() {
            eye_from_body.translation = Vec3::zeros();
        }
        Pose::new(*world_from_eye * eye_from_body)
    }

    /// Whether lengths in the map are metres.
    pub fn is_metric(&self) -> bool {
        self.eye.model().baseline_fx > 0.0
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

    /// What became of every frame.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// Waits for mapping to finish what it has; call at the end of a run, before [`Engine::trajectory`]. Returns
    /// the milliseconds of each key frame finished meanwhile.
    pub fn finish(&mut self) -> Vec<f64> {
        let mut done = Done::default();
        if !self.localize_only {
            self.mapping.finish(&mut done);
        }
        self.died = self.died.take().or(done.died);
        done.ms
    }

    /// Where the body was in every tracked frame, as the map sees it now.
    pub fn trajectory(&self) -> Vec<(Stamp, Se3)> {
        let map = self.mapping.latest();
        self.log.corrected(&map).into_iter().map(|(t, p)| (t, self.body(&p).se3)).collect()
    }

    /// Where the body was as it was told at the time.
    pub fn live_trajectory(&self) -> Vec<(Stamp, Se3)> {
        self.log.live().into_iter().map(|(t, p)| (t, self.body(&p).se3)).collect()
    }
}

/// The pose of an eye that stands where a key frame does.
fn standing_at(map: &Map, id: KeyFrameId) -> Option<Placed> {
    let world_from_eye = map.world_from_eye(id)?;
    Some(Placed { reference: id, reference_from_eye: Se3::identity(), world_from_eye })
}
