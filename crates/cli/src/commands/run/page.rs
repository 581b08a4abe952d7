//! The report of a run as one HTML file: what went wrong first, then the map from above, what happened when, accuracy
//! and cost.

use super::history::{History, Tracking};
use super::outcome::Outcome;
use super::picture;
use super::text::{metres, plural};
use cairn_atlas::Snapshot;
use cairn_eval::{Page, RunReport, error_over_time, times_histogram, times_over_frames};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;

/// The page.
pub fn of(ended: &Outcome, world_from_body: &[(Stamp, Se3)], map: &Snapshot) -> String {
    let (r, history) = (&ended.report, &ended.history);
    let stopped = if ended.interrupted { " The run was interrupted." } else { "" };
    let lead = format!("{} of {} frames have a pose.{stopped}", r.tracked, r.frames);
    let mut page = Page::new(&format!("{}, {}", r.source, r.sensor), &lead);
    summary(&mut page, r);
    page.heading("What went wrong");
    if ended.problems.is_empty() {
        page.paragraph("Nothing: every frame has a pose, and nothing was skipped.");
    }
    for problem in &ended.problems {
        page.paragraph(problem);
    }
    page.heading("The map");
    let view = picture::View::of(r, world_from_body);
    page.figure(&picture::plan(r, history, world_from_body, map, &view).figure(), &view.caption());
    page.heading("What happened when");
    page.figure(
        &picture::timeline(r, history, map).figure(),
        "Colours say how each frame was tracked. Numbers of loops and merges are those in the picture of the map and in \
         the table.",
    );
    joins(&mut page, history);
    losses(&mut page, r, history);
    skips(&mut page, r);
    scale(&mut page, r);
    if history.growth.len() > 1 {
        page.heading("Growth of the map");
        page.figure(&picture::growth(history), "Landmarks in all maps, sampled twice a second.");
    }
    if let Some(e) = &r.accuracy {
        page.heading("Accuracy");
        page.figure(
            &error_over_time("Error", e),
            "Distance of each pose to the ground truth, after aligning the whole.",
        );
        if let Some(live) = &r.live {
            page.paragraph(&format!(
                "As the poses were given at the time: ATE {:.4} m; from one pose to the next the error changes by at most \
                 {:.3} m (p99 {:.4} m).",
                live.ate_m, live.jump_max_m, live.jump_p99_m
            ));
        }
    }
    cost(&mut page, r, &ended.step_ms);
    page.heading("Configuration");
    let config = serde_json::to_string_pretty(&r.config).unwrap_or_default();
    page.folded("The complete configuration", &config);
    page.finish()
}

fn number(value: Option<f64>, digits: usize, unit: &str) -> String {
    value.map_or_else(|| "unknown".to_owned(), |v| format!("{v:.digits$} {unit}"))
}

fn summary(page: &mut Page, r: &RunReport) {
    page.heading("Summary");
    let mut facts = vec![
        ("Coverage", format!("{:.3}", r.coverage)),
        ("Key frames", r.keyframes.to_string()),
        ("Landmarks", r.landmarks.to_string()),
        ("Maps", r.maps.to_string()),
        ("Loops, merges", format!("{}, {}", r.loops, r.merges)),
        ("Times lost", r.lost.len().to_string()),
        ("Step, median", number(r.ms.map(|ms| ms.p50), 2, "ms")),
        ("Step, p99", number(r.ms.map(|ms| ms.p99), 2, "ms")),
        ("First pose", number(r.first_pose_s, 2, "s")),
        ("Peak memory", number(r.peak_rss_mb, 0, "MB")),
    ];
    if let Some(e) = &r.accuracy {
        facts.insert(0, ("ATE, RMSE", format!("{:.4} m", e.ate_m.rmse)));
        facts.insert(1, ("Path", format!("{:.1} m", e.path_m)));
    }
    page.facts(&facts.iter().map(|(name, value)| (*name, value.as_str())).collect::<Vec<_>>());
}

fn joins(page: &mut Page, history: &History) {
    if history.joins.is_empty() {
        page.paragraph("No place was recognised again: no loop was closed and no maps were merged.");
        return;
    }
    let row = |(i, j): (usize, &super::history::Join)| {
        let [new, old] = j.key_frames.map(|k| k.index().to_string());
        vec![
            (i + 1).to_string(),
            format!("{:.2}", j.at - picture::start(history)),
            if j.merge { "merge" } else { "loop" }.to_owned(),
            new,
            old,
            j.inliers.to_string(),
            format!("{:.3}", j.moved),
            format!("{:.2}", j.moved_rad.to_degrees()),
        ]
    };
    let rows: Vec<Vec<String>> = history.joins.iter().enumerate().map(row).collect();
    let head =
        ["No.", "time [s]", "what", "key frame", "recognised", "inliers", "moved by", "turned by [deg]"];
    page.table("Loops and merges", &head, &rows);
}

fn losses(page: &mut Page, r: &RunReport, history: &History) {
    let start = picture::start(history);
    let states = [Tracking::Starting, Tracking::Coasting, Tracking::Rotation, Tracking::Lost];
    let rows: Vec<Vec<String>> = history
        .stretches
        .iter()
        .filter(|s| states.contains(&s.tracking))
        .map(|s| {
            let reason =
                r.lost.iter().find(|l| s.tracking == Tracking::Lost && (l.t - s.from.seconds()).abs() < 1e-6);
            vec![
                format!("{:.2}", s.from - start),
                format!("{:.2}", s.to - start),
                s.tracking.name().to_owned(),
                reason.map_or_else(String::new, |l| l.reason.clone()),
            ]
        })
        .collect();
    if rows.is_empty() {
        return;
    }
    page.heading("Stretches without full tracking");
    page.table("Times from the first frame", &["from [s]", "to [s]", "how", "why"], &rows);
}

fn skips(page: &mut Page, r: &RunReport) {
    if r.skips.is_empty() {
        return;
    }
    page.heading("Skipped");
    let rows: Vec<Vec<String>> = r
        .skips
        .iter()
        .map(|s| vec![s.count.to_string(), plural(&s.what, s.count), s.reason.clone(), s.first.clone()])
        .collect();
    page.table("What the source could not give, and why", &["count", "what", "why", "the first"], &rows);
}

fn scale(page: &mut Page, r: &RunReport) {
    if r.scale.len() < 2 && r.scale.iter().all(|s| s.metric) {
        return;
    }
    page.heading("Unit of length");
    let known = |s: &cairn_eval::ScaleReport| match (s.metric, s.sigma_log) {
        (true, _) => metres(s.metres_sigma_log),
        (false, sigma) if sigma > 0.0 => format!("its own, known to {:.0} %", 100.0 * sigma),
        (false, _) => "its own".to_owned(),
    };
    let digits = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
    let row = |s: &cairn_eval::ScaleReport| {
        let times = [s.from_s, s.to_s].map(|t| format!("{t:.2}"));
        let [from, to] = times;
        vec![from, to, s.map.to_string(), known(s), digits(s.ate_m), digits(s.metres_per_unit)]
    };
    let rows: Vec<Vec<String>> = r.scale.iter().map(row).collect();
    let head = ["from [s]", "to [s]", "map", "unit", "ATE [m]", "metres per unit"];
    page.table("Stretches of one unit of length, in the clock of the source", &head, &rows);
}

fn cost(page: &mut Page, r: &RunReport, step_ms: &[f64]) {
    page.heading("Cost");
    page.figure(&times_over_frames("Step", step_ms), "Time from the decoded image to the pose.");
    page.figure(&times_histogram("Steps", step_ms), "Distribution of the times of a step.");
    let rows = r.stages.0.iter().map(|(name, p)| {
        let cells = [p.p50, p.p95, p.p99, p.max].map(|v| format!("{v:.2}"));
        std::iter::once(name.clone()).chain(cells).collect()
    });
    page.table("Milliseconds per stage", &["stage", "p50", "p95", "p99", "max"], &rows.collect::<Vec<_>>());
}
