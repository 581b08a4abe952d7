//! `cairn solve graph`: solves a pose graph in the format of g2o, TORO or iSAM.

use super::{stop_name, text_of};
use crate::failure::Failure;
use crate::interrupt;
use crate::number::positive;
use crate::output::{Output, note};
use crate::outputs::Outputs;
use crate::progress::Progress;
use cairn_solve::g2o::{self, Form, Graph, Named};
use cairn_solve::graph::{
    GraphConfig, Method, Metric, Rigid, Start, chordal_start, lowest_start, odometry_start,
};
use cairn_solve::{Loss, Report, Stop};
use clap::ValueEnum;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

/// Optimizes a pose graph: finds the poses that best fit the relative measurements of a file of g2o, TORO or iSAM.
///
/// Poses are 2-D (VERTEX_SE2, EDGE_SE2) or 3-D (VERTEX_SE3:QUAT, EDGE_SE3:QUAT), with points that they saw (EDGE_SE2_XY,
/// EDGE_SE3_TRACKXYZ) and poses that are known in the world (EDGE_SE2_PRIOR, EDGE_SE3_PRIOR). FIX keeps vertices fixed; if
/// nothing is fixed or known in the world, the first vertex is fixed, of each part that no measurement connects. The cost is half the sum of the (robust) losses of the squared whitened residuals;
/// chi2 is twice that.
#[derive(clap::Args)]
pub struct Arguments {
    /// The graph in the format of g2o, TORO or iSAM; also compressed (.bz2, .gz, .xz, .zst).
    file: PathBuf,
    /// The method: gn (Gauss-Newton) or lm (Levenberg-Marquardt).
    #[arg(long, default_value = "lm", value_name = "HOW")]
    method: MethodName,
    /// Initial poses: file, odometry (chained along the edges) or chordal (linear relaxation). By default the one of
    /// these with the lowest cost.
    #[arg(long, value_name = "WHERE")]
    init: Option<Init>,
    /// Information matrices that are not positive semi-definite: refuse the file, or solve with the nearest matrix
    /// that is (negative eigenvalues become zero).
    #[arg(long, default_value = "refuse", value_name = "WHAT")]
    information: Information,
    /// Robust loss against outliers: none, huber or cauchy.
    #[arg(long, default_value = "none", value_name = "LOSS")]
    robust: Robust,
    /// Width of the robust loss in standard deviations.
    #[arg(long, default_value_t = 1.0, value_name = "W", value_parser = positive())]
    robust_width: f64,
    /// The cost: geodesic (Lie logarithm; x, y and angle in 2-D), chordal (translation and 2 sin(angle/2)), or se-sync
    /// (chordal, with isotropic information matrices as in the SE-Sync papers; chi2 is then their objective).
    #[arg(long, default_value = "geodesic", value_name = "WHAT")]
    cost: Cost,
    /// Largest number of iterations.
    #[arg(long, default_value_t = GraphConfig::default().iterations, value_name = "N")]
    iterations: usize,
    /// Converged when a step is predicted to lower the cost by less than this fraction.
    #[arg(long, default_value_t = GraphConfig::default().tolerance, value_name = "PART", value_parser = positive())]
    tolerance: f64,
    /// Solves without the lines whose tags are not known. They are written to --out as they are.
    #[arg(long)]
    ignore_unknown: bool,
    /// Writes the optimized graph here, in g2o format.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the file if it exists.
    #[arg(long)]
    overwrite: bool,
}

#[derive(Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum MethodName {
    Gn,
    Lm,
}

#[derive(Clone, Copy, PartialEq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Init {
    File,
    Odometry,
    Chordal,
}

impl From<Start> for Init {
    fn from(start: Start) -> Self {
        match start {
            Start::Values => Self::File,
            Start::Odometry => Self::Odometry,
            Start::Chordal => Self::Chordal,
        }
    }
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Information {
    Refuse,
    Nearest,
}

#[derive(Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Robust {
    None,
    Huber,
    Cauchy,
}

#[derive(Clone, Copy, PartialEq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Cost {
    Geodesic,
    Chordal,
    SeSync,
}

/// The printed result.
#[derive(Serialize)]
struct Solved {
    vertices: usize,
    edges: usize,
    dimensions: usize,
    /// Vertices that are points, not poses.
    points: usize,
    /// Edges that say where a pose is in the world.
    priors: usize,
    fixed: usize,
    /// Parts of the graph without a measurement between them; poses of different parts mean nothing to each other.
    parts: usize,
    method: MethodName,
    init: Init,
    /// Cost of each start that was compared, the chosen one first.
    starts: Vec<(Init, f64)>,
    /// Edges whose information matrix was replaced by the nearest positive semi-definite one.
    information_replaced: usize,
    /// Edges whose information is zero: they say nothing, and count as no measurement.
    without_information: usize,
    robust: Robust,
    cost: Cost,
    cost_before: f64,
    cost_after: f64,
    chi2_before: f64,
    chi2_after: f64,
    iterations: usize,
    /// Edges within the 95 % bound of their residual.
    inliers: usize,
    stop: &'static str,
    /// Time of initialisation and solving, without reading and writing.
    seconds: f64,
    unknown: BTreeMap<String, usize>,
}

/// Reads, solves and prints.
///
/// # Errors
/// When the file is invalid, the solver makes no progress, or the result cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let name = arguments.file.display().to_string();
    let outputs = Outputs::new(arguments.overwrite)
        .input("the graph", Some(&arguments.file))
        .output("--out", arguments.out.as_deref())
        .checked()?;
    let text = text_of(&arguments.file, "g2o")?;
    let mut file = g2o::read_nearest(&text)
        .map_err(|e| Failure::new(format!("{name}, line {}", e.line), e.reason, HINT))?;
    told_form(&name, file.form);
    if !file.unknown.is_empty() && !arguments.ignore_unknown {
        return Err(Failure::new(
            &name,
            format!("has lines that are not known and would be left out: {}", g2o::tags_text(&file.unknown)),
            "give --ignore-unknown to solve without them",
        ));
    }
    if let Some(replaced) = file.replaced.filter(|_| arguments.information == Information::Refuse) {
        return Err(Failure::new(
            format!("{name}, line {}", replaced.first_line),
            format!(
                "the information matrix is not positive semi-definite, as in {} of the file's edges",
                replaced.edges
            ),
            "give --information nearest to solve with the nearest matrices that are",
        ));
    }
    if arguments.init == Some(Init::File) && !file.has_values {
        return Err(Failure::new(&name, "has no vertices to start from", "use --init odometry or chordal"));
    }
    let has_values = file.has_values;
    let mut solved = match &mut file.graph {
        Graph::Plane(named) => solve(named, arguments, has_values),
        Graph::Space(named) => solve(named, arguments, has_values),
    }
    .map_err(|(why, hint)| Failure::new(&name, why, hint))?;
    solved.unknown = file.unknown.clone();
    solved.information_replaced = file.replaced.map_or(0, |r| r.edges);
    if !has_values {
        match &mut file.graph {
            Graph::Plane(named) => named.lay_apart(),
            Graph::Space(named) => named.lay_apart(),
        }
    }
    outputs.write("--out", || Ok(g2o::write(&file).into_bytes()))?;
    output.result(&solved, summary)
}

/// Says how a graph of another program was read: its numbers do not say what they are.
fn told_form(name: &str, form: Form) {
    let how = match form {
        Form::G2o => return,
        Form::Toro => "is read as TORO's, its numbers as information matrices",
        Form::Isam => "is read as iSAM's, its numbers as square roots of information matrices",
    };
    note(&format!("note: {name} {how}; --out writes g2o"));
}

fn solve<G: Rigid<D>, const D: usize>(
    named: &mut Named<G, D>,
    arguments: &Arguments,
    has_values: bool,
) -> Result<Solved, (String, &'static str)> {
    let (original, parts) = (named.graph.clone(), named.parts().len());
    let graph = &mut named.graph;
    let loss = match arguments.robust {
        Robust::None => Loss::Squared,
        Robust::Huber => Loss::Huber(arguments.robust_width),
        Robust::Cauchy => Loss::Cauchy(arguments.robust_width),
    };
    for edge in graph.edges_mut() {
        edge.loss = loss;
        if arguments.cost == Cost::SeSync {
            edge.information = G::isotropic(&edge.information);
        }
    }
    let config = GraphConfig {
        method: match arguments.method {
            MethodName::Gn => Method::GaussNewton,
            MethodName::Lm => Method::LevenbergMarquardt,
        },
        metric: if arguments.cost == Cost::Geodesic { Metric::Geodesic } else { Metric::Chordal },
        iterations: arguments.iterations,
        tolerance: arguments.tolerance,
    };
    let began = Instant::now();
    let mut starts = Vec::new();
    match arguments.init {
        None => {
            let compared = lowest_start(graph, has_values, config.metric);
            starts = compared.iter().map(|s| (s.start.into(), s.cost)).collect();
        }
        Some(Init::File) => {}
        Some(Init::Odometry) => odometry_start(graph),
        Some(Init::Chordal) => chordal_start(graph).map_err(|_| {
            let why = "the edges do not determine every pose, so there is no chordal start";
            (why.to_owned(), "start with --init odometry, or give edges with positive definite information")
        })?,
    }
    interrupt::in_order();
    let progress = Progress::new(None);
    let mut steps = 0;
    let report = graph.solve(&config, || {
        steps += 1;
        progress.step(steps);
        interrupt::requested()
    });
    let seconds = began.elapsed().as_secs_f64();
    drop(progress);
    check(&report)?;
    // The output file keeps the original measurements.
    for (edge, original) in graph.edges_mut().iter_mut().zip(original.edges()) {
        edge.information = original.information;
    }
    let without_information = graph.edges().iter().filter(|e| e.information.norm() == 0.0).count();
    Ok(Solved {
        vertices: named.ids.len(),
        edges: graph.edges().len(),
        dimensions: if D == 3 { 2 } else { 3 },
        points: named.points.len(),
        priors: named.priors,
        fixed: graph.fixed().iter().take(named.ids.len()).filter(|fixed| **fixed).count(),
        parts,
        method: arguments.method,
        init: arguments.init.or(starts.first().map(|(init, _)| *init)).unwrap_or(Init::Odometry),
        starts,
        information_replaced: 0,
        without_information,
        robust: arguments.robust,
        cost: arguments.cost,
        cost_before: report.cost_before,
        cost_after: report.cost_after,
        chi2_before: 2.0 * report.cost_before,
        chi2_after: 2.0 * report.cost_after,
        iterations: report.iterations,
        inliers: report.inliers - without_information,
        stop: stop_name(report.stop),
        seconds,
        unknown: BTreeMap::new(),
    })
}

/// Rejects a solution without progress.
fn check(report: &Report) -> Result<(), (String, &'static str)> {
    if !report.cost_before.is_finite() {
        return Err((
            "the initial cost is not finite".into(),
            "the numbers are too large: check poses and information matrices",
        ));
    }
    if report.stop == Stop::NoDescent && report.cost_after >= report.cost_before {
        return Err((
            format!(
                "no step lowers the cost of {:.6e}: the edges do not determine every pose",
                report.cost_before
            ),
            "try --method lm, or give edges with positive definite information",
        ));
    }
    Ok(())
}

/// What to do about a text that is no graph.
pub(in crate::commands) const HINT: &str = "give a graph of VERTEX_SE2 and EDGE_SE2 or of VERTEX_SE3:QUAT and EDGE_SE3:QUAT lines (g2o), or of VERTEX2 and EDGE2, VERTEX3 and EDGE3 (TORO, iSAM)";

fn summary(s: &Solved) -> String {
    let kind = if s.dimensions == 2 { "in the plane" } else { "in space" };
    let mut lines = vec![
        format!("graph       {} vertices {kind} ({} fixed), {} edges", s.vertices, s.fixed, s.edges),
        format!("start       {}{}", init_name(s.init), compared(&s.starts)),
        format!("cost        {:.9} before, {:.9} after", s.cost_before, s.cost_after),
        format!("chi2        {:.9} before, {:.9} after", s.chi2_before, s.chi2_after),
        format!(
            "inliers     {} of {} edges within their 95 % bound",
            s.inliers,
            s.edges - s.without_information
        ),
        format!("iterations  {} ({})", s.iterations, s.stop),
        format!("time        {:.3} s", s.seconds),
    ];
    if s.points + s.priors > 0 {
        lines[0] += &format!(" ({} vertices are points, {} edges are from the world)", s.points, s.priors);
    }
    if s.parts > 1 {
        lines.push(format!(
            "note        no measurement connects the {} parts of the graph: poses of different parts mean nothing to each other",
            s.parts
        ));
    }
    if s.without_information > 0 {
        let those = format!("{} of the {} edges have zero information", s.without_information, s.edges);
        lines.push(format!("note        {those}: they measure nothing, and the poses do not depend on them"));
    }
    if s.information_replaced > 0 {
        lines.push(format!(
            "note        {} information matrices were replaced by the nearest positive semi-definite ones",
            s.information_replaced
        ));
    }
    for (tag, count) in &s.unknown {
        lines.push(format!("note        {count} lines of {tag} were ignored"));
    }
    lines.join("\n")
}

fn init_name(init: Init) -> &'static str {
    match init {
        Init::File => "file",
        Init::Odometry => "odometry",
        Init::Chordal => "chordal",
    }
}

/// The costs of the starts that were compared, in words.
fn compared(starts: &[(Init, f64)]) -> String {
    if starts.is_empty() {
        return String::new();
    }
    let each: Vec<String> =
        starts.iter().map(|(init, cost)| format!("{} {cost:.6e}", init_name(*init))).collect();
    format!(", of least cost: {}", each.join(", "))
}
