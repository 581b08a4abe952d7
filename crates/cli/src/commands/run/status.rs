//! `--status`: status lines on stderr; and the summary of the status in the report.

use cairn_engine::{Phase, Status, StatusEvent};
use cairn_eval::{GateSummary, ImuSummary, RunReport, StatusSummary};
use cairn_session::Age;
use std::io::Write;

/// Longest time between two status lines, seconds of the source's time.
const INTERVAL_S: f64 = 1.0;

/// Prints complete lines, one below the other, so that a screen reader can follow.
#[derive(Default)]
pub struct StatusLines {
    printed: Option<Status>,
}

impl StatusLines {
    /// Prints a line if something has changed or a second has passed; of a live source with the age of its last picture.
    pub fn update(&mut self, status: &Status, age: Age) {
        if self.printed.as_ref().is_some_and(|printed| !is_news(printed, status)) {
            return;
        }
        // If stderr is closed, the run continues.
        let _ = writeln!(std::io::stderr().lock(), "status: {status}{}", latency(age));
        self.printed = Some(status.clone());
    }
}

fn latency(age: Age) -> String {
    match age {
        Age::Recorded => String::new(),
        Age::Unknown => "; the picture's age is not known".into(),
        Age::Known { age_s, bound_s, .. } => {
            let late = if age.is_stale() { ", too old to guide" } else { "" };
            format!("; picture {:.0} ms old{}{late}", 1e3 * age_s, bound(bound_s))
        }
    }
}

fn bound(bound_s: f64) -> String {
    if bound_s > 0.0 { format!(" +- {:.0} ms", 1e3 * bound_s) } else { String::new() }
}

fn is_news(printed: &Status, now: &Status) -> bool {
    let key = |s: &Status| (s.phase, s.map, s.initialised, s.valid);
    let happened = now.frames > printed.frames && !now.events.is_empty();
    happened || key(printed) != key(now) || now.t_s - printed.t_s >= INTERVAL_S
}

/// Accumulates the status of a run, frame by frame.
#[derive(Default)]
pub struct StatusTally {
    summary: StatusSummary,
    last: Option<Status>,
    /// Maps started after the first one.
    pub resets: usize,
}

impl StatusTally {
    /// Adds the status after a frame.
    pub fn add(&mut self, status: Status) {
        if let Some(last) = &self.last {
            let seconds = self.summary.seconds.entry(last.phase.name().to_owned()).or_default();
            *seconds += status.t_s - last.t_s;
        }
        if status.valid && status.metric {
            self.summary.first_metric_pose_s.get_or_insert(status.t_s);
        }
        for event in &status.events {
            match event {
                StatusEvent::MapCreated { others: true, .. } => self.resets += 1,
                StatusEvent::Relocalised { .. } => self.summary.found += 1,
                _ => {}
            }
        }
        self.last = Some(status);
    }

    /// The summary for the report.
    pub fn summary(&self) -> StatusSummary {
        let imu = self.last.as_ref().and_then(|s| Some((s, s.imu?))).map(|(s, imu)| ImuSummary {
            synthesised: imu.synthesised,
            gaps: imu.gaps,
            longest_gap_s: imu.longest_gap_s,
            initialised: s.initialised,
            gates: s.gates.iter().map(gate).collect(),
        });
        StatusSummary { imu, ..self.summary.clone() }
    }
}

fn gate(gate: &cairn_engine::Gate) -> GateSummary {
    GateSummary {
        words: gate.to_string(),
        value: Some(gate.value).filter(|v| v.is_finite()),
        bound: gate.bound,
        passed: gate.passed,
    }
}

/// The lines of the report's table.
pub fn text(r: &RunReport) -> String {
    let in_order = Phase::ALL.iter().filter_map(|p| Some((p, r.standing.seconds.get(p.name())?)));
    let phases: Vec<String> = in_order.map(|(phase, s)| format!("{phase} {s:.2} s")).collect();
    let mut text = match phases.is_empty() {
        true => String::new(),
        false => format!("phases    {}\n", phases.join(", ")),
    };
    if let Some(imu) = &r.standing.imu {
        let metric = r.standing.first_metric_pose_s;
        let first = metric.map_or("no metric pose".into(), |s| format!("metric after {s:.2} s"));
        let (synthesised, gaps) = (imu.synthesised, imu.gaps);
        text += &format!("IMU       {first}, {synthesised} readings synthesised, {gaps} gaps\n");
        if !imu.initialised {
            let failed: Vec<&str> =
                imu.gates.iter().filter(|g| !g.passed).map(|g| g.words.as_str()).collect();
            text += &match failed.is_empty() {
                true => "  lacks   key frames for a first initialisation attempt\n".to_owned(),
                false => format!("  lacks   {}\n", failed.join(", ")),
            };
        }
    }
    text
}
