//! Writes a page with every element, for visual inspection: `page OUT.html [REFERENCE ESTIMATE]`.

use cairn_eval::{
    EvalOptions, Event, Marker, Page, Percentiles, Plan, PlanLine, Said, Tone, error_over_time,
    evaluate_files, load_trajectory, times_histogram, times_over_frames, trajectory_view, write_whole,
};
use cairn_geometry::Vec2;
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let out = args.first().ok_or("usage: page OUT.html [REFERENCE ESTIMATE]")?;
    let mut page = Page::new(
        "An example page",
        "Every element that a report can contain, with artificial times and an artificial walk.",
    );
    walk(&mut page);
    if let [_, reference, estimate] = args.as_slice() {
        evaluation(&mut page, Path::new(reference), Path::new(estimate))?;
    }
    timings(&mut page);
    write_whole(Path::new(out), &page.finish())?;
    Ok(())
}

fn walk(page: &mut Page) {
    let (width, inner) = (14.0, 2.0);
    let outer = [Vec2::new(0.0, 0.0), Vec2::new(width, 0.0), Vec2::new(width, 9.0), Vec2::new(0.0, 9.0)];
    let block = [
        Vec2::new(inner, inner),
        Vec2::new(width - inner, inner),
        Vec2::new(width - inner, 9.0 - inner),
        Vec2::new(inner, 9.0 - inner),
    ];
    let walls = [outer, block].iter().flat_map(|w| (0..4).map(|i| [w[i], w[(i + 1) % 4]])).collect();
    let corners =
        [(1.0, 8.0), (1.0, 1.0), (13.0, 1.0), (13.0, 8.0), (4.0, 8.0)].map(|(x, y)| Vec2::new(x, y));
    let points: Vec<Vec2> = corners
        .windows(2)
        .flat_map(|w| (0..60).map(|i| w[0].lerp(&w[1], f64::from(i) / 60.0)).collect::<Vec<_>>())
        .collect();
    let home = points
        .iter()
        .rev()
        .enumerate()
        .map(|(i, p)| p + Vec2::new(0.2, 0.2) * (i as f64 * 0.21).sin())
        .collect();
    let words = [
        (corners[4], "Go straight, 9 metres.", "start"),
        (Vec2::new(10.0, 8.0), "In 3 metres, turn right.", "before the turn"),
        (corners[3], "Turn right.", "at the turn"),
        (Vec2::new(13.0, 7.6), "Good. Straight, 7 metres.", "after the turn"),
        (corners[2], "Turn right.", "at the turn"),
        (corners[1], "Turn right.", "at the turn"),
        (corners[0], "You have arrived.", "arrival"),
    ];
    let numbered = words.iter().enumerate();
    let events =
        numbered.clone().map(|(i, w)| Event { number: i + 1, at: w.0, tone: Tone::Second }).collect();
    let plan = Plan {
        dots: Vec::new(),
        title: "The route out and the route home".into(),
        description: "A walk of 37 metres with three turns around a block, and the way back along it.".into(),
        axes: ("x".into(), "y".into()),
        walls,
        lines: vec![
            PlanLine {
                label: "route out, recorded".into(),
                points,
                tone: Tone::First,
                arrows: true,
                ..PlanLine::default()
            },
            PlanLine {
                label: "route home, walked".into(),
                points: home,
                tone: Tone::Second,
                dashed: true,
                ..PlanLine::default()
            },
        ],
        markers: vec![
            Marker { label: "home".into(), at: corners[0], tone: Tone::Third },
            Marker { label: "turned back here".into(), at: corners[4], tone: Tone::Fourth },
        ],
        events,
        ..Plan::default()
    };
    page.facts(&[
        ("Route length", "37.0 m"),
        ("Arrival error", "0.21 m"),
        ("ATE", "0.014 m"),
        ("Coverage", "1.00"),
        ("Step, p50", "6.1 ms"),
    ]);
    page.heading("The walk");
    page.figure(&plan.figure(), "The numbers show where each line of the transcript was spoken.");
    let lines: Vec<Said> = numbered
        .map(|(i, w)| Said { number: Some(i + 1), t_s: 7.3 * i as f64, words: w.1.into(), note: w.2.into() })
        .collect();
    page.transcript("What the walker heard", &lines);
}

fn evaluation(page: &mut Page, reference: &Path, estimate: &Path) -> Result<(), Box<dyn Error>> {
    let result =
        evaluate_files(&load_trajectory(reference)?, &load_trajectory(estimate)?, &EvalOptions::default())?;
    page.heading("Accuracy");
    page.figure(&trajectory_view("Estimate and ground truth", &result), "Aligned by a rigid transform.");
    page.figure(&error_over_time("Error over time", &result), "Distance between estimate and ground truth.");
    Ok(())
}

fn timings(page: &mut Page) {
    let ms: Vec<f64> = (0..900u32)
        .map(|i| {
            6.0 + 2.0 * (f64::from(i) * 0.02).sin()
                + f64::from(i * 7919 % 101) * 0.02
                + if i % 97 == 0 { 6.0 } else { 0.0 }
        })
        .collect();
    page.heading("Time");
    page.figure(&times_over_frames("Time per frame", &ms), "From decoded image to pose.");
    page.figure(&times_histogram("Distribution of the time per frame", &ms), "From decoded image to pose.");
    if let Some(p) = Percentiles::of(&ms) {
        let row = |name: &str, part: f64| {
            let cells = [p.p50, p.p95, p.p99, p.max].map(|v| format!("{:.2}", v * part));
            std::iter::once(name.to_owned()).chain(cells).collect::<Vec<_>>()
        };
        page.table(
            "Milliseconds per frame",
            &["stage", "p50", "p95", "p99", "max"],
            &[row("step", 1.0), row("see", 0.4), row("track", 0.35)],
        );
    }
    page.folded("Configuration", "[front_end]\nfeatures = 1000\nlevels = 8\n");
}
