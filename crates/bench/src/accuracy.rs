//! `accuracy`: the real recordings. Each run has its own process, so that peak memory is measured separately; each
//! recording runs twice, to check that results are bit-identical.

use crate::MeasureError;
use crate::recordings::{RECORDINGS, Recording};
use crate::{Measured, RunOptions, measure};
use cairn_sources::{OpenOptions, open};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// Result of one row.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Name of recording and sensor.
    pub name: String,
    /// The run.
    pub measured: Measured,
    /// Whether all runs were bit-identical; `None` if there was only one.
    pub bit_identical: Option<bool>,
}

/// Runs one recording in this process.
///
/// # Errors
/// As [`measure()`], and when the recording cannot be opened.
pub fn run_here(data: &Path, recording: &Recording, config: &RunOptions) -> Result<Measured, MeasureError> {
    let folder = data.join(recording.folder);
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default())?;
    measure(source.as_mut(), config)
}

/// Runs the available recordings whose name contains `only` (all if `None`), each `times` times.
///
/// # Errors
/// When a run fails; the text names the recording.
pub fn run(data: &Path, only: Option<&str>, times: usize) -> Result<Vec<Row>, MeasureError> {
    let mut rows = Vec::new();
    for recording in RECORDINGS.iter().filter(|r| only.is_none_or(|o| r.name.contains(o))) {
        if !data.join(recording.folder).exists() {
            eprintln!("skipped: {} is not in {}", recording.folder, data.display());
            continue;
        }
        let runs: Vec<Measured> =
            (0..times.max(1)).map(|_| child(data, recording)).collect::<Result<_, _>>()?;
        let bit_identical = (runs.len() > 1).then(|| runs.windows(2).all(|w| w[0].hash == w[1].hash));
        // Times are taken from the fastest run, which was disturbed least by other load on the machine.
        let fastest = runs.into_iter().min_by(|a, b| a.step_ms.p50.total_cmp(&b.step_ms.p50));
        let Some(measured) = fastest else { continue };
        rows.push(Row { name: recording.name.into(), measured, bit_identical });
    }
    Ok(rows)
}

fn child(data: &Path, recording: &Recording) -> Result<Measured, MeasureError> {
    let name = recording.name;
    let me = std::env::current_exe().map_err(|e| MeasureError::of(name, e))?;
    let out = Command::new(me)
        .args(["one", name, "--data"])
        .arg(data)
        .output()
        .map_err(|e| MeasureError::of(name, e))?;
    if !out.status.success() {
        let said = String::from_utf8_lossy(&out.stderr).trim().to_owned();
        return Err(MeasureError::of(name, MeasureError::Program(said)));
    }
    serde_json::from_slice(&out.stdout).map_err(|e| MeasureError::of(name, e))
}

/// The table in Markdown, with the figures of the reference in brackets.
pub fn table(rows: &[Row]) -> String {
    let mut t = String::from(
        "| recording | alignment | ATE m (ORB-SLAM3) | coverage | step p50 / p99 ms | peak MB | bit-identical runs |\n|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let Some(figures) = figures(row) else { continue };
        let align = if row.measured.metric { "SE3" } else { "Sim3" };
        let same = match row.bit_identical {
            Some(true) => "yes",
            Some(false) => "NO",
            None => "not run",
        };
        let _ = writeln!(t, "| {} | {align} | {figures} | {same} |", row.name);
    }
    t
}

/// ATE, coverage, step and peak memory, columns of a table, each with that of the reference in brackets.
fn figures(row: &Row) -> Option<String> {
    let (m, r) = (&row.measured, crate::recordings::recording(&row.name)?.reference);
    Some(format!(
        "{} ({}-{}) | {:.2} ({:.2}) | {:.1} / {:.1} ({}) | {:.0} ({:.0})",
        m.ate_m.map_or("none".into(), |a| format!("{a:.4}")),
        r.ate_m[0],
        r.ate_m[1],
        m.coverage(),
        r.coverage,
        m.step_ms.p50,
        m.step_ms.p99,
        r.step_ms,
        m.peak_mb.unwrap_or(f64::NAN),
        r.peak_mb,
    ))
}

/// The complete page `docs/figures/accuracy.md`.
pub fn page(rows: &[Row]) -> String {
    format!(
        "# Figures: accuracy\n\n\
         `cargo run --release -p bench -- accuracy --write` writes this page and the same figures in the README. A test fails when\n\
         the ATE of this page is no longer that of the code. [Accuracy](../accuracy.md) says how errors are measured.\n\n{}\n\
         {}: {}.\n\n\
         Lockstep, default configuration. ATE is the RMSE of the final trajectory against the ground truth after alignment.\n\
         Coverage is the share of packets that have a pose. A step lasts from the decoded image to the pose; times are those of\n\
         the run with the lowest median. Peak memory is that of the whole process. In brackets: ORB-SLAM3 V1.0 on the same files\n\
         and on two cores of an Intel Xeon, otherwise idle and fed in real time, range of three runs.\n",
        table(rows),
        MEASURED,
        crate::build::measured_on()
    )
}

/// How the line begins that says where and with which build figures were measured.
const MEASURED: &str = "Measured on two cores";

/// The text of the README with these rows in place of its own, and where they were measured.
///
/// # Errors
/// When a row or the line about the measurement is not in it.
pub fn readme(text: &str, rows: &[Row]) -> Result<String, MeasureError> {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut replace = |begin: &str, new: String| {
        let line = lines.iter_mut().find(|l| l.starts_with(begin));
        let none = || MeasureError::from(format!("README.md has no line that begins with {begin:?}"));
        line.map(|l| *l = new).ok_or_else(none)
    };
    for row in rows {
        let title = crate::recordings::recording(&row.name).map(|recording| recording.title);
        let Some((title, figures)) = title.zip(figures(row)) else { continue };
        let begin = format!("| {title} |");
        replace(&begin, format!("{begin} {figures} |"))?;
    }
    replace(MEASURED, format!("{MEASURED}: {}.", crate::build::measured_on()))?;
    Ok(lines.join("\n") + "\n")
}

/// The ATE that a page written by [`page`] states for a recording, metres.
pub fn stated_ate(page: &str, name: &str) -> Option<f64> {
    let row = page.lines().find(|l| l.starts_with(&format!("| {name} |")))?;
    row.split('|').nth(3)?.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sensors;
    use cairn_eval::Percentiles;

    fn measured(ate_m: f64) -> Measured {
        Measured {
            sensor: Sensors::Mono,
            frames: 10,
            tracked: 10,
            lost: Vec::new(),
            started: Some(0),
            ate_m: Some(ate_m),
            live_ate_m: None,
            metric: false,
            scale: 1.0,
            metric_s: None,
            imu_offset_ms: 0.0,
            path_m: 1.0,
            step_ms: Percentiles::default(),
            track_ms: Percentiles::default(),
            map_ms: Percentiles::default(),
            worlds: 1,
            loops: 0,
            merges: 0,
            joined_s: Vec::new(),
            refused: 0,
            false_joins: Vec::new(),
            key_frames: 2,
            landmarks: 100,
            peak_mb: None,
            hash: 0,
        }
    }

    #[test]
    fn rows_of_the_readme_are_replaced() {
        let text = include_str!("../../../README.md");
        let row = |name: &str| Row { name: name.into(), measured: measured(0.01), bit_identical: None };
        let rows: Vec<Row> = RECORDINGS.iter().map(|r| row(r.name)).collect();
        let new = readme(text, &rows).unwrap();
        assert_eq!(new.lines().count(), text.lines().count());
        assert_eq!(new.lines().zip(text.lines()).filter(|(a, b)| a != b).count(), RECORDINGS.len() + 1);
        assert!(readme("# Another page\n", &rows).unwrap_err().to_string().contains("EuRoC MH_01"));
    }

    #[test]
    fn a_page_states_the_ate_of_its_rows() {
        let row =
            Row { name: "kitti-a-mono".into(), measured: measured(0.012_34), bit_identical: Some(true) };
        let page = page(&[row]);
        assert_eq!(stated_ate(&page, "kitti-a-mono"), Some(0.0123));
        assert_eq!(stated_ate(&page, "kitti-a-stereo"), None);
    }
}
