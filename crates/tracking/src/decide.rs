//! The key frame decision: which frames become key frames.

use crate::match_last::Matches;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_vision::{Frame, RectifiedCamera};

/// The inputs of the decision.
pub(crate) struct Situation<'a> {
    pub snapshot: &'a Snapshot,
    pub camera: &'a RectifiedCamera,
    pub frame: &'a Frame,
    pub matches: &'a Matches,
    pub inliers: usize,
    /// Inliers that were required to accept the pose.
    pub need: usize,
    pub reference: KeyFrameId,
    /// Rotation of the camera since the reference key frame, radians.
    pub rotated_rad: f64,
    /// Frame periods since the last key frame request.
    pub since: usize,
    /// Seconds since then; `None` without IMU readings.
    pub since_s: Option<f64>,
    /// Whether the camera is stationary according to the IMU.
    pub stationary: bool,
    /// Whether mapping would process a key frame at once.
    pub idle: bool,
}

/// Least time between two key frames, seconds: points that were triangulated over less have depths of noise. With a key frame for each of
/// the 30 pictures a second of a real phone (`phone/b`) the unit of its map shrank fivefold in a turn through a door, and mapping took
/// twice as long; at 20 Hz each picture may become one, which a turn on the spot needs (`atrium`: 0.033 m, with every other 0.043).
const LEAST_GAP_S: f64 = 0.05;
/// The same with one camera with a rolling shutter in a metric map, where the camera has turned by less than this, radians, since the
/// reference: a walk straight on gains nothing by more. `phone/b` at 15 Hz has 145 key frames with 0.05 s and 100 with this, of the same
/// path. With a global shutter it is not settled (`atrium` and `sim:demo` of seed 6 were better with it, of seeds 3 to 5 worse).
const STRAIGHT_GAP_S: f64 = 0.12;
const STRAIGHT_RAD: f64 = 0.05;
/// A key frame is due when the camera has rotated by this share of the field of view.
const TURNED: f64 = 0.2;
/// A key frame is due when less than this share of the features shows landmarks: in front of a plain wall the few
/// points shared with the last key frames would leave the rotation of the next one poorly constrained.
const KNOWN_SHARE: f64 = 0.45;
/// A key frame does not wait for mapping where less than this share of the reference's landmarks is left, with depth and without:
/// without, new landmarks need two key frames, and the second has to see what the first one saw.
const WEAK_SHARE: [f64; 2] = [0.25, 0.5];
/// Least time between two of these without depth, seconds: their view does not grow before mapping has taken the first.
const WEAK_GAP_S: f64 = 0.25;
/// Seconds after the last key frame before which [`KNOWN_SHARE`] is not applied.
const KNOWN_AFTER_S: f64 = 0.5;
/// Longest time between key frames with an IMU, seconds: before gravity and scale are known, and afterwards.
const IMU_GAP_S: [f64; 2] = [0.25, 0.5];
/// The same while the camera is stationary.
const IMU_GAP_STATIONARY_S: f64 = 4.0;

/// True when the frame should become a key frame: the view has changed since the reference, or close points
/// are running out (after Mur-Artal & Tardós 2017, section III-E).
pub(crate) fn wants_key_frame(s: &Situation, rate_hz: f64) -> bool {
    // A hundredth of a period: a rate that is measured is not a round number.
    let is_within = |gap_s: f64| (s.since as f64) < (gap_s * rate_hz - 0.01).max(1.0);
    if is_within(LEAST_GAP_S) {
        return false;
    }
    let depth = s.camera.has_depth();
    let Some(reference) = s.snapshot.key_frame(s.reference) else { return true };
    let is_metric = s.snapshot.is_gravity_aligned(reference.map);
    let is_straight =
        !depth && is_metric && s.snapshot.readout().is_rolling() && s.rotated_rad < STRAIGHT_RAD;
    if is_straight && is_within(STRAIGHT_GAP_S) {
        return false;
    }
    // Few covisible key frames: the map has just been created.
    let others = reference.covisible.len();
    let least = if others <= 1 { 1 } else { 2 };
    let tracked_points = reference
        .landmarks
        .iter()
        .flatten()
        .filter(|id| s.snapshot.landmark(**id).is_some_and(|l| l.observations.len() >= least))
        .count();
    let mut close = [0usize; 2];
    if depth {
        for i in 0..s.frame.len() {
            if s.frame.has_depth(i) && (s.frame.depth[i] as f64) < s.camera.close_depth {
                close[s.matches.landmarks[i].is_some() as usize] += 1;
            }
        }
    }
    let [new_close, known_close] = close;
    let lacks_close_points = depth && known_close < 100 && new_close > 70;
    let mostly_unmapped = depth
        && new_close > 70
        && (s.inliers as f64) < KNOWN_SHARE * s.frame.len() as f64
        && s.since as f64 >= KNOWN_AFTER_S * rate_hz;
    let ratio = match (depth, others) {
        (_, 0) => 0.4,
        (true, _) => 0.75,
        (false, _) => 0.9,
    };
    // After a rotation only landmarks at the edge of the image connect the view to the reference, and few of
    // them constrain the pose well.
    let field_rad = 2.0 * (0.5 * (s.camera.bounds[2] - s.camera.bounds[0]) / s.camera.fx).atan();
    let rotated = depth && s.rotated_rad > TURNED * field_rad;
    let changed = (s.inliers as f64) < ratio * tracked_points as f64
        || lacks_close_points
        || rotated
        || mostly_unmapped;
    let overdue = s.since as f64 >= rate_hz;
    let is_weak = |share: f64| (s.inliers as f64) < share * tracked_points as f64;
    let weak = match depth {
        true => is_weak(WEAK_SHARE[0]) || lacks_close_points,
        false => is_weak(WEAK_SHARE[1]) && s.since as f64 >= WEAK_GAP_S * rate_hz,
    };
    // The shorter the time between key frames, the better an IMU factor constrains them.
    let longest_gap_s = match (s.stationary, is_metric) {
        (true, true) => IMU_GAP_STATIONARY_S,
        (_, true) => IMU_GAP_S[1],
        (_, false) => IMU_GAP_S[0],
    };
    if s.idle && s.since_s.is_some_and(|since| since >= longest_gap_s) {
        return true;
    }
    changed && s.inliers > s.need.min(15) && (overdue || s.idle || weak)
}
