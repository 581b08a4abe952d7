//! A synthetic world for tests: points with distinct descriptors all around the origin, the exact frame that a camera takes
//! of it from any pose, and maps of what it saw along a path. The camera looks along z, y is down.
//!
//! The tests of adjust, mapping and tracking share this file; none of them needs all of it.
#![allow(dead_code)]

use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_random::Random;
use cairn_sensor::Stamp;
use cairn_vision::bow::Vocabulary;
use cairn_vision::{Descriptor, Frame, Octaves, RectifiedCamera};
use std::f64::consts::TAU;
use std::sync::Arc;

/// The feature budget that goes with these worlds.
pub const FEATURES: usize = 600;
/// Frames a second.
pub const RATE_HZ: f64 = 20.0;

const OCTAVES: Octaves = Octaves { levels: 8, factor: 1.2 };
/// Distance in metres from which on points are found at the finest level, by a camera of the focal length of [`stereo`].
const FINEST_M: f64 = 6.0;
const FOCAL_PX: f64 = 420.0;

/// A camera with a stereo baseline of 0.12 m.
pub fn stereo() -> RectifiedCamera {
    RectifiedCamera {
        fx: FOCAL_PX,
        fy: FOCAL_PX,
        cx: 320.0,
        cy: 240.0,
        baseline_fx: 50.0,
        bounds: [0.0, 0.0, 640.0, 480.0],
        close_depth: 5.0,
        body_from_camera: Se3::identity(),
    }
}

/// A single camera.
pub fn mono() -> RectifiedCamera {
    RectifiedCamera { baseline_fx: 0.0, ..stereo() }
}

/// The pose at a position with a heading: rotated about the y axis, radians.
pub fn pose(x: f64, z: f64, heading: f64) -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.0, heading, 0.0)), Vec3::new(x, 0.0, z))
}

/// Distance in metres and angle in radians between two poses.
pub fn off(a: &Se3, b: &Se3) -> (f64, f64) {
    ((a.translation - b.translation).norm(), (a.rotation.inverse() * b.rotation).angle())
}

/// Points and their looks.
pub struct World {
    pub camera: RectifiedCamera,
    pub points: Vec<Vec3>,
    descriptors: Vec<Descriptor>,
}

/// A frame, and the point that each of its features shows.
#[derive(Clone)]
pub struct View {
    pub frame: Arc<Frame>,
    pub points: Vec<usize>,
}

impl World {
    /// Points 3 to 7 m from the origin, in all directions and up to 1.5 m above or below; about 250 in a view. Worlds of
    /// different seeds look different.
    pub fn around(camera: RectifiedCamera, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut unit = || random.unit();
        let points = (0..1200).map(|_| {
            let (heading, distance, y) = (TAU * unit(), 3.0 + 4.0 * unit(), 3.0 * unit() - 1.5);
            Vec3::new(distance * heading.sin(), y, distance * heading.cos())
        });
        let points: Vec<Vec3> = points.collect();
        let look = |_: &Vec3| std::array::from_fn(|_| random.below(256) as u8);
        let descriptors = points.iter().map(look).collect();
        Self { camera, points, descriptors }
    }

    /// A world without anything in it.
    pub fn empty(camera: RectifiedCamera) -> Self {
        Self { camera, points: Vec::new(), descriptors: Vec::new() }
    }

    /// The same world, moved.
    pub fn transformed(mut self, by: &Sim3) -> Self {
        self.points.iter_mut().for_each(|point| *point = *by * *point);
        self
    }

    /// Leaves these points, by their numbers, and no others.
    pub fn keep(&mut self, points: &[usize]) {
        self.descriptors = points.iter().map(|n| self.descriptors[*n]).collect();
        self.points = points.iter().map(|n| self.points[*n]).collect();
    }

    /// What the camera sees from a pose: every point in view, exactly where it is.
    pub fn see(&self, world_from_camera: &Se3, seconds: f64) -> View {
        let camera_from_world = world_from_camera.inverse();
        let mut frame = Frame::default();
        frame.stamp = Stamp::from_seconds(seconds);
        let mut points = Vec::new();
        for (i, point) in self.points.iter().enumerate() {
            let p = camera_from_world * *point;
            let Some([u, v, right]) =
                self.camera.project(&p).filter(|[u, v, _]| self.camera.contains(*u, *v))
            else {
                continue;
            };
            let finest = FINEST_M * (self.camera.fx / FOCAL_PX);
            let level = ((finest / p.norm()).ln() / OCTAVES.factor.ln()).ceil().clamp(0.0, 7.0);
            let depth = self.camera.has_depth();
            frame.px.push([u as f32, v as f32]);
            frame.raw.push([u as f32, v as f32]);
            frame.octave.push(level as u8);
            frame.angle.push(0.0);
            frame.descriptors.push(self.descriptors[i]);
            frame.right_x.push(if depth { right as f32 } else { f32::NAN });
            frame.depth.push(if depth { p.z as f32 } else { f32::NAN });
            points.push(i);
        }
        frame.index(&self.camera);
        View { frame: Arc::new(frame), points }
    }

    /// The views from poses, `gap_s` seconds apart.
    pub fn walk(&self, path: &[Se3], from_s: f64, gap_s: f64) -> Vec<View> {
        path.iter().enumerate().map(|(n, pose)| self.see(pose, from_s + n as f64 * gap_s)).collect()
    }

    /// Adds views as key frames: a map of its own, or on from `parent`. A point is a landmark for as long as it stays in
    /// view, and another one when it comes into view again; without depth it takes two views. `map_from_world` says how
    /// far off the map is at the n-th view. Returns the key frames.
    pub fn map(
        &self,
        atlas: &mut Atlas,
        views: &[View],
        path: &[Se3],
        mut parent: Option<KeyFrameId>,
        map_from_world: impl Fn(usize) -> Sim3,
    ) -> Vec<KeyFrameId> {
        let mut ids = Vec::new();
        let mut current: Vec<Option<(usize, LandmarkId)>> = vec![None; self.points.len()];
        for (n, view) in views.iter().enumerate() {
            let snapshot = atlas.latest();
            let id = snapshot.next_key_frame_id();
            let mut next = snapshot.next_landmark_id().index();
            let bag = Vocabulary::embedded().bag(&view.frame.descriptors);
            let at = map_from_world(n).transform_pose(&path[n]);
            let key_frame = KeyFrame::new(id, view.frame.clone(), at, parent).with_bag(Arc::new(bag));
            let mut changes = vec![Change::AddKeyFrame(Box::new(key_frame))];
            for (feature, point) in view.points.iter().enumerate() {
                let goes_on = views.get(n + 1).is_some_and(|next| next.points.binary_search(point).is_ok());
                let landmark = match current[*point] {
                    Some((last, landmark)) if last + 1 == n => landmark,
                    _ if !goes_on && !self.camera.has_depth() => continue,
                    _ => {
                        let landmark = LandmarkId::from_index(next).expect("an id");
                        next += 1;
                        let position = map_from_world(n) * self.points[*point];
                        changes.push(Change::AddLandmark(landmark, position));
                        landmark
                    }
                };
                current[*point] = Some((n, landmark));
                changes.push(Change::Observe(landmark, id, feature as u16));
            }
            let applied = atlas.commit(changes);
            assert_eq!(applied.dropped, 0, "the map takes every change");
            parent = Some(id);
            ids.push(id);
        }
        ids
    }

    /// A map of its own, exact, of the views along a path, half a second apart from time 0.
    pub fn exact_map(&self, path: &[Se3]) -> (Atlas, Vec<KeyFrameId>) {
        let mut atlas = Atlas::new(Snapshot::with_octaves(OCTAVES));
        let views = self.walk(path, 0.0, 0.5);
        let ids = self.map(&mut atlas, &views, path, None, |_| Sim3::identity());
        (atlas, ids)
    }

    /// The landmark of each point in a snapshot that has no more than one of each, found by the features that show it.
    pub fn landmark_of(&self, snapshot: &Snapshot, point: usize) -> Option<LandmarkId> {
        let shows = |id: &LandmarkId| {
            let o = snapshot.landmark(*id)?.observations.first()?;
            let frame = &snapshot.key_frame(o.key_frame)?.frame;
            Some(frame.descriptors[o.feature as usize] == self.descriptors[point])
        };
        snapshot.landmarks().map(|l| l.id).find(|id| shows(id) == Some(true))
    }

    /// The landmark that each feature of a view shows, as [`World::landmark_of`].
    pub fn matches(&self, snapshot: &Snapshot, view: &View) -> Vec<Option<LandmarkId>> {
        view.points.iter().map(|point| self.landmark_of(snapshot, *point)).collect()
    }

    /// The point that a landmark of a snapshot is.
    pub fn point_of(&self, snapshot: &Snapshot, landmark: LandmarkId) -> Option<Vec3> {
        let o = snapshot.landmark(landmark)?.observations.first()?;
        let look = snapshot.key_frame(o.key_frame)?.frame.descriptors[o.feature as usize];
        self.descriptors.iter().position(|d| *d == look).map(|point| self.points[point])
    }
}

/// A path sideways along x, looking along z: poses `step` metres apart.
pub fn sideways(count: usize, step: f64) -> Vec<Se3> {
    (0..count).map(|n| pose(step * n as f64, 0.0, 0.0)).collect()
}
