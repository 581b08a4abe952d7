//! Poses that put the walls of one surface onto those of another.
//!
//! Features tell walls from nothing, and in a bare room there are few others: of the poses under which such a room fits, features
//! propose one or another, as it happens. Here the directions of most normals are turned onto each other in every way that keeps the
//! angle between them, and for each turn the points along those directions tell the translation: where most of one lies on most of the
//! other.

use super::fgr::upright;
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use std::collections::BTreeMap;

/// A point and a normal.
type Point = (Vec3, Vec3);

/// Normals within this cosine of a direction belong to it.
const ALONG: f64 = 0.94;
/// Directions that are looked for in a surface, and the share of its points that each has at least.
const MOST: usize = 6;
const LEAST_SHARE: f64 = 0.04;
/// Two turns within this angle are one, in radians.
const SAME_RAD: f64 = 0.25;
/// Distances along a direction are counted in bins of this size, in metres.
const BIN_M: f64 = 0.05;
/// Translations along each of three directions that are tried, at least so many bins apart.
const PEAKS: usize = 2;
const APART: i32 = 4;

/// Poses of `source` in `target`, by the walls of both; with `ups` those that keep gravity.
pub(super) fn poses(target: &[Point], source: &[Point], ups: Option<[Vec3; 2]>) -> Vec<Se3> {
    let [of_target, of_source] = [target, source].map(directions);
    turns(&of_target, &of_source, ups)
        .iter()
        .flat_map(|turn| shifts(target, source, &of_target, turn).into_iter().map(|t| Se3::new(*turn, t)))
        .collect()
}

/// The directions of most normals, the most first.
fn directions(points: &[Point]) -> Vec<Vec3> {
    let mut left: Vec<Vec3> = points.iter().map(|p| p.1).collect();
    let least = (LEAST_SHARE * points.len() as f64).max(3.0) as usize;
    let mut out = Vec::new();
    while out.len() < MOST {
        let around = |d: &Vec3| left.iter().filter(|n| n.dot(d) > ALONG).count();
        let Some((count, at)) = left.iter().map(|d| (around(d), d)).max_by_key(|c| c.0) else { break };
        if count < least {
            break;
        }
        let mean = left.iter().filter(|n| n.dot(at) > ALONG).sum::<Vec3>().normalize();
        out.push(mean);
        left.retain(|n| n.dot(&mean) <= ALONG);
    }
    out
}

/// Rotations that turn the first two directions of the source onto two of the target.
fn turns(target: &[Vec3], source: &[Vec3], ups: Option<[Vec3; 2]>) -> Vec<So3> {
    let mut out: Vec<So3> = Vec::new();
    let Some(&a) = source.first() else { return out };
    let Some(&b) = source.iter().find(|b| a.dot(b).abs() < 0.7) else { return out };
    for p in target {
        for q in target.iter().filter(|q| (p.dot(q) - a.dot(&b)).abs() < 0.2) {
            let mut turn = So3::from_matrix(&(frame(p, q) * frame(&a, &b).transpose()));
            if let Some([up, other]) = ups {
                let tilted = turn * other;
                if tilted.dot(&up) < ALONG {
                    continue;
                }
                turn = upright(&up, &tilted) * turn;
            }
            if out.iter().all(|o| (o.inverse() * turn).angle() > SAME_RAD) {
                out.push(turn);
            }
        }
    }
    out
}

/// Axes along `a` and, as nearly as may be, `b`.
fn frame(a: &Vec3, b: &Vec3) -> Mat3 {
    let y = (b - a * a.dot(b)).normalize();
    Mat3::from_columns(&[*a, y, a.cross(&y)])
}

/// Translations of the turned source by three of the target's directions; none where fewer of them are in both.
fn shifts(target: &[Point], source: &[Point], directions: &[Vec3], turn: &So3) -> Vec<Vec3> {
    let turned: Vec<Point> = source.iter().map(|(p, n)| (*turn * *p, *turn * *n)).collect();
    let mut axes: Vec<(Vec3, Vec<i32>)> = Vec::new();
    for d in directions {
        let is_new = match &axes[..] {
            [] => true,
            [a] => a.0.dot(d).abs() < 0.7,
            [a, b] => a.0.cross(&b.0).dot(d).abs() > 0.5,
            _ => false,
        };
        if !is_new {
            continue;
        }
        let peaks = peaks(target, &turned, d);
        if !peaks.is_empty() {
            axes.push((*d, peaks));
        }
    }
    let [a, b, c] = &axes[..] else { return Vec::new() };
    let Some(solve) = Mat3::from_columns(&[a.0, b.0, c.0]).transpose().try_inverse() else {
        return Vec::new();
    };
    let mut out = Vec::new();
    for &i in &a.1 {
        for &j in &b.1 {
            out.extend(c.1.iter().map(|&k| solve * Vec3::from([i, j, k].map(|n| f64::from(n) * BIN_M))));
        }
    }
    out
}

/// The shifts along a direction, in bins, at which most points that face along it, either way, lie at the same distance.
fn peaks(target: &[Point], source: &[Point], direction: &Vec3) -> Vec<i32> {
    let mut by_shift: BTreeMap<i32, u32> = BTreeMap::new();
    for way in [1.0, -1.0] {
        let count = |points: &[Point]| {
            let mut out: BTreeMap<i32, u32> = BTreeMap::new();
            for (p, _) in points.iter().filter(|(_, n)| way * n.dot(direction) > ALONG) {
                *out.entry((p.dot(direction) / BIN_M).floor() as i32).or_default() += 1;
            }
            out
        };
        let (here, there) = (count(target), count(source));
        for (i, n) in &here {
            for (j, m) in &there {
                // Bins cut a wall in two at one place or another.
                for (near, times) in [(-1, 1), (0, 2), (1, 1)] {
                    *by_shift.entry(i - j + near).or_default() += times * n.min(m);
                }
            }
        }
    }
    let mut ranked: Vec<(u32, i32)> = by_shift.into_iter().map(|(shift, n)| (n, shift)).collect();
    ranked.sort_unstable_by_key(|r| (std::cmp::Reverse(r.0), r.1));
    let mut out: Vec<i32> = Vec::new();
    for (_, shift) in ranked {
        if out.len() == PEAKS {
            break;
        }
        if out.iter().all(|o| (o - shift).abs() >= APART) {
            out.push(shift);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a grid on all sides of a box around a place, which face inwards.
    fn inside_of_a_box(half: [f64; 3], middle: Vec3) -> Vec<Point> {
        let mut out = Vec::new();
        for (axis, side) in [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0), (2, -1.0), (2, 1.0)] {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for i in 0..64 {
                let (a, b) = (f64::from(i % 8) / 3.5 - 1.0, f64::from(i / 8) / 3.5 - 1.0);
                let (mut p, mut n) = (Vec3::zeros(), Vec3::zeros());
                (p[axis], p[u], p[v], n[axis]) = (side * half[axis], a * half[u], b * half[v], -side);
                out.push((p + middle, n));
            }
        }
        out
    }

    fn moved(points: &[Point], pose: &Se3) -> Vec<Point> {
        points.iter().map(|(p, n)| (*pose * *p, pose.rotation * *n)).collect()
    }

    fn has(found: &[Se3], pose: &Se3) -> bool {
        found.iter().any(|f| {
            let off = f.inverse() * *pose;
            off.translation.norm() < 0.1 && off.rotation.angle() < 0.02
        })
    }

    #[test]
    fn a_box_fits_onto_itself_in_four_ways() {
        let target = inside_of_a_box([2.0, 0.7, 1.5], Vec3::new(0.4, -0.2, 0.1));
        let pose = Se3::new(So3::exp(&Vec3::new(0.4, -1.1, 0.8)), Vec3::new(0.5, 1.0, -2.0));
        let source = moved(&target, &pose.inverse());
        let about = Se3::new(So3::identity(), Vec3::new(0.4, -0.2, 0.1));
        let turned = |axis: Vec3| {
            about * Se3::new(So3::exp(&(axis * std::f64::consts::PI)), Vec3::zeros()) * about.inverse() * pose
        };
        let [x, y, z] = [Vec3::x(), Vec3::y(), Vec3::z()].map(turned);
        let found = poses(&target, &source, None);
        assert!([pose, x, y, z].iter().all(|p| has(&found, p)), "{found:?}");
        // With gravity along y two are left.
        let up = pose.rotation.inverse() * Vec3::y();
        let upright = poses(&target, &source, Some([Vec3::y(), up]));
        assert!(has(&upright, &pose) && has(&upright, &y) && !has(&upright, &x) && !has(&upright, &z));
        assert!(upright.iter().all(|p| (p.rotation * up - Vec3::y()).norm() < 1e-9));
    }

    #[test]
    fn one_wall_and_no_points_propose_nothing() {
        let sides = inside_of_a_box([2.0, 0.7, 1.5], Vec3::zeros());
        assert!(poses(&sides[..64], &sides[..64], None).is_empty());
        assert!(poses(&[], &sides, None).is_empty() && poses(&sides, &[], None).is_empty());
    }
}
