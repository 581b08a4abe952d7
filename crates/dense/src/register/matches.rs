//! Matches of features, and those of them that are consistent with one another.
//!
//! Reciprocal nearest neighbours as in Zhou, Park and Koltun, "Fast global registration" (ECCV 2016), section 3.2. Their
//! test of random triples is replaced by all pairs: Chen, Sun, Yang and Tao, "SC2-PCR: a second order spatial
//! compatibility for efficient and robust point cloud registration" (CVPR 2022), equations 5 and 6 (two matches support
//! each other by the number of third matches that are compatible with both), which leaves nothing to chance.

use super::SurfaceFeatures;
use super::fpfh::{Fpfh, distance};
use crate::Backend;
use crate::backend::dispatch;
use cairn_geometry::{Se3, Vec3};

/// A match: a point and a normal on each side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Match {
    pub target: Vec3,
    pub source: Vec3,
    pub normals: [Vec3; 2],
}

/// The most consistent are looked for among so many matches.
const MOST_MATCHES: usize = 1024;
const WORDS: usize = MOST_MATCHES / 64;

/// The points whose features are farthest from the mean feature: on bare walls all are alike (persistent features,
/// section III-B of the paper on FPFH, here with one radius).
pub(super) fn distinct(features: &[Fpfh], most: usize) -> Vec<u32> {
    let mean: Fpfh = std::array::from_fn(|i| {
        let sum: u64 = features.iter().map(|f| u64::from(f[i])).sum();
        (sum / features.len().max(1) as u64) as u8
    });
    let mut ranked: Vec<(u32, u32)> =
        features.iter().enumerate().map(|(i, f)| (distance(f, &mean), i as u32)).collect();
    ranked.sort_unstable_by_key(|r| (std::cmp::Reverse(r.0), r.1));
    ranked.truncate(most);
    ranked.into_iter().map(|r| r.1).collect()
}

/// For each feature of `a` the nearest of `b`, and the other way round; `tilt` gives how a normal stands to gravity, and
/// features whose normals stand otherwise by more than `most_tilt` are not compared.
#[inline(always)]
fn nearest(
    a: &[(Fpfh, f32)],
    b: &[(Fpfh, f32)],
    most_tilt: f32,
    apart: &Apart,
    of_a: &mut [(u32, u32)],
    of_b: &mut [(u32, u32)],
) {
    for (i, (feature, tilt)) in a.iter().enumerate() {
        for (j, (other, other_tilt)) in b.iter().enumerate() {
            if (tilt - other_tilt).abs() > most_tilt || (!apart.at.is_empty() && apart.is_near(i, j)) {
                continue;
            }
            let d = distance(feature, other);
            if d < of_a[i].0 {
                of_a[i] = (d, j as u32);
            }
            if d < of_b[j].0 {
                of_b[j] = (d, i as u32);
            }
        }
    }
}

/// Pairs of points that are not compared: those that a pose puts near each other.
#[derive(Default)]
struct Apart {
    /// The points of both sides in one frame; of one side empty where all pairs are compared.
    at: Vec<[f32; 3]>,
    other: Vec<[f32; 3]>,
}

/// Points nearer to each other than this are one place, in metres.
const APART_M: f32 = 0.5;

impl Apart {
    #[inline(always)]
    fn is_near(&self, i: usize, j: usize) -> bool {
        let (p, q) = (self.at[i], self.other[j]);
        (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f32>() < APART_M * APART_M
    }
}

fn nearest_with(
    backend: Backend,
    a: &[(Fpfh, f32)],
    b: &[(Fpfh, f32)],
    most_tilt: f32,
    apart: &Apart,
) -> [Vec<(u32, u32)>; 2] {
    let (mut of_a, mut of_b) = (vec![(u32::MAX, 0); a.len()], vec![(u32::MAX, 0); b.len()]);
    let (to_a, to_b) = (&mut of_a[..], &mut of_b[..]);
    dispatch!(backend, nearest(
        a: &[(Fpfh, f32)],
        b: &[(Fpfh, f32)],
        most_tilt: f32,
        apart: &Apart,
        to_a: &mut [(u32, u32)],
        to_b: &mut [(u32, u32)]
    ) -> ());
    [of_a, of_b]
}

/// Reciprocal matches, best first; with `but` only those that this pose of the source does not explain.
pub(super) fn reciprocal(
    target: &SurfaceFeatures,
    source: &SurfaceFeatures,
    ups: Option<[Vec3; 2]>,
    but: Option<&Se3>,
) -> Vec<Match> {
    let side = |f: &SurfaceFeatures, up: Option<Vec3>| -> Vec<(Fpfh, f32)> {
        let tilt = |i: u32| up.map_or(0.0, |up| vec(f.surfels.normals[i as usize]).dot(&up) as f32);
        f.distinct.iter().map(|&i| (f.fpfh[i as usize], tilt(i))).collect()
    };
    let [a, b] = [side(target, ups.map(|u| u[0])), side(source, ups.map(|u| u[1]))];
    let moved = |f: &SurfaceFeatures, pose: &Se3| -> Vec<[f32; 3]> {
        let at = |i: &u32| (*pose * vec(f.surfels.points[*i as usize])).map(|v| v as f32).into();
        f.distinct.iter().map(at).collect()
    };
    let apart = but.map_or_else(Apart::default, |pose| Apart {
        at: moved(target, &Se3::identity()),
        other: moved(source, pose),
    });
    let [of_a, of_b] = nearest_with(Backend::best(), &a, &b, MOST_TILT, &apart);
    let mut found: Vec<(u32, usize, usize)> = of_a
        .iter()
        .enumerate()
        .filter(|(i, (d, j))| *d < u32::MAX && of_b[*j as usize].1 as usize == *i)
        .map(|(i, (d, j))| (*d, i, *j as usize))
        .collect();
    found.sort_unstable();
    found.truncate(MOST_MATCHES);
    let point = |f: &SurfaceFeatures, i: usize| {
        let i = f.distinct[i] as usize;
        (vec(f.surfels.points[i]), vec(f.surfels.normals[i]))
    };
    let matched = found.into_iter().map(|(_, i, j)| {
        let ((p, n), (q, m)) = (point(target, i), point(source, j));
        Match { target: p, source: q, normals: [n, m] }
    });
    matched.collect()
}

/// Cosine by which the angles of two normals to gravity may differ.
const MOST_TILT: f32 = 0.2;

pub(super) fn vec(v: [f32; 3]) -> Vec3 {
    Vec3::from(v.map(f64::from))
}

type Row = [u64; WORDS];

/// Groups of matches that one pose may explain, the most supported first; no match leads two groups.
pub(super) fn groups(
    matches: &[Match],
    ups: Option<[Vec3; 2]>,
    tolerance_m: f64,
    most: usize,
) -> Vec<Vec<usize>> {
    let n = matches.len().min(MOST_MATCHES);
    let mut rows: Vec<Row> = vec![[0; WORDS]; n];
    for i in 0..n {
        for j in i + 1..n {
            if compatible(&matches[i], &matches[j], ups, tolerance_m) {
                rows[i][j / 64] |= 1 << (j % 64);
                rows[j][i / 64] |= 1 << (i % 64);
            }
        }
    }
    let has = |row: &Row, j: usize| row[j / 64] >> (j % 64) & 1 == 1;
    let common = |a: &Row, b: &Row| a.iter().zip(b).map(|(x, y)| (x & y).count_ones()).sum::<u32>();
    // Support of a match: third matches in common, summed over those compatible with it.
    let support: Vec<u32> = (0..n)
        .map(|i| (0..n).filter(|&j| has(&rows[i], j)).map(|j| common(&rows[i], &rows[j])).sum())
        .collect();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(support[i]), i));
    let mut led = vec![false; n];
    let mut out = Vec::new();
    for lead in order {
        if out.len() == most || support[lead] == 0 {
            break;
        }
        if led[lead] {
            continue;
        }
        let mut members: Vec<(u32, usize)> =
            (0..n).filter(|&j| has(&rows[lead], j)).map(|j| (common(&rows[lead], &rows[j]), j)).collect();
        members.sort_unstable_by_key(|m| (std::cmp::Reverse(m.0), m.1));
        let best = members.first().map_or(0, |m| m.0);
        members.retain(|m| 2 * m.0 >= best && m.0 > 0);
        if members.len() < 2 {
            continue;
        }
        members.iter().for_each(|m| led[m.1] = true);
        led[lead] = true;
        out.push(std::iter::once(lead).chain(members.into_iter().map(|m| m.1)).collect());
    }
    out
}

/// Whether one rigid motion may explain two matches: their distance on both sides, the angle of their normals, and with
/// gravity their difference in height.
fn compatible(a: &Match, b: &Match, ups: Option<[Vec3; 2]>, tolerance_m: f64) -> bool {
    let (p, q) = (a.target - b.target, a.source - b.source);
    let (length, other) = (p.norm_squared().sqrt(), q.norm_squared().sqrt());
    if (length - other).abs() > tolerance_m || length < 2.0 * tolerance_m {
        return false;
    }
    let turned = |k: usize| a.normals[k].dot(&b.normals[k]);
    if (turned(0) - turned(1)).abs() > 0.35 {
        return false;
    }
    ups.is_none_or(|[up, other_up]| (p.dot(&up) - q.dot(&other_up)).abs() <= tolerance_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All instruction sets find the same neighbours.
    #[test]
    fn all_backends_match_alike() {
        let mut random = cairn_random::Random::new(7);
        let mut next = || random.below(256) as u8;
        let mut some = |n: usize| -> Vec<(Fpfh, f32)> {
            (0..n).map(|i| (std::array::from_fn(|_| next()), (i % 5) as f32 * 0.1)).collect()
        };
        let (a, b) = (some(71), some(93));
        let place = |n: usize| (0..n).map(|i| [(i % 7) as f32 * 0.2, (i % 3) as f32, 0.1]).collect();
        let all = Apart::default();
        let some = Apart { at: place(a.len()), other: place(b.len()) };
        let plain = [&all, &some].map(|apart| nearest_with(Backend::Scalar, &a, &b, MOST_TILT, apart));
        assert!(plain.iter().all(|p| p[0].iter().all(|f| f.0 < u32::MAX)));
        assert!(plain[1][0].iter().enumerate().all(|(i, f)| !some.is_near(i, f.1 as usize)));
        for backend in Backend::ALL.into_iter().filter(|b| b.available()) {
            for (apart, plain) in [&all, &some].into_iter().zip(&plain) {
                assert_eq!(&nearest_with(backend, &a, &b, MOST_TILT, apart), plain, "{backend:?}");
            }
        }
    }
}
