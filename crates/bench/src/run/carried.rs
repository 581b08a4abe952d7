//! How well the motion sensors carry the pose while no feature is matched: the error at the end of the longest such stretch,
//! beside the standard deviation that was stated there.

use cairn_engine::Odometry;
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Seconds before the stretch over which the motion is compared too: a velocity that is off there is carried on.
const BEFORE_S: f64 = 0.5;

/// The longest stretch of frames whose pose was carried.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub struct Carried {
    /// Seconds from the first frame to the last tracked frame before it.
    pub from_s: f64,
    /// Seconds from there to its last frame.
    pub seconds: f64,
    /// Error of the motion in that time, metres.
    pub error_m: f64,
    /// Error of the rotation in that time, degrees.
    pub error_deg: f64,
    /// Standard deviation of the position that was stated at its last frame, metres.
    pub sigma_m: f64,
    /// Error of the mean velocity in the half second before it, m/s.
    pub before_m_s: f64,
    /// Error of the direction of gravity at its beginning and at its end, degrees.
    pub tilt_deg: [f64; 2],
}

impl Carried {
    /// Of metric poses in the odometry frame, in order of time; `sigmas` has the stated standard deviations of the frames
    /// whose pose was carried. `None` where none was.
    pub fn longest(
        start: Stamp,
        moved: &[(Stamp, Odometry)],
        sigmas: &BTreeMap<Stamp, f64>,
        truth: &BTreeMap<Stamp, Se3>,
    ) -> Option<Self> {
        let (mut longest, mut from) = (None, None);
        for (i, (stamp, _)) in moved.iter().enumerate() {
            if !sigmas.contains_key(stamp) {
                from = Some(i);
                continue;
            }
            let Some(from) = from else { continue };
            let seconds = *stamp - moved[from].0;
            if longest.is_none_or(|(_, _, longest_s)| seconds > longest_s) {
                longest = Some((from, i, seconds));
            }
        }
        let (from, to, seconds) = longest?;
        let off = error(&moved[from], &moved[to], truth)?;
        let before = moved[..from].iter().rev().find(|(t, _)| moved[from].0 - *t >= BEFORE_S)?;
        let off_before = error(before, &moved[from], truth)?;
        Some(Self {
            from_s: moved[from].0 - start,
            seconds,
            error_m: off.translation.norm(),
            error_deg: off.rotation.log().norm().to_degrees(),
            sigma_m: *sigmas.get(&moved[to].0)?,
            before_m_s: off_before.translation.norm() / (moved[from].0 - before.0),
            tilt_deg: [tilt_deg(&moved[from], truth)?, tilt_deg(&moved[to], truth)?],
        })
    }
}

/// Angle between where up is and where it is said to be, seen from the body, in degrees.
fn tilt_deg(at: &(Stamp, Odometry), truth: &BTreeMap<Stamp, Se3>) -> Option<f64> {
    let said = at.1.world_from_odom.sim3.rotation * at.1.odom_from_body.se3.rotation;
    let [said, true_up] = [said, truth.get(&at.0)?.rotation].map(|r| r.inverse() * Vec3::z());
    Some(said.cross(&true_up).norm().asin().to_degrees())
}

/// What is missing of the motion between two instants, in the body frame of the second; `None` without ground truth there or
/// where the odometry was interrupted.
fn error(a: &(Stamp, Odometry), b: &(Stamp, Odometry), truth: &BTreeMap<Stamp, Se3>) -> Option<Se3> {
    if a.1.segment != b.1.segment {
        return None;
    }
    let (ta, tb) = (truth.get(&a.0)?, truth.get(&b.0)?);
    let scale = b.1.world_from_odom.sim3.scale;
    let [pa, pb] = [a, b].map(|(_, o)| {
        let se3 = o.odom_from_body.se3;
        Se3::new(se3.rotation, scale * se3.translation)
    });
    Some((pa.inverse() * pb).inverse() * (ta.inverse() * *tb))
}
