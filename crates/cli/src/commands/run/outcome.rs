//! What a run came to.

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
}
