//! `--status`: how it stands, a line on stderr; and what the report tells of it.

use cairn_engine::{Phase, Status, StatusEvent};
use cairn_eval::{GateStanding, ImuStanding, RunReport, StatusSummary};
use std::io::Write;

/// A line is told at least so often, seconds of the source's time.
const EVERY_S: f64 = 1.0;

/// Whole lines, one below the other, so that a screen reader can follow.
#[derive(Default)]
pub struct StatusLines {
    told: Option<Status>,
}

impl StatusLines {
    /// A line, when something has changed or a second has passed.
    pub fn tell(&mut self, status: &Status) {
        if self.told.as_ref().is_some_and(|told| !is_news(told, status)) {
            return;
        }
        // Where nobody listens any more, the run goes on.
        let _ = writeln!(std::io::stderr().lock(), "status: {status}");
        self.told = Some(status.clone());
    }
}

fn is_news(told: &Status, now: &Status) -> bool {
    let what = |s: &Status| (s.phase, s.map, s.initialised, s.valid);
    let happened = now.frames > told.frames && !now.events.is_empty();
    happened || what(told) != what(now) || now.t_s - told.t_s >= EVERY_S
}

/// Adds up how a run stands, frame by frame.
#[derive(Default)]
pub struct Stood {
    standing: StatusSummary,
    last: Option<Status>,
    /// Worlds begun beside others.
    pub resets: usize,
}

impl Stood {
    /// After a frame.
    pub fn add(&mut self, status: Status) {
        if let Some(last) = &self.last {
            let seconds = self.standing.seconds.entry(last.phase.name().to_owned()).or_default();
            *seconds += status.t_s - last.t_s;
        }
        if status.valid && status.metric {
            self.standing.first_metric_pose_s.get_or_insert(status.t_s);
        }
        for event in &status.events {
            match event {
                StatusEvent::MapCreated { others: true, .. } => self.resets += 1,
                StatusEvent::Relocalised { .. } => self.standing.found += 1,
                _ => {}
            }
        }
        self.last = Some(status);
    }

    /// What the report tells.
    pub fn standing(&self) -> StatusSummary {
        let imu = self.last.as_ref().and_then(|s| Some((s, s.imu?))).map(|(s, imu)| ImuStanding {
            synthesised: imu.synthesised,
            gaps: imu.gaps,
            longest_gap_s: imu.longest_gap_s,
            initialised: s.initialised,
            gates: s.gates.iter().map(gate).collect(),
        });
        StatusSummary { imu, ..self.standing.clone() }
    }
}

fn gate(gate: &cairn_engine::Gate) -> GateStanding {
    GateStanding {
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
        let first = metric.map_or("no pose in metres".into(), |s| format!("in metres after {s:.2} s"));
        let (made_up, gaps) = (imu.synthesised, imu.gaps);
        text += &format!("inertial  {first}, {made_up} readings synthesised, {gaps} gaps\n");
        if !imu.initialised {
            let failed: Vec<&str> =
                imu.gates.iter().filter(|g| !g.passed).map(|g| g.words.as_str()).collect();
            text += &match failed.is_empty() {
                true => "  lacks   key frames for a first try\n".to_owned(),
                false => format!("  lacks   {}\n", failed.join(", ")),
            };
        }
    }
    text
}
