//! The status of a session, for screens: a few numbers often, the map less often.

use crate::age::Age;
use cairn_engine::Phase;
use cairn_phrases::Language;
use serde::Serialize;

/// The status.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SessionStatus {
    /// Seconds since the first packet.
    pub t_s: f64,
    /// The engine's phase; WAIT_FRAMES also when images no longer arrive.
    pub phase: Phase,
    /// The language of the words here.
    pub language: Language,
    /// The phase in a sentence.
    pub words: String,
    /// What is waited for, as parts of a sentence.
    pub waits: Vec<String>,
    /// The state in large print: whether the walker is guided, or why not.
    pub headline: String,
    /// Whether that is a reason to stop.
    pub alarm: bool,
    /// How old the last picture is.
    pub age: Age,
    /// The engine's full status.
    pub engine: cairn_engine::Status,
    /// Frames processed.
    pub frames: usize,
    /// Frames that have a pose.
    pub tracked: usize,
    /// Features of the last frame.
    pub features: usize,
    /// Matches of the last frame that agree with its pose.
    pub inliers: usize,
    /// Milliseconds from the last image to its pose.
    pub step_ms: f64,
    /// Keyframes of the map.
    pub key_frames: usize,
    /// Landmarks of the map.
    pub landmarks: usize,
    /// Whether lengths are metres.
    pub metric: bool,
    /// The recording in progress, if any.
    pub recording: Option<RecordingStatus>,
    /// The route at hand, if any.
    pub route: Option<RouteStatus>,
    /// A question that waits for yes or no.
    pub question: Option<String>,
    /// Why the map is not on disk as it is, where it is kept.
    pub map_trouble: Option<String>,
    /// Guidance in progress, if any.
    pub guiding: Option<GuidingStatus>,
    /// The last utterance.
    pub last_words: String,
}

/// A recording in progress.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RecordingStatus {
    /// Points so far.
    pub points: usize,
    /// Length so far; metres where the map is metric.
    pub length: f64,
    /// Number of gaps, stretches of which only the two ends are known.
    pub gaps: usize,
    /// The file's name.
    pub file: String,
    /// Number of notes.
    pub notes: usize,
    /// Why data is waiting to be written, if it is.
    pub trouble: Option<String>,
}

/// A route at hand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RouteStatus {
    /// The file's name.
    pub file: String,
    /// "Route 3, to the kitchen"; the file's name for one without a number.
    pub name: String,
    /// Number of points.
    pub points: usize,
    /// It was recorded on this map.
    pub here: bool,
    /// It was recorded in this session, not loaded from another day.
    pub is_new: bool,
}

/// Guidance in progress.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GuidingStatus {
    /// "home", "back" or "backwards".
    pub facing: &'static str,
    /// What the guide is doing, in a word.
    pub state: &'static str,
    /// Distance along the route, metres.
    pub along_m: f64,
    /// Length of the route, metres.
    pub length_m: f64,
    /// Distance from the route, metres, positive when the walker is to its left.
    pub cross_m: f64,
}

/// Lines and points to draw, in the map's own frame and units.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct View {
    /// The direction up.
    pub up: [f32; 3],
    /// Landmarks in the order in which they were found, at most as many as asked for.
    pub points: Vec<[f32; 3]>,
    /// Their numbers; a landmark that is shown again has the same.
    pub point_ids: Vec<u64>,
    /// Positions of the key frames in order.
    pub key_frames: Vec<[f32; 3]>,
    /// Their numbers.
    pub key_frame_ids: Vec<u64>,
    /// The map of each, which are drawn apart.
    pub maps: Vec<u64>,
    /// Loops: pairs of key frames, by their places in the list.
    pub loops: Vec<[u32; 2]>,
    /// The route as recorded.
    pub recorded: Vec<[f32; 3]>,
    /// The cleaned route under guidance.
    pub plan: Vec<[f32; 3]>,
    /// The camera: position, then the axes right, down and forward; none before the first pose.
    pub camera: Option<[[f32; 3]; 4]>,
}
