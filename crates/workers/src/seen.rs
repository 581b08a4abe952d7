//! All that a session needs of a frame that was tracked in another process: the engine's output as a message, and back.
//!
//! Left out is what only reports read: verdicts of closing, attempts of the initialisation, times of mapping, events.

use crate::anchored::{Anchored, numbers, se3};
use cairn_atlas::{KeyFrameId, MapId};
use cairn_engine::{
    Evidence, FramePose, Gate, ImuStatus, MotionSource, Odometry, Output, Phase, Scale, StageEvent, State,
    Status, Timings, Wait,
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
    status: SeenStatus,
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

/// As `cairn_engine::Status`, without its events.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SeenStatus {
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
    waits: Vec<SeenWait>,
    gates: Vec<Gate>,
    error: Option<String>,
}

/// As `cairn_engine::Wait`, which is written as text.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum SeenWait {
    Points {
        have: usize,
        need: usize,
    },
    Parallax {
        matches: usize,
    },
    Reading {
        silent_s: Option<f64>,
    },
    FirstTry,
    Gate(Gate),
    #[serde(rename = "Sight")]
    VisualMatches {
        since_s: f64,
        sigma: f64,
    },
    Translation {
        since_s: f64,
    },
    Place {
        have: usize,
        need: usize,
    },
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
            status: SeenStatus::of(&output.status),
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
            status: self.status.to_status(),
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

impl SeenStatus {
    fn of(s: &Status) -> Self {
        Self {
            phase: s.phase,
            t_s: s.t_s,
            frames: s.frames,
            sequence: s.sequence,
            valid: s.valid,
            map: s.map,
            initialised: s.initialised,
            metric: s.metric,
            points: s.points,
            imu: s.imu,
            waits: s.waits.iter().map(SeenWait::of).collect(),
            gates: s.gates.clone(),
            error: s.error.clone(),
        }
    }

    fn to_status(&self) -> Status {
        Status {
            phase: self.phase,
            t_s: self.t_s,
            frames: self.frames,
            sequence: self.sequence,
            valid: self.valid,
            map: self.map,
            initialised: self.initialised,
            metric: self.metric,
            points: self.points,
            imu: self.imu,
            waits: self.waits.iter().map(|wait| wait.to_wait()).collect(),
            events: Vec::new(),
            gates: self.gates.clone(),
            error: self.error.clone(),
        }
    }
}

impl SeenWait {
    fn of(wait: &Wait) -> Self {
        match *wait {
            Wait::Points { have, need } => Self::Points { have, need },
            Wait::Parallax { matches } => Self::Parallax { matches },
            Wait::Reading { silent_s } => Self::Reading { silent_s },
            Wait::FirstTry => Self::FirstTry,
            Wait::Gate(gate) => Self::Gate(gate),
            Wait::VisualMatches { since_s, sigma } => Self::VisualMatches { since_s, sigma },
            Wait::Translation { since_s } => Self::Translation { since_s },
            Wait::Place { have, need } => Self::Place { have, need },
        }
    }

    fn to_wait(self) -> Wait {
        match self {
            Self::Points { have, need } => Wait::Points { have, need },
            Self::Parallax { matches } => Wait::Parallax { matches },
            Self::Reading { silent_s } => Wait::Reading { silent_s },
            Self::FirstTry => Wait::FirstTry,
            Self::Gate(gate) => Wait::Gate(gate),
            Self::VisualMatches { since_s, sigma } => Wait::VisualMatches { since_s, sigma },
            Self::Translation { since_s } => Wait::Translation { since_s },
            Self::Place { have, need } => Wait::Place { have, need },
        }
    }
}
