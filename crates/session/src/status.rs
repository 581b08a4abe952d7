//! How things stand, for screens: small numbers often, the map now and then.

use cairn_engine::Phase;
use serde::Serialize;

/// How things stand.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Status {
    /// Seconds since the first packet.
    pub t_s: f64,
    /// What the engine is doing; WAIT_FRAMES also when no picture comes any more.
    pub phase: Phase,
    /// The same in a sentence.
    pub words: String,
    /// The same with all its numbers.
    pub engine: cairn_engine::Status,
    /// Frames taken, and those with a pose.
    pub frames: usize,
    /// Frames that have a pose.
    pub tracked: usize,
    /// Features of the last frame, and matches that agree with its pose.
    pub features: usize,
    /// Matches that agree with the pose.
    pub inliers: usize,
    /// Milliseconds from the last image to its pose.
    pub step_ms: f64,
    /// Key frames of the map.
    pub key_frames: usize,
    /// Landmarks of the map.
    pub landmarks: usize,
    /// Whether lengths are metres.
    pub metric: bool,
    /// The recording, while there is one.
    pub recording: Option<RecordingStatus>,
    /// The way that can be walked, when there is one.
    pub route: Option<RouteStatus>,
    /// Guidance, while there is some.
    pub guiding: Option<GuidingStatus>,
    /// The last words.
    pub last_words: String,
}

/// A recording under way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordingStatus {
    /// Points so far.
    pub points: usize,
    /// Length so far; metres where the map is metric.
    pub length: f64,
    /// Stretches of which only the ends are known.
    pub gaps: usize,
    /// The file's name.
    pub file: String,
    /// Why the file is behind, if it is.
    pub trouble: Option<String>,
}

/// A way at hand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RouteStatus {
    /// The file's name.
    pub file: String,
    /// Points.
    pub points: usize,
    /// It was recorded on this map.
    pub here: bool,
}

/// Guidance under way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GuidingStatus {
    /// "home", "back" or "backwards".
    pub facing: &'static str,
    /// What the guide is doing, in a word.
    pub state: &'static str,
    /// Metres gone along the way.
    pub along_m: f64,
    /// Metres of the whole.
    pub length_m: f64,
    /// Metres beside the way, positive: the walker stands to its left.
    pub cross_m: f64,
}

/// Lines and points to draw, in the map's own frame and units.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct View {
    /// The direction up.
    pub up: [f32; 3],
    /// Landmarks, at most as many as asked for.
    pub points: Vec<[f32; 3]>,
    /// Places of the key frames in order.
    pub key_frames: Vec<[f32; 3]>,
    /// The way as recorded.
    pub recorded: Vec<[f32; 3]>,
    /// The cleaned way under guidance.
    pub plan: Vec<[f32; 3]>,
    /// The camera: place, then the axes right, down and forward; none before the first pose.
    pub camera: Option<[[f32; 3]; 4]>,
}
