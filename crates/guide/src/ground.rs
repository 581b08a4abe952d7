//! The ground plane: the up direction, points seen from above, and the heading of a camera.
//!
//! Input: points and poses in the odom frame. Output: plane coordinates in metres, headings in radians,
//! counter-clockwise seen from above, so that a positive difference of headings is a turn to the left.

use cairn_geometry::{Mat3, Se3, So3, Vec2, Vec3};
use std::f64::consts::PI;

/// The plane perpendicular to gravity, with two fixed axes in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    up: Vec3,
    first: Vec3,
    second: Vec3,
}

impl Ground {
    /// From a vector that points up; `None` when it is zero or not finite.
    pub fn new(up: Vec3) -> Option<Self> {
        let norm = up.norm();
        if !(norm.is_finite() && norm > 1e-9) {
            return None;
        }
        let up = up / norm;
        let seed = if up.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() };
        let first = (seed - up * seed.dot(&up)).normalize();
        Some(Self { up, first, second: up.cross(&first) })
    }

    /// For a frame whose z axis points up.
    pub fn z_up() -> Self {
        Self { up: Vec3::z(), first: Vec3::x(), second: Vec3::y() }
    }

    /// For a map that starts at a level camera without gravity alignment: up is minus y of that camera.
    pub fn first_camera() -> Self {
        Self { up: -Vec3::y(), first: Vec3::x(), second: Vec3::z() }
    }

    /// For a walk in a frame without gravity alignment: up is the direction with the smallest component along the
    /// cameras' right axes, as a camera on a chest is pitched down by an unknown angle but does not roll to one side
    /// for long.
    ///
    /// Least squares over all poses (x right, y down, z forward): `sum (up . right)^2 + w |up + down|^2`. The weight
    /// `w` is small, so the second term decides only what the walk does not observe: without turns, the pitch. `None`
    /// without poses, or when they cancel out.
    pub fn of_walk<'a>(frame_from_camera: impl IntoIterator<Item = &'a Se3>) -> Option<Self> {
        const WEIGHT: f64 = 0.01;
        let (mut scatter, mut above, mut count) = (Mat3::zeros(), Vec3::zeros(), 0.0);
        for pose in frame_from_camera {
            let right = pose.rotation * Vec3::x();
            scatter += right * right.transpose();
            above -= pose.rotation * Vec3::y();
            count += 1.0;
        }
        let normal = scatter + Mat3::identity() * (WEIGHT * count);
        Self::new(normal.try_inverse()? * above)
    }

    /// The same plane in another frame.
    pub fn rotated(&self, to_from_here: &So3) -> Self {
        let [up, first, second] = [self.up, self.first, self.second].map(|axis| *to_from_here * axis);
        Self { up, first, second }
    }

    /// The unit vector that points up.
    pub fn up(&self) -> Vec3 {
        self.up
    }

    /// A point projected onto the plane, in metres.
    pub fn plane(&self, p: &Vec3) -> Vec2 {
        Vec2::new(p.dot(&self.first), p.dot(&self.second))
    }

    /// The height of a point above the plane through the origin, in metres.
    pub fn height(&self, p: &Vec3) -> f64 {
        p.dot(&self.up)
    }

    /// The point with these plane coordinates and this height.
    pub fn point(&self, plane: &Vec2, height: f64) -> Vec3 {
        self.first * plane.x + self.second * plane.y + self.up * height
    }

    /// The direction in which a camera (x right, y down, z forward) looks, as a heading in radians; `None` where it
    /// has none (looking straight up while lying on its side, or values that are not finite).
    ///
    /// The optical axis and the right axis both contribute, each by its horizontal part, so that
    /// neither pitch nor a small roll leaks into the heading, even when the camera looks at the feet.
    pub fn heading(&self, frame_from_camera: &Se3) -> Option<f64> {
        let level = |v: Vec3| self.plane(&(frame_from_camera.rotation * v));
        let ahead = level(Vec3::z());
        let right = level(Vec3::x());
        let both = ahead + Vec2::new(-right.y, right.x);
        let f = if both.norm() > 0.5 { both } else { ahead };
        (f.norm() > 0.3).then(|| f.y.atan2(f.x))
    }
}

/// An angle wrapped into (-pi, pi].
pub fn wrap(angle: f64) -> f64 {
    let a = angle.rem_euclid(2.0 * PI);
    if a > PI { a - 2.0 * PI } else { a }
}

/// The unit vector of a heading.
pub fn direction(heading: f64) -> Vec2 {
    Vec2::new(heading.cos(), heading.sin())
}

/// The heading of a plane vector in radians.
pub fn heading_of(v: &Vec2) -> f64 {
    v.y.atan2(v.x)
}

/// The cross product of two plane vectors: positive where `b` points to the left of `a`.
pub fn cross(a: &Vec2, b: &Vec2) -> f64 {
    a.x * b.y - a.y * b.x
}

/// The level pose of a camera 1.3 m above the ground that looks along `heading`, tilted down.
pub fn camera_pose(x: f64, y: f64, heading: f64, tilt_down: f64) -> Se3 {
    let (s, c) = heading.sin_cos();
    let level = Mat3::from_columns(&[Vec3::new(s, -c, 0.0), -Vec3::z(), Vec3::new(c, s, 0.0)]);
    let tilt = So3::exp(&Vec3::new(-tilt_down, 0.0, 0.0));
    Se3::new(So3::from_matrix(&level) * tilt, Vec3::new(x, y, 1.3))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pose of a camera with this heading, pitched down and rolled, in a frame with z up.
    fn camera(heading: f64, pitch_down: f64, roll: f64) -> Se3 {
        let (s, c) = heading.sin_cos();
        let level = Mat3::from_columns(&[Vec3::new(s, -c, 0.0), -Vec3::z(), Vec3::new(c, s, 0.0)]);
        let tilt = So3::exp(&Vec3::new(-pitch_down, 0.0, 0.0)) * So3::exp(&Vec3::new(0.0, 0.0, roll));
        Se3::new(So3::from_matrix(&level) * tilt, Vec3::zeros())
    }

    #[test]
    fn pitch_does_not_leak_into_heading() {
        let ground = Ground::z_up();
        for k in -6..=6 {
            let yaw = 0.5 * k as f64;
            for pitch in [-0.6, 0.0, 0.5, 1.2, 1.5] {
                let h = ground.heading(&camera(yaw, pitch, 0.0)).unwrap();
                assert!(wrap(h - yaw).abs() < 1e-9, "yaw {yaw} pitch {pitch} gave {h}");
            }
            let h = ground.heading(&camera(yaw, 0.5, 0.15)).unwrap();
            assert!(wrap(h - yaw).abs() < 0.05, "a small roll moved the heading by {}", wrap(h - yaw));
        }
    }

    #[test]
    fn up_direction_from_a_walk_with_turns() {
        let tilted = So3::exp(&Vec3::new(0.2, -0.1, 0.4));
        let angle = |headings: &[f64]| {
            let walk: Vec<Se3> = (headings.iter())
                .flat_map(|h| (0..40).map(move |k| camera(*h, 0.15, 0.012 * (0.7 * k as f64).sin())))
                .map(|p| Se3::new(tilted * p.rotation, p.translation))
                .collect();
            let up = Ground::of_walk(&walk).unwrap().up();
            up.angle(&(tilted * Vec3::z())).to_degrees()
        };
        assert!(angle(&[0.0, 1.5, 0.0, -1.5]) < 1.0, "{}", angle(&[0.0, 1.5, 0.0, -1.5]));
        // Without turns the pitch cannot be distinguished from a slope: 0.15 rad.
        assert!(angle(&[0.3]) < 8.7, "{}", angle(&[0.3]));
        assert!(Ground::of_walk(&[]).is_none());
    }

    #[test]
    fn left_is_positive_in_both_conventions() {
        // A camera frame without gravity: x right, y down, z forward; turning left moves z towards minus x.
        let ground = Ground::first_camera();
        let before = ground.heading(&Se3::identity()).unwrap();
        let left = Se3::new(So3::exp(&Vec3::new(0.0, -0.3, 0.0)), Vec3::zeros());
        assert!((left.rotation * Vec3::z()).x < 0.0);
        assert!((wrap(ground.heading(&left).unwrap() - before) - 0.3).abs() < 1e-9);
        let general = Ground::new(-Vec3::y()).unwrap();
        assert!(
            (wrap(general.heading(&left).unwrap() - general.heading(&Se3::identity()).unwrap()) - 0.3).abs()
                < 1e-9
        );
        assert!(Ground::new(Vec3::zeros()).is_none());
        assert!(Ground::new(Vec3::new(f64::NAN, 0.0, 1.0)).is_none());
    }
}
