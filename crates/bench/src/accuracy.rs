//! `accuracy`: the real recordings. Each run has its own process, so that peak memory is measured separately; each
//! recording runs twice, to check that results are bit-identical.

use crate::recordings::{RECORDINGS, Recording};
use crate::{MeasureOptions, Measured, measure};
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
pub fn run_here(data: &Path, recording: &Recording, config: &MeasureOptions) -> Result<Measured, String> {
    let folder = data.join(recording.folder);
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default()).map_err(|e| e.to_string())?;
    measure(source.as_mut(), config)
}

/// Runs the available recordings whose name contains `only` (all if `None`), each `times` times.
///
/// # Errors
/// When a run fails; the text names the recording.
pub fn run(data: &Path, only: Option<&str>, times: usize) -> Result<Vec<Row>, String> {
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

fn child(data: &Path, recording: &Recording) -> Result<Measured, String> {
    let name = recording.name;
    let me = std::env::current_exe().map_err(|e| format!("{name}: {e}"))?;
    let out = Command::new(me)
        .args(["one", name, "--data"])
        .arg(data)
        .output()
        .map_err(|e| format!("{name}: {e}"))?;
    if !out.status.success() {
        return Err(format!("{name}: {}", String::from_utf8_lossy(&out.stderr).trim()));
    }
    serde_json::from_slice(&out.stdout).map_err(|e| format!("{name}: {e}"))
}

/// The table in Markdown, with the figures of the reference in brackets.
pub fn table(rows: &[Row]) -> String {
    let mut t = String::from(
        "| recording | alignment | ATE m (ORB-SLAM3) | coverage | step p50 / p99 ms | peak MB | bit-identical runs |\n|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let m = &row.measured;
        let Some(r) = crate::recordings::recording(&row.name).map(|r| r.reference) else { continue };
        let align = if m.metric { "SE3" } else { "Sim3" };
        let ate = m.ate_m.map_or("none".into(), |a| format!("{a:.4}"));
        let same = match row.bit_identical {
            Some(true) => "yes",
            Some(false) => "NO",
            None => "not run",
        };
        let _ = writeln!(
            t,
            "| {} | {align} | {ate} ({}-{}) | {:.2} ({:.2}) | {:.1} / {:.1} ({}) | {:.0} ({:.0}) | {same} |",
            row.name,
            r.ate_m[0],
            r.ate_m[1],
            m.coverage(),
            r.coverage,
            m.step_ms.p50,
            m.step_ms.p99,
            r.step_ms,
            m.peak_mb.unwrap_or(f64::NAN),
            r.peak_mb,
        );
    }
    t
}

/// The complete page `docs/accuracy.md`.
pub fn page(rows: &[Row]) -> String {
    let cpu = cairn_eval::process::cpu_model().unwrap_or_else(|| "an unknown processor".into());
    format!(
        "# Accuracy\n\n\
         `cargo run --release -p bench -- accuracy --write` writes this page. Recordings are read from `CAIRN_DATA`, else\n\
         from `../shared/data` beside the checkout.\n\n{}\n\
         Lockstep, default configuration. ATE is the RMSE of the final trajectory against the ground truth after alignment; coverage\n\
         is the share of packets that have a pose. A step lasts from the decoded image to the pose; times are those of the run with the lowest median, {cpu}.\n\
         Peak memory is that of the whole process. In brackets: ORB-SLAM3 V1.0 measured on the same files, on two cores of an\n\
         Intel Xeon, otherwise idle and fed in real time, range of three runs.\n",
        table(rows)
    )
}
