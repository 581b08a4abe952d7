//! What a run came to.

use super::history::History;
use cairn_engine::SearchCounts;
use cairn_eval::RunReport;
use serde::Serialize;

/// The report with how the run ended.
#[derive(Serialize)]
pub struct Outcome {
    #[serde(flatten)]
    pub report: RunReport,
    /// Whether a signal ended the run before its source did.
    pub interrupted: bool,
    /// What went wrong, in sentences, the worst first.
    pub problems: Vec<String>,
    /// What searches for a lost camera by the shape of its surroundings did, if there were any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub searches: Option<SearchCounts>,
    /// Of a run in several processes.
    #[serde(flatten)]
    pub processes: Option<Processes>,
    /// Why the last frame has no pose; `None` where it has one.
    #[serde(skip)]
    pub last_state: Option<String>,
    /// What happened when.
    #[serde(skip)]
    pub history: History,
    /// Milliseconds from decoded image to pose, frame by frame.
    #[serde(skip)]
    pub step_ms: Vec<f64>,
}

/// What became of the processes.
#[derive(Serialize)]
pub struct Processes {
    /// Each process that died or was killed because it hung.
    pub deaths: Vec<DeathReport>,
    /// After each death of SLAM: frames without a pose, and seconds until the next pose.
    pub relocalised: Vec<RelocalisedReport>,
}

/// The death of a process.
#[derive(Serialize)]
pub struct DeathReport {
    pub process: &'static str,
    pub why: String,
    pub at_frame: u64,
    pub t_s: f64,
}

/// How long there was no pose.
#[derive(Serialize)]
pub struct RelocalisedReport {
    pub frames: usize,
    pub after_s: f64,
}
