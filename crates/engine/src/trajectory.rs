//! What a run has told and knows of its poses: trajectories, odometry, stretches of one scale, and a digest of it all.

use crate::digest::Digest;
use crate::engine::Engine;
use crate::log::Logged;
use crate::scale::{ScaleStretch, map_of, scale_of, stretches};
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;
use cairn_tracking::Odometry;

/// Which estimate of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseTime {
    /// As it was estimated at the time.
    Live,
    /// As the latest map corrects it.
    Corrected,
}

/// `world_from_camera` of the first camera in tracked frames, each with whether its lengths are metres.
///
/// The body is not where the camera is, and how far apart they are is known in metres alone. So poses are those of the body
/// only where all of them are in metres, else those of the first camera: one trajectory is of one thing.
#[derive(Clone, Debug)]
pub struct CameraPoses {
    /// Where the camera is on the body, metres.
    pub body_from_camera: Se3,
    /// Time, `world_from_camera`, and whether its lengths are metres.
    pub poses: Vec<(Stamp, Se3, bool)>,
}

impl CameraPoses {
    /// Whether all lengths are metres.
    pub fn is_metric(&self) -> bool {
        self.poses.iter().all(|(_, _, metric)| *metric)
    }

    /// Where on the body that is of which [`CameraPoses::trajectory`] has the poses: the body itself, or the first camera.
    pub fn body_from_frame(&self) -> Se3 {
        if self.is_metric() { Se3::identity() } else { self.body_from_camera }
    }

    /// The poses of the body, or of the first camera where not all lengths are metres.
    pub fn trajectory(&self) -> Vec<(Stamp, Se3)> {
        self.of_mounted(&self.body_from_frame())
    }

    /// The poses of something mounted on the body (`body_from_mounted`, metres). Where lengths are not metres only its orientation is
    /// known, and its position is the first camera's.
    pub fn of_mounted(&self, body_from_mounted: &Se3) -> Vec<(Stamp, Se3)> {
        let mut camera_from_mounted = self.body_from_camera.inverse();
        // The pose of the body itself has the bits that outputs have.
        if *body_from_mounted != Se3::identity() {
            camera_from_mounted = camera_from_mounted * *body_from_mounted;
        }
        let turned = Se3::new(camera_from_mounted.rotation, Vec3::zeros());
        let pose_of = |(t, pose, metric): &(Stamp, Se3, bool)| {
            (*t, *pose * if *metric { camera_from_mounted } else { turned })
        };
        self.poses.iter().map(pose_of).collect()
    }

    /// True poses of the body as poses of what [`CameraPoses::trajectory`] has.
    pub fn comparable(&self, truth: &[(Stamp, Se3)]) -> Vec<(Stamp, Se3)> {
        let body_from_frame = self.body_from_frame();
        truth.iter().map(|(t, body)| (*t, *body * body_from_frame)).collect()
    }
}

impl Engine {
    /// The pose of the body in every tracked frame in the latest map; of the first camera where not all lengths are metres.
    pub fn trajectory(&self) -> Vec<(Stamp, Se3)> {
        self.camera_poses(PoseTime::Corrected).trajectory()
    }

    /// The same as estimated at the time.
    pub fn live_trajectory(&self) -> Vec<(Stamp, Se3)> {
        self.camera_poses(PoseTime::Live).trajectory()
    }

    /// The pose of the body in the odometry frame, frame by frame as it was told: one list for each segment (see
    /// [`Odometry::segment`]).
    pub fn odometry_segments(&self) -> Vec<Vec<(Stamp, Se3)>> {
        let told = self.log().frames().iter().filter_map(|f| Some((f.stamp, f.odometry?)));
        let told: Vec<(Stamp, Odometry)> = told.collect();
        let segments = told.chunk_by(|a, b| a.1.segment == b.1.segment);
        segments.map(|s| s.iter().map(|(t, o)| (*t, o.odom_from_body.se3)).collect()).collect()
    }

    /// The poses of the first camera in every tracked frame.
    pub fn camera_poses(&self, time: PoseTime) -> CameraPoses {
        let snapshot = self.snapshot();
        let pose_of = |f: &Logged| {
            let p = f.anchored?;
            Some(match time {
                PoseTime::Live => (f.stamp, p.world_from_camera, f.metric),
                PoseTime::Corrected => {
                    let pose = snapshot.resolve(p.reference, &p.reference_from_camera)?;
                    (f.stamp, pose, self.is_metric_at(&snapshot, p.reference))
                }
            })
        };
        let poses = self.log().frames().iter().filter_map(pose_of).collect();
        CameraPoses { body_from_camera: self.front_end().model().body_from_camera, poses }
    }

    fn is_metric_at(&self, snapshot: &Snapshot, reference: KeyFrameId) -> bool {
        self.front_end().model().has_depth()
            || map_of(snapshot, reference).is_some_and(|w| snapshot.is_gravity_aligned(w))
    }

    /// The stretches of the run in one unit of length, in order of time, as the map knows them now. Lengths of two
    /// stretches that are not metric are comparable only as well as their `sigma_log` says.
    pub fn scale_stretches(&self) -> Vec<ScaleStretch> {
        let snapshot = self.snapshot();
        let depth = self.front_end().model().has_depth();
        let scale = |f: &Logged| {
            let map = map_of(&snapshot, f.anchored?.reference)?;
            Some((f.stamp, scale_of(&snapshot, map, depth, f.scale_supported)))
        };
        stretches(self.log().frames().iter().filter_map(scale))
    }

    /// True poses of the body in the form of [`Output::world_from_body`](crate::Output::world_from_body): without metric scale, at
    /// the first camera's position.
    pub fn comparable(&self, truth: &[(Stamp, Se3)]) -> Vec<(Stamp, Se3)> {
        let arm = if self.is_metric() {
            Vec3::zeros()
        } else {
            self.front_end().model().body_from_camera.translation
        };
        truth.iter().map(|(t, body)| (*t, Se3::new(body.rotation, *body * arm))).collect()
    }

    /// A digest of the map and of every frame's pose, as estimated at the time and as in the latest map:
    /// equal when all bits are.
    pub fn digest(&self) -> u64 {
        let mut digest = Digest::default();
        digest.snapshot(&self.snapshot());
        for frame in self.log().frames() {
            digest.state(frame.state);
            digest.anchored(frame.anchored.as_ref());
        }
        self.trajectory().iter().for_each(|(_, pose)| digest.pose(pose));
        digest.value()
    }
}
