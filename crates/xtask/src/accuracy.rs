//! `accuracy`: the real recordings, each run in a process of its own, so that its memory is its own; twice, so that
//! what should be the same bits is known to be.

use crate::recordings::{RECORDINGS, Recording};
use crate::{MeasureOptions, Measured, measure};
use cairn_sources::{OpenOptions, open};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// A row that was run.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Name of the recording and sensor.
    pub name: String,
    /// The run.
    pub measured: Measured,
    /// Whether a second run gave the same bits; none when it was not run.
    pub twice_the_same: Option<bool>,
}

/// Runs one recording in this process.
///
/// # Errors
/// As [`measure()`], and when the recording can not be opened.
pub fn run_here(data: &Path, recording: &Recording, config: &MeasureOptions) -> Result<Measured, String> {
    let folder = data.join(recording.folder);
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default()).map_err(|e| e.to_string())?;
    measure(source.as_mut(), config)
}

/// Runs the recordings that `only` names (all when it is none) that are there, each `times` times.
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
        let twice_the_same = (runs.len() > 1).then(|| runs.windows(2).all(|w| w[0].hash == w[1].hash));
        // The quietest run speaks for the times: the others were disturbed by whatever else the machine did.
        let quiet = runs.into_iter().min_by(|a, b| a.step_ms.p50.total_cmp(&b.step_ms.p50));
        let Some(measured) = quiet else { continue };
        rows.push(Row { name: recording.name.into(), measured, twice_the_same });
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

/// The table in Markdown, the reference's figures beside.
pub fn table(rows: &[Row]) -> String {
    let mut t = String::from(
        "| recording | alignment | ATE m (ORB-SLAM3) | coverage | step p50 / p99 ms | peak MB | same bits twice |\n|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let m = &row.measured;
        let Some(r) = crate::recordings::recording(&row.name).map(|r| r.reference) else { continue };
        let align = if m.metric { "SE3" } else { "Sim3" };
        let ate = m.ate_m.map_or("none".into(), |a| format!("{a:.4}"));
        let same = match row.twice_the_same {
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

/// The whole page `docs/accuracy.md`.
pub fn page(rows: &[Row]) -> String {
    let cpu = cairn_eval::process::cpu_model().unwrap_or_else(|| "a processor of unknown name".into());
    format!(
        "# Accuracy\n\n\
         `cargo run --release -p xtask -- accuracy --write` writes this page. Recordings are looked for in `CAIRN_DATA`, else\n\
         in `../shared/data` beside the checkout.\n\n{}\n\
         Lockstep, default configuration. ATE is the RMSE of the final trajectory against the truth after alignment; coverage is\n\
         the share of packets that have a pose. A step is from the decoded image to the pose; the quietest of the runs, {cpu}.\n\
         Peak memory is that of the whole process. In brackets: ORB-SLAM3 V1.0 measured on the same files, on two cores of this\n\
         kind, quiet and fed in real time, range of three runs.\n",
        table(rows)
    )
}
