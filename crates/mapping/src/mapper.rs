//! The mapping stage: one key frame in, the map grown, fused, adjusted and culled.

use crate::cull::{RecentLandmarks, redundant};
use crate::disparity::DisparityError;
use crate::fuse::{around, fuse_into};
use crate::grow::grow;
use crate::inertial::{Inertial, InertialConfig};
use crate::insert::{Entry, NewLandmarks, add_key_frame, points_from_depth};
use crate::turning::hold_orientation;
use cairn_adjust::{Window, WindowConfig};
use cairn_atlas::{Atlas, Change, ImuSegment, InertialState, KeyFrameId, LandmarkId, MapId, MapPrior};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_inertial::Attempt;
use cairn_sensor::ImuSensor;
use cairn_solve::Report;
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

/// How to map.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapperConfig {
    /// Neighbours searched for new points.
    pub grow_neighbours: usize,
    /// Neighbours searched for duplicates.
    pub fuse_neighbours: usize,
    /// The window of the local adjustment.
    pub window: WindowConfig,
    /// A key frame goes when more than this share of its landmarks is seen by three others.
    pub redundant_share: f64,
    /// Key frames up to which a map is adjusted as a whole when a run ends.
    pub final_adjustment_key_frames: usize,
    /// Points from depth that a key frame brings at least, where it has them.
    pub depth_points: usize,
}

impl Default for MapperConfig {
    fn default() -> Self {
        Self {
            grow_neighbours: 10,
            fuse_neighbours: 10,
            window: WindowConfig::default(),
            redundant_share: 0.9,
            final_adjustment_key_frames: 5000,
            depth_points: 100,
        }
    }
}

/// Where a world begins.
#[derive(Clone, Debug)]
pub struct Begin {
    /// The pose of its root.
    pub world_from_camera: Se3,
    /// How it hangs on a former world, if there is one.
    pub tie: Option<MapPrior>,
    /// Units a second that the eye shall have gone, where there is no other scale; else the median depth is one.
    pub pace: Option<f64>,
    /// What the inertial sensor says of its last key frame.
    pub imu: Option<ImuSegment>,
    /// Whether its lengths are metres and its z axis points up already.
    pub level: bool,
}

impl Default for Begin {
    fn default() -> Self {
        Self { world_from_camera: Se3::identity(), tie: None, pace: None, imu: None, level: false }
    }
}

/// A frame that shall become a key frame of a world that is there.
#[derive(Clone, Copy, Debug)]
pub struct Submitted<'a> {
    /// The frame.
    pub frame: &'a Arc<Frame>,
    /// The landmark that each feature shows.
    pub landmarks: &'a [Option<LandmarkId>],
    /// The key frame on which its place hangs.
    pub reference: KeyFrameId,
    /// Its place there.
    pub reference_from_camera: Se3,
    /// What the inertial sensor says of it.
    pub imu: Option<&'a ImuSegment>,
}

/// What mapping did with one offer.
#[derive(Clone, Debug)]
pub struct Mapped {
    /// The key frame that was added.
    pub key_frame: KeyFrameId,
    /// Landmarks born.
    pub born: usize,
    /// The local adjustment, when there was one.
    pub adjustment: Option<Report>,
    /// How gravity, scale and biases were sought, when they were.
    pub attempt: Option<Attempt>,
}

/// The mapping stage.
#[derive(Debug)]
pub struct Mapper {
    camera: RectifiedCamera,
    config: MapperConfig,
    recent_landmarks: RecentLandmarks,
    inertial: Option<Inertial>,
    /// Of a stereo rig, where it is looked for.
    disparity: Option<DisparityError>,
}

impl Mapper {
    /// A mapper for one eye.
    pub fn new(camera: RectifiedCamera, config: MapperConfig) -> Self {
        let disparity = DisparityError::within(config.window.right_offset_sigma);
        Self { camera, config, recent_landmarks: RecentLandmarks::default(), inertial: None, disparity }
    }

    /// The same with an inertial sensor; `imu_from_camera` in metres.
    pub fn with_imu(self, sensor: &ImuSensor, imu_from_camera: Se3, config: InertialConfig) -> Self {
        Self { inertial: Some(Inertial::new(sensor, imu_from_camera, config)), ..self }
    }

    /// What tracking expected in a frame and whether it was found: young landmarks are judged by it.
    pub fn note(&mut self, seen: &[(LandmarkId, bool)]) {
        self.recent_landmarks.note(seen);
    }

    /// Begins a world with a frame that has depth.
    pub fn start(&mut self, atlas: &mut Atlas, frame: &Arc<Frame>, begin: &Begin) -> KeyFrameId {
        let snapshot = atlas.latest();
        let id = snapshot.next_key_frame_id();
        let mut new_landmarks = NewLandmarks::after(snapshot);
        let nothing = vec![None; frame.len()];
        let motion = begin.imu.as_ref().filter(|_| self.inertial.is_some()).map(without_imu_factor);
        let entry = Entry { id, frame, world_from_camera: begin.world_from_camera, shown: &nothing, motion };
        let mut changes = add_key_frame(&entry, None);
        changes.extend(begin.tie.map(|tie| Change::MapPrior(MapId(id), tie)));
        changes.extend(begin.level.then(|| Change::AlignGravity(MapId(id), Sim3::identity())));
        changes.extend(points_from_depth(snapshot, &self.camera, &entry, frame.len(), &mut new_landmarks));
        atlas.commit(changes);
        id
    }

    /// Begins a world with two frames and the points both see, and adjusts it; the unit of length follows
    /// from the pace, or is the median depth of the first. `None` when there is no point in front of both.
    pub fn start_pair(
        &mut self,
        atlas: &mut Atlas,
        first: &Arc<Frame>,
        second: &Arc<Frame>,
        first_from_second: Se3,
        points: &[(u16, u16, Vec3)],
        begin: &Begin,
    ) -> Option<KeyFrameId> {
        let mut depths: Vec<f64> = points.iter().map(|(_, _, p)| p.z).filter(|z| *z > 0.0).collect();
        if depths.is_empty() {
            return None;
        }
        let gone = first_from_second.translation.norm() / (second.stamp - first.stamp);
        let unit = match begin.pace {
            Some(pace) if gone.is_finite() && gone > 0.0 => pace / gone,
            _ => {
                let middle = depths.len() / 2;
                1.0 / *depths.select_nth_unstable_by(middle, f64::total_cmp).1
            }
        };
        let before = atlas.latest().clone();
        let a = before.next_key_frame_id();
        let b = KeyFrameId::from_index(a.index() + 1)?;
        let mut new_landmarks = NewLandmarks::after(&before);
        let scaled = Se3::new(first_from_second.rotation, first_from_second.translation * unit);
        let (none_a, none_b) = (vec![None; first.len()], vec![None; second.len()]);
        let imu = self.inertial.as_mut().zip(begin.imu.as_ref());
        let motion = imu.as_ref().map(|(_, imu)| without_imu_factor(imu));
        let entry_a =
            Entry { id: a, frame: first, world_from_camera: begin.world_from_camera, shown: &none_a, motion };
        let world_from_second = begin.world_from_camera * scaled;
        let motion = imu.map(|(inertial, imu)| inertial.motion_since(Some(a), imu));
        let entry_b =
            Entry { id: b, frame: second, world_from_camera: world_from_second, shown: &none_b, motion };
        let mut changes = add_key_frame(&entry_a, None);
        changes.extend(begin.tie.map(|tie| Change::MapPrior(MapId(a), tie)));
        changes.extend(add_key_frame(&entry_b, Some(a)));
        for (i, j, p) in points {
            let id = new_landmarks.id()?;
            changes.push(Change::AddLandmark(id, begin.world_from_camera * (p * unit)));
            changes.push(Change::Observe(id, a, *i));
            changes.push(Change::Observe(id, b, *j));
        }
        atlas.commit(changes);
        let window = WindowConfig { iterations: [10, 10], tolerance: 1e-6, ..self.config.window };
        let final_result = Window::whole(atlas.latest(), &self.camera, MapId(a)).solve(&window, || false);
        atlas.commit(final_result.changes.changes);
        self.recent_landmarks.admit(&new_landmarks.born, b);
        Some(b)
    }

    /// Takes up a key frame. `stop` is asked between and within the steps: when it says true, what can wait is left
    /// for the next key frame.
    pub fn step(
        &mut self,
        atlas: &mut Atlas,
        submitted: &Submitted,
        mut stop: impl FnMut() -> bool,
    ) -> Option<Mapped> {
        let Submitted { frame, landmarks, reference, reference_from_camera, imu } = *submitted;
        let depth = self.camera.has_depth();
        let snapshot = atlas.latest().clone();
        let (parent, _) = snapshot.surviving_ancestor(reference)?;
        let world_from_camera = snapshot.resolve(reference, &reference_from_camera)?;
        let id = snapshot.next_key_frame_id();
        let mut new_landmarks = NewLandmarks::after(&snapshot);
        let alive: Vec<Option<LandmarkId>> =
            landmarks.iter().map(|l| l.filter(|l| snapshot.landmark(*l).is_some())).collect();
        let map = snapshot.key_frame(parent)?.map;
        let imu = self.inertial.as_mut().zip(imu);
        let motion = imu.map(|(i, imu)| i.motion(&snapshot, map, frame.stamp, imu));
        let entry = Entry { id, frame, world_from_camera, shown: &alive, motion };
        let mut changes = add_key_frame(&entry, Some(parent));
        if depth {
            let least = self.config.depth_points;
            changes.extend(points_from_depth(&snapshot, &self.camera, &entry, least, &mut new_landmarks));
        }
        atlas.commit(changes);
        atlas.commit(self.recent_landmarks.judge(atlas.latest(), id, depth));
        self.recent_landmarks.admit(&new_landmarks.born, id);
        let mut born = new_landmarks.born.len();

        let snapshot = atlas.latest().clone();
        let mut new_landmarks = NewLandmarks::after(&snapshot);
        atlas.commit(grow(
            &snapshot,
            &self.camera,
            id,
            self.config.grow_neighbours,
            &mut new_landmarks,
            &mut stop,
        ));
        self.recent_landmarks.admit(&new_landmarks.born, id);
        born += new_landmarks.born.len();
        if !depth {
            let mut new_landmarks = NewLandmarks::after(atlas.latest());
            let held = hold_orientation(atlas.latest(), &self.camera, id, &mut new_landmarks);
            atlas.commit(held);
            self.recent_landmarks.admit(&new_landmarks.born, id);
            born += new_landmarks.born.len();
        }

        let mut adjustment = None;
        if !stop() {
            self.fuse(atlas, id);
        }
        if !stop() && atlas.latest().key_frame_count() > 2 {
            let mut window = self.config.window;
            let found = atlas.latest().right_offset();
            if let Some(error) = &self.disparity {
                window.right_offset_sigma = error.sigma(found == 0.0);
            }
            let (snapshot, config) = (atlas.latest(), &window);
            let imu = self.inertial.as_ref().and_then(|i| i.window(snapshot, &self.camera, id, config));
            let final_result = match imu {
                Some(window) => window.solve(config, &mut stop),
                None => {
                    let window = Window::around(snapshot, &self.camera, id, config)?;
                    window.solve(config, &mut stop)
                }
            };
            adjustment = Some(final_result.report);
            let calibrated = self.disparity.as_mut().and_then(|error| error.hear(found, &final_result));
            atlas.commit(final_result.changes.changes);
            atlas.commit(calibrated.into_iter().collect());
            let gone = redundant(atlas.latest(), &self.camera, id, self.config.redundant_share);
            atlas.commit(gone.into_iter().collect());
        }
        let attempt = match &mut self.inertial {
            Some(inertial) => inertial.final_adjustment(atlas, &self.camera, id, &self.config.window),
            None => None,
        };
        Some(Mapped { key_frame: id, born, adjustment, attempt })
    }

    /// Adjusts each world as a whole, as a run ends; worlds of more than `final_adjustment_key_frames` are left as they are, since
    /// their windows have settled long ago and the dense reduced system would not fit the time.
    pub fn final_adjustment(&mut self, atlas: &mut Atlas) {
        let maps: Vec<MapId> = atlas.latest().maps().map(|(id, _)| id).collect();
        for map in maps {
            let snapshot = atlas.latest();
            if !(3..=self.config.final_adjustment_key_frames).contains(&snapshot.key_frames_of(map).count()) {
                continue;
            }
            let window = WindowConfig { iterations: [40, 20], tolerance: 1e-6, ..self.config.window };
            let imu =
                self.inertial.as_ref().and_then(|i| i.whole(snapshot, &self.camera, map, &window, || false));
            let final_result =
                imu.unwrap_or_else(|| Window::whole(snapshot, &self.camera, map).solve(&window, || false));
            atlas.commit(final_result.changes.changes);
        }
    }

    fn fuse(&self, atlas: &mut Atlas, id: KeyFrameId) {
        let near = around(atlas.latest(), id, self.config.fuse_neighbours);
        for neighbour in &near {
            let snapshot = atlas.latest().clone();
            let (Some(here), Some(there)) = (snapshot.key_frame(id), snapshot.key_frame(*neighbour)) else {
                continue;
            };
            let mine: Vec<LandmarkId> = here.landmarks.iter().flatten().copied().collect();
            atlas.commit(fuse_into(&snapshot, &self.camera, &mine, there));
        }
        let snapshot = atlas.latest().clone();
        let Some(here) = snapshot.key_frame(id) else { return };
        let mut theirs: Vec<LandmarkId> = near
            .iter()
            .filter_map(|k| snapshot.key_frame(*k))
            .flat_map(|k| k.landmarks.iter().flatten().copied())
            .collect();
        theirs.sort_unstable();
        theirs.dedup();
        atlas.commit(fuse_into(&snapshot, &self.camera, &theirs, here));
    }
}

/// The motion of a key frame before which nothing was felt.
fn without_imu_factor(imu: &ImuSegment) -> InertialState {
    InertialState { velocity: imu.velocity, bias: imu.bias, imu_factor: None }
}
