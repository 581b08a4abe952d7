//! All that a session needs of a frame that was tracked in another process: the engine's output as a message, and back.
//!
//! Left out is what only reports read: verdicts of closing, attempts of the initialisation, times of mapping, events.

use crate::anchored::{Anchored, numbers, se3};
use cairn_atlas::{KeyFrameId, MapId};
use cairn_engine::{
    Evidence, FramePose, Gate, ImuStatus, MotionSource, Odometry, Output, Phase, Scale, StageEvent, State,
    Status, StatusEvent, Timings, Wait,
};
use cairn_geometry::{Pose, Se3, Sim3, Similarity};
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The output of the engine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    state: State,
    pose: Option<SeenPose>,
    evidence: Evidence,
    key_frame_requested: bool,
    extract_ms: f64,
    track_ms: f64,
    stage_failed: Option<String>,
    #[serde(with = "StatusForm")]
    status: Status,
    /// Pixels of the features in the image as it came.
    raw: Vec<[f32; 2]>,
}

/// As `cairn_engine::FramePose`; poses are seven numbers as in [`Anchored`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SeenPose {
    world_from_body: [f64; 7],
    odometry: SeenOdometry,
    anchored: Anchored,
    covariance: Option<[[f64; 6]; 6]>,
    scale: SeenScale,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SeenOdometry {
    segment: u32,
    source: MotionSource,
    odom_from_body: [f64; 7],
    world_from_odom: ([f64; 7], f64),
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SeenScale {
    /// The index of the map's root.
    map: u32,
    metric: bool,
    sigma_log: f64,
    supported: bool,
}

/// The form of [`Status`] in a message, without its events.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Status")]
struct StatusForm {
    phase: Phase,
    t_s: f64,
    frames: u64,
    sequence: u64,
    valid: bool,
    map: Option<usize>,
    initialised: bool,
    metric: bool,
    points: usize,
    imu: Option<ImuStatus>,
    #[serde(with = "waits")]
    waits: Vec<Wait>,
    #[serde(skip)]
    events: Vec<StatusEvent>,
    gates: Vec<Gate>,
    error: Option<String>,
}

/// The form of [`Wait`] in a message; elsewhere it is written as text.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Wait")]
enum WaitForm {
    Points { have: usize, need: usize },
    Parallax { matches: usize },
    Reading { silent_s: Option<f64> },
    FirstTry,
    Gate(Gate),
    VisualMatches { since_s: f64, sigma: f64 },
    Translation { since_s: f64 },
    Place { have: usize, need: usize },
}

/// Lists of [`Wait`] in the form of [`WaitForm`].
mod waits {
    use super::{Wait, WaitForm};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Serialize, Deserialize)]
    struct Form(#[serde(with = "WaitForm")] Wait);

    pub fn serialize<S: Serializer>(waits: &[Wait], to: S) -> Result<S::Ok, S::Error> {
        waits.iter().map(|wait| Form(*wait)).collect::<Vec<_>>().serialize(to)
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(from: D) -> Result<Vec<Wait>, D::Error> {
        Ok(Vec::<Form>::deserialize(from)?.into_iter().map(|form| form.0).collect())
    }
}

impl Seen {
    /// Of a frame that SLAM's process number `start` has tracked: its odometry is a segment of its own.
    pub fn of(output: &Output, start: u64) -> Self {
        Self {
            state: output.state,
            pose: output.pose.as_ref().map(|pose| SeenPose::of(pose, start)),
            evidence: output.evidence,
            key_frame_requested: output.key_frame_requested,
            extract_ms: output.timings.extract_ms,
            track_ms: output.timings.track_ms,
            stage_failed: output.stage_failed().map(str::to_owned),
            status: Status { events: Vec::new(), ..output.status.clone() },
            raw: output.frame.raw.clone(),
        }
    }

    /// Back; `None` when a pose is none.
    pub fn to_output(&self, stamp: Stamp) -> Option<Output> {
        let pose = match &self.pose {
            Some(pose) => Some(pose.to_pose()?),
            None => None,
        };
        let mut frame = Frame::default();
        (frame.stamp, frame.raw) = (stamp, self.raw.clone());
        let (extract_ms, track_ms) = (self.extract_ms, self.track_ms);
        Some(Output {
            stamp,
            frame: Arc::new(frame),
            state: self.state,
            pose,
            evidence: self.evidence,
            key_frame_requested: self.key_frame_requested,
            events: self.stage_failed.clone().map(StageEvent::Failed).into_iter().collect(),
            timings: Timings { extract_ms, track_ms, ..Timings::default() },
            status: self.status.clone(),
        })
    }
}

impl SeenPose {
    fn of(pose: &FramePose, start: u64) -> Self {
        let FramePose { odometry, scale, .. } = pose;
        let s = &odometry.world_from_odom.sim3;
        Self {
            world_from_body: numbers(&pose.world_from_body.se3),
            odometry: SeenOdometry {
                segment: (start as u32) << 16 | odometry.segment & 0xffff,
                source: odometry.source,
                odom_from_body: numbers(&odometry.odom_from_body.se3),
                world_from_odom: (numbers(&Se3::new(s.rotation, s.translation)), s.scale),
            },
            anchored: Anchored::of(&pose.anchored),
            covariance: pose.covariance.map(|c| c.data.0),
            scale: SeenScale {
                map: scale.map.root().index() as u32,
                metric: scale.metric,
                sigma_log: scale.sigma_log,
                supported: scale.supported,
            },
        }
    }

    fn to_pose(&self) -> Option<FramePose> {
        let (o, s) = (&self.odometry, &self.scale);
        let rigid = se3(&o.world_from_odom.0)?;
        let sim3 = Sim3::new(rigid.rotation, rigid.translation, o.world_from_odom.1);
        Some(FramePose {
            world_from_body: Pose::new(se3(&self.world_from_body)?),
            odometry: Odometry {
                segment: o.segment,
                source: o.source,
                odom_from_body: Pose::new(se3(&o.odom_from_body)?),
                world_from_odom: Similarity::new(sim3),
            },
            anchored: self.anchored.pose()?,
            covariance: self.covariance.map(Into::into),
            scale: Scale {
                map: MapId(KeyFrameId::from_index(s.map as usize)?),
                metric: s.metric,
                sigma_log: s.sigma_log,
                supported: s.supported,
            },
        })
    }
}
