//! Fast point feature histograms: how the normals around a point turn, whatever the pose.
//!
//! Rusu, Blodow and Beetz, "Fast point feature histograms (FPFH) for 3D registration" (ICRA 2009): the three angles of
//! section II, a histogram of eleven bins for each (SPFH), and equation 2 for the weighted sum over the neighbours.

use super::surfels::{Cubes, Surfels};

/// Bins of each angle.
const BINS: usize = 11;
/// Bins of a feature.
const ALL: usize = 3 * BINS;
/// Bytes of a feature, filled with zeros to whole lanes.
pub(super) const BYTES: usize = 48;

/// A feature: the square roots of the shares in each bin (of each angle by itself), so that rare bins count, in 1/255.
pub(super) type Fpfh = [u8; BYTES];

/// Pairs of points within the radius: numbers and distance.
struct Pair {
    i: u32,
    j: u32,
    distance: f32,
}

/// Features of all points.
pub(super) fn features(surfels: &Surfels, radius_m: f32) -> Vec<Fpfh> {
    let n = surfels.points.len();
    let pairs = pairs(surfels, radius_m);
    let mut simple = vec![[0.0f32; ALL]; n];
    let mut count = vec![0.0f32; n];
    for pair in &pairs {
        let (i, j) = (pair.i as usize, pair.j as usize);
        for bin in bins(surfels, i, j, pair.distance) {
            simple[i][bin] += 1.0;
            simple[j][bin] += 1.0;
        }
        count[i] += 1.0;
        count[j] += 1.0;
    }
    for (histogram, &k) in simple.iter_mut().zip(&count) {
        histogram.iter_mut().for_each(|v| *v /= k.max(1.0));
    }
    let mut full = simple.clone();
    for pair in &pairs {
        let (i, j) = (pair.i as usize, pair.j as usize);
        // Distances as shares of the radius: the weight of a neighbour has no unit.
        let by_distance = radius_m / pair.distance;
        let (to_i, to_j) = (by_distance / count[i], by_distance / count[j]);
        for bin in 0..ALL {
            full[i][bin] += simple[j][bin] * to_i;
            full[j][bin] += simple[i][bin] * to_j;
        }
    }
    full.iter().map(packed).collect()
}

fn pairs(surfels: &Surfels, radius_m: f32) -> Vec<Pair> {
    let points = &surfels.points;
    let cubes = Cubes::new(points, radius_m);
    let mut out = Vec::with_capacity(points.len() * 24);
    let (least, most) = ((0.2 * surfels.cell_m).powi(2), radius_m * radius_m);
    let mut near: Vec<u32> = Vec::new();
    for (key, own) in cubes.occupied() {
        near.clear();
        near.extend((0..27).flat_map(|i| cubes.of(key.offset([i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]))));
        for &i in own {
            let p = points[i as usize];
            for &j in near.iter().filter(|&&j| j > i) {
                let q = points[j as usize];
                let d2 = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f32>();
                if d2 <= most && d2 > least {
                    out.push(Pair { i, j, distance: d2.sqrt() });
                }
            }
        }
    }
    out
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The bins of the three angles of a pair; the same for both orders of the pair.
fn bins(surfels: &Surfels, i: usize, j: usize, distance: f32) -> [usize; 3] {
    let between = |a: usize, b: usize| -> [f32; 3] {
        std::array::from_fn(|k| (surfels.points[b][k] - surfels.points[a][k]) / distance)
    };
    // The source is the point whose normal makes the smaller angle with the line between them.
    let d = between(i, j);
    let (source, target, d) = if dot(surfels.normals[i], d).abs() >= dot(surfels.normals[j], d).abs() {
        (i, j, d)
    } else {
        (j, i, d.map(|v| -v))
    };
    let (u, n) = (surfels.normals[source], surfels.normals[target]);
    let phi = dot(u, d);
    let v = cross(d, u);
    let length = dot(v, v).sqrt();
    // The line along the normal leaves the frame open.
    let v = if length > 1e-6 { v.map(|x| x / length) } else { [0.0; 3] };
    let alpha = dot(v, n);
    let theta = dot(cross(u, v), n).atan2(dot(u, n)) / std::f32::consts::PI;
    let bin = |x: f32| (((x + 1.0) * 0.5 * BINS as f32) as usize).min(BINS - 1);
    [bin(alpha), BINS + bin(phi), 2 * BINS + bin(theta)]
}

fn packed(histogram: &[f32; ALL]) -> Fpfh {
    let mut out = [0; BYTES];
    for angle in 0..3 {
        let range = angle * BINS..(angle + 1) * BINS;
        let sum: f32 = histogram[range.clone()].iter().sum();
        for bin in range {
            out[bin] = ((histogram[bin] / sum.max(1e-9)).sqrt() * 255.0 + 0.5) as u8;
        }
    }
    out
}

/// Distance of two features: sum of the absolute differences.
#[inline(always)]
pub(super) fn distance(a: &Fpfh, b: &Fpfh) -> u32 {
    a.iter().zip(b).map(|(&x, &y)| u32::from(x.abs_diff(y))).sum()
}
