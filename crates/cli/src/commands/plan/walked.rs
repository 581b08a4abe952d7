//! `cairn plan MAP.cairn`: the way over recorded routes from one place of a saved map to another.

use super::{Arguments, Place};
use crate::commands::map;
use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn_eval::{Marker, Plan, PlanLine, Tone};
use cairn_geometry::Vec2;
use cairn_guide::{Maneuver, Route, RouteConfig, Travel};
use cairn_session::{Destination, NoWay, Planned, ReferencePath, WalkedRoutes};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What is printed.
#[derive(Serialize)]
struct Report {
    from: String,
    to: String,
    /// Whether lengths are metres; else they are estimated from the walking speed.
    metric: bool,
    length_m: f64,
    /// The stretches of recorded routes, in order.
    stretches: Vec<Stretch>,
    /// Turns of the cleaned way.
    turns: Vec<Turn>,
    /// Seen from above, metres.
    points: Vec<[f64; 3]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    written: Vec<PathBuf>,
}

#[derive(Serialize)]
struct Stretch {
    route: String,
    /// Against the direction in which it was recorded.
    backwards: bool,
}

#[derive(Serialize)]
struct Turn {
    /// Metres from the start.
    at_m: f64,
    /// Positive to the left.
    turn_deg: f64,
}

pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let name = arguments.grid.display().to_string();
    if arguments.out.as_deref().is_some_and(|out| out.extension().is_none_or(|e| e != "svg")) {
        return Err(Failure::new(
            "--out",
            "a way over routes is drawn as SVG only",
            "name a file that ends in .svg",
        ));
    }
    let mut outputs = Outputs::new(arguments.overwrite)
        .input("the map", Some(&arguments.grid))
        .output("--out", arguments.out.as_deref())
        .output("--route-out", arguments.route_out.as_deref());
    for file in &arguments.routes {
        outputs = outputs.input("--routes", Some(file));
    }
    let outputs = outputs.checked()?;
    let file = map::open(&arguments.grid)?;
    let routes = routes(arguments, &file)?;
    let walked = WalkedRoutes::new(&file.snapshot, routes.iter().map(|(name, route)| (name.clone(), route)));
    let find = |place: &Place| match place {
        Place::At(at) => walked.near(*at),
        Place::Named(name) => walked.destination(name),
    };
    let hint = hint(&walked);
    let failed = |e: NoWay| Failure::new(&name, e.to_string(), &hint);
    let (from, to) = (find(&arguments.from).map_err(failed)?, find(&arguments.to).map_err(failed)?);
    let planned = walked.take_me(from.map, from.at, &to).map_err(failed)?;
    let turns = turns(&file, &planned)?;
    if arguments.out.is_some() {
        outputs.write("--out", || Ok(draw(&walked, &planned, &from).into_bytes()))?;
    }
    if arguments.route_out.is_some() {
        let bug = |e: std::io::Error| Failure::new("the route", e.to_string(), "report this with the map");
        outputs.write("--route-out", || planned.route.to_bytes().map_err(bug))?;
    }
    let stretch = |s: &cairn_plan::walked::Stretch| Stretch {
        route: routes.get(s.route).map_or_else(String::new, |(name, _)| name.clone()),
        backwards: s.backwards,
    };
    let told = Report {
        from: from.name,
        to: to.name,
        metric: planned.route.header.metric,
        length_m: planned.path.length_m,
        stretches: planned.path.stretches.iter().map(stretch).collect(),
        turns: turns.iter().map(|m| Turn { at_m: m.at_m, turn_deg: m.turn_rad.to_degrees() }).collect(),
        points: planned.path.points.iter().map(|p| (*p).into()).collect(),
        written: arguments.out.iter().chain(&arguments.route_out).cloned().collect(),
    };
    output.result(&told, text)
}

/// The routes of the command line, else those in the map's file, with their names.
fn routes(
    arguments: &Arguments,
    file: &cairn_atlas::store::MapFile,
) -> Result<Vec<(String, Route)>, Failure> {
    let stem = |path: &Path| path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    if arguments.routes.is_empty() {
        let named =
            cairn::routes_of(file).filter_map(|(name, _, route)| Some((stem(Path::new(name)), route.ok()?)));
        return Ok(named.collect());
    }
    let load = |path: &PathBuf| {
        let route = Route::load(path).map_err(|e| {
            Failure::new(
                path.display().to_string(),
                e.to_string(),
                "give files that cairn run --record wrote",
            )
        })?;
        Ok((stem(path), route))
    };
    arguments.routes.iter().map(load).collect()
}

fn hint(walked: &WalkedRoutes) -> String {
    let names: Vec<String> = walked.destinations().into_iter().map(|d| d.name).collect();
    match names.is_empty() {
        true => "give recorded routes with --routes".to_owned(),
        false => format!("places are {}", names.join(", ")),
    }
}

/// The turns of the cleaned way.
fn turns(file: &cairn_atlas::store::MapFile, planned: &Planned) -> Result<Vec<Maneuver>, Failure> {
    let reference =
        ReferencePath::in_map(&file.snapshot, &planned.route, Travel::Again, &RouteConfig::default());
    let plan = reference.plan().map_err(|e| {
        Failure::new(
            format!("the way to {}", planned.to.name),
            e.to_string(),
            "choose places that are farther apart",
        )
    })?;
    Ok(plan.maneuvers().to_vec())
}

fn draw(walked: &WalkedRoutes, planned: &Planned, from: &Destination) -> String {
    let line =
        |label: String, points: Vec<Vec2>, tone| PlanLine { label, points, tone, ..PlanLine::default() };
    let mut lines: Vec<PlanLine> = (walked.lines(planned.to.map).into_iter())
        .map(|(name, points)| PlanLine {
            broad: true,
            ..line(name, points.iter().map(|p| p.xy()).collect(), Tone::Truth)
        })
        .collect();
    let way: Vec<Vec2> = planned.path.points.iter().map(|p| p.xy()).collect();
    let marker = |label: &str, at: Option<&Vec2>| {
        Some(Marker { label: label.to_owned(), at: *at?, tone: Tone::Third })
    };
    let markers = [marker(&from.name, way.first()), marker(&planned.to.name, way.last())];
    let markers = markers.into_iter().flatten().collect();
    lines.push(PlanLine { arrows: true, ..line("the way".into(), way, Tone::First) });
    let plan = Plan {
        title: format!("From {} to {}", from.name, planned.to.name),
        description: format!(
            "Recorded routes seen from above, and the way of {:.1} m over them.",
            planned.path.length_m
        ),
        axes: ("x".to_owned(), "y".to_owned()),
        lines,
        markers,
        ..Plan::default()
    };
    plan.figure().standalone()
}

fn text(t: &Report) -> String {
    let unit = if t.metric { "m" } else { "m (estimated from the walking speed: the scale is unknown)" };
    let mut lines = vec![format!("way         from {} to {}, {:.1} {unit}", t.from, t.to, t.length_m)];
    for s in &t.stretches {
        let direction = if s.backwards { "against its recording" } else { "as recorded" };
        lines.push(format!("along       {}, {direction}", s.route));
    }
    for turn in &t.turns {
        let side = if turn.turn_deg >= 0.0 { "left" } else { "right" };
        lines.push(format!("turn        {:.0} degrees {side} at {:.1} m", turn.turn_deg.abs(), turn.at_m));
    }
    lines.extend(t.written.iter().map(|file| format!("written     {}", file.display())));
    lines.join("\n")
}
