//! A gravity-aligned map with IMU readings for tests: a walk to and fro, exact but for what a test puts wrong.

use crate::synthetic::{View, World, mono, pose};
use cairn_atlas::{
    Atlas, Change, ImuFactor, ImuSegment, InertialState, KeyFrame, KeyFrameId, MapId, Snapshot,
};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_inertial::{Bias, Preintegrated};
use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, Stamp};
use cairn_vision::Frame;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

/// Seconds from key frame to key frame.
pub const STEP_S: f64 = 0.25;
/// Noise that the readings are said to have; they have none.
pub const NOISE: ImuNoise = ImuNoise { gyro: 3e-4, gyro_walk: 1e-4, accel: 3e-3, accel_walk: 1e-3 };

/// To and fro with the gait of a walker, in the world of the views (y is down).
pub fn position(t: f64) -> Vec3 {
    Vec3::new(0.8 * (0.8 * t).sin(), 0.008 * (1.8 * TAU * t).sin(), 0.5 * (0.6 * t).sin())
}

/// The walk and what is wrong with its map.
#[derive(Clone, Copy, Debug)]
pub struct ToAndFro {
    /// How far the camera turns to either side, radians.
    pub turn_rad: f64,
    /// How far the map is from level, radians.
    pub tilt_rad: f64,
    /// Units of the map in a metre.
    pub factor: f64,
}

impl ToAndFro {
    fn heading(&self, t: f64) -> f64 {
        self.turn_rad * (0.8 * t).sin()
    }

    fn at(&self, t: f64) -> Se3 {
        Se3::new(pose(0.0, 0.0, self.heading(t)).rotation, position(t))
    }

    fn reading(&self, t: f64) -> ImuSample {
        let h = 1e-3;
        let acceleration = (position(t + h) + position(t - h) - position(t) * 2.0) / (h * h);
        let force = self.at(t).rotation.inverse() * (acceleration - Vec3::y() * GRAVITY_M_S2);
        let rate = (self.heading(t + h) - self.heading(t - h)) / (2.0 * h);
        ImuSample::new(Stamp::from_seconds(t), Vec3::y() * rate, force)
    }

    fn link(&self, n: usize) -> Arc<Preintegrated> {
        let readings = (0..=25).map(|i| self.reading(STEP_S * (n as f64 + i as f64 / 25.0))).collect();
        Arc::new(Preintegrated::of(NOISE, Bias::default(), readings))
    }

    /// What belongs to the n-th key frame: the readings since the one before, whose stamps are so late, and the orientations of
    /// twenty frames a second.
    pub fn segment(&self, n: usize, late_s: f64) -> ImuSegment {
        let from_s = STEP_S * (n as f64 - 1.0);
        let reading = |i: i32| {
            let s = self.reading(from_s + STEP_S * f64::from(i) / 25.0);
            ImuSample { stamp: s.stamp.plus_seconds(late_s), ..s }
        };
        let turn = |i: i32| {
            let t = from_s + f64::from(i) / 20.0;
            (Stamp::from_seconds(t), self.at(t).rotation)
        };
        ImuSegment {
            velocity: Vec3::zeros(),
            bias: Bias::default(),
            still_sigma: None,
            up: None,
            samples: (0..=25).map(reading).collect(),
            unsound_since: None,
            offset_s: 0.0,
            turns: (0..5).map(turn).collect(),
        }
    }

    /// The map of so many key frames as vision alone makes it: y is down, and lengths are in a unit of its own.
    pub fn map_of_vision(&self, count: usize) -> (Atlas, Vec<KeyFrameId>) {
        let unit = Sim3 { scale: self.factor, ..Sim3::identity() };
        let (changes, ids) = self.seen(count, &unit, None);
        let mut atlas = Atlas::new(Snapshot::new());
        assert_eq!(atlas.commit(changes).dropped, 0);
        (atlas, ids)
    }

    /// A gravity-aligned map of so many key frames of the walk.
    pub fn map(&self, count: usize) -> (Atlas, Vec<KeyFrameId>) {
        self.map_but_for(count, None)
    }

    /// The same where one key frame sees nothing: points that come into view again are new landmarks.
    pub fn map_but_for(&self, count: usize, unseen: Option<usize>) -> (Atlas, Vec<KeyFrameId>) {
        let (mut changes, ids) = self.seen(count, &Sim3::identity(), unseen);
        let up = So3::exp(&(Vec3::x() * (self.tilt_rad - FRAC_PI_2)));
        changes.push(Change::AlignGravity(MapId(ids[0]), Sim3 { rotation: up, ..Sim3::identity() }));
        changes.push(Change::Rescale(MapId(ids[0]), self.factor));
        let mut atlas = Atlas::new(Snapshot::new());
        assert_eq!(atlas.commit(changes).dropped, 0);
        (atlas, ids)
    }

    /// The changes that make a map of the key frames, which have their readings.
    fn seen(
        &self,
        count: usize,
        map_from_world: &Sim3,
        unseen: Option<usize>,
    ) -> (Vec<Change>, Vec<KeyFrameId>) {
        let world = World::around(mono(), 71);
        let path: Vec<Se3> = (0..count).map(|n| self.at(STEP_S * n as f64)).collect();
        let mut views = world.walk(&path, 0.0, STEP_S);
        if let Some(n) = unseen {
            let mut frame = Frame::default();
            frame.stamp = views[n].frame.stamp;
            frame.index(&world.camera);
            views[n] = View { frame: Arc::new(frame), points: Vec::new() };
        }
        let mut seen = Atlas::new(Snapshot::new());
        let ids = world.map(&mut seen, &views, &path, None, |_| *map_from_world);
        let (seen, mut changes) = (seen.latest().clone(), Vec::new());
        for (n, id) in ids.iter().enumerate() {
            let k = seen.key_frame(*id).unwrap();
            let t = STEP_S * n as f64;
            let velocity = path[n].rotation.inverse() * (position(t + 1e-3) - position(t - 1e-3)) / 2e-3;
            let imu_factor =
                n.checked_sub(1).map(|before| ImuFactor { since: ids[before], sum: self.link(before) });
            let mut k = KeyFrame::new(k.id, k.frame.shared(), k.world_from_camera, k.parent);
            k.motion = Some(InertialState { velocity, bias: Bias::default(), still_sigma: None, imu_factor });
            changes.push(Change::AddKeyFrame(Box::new(k)));
        }
        for l in seen.landmarks() {
            changes.push(Change::AddLandmark(l.id, l.position));
            changes.extend(l.observations.iter().map(|o| Change::Observe(l.id, o.key_frame, o.feature)));
        }
        (changes, ids)
    }
}
