//! Whether lengths told as metres are metres: the scale of live poses against the truth, frame by frame.

use cairn_engine::Odometry;
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Seconds of odometry that the live scale is measured over.
const SCALE_S: f64 = 2.0;
/// Seconds after the first frame at which the live scale is told.
const AFTER_S: f64 = 30.0;
/// Metres that the body must have gone in that time.
const LEAST_WALKED_M: f64 = 1.0;

/// The scale of live metric poses, in percent of the logarithm.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
pub struct LiveScale {
    /// Error over the first two seconds of walking after the first metric pose.
    pub first_percent: Option<f64>,
    /// Median error 30 s after the first frame.
    pub after_percent: Option<f64>,
    /// Largest error of stretches whose scale was said to be known throughout.
    pub worst_percent: f64,
    /// Seconds after the first frame at which that was.
    pub worst_at_s: f64,
    /// Seconds of walking in which it was more than 10 % off and said to be known.
    pub wrong_s: f64,
    /// The same where it was said to be unknown somewhere in those seconds.
    pub unknown_s: f64,
}

impl LiveScale {
    /// That of metric poses against the truth while the body walks since a first frame, each of the odometry over two seconds.
    pub fn of(
        first: Stamp,
        truth: &BTreeMap<Stamp, Se3>,
        moved: &[(Stamp, Odometry)],
        told: &BTreeSet<Stamp>,
    ) -> Self {
        let mut live = Self::default();
        let mut after = Vec::new();
        for (i, (to, now)) in moved.iter().enumerate() {
            let from = moved[..i].iter().rev().find(|(t, _)| *to - *t >= SCALE_S);
            let Some((from, then)) =
                from.filter(|(t, o)| o.segment == now.segment && *to - *t < SCALE_S + 0.5)
            else {
                continue;
            };
            let (Some(a), Some(b)) = (truth.get(from), truth.get(to)) else { continue };
            let truly = (b.translation - a.translation).norm();
            if truly < LEAST_WALKED_M {
                continue;
            }
            let at = |o: &Odometry| o.odom_from_body.se3.translation;
            let found = (at(now) - at(then)).norm() * now.world_from_odom.sim3.scale;
            let off = 100.0 * (found / truly).ln();
            live.first_percent.get_or_insert(off);
            let since_s = *to - first;
            let is_told =
                moved[..=i].iter().rev().take_while(|(t, _)| t >= from).all(|(t, _)| told.contains(t));
            if is_told && off.abs() > live.worst_percent {
                (live.worst_percent, live.worst_at_s) = (off.abs(), since_s);
            }
            let wrong = if is_told { &mut live.wrong_s } else { &mut live.unknown_s };
            *wrong += if off.abs() > 10.0 { *to - moved[i - 1].0 } else { 0.0 };
            if (since_s - AFTER_S).abs() <= SCALE_S {
                after.push(off);
            }
        }
        after.sort_by(f64::total_cmp);
        live.after_percent = after.get(after.len() / 2).copied();
        live
    }
}
