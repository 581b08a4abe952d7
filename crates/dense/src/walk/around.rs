//! How far one could walk straight on, in each direction around a place.

use super::Blocked;
use cairn_geometry::Vec2;
use std::f64::consts::{PI, TAU};

/// Depth of a cluster of cells that makes an obstacle, in metres.
const CLUSTER_M: f64 = 0.25;

/// For each of `count` headings (radians, `k * 2 pi / count` counter-clockwise from x of the level frame) the metres that a
/// strip of `half_m` to each side is free straight ahead of `from`, at most `reach_m`: up to the first cluster of at least
/// `least` voxels. Of what is nearer than `half_m` all headings are blocked that come still nearer to it.
pub fn free_around(
    obstacles: &[Blocked],
    from: &Vec2,
    half_m: f64,
    reach_m: f64,
    least: u32,
    count: usize,
) -> Vec<f64> {
    let mut hits: Vec<Vec<(f64, u32)>> = vec![Vec::new(); count];
    let bin = TAU / count.max(1) as f64;
    for b in obstacles {
        let to = b.at - from;
        let far = to.norm();
        if far > reach_m.hypot(half_m) || far < 1e-6 {
            continue;
        }
        let aside = if far <= half_m { 0.5 * PI } else { (half_m / far).asin() };
        let middle = to.y.atan2(to.x);
        let (first, last) = (((middle - aside) / bin).ceil() as i64, ((middle + aside) / bin).floor() as i64);
        for k in first..=last {
            let along_m = far * (k as f64 * bin - middle).cos();
            if along_m > 1e-6 {
                hits[k.rem_euclid(count as i64) as usize].push((along_m, b.voxels));
            }
        }
    }
    hits.into_iter().map(|hits| first_cluster(hits, least).map_or(reach_m, |m| m.min(reach_m))).collect()
}

/// Where the first cluster of at least `least` voxels begins.
fn first_cluster(mut hits: Vec<(f64, u32)>, least: u32) -> Option<f64> {
    hits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut last, mut voxels) = (0, 0);
    for &(begin_m, own) in &hits {
        while let Some((_, more)) = hits.get(last).filter(|hit| hit.0 <= begin_m + CLUSTER_M) {
            voxels += more;
            last += 1;
        }
        if voxels >= least {
            return Some(begin_m);
        }
        voxels -= own;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, y: f64) -> Blocked {
        Blocked { at: Vec2::new(x, y), low_m: 0.5, voxels: 4 }
    }

    #[test]
    fn headings_past_a_post_are_free() {
        let free = free_around(&[at(2.0, 0.0)], &Vec2::zeros(), 0.3, 3.0, 4, 72);
        assert!((free[0] - 2.0).abs() < 1e-9);
        // Half a strip beside a post 2 m away: 8.6 degrees.
        assert!(free[1] < 2.0 && free[71] < 2.0, "{free:?}");
        assert!(free[2..71].iter().all(|m| *m == 3.0), "{free:?}");
        // Three voxels are none.
        let few = Blocked { voxels: 3, ..at(2.0, 0.0) };
        assert_eq!(free_around(&[few], &Vec2::zeros(), 0.3, 3.0, 4, 72), vec![3.0; 72]);
        let both = [few, Blocked { at: Vec2::new(2.2, 0.0), ..few }];
        assert_eq!(free_around(&both, &Vec2::zeros(), 0.3, 3.0, 4, 72)[0], 2.0);
    }

    #[test]
    fn what_is_touched_blocks_the_ways_towards_it() {
        let free = free_around(&[at(0.0, 0.2)], &Vec2::zeros(), 0.3, 3.0, 4, 72);
        assert!(free[18] <= 0.2 && free[10] <= 0.2 && free[26] <= 0.2, "{free:?}");
        assert!(free[36..].iter().all(|m| *m == 3.0) && free[0] == 3.0, "{free:?}");
    }
}
