//! Matches between two images, as found and as aligned, against the truth.

use crate::geometry::{Sighting, epipolar, fit_epipolar, fit_pose};
use crate::recording::{Recording, View, Way};
use cairn_geometry::Se3;
use cairn_vision::{DescriptorQuery, match_descriptors};

/// One match before and after one way of aligning.
pub struct Row {
    pub level: u8,
    pub outline: bool,
    /// Pixels of the image in a pixel of the later feature's level.
    pub scale: f64,
    /// Distances to the truth in pixels: as found, aligned.
    pub found: f64,
    pub aligned: Option<f64>,
    /// The same along the parallax, where there is any.
    pub along: Option<(f64, Option<f64>)>,
    /// Epipolar distances with the fitted motion.
    pub fitted: [f64; 2],
}

/// A quantile; NaN of nothing.
pub fn quantile(v: &mut [f64], q: f64) -> f64 {
    v.sort_by(f64::total_cmp);
    v.get(((v.len() as f64 * q) as usize).min(v.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

/// The mean; 0 of nothing.
pub fn mean(v: &[f64]) -> f64 {
    v.iter().sum::<f64>() / v.len().max(1) as f64
}

fn wide(px: [f32; 2]) -> [f64; 2] {
    px.map(f64::from)
}

/// Adds the matches between two images, and the poses that they give.
pub fn compare(r: &Recording, a: &View, b: &View, way: &Way, rows: &mut Vec<Row>, poses: &mut [Vec<f64>; 2]) {
    let b_from_a = b.world_from_camera.inverse() * a.world_from_camera;
    let queries = (0..a.frame.len()).map(|item| DescriptorQuery {
        item,
        descriptor: &a.frame.descriptors[item],
        angle: a.frame.angle[item],
    });
    let mut sightings: [Vec<Sighting>; 2] = Default::default();
    let mut pixels = Vec::new();
    let first = rows.len();
    for (j, i) in match_descriptors(queries, &b.frame, 50, 0.8) {
        let (pa, pb) = (wide(a.frame.px[i]), wide(b.frame.px[j]));
        let scale = r.octaves.scale(b.frame.octave[j]);
        let depth = r.depth(a, i);
        let point = depth.map(|d| r.camera.unproject(a.frame.px[i], d.0));
        let truth = point.and_then(|p| r.camera.project(&(b_from_a * p)));
        let distance = |p: [f64; 2]| match truth {
            Some([u, v, _]) if r.exact => Some((p[0] - u).hypot(p[1] - v)),
            _ if r.exact => None,
            _ => Some(epipolar(&r.camera, &b_from_a, pa, p)),
        };
        let Some(found) = distance(pb) else { continue };
        if found > if r.exact { 3.0 * scale } else { 2.0 } {
            continue;
        }
        let moved = r.aligned(a, b, (i, j), &b_from_a, way);
        let along = point.zip(truth).filter(|_| r.exact).and_then(|(p, [u, v, _])| {
            let [u0, v0, _] = r.camera.project(&(b_from_a.rotation * p))?;
            let (dx, dy) = (u - u0, v - v0);
            let length = dx.hypot(dy);
            let of = |p: [f64; 2]| ((p[0] - u) * dx + (p[1] - v) * dy) / length;
            (length > 3.0).then(|| (of(pb), moved.map(of)))
        });
        let outline = depth.is_some_and(|d| d.1);
        if let Some(point) = point.filter(|_| !outline) {
            let sighting = |pixel| Sighting { point, pixel, scale };
            sightings[0].push(sighting(pb));
            sightings[1].push(sighting(moved.unwrap_or(pb)));
        }
        pixels.push((pa, pb, moved));
        let aligned = moved.and_then(distance);
        rows.push(Row {
            level: b.frame.octave[j],
            outline,
            scale,
            found,
            aligned,
            along,
            fitted: [f64::NAN; 2],
        });
    }
    match r.exact {
        true => add_poses(r, b_from_a, &sightings, poses),
        false => add_fitted(r, b_from_a, &pixels, &mut rows[first..]),
    }
}

/// A match: the earlier pixel, the later one as found and as aligned.
type Pixels = ([f64; 2], [f64; 2], Option<[f64; 2]>);

/// Epipolar distances with the motions that the matches agree with best, as found and as aligned.
fn add_fitted(r: &Recording, truth: Se3, pixels: &[Pixels], rows: &mut [Row]) {
    if pixels.len() <= 30 {
        return;
    }
    let before: Vec<_> = pixels.iter().map(|p| (p.0, p.1)).collect();
    let after: Vec<_> = pixels.iter().map(|p| (p.0, p.2.unwrap_or(p.1))).collect();
    for (k, matches) in [before, after].iter().enumerate() {
        let fit = fit_epipolar(&r.camera, truth, matches);
        for (row, (a, b)) in rows.iter_mut().zip(matches) {
            row.fitted[k] = epipolar(&r.camera, &fit, *a, *b);
        }
    }
}

/// Errors in mm of the poses that the matches give, as found and as aligned.
fn add_poses(r: &Recording, truth: Se3, sightings: &[Vec<Sighting>; 2], poses: &mut [Vec<f64>; 2]) {
    if sightings[0].len() <= 20 {
        return;
    }
    for (poses, s) in poses.iter_mut().zip(sightings) {
        let error = truth.inverse() * fit_pose(&r.camera, truth, s);
        poses.push(error.translation.norm() * 1000.0);
    }
}
