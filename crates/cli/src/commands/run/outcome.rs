//! What a run came to.

use cairn_engine::SearchCounts;
use cairn_eval::RunReport;
use serde::Serialize;

/// The report with how the run ended.
#[derive(Serialize)]
pub struct Outcome<'a> {
    #[serde(flatten)]
    pub report: &'a RunReport,
    /// Whether a signal ended the run before its source did.
    pub interrupted: bool,
    /// What went wrong, in sentences, the worst first.
    pub problems: Vec<String>,
    /// What searches for a lost camera by the shape of its surroundings did, if there were any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub searches: Option<SearchCounts>,
}
