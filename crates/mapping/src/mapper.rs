//! The mapping stage: one key frame in, the map grown, fused, adjusted and culled.

use crate::cull::{Nursery, redundant};
use crate::disparity::DisparityError;
use crate::fuse::{around, fuse_into};
use crate::grow::grow;
use crate::inertial::{Inertial, InertialSetting};
use crate::insert::{Births, Entry, add_key_frame, points_from_depth};
use crate::turning::hold_orientation;
use cairn_adjust::{Window, WindowSetting};
use cairn_atlas::{Atlas, Change, KeyFrameId, LandmarkId, Motion, Sensed, Tie, WorldId};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_inertial::Attempt;
use cairn_sensor::ImuSensor;
use cairn_solve::Report;
use cairn_vision::{EyeModel, Frame};
use std::sync::Arc;

/// How to map.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapperSetting {
    /// Neighbours searched for new points.
    pub grow_neighbours: usize,
    /// Neighbours searched for duplicates.
    pub fuse_neighbours: usize,
    /// The window of the local adjustment.
    pub window: WindowSetting,
    /// A key frame goes when more than this share of its landmarks is seen by three others.
    pub redundant_share: f64,
    /// Key frames up to which a map is adjusted as a whole when a run ends.
    pub settle_key_frames: usize,
    /// Points from depth that a key frame brings at least, where it has them.
    pub depth_points: usize,
}

impl Default for MapperSetting {
    fn default() -> Self {
        Self {
            grow_neighbours: 10,
            fuse_neighbours: 10,
            window: WindowSetting::default(),
            redundant_share: 0.9,
            settle_key_frames: 500,
            depth_points: 100,
        }
    }
}

/// Where a world begins.
#[derive(Clone, Debug)]
pub struct Begin {
    /// The pose of its root.
    pub world_from_eye: Se3,
    /// How it hangs on a former world, if there is one.
    pub tie: Option<Tie>,
    /// Units a second that the eye shall have gone, where there is no other scale; else the median depth is one.
    pub pace: Option<f64>,
    /// What the inertial sensor says of its last key frame.
    pub sensed: Option<Sensed>,
    /// Whether its lengths are metres and its z axis points up already.
    pub level: bool,
}

impl Default for Begin {
    fn default() -> Self {
        Self { world_from_eye: Se3::identity(), tie: None, pace: None, sensed: None, level: false }
    }
}

/// A frame that shall become a key frame of a world that is there.
#[derive(Clone, Copy, Debug)]
pub struct Offered<'a> {
    /// The frame.
    pub frame: &'a Arc<Frame>,
    /// The landmark that each feature shows.
    pub landmarks: &'a [Option<LandmarkId>],
    /// The key frame on which its place hangs.
    pub reference: KeyFrameId,
    /// Its place there.
    pub reference_from_eye: Se3,
    /// What the inertial sensor says of it.
    pub sensed: Option<&'a Sensed>,
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
    eye: EyeModel,
    setting: MapperSetting,
    nursery: Nursery,
    inertial: Option<Inertial>,
    /// Of a stereo rig, where it is looked for.
    disparity: Option<DisparityError>,
}

impl Mapper {
    /// A mapper for one eye.
    pub fn new(eye: EyeModel, setting: MapperSetting) -> Self {
        let disparity = DisparityError::within(setting.window.right_offset_sigma);
        Self { eye, setting, nursery: Nursery::default(), inertial: None, disparity }
    }

    /// The same with an inertial sensor; `imu_from_eye` in metres.
    pub fn feeling(self, sensor: &ImuSensor, imu_from_eye: Se3, setting: InertialSetting) -> Self {
        Self { inertial: Some(Inertial::new(sensor, imu_from_eye, setting)), ..self }
    }

    /// What tracking expected in a frame and whether it was found: young landmarks are judged by it.
    pub fn note(&mut self, seen: &[(LandmarkId, bool)]) {
        self.nursery.note(seen);
    }

    /// Begins a world with a frame that has depth.
    pub fn start(&mut self, atlas: &mut Atlas, frame: &Arc<Frame>, begin: &Begin) -> KeyFrameId {
        let map = atlas.latest();
        let id = map.next_key_frame_id();
        let mut births = Births::after(map);
        let nothing = vec![None; frame.len()];
        let motion = begin.sensed.as_ref().filter(|_| self.inertial.is_some()).map(still_unfelt);
        let entry = Entry { id, frame, world_from_eye: begin.world_from_eye, shown: &nothing, motion };
        let mut changes = add_key_frame(&entry, None);
        changes.extend(begin.tie.map(|tie| Change::Tie(WorldId(id), tie)));
        changes.extend(begin.level.then(|| Change::Level(WorldId(id), Sim3::identity())));
        changes.extend(points_from_depth(map, &self.eye, &entry, frame.len(), &mut births));
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
        let mut births = Births::after(&before);
        let scaled = Se3::new(first_from_second.rotation, first_from_second.translation * unit);
        let (none_a, none_b) = (vec![None; first.len()], vec![None; second.len()]);
        let felt = self.inertial.as_mut().zip(begin.sensed.as_ref());
        let motion = felt.as_ref().map(|(_, sensed)| still_unfelt(sensed));
        let entry_a =
            Entry { id: a, frame: first, world_from_eye: begin.world_from_eye, shown: &none_a, motion };
        let world_from_second = begin.world_from_eye * scaled;
        let motion = felt.map(|(inertial, sensed)| inertial.motion_since(Some(a), sensed));
        let entry_b =
            Entry { id: b, frame: second, world_from_eye: world_from_second, shown: &none_b, motion };
        let mut changes = add_key_frame(&entry_a, None);
        changes.extend(begin.tie.map(|tie| Change::Tie(WorldId(a), tie)));
        changes.extend(add_key_frame(&entry_b, Some(a)));
        for (i, j, p) in points {
            let id = births.id()?;
            changes.push(Change::AddLandmark(id, begin.world_from_eye * (p * unit)));
            changes.push(Change::Observe(id, a, *i));
            changes.push(Change::Observe(id, b, *j));
        }
        atlas.commit(changes);
        let window = WindowSetting { iterations: [10, 10], tolerance: 1e-6, ..self.setting.window };
        let settled = Window::whole(atlas.latest(), &self.eye, WorldId(a)).solve(&window, || false);
        atlas.commit(settled.changes.changes);
        self.nursery.admit(&births.born, b);
        Some(b)
    }

    /// Takes up a key frame. `stop` is asked between and within the steps: when it says true, what can wait is left
    /// for the next key frame.
    pub fn step(
        &mut self,
        atlas: &mut Atlas,
        offered: &Offered,
        mut stop: impl FnMut() -> bool,
    ) -> Option<Mapped> {
        let Offered { frame, landmarks, reference, reference_from_eye, sensed } = *offered;
        let depth = self.eye.has_depth();
        let map = atlas.latest().clone();
        let (parent, _) = map.living(reference)?;
        let world_from_eye = map.stand(reference, &reference_from_eye)?;
        let id = map.next_key_frame_id();
        let mut births = Births::after(&map);
        let alive: Vec<Option<LandmarkId>> =
            landmarks.iter().map(|l| l.filter(|l| map.landmark(*l).is_some())).collect();
        let world = map.key_frame(parent)?.world;
        let felt = self.inertial.as_mut().zip(sensed);
        let motion = felt.map(|(i, sensed)| i.motion(&map, world, frame.stamp, sensed));
        let entry = Entry { id, frame, world_from_eye, shown: &alive, motion };
        let mut changes = add_key_frame(&entry, Some(parent));
        if depth {
            let least = self.setting.depth_points;
            changes.extend(points_from_depth(&map, &self.eye, &entry, least, &mut births));
        }
        atlas.commit(changes);
        atlas.commit(self.nursery.judge(atlas.latest(), id, depth));
        self.nursery.admit(&births.born, id);
        let mut born = births.born.len();

        let map = atlas.latest().clone();
        let mut births = Births::after(&map);
        atlas.commit(grow(&map, &self.eye, id, self.setting.grow_neighbours, &mut births, &mut stop));
        self.nursery.admit(&births.born, id);
        born += births.born.len();
        if !depth {
            let mut births = Births::after(atlas.latest());
            let held = hold_orientation(atlas.latest(), &self.eye, id, &mut births);
            atlas.commit(held);
            self.nursery.admit(&births.born, id);
            born += births.born.len();
        }

        let mut adjustment = None;
        if !stop() {
            self.fuse(atlas, id);
        }
        if !stop() && atlas.latest().key_frame_count() > 2 {
            let mut window = self.setting.window;
            let found = atlas.latest().right_offset();
            if let Some(error) = &self.disparity {
                window.right_offset_sigma = error.sigma(found == 0.0);
            }
            let (map, setting) = (atlas.latest(), &window);
            let felt = self.inertial.as_ref().and_then(|i| i.window(map, &self.eye, id, setting));
            let settled = match felt {
                Some(window) => window.solve(setting, &mut stop),
                None => {
                    let window = Window::around(map, &self.eye, id, setting)?;
                    window.solve(setting, &mut stop)
                }
            };
            adjustment = Some(settled.report);
            let calibrated = self.disparity.as_mut().and_then(|error| error.hear(found, &settled));
            atlas.commit(settled.changes.changes);
            atlas.commit(calibrated.into_iter().collect());
            let gone = redundant(atlas.latest(), &self.eye, id, self.setting.redundant_share);
            atlas.commit(gone.into_iter().collect());
        }
        let attempt = match &mut self.inertial {
            Some(inertial) => inertial.settle(atlas, &self.eye, id, &self.setting.window),
            None => None,
        };
        Some(Mapped { key_frame: id, born, adjustment, attempt })
    }

    /// Adjusts each world as a whole, as a run ends; worlds of more than `settle_key_frames` are left as they are, since
    /// their windows have settled long ago and the dense reduced system would not fit the time.
    pub fn settle(&mut self, atlas: &mut Atlas) {
        let worlds: Vec<WorldId> = atlas.latest().worlds().map(|(id, _)| id).collect();
        for world in worlds {
            let map = atlas.latest();
            if !(3..=self.setting.settle_key_frames).contains(&map.key_frames_of(world).count()) {
                continue;
            }
            let window = WindowSetting { iterations: [40, 20], tolerance: 1e-6, ..self.setting.window };
            let felt = self.inertial.as_ref().and_then(|i| i.whole(map, &self.eye, world, &window, || false));
            let settled =
                felt.unwrap_or_else(|| Window::whole(map, &self.eye, world).solve(&window, || false));
            atlas.commit(settled.changes.changes);
        }
    }

    fn fuse(&self, atlas: &mut Atlas, id: KeyFrameId) {
        let near = around(atlas.latest(), id, self.setting.fuse_neighbours);
        for neighbour in &near {
            let map = atlas.latest().clone();
            let (Some(here), Some(there)) = (map.key_frame(id), map.key_frame(*neighbour)) else { continue };
            let mine: Vec<LandmarkId> = here.landmarks.iter().flatten().copied().collect();
            atlas.commit(fuse_into(&map, &self.eye, &mine, there));
        }
        let map = atlas.latest().clone();
        let Some(here) = map.key_frame(id) else { return };
        let mut theirs: Vec<LandmarkId> = near
            .iter()
            .filter_map(|k| map.key_frame(*k))
            .flat_map(|k| k.landmarks.iter().flatten().copied())
            .collect();
        theirs.sort_unstable();
        theirs.dedup();
        atlas.commit(fuse_into(&map, &self.eye, &theirs, here));
    }
}

/// The motion of a key frame before which nothing was felt.
fn still_unfelt(sensed: &Sensed) -> Motion {
    Motion { velocity: sensed.velocity, bias: sensed.bias, felt: None }
}
