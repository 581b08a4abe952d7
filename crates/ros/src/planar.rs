//! A robot that moves on a plane: poses and covariances of three degrees of freedom, and a watch for floors that are none.

use cairn::Stamp;
use cairn::geometry::{Se3, So3, Vec3};
use nalgebra::Matrix6;

/// Variance of what is fixed, m^2 and rad^2: filters do not accept zeros.
const FIXED: f64 = 1e-6;
/// Tilt against the plane above which the floor is not flat, radians: ramps for wheelchairs have 3.4 to 7 degrees, a robot that brakes
/// nods by one or two.
const TILT_RAD: f64 = 0.08;
/// Height above the plane likewise, metres, and for each metre from the start: a camera that is mounted 3 degrees off climbs so.
const HEIGHT_M: [f64; 2] = [0.25, 0.05];
/// How long that must last, seconds.
const LASTS_S: f64 = 2.0;

/// A pose with place and heading alone.
pub fn planar(pose: &Se3) -> Se3 {
    let ahead = pose.rotation * Vec3::x();
    let rotation = So3::exp(&(Vec3::z() * ahead.y.atan2(ahead.x)));
    Se3::new(rotation, Vec3::new(pose.translation.x, pose.translation.y, 0.0))
}

/// A covariance (x, y, z, and the rotations about them) with what is known of place and heading alone.
pub fn planar_covariance(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    const FREE: [usize; 3] = [0, 1, 5];
    Matrix6::from_fn(|i, j| match (FREE.contains(&i) && FREE.contains(&j), i == j) {
        (true, _) => covariance[(i, j)],
        (false, true) => FIXED,
        (false, false) => 0.0,
    })
}

/// What the camera measures against the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotFlat {
    /// Between the robot's upward axis and that of the map, degrees.
    pub tilt_deg: f64,
    /// Of the robot in the map, metres.
    pub height_m: f64,
}

/// Watches whether the floor is flat.
#[derive(Clone, Copy, Debug, Default)]
pub struct FloorWatch {
    since: Option<Stamp>,
}

impl FloorWatch {
    /// The robot in the map as the camera measures it; what contradicts the plane, once it has for a while. Heights count where
    /// lengths are metres.
    pub fn step(&mut self, stamp: Stamp, map_from_base: &Se3, metric: bool) -> Option<NotFlat> {
        let up = map_from_base.rotation * Vec3::z();
        let (at, tilt) = (map_from_base.translation, up.z.clamp(-1.0, 1.0).acos());
        let most_m = HEIGHT_M[0] + HEIGHT_M[1] * at.xy().norm();
        if tilt <= TILT_RAD && (at.z.abs() <= most_m || !metric) {
            self.since = None;
            return None;
        }
        let since = *self.since.get_or_insert(stamp);
        (stamp - since >= LASTS_S).then(|| NotFlat { tilt_deg: tilt.to_degrees(), height_m: at.z })
    }
}

impl std::fmt::Display for NotFlat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { tilt_deg, height_m } = self;
        write!(
            f,
            "the floor is not flat, or --base-from-camera is off: the camera measures a tilt of {tilt_deg:.0} degrees and a height of \
             {height_m:.2} m, and --planar leaves both out"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(k: usize, pitch: f64, height: f64) -> (Stamp, Se3) {
        let turned = So3::exp(&Vec3::new(0.0, 0.0, 0.7)) * So3::exp(&Vec3::new(0.0, -pitch, 0.0));
        (Stamp(k as i64 * 100_000_000), Se3::new(turned, Vec3::new(2.0, -1.0, height)))
    }

    #[test]
    fn place_and_heading_are_kept() {
        let (_, pose) = at(0, 0.2, 0.3);
        let flat = planar(&pose);
        assert_eq!(flat.translation, Vec3::new(2.0, -1.0, 0.0));
        assert!((flat.rotation.log() - Vec3::new(0.0, 0.0, 0.7)).norm() < 1e-12);
        let covariance = planar_covariance(&Matrix6::from_fn(|i, j| (1 + i.min(j)) as f64));
        assert_eq!((covariance[(0, 5)], covariance[(1, 1)], covariance[(5, 5)]), (1.0, 2.0, 6.0));
        assert_eq!((covariance[(2, 2)], covariance[(0, 2)], covariance[(3, 4)]), (FIXED, 0.0, 0.0));
    }

    #[test]
    fn a_ramp_is_noticed_and_a_nod_is_not() {
        let mut watch = FloorWatch::default();
        let mut seen = |k, pitch, height| {
            let (stamp, pose) = at(k, pitch, height);
            watch.step(stamp, &pose, true)
        };
        assert!((0..15).all(|k| seen(k, 0.15, 0.0).is_none()), "a nod of 1.5 s");
        assert!((15..60).all(|k| seen(k, 0.03, 0.3).is_none()), "a camera that is mounted a little off");
        let ramp: Vec<_> = (60..90).filter_map(|k| seen(k, 0.12, 0.2)).collect();
        assert_eq!(ramp.len(), 10);
        assert!((ramp[0].tilt_deg - 6.9).abs() < 0.1 && ramp[0].to_string().contains("7 degrees"));
        assert!(seen(90, 0.0, 0.0).is_none() && seen(91, 0.0, 0.8).is_none(), "begins anew");
        assert!(seen(111, 0.0, 0.8).is_some(), "a storey that was driven up");
        let (stamp, pose) = at(140, 0.0, 0.8);
        assert!(watch.step(stamp, &pose, false).is_none(), "not metres");
    }
}
