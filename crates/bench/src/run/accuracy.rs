//! Poses of a run against the truth.

use crate::MeasureError;
use cairn_atlas::KeyFrameId;
use cairn_engine::Engine;
use cairn_eval::{Align, EvalOptions, Evaluation, evaluate};
use cairn_geometry::{Se3, Trajectory, Vec3};
use cairn_sensor::Stamp;

/// Poses by their times.
pub type Poses = [(Stamp, Se3)];

/// Loops and merges.
#[derive(Clone, Debug, Default)]
pub struct Joins {
    pub loops: usize,
    pub merges: usize,
    pub refused: usize,
    pub joined_s: Vec<f64>,
    pub false_m: Vec<f64>,
}

/// Poses after alignment with the truth; `None` with too few of them.
///
/// # Errors
/// When the times of one of them do not increase.
pub fn aligned(truth: &Poses, poses: &Poses, align: Align) -> Result<Option<Evaluation>, MeasureError> {
    let trajectory =
        |poses: &Poses| Trajectory::from_unsorted(poses.iter().map(|(t, p)| (t.0, *p)).collect());
    let options = EvalOptions { align, ..EvalOptions::default() };
    Ok(evaluate(&trajectory(truth)?, &trajectory(poses)?, &options).ok())
}

/// RMSE and scale after alignment; `None` with too few poses.
pub fn ate(truth: &Poses, poses: &Poses, align: Align) -> Result<Option<(f64, f64)>, MeasureError> {
    Ok(aligned(truth, poses, align)?.map(|e| (e.ate_m.rmse, e.scale)))
}

/// Error of the position of one key frame in the camera frame of another, metres.
pub fn join_error(
    engine: &Engine,
    truth: &Poses,
    a: KeyFrameId,
    b: KeyFrameId,
) -> Result<Option<f64>, MeasureError> {
    let metres = match engine.is_metric() {
        true => 1.0,
        false => ate(&engine.comparable(truth), &engine.trajectory(), Align::Sim3)?.map_or(1.0, |a| a.1),
    };
    let map = engine.snapshot();
    let Some((a, b)) = map.key_frame(a).zip(map.key_frame(b)) else { return Ok(None) };
    let body_from_camera = engine.front_end().model().body_from_camera;
    let truly = |t: Stamp| {
        let i = truth.binary_search_by_key(&t, |p| p.0).ok()?;
        Some(truth[i].1 * body_from_camera)
    };
    let Some((true_a, true_b)) = truly(a.frame.stamp).zip(truly(b.frame.stamp)) else { return Ok(None) };
    let true_a_from_b = true_a.inverse() * true_b;
    let a_from_b = a.world_from_camera.inverse() * b.world_from_camera;
    Ok(Some((true_a_from_b.translation - a_from_b.translation * metres).norm()))
}

/// The first frame with a pose, and the stretches without one after it.
pub fn gaps(stamps: &[Stamp], poses: &Poses) -> (Option<usize>, Vec<[usize; 2]>) {
    let have = |t: &Stamp| poses.binary_search_by_key(t, |p| p.0).is_ok();
    let started = stamps.iter().position(have);
    let mut lost: Vec<[usize; 2]> = Vec::new();
    for i in started.unwrap_or(stamps.len())..stamps.len() {
        if have(&stamps[i]) {
            continue;
        }
        match lost.last_mut() {
            Some([_, last]) if *last + 1 == i => *last = i,
            _ => lost.push([i, i]),
        }
    }
    (started, lost)
}

/// Length of the true path between the first and the last of these times.
pub fn path_between(truth: &Poses, stamps: &[Stamp]) -> f64 {
    let (Some(first), Some(last)) = (stamps.first(), stamps.last()) else { return 0.0 };
    let inside: Vec<&Se3> = truth.iter().filter(|(t, _)| t >= first && t <= last).map(|(_, p)| p).collect();
    inside.windows(2).map(|w| (w[1].translation - w[0].translation).norm()).sum()
}

/// Largest movement between two instants, metres: of the live poses from the first of them; of the ground truth; and of one relative
/// to the other, after aligning all live poses with the ground truth. `None` without a pose there.
pub fn movements(
    truth: &Poses,
    live: &Poses,
    align: Align,
    [from, to]: [Stamp; 2],
) -> Result<Option<[f64; 3]>, MeasureError> {
    let Some(found) = aligned(truth, live, align)? else { return Ok(None) };
    let inside = |list: &Poses| -> Vec<(Stamp, Vec3)> {
        list.iter().filter(|(t, _)| (from..=to).contains(t)).map(|(t, p)| (*t, p.translation)).collect()
    };
    let (truth, live) = (inside(truth), inside(live));
    let off = live.iter().filter_map(|(t, p)| {
        let near = truth.iter().min_by(|a, b| (a.0 - *t).abs().total_cmp(&(b.0 - *t).abs()))?;
        Some(found.reference_from_estimate * *p - near.1)
    });
    let places = |list: &[(Stamp, Vec3)]| list.iter().map(|p| p.1).collect();
    let all: [Vec<Vec3>; 3] = [places(&live), places(&truth), off.collect()];
    if all.iter().any(Vec::is_empty) {
        return Ok(None);
    }
    Ok(Some(all.map(|places| places.iter().map(|p| (p - places[0]).norm()).fold(0.0, f64::max))))
}

/// Error of the last pose, metres, after aligning the poses up to an instant with the ground truth.
pub fn end_error(
    truth: &Poses,
    poses: &Poses,
    align: Align,
    until: Stamp,
) -> Result<Option<f64>, MeasureError> {
    let begin: Vec<(Stamp, Se3)> = poses.iter().filter(|(t, _)| *t <= until).copied().collect();
    let (Some((t, last)), Some(found)) = (poses.last(), aligned(truth, &begin, align)?) else {
        return Ok(None);
    };
    let near = truth.iter().min_by(|a, b| (a.0 - *t).abs().total_cmp(&(b.0 - *t).abs()));
    Ok(near.map(|(_, p)| (found.reference_from_estimate * last.translation - p.translation).norm()))
}

/// When a turn on the spot begins: more than 5 s after the first pose, at more than 0.4 rad/s.
pub fn turn_begins(truth: &Poses) -> Option<Stamp> {
    let turns = |w: &&[(Stamp, Se3)]| {
        let rate = (w[0].1.rotation.inverse() * w[1].1.rotation).angle() / (w[1].0 - w[0].0);
        w[0].0 - truth[0].0 > 5.0 && rate > 0.4
    };
    truth.windows(2).find(turns).map(|w| w[0].0)
}

/// FNV-1a over the bits of times and poses (Fowler, Noll, Vo).
pub fn hash(poses: &Poses) -> u64 {
    let mut h = 0xcbf2_9ce4_8422_2325_u64;
    let mut take = |bits: u64| {
        for byte in bits.to_le_bytes() {
            h = (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for (t, p) in poses {
        take(t.0 as u64);
        p.translation.iter().for_each(|v| take(v.to_bits()));
        p.rotation.matrix().iter().for_each(|v| take(v.to_bits()));
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;

    fn pose(x: f64) -> Se3 {
        Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0))
    }

    #[test]
    fn gaps_are_found() {
        let stamps: Vec<Stamp> = (0..8).map(Stamp).collect();
        let poses: Vec<(Stamp, Se3)> = [1, 2, 5, 7].map(|t| (Stamp(t), pose(0.0))).to_vec();
        assert_eq!(gaps(&stamps, &poses), (Some(1), vec![[3, 4], [6, 6]]));
        assert_eq!(gaps(&stamps, &[]), (None, vec![]));
    }

    #[test]
    fn hash_depends_on_the_last_bit() {
        let one = [(Stamp(1), pose(1.0))];
        let other = [(Stamp(1), pose(1.0 + f64::EPSILON))];
        assert_eq!(hash(&one), hash(&one));
        assert_ne!(hash(&one), hash(&other));
    }
}
