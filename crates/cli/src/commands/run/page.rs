//! The report of a run as one HTML file.

use super::results::Outcome;
use super::tally::Tally;
use cairn_eval::{
    Page, Plan, PlanLine, Tone, error_over_time, times_histogram, times_over_frames, trajectory_view,
    widest_axes,
};
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::Stamp;

/// The page: results, comparison with ground truth where there is one, cost, and configuration.
pub fn of(ended: &Outcome, tally: &Tally, world_from_body: &[(Stamp, Se3)]) -> String {
    let r = ended.report;
    let stopped = if ended.interrupted { " The run was interrupted." } else { "" };
    let lead = format!("{} of {} frames have a pose.{stopped}", r.tracked, r.frames);
    let mut page = Page::new(&format!("{}, {}", r.source, r.sensor), &lead);
    let number = |v: Option<f64>, unit: &str| v.map_or("unknown".into(), |v| format!("{v:.2} {unit}"));
    page.heading("Summary");
    let ate = r.accuracy.as_ref().map(|e| format!("{:.4} m", e.ate_m.rmse));
    let (coverage, keyframes, landmarks) =
        (format!("{:.3}", r.coverage), r.keyframes.to_string(), r.landmarks.to_string());
    let step = number(r.ms.map(|ms| ms.p50), "ms");
    let (memory, first) = (number(r.peak_rss_mb, "MB"), number(r.first_pose_s, "s"));
    let mut facts = vec![
        ("Coverage", coverage.as_str()),
        ("Step, median", &step),
        ("First pose", &first),
        ("Peak memory", &memory),
        ("Key frames", &keyframes),
        ("Landmarks", &landmarks),
    ];
    if let Some(ate) = &ate {
        facts.insert(0, ("ATE, RMSE", ate));
    }
    page.facts(&facts);

    page.heading("Trajectory");
    match &r.accuracy {
        Some(e) => {
            page.figure(&trajectory_view("Trajectory", e), "The estimate aligned to the ground truth.");
            page.figure(&error_over_time("Error", e), "Distance of each pose to the ground truth.");
        }
        None => page.figure(&plan(world_from_body).figure(), "Every tracked frame, corrected at the end."),
    }

    page.heading("Cost");
    page.figure(&times_over_frames("Step", &tally.step_ms), "Time from the decoded image to the pose.");
    page.figure(&times_histogram("Steps", &tally.step_ms), "Distribution of the times of a step.");
    let rows = r.stages.0.iter().map(|(name, p)| {
        let cells = [p.p50, p.p95, p.p99, p.max].map(|v| format!("{v:.2}"));
        std::iter::once(name.clone()).chain(cells).collect()
    });
    page.table("Milliseconds per stage", &["stage", "p50", "p95", "p99", "max"], &rows.collect::<Vec<_>>());

    if !r.lost.is_empty() {
        page.heading("Tracking losses");
        let rows: Vec<Vec<String>> =
            r.lost.iter().map(|l| vec![format!("{:.3}", l.t), l.reason.clone()]).collect();
        page.table("Times and reasons", &["time [s]", "reason"], &rows);
    }
    page.heading("Configuration");
    let config = serde_json::to_string_pretty(&r.config).unwrap_or_default();
    page.folded("The complete configuration", &config);
    page.finish()
}

fn plan(world_from_body: &[(Stamp, Se3)]) -> Plan {
    let points = world_from_body.iter().map(|(_, pose)| pose.translation);
    let (i, j) = widest_axes(points.clone());
    let name = |axis: usize| ["x", "y", "z"][axis].to_owned();
    let estimate = PlanLine {
        label: "estimate".into(),
        points: points.map(|p| Vec2::new(p[i], p[j])).collect(),
        tone: Tone::First,
        ..PlanLine::default()
    };
    Plan {
        title: "Trajectory".into(),
        description: format!("The estimated trajectory of {} frames.", world_from_body.len()),
        axes: (name(i), name(j)),
        lines: vec![estimate],
        ..Plan::default()
    }
}
