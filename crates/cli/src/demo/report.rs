//! Output of a demo: text on the terminal, files in its folder, and a page that opens in any browser.

use super::config::DemoConfig;
use super::once::{Demo, Figures, once};
use crate::failure::Failure;
use crate::interrupt;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::surface::form;
use cairn_eval::{
    Event, Figure, Marker, Page, Plan, PlanLine, Said, Tone, error_over_time, times_over_frames, to_tum,
};
use cairn_geometry::Vec2;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Runs one demo, prints its result and writes its files.
///
/// # Errors
/// When the demo fails, the walker did not arrive, or a file cannot be written.
pub fn run(config: &DemoConfig, folder: &Path, overwrite: bool, output: &Output) -> Result<(), Failure> {
    let outputs = checked(folder, overwrite, config.dense)?;
    let demo = once(config)?;
    let plan = plan(&demo);
    interrupt::in_order();
    write_files(&demo, &plan, &outputs)?;
    let report = folder.join("report.html");
    let f = &demo.figures;
    let text = |f: &Figures| format!("{}\n{}report     {}", transcript(f), summary(f), report.display());
    if f.arrived {
        return output.result(f, text);
    }
    output.text(&text(f))?;
    let why = format!("the walker did not get back: {:.2} m from the start", f.arrival_error_m);
    Err(Failure::new("the demo", why, format!("see {} for what happened", report.display())))
}

/// The files of a demo, in its folder.
const FILES: [&str; 7] =
    ["report.html", "plan.svg", "demo.json", "transcript.txt", "truth.tum", "estimate.tum", "demo.route"];

/// The files of a surface.
const SURFACE: [&str; 2] = ["surface.ply", "surface.png"];

/// Checks before the walk that all files can be written.
fn checked(folder: &Path, overwrite: bool, dense: bool) -> Result<Outputs, Failure> {
    let elsewhere = |f: Failure| Failure { hint: "choose another folder with --out".into(), ..f };
    crate::outputs::folder(folder).map_err(elsewhere)?;
    // An interrupted demo leaves no empty folder behind; one with files in it is not removed.
    let made = folder.to_owned();
    interrupt::before_exit(move || drop(std::fs::remove_dir(&made)));
    let names = FILES.into_iter().chain(SURFACE.into_iter().filter(|_| dense));
    let paths: Vec<_> = names.map(|name| (name, folder.join(name))).collect();
    // A recorded route is otherwise never replaced; that of an earlier demo is, if the user says so.
    let add = |outputs: Outputs, (name, path): &(&'static str, PathBuf)| match *name {
        "demo.route" if overwrite => outputs.output_kept(name, Some(path)),
        name => outputs.output(name, Some(path)),
    };
    paths.iter().fold(Outputs::new(overwrite), add).checked()
}

fn write_files(demo: &Demo, plan: &Figure, outputs: &Outputs) -> Result<(), Failure> {
    let json = serde_json::to_string_pretty(&demo.figures)
        .map_err(|e| Failure::new("demo.json", e.to_string(), "report this with the command line"))?;
    let route = demo
        .route
        .to_bytes()
        .map_err(|e| Failure::new("demo.route", e.to_string(), "report this with the command line"))?;
    let contents = [
        page(demo, plan).into_bytes(),
        plan.standalone().into_bytes(),
        json.into_bytes(),
        transcript(&demo.figures).into_bytes(),
        to_tum(&demo.truth).into_bytes(),
        to_tum(&demo.estimate).into_bytes(),
        route,
    ];
    let written = FILES.into_iter().zip(contents).map(|(name, bytes)| outputs.write(name, || Ok(bytes)));
    let mut failures: Vec<Failure> = written.filter_map(Result::err).collect();
    if let Some(surface) = &demo.surface {
        let ply = outputs.write(SURFACE[0], || surface.bytes(form(Path::new(SURFACE[0]))?, SURFACE[0]));
        failures.extend(
            [ply, outputs.write(SURFACE[1], || surface.picture())].into_iter().filter_map(Result::err),
        );
    }
    Failure::all(failures)
}

/// The announcements, one line each with its time.
fn transcript(f: &Figures) -> String {
    let mut text = String::new();
    for line in &f.said {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{:>3}:{:04.1}  {}", (line.t_s / 60.0) as i64, line.t_s % 60.0, line.words);
    }
    text
}

fn summary(f: &Figures) -> String {
    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "{name:<10} {value}");
    };
    row(
        "route",
        format!(
            "{:.1} m walked out, {:.1} m recorded, {:.1} m cleaned, {} turns",
            f.walked_out_m, f.recorded_m, f.cleaned_m, f.turns
        ),
    );
    row(
        "return",
        format!(
            "{}, {:.1} m in {:.0} s, {} announcements",
            f.facing,
            f.walked_home_m,
            f.home_s,
            f.said.len()
        ),
    );
    row(
        "arrival",
        format!("{}, {:.2} m from the start", if f.arrived { "yes" } else { "no" }, f.arrival_error_m),
    );
    if let Some(reason) = f.stopped.as_ref().filter(|_| !f.arrived) {
        row("stopped", format!("the guide gave no more directions: {reason}"));
    }
    if f.misled {
        row("misled", format!("the walker was up to {:.1} m off the path", f.farthest_off_m));
    }
    row(
        "ATE",
        format!(
            "{:.4} m RMSE over {:.1} m out and back, aligned by {}; coverage {:.4} of {} frames",
            f.ate_m,
            f.walked_out_m + f.walked_home_m,
            if f.metric { "SE3" } else { "Sim3 (one camera has a unit of its own)" },
            f.coverage,
            f.frames
        ),
    );
    for (t, frames) in &f.lost {
        row("lost", format!("at {t:.1} s for {frames} frames"));
    }
    if let Some(ms) = &f.ms {
        row("step", format!("{ms} ms from image to pose, {}", f.sensor));
    }
    if let Some(ms) = f.stages.get("map") {
        row("mapping", format!("{ms} ms per key frame"));
    }
    let memory = f.peak_rss_mb.map_or("unknown".into(), |m| format!("{m:.0} MB"));
    if f.obstacles > 0 || f.way_stops > 0 {
        row(
            "in the way",
            format!(
                "{} things put in; touched {}, stopped {} times, {} of them for nothing",
                f.obstacles, f.touched, f.way_stops, f.false_stops
            ),
        );
    }
    if let Some(ms) = f.stages.get("way ahead") {
        row("way ahead", format!("{ms} ms for each frame of the return"));
    }
    row("map", format!("{} key frames, {} landmarks; peak memory {memory}", f.keyframes, f.landmarks));
    row("time", format!("{:.1} s for {:.0} s of walking", f.wall_s, f.walk_s));
    text
}

fn plan(demo: &Demo) -> Figure {
    let f = &demo.figures;
    let mut lines = vec![
        PlanLine {
            label: "route as recorded".into(),
            points: demo.recorded.clone(),
            tone: Tone::Truth,
            broad: true,
            ..PlanLine::default()
        },
        PlanLine {
            label: "cleaned route".into(),
            points: demo.cleaned.clone(),
            tone: Tone::First,
            ..PlanLine::default()
        },
        PlanLine {
            label: "return, as walked".into(),
            points: demo.path_home.clone(),
            tone: Tone::Second,
            arrows: true,
            ..PlanLine::default()
        },
    ];
    lines.retain(|w| w.points.len() > 1);
    let events = f.said.iter().enumerate();
    let events = events.map(|(k, line)| Event { number: k + 1, at: Vec2::from(line.at), tone: Tone::Second });
    let marker = |label: &str, at| Marker { label: label.into(), at, tone: Tone::Third };
    let plan = Plan {
        title: format!("Out and back, seed {}, {}", f.seed, f.facing),
        description: format!(
            "Corridors seen from above. The recorded route of {:.1} m with {} turns leads from the start to the far \
             end; the return path runs beside it and ends {:.2} m from the start. Numbers mark the places of the \
             announcements listed in the transcript.",
            f.recorded_m, f.turns, f.arrival_error_m
        ),
        walls: demo.walls.clone(),
        dots: demo.landmarks.clone(),
        lines,
        markers: vec![marker("start", demo.start), marker("far end", demo.far_end)],
        events: events.collect(),
        ..Plan::default()
    };
    plan.figure()
}

fn page(demo: &Demo, plan: &Figure) -> String {
    let f = &demo.figures;
    let outcome = if f.arrived { "was guided back" } else { "did not get back" };
    let lead = format!(
        "A walker went {:.0} m out and {outcome}, ending {:.2} m from the start, with only the announcements below.",
        f.walked_out_m, f.arrival_error_m
    );
    let mut page =
        Page::new(&format!("Out and back: {}, {} camera, seed {}", f.facing, f.sensor, f.seed), &lead);
    page.heading("Summary");
    let number = |v: Option<f64>, digits: usize, unit: &str| {
        v.map_or("unknown".to_owned(), |v| format!("{v:.digits$} {unit}"))
    };
    page.facts(&[
        ("Arrival error", &format!("{:.2} m", f.arrival_error_m)),
        ("Outbound walk", &format!("{:.1} m", f.walked_out_m)),
        ("Cleaned route", &format!("{:.1} m, {} turns", f.cleaned_m, f.turns)),
        ("Return", &format!("{:.1} m", f.walked_home_m)),
        ("ATE, RMSE", &format!("{:.4} m", f.ate_m)),
        ("Coverage", &format!("{:.4}", f.coverage)),
        ("Step, median", &number(f.ms.map(|ms| ms.p50), 1, "ms")),
        ("Step, p99", &number(f.ms.map(|ms| ms.p99), 1, "ms")),
        ("Key frames", &f.keyframes.to_string()),
        ("Landmarks", &f.landmarks.to_string()),
        ("Peak memory", &number(f.peak_rss_mb, 0, "MB")),
    ]);
    page.heading("The route");
    page.figure(
        plan,
        "Walls of the world as grey lines, landmarks of the map as dots. The map, the recorded and the cleaned route \
         are placed in the world by aligning the whole trajectory; the return is the walker's true path.",
    );
    page.heading("Announcements");
    let said: Vec<Said> = (f.said.iter().enumerate())
        .map(|(k, line)| Said {
            number: Some(k + 1),
            t_s: line.t_s,
            words: line.words.clone(),
            note: if line.interrupts { "interrupts".into() } else { String::new() },
        })
        .collect();
    page.transcript("Times count from the first frame of the outbound walk.", &said);
    page.heading("Accuracy");
    page.figure(
        &error_over_time("Position error", &demo.evaluation),
        "Distance of each pose to the ground truth, out and back, after aligning the whole trajectory.",
    );
    for (t, frames) in &f.lost {
        page.paragraph(&format!("Tracking was lost at {t:.1} s for {frames} frames."));
    }
    page.heading("Cost");
    page.figure(&times_over_frames("Step", &demo.step_ms), "Time from image to pose, frame by frame.");
    let rows = f.stages.0.iter().map(|(name, p)| {
        let cells = [p.p50, p.p95, p.p99, p.max].map(|v| format!("{v:.2}"));
        std::iter::once(name.clone()).chain(cells).collect()
    });
    let rows: Vec<Vec<String>> = rows.collect();
    page.table("Milliseconds per stage", &["stage", "p50", "p95", "p99", "max"], &rows);
    page.paragraph(&format!(
        "The whole demo took {:.1} s for {:.0} s of walking; this includes rendering the images, which is not part \
         of the step.",
        f.wall_s, f.walk_s
    ));
    page.finish()
}
