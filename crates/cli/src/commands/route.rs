//! `cairn route`: summary of a recorded route, the result of cleaning it, and a drawing of both.
//!
//! The file itself is never changed. Poses are used as they were recorded.

use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn_eval::{Marker, Plan, Tone};
use cairn_geometry::Vec2;
use cairn_guide::{
    CleanConfig, CleanedRoute, Maneuver, ManeuverPlan, ManeuverPlanConfig, ManeuverPlanError, Route,
    RouteDrawing, RouteError, RouteInfo, Stairs, Travel, survey,
};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Inspects recorded routes: length and turns, before and after cleaning, and a drawing.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Shows points, duration, length, gaps, and the length after cleaning.
    Info(One),
    /// Shows the cleaned route: its corners, the detours cut out, and the turns on the return.
    Clean(One),
    /// Draws the route as recorded and as cleaned, seen from above, as SVG.
    Show(Show),
}

/// A recorded route.
#[derive(clap::Args)]
struct One {
    /// The recorded route.
    route: PathBuf,
}

/// A recorded route and where to write its drawing.
#[derive(clap::Args)]
struct Show {
    /// The recorded route.
    route: PathBuf,
    /// Writes the drawing here; otherwise SVG goes to stdout.
    #[arg(long, value_name = "OUT.svg")]
    out: Option<PathBuf>,
    /// Replaces the drawing if it exists.
    #[arg(long, requires = "out")]
    overwrite: bool,
}

/// Result of `show`: the drawing or the file it was written to.
#[derive(Serialize)]
struct Shown {
    #[serde(skip_serializing_if = "Option::is_none")]
    written: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    svg: Option<String>,
    drawing: RouteDrawing,
}

/// Runs the subcommand.
///
/// # Errors
/// When the route cannot be read or cleaned, or the drawing cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.command {
        Command::Info(one) => output.result(&load(&one.route)?.info, info_text),
        Command::Clean(one) => {
            let surveyed = load(&one.route)?;
            let cleaned = cleaned(&surveyed).map_err(|why| {
                Failure::new(
                    one.route.display().to_string(),
                    why.to_string(),
                    "record a route of at least some metres",
                )
            })?;
            output.result(&cleaned, |c| cleaned_text(c, &surveyed.info))
        }
        Command::Show(show) => {
            let outputs = Outputs::new(show.overwrite)
                .input("the route", Some(&show.route))
                .output("--out", show.out.as_deref())
                .checked()?;
            let Surveyed { info, drawing, .. } = load(&show.route)?;
            let svg = plan(&drawing, &info).figure().standalone();
            let written = show.out.clone();
            let shown = match &written {
                Some(_) => {
                    outputs.write("--out", || Ok(svg.into_bytes()))?;
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
                "remove that line, or record the route again",
            ),
            RouteError::Header(why) => Failure::new(
                shown,
                format!("not a recorded route: {why}"),
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
    /// Manoeuvres on the return, in order.
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
    /// Metres from the start of the return.
    at_m: f64,
    /// Positive to the left.
    turn_deg: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    stairs: Option<&'static str>,
}

fn cleaned(surveyed: &Surveyed) -> Result<Cleaned, ManeuverPlanError> {
    let Surveyed { route, info, clean, .. } = surveyed;
    let plan = ManeuverPlan::from_route(
        clean,
        Travel::Home,
        &route.header.ground(),
        &ManeuverPlanConfig::default(),
    )?;
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

/// The route seen from above.
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
        title: format!("A route of {:.1} m, cleaned to {:.1} m", info.length_m, info.cleaned_m),
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
    let unit = if i.metric { "m" } else { "m (estimated from the walking speed: the scale is unknown)" };
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "source    {}", i.source);
    // Adding zero turns the negative zero of an empty sum into a positive one.
    let _ = writeln!(text, "points    {} in {:.1} s", i.points, i.duration_s);
    let _ = writeln!(
        text,
        "length    {:.2} {unit}, of which {:.2} bridged, {:.2} gaps",
        i.length_m,
        i.bridged_m + 0.0,
        i.gap_m + 0.0
    );
    let _ = writeln!(
        text,
        "cleaned   {:.2} m, {} detours cut out, {} turns, {} stairs, at most {:.2} m from the recording",
        i.cleaned_m, i.cuts, i.turns, i.stairs, i.largest_distance_m
    );
    if i.torn {
        let _ = writeln!(text, "torn      the last line was incomplete and was ignored");
    }
    text
}

fn cleaned_text(c: &Cleaned, info: &RouteInfo) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "length    {:.2} m recorded, {:.2} m cleaned", c.before_m, c.after_m);
    if !c.metric {
        let _ = writeln!(text, "scale     unknown: lengths are estimated from the walking speed");
    }
    for cut in &c.cuts {
        let [x, y, z] = cut.from;
        let _ = writeln!(text, "cut       {:.2} m at {x:.2} {y:.2} {z:.2}", cut.saved_m);
    }
    let _ = writeln!(text, "corners   {}", c.corners.len());
    let _ = writeln!(text, "return    {} manoeuvres in {:.2} m", c.home.len(), info.cleaned_m);
    for turn in &c.home {
        let side = if turn.turn_deg >= 0.0 { "left" } else { "right" };
        let stairs = turn.stairs.map_or_else(String::new, |s| format!(", stairs {s}"));
        let _ = writeln!(text, "  {:7.2} m  {:.0} deg {side}{stairs}", turn.at_m, turn.turn_deg.abs());
    }
    text
}
