//! What the estimate is made from: observations of landmarks from key frames, and the gyroscope's rotations between them.

use crate::gyro::GyroLink;
use cairn_adjust::{pinhole, weight};
use cairn_atlas::{MapId, Snapshot};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_inertial::Bias;
use cairn_solve::{Bundle, Freedom, Observation};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;

/// Key frames used at most: the newest.
const MOST_KEY_FRAMES: usize = 80;
/// A gyroscope's rotation is at least as uncertain as this, radians: the pictures' stamps are.
const LEAST_SIGMA: f64 = 3e-3;
/// Landmarks count from this many observations on.
const LEAST_VIEWS: usize = 3;

/// The problem. Its bundle is in the pixels of the guessed camera.
#[derive(Clone, Debug)]
pub struct LensProblem {
    /// Poses, landmarks and observations as measured.
    pub bundle: Bundle,
    /// The pixels that a readout longer by a second moves each observation by.
    pub slopes: Vec<Vec2>,
    /// Rotations by the gyroscope between the poses of the bundle.
    pub links: Vec<GyroLink>,
    /// The offset of the clocks and the readout time that links and observations were taken with, seconds.
    pub taken_with_s: [f64; 2],
}

impl LensProblem {
    /// From the newest key frames of a map that was made with a guessed camera without distortion;
    /// `imu_from_camera` is the rotation from the camera's to the gyroscope's axes. `None` for fewer than five key frames.
    pub fn of(
        snapshot: &Snapshot,
        map: MapId,
        camera: &RectifiedCamera,
        imu_from_camera: &So3,
    ) -> Option<Self> {
        let mut key_frames: Vec<_> = snapshot.key_frames_of(map).collect();
        key_frames.sort_by_key(|k| k.id);
        let key_frames = &key_frames[key_frames.len().saturating_sub(MOST_KEY_FRAMES)..];
        if key_frames.len() < 5 {
            return None;
        }
        let slots: BTreeMap<_, usize> = key_frames.iter().enumerate().map(|(i, k)| (k.id, i)).collect();
        let poses: Vec<Se3> = key_frames.iter().map(|k| k.world_from_camera).collect();
        let mut freedom = vec![Freedom::Free; poses.len()];
        freedom[0] = Freedom::Fixed;
        let Observations { points, observations, slopes } = Observations::of(snapshot, map, &slots);
        let links = key_frames.iter().enumerate().filter_map(|(to, k)| {
            let factor = k.motion.as_ref()?.imu_factor.as_ref()?;
            let from = *slots.get(&factor.since)?;
            let (rotation, ..) = factor.sum.gained(&Bias::default());
            let seconds = factor.sum.seconds();
            let noise = factor.sum.noise().gyro * seconds.sqrt();
            let rotation = imu_from_camera.inverse() * rotation * *imu_from_camera;
            let (first, last) = (factor.sum.samples().first()?, factor.sum.samples().last()?);
            let rates = [first, last].map(|reading| imu_from_camera.inverse() * reading.gyro);
            Some(GyroLink { from, to, rotation, rates, seconds, sigma: noise.hypot(LEAST_SIGMA) })
        });
        let links = links.collect();
        let camera = pinhole(camera);
        let bundle = Bundle {
            camera,
            own_cameras: Vec::new(),
            poses,
            freedom,
            points,
            observations,
            calibrations: Vec::new(),
        };
        let taken_with_s = [snapshot.imu_offset(), snapshot.readout().seconds];
        Some(Self { bundle, slopes, links, taken_with_s })
    }
}

impl LensProblem {
    /// The largest angle between the first key frame and another, radians: a lens is only seen well across a turn.
    pub fn turned_rad(&self) -> f64 {
        let Some(first) = self.bundle.poses.first() else { return 0.0 };
        let angle = |p: &Se3| (first.rotation.inverse() * p.rotation).angle();
        self.bundle.poses.iter().map(angle).fold(0.0, f64::max)
    }
}

/// The landmarks that several key frames see, what they see of them, and by how many pixels a second of readout moves that.
struct Observations {
    points: Vec<Vec3>,
    observations: Vec<Observation>,
    slopes: Vec<Vec2>,
}

impl Observations {
    fn of(snapshot: &Snapshot, map: MapId, slots: &BTreeMap<cairn_atlas::KeyFrameId, usize>) -> Self {
        let (mut points, mut out, mut slopes) = (Vec::new(), Vec::new(), Vec::new());
        let readout_s = snapshot.readout().seconds;
        for landmark in snapshot.landmarks() {
            let first = out.len();
            for o in &landmark.observations {
                let (Some(slot), Some(k)) = (slots.get(&o.key_frame), snapshot.key_frame(o.key_frame)) else {
                    continue;
                };
                if k.map != map {
                    continue;
                }
                let feature = o.feature as usize;
                let [u, v, _] = k.frame.pixel_with(feature, readout_s);
                let [later_u, later_v, _] = k.frame.pixel_with(feature, readout_s + 1.0);
                out.push(Observation {
                    pose: *slot as u32,
                    point: points.len() as u32,
                    pixel: [u, v, f64::NAN],
                    weight: weight(&k.frame, feature, &snapshot.octaves()),
                });
                slopes.push(Vec2::new(later_u - u, later_v - v));
            }
            if out.len() - first < LEAST_VIEWS {
                out.truncate(first);
                slopes.truncate(first);
            } else {
                points.push(landmark.position);
            }
        }
        Self { points, observations: out, slopes }
    }
}
