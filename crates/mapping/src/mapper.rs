//! The mapping stage: takes one key frame at a time, triangulates new landmarks, fuses duplicates, adjusts
//! and culls.

use crate::cull::{RecentLandmarks, redundant};
use crate::depth_views::DepthViews;
use crate::disparity::DisparityError;
use crate::fuse::{around, fuse_into};
use crate::inertial::{Inertial, InertialConfig};
use crate::insert::{Entry, NewLandmarks, add_key_frame, points_from_depth};
use crate::rotation_only::landmarks_by_rotation;
use crate::scale_check::ScaleCheck;
use crate::triangulation::create_landmarks;
use crate::windows;
use cairn_adjust::{MotionLinks, MotionSince, Window, WindowConfig};
use cairn_atlas::{
    Atlas, Change, ImuSegment, InertialState, KeyFrameId, LandmarkId, MapId, MapPrior, Readout, Snapshot,
};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_inertial::Attempt;
use cairn_sensor::{ImuSensor, Stamp};
use cairn_settings::Settings;
use cairn_solve::{Report, pause, to_end};
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

/// Configuration of mapping.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct MapperConfig {
    /// Neighbouring key frames searched for new landmarks.
    #[setting(default = 10, range = 1..=1000)]
    pub grow_neighbours: usize,
    /// Neighbouring key frames searched for duplicate landmarks.
    #[setting(default = 10, range = 0..=1000)]
    pub fuse_neighbours: usize,
    /// The window of the local bundle adjustment.
    #[setting(section)]
    pub window: WindowConfig,
    /// A key frame is culled when more than this share of its landmarks is observed by three others.
    #[setting(default = 0.9, range = 0.1..=1.0)]
    pub redundant_share: f64,
    /// Largest map, in key frames, that gets a final bundle adjustment when a run ends; 0: never.
    #[setting(default = 2000, range = 0..=10000)]
    pub final_adjustment_key_frames: usize,
    /// Landmarks that a key frame should have at least after adding points from depth, where it has enough features.
    #[setting(default = 100, range = 0..=100000)]
    pub depth_points: usize,
}

/// The initial state of a new map.
#[derive(Clone, Debug)]
pub struct MapStart {
    /// The pose of its root key frame.
    pub world_from_camera: Se3,
    /// Its pose relative to a previous map, if there is one.
    pub map_prior: Option<MapPrior>,
    /// Assumed speed of the camera in units per second, which sets the scale where nothing else does; without it the
    /// median depth is one.
    pub speed: Option<f64>,
    /// The IMU data of its last key frame.
    pub imu: Option<ImuSegment>,
    /// Whether its lengths are metres and its z axis points up from the start.
    pub gravity_aligned: bool,
    /// The first key frame of the previous map that rests on assumed depths. Once the camera moved on, its landmarks
    /// have parallax, but their scale is none: it and those after it are removed, so that neither recognition nor a
    /// merge takes scale from them.
    pub assumed_since: Option<KeyFrameId>,
    /// Clocks and rows as they are known before the first map.
    pub clocks: Option<StartClocks>,
}

/// What is known of the clocks of camera and IMU and of the readout of the rows before there is a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartClocks {
    /// Seconds to add to the stamps of the IMU, as was done in the IMU data, and their standard deviation.
    pub offset_s: [f64; 2],
    /// The readout time.
    pub readout: Readout,
}

impl Default for MapStart {
    fn default() -> Self {
        Self {
            world_from_camera: Se3::identity(),
            map_prior: None,
            speed: None,
            imu: None,
            gravity_aligned: false,
            assumed_since: None,
            clocks: None,
        }
    }
}

/// A frame that is to become a key frame of an existing map.
#[derive(Clone, Copy, Debug)]
pub struct KeyFrameInput<'a> {
    /// The frame.
    pub frame: &'a Arc<Frame>,
    /// The landmark that each feature shows.
    pub landmarks: &'a [Option<LandmarkId>],
    /// The key frame that its pose is anchored to.
    pub reference: KeyFrameId,
    /// Its pose in that key frame's camera frame.
    pub reference_from_camera: Se3,
    /// The IMU data that belongs to it.
    pub imu: Option<&'a ImuSegment>,
    /// Whether scale is unsupported: it only carries the orientation forward, and no landmark is triangulated from
    /// it.
    pub orientation_only: bool,
    /// The factor by which the lengths of its map are multiplied first, and the standard deviation of the logarithm
    /// of the map's scale against the previous map after that.
    pub rescale: Option<(f64, f64)>,
    /// What other sensors measured of the camera's motion since the key frame asked for before.
    pub motion: Option<&'a MotionSince>,
    /// Whether its pose is that of its depth: from now on poses stay where they are found.
    pub by_depth: bool,
}

/// The result of one mapping step.
#[derive(Clone, Debug)]
pub struct Mapped {
    /// The key frame that was added.
    pub key_frame: KeyFrameId,
    /// Landmarks created.
    pub created: usize,
    /// The report of the local bundle adjustment, when there was one.
    pub adjustment: Option<Report>,
    /// The attempt to initialise gravity, scale and biases, when there was one.
    pub attempt: Option<Attempt>,
    /// What the IMU says of the scale of a metric map, where it does.
    pub scale_check: Option<ScaleCheck>,
}

/// The mapping stage.
#[derive(Debug)]
pub struct Mapper {
    camera: RectifiedCamera,
    config: MapperConfig,
    recent_landmarks: RecentLandmarks,
    inertial: Option<Inertial>,
    /// The disparity error of a stereo rig, where it is estimated.
    disparity: Option<DisparityError>,
    /// The key frame that was added last, with its time, and motions measured from one to the next.
    last: Option<(KeyFrameId, Stamp)>,
    links: MotionLinks,
    depth_views: Option<DepthViews>,
}

impl Mapper {
    /// A mapper for a camera.
    pub fn new(camera: RectifiedCamera, config: MapperConfig) -> Self {
        let disparity = DisparityError::within(config.window.right_offset_sigma);
        Self {
            camera,
            config,
            recent_landmarks: RecentLandmarks::default(),
            inertial: None,
            disparity,
            last: None,
            links: MotionLinks::default(),
            depth_views: None,
        }
    }

    /// Adds an IMU; `imu_from_camera` in metres.
    pub fn with_imu(self, sensor: &ImuSensor, imu_from_camera: Se3, config: InertialConfig) -> Self {
        Self { inertial: Some(Inertial::new(sensor, imu_from_camera, config)), ..self }
    }

    /// Adds the depth of key frames, which it keeps from now on.
    pub fn with_depth_views(self, depth_views: DepthViews) -> Self {
        Self { depth_views: Some(depth_views), ..self }
    }

    /// The motions that other sensors measured between its key frames.
    pub fn motion_links(&self) -> MotionLinks {
        self.links.clone()
    }

    /// Takes the landmarks that tracking expected in a frame, and whether each was found: this decides which
    /// tentative landmarks are culled.
    pub fn note(&mut self, seen: &[(LandmarkId, bool)]) {
        self.recent_landmarks.note(seen);
    }

    /// Starts a map from a frame that has depth.
    pub fn start(&mut self, atlas: &mut Atlas, frame: &Arc<Frame>, start: &MapStart) -> KeyFrameId {
        let snapshot = atlas.latest();
        let id = snapshot.next_key_frame_id();
        let mut new_landmarks = NewLandmarks::after(snapshot);
        let no_landmarks = vec![None; frame.len()];
        let motion = start.imu.as_ref().filter(|_| self.inertial.is_some()).map(without_imu_factor);
        let entry =
            Entry { id, frame, world_from_camera: start.world_from_camera, observed: &no_landmarks, motion };
        let mut changes = add_key_frame(&entry, None);
        changes.extend(start.map_prior.map(|map_prior| Change::MapPrior(MapId(id), map_prior)));
        changes.extend(start.gravity_aligned.then(|| Change::AlignGravity(MapId(id), Sim3::identity())));
        changes.extend(points_from_depth(snapshot, &self.camera, &entry, frame.len(), &mut new_landmarks));
        self.keep_depth(id, frame.stamp);
        atlas.commit(changes);
        self.last = Some((id, frame.stamp));
        id
    }

    /// Starts a map from two frames and the points seen in both, and adjusts it; the unit of length follows
    /// from the assumed speed, or is the median depth of the first frame. `None` when no point lies in front
    /// of the first camera.
    pub fn start_pair(
        &mut self,
        atlas: &mut Atlas,
        first: &Arc<Frame>,
        second: &Arc<Frame>,
        first_from_second: Se3,
        points: &[(u16, u16, Vec3)],
        start: &MapStart,
    ) -> Option<KeyFrameId> {
        let mut depths: Vec<f64> = points.iter().map(|(_, _, p)| p.z).filter(|z| *z > 0.0).collect();
        if depths.is_empty() {
            return None;
        }
        let speed_in_baselines = first_from_second.translation.norm() / (second.stamp - first.stamp);
        let unit = match start.speed {
            Some(speed) if speed_in_baselines.is_finite() && speed_in_baselines > 0.0 => {
                speed / speed_in_baselines
            }
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
        if let Some(clocks) = &start.clocks {
            let [offset_s, sigma_s] = clocks.offset_s;
            atlas.commit(vec![Change::ImuOffset(offset_s), Change::Readout(clocks.readout)]);
            self.inertial.iter_mut().for_each(|inertial| inertial.adopt_offset(offset_s, sigma_s));
        }
        let imu = self.inertial.as_mut().zip(start.imu.as_ref());
        let motion = imu.as_ref().map(|(_, imu)| without_imu_factor(imu));
        let entry_a = Entry {
            id: a,
            frame: first,
            world_from_camera: start.world_from_camera,
            observed: &none_a,
            motion,
        };
        let world_from_second = start.world_from_camera * scaled;
        let motion = imu.map(|(inertial, imu)| inertial.motion_since(Some(a), imu));
        let entry_b =
            Entry { id: b, frame: second, world_from_camera: world_from_second, observed: &none_b, motion };
        let mut changes = add_key_frame(&entry_a, None);
        changes.extend(start.map_prior.map(|map_prior| Change::MapPrior(MapId(a), map_prior)));
        changes.extend(add_key_frame(&entry_b, Some(a)));
        for (i, j, p) in points {
            let id = new_landmarks.id()?;
            changes.push(Change::AddLandmark(id, start.world_from_camera * (p * unit)));
            changes.push(Change::Observe(id, a, *i));
            changes.push(Change::Observe(id, b, *j));
        }
        changes.extend(start.assumed_since.into_iter().flat_map(|since| removed_since(&before, since)));
        atlas.commit(changes);
        let window = WindowConfig { iterations: [10, 10], tolerance: 1e-6, ..self.config.window };
        if let Some(whole) = Window::of(atlas.latest(), &self.camera).whole(MapId(a)) {
            let result = whole.solve(&window, || false);
            atlas.commit(result.changes.changes);
        }
        self.recent_landmarks.admit(&new_landmarks.ids, b);
        Some(b)
    }

    /// Inserts a key frame. `stop` is called between and within the steps: once it returns true, work that can wait
    /// is left for the next key frame. `None` when the key frame it is anchored to has no surviving ancestor.
    pub fn step(
        &mut self,
        atlas: &mut Atlas,
        input: &KeyFrameInput<'_>,
        stop: impl FnMut() -> bool,
    ) -> Option<Mapped> {
        to_end(self.step_in_slices(atlas, input, stop))
    }

    /// The same, with pauses between and within the steps: snapshots taken in between are those of a map that can be used.
    pub async fn step_in_slices(
        &mut self,
        atlas: &mut Atlas,
        input: &KeyFrameInput<'_>,
        mut stop: impl FnMut() -> bool,
    ) -> Option<Mapped> {
        let KeyFrameInput { frame, landmarks, reference, reference_from_camera, imu, .. } = *input;
        if let Some((factor, sigma_log_scale)) = input.rescale {
            let changes = rescaled(atlas.latest(), reference, factor, sigma_log_scale);
            atlas.commit(changes);
        }
        if let Some((inertial, imu)) = self.inertial.as_mut().zip(imu) {
            let changes = inertial.cut(atlas.latest(), imu);
            atlas.commit(changes);
        }
        let depth = self.camera.has_depth();
        if input.by_depth
            && let Some(views) = self.depth_views.take()
        {
            self.config.window.hold_poses = true;
            views.hold_from(atlas.latest().next_key_frame_id());
        }
        let snapshot = atlas.latest().clone();
        let (parent, _) = snapshot.surviving_ancestor(reference)?;
        let world_from_camera = snapshot.resolve(reference, &reference_from_camera)?;
        let id = snapshot.next_key_frame_id();
        let mut new_landmarks = NewLandmarks::after(&snapshot);
        let surviving: Vec<Option<LandmarkId>> =
            landmarks.iter().map(|l| l.filter(|l| snapshot.landmark(*l).is_some())).collect();
        let map = snapshot.key_frame(parent)?.map;
        let imu = self.inertial.as_mut().zip(imu);
        let motion = imu.map(|(i, imu)| i.motion(&snapshot, map, frame.stamp, imu));
        let entry = Entry { id, frame, world_from_camera, observed: &surviving, motion };
        let mut changes = add_key_frame(&entry, Some(parent));
        if depth {
            let least = self.config.depth_points;
            changes.extend(points_from_depth(&snapshot, &self.camera, &entry, least, &mut new_landmarks));
        }
        self.keep_depth(id, frame.stamp);
        atlas.commit(changes);
        if let (Some(motion), Some((last, stamp))) = (input.motion, self.last)
            && motion.stamp == stamp
        {
            self.links.insert(last, id, *motion);
        }
        self.last = Some((id, frame.stamp));
        atlas.commit(self.recent_landmarks.cull(atlas.latest(), id, depth));
        self.recent_landmarks.admit(&new_landmarks.ids, id);
        let mut created = new_landmarks.ids.len();
        pause().await;

        if !input.orientation_only {
            let snapshot = atlas.latest().clone();
            let mut new_landmarks = NewLandmarks::after(&snapshot);
            let neighbours = self.config.grow_neighbours;
            let found =
                create_landmarks(&snapshot, &self.camera, id, neighbours, &mut new_landmarks, &mut stop);
            atlas.commit(found.await);
            self.recent_landmarks.admit(&new_landmarks.ids, id);
            created += new_landmarks.ids.len();
        }
        // Where the IMU carries the pose, their invented depth would set the scale of what follows.
        if !depth && !atlas.latest().is_gravity_aligned(map) {
            let mut new_landmarks = NewLandmarks::after(atlas.latest());
            let oriented = landmarks_by_rotation(atlas.latest(), &self.camera, id, &mut new_landmarks);
            atlas.commit(oriented);
            self.recent_landmarks.admit(&new_landmarks.ids, id);
            created += new_landmarks.ids.len();
        }

        if input.orientation_only {
            return Some(Mapped {
                key_frame: id,
                created,
                adjustment: None,
                attempt: None,
                scale_check: None,
            });
        }
        let mut adjustment = None;
        if !stop() {
            self.fuse(atlas, id).await;
        }
        if !stop() && atlas.latest().key_frame_count() > 2 {
            let mut window = self.config.window;
            let found = atlas.latest().right_offset();
            // Of several rigs each has an error of its own: none is estimated.
            let several = atlas.latest().other_cameras().next().is_some();
            if let Some(error) = self.disparity.as_ref().filter(|_| !several) {
                window.right_offset_sigma = error.sigma(found == 0.0);
            }
            let (snapshot, config) = (&atlas.latest().clone(), &window);
            let imu = self.inertial.as_ref().and_then(|i| i.window(snapshot, &self.camera, id, config));
            let motions = || Window::of(snapshot, &self.camera).add(self.links.factors()).around(id, config);
            let result = imu.or_else(motions)?.solve_in_slices(config, &mut stop).await;
            adjustment = Some(result.report);
            let disparity = self.disparity.as_mut().filter(|_| !several);
            let calibrated = disparity.and_then(|error| error.update(found, &result));
            atlas.commit(result.changes.changes);
            atlas.commit(calibrated.into_iter().collect());
            pause().await;
            let redundant_key_frame =
                redundant(atlas.latest(), &self.camera, id, self.config.redundant_share);
            atlas.commit(redundant_key_frame.into_iter().collect());
            pause().await;
        }
        let (attempt, scale_check) = match &mut self.inertial {
            Some(inertial) => inertial.align_or_refine(atlas, &self.camera, id, &self.config.window).await,
            None => (None, None),
        };
        Some(Mapped { key_frame: id, created, adjustment, attempt, scale_check })
    }

    /// Final bundle adjustment of each map at the end of a run; maps of more than `final_adjustment_key_frames` are
    /// left as they are, since their windows converged long ago and the dense reduced system would take too long.
    /// `stop` is called before each step; a map during whose adjustment it returned true, and those after it, stay
    /// unchanged.
    pub fn final_adjustment(&mut self, atlas: &mut Atlas, mut stop: impl FnMut() -> bool) {
        let maps: Vec<MapId> = atlas.latest().maps().map(|(id, _)| id).collect();
        for map in maps {
            let count = atlas.latest().key_frames_of(map).count();
            if !(3..=self.config.final_adjustment_key_frames).contains(&count) {
                continue;
            }
            let window = WindowConfig { iterations: [40, 20], tolerance: 1e-6, ..self.config.window };
            if let Some(views) = &self.depth_views {
                let related = views.measure(atlas.latest(), map, &mut stop);
                if stop() {
                    return;
                }
                atlas.commit(related);
            }
            let snapshot = atlas.latest();
            let inertial = self.inertial.as_ref();
            let whole = |i: &Inertial| to_end(i.whole(snapshot, &self.camera, map, &window, &mut stop));
            let imu = inertial.and_then(whole);
            let motions = || windows::whole(Window::of(snapshot, &self.camera), &self.links, map);
            let result = imu.or_else(|| Some(motions()?.solve(&window, &mut stop)));
            if stop() {
                return;
            }
            atlas.commit(result.map_or(Vec::new(), |result| result.changes.changes));
        }
    }

    /// Keeps the depth of a key frame, before it is in any snapshot.
    fn keep_depth(&self, id: KeyFrameId, stamp: Stamp) {
        if let Some(views) = &self.depth_views {
            views.keep(id, stamp);
        }
    }

    async fn fuse(&self, atlas: &mut Atlas, id: KeyFrameId) {
        let near = around(atlas.latest(), id, self.config.fuse_neighbours);
        for neighbour in &near {
            let snapshot = atlas.latest().clone();
            let (Some(here), Some(there)) = (snapshot.key_frame(id), snapshot.key_frame(*neighbour)) else {
                continue;
            };
            let mine: Vec<LandmarkId> = here.landmarks.iter().flatten().copied().collect();
            atlas.commit(fuse_into(&snapshot, &self.camera, &mine, there));
            pause().await;
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

/// Changes that multiply a map's lengths by a factor and set the uncertainty of its scale after that.
fn rescaled(snapshot: &Snapshot, reference: KeyFrameId, factor: f64, sigma_log_scale: f64) -> Vec<Change> {
    let map = snapshot.surviving_ancestor(reference).and_then(|(id, _)| Some(snapshot.key_frame(id)?.map));
    let Some(map) = map else { return Vec::new() };
    let prior = snapshot.maps().find(|(id, _)| *id == map).and_then(|(_, prior)| prior.copied());
    let prior = prior.map(|prior| Change::MapPrior(map, MapPrior { sigma_log_scale, ..prior }));
    [Change::Rescale(map, factor)].into_iter().chain(prior).collect()
}

/// Changes that remove a key frame and all later ones, the newest first; roots stay.
fn removed_since(snapshot: &Snapshot, since: KeyFrameId) -> Vec<Change> {
    let later = snapshot.key_frames().filter(|k| k.id >= since && k.parent.is_some());
    let mut ids: Vec<KeyFrameId> = later.map(|k| k.id).collect();
    ids.reverse();
    ids.into_iter().map(Change::RemoveKeyFrame).collect()
}

/// The motion of a key frame without an IMU factor to an earlier one.
fn without_imu_factor(imu: &ImuSegment) -> InertialState {
    InertialState { velocity: imu.velocity, bias: imu.bias, still_sigma: imu.still_sigma, imu_factor: None }
}
