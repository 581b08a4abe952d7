//! The ground as a plane, followed from image to image.

use crate::DepthFrame;
use cairn_geometry::{Mat3, Se3, Vec2, Vec3};

/// About so many pixels along a row are looked at, and as closely along the columns.
const ACROSS: usize = 64;
/// The ground lies this far below the camera, in metres: from a camera in the hand of a child to one on a tall man's head.
const BELOW_M: [f64; 2] = [0.4, 2.2];
/// Horizontal distance from the camera within which the ground is fitted, in metres.
const NEAR_M: f64 = 4.0;
/// Width of the bins in which the ground's height is searched, in metres.
const BIN_M: f64 = 0.025;
/// Points farther from the plane are not on it, in metres.
const OFF_M: f64 = 0.07;
/// Cosine of the steepest angle at which a piece of surface counts as about level: noise tilts small pieces.
const LEVEL: f64 = 0.88;
/// Fewer points do not make a ground.
const LEAST: usize = 40;
/// Greatest slope, rise over run: beyond it the frame is not level, or this is no ground.
const STEEPEST: f64 = 0.12;
/// Share of a new fit that is taken over.
const GAIN: f64 = 0.3;
/// Who climbs carries the camera along: ground that is nearer to the camera than the ground before by more than this is a table
/// or a shelf in front of it, in metres.
const CARRIED_M: f64 = 0.3;

/// The ground plane near the walker: height `base + slope . (at - origin)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Floor {
    plane: Option<Plane>,
    /// Height of the camera above the ground when the plane was last fitted, in metres.
    eye_above_m: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Plane {
    origin: Vec2,
    base: f64,
    slope: Vec2,
}

impl Plane {
    fn height(&self, at: &Vec2) -> f64 {
        self.base + self.slope.dot(&(at - self.origin))
    }
}

impl Floor {
    /// Height of the ground at a place of the level frame.
    pub fn height(&self, at: &Vec2) -> Option<f64> {
        self.plane.map(|p| p.height(at))
    }

    /// Fits the plane to an image.
    pub fn update(&mut self, frame: &DepthFrame, level_from_camera: &Se3) {
        let eye = level_from_camera.translation;
        let points = points(frame, level_from_camera);
        let on =
            |plane: &Plane| points.iter().filter(|p| (p.z - plane.height(&p.xy())).abs() < OFF_M).count();
        let searched = lowest(&points).map(|base| Plane { origin: eye.xy(), base, slope: Vec2::zeros() });
        let from = match (self.plane, searched) {
            (Some(plane), Some(other)) => {
                // After stairs, or where it was a table: another height has far more, or lies below with about as much.
                let (here, there) = (on(&plane), on(&other));
                let below = plane.height(&eye.xy()) - other.base > 2.0 * OFF_M && 2 * there > here;
                let apart = (plane.height(&eye.xy()) - other.base).abs() > 2.0 * OFF_M;
                let carried = self.eye_above_m - (eye.z - other.base) < CARRIED_M;
                let replaced = there >= LEAST && (below || apart && carried && there > 3 * here);
                if replaced { other } else { plane }
            }
            (Some(plane), None) => plane,
            (None, Some(other)) => other,
            (None, None) => return,
        };
        let Some(fitted) = fit(&points, &from, &eye.xy()) else { return };
        let gain = if self.plane == Some(from) { GAIN } else { 1.0 };
        let before = from.height(&eye.xy());
        self.eye_above_m = eye.z - (before + gain * (fitted.base - before));
        self.plane = Some(Plane {
            origin: eye.xy(),
            base: before + gain * (fitted.base - before),
            slope: from.slope + gain * (fitted.slope - from.slope),
        });
    }
}

/// Points of an image that may be ground, in the level frame: where the surface is about level. A wall has no height at
/// which much lies, but it has points at every height.
fn points(frame: &DepthFrame, level_from_camera: &Se3) -> Vec<Vec3> {
    let (c, eye) = (frame.camera(), level_from_camera.translation);
    let step = (c.width / ACROSS).max(2);
    let at = |x: usize, y: usize| {
        let z = f64::from(frame.depth_m(x, y)?);
        let ray = Vec3::new((x as f64 - c.cx) / c.fx, (y as f64 - c.cy) / c.fy, 1.0);
        Some(*level_from_camera * (ray * z))
    };
    let mut out = Vec::new();
    for y in (step / 2..c.height.saturating_sub(step)).step_by(step) {
        for x in (step / 2..c.width.saturating_sub(step)).step_by(step) {
            let Some(p) = at(x, y) else { continue };
            if !(BELOW_M[0]..BELOW_M[1]).contains(&(eye.z - p.z)) || (p - eye).xy().norm() > NEAR_M {
                continue;
            }
            let (Some(right), Some(down)) = (at(x + step, y), at(x, y + step)) else { continue };
            let normal = (right - p).cross(&(down - p));
            if normal.z.abs() > LEVEL * normal.norm() {
                out.push(p);
            }
        }
    }
    out
}

/// The lowest height at which at least a third as many points lie as at the most common height.
fn lowest(points: &[Vec3]) -> Option<f64> {
    let low = points.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    let mut bins = vec![0usize; ((BELOW_M[1] - BELOW_M[0]) / BIN_M) as usize + 3];
    for p in points {
        let i = ((p.z - low) / BIN_M) as usize;
        if let Some(n) = bins.get_mut(i) {
            *n += 1;
        }
    }
    let around = |i: usize| bins[i.saturating_sub(1)..(i + 2).min(bins.len())].iter().sum::<usize>();
    let most = (0..bins.len()).map(around).max().filter(|n| *n >= LEAST)?;
    let first = (0..bins.len()).find(|&i| around(i) * 3 >= most && around(i) >= LEAST)?;
    // Its best bin nearby.
    let best = (first..(first + 3).min(bins.len())).max_by_key(|&i| (around(i), std::cmp::Reverse(i)))?;
    Some(low + (best as f64 + 0.5) * BIN_M)
}

/// Least squares through the points near a plane, twice; slopes are pulled to those before where little is seen.
fn fit(points: &[Vec3], from: &Plane, origin: &Vec2) -> Option<Plane> {
    let mut plane = Plane { origin: *origin, base: from.height(origin), slope: from.slope };
    for _ in 0..2 {
        let (mut normal, mut right, mut n) = (Mat3::zeros(), Vec3::zeros(), 0);
        for p in points {
            let off = p.z - plane.height(&p.xy());
            if off.abs() < OFF_M {
                let d = p.xy() - origin;
                let row = Vec3::new(1.0, d.x, d.y);
                normal += row * row.transpose();
                right += row * off;
                n += 1;
            }
        }
        if n < LEAST {
            return None;
        }
        // As if a few points had been seen a metre away on each side.
        let held = 0.1 * n as f64;
        normal += Mat3::from_diagonal(&Vec3::new(0.0, held, held));
        let change = normal.try_inverse()? * right;
        plane.base += change.x;
        plane.slope += Vec2::new(change.y, change.z);
    }
    (plane.slope.norm() < STEEPEST && plane.base.is_finite()).then_some(plane)
}
