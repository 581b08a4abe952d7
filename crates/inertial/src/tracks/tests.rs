//! Walks with a phone that turns: readings, and rays to points 1 to 6 m away.

use super::*;
use crate::{Bias, Preintegrated};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_random::Random;
use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, Stamp};
use cairn_solve::to_end;

const NOISE: ImuNoise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-4, accel: 1e-2, accel_walk: 1e-3 };
const FOCAL_PX: f64 = 500.0;
const FRAME_S: f64 = 0.2;
const FRAMES: usize = 16;

/// What the phone is, and how it goes: its speed in m/s and the rate at which it turns to the side, rad/s.
#[derive(Clone, Copy)]
struct Phone {
    offset_s: f64,
    readout_s: f64,
    focal: f64,
    speed: f64,
    turn: f64,
}

const PHONE: Phone = Phone { offset_s: 0.0, readout_s: 0.0, focal: 1.0, speed: 1.0, turn: 0.4 };

impl Phone {
    /// The camera of a walker who bobs, sways and turns; z ahead, y down at first.
    fn pose(&self, t: f64) -> Se3 {
        let turn = So3::exp(&Vec3::new(
            0.06 * (7.0 * t).sin(),
            self.turn * t + 0.05 * (5.0 * t).sin(),
            0.04 * (6.0 * t).cos(),
        ));
        let ahead = self.speed * t + 0.02 * self.speed * (11.5 * t).sin();
        let bob = self.speed * Vec3::new(0.03 * (5.7 * t).sin(), 0.03 * (11.5 * t).cos(), 0.0);
        Se3::new(turn, Vec3::new(0.0, 0.0, ahead) + bob)
    }

    fn reading(&self, t: f64) -> ImuSample {
        let h = 1e-4;
        let place = |t: f64| self.pose(t).translation;
        let acceleration = (place(t + h) - place(t) * 2.0 + place(t - h)) / (h * h);
        let rotation = self.pose(t).rotation;
        let gyro = (self.pose(t - h).rotation.inverse() * self.pose(t + h).rotation).log() / (2.0 * h);
        let accel = rotation.inverse() * (acceleration - Vec3::y() * GRAVITY_M_S2);
        ImuSample::new(Stamp::from_seconds(t), gyro + Vec3::new(0.002, -0.002, 0.001), accel)
    }

    /// Readings between frames, and the tracks of points; frames are stamped so much later than they were taken.
    fn walk(&self, seed: u64) -> (Vec<Preintegrated>, Vec<Vec<TrackPoint>>) {
        let mut random = Random::new(seed);
        let links = (1..FRAMES).map(|k| {
            let from = 1.0 + FRAME_S * (k - 1) as f64;
            let reading = |i: u32| self.reading(from + FRAME_S * f64::from(i) / 40.0);
            Preintegrated::of(NOISE, Bias::default(), (0..=40).map(reading).collect())
        });
        let links = links.collect();
        let mut tracks = Vec::new();
        for k in 0..FRAMES - 2 {
            for _ in 0..25 {
                let [x, y] = [random.uniform(-0.6, 0.6), random.uniform(-0.45, 0.45)];
                let at = self.pose(1.0 + FRAME_S * k as f64);
                let point = at * (Vec3::new(x, y, 1.0) * random.uniform(1.0, 6.0));
                let seen = (k..FRAMES.min(k + 5)).map_while(|n| self.see(n, &point, &mut random));
                let track: Vec<TrackPoint> = seen.collect();
                if track.len() > 1 {
                    tracks.push(track);
                }
            }
        }
        (links, tracks)
    }

    fn see(&self, n: usize, point: &Vec3, random: &mut Random) -> Option<TrackPoint> {
        let t = 1.0 + FRAME_S * n as f64 - self.offset_s;
        let ray = |t: f64| {
            let p = self.pose(t).inverse() * *point;
            (p.z > 0.3).then(|| [p.x / p.z, p.y / p.z])
        };
        let row = |ray: [f64; 2]| ray[1] / 0.9;
        let mut seen = ray(t)?;
        for _ in 0..4 {
            seen = ray(t + row(seen) * self.readout_s)?;
        }
        let [before, after] = [ray(t - 1e-3)?, ray(t + 1e-3)?];
        let noise = 0.5 / FOCAL_PX;
        let by = |i: usize| -(after[i] - before[i]) / 2e-3 * row(seen) * self.focal;
        let of = |i: usize, r: f64| seen[i] * self.focal + noise * r;
        let [a, b] = [random.standard_normal(), random.standard_normal()];
        (seen[0].abs() < 0.65 && seen[1].abs() < 0.5).then(|| TrackPoint {
            frame: n,
            ray: [of(0, a), of(1, b)],
            by_readout: [by(0), by(1)],
        })
    }

    fn found(&self, seed: u64) -> Option<TrackMotion> {
        let (links, tracks) = self.walk(seed);
        let priors = TrackPriors {
            ray: 1.0 / FOCAL_PX,
            bias: [0.01, 0.1],
            offset_s: 0.02,
            log_focal: 0.1,
            readout_s: 0.02,
        };
        let imu_from_camera = Se3::identity();
        to_end(motion_of_tracks(&Tracks { links: &links, tracks: &tracks, imu_from_camera, priors }))
    }

    /// The length of the way that was found over the true one.
    fn scale(&self, found: &TrackMotion) -> f64 {
        let place = |k: usize| found.states[k].world_from_imu.translation;
        let real = |k: usize| self.pose(1.0 + FRAME_S * k as f64).translation;
        (place(FRAMES - 1) - place(0)).norm() / (real(FRAMES - 1) - real(0)).norm()
    }
}

#[test]
fn a_walk_of_three_seconds_has_metres_and_says_how_well() {
    for seed in 1..6 {
        for turn in [0.0, 0.4, 1.2] {
            let phone = Phone { turn, ..PHONE };
            let found = phone.found(seed).expect("a motion");
            let off = phone.scale(&found).ln();
            assert!(found.scale_sigma < 0.1, "{turn}: {}", found.scale_sigma);
            assert!(off.abs() < 3.0 * found.scale_sigma + 0.01, "{turn}: {off} of {}", found.scale_sigma);
            assert!(found.agreeing > 0.9, "{}", found.agreeing);
        }
    }
}

#[test]
fn clocks_rows_and_lens_are_found_with_it() {
    for seed in 1..6 {
        let phone = Phone { offset_s: 0.012, readout_s: 0.02, focal: 1.05, ..PHONE };
        let found = phone.found(seed).expect("a motion");
        let of = |known: [f64; 2], real: f64| ((known[0] - real) / known[1], known[1]);
        for (name, (off, sigma), most) in [
            ("offset", of(found.offset_s, 0.012), 0.004),
            ("focal", of(found.log_focal, 1.05f64.ln()), 0.02),
            ("readout", of(found.readout_s, 0.02), 0.006),
        ] {
            assert!(off.abs() < 4.0 && sigma < most, "{name}: {off} sigma of {sigma}");
        }
        assert!((phone.scale(&found).ln()).abs() < 3.0 * found.scale_sigma + 0.01, "{}", phone.scale(&found));
    }
}

#[test]
fn who_hardly_moves_is_told_no_metres() {
    let phone = Phone { speed: 0.01, turn: 0.3, ..PHONE };
    let found = phone.found(3);
    assert!(found.is_none_or(|found| found.scale_sigma > 0.1), "metres of nothing");
}
