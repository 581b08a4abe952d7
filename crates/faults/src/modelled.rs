//! The modelled engine as what tracks for a session: it has an atlas with the key frames of the way out, and a result for each
//! picture that the estimator has already made.

use crate::estimator::{PoseView, Reading, View};
use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, MapId, MapPrior, Snapshot};
use cairn_engine::{
    AnchoredPose, Evidence, FramePose, MotionSource, Odometry, Output, Phase, Scale, SensorMode, State,
    Status, Timings,
};
use cairn_geometry::{Pose, Se3, Sim3, Similarity};
use cairn_sensor::{FramePacket, Stamp};
use cairn_session::{NotTracked, Slam};
use cairn_vision::{Frame, RectifiedCamera};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Metres (units) between key frames.
const KEY_FRAME_EACH: f64 = 1.0;

/// The model.
pub(crate) struct Modelled {
    atlas: Atlas,
    /// The key frames of the route's map.
    key_frames: Vec<(KeyFrameId, Se3)>,
    /// A map of its own, with the key frame that it began with.
    own: Option<KeyFrameId>,
    maps: bool,
    metric: bool,
    camera: RectifiedCamera,
    status: Status,
    frame: Arc<Frame>,
    next: Option<Reading>,
    /// The newest picture with a pose.
    pictured: Option<Stamp>,
    away: bool,
}

impl Modelled {
    /// With nothing mapped. It maps until [`Self::recorded`].
    pub fn new(metric: bool) -> Self {
        let camera = RectifiedCamera {
            fx: 200.0,
            fy: 200.0,
            cx: 160.0,
            cy: 120.0,
            baseline_fx: 0.0,
            bounds: [0.0, 0.0, 320.0, 240.0],
            close_depth: 0.0,
            body_from_camera: Se3::identity(),
        };
        Self {
            atlas: Atlas::new(Snapshot::new()),
            key_frames: Vec::new(),
            own: None,
            maps: true,
            metric,
            camera,
            status: Status::default(),
            frame: Arc::new(Frame::default()),
            next: None,
            pictured: None,
            away: false,
        }
    }

    /// The way out is recorded: no more key frames are needed.
    pub fn recorded(&mut self) {
        self.maps = false;
    }

    /// The time of the newest picture with a pose.
    pub fn pictured(&self) -> Option<Stamp> {
        self.pictured
    }

    /// What the next packet shows.
    pub fn show(&mut self, reading: Reading) {
        self.away = matches!(reading.view, View::Away);
        self.next = Some(reading);
    }

    fn add(&mut self, pose: Se3, parent: Option<KeyFrameId>) -> KeyFrameId {
        let id = self.atlas.latest().next_key_frame_id();
        let key_frame = KeyFrame::new(id, Arc::clone(&self.frame), pose, parent);
        self.atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
        id
    }

    /// The key frame that a pose in the route's map is anchored to.
    fn nearest(&mut self, pose: &Se3) -> (KeyFrameId, Se3) {
        let far = |(_, at): &(KeyFrameId, Se3)| (at.translation - pose.translation).norm();
        let nearest = self.key_frames.iter().min_by(|a, b| far(a).total_cmp(&far(b))).copied();
        if let Some(nearest) = nearest.filter(|near| !self.maps || far(near) < KEY_FRAME_EACH) {
            return nearest;
        }
        let id = self.add(*pose, nearest.map(|(id, _)| id));
        self.key_frames.push((id, *pose));
        if nearest.is_none() && self.metric {
            let map = self.atlas.latest().maps().map(|(map, _)| map).next();
            self.atlas
                .commit(map.into_iter().map(|map| Change::AlignGravity(map, Sim3::identity())).collect());
        }
        (id, *pose)
    }

    /// The root of the map with a unit of its own, which begins where that is not there yet.
    fn own_root(&mut self, began: Se3) -> (KeyFrameId, Se3) {
        let root = self.own.unwrap_or_else(|| {
            let root = self.add(began, None);
            let (to, at) = self.nearest(&began);
            let to_from_root = at.inverse() * began;
            let prior = MapPrior { to, to_from_root, sigma: 0.5, sigma_rad: 0.1, sigma_log_scale: 0.15 };
            self.atlas.commit(vec![Change::MapPrior(MapId(root), prior)]);
            root
        });
        self.own = Some(root);
        (root, began)
    }

    fn frame_pose(&mut self, view: &PoseView) -> FramePose {
        let world = view.world_from_odom * view.odom_from_camera;
        let (reference, at) = match view.own_map {
            Some(began) => self.own_root(began),
            None => {
                self.own = None;
                self.nearest(&world)
            }
        };
        let first = self.status.frames == 1;
        let map = self.atlas.latest().key_frame(reference).map_or(MapId(reference), |k| k.map);
        FramePose {
            world_from_body: Pose::new(world),
            odometry: Odometry {
                segment: view.segment,
                source: if first { MotionSource::None } else { MotionSource::Map },
                odom_from_body: Pose::new(view.odom_from_camera),
                world_from_odom: Similarity::new(Sim3::from(view.world_from_odom)),
            },
            anchored: AnchoredPose {
                reference,
                reference_from_camera: at.inverse() * world,
                world_from_camera: world,
            },
            covariance: None,
            scale: Scale {
                map,
                metric: view.metric,
                sigma_log: if view.own_map.is_some() { 0.15 } else { 0.0 },
                supported: view.supported,
            },
        }
    }
}

fn state_of(view: &View) -> State {
    match view {
        View::Pose(PoseView { coasts_s: None, .. }) => State::Tracking,
        View::Pose(PoseView { coasts_s: Some(since_s), .. }) => {
            State::Coasting { since_s: *since_s, sigma: 0.01 + 0.05 * since_s * since_s }
        }
        _ => State::Lost { inliers: 0, need: 10 },
    }
}

impl Slam for Modelled {
    fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked> {
        let Some(reading) = self.next.take() else {
            return Err(NotTracked::Refused("nothing is known of this picture".into()));
        };
        match reading.view {
            View::Away => return Err(NotTracked::Away("it is started again".into())),
            // As a panic of the engine, without the words of the hook.
            View::Dies => std::panic::resume_unwind(Box::new("the engine fails")),
            View::Lost | View::Pose(_) => {}
        }
        self.status.frames += 1;
        let state = state_of(&reading.view);
        let pose = match &reading.view {
            View::Pose(view) => Some(self.frame_pose(view)),
            _ => None,
        };
        self.pictured = pose.map(|_| packet.stamp).or(self.pictured);
        self.status = Status {
            phase: if pose.is_some() { Phase::Tracking } else { Phase::Lost },
            frames: self.status.frames,
            sequence: self.status.sequence + u64::from(pose.is_some()),
            valid: pose.is_some(),
            map: Some(0),
            initialised: true,
            metric: self.metric,
            ..Status::default()
        };
        Ok(Output {
            stamp: packet.stamp,
            frame: Arc::clone(&self.frame),
            state,
            pose,
            evidence: Evidence { features: 100, expected: 100, matched: 100, inliers: 90 },
            key_frame_requested: false,
            events: Vec::new(),
            timings: Timings::default(),
            status: self.status.clone(),
        })
    }

    fn away(&self) -> Option<&str> {
        self.away.then_some("it is started again")
    }

    fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(self.atlas.latest())
    }

    fn camera(&self) -> &RectifiedCamera {
        &self.camera
    }

    fn status(&self) -> &Status {
        &self.status
    }

    fn is_visual(&self) -> bool {
        false
    }

    fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        let about = About { program: program.to_owned(), sensor: SensorMode::Mono, camera: self.camera };
        MapFile { snapshot: (**self.atlas.latest()).clone(), about, attached }
    }
}

/// A packet without pictures.
pub(crate) fn packet(stamp: Stamp) -> FramePacket {
    FramePacket { stamp, images: Vec::new(), depth: None, imu: Vec::new(), decode_ms: 0.0 }
}
