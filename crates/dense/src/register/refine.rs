//! From a pose that matches agree on to the pose of the surfaces: points to planes, then points to the field.
//!
//! Chen and Medioni, "Object modelling by registration of multiple range images" (IVC 1992) for points to planes; the
//! field as in [`crate::track`].

use super::SurfaceFeatures;
use super::matches::vec;
use super::surfels::Cubes;
use crate::sample::Sampler;
use crate::track::Normal;
use crate::{TrackConfig, TsdfVolume};
use cairn_geometry::{Manifold, Se3, Vec3};
use nalgebra::Vector6;

/// Finds the target's surfels near a point.
pub(super) struct Planes<'a> {
    features: &'a SurfaceFeatures,
    cubes: Cubes,
    reach_m: f32,
}

impl<'a> Planes<'a> {
    pub fn new(features: &'a SurfaceFeatures, reach_m: f32) -> Self {
        Self { features, cubes: Cubes::new(&features.surfels.points, reach_m), reach_m }
    }

    /// The nearest point within reach whose normal points the same way, with its normal.
    fn nearest(&self, p: &Vec3, n: &Vec3) -> Option<(Vec3, Vec3)> {
        let (p, n): ([f32; 3], [f32; 3]) = (p.map(|v| v as f32).into(), n.map(|v| v as f32).into());
        let surfels = &self.features.surfels;
        let mut best = (self.reach_m * self.reach_m, None);
        for i in self.cubes.around(&p) {
            let (q, m) = (surfels.points[i as usize], surfels.normals[i as usize]);
            let d2 = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f32>();
            if d2 < best.0 && m[0] * n[0] + m[1] * n[1] + m[2] * n[2] > 0.6 {
                best = (d2, Some((vec(q), vec(m))));
            }
        }
        best.1
    }
}

/// Points and normals of a surface, `most` at most, evenly taken; relative to a centre.
pub(super) fn sampled(source: &SurfaceFeatures, most: usize, centre: &Vec3) -> Vec<(Vec3, Vec3)> {
    let all = &source.surfels;
    let stride = all.points.len().div_ceil(most).max(1);
    let one = |i: usize| (vec(all.points[i]) - centre, vec(all.normals[i]));
    (0..all.points.len()).step_by(stride).map(one).collect()
}

/// The mean of a surface's points: about it, rotations and translations hardly depend on each other.
pub(super) fn centre(source: &SurfaceFeatures) -> Vec3 {
    let points = &source.surfels.points;
    points.iter().map(|p| vec(*p)).sum::<Vec3>() / points.len().max(1) as f64
}

/// Points to planes, a few steps.
pub(super) fn to_planes(
    planes: &Planes,
    points: &[(Vec3, Vec3)],
    start: &Se3,
    source_up: Option<&Vec3>,
    iterations: usize,
) -> Se3 {
    let config = config();
    let mut pose = *start;
    for _ in 0..iterations {
        let mut normal = Normal::default();
        for (p, n) in points {
            let at = pose * *p;
            let Some((q, m)) = planes.nearest(&at, &(pose.rotation * *n)) else { continue };
            let distance = m.dot(&(at - q));
            let huber = 0.02;
            let robust = if distance.abs() <= huber { 1.0 } else { huber / distance.abs() };
            normal.add(p, &(pose.rotation.inverse() * m), distance, robust * WEIGHT);
        }
        if let Some(up) = source_up {
            normal.keep_upright(up);
        }
        let (step, _) = normal.solve(&config);
        pose = pose.retract(&step);
        if step.norm() < 1e-3 || !pose.is_finite() {
            break;
        }
    }
    if pose.is_finite() { pose } else { *start }
}

/// A few hundred points fix what thousands of pixels would fix more tightly.
fn config() -> TrackConfig {
    TrackConfig { fixed_m: 0.03, huber_m: 0.02, ..TrackConfig::default() }
}

/// One over the variance of a surfel's distance: 1 cm.
const WEIGHT: f64 = 1e4;

/// What the field says of a pose.
pub(super) struct Refined {
    pub pose: Se3,
    /// Root mean square distance of the points in the field, in metres.
    pub rms_m: f64,
    pub free: Vec<Vector6<f64>>,
}

/// Points to the field.
pub(super) fn to_field(
    volume: &TsdfVolume,
    sampler: &Sampler,
    points: &[(Vec3, Vec3)],
    start: &Se3,
    source_up: Option<&Vec3>,
) -> Refined {
    let config = config();
    let points: Vec<(Vec3, f64)> = points.iter().map(|(p, _)| (*p, WEIGHT.sqrt())).collect();
    let mut pose = *start;
    let mut out = Refined { pose, rms_m: f64::INFINITY, free: Vec::new() };
    for _ in 0..12 {
        let mut normal = Normal::build(sampler, volume, &points, &[], &pose, &config);
        out.rms_m = normal.rms_m();
        if let Some(up) = source_up {
            normal.keep_upright(up);
        }
        let (step, free) = normal.solve(&config);
        out.free = free;
        pose = pose.retract(&step);
        if step.norm() < 1e-4 || !pose.is_finite() {
            break;
        }
    }
    if pose.is_finite() {
        out.pose = pose;
    }
    out
}
