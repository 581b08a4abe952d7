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

impl Engine {
    /// The pose of the body in every tracked frame, in the latest map.
    pub fn trajectory(&self) -> Vec<(Stamp, Se3)> {
        self.poses(PoseTime::Corrected).map(|(t, pose, metric)| (t, self.body(&pose, metric).se3)).collect()
    }

    /// The pose of the body in every tracked frame, as estimated at the time.
    pub fn live_trajectory(&self) -> Vec<(Stamp, Se3)> {
        self.poses(PoseTime::Live).map(|(t, pose, metric)| (t, self.body(&pose, metric).se3)).collect()
    }

    /// The pose of the body in the odometry frame, frame by frame as it was told: one list for each segment (see
    /// [`Odometry::segment`]).
    pub fn odometry_segments(&self) -> Vec<Vec<(Stamp, Se3)>> {
        let told = self.log().frames().iter().filter_map(|f| Some((f.stamp, f.odometry?)));
        let told: Vec<(Stamp, Odometry)> = told.collect();
        let segments = told.chunk_by(|a, b| a.1.segment == b.1.segment);
        segments.map(|s| s.iter().map(|(t, o)| (*t, o.odom_from_body.se3)).collect()).collect()
    }

    /// The pose of something mounted on the body (`body_from_mounted`, metres) in every tracked frame: the first camera,
    /// for instance. Without metric scale the body is given at the first camera's position ([`Engine::trajectory`]), and a
    /// lever arm in metres cannot be added to it: then only the orientation is that of the mounted thing, the position is
    /// the first camera's.
    pub fn mounted_trajectory(&self, body_from_mounted: &Se3, time: PoseTime) -> Vec<(Stamp, Se3)> {
        let pose_of = |(t, pose, metric): (Stamp, Se3, bool)| {
            let body = self.body(&pose, metric).se3;
            let arm = if metric { body_from_mounted.translation } else { Vec3::zeros() };
            (t, Se3::new(body.rotation * body_from_mounted.rotation, body * arm))
        };
        self.poses(time).map(pose_of).collect()
    }

    /// Time, `world_from_camera` and whether lengths are metres, of every tracked frame.
    fn poses(&self, time: PoseTime) -> impl Iterator<Item = (Stamp, Se3, bool)> + '_ {
        let snapshot = self.snapshot();
        self.log().frames().iter().filter_map(move |f| {
            let p = f.anchored?;
            Some(match time {
                PoseTime::Live => (f.stamp, p.world_from_camera, f.metric),
                PoseTime::Corrected => {
                    let pose = snapshot.resolve(p.reference, &p.reference_from_camera)?;
                    (f.stamp, pose, self.is_metric_at(&snapshot, p.reference))
                }
            })
        })
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

    /// Ground truth in the form of [`Engine::trajectory`]: without metric scale, at the first camera's
    /// position.
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
