//! The results as one HTML page with figures.

use super::Results;
use super::row::Row;
use super::table::{HEADS, KITTI_HEADS, cells, groups, kitti, legend};
use cairn_eval::{Dots, Labels, Page, dot_chart};

/// The value of a run that a figure shows.
type Figure = fn(&Row) -> Option<f64>;

/// The page.
pub fn of(results: &Results) -> String {
    let mut page = Page::new("Benchmark", &legend(results));
    let groups = groups(&results.runs);
    let table: Vec<Vec<String>> = groups.iter().map(|g| cells(g)).collect();
    page.heading("Results");
    page.table("Each recording with each sensor", &HEADS, &table);
    let kitti = kitti(&results.runs);
    if !kitti.is_empty() {
        page.table(
            "Drift over segments of 100 to 800 m, as in the KITTI odometry benchmark",
            &KITTI_HEADS,
            &kitti,
        );
    }
    page.heading("Figures");
    let figures: [(&str, &str, Figure); 4] = [
        ("Absolute trajectory error", "ATE (RMSE), m", |r| r.ate_m),
        ("Error of the live poses", "live ATE (RMSE), m", |r| r.live_ate_m),
        ("Time of a step, median", "ms", |r| r.step_p50_ms),
        ("Peak memory", "MB", |r| r.peak_mb),
    ];
    for (title, x, value) in figures {
        let rows: Vec<Dots> = groups
            .iter()
            .filter_map(|group| {
                let first = group.first()?;
                let values: Vec<f64> = group.iter().filter_map(value).collect();
                let label = format!("{} {}", first.sequence, first.sensor);
                (!values.is_empty()).then_some(Dots { label, values })
            })
            .collect();
        if rows.is_empty() {
            continue;
        }
        let labels = Labels {
            title: title.into(),
            description: format!("{title} of each recording with each sensor, a dot for each run"),
            x: x.into(),
            y: String::new(),
        };
        page.figure(
            &dot_chart(&labels, &rows),
            &format!("{title}: a dot for each run, on a logarithmic scale."),
        );
    }
    page.heading("Each run");
    let links: Vec<(String, String)> = results
        .runs
        .iter()
        .filter(|r| r.failed.is_none())
        .map(|r| (r.line(), format!("runs/{}/report.html", r.folder)))
        .collect();
    page.links(&links);
    let failed = results.runs.iter().filter(|r| r.failed.is_some()).map(Row::line);
    for line in failed.chain(results.left_out.iter().map(|what| format!("Left out: {what}"))) {
        page.paragraph(&line);
    }
    page.finish()
}
