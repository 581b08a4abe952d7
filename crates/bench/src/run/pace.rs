//! How the pace varies by what a run found, without the truth: one unit of length that changes within a map, unsaid, shows in it.

use cairn_geometry::Se3;
use cairn_sensor::Stamp;

/// Seconds over which the pace is averaged.
const PACE_S: f64 = 2.0;

/// Length of a trajectory.
pub fn length_m(poses: &[(Stamp, Se3)]) -> f64 {
    poses.windows(2).map(|w| (w[1].1.translation - w[0].1.translation).norm()).sum()
}

/// The fastest pace over the slowest of each two seconds; `None` where there are none, or without a step.
pub fn ratio(poses: &[(Stamp, Se3)]) -> Option<f64> {
    let (mut from, mut paces) = (0, Vec::new());
    for i in 1..poses.len() {
        let seconds = poses[i].0 - poses[from].0;
        if seconds >= PACE_S {
            paces.push(length_m(&poses[from..=i]) / seconds);
            from = i;
        }
    }
    let (least, most) =
        paces.iter().fold((f64::INFINITY, 0.0f64), |(a, b), pace| (a.min(*pace), b.max(*pace)));
    (least > 0.0 && most > 0.0).then_some(most / least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    #[test]
    fn a_unit_that_shrinks_shows_in_the_ratio() {
        let walk = |shrunk_at: usize| -> Vec<(Stamp, Se3)> {
            let mut x = 0.0;
            let pose = |i: usize| {
                x += if i < shrunk_at { 0.05 } else { 0.01 };
                (Stamp::from_seconds(0.1 * i as f64), Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0)))
            };
            (0..100).map(pose).collect()
        };
        assert!((ratio(&walk(100)).unwrap() - 1.0).abs() < 1e-6);
        assert!((ratio(&walk(60)).unwrap() - 5.0).abs() < 0.01);
        assert!((length_m(&walk(100)) - 4.95).abs() < 1e-6);
        assert_eq!(ratio(&walk(100)[..10]), None);
    }
}
