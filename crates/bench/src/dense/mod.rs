//! `dense`: surfaces from depth images with known poses, on one thread: times, quality and memory, each beside its goal.
//!
//! On 7scenes-kitchen, every fifth of frames 0 to 299, depth to 5 m, truncation of four voxels. Times are processor time,
//! the least of several repetitions. `tools/compare_dense.py` measures Open3D on the same frames.

mod fields;
mod kitchen;
mod motion;
#[path = "../../../dense/tests/suite/common/pairs.rs"]
mod pairs;
mod submaps;
mod views;

use crate::MeasureError;
use kitchen::Kitchen;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// A part of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Section {
    /// Growth of the process.
    Memory,
    /// Fusion into fields and occupancy.
    Fusion,
    /// Depth of the surface in images that were not fused.
    Quality,
    /// Meshes.
    Mesh,
    /// Ray casts.
    Raycast,
    /// Tracking by depth alone.
    Tracking,
    /// Registration without a guess.
    Registration,
    /// Key frames' depth, and a loop closure over 1,000 of them.
    Submaps,
}

impl Section {
    /// In this order: memory first, before memory freed by other sections is used again.
    const ALL: [Self; 8] = [
        Self::Memory,
        Self::Fusion,
        Self::Quality,
        Self::Mesh,
        Self::Raycast,
        Self::Tracking,
        Self::Registration,
        Self::Submaps,
    ];
}

/// One figure.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What was measured.
    pub what: String,
    /// The value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// The goal; `None` for a figure that is only told.
    pub goal: Option<Goal>,
}

/// What a figure should be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Goal {
    /// At most this.
    AtMost(f64),
    /// At least this.
    AtLeast(f64),
}

impl Row {
    fn told(what: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { what: what.into(), value, unit, goal: None }
    }

    fn at_most(what: impl Into<String>, value: f64, unit: &'static str, goal: f64) -> Self {
        Self { goal: Some(Goal::AtMost(goal)), ..Self::told(what, value, unit) }
    }

    fn at_least(what: impl Into<String>, value: f64, unit: &'static str, goal: f64) -> Self {
        Self { goal: Some(Goal::AtLeast(goal)), ..Self::told(what, value, unit) }
    }

    /// Whether the goal is reached; `None` without one.
    pub fn reached(&self) -> Option<bool> {
        self.goal.map(|goal| match goal {
            Goal::AtMost(most) => self.value <= most,
            Goal::AtLeast(least) => self.value >= least,
        })
    }
}

/// Measures some sections; all of them when none is named.
///
/// # Errors
/// When the recording is missing or cannot be read.
pub fn run(data: &Path, only: &[Section]) -> Result<Vec<Row>, MeasureError> {
    let kitchen = Kitchen::read(data)?;
    let mut rows = Vec::new();
    for section in Section::ALL.into_iter().filter(|s| only.is_empty() || only.contains(s)) {
        eprintln!("dense: {section:?} ...");
        let measured = match section {
            Section::Memory => fields::memory(&kitchen),
            Section::Fusion => fields::fusion(&kitchen),
            Section::Quality => views::quality(&kitchen),
            Section::Mesh => views::mesh(&kitchen),
            Section::Raycast => views::casts(&kitchen),
            Section::Tracking => motion::tracking(&kitchen),
            Section::Registration => motion::registration(&kitchen),
            Section::Submaps => submaps::submaps(&kitchen),
        };
        rows.extend(measured.map_err(|e| format!("{section:?}: {e}"))?);
    }
    Ok(rows)
}

/// All figures as a table in Markdown.
pub fn table(rows: &[Row]) -> String {
    let mut out = format!(
        "7scenes-kitchen, one thread, processor time, best instructions: {:?}\n\n| | measured | goal | |\n|---|---|---|---|\n",
        cairn_dense::Backend::best()
    );
    for row in rows {
        let goal = match row.goal {
            Some(Goal::AtMost(v)) => format!("at most {v:.4}"),
            Some(Goal::AtLeast(v)) => format!("at least {v:.4}"),
            None => String::new(),
        };
        let goal = if goal.contains('.') { goal.trim_end_matches('0').trim_end_matches('.') } else { &goal };
        let reached = match row.reached() {
            Some(true) => "reached",
            Some(false) => "NOT REACHED",
            None => "",
        };
        let digits = if row.value.fract() == 0.0 { 0 } else { 2 };
        let _ = writeln!(out, "| {} | {:.digits$} {} | {goal} | {reached} |", row.what, row.value, row.unit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missed_goal_is_told() {
        let rows = [
            Row::at_most("ray cast", 39.96, "ms", 40.0),
            Row::at_least("pairs", 19.0, "of 20", 20.0),
            Row::told("blocks", 7.0, ""),
        ];
        assert_eq!(rows.each_ref().map(Row::reached), [Some(true), Some(false), None]);
        let text = table(&rows);
        assert!(text.contains("| ray cast | 39.96 ms | at most 40 | reached |"), "{text}");
        assert!(text.contains("| pairs | 19 of 20 | at least 20 | NOT REACHED |"), "{text}");
    }
}
