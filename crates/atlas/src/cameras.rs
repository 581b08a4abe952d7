//! Key frames of several cameras in one atlas: each knows the camera that its features are seen with.
//!
//! An atlas has a camera of its own, that of [`crate::store::About`]; most have no other. A key frame that another camera made
//! carries that one. Everything that projects into a key frame asks it for its camera, and distances at which landmarks are
//! found, which depend on the focal length, are those of the atlas's camera.

use crate::made_by::MadeBy;
use crate::store::{About, MapFile};
use crate::{CombineError, KeyFrame, MapId, OtherCamera, Snapshot};
use cairn_geometry::Se3;
use cairn_vision::{Frame, RectifiedCamera, SensorMode};
use std::sync::Arc;

impl KeyFrame {
    /// The camera of its features, where `atlas` is that of the atlas.
    pub fn camera<'a>(&'a self, atlas: &'a RectifiedCamera) -> &'a RectifiedCamera {
        self.other_camera.as_ref().map_or(atlas, |other| &other.camera)
    }

    /// Focal length of its camera over that of the atlas's: what a landmark's range of distances is multiplied by.
    pub fn focal_ratio(&self) -> f64 {
        self.other_camera.as_ref().map_or(1.0, |other| other.focal_ratio)
    }
}

impl Snapshot {
    /// The cameras of key frames that are not the atlas's.
    pub fn other_cameras(&self) -> impl Iterator<Item = &OtherCamera> {
        self.other_cameras.iter().map(|other| &**other)
    }

    /// Whether lengths in one map are metres, by the depth of some of its key frames, or by gravity.
    pub fn is_metric_in(&self, map: MapId, camera: &RectifiedCamera) -> bool {
        self.is_gravity_aligned(map) || self.has_depth_in(map, camera)
    }

    /// Whether some key frames of a map may have depth; `camera` is that of the atlas.
    pub(crate) fn has_depth_in(&self, map: MapId, camera: &RectifiedCamera) -> bool {
        match self.other_cameras.is_empty() {
            true => camera.has_depth(),
            false => self.made_by.has_depth(map, camera),
        }
    }

    /// Whether lengths in all maps are metres.
    pub fn is_metric(&self, camera: &RectifiedCamera) -> bool {
        match self.other_cameras.is_empty() {
            true => camera.has_depth() || self.is_gravity_aligned_throughout(),
            false => self.maps().all(|(map, _)| self.is_metric_in(map, camera)),
        }
    }

    /// The same snapshot without what IMUs of other cameras than the atlas's measured, and how these are mounted.
    pub fn without_other_imus(&self) -> Self {
        let without = |of: &OtherCamera| OtherCamera { imu_from_camera: None, ..*of };
        let mut others: Vec<Arc<OtherCamera>> = Vec::new();
        for of in self.other_cameras().map(without) {
            if !others.iter().any(|o| **o == of) {
                others.push(Arc::new(of));
            }
        }
        let mut snapshot = self.clone();
        for (id, of) in
            self.key_frames.iter().filter_map(|(id, k)| Some((id, without(k.other_camera.as_deref()?))))
        {
            if let Some(k) = snapshot.key_frames.get_mut(id) {
                (k.other_camera, k.motion) = (others.iter().find(|o| ***o == of).cloned(), None);
            }
        }
        snapshot.other_cameras = Arc::new(others);
        snapshot
    }

    /// The same maps in an atlas of another camera, `now`: the key frames of `was`, that of this atlas, carry it from now on,
    /// and so do all others theirs; those of `now` need not. What is measured with a right image is stated as if it had the disparity error
    /// `right_offset`, so that one correction serves all. With `with_imu`, key frames of other cameras keep what their IMU measured where it
    /// is known how it is mounted; all else of IMUs is left out.
    fn in_atlas_of(
        &self,
        was: (SensorMode, RectifiedCamera),
        now: (SensorMode, RectifiedCamera),
        right_offset: f64,
        with_imu: bool,
    ) -> Self {
        let mut snapshot = self.clone();
        let mounted = |of: Option<Se3>| of.filter(|_| with_imu);
        let correction = self.right_offset - right_offset;
        let mut others: Vec<Arc<OtherCamera>> = Vec::new();
        for id in self.key_frames.iter().map(|(id, _)| id) {
            let Some(k) = snapshot.key_frames.get_mut(id) else { continue };
            let of = k.other_camera.as_ref().map_or(was, |other| (other.sensor, other.camera));
            let mount = k.other_camera.as_ref().map_or(self.imu_from_camera, |other| other.imu_from_camera);
            let mount = mounted(mount);
            if correction != 0.0 && of.1.has_depth() {
                k.frame.change(|frame| shift_disparities(frame, &of.1, correction));
            }
            let is_it =
                |o: &&Arc<OtherCamera>| (o.sensor, o.camera, o.imu_from_camera) == (of.0, of.1, mount);
            let known = others.iter().find(is_it).cloned();
            let other = known.or_else(|| {
                let (sensor, camera) = of;
                let focal_ratio = camera.fx / now.1.fx;
                let stated = OtherCamera { sensor, camera, focal_ratio, imu_from_camera: mount };
                (of != now).then(|| Arc::new(stated))
            });
            let is_new = |other: &&Arc<OtherCamera>| !others.iter().any(|o| Arc::ptr_eq(o, other));
            others.extend(other.as_ref().filter(is_new).cloned());
            k.motion = k.motion.take().filter(|_| other.is_some() && mount.is_some());
            k.other_camera = other;
        }
        for (id, l) in self.landmarks.iter() {
            if let (Some(seen), Some(l)) = (snapshot.visibility(l), snapshot.landmarks.get_mut(id)) {
                (l.normal, l.min_distance, l.max_distance) = seen;
            }
        }
        snapshot.right_offset = right_offset;
        snapshot.imu_from_camera = None;
        snapshot.other_cameras = Arc::new(others);
        snapshot.made_by = MadeBy::of(snapshot.key_frames());
        snapshot
    }
}

impl MapFile {
    /// This map, ready to be put beside those of another one's atlas, whose camera may be any other: its key frames carry
    /// their camera along, and what an IMU measured.
    ///
    /// # Errors
    /// [`CombineError::Octaves`].
    pub fn in_atlas_of(&self, other: &MapFile) -> Result<Self, CombineError> {
        let octaves = [&self.snapshot, &other.snapshot].map(Snapshot::octaves);
        if octaves[0] != octaves[1] {
            return Err(CombineError::Octaves(octaves[0], octaves[1]));
        }
        let about = &other.about;
        Ok(self.in_atlas(about.sensor, &about.camera, other.snapshot.right_offset(), true))
    }

    /// Whether some of its key frames may be of this camera.
    pub fn has_key_frames_of(&self, sensor: SensorMode, camera: &RectifiedCamera) -> bool {
        let octaves = self.snapshot.octaves();
        let fits = |about: &About| about.fits(octaves, sensor, camera, octaves).is_ok();
        let of = |other: &OtherCamera| About {
            program: String::new(),
            sensor: other.sensor,
            camera: other.camera,
        };
        fits(&self.about) || self.snapshot.other_cameras().any(|other| fits(&of(other)))
    }

    /// This map in an atlas of any camera, whose right x have this error. Velocities and biases are left out: they are of another IMU.
    pub fn in_atlas_with(&self, sensor: SensorMode, camera: &RectifiedCamera, right_offset: f64) -> Self {
        self.in_atlas(sensor, camera, right_offset, false)
    }

    fn in_atlas(
        &self,
        sensor: SensorMode,
        camera: &RectifiedCamera,
        right_offset: f64,
        with_imu: bool,
    ) -> Self {
        let was = (self.about.sensor, self.about.camera);
        let snapshot = self.snapshot.in_atlas_of(was, (sensor, *camera), right_offset, with_imu);
        let about = About { program: self.about.program.clone(), sensor, camera: *camera };
        Self { snapshot, about, attached: self.attached.clone() }
    }
}

/// Adds to every measured right x, and to the depths that follow from it.
fn shift_disparities(frame: &mut Frame, camera: &RectifiedCamera, by: f64) {
    for (right_x, depth) in frame.right_x.iter_mut().zip(&mut frame.depth) {
        *right_x += by as f32;
        let disparity = camera.baseline_fx / f64::from(*depth) - by;
        *depth = if disparity > 0.0 { (camera.baseline_fx / disparity) as f32 } else { f32::NAN };
    }
}
