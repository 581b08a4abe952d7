//! What an IMU measured, as robots send it: it comes back as it was within the rounding, is said once, and stays when key frames go.

use crate::store::history::{camera, file, with_readings};
use cairn_atlas::store::pieces::{Pieces, read};
use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{
    Atlas, Change, ChangeSet, ImuFactor, InertialState, KeyFrame, KeyFrameId, LandmarkId, Snapshot,
};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{Bias, Preintegrated};
use cairn_sensor::{ImuNoise, ImuSample, Stamp};
use cairn_vision::{Frame, SensorMode};
use std::collections::BTreeMap;
use std::sync::Arc;

const NOISE: ImuNoise = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2e-3, accel_walk: 3e-3 };
/// Seconds between key frames, and readings a second.
const STEP: f64 = 0.4;
const RATE: f64 = 200.0;

fn mount() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.1, -1.2, 0.3)), Vec3::new(0.02, -0.01, 0.03))
}

/// Nanoseconds of a time in seconds, of a clock that runs since long.
fn stamp(t: f64) -> Stamp {
    Stamp(1_403_636_579_763_555_000 + (t * 1e9).round() as i64)
}

/// Readings of somebody who walks and looks around, with noise, and both ends between two readings.
fn readings(from: f64, to: f64) -> Vec<ImuSample> {
    let mut times = vec![from, to];
    let first = (from * RATE).floor() as usize + 1;
    times.extend((first..).map(|i| i as f64 / RATE).take_while(|t| *t < to - 1e-6));
    times.sort_by(f64::total_cmp);
    let noise = |t: f64, k: f64| ((t * 7919.0 * k).sin() * 43_758.545).fract();
    let one = |t: f64| {
        let gyro = Vec3::new((5.0 * t).sin(), 0.5 * (3.0 * t).cos(), -0.3);
        let accel = Vec3::new(2.0 * (11.0 * t).sin(), 9.7 + (12.0 * t).cos(), 0.4);
        let off = |k: f64| Vec3::new(noise(t, k), noise(t, k + 1.0), noise(t, k + 2.0));
        ImuSample::new(stamp(t), gyro + off(1.0) * 4e-3, accel + off(4.0) * 0.05)
    };
    times.into_iter().map(one).collect()
}

/// A map of some key frames that share a landmark, of a camera on an IMU.
fn walked(key_frames: usize) -> MapFile {
    let mut atlas = Atlas::new(Snapshot::new());
    let landmark = LandmarkId::from_index(0).unwrap();
    let mut before: Option<(KeyFrameId, f64)> = None;
    for n in 0..key_frames {
        let t = 0.0123 + n as f64 * STEP;
        let id = atlas.latest().next_key_frame_id();
        let mut frame = Frame::default();
        frame.stamp = stamp(t);
        frame.px.push([320.0, 240.0]);
        frame.raw.push([320.0, 240.0]);
        frame.octave.push(0);
        frame.angle.push(0.0);
        frame.descriptors.push([7; 32]);
        frame.depth.push(f32::NAN);
        frame.right_x.push(f32::NAN);
        frame.index(&camera());
        let at = Se3::new(So3::identity(), Vec3::new(0.1 * n as f64, 0.0, 0.0));
        let mut k = KeyFrame::new(id, Arc::new(frame), at, before.map(|(id, _)| id));
        let bias = Bias { gyro: Vec3::new(0.01, -0.02, 0.003), accel: Vec3::new(0.1, 0.05, -0.02) };
        let imu_factor = before.map(|(since, from)| {
            let sum = Arc::new(Preintegrated::of(NOISE, bias, readings(from, t)));
            ImuFactor { since, sum }
        });
        let still_sigma = (n == 3).then_some(0.05);
        k.motion = Some(InertialState { velocity: Vec3::new(0.3, 0.1, 1.2), bias, still_sigma, imu_factor });
        let mut changes = vec![Change::AddKeyFrame(Box::new(k))];
        if n == 0 {
            changes.push(Change::AddLandmark(landmark, Vec3::new(0.0, 0.0, 5.0)));
        }
        changes.push(Change::Observe(landmark, id, 0));
        atlas.commit(changes);
        before = Some((id, t));
    }
    let about = About { program: "cairn test".into(), sensor: SensorMode::Stereo, camera: camera() };
    let snapshot = atlas.latest().with_imu_from_camera(mount());
    MapFile { snapshot, about, attached: BTreeMap::new() }
}

fn changed(file: &MapFile, changes: Vec<Change>) -> MapFile {
    let snapshot = file.snapshot.apply(&ChangeSet { base: file.snapshot.version(), changes }).0;
    MapFile { snapshot, ..file.clone() }
}

fn factors(s: &Snapshot) -> Vec<&ImuFactor> {
    s.key_frames().filter_map(|k| k.motion.as_ref()?.imu_factor.as_ref()).collect()
}

/// What was sent measures the same, at any bias, much closer than the sensor does.
fn is_near(now: &Snapshot, then: &Snapshot) {
    assert_eq!(now.check(), Ok(()));
    let off = now.imu_from_camera().unwrap().inverse() * *then.imu_from_camera().unwrap();
    assert!(off.translation.norm() < 1e-12 && off.rotation.angle() < 1e-7);
    for (k, was) in now.key_frames().zip(then.key_frames()) {
        let (m, w) = (k.motion.as_ref().unwrap(), was.motion.as_ref().unwrap());
        assert!((m.velocity - w.velocity).norm() < 0.051 && (m.bias.gyro - w.bias.gyro).norm() < 1.01e-3);
        assert!((m.bias.accel - w.bias.accel).norm() < 0.021);
        assert_eq!(m.still_sigma.map(|s| s as f32), w.still_sigma.map(|s| s as f32));
    }
    let (now, then) = (factors(now), factors(then));
    assert_eq!(now.len(), then.len());
    for (f, was) in now.into_iter().zip(then) {
        assert_eq!((f.since, f.sum.noise()), (was.since, was.sum.noise()));
        let sigma = was.sum.motion_covariance().diagonal().map(f64::sqrt);
        for bias in [*was.sum.bias(), Bias { gyro: Vec3::x() * 0.03, accel: Vec3::y() * 0.3 }] {
            let again = |f: &ImuFactor| {
                Preintegrated::of(*f.sum.noise(), bias, f.sum.samples().to_vec()).gained(&bias)
            };
            let ((r, v, p), (r0, v0, p0)) = (again(f), again(was));
            let off = [(r.inverse() * r0).log(), v - v0, p - p0];
            for (i, off) in off.iter().enumerate() {
                assert!(off.norm() < 0.5 * sigma[3 * i], "{i}: {off} of {sigma}");
            }
        }
    }
}

#[test]
fn what_an_imu_measured_comes_back_in_less_than_a_kilobyte_a_key_frame() {
    let saved = walked(20);
    let mut pieces = Pieces::default();
    pieces.add(&saved).unwrap();
    is_near(&read(pieces.bytes()).unwrap().snapshot, &saved.snapshot);
    let of_imu = pieces.parts().unwrap().imu / 20;
    println!("{of_imu} bytes a key frame before packing, {} of all packed", pieces.bytes().len() / 20);
    assert!(of_imu < 700, "{of_imu} bytes a key frame");
    // What was rounded is not rounded again.
    let back = read(pieces.bytes()).unwrap();
    let mut again = Pieces::default();
    again.add(&back).unwrap();
    assert_eq!(again.parts().unwrap().imu, pieces.parts().unwrap().imu);
}

/// Without the mount readings are of no use.
#[test]
fn readings_of_an_imu_of_unknown_mount_are_not_sent() {
    let saved = file(3, 30, 12);
    let saved = MapFile { snapshot: with_readings(&saved.snapshot, NOISE), ..saved };
    let mut pieces = Pieces::default();
    pieces.add(&saved).unwrap();
    let back = read(pieces.bytes()).unwrap().snapshot;
    assert!(back.imu_from_camera().is_none() && back.key_frames().all(|k| k.motion.is_none()));
}

#[test]
fn readings_are_said_once_also_when_key_frames_go() {
    let saved = walked(20);
    let ids: Vec<KeyFrameId> = saved.snapshot.key_frames().map(|k| k.id).collect();
    for gone in [vec![7], vec![7, 8], vec![8, 7], vec![5, 12], vec![19]] {
        let mut pieces = Pieces::default();
        pieces.add(&saved).unwrap();
        let remove = gone.iter().map(|n| Change::RemoveKeyFrame(ids[*n])).collect();
        let fewer = changed(&saved, remove);
        pieces.add(&fewer).unwrap();
        let last = *pieces.lengths().last().unwrap();
        assert!(pieces.lengths().len() == 2 && last < 400, "{gone:?}: {last} bytes");
        is_near(&read(pieces.bytes()).unwrap().snapshot, &fewer.snapshot);
        // More of it at the next save, by a robot that was started again.
        let mut pieces = Pieces::open(pieces.bytes()).unwrap();
        let least = changed(&fewer, vec![Change::RemoveKeyFrame(ids[9])]);
        pieces.add(&least).unwrap();
        let last = *pieces.lengths().last().unwrap();
        assert!(pieces.lengths().len() == 3 && last < 400, "{gone:?} and 9: {last} bytes");
        is_near(&read(pieces.bytes()).unwrap().snapshot, &least.snapshot);
    }
}

/// A factor that would span too long a time is dropped, and so it is by those who have what was sent.
#[test]
fn readings_that_end_are_forgotten() {
    let saved = walked(30);
    let ids: Vec<KeyFrameId> = saved.snapshot.key_frames().map(|k| k.id).collect();
    let mut pieces = Pieces::default();
    pieces.add(&saved).unwrap();
    let fewer = changed(&saved, ids[3..20].iter().map(|id| Change::RemoveKeyFrame(*id)).collect());
    assert!(factors(&fewer.snapshot).len() < fewer.snapshot.key_frame_count() - 1);
    pieces.add(&fewer).unwrap();
    is_near(&read(pieces.bytes()).unwrap().snapshot, &fewer.snapshot);
}

#[test]
fn motions_are_sent_again_when_they_changed_by_more_than_matters() {
    let saved = walked(10);
    let last = saved.snapshot.key_frames().last().unwrap();
    let motion = last.motion.clone().unwrap();
    for (by, pieces_then) in [(0.01, 1), (0.1, 2)] {
        let mut pieces = Pieces::default();
        pieces.add(&saved).unwrap();
        let velocity = motion.velocity + Vec3::new(by, 0.0, 0.0);
        let now = changed(&saved, vec![Change::InertialState(last.id, velocity, motion.bias)]);
        pieces.add(&now).unwrap();
        assert_eq!(pieces.lengths().len(), pieces_then, "{by} m/s");
        is_near(&read(pieces.bytes()).unwrap().snapshot, &now.snapshot);
    }
    // So is where the camera is on the IMU, once that is better known.
    let mut pieces = Pieces::default();
    pieces.add(&saved).unwrap();
    let moved = mount().translation + Vec3::new(0.0, 0.04, 0.0);
    let now = changed(&saved, vec![Change::LeverArm(moved)]);
    pieces.add(&now).unwrap();
    let back = read(pieces.bytes()).unwrap().snapshot;
    assert!((back.imu_from_camera().unwrap().translation - moved).norm() < 1e-12);
    is_near(&back, &now.snapshot);
    let wrong = changed(&now, vec![Change::LeverArm(Vec3::new(f64::NAN, 0.0, 0.0))]);
    assert_eq!(wrong.snapshot.imu_from_camera(), now.snapshot.imu_from_camera());
}

/// The part of a robot that continued a map keeps the readings between its key frames.
#[test]
fn a_part_of_a_map_keeps_its_readings() {
    let saved = walked(10);
    let continued = MapFile { snapshot: saved.snapshot.continued_by(3), ..saved };
    let id = continued.snapshot.next_key_frame_id();
    let parent = continued.snapshot.key_frames().last().unwrap().clone();
    let mut more = vec![];
    for (n, since) in [(0, parent.id), (1, id)] {
        let of = KeyFrameId::from_index(id.index() + n).unwrap();
        let t = 0.0123 + (10 + n) as f64 * STEP;
        let mut frame = (*parent.frame).clone();
        frame.stamp = stamp(t);
        let mut k = KeyFrame::new(of, Arc::new(frame), parent.world_from_camera, Some(since));
        let mut motion = parent.motion.clone().unwrap();
        let sum = Preintegrated::of(NOISE, motion.bias, readings(t - STEP, t));
        motion.imu_factor = Some(ImuFactor { since, sum: Arc::new(sum) });
        k.motion = Some(motion);
        more.push(Change::AddKeyFrame(Box::new(k)));
        more.push(Change::Observe(LandmarkId::from_index(0).unwrap(), of, 0));
    }
    let continued = changed(&continued, more);
    let part = MapFile { snapshot: continued.snapshot.part_of(3).unwrap(), ..continued };
    let mut pieces = Pieces::default();
    pieces.add(&part).unwrap();
    let back = read(pieces.bytes()).unwrap().snapshot;
    is_near(&back, &part.snapshot);
    // That since a key frame of another robot is left out.
    assert_eq!((back.key_frame_count(), factors(&back).len()), (2, 1));
}

#[test]
fn what_is_damaged_is_refused_or_sound() {
    let saved = walked(4);
    let mut pieces = Pieces::default();
    pieces.add(&saved).unwrap();
    let second = saved.snapshot.key_frames().nth(2).unwrap().id;
    pieces.add(&changed(&saved, vec![Change::RemoveKeyFrame(second)])).unwrap();
    let bytes = pieces.bytes();
    let (mut read_at, mut refused) = (0, 0);
    for bit in 0..8 * bytes.len() {
        let mut damaged = bytes.to_vec();
        damaged[bit / 8] ^= 1 << (bit % 8);
        match read(&damaged) {
            Ok(map) => {
                map.snapshot.check().unwrap();
                for f in factors(&map.snapshot) {
                    let sound =
                        |s: &ImuSample| s.gyro.norm() < 2e3 && s.accel.norm() < 2e4 && s.noise_scale > 0.0;
                    assert!(f.sum.samples().iter().all(sound));
                    assert!(f.sum.samples().windows(2).all(|w| w[0].stamp < w[1].stamp));
                }
                read_at += 1;
            }
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 0 && read_at > 0, "{refused} refused, {read_at} read");
}
