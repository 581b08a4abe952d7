//! `cairn route`: what is in a recorded way, what cleaning makes of it, and a picture of both.
//!
//! The record itself is never changed. Poses are taken as they were recorded.

use crate::failure::Failure;
use crate::output::Output;
use cairn_eval::{Marker, Plan, Tone};
use cairn_geometry::Vec2;
use cairn_guide::{
    CleanConfig, CleanedRoute, Maneuver, ManeuverPlan, ManeuverPlanConfig, Route, RouteDrawing, RouteError,
    RouteInfo, Stairs, Travel, survey,
};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Recorded ways: length and turns, before and after cleaning; a picture.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Points, time, length, gaps, and the length after cleaning.
    Info(One),
    /// The cleaned way: its corners, what was cut, and the turns on the way home.
    Clean(One),
    /// Draws the way as recorded and as cleaned, seen from above, as SVG.
    Show(Show),
}

/// A recorded way.
#[derive(clap::Args)]
struct One {
    /// The recorded way.
    route: PathBuf,
}

/// A recorded way and its picture.
#[derive(clap::Args)]
struct Show {
    /// The recorded way.
    route: PathBuf,
    /// The picture; without it, SVG on stdout.
    #[arg(long, value_name = "OUT.svg")]
    out: Option<PathBuf>,
}

/// What `show` did: the picture or where it went.
#[derive(Serialize)]
struct Shown {
    #[serde(skip_serializing_if = "Option::is_none")]
    written: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    svg: Option<String>,
    drawing: RouteDrawing,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.command {
        Command::Info(one) => output.result(&load(&one.route)?.info, info_text),
        Command::Clean(one) => {
            let surveyed = load(&one.route)?;
            let cleaned = cleaned(&surveyed).map_err(|why| {
                Failure::new(one.route.display().to_string(), why, "record a way of some metres")
            })?;
            output.result(&cleaned, |c| cleaned_text(c, &surveyed.info))
        }
        Command::Show(show) => {
            let Surveyed { info, drawing, .. } = load(&show.route)?;
            let svg = plan(&drawing, &info).figure().standalone();
            let written = show.out.clone();
            let shown = match &written {
                Some(path) => {
                    cairn_eval::write_whole(path, &svg)?;
                    Shown { svg: None, written, drawing }
                }
                None => Shown { svg: Some(svg), written, drawing },
            };
            output.result(&shown, |s| match (&s.written, &s.svg) {
                (Some(path), _) => format!("written to {}", path.display()),
                (None, svg) => svg.clone().unwrap_or_default(),
            })
        }
    }
}

struct Surveyed {
    route: Route,
    info: RouteInfo,
    clean: CleanedRoute,
    drawing: RouteDrawing,
}

fn load(path: &Path) -> Result<Surveyed, Failure> {
    let route = Route::load(path).map_err(|e| {
        let shown = path.display().to_string();
        match e {
            RouteError::File { source, .. } => Failure::new(shown, source.to_string(), "check the path"),
            RouteError::Line { line, why } => Failure::new(
                format!("{shown}, line {line}"),
                why,
                "remove that line, or record the way again",
            ),
            RouteError::Header(why) => Failure::new(
                shown,
                format!("not a recorded way: {why}"),
                "give a file that cairn run --record wrote",
            ),
        }
    })?;
    let (info, clean, drawing) = survey(&route, |_| None, &CleanConfig::default());
    Ok(Surveyed { route, info, clean, drawing })
}

#[derive(Serialize)]
struct Cleaned {
    metric: bool,
    before_m: f64,
    after_m: f64,
    corners: Vec<[f64; 3]>,
    cuts: Vec<CutReport>,
    /// What there is to do on the way home, in its order.
    home: Vec<TurnReport>,
}

#[derive(Serialize)]
struct CutReport {
    from: [f64; 3],
    to: [f64; 3],
    saved_m: f64,
}

#[derive(Serialize)]
struct TurnReport {
    /// Metres from where the way home begins.
    at_m: f64,
    /// Positive to the left.
    turn_deg: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    stairs: Option<&'static str>,
}

fn cleaned(surveyed: &Surveyed) -> Result<Cleaned, String> {
    let Surveyed { route, info, clean, .. } = surveyed;
    let plan =
        ManeuverPlan::from_route(clean, Travel::Home, &route.header.ground(), &ManeuverPlanConfig::default())
            .map_err(|e| e.to_string())?;
    let turn = |m: &Maneuver| TurnReport {
        at_m: m.at_m,
        turn_deg: m.turn_rad.to_degrees(),
        stairs: m.stairs.map(|s| match s {
            Stairs::Up => "up",
            Stairs::Down => "down",
        }),
    };
    let cut = |c: &cairn_guide::Cut| CutReport { from: c.from.into(), to: c.to.into(), saved_m: c.saved_m };
    Ok(Cleaned {
        metric: info.metric,
        before_m: clean.before_m,
        after_m: clean.after_m,
        corners: clean.points.iter().map(|p| (*p).into()).collect(),
        cuts: clean.cuts.iter().map(cut).collect(),
        home: plan.maneuvers().iter().map(turn).collect(),
    })
}

/// The way seen from above.
fn plan(drawing: &RouteDrawing, info: &RouteInfo) -> Plan {
    let points = |line: &[[f64; 2]]| line.iter().map(|p| Vec2::new(p[0], p[1])).collect::<Vec<_>>();
    let (recorded, cleaned) = (points(&drawing.recorded), points(&drawing.cleaned));
    let ends = [("start", cleaned.first()), ("end", cleaned.last())];
    let marker = |(label, at): (&str, Option<&Vec2>)| {
        Some(Marker { label: label.to_owned(), at: *at?, tone: Tone::Third })
    };
    let route = |label: &str, points, tone| cairn_eval::PlanLine {
        label: label.to_owned(),
        points,
        tone,
        ..cairn_eval::PlanLine::default()
    };
    Plan {
        title: format!("A way of {:.1} m, cleaned to {:.1} m", info.length_m, info.cleaned_m),
        description: format!(
            "Seen from above: {} turns, {} detours cut out, {} stairs; recorded from {}.",
            info.turns, info.cuts, info.stairs, info.source
        ),
        axes: ("x".to_owned(), "y".to_owned()),
        markers: ends.into_iter().filter_map(marker).collect(),
        lines: vec![
            cairn_eval::PlanLine { broad: true, ..route("as recorded", recorded, Tone::Truth) },
            cairn_eval::PlanLine { arrows: true, ..route("cleaned", cleaned, Tone::First) },
        ],
        ..Plan::default()
    }
}

fn info_text(i: &RouteInfo) -> String {
    let unit = if i.metric { "m" } else { "m (a guess from the pace: the scale is not known)" };
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = writeln!(text, "source    {}", i.source);
    // Adding zero makes the negative zero of an empty sum a plain one.
    let _ = writeln!(text, "points    {} in {:.1} s", i.points, i.duration_s);
    let _ = writeln!(
        text,
        "length    {:.2} {unit}, of it {:.2} bridged, {:.2} gaps",
        i.length_m,
        i.bridged_m + 0.0,
        i.gap_m + 0.0
    );
    let _ = writeln!(
        text,
        "cleaned   {:.2} m, {} cut out, {} turns, {} stairs, at most {:.2} m from the record",
        i.cleaned_m, i.cuts, i.turns, i.stairs, i.largest_distance_m
    );
    if i.torn {
        let _ = writeln!(text, "torn      the last line was not written whole and was left out");
    }
    text
}

fn cleaned_text(c: &Cleaned, info: &RouteInfo) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "length    {:.2} m recorded, {:.2} m cleaned", c.before_m, c.after_m);
    if !c.metric {
        let _ = writeln!(text, "scale     not known: lengths are a guess from the pace");
    }
    for cut in &c.cuts {
        let [x, y, z] = cut.from;
        let _ = writeln!(text, "cut       {:.2} m at {x:.2} {y:.2} {z:.2}", cut.saved_m);
    }
    let _ = writeln!(text, "corners   {}", c.corners.len());
    let _ = writeln!(text, "home      {} places in {:.2} m", c.home.len(), info.cleaned_m);
    for turn in &c.home {
        let side = if turn.turn_deg >= 0.0 { "left" } else { "right" };
        let stairs = turn.stairs.map_or_else(String::new, |s| format!(", stairs {s}"));
        let _ = writeln!(text, "  {:7.2} m  {:.0} deg {side}{stairs}", turn.at_m, turn.turn_deg.abs());
    }
    text
}
