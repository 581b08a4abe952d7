//! What others may say of an IMU: anything. It is refused, and takes little memory.

use super::super::measured::give;
use super::super::pose::Pose;
use super::super::state::{KeyFrameState, Row, State};
use super::*;
use crate::KeyFrameId;
use cairn_geometry::Se3;
use cairn_vision::Frame;
use std::sync::Arc;

const HEAD_NOISE: [f64; 4] = [1e-3, 1e-5, 1e-2, 1e-4];
const STAMP: i64 = 1_700_000_000_000_000_000;

fn motion() -> Motion {
    Motion { velocity: [1, 2, 3], gyro_bias: [0; 3], accel_bias: [5; 3], still_sigma: Some(0.1) }
}

/// Half a second, 100 a second, up to key frame 2.
fn readings() -> Readings {
    let steps = std::iter::once(0).chain(std::iter::repeat_n(10_000, 50)).collect();
    let values = (0..51).map(|i| [i, -i, 3, 4, 1_255, i * i]).collect();
    Readings { since: 1, noise: 0, begins: STAMP / 1_000, steps, values, scales: vec![(20, 1.0), (31, 4.0)] }
}

fn key_frame(id: u32, stamp: i64) -> KeyFrame {
    let mut frame = Frame::default();
    frame.stamp = Stamp(stamp);
    let id = KeyFrameId::from_raw(id).expect("not 0");
    let mut k = KeyFrame::new(id, Arc::new(frame), Se3::identity(), None);
    k.map = crate::MapId(KeyFrameId::from_raw(1).expect("not 0"));
    k
}

fn state(motion: Motion, readings: Readings, noise: [f64; 4]) -> State {
    let mut state = State::default();
    state.head.imu = Some(ImuHead { imu_from_camera: [0.0; 7], noises: vec![noise] });
    for id in [1, 2] {
        let row = Row { stamp: 0, parent: 0, map: 1, unit: 1.0, camera: 0, findable: false, links: vec![] };
        state.key_frames.insert(id, KeyFrameState::new(row, Pose::of(&Se3::identity())));
    }
    let k = state.key_frames.get_mut(&2).expect("inserted");
    (k.motion, k.readings) = (Some(motion), Some(readings));
    state
}

/// The readings that come of it.
fn given(motion: Motion, readings: Readings, noise: [f64; 4]) -> Option<Vec<ImuSample>> {
    let mut key_frames = [key_frame(1, STAMP), key_frame(2, STAMP + 500_000_000)];
    give(&state(motion, readings, noise), &mut key_frames).ok()?;
    let factor = key_frames[1].motion.as_ref()?.imu_factor.as_ref()?;
    Some(factor.sum.samples().to_vec())
}

#[test]
fn absurd_readings_are_refused() {
    let samples = given(motion(), readings(), HEAD_NOISE).expect("sound");
    assert_eq!((samples.len(), samples[20].noise_scale, samples[19].noise_scale), (51, 4.0, 1.0));
    assert_eq!(samples[50].stamp.0, STAMP + 500_000_000);
    type Spoil = fn(&mut Readings);
    let spoils: [(&str, Spoil); 15] = [
        ("twice the same time", |r| r.steps[3] = 0),
        ("not from its first", |r| r.steps[0] = 1),
        ("too late", |r| r.begins += 3_000_000),
        ("at the end of time", |r| r.begins = i64::MAX),
        ("at its beginning", |r| r.begins = i64::MIN),
        ("too long", |r| r.steps[9] = u32::MAX),
        ("turns faster than anything", |r| r.values[3][0] = i32::MIN),
        ("NaN", |r| r.scales[0].1 = f32::NAN),
        ("no noise", |r| r.scales[0].1 = 0.0),
        ("fewer scales", |r| r.scales[1].0 = 30),
        ("more scales", |r| r.scales.extend([(u32::MAX, 1.0), (u32::MAX, 1.0)])),
        ("unknown noise", |r| r.noise = 1),
        ("since itself", |r| r.since = 2),
        ("since nothing", |r| r.since = 0),
        ("one reading", |r| (r.steps, r.values, r.scales) = (vec![0], vec![[0; 6]], vec![(1, 1.0)])),
    ];
    for (what, spoil) in spoils {
        let mut spoilt = readings();
        spoil(&mut spoilt);
        assert_eq!(given(motion(), spoilt, HEAD_NOISE), None, "{what}");
    }
    for noise in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(given(motion(), readings(), [1e-3, noise, 1e-2, 1e-4]), None, "noise {noise}");
    }
    for sigma in [0.0, -0.1, f32::NAN, f32::INFINITY] {
        let motion = Motion { still_sigma: Some(sigma), ..motion() };
        assert_eq!(given(motion, readings(), HEAD_NOISE), None, "stands still to {sigma}");
    }
    // Readings without a motion, and a motion without an IMU.
    let mut none = state(motion(), readings(), HEAD_NOISE);
    none.head.imu = None;
    assert!(give(&none, &mut [key_frame(1, STAMP), key_frame(2, STAMP)]).is_err());
    let mut none = state(motion(), readings(), HEAD_NOISE);
    none.key_frames.get_mut(&2).expect("there").motion = None;
    assert!(give(&none, &mut [key_frame(1, STAMP), key_frame(2, STAMP)]).is_err());
}

/// What a few bytes say over and over again comes to an end.
#[test]
fn joins_that_grow_without_end_are_refused() {
    let long = Readings {
        since: 0,
        begins: 0,
        steps: vec![1; MAX_READINGS / 2 - 1],
        values: vec![[0; 6]; MAX_READINGS / 2 - 1],
        scales: vec![(MAX_READINGS as u32 / 2 - 1, 1.0)],
        ..readings()
    };
    let mut state = state(motion(), readings(), HEAD_NOISE);
    state.key_frames.get_mut(&1).expect("there").readings = Some(long.clone());
    let n = MAX_ALL / MAX_READINGS + 2;
    let template = state.key_frames[&2].clone();
    for id in 2..2 + n as u32 {
        let mut k = template.clone();
        let next = Readings { since: 1, begins: MAX_READINGS as i64, ..long.clone() };
        k.readings = Some(next);
        state.key_frames.insert(id, k);
    }
    let joins = |n: usize| MotionDelta {
        joined: (2..2 + n as u32).map(|id| (id, 1)).collect(),
        ..MotionDelta::default()
    };
    assert!(joins(3).join(&mut state.clone()).is_some());
    assert!(joins(n).join(&mut state).is_none());
    // Nor does one become longer than a factor may be.
    let two = long.then(&Readings { begins: 1 << 20, ..long.clone() }).expect("short enough");
    assert!(two.then(&Readings { begins: 1 << 21, ..long }).is_none());
}

#[test]
fn columns_that_do_not_fit_each_other_are_refused() {
    let a = state(motion(), readings(), HEAD_NOISE);
    let mut before = a.clone();
    before.key_frames.get_mut(&2).expect("there").readings = None;
    let delta = MotionDelta::between(&before, &a, |_| false);
    let mut to = before.clone();
    delta.clone().apply(&mut to).expect("fits");
    assert_eq!(to, a);
    let spoils: [fn(&mut MotionDelta); 7] = [
        |d| d.steps.truncate(9),
        |d| d.steps.push(0),
        |d| d.values[3].truncate(9),
        |d| d.values[5].push(1),
        |d| d.heads[0].key_frame = 9,
        |d| d.heads[0].count = u32::MAX,
        |d| d.gone.push(1),
    ];
    for (n, spoil) in spoils.into_iter().enumerate() {
        let mut spoilt = delta.clone();
        spoil(&mut spoilt);
        assert!(spoilt.apply(&mut before.clone()).is_none(), "{n}");
    }
}
