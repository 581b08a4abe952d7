//! Which frames become key frames.

use crate::match_last::Matches;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_vision::{Frame, RectifiedCamera};

/// What the decision is made from.
pub(crate) struct Situation<'a> {
    pub snapshot: &'a Snapshot,
    pub camera: &'a RectifiedCamera,
    pub frame: &'a Frame,
    pub matches: &'a Matches,
    pub inliers: usize,
    /// Matches that had to agree.
    pub need: usize,
    pub reference: KeyFrameId,
    /// How far the view has turned since the reference, radians.
    pub turned_rad: f64,
    /// Frames since the last key frame was offered.
    pub since: usize,
    /// Seconds since then, where there is an inertial sensor.
    pub since_s: Option<f64>,
    /// Whether the eye stands still, as it is felt.
    pub stands: bool,
    /// Whether mapping would take it up at once.
    pub idle: bool,
}

/// A key frame is due when the view has turned by this share of the field of view.
const TURNED: f64 = 0.2;
/// A key frame is due when less than this share of the features is known: before a wall the last key frames' few common
/// points let the next one turn about them.
const KNOWN_SHARE: f64 = 0.45;
/// Seconds since the last key frame before which that is no reason.
const KNOWN_AFTER_S: f64 = 0.5;
/// Seconds between key frames with an inertial sensor, at most: before gravity and scale are known, and after.
const LINK_S: [f64; 2] = [0.25, 0.5];
/// The same while the eye stands still.
const LINK_AT_REST_S: f64 = 4.0;

/// True when the frame should become a key frame: the view has changed since the reference, or close points
/// are running out (after Mur-Artal & Tardós 2017, section III-E).
pub(crate) fn wants_key_frame(s: &Situation, rate_hz: f64, min_gap: usize) -> bool {
    if s.since < min_gap {
        return false;
    }
    let depth = s.camera.has_depth();
    let Some(reference) = s.snapshot.key_frame(s.reference) else { return true };
    // A world that has just begun: how many others share the view.
    let others = reference.covisible.len();
    let least = if others <= 1 { 1 } else { 2 };
    let settled = reference
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
    let starving = depth && known_close < 100 && new_close > 70;
    let unknown = depth
        && new_close > 70
        && (s.inliers as f64) < KNOWN_SHARE * s.frame.len() as f64
        && s.since as f64 >= KNOWN_AFTER_S * rate_hz;
    let ratio = match (depth, others) {
        (_, 0) => 0.4,
        (true, _) => 0.75,
        (false, _) => 0.9,
    };
    // A view that turns leaves what ties it to the reference at the edge of the image, where few points judge much.
    let field_rad = 2.0 * (0.5 * (s.camera.bounds[2] - s.camera.bounds[0]) / s.camera.fx).atan();
    let turned = depth && s.turned_rad > TURNED * field_rad;
    let changed = (s.inliers as f64) < ratio * settled as f64 || starving || turned || unknown;
    let overdue = s.since as f64 >= rate_hz;
    let weak = depth && ((s.inliers as f64) < 0.25 * settled as f64 || starving);
    // What is felt links key frames the better the nearer they are in time.
    let link_s = match (s.stands, s.snapshot.is_gravity_aligned(reference.map)) {
        (true, true) => LINK_AT_REST_S,
        (_, true) => LINK_S[1],
        (_, false) => LINK_S[0],
    };
    if s.idle && s.since_s.is_some_and(|since| since >= link_s) {
        return true;
    }
    changed && s.inliers > s.need.min(15) && (overdue || s.idle || weak)
}
