//! `cairn solve graph`: solves a pose graph in g2o format.

use super::{positive, stop_name, text_of};
use crate::failure::Failure;
use crate::output::Output;
use crate::progress::Progress;
use cairn_solve::g2o::{self, Graph, Named};
use cairn_solve::graph::{GraphConfig, Method, Metric, Rigid, chordal_start, odometry_start};
use cairn_solve::{Loss, Report, Stop};
use clap::ValueEnum;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

/// Optimizes a pose graph: finds the poses that best fit the relative measurements of a g2o file.
///
/// Poses are 2-D (VERTEX_SE2, EDGE_SE2) or 3-D (VERTEX_SE3:QUAT, EDGE_SE3:QUAT). FIX keeps vertices fixed; if there is
/// none, the first vertex is fixed. The cost is half the sum of the (robust) losses of the squared whitened residuals;
/// chi2 is twice that.
#[derive(clap::Args)]
pub struct Arguments {
    /// The graph in g2o format.
    file: PathBuf,
    /// The method: gn (Gauss-Newton) or lm (Levenberg-Marquardt).
    #[arg(long, default_value = "lm", value_name = "HOW")]
    method: MethodName,
    /// Initial poses: file, odometry (chained along the edges) or chordal (linear relaxation). By default the values in
    /// the file, or odometry if it has none.
    #[arg(long, value_name = "WHERE")]
    init: Option<Init>,
    /// Robust loss against outliers: none, huber or cauchy.
    #[arg(long, default_value = "none", value_name = "LOSS")]
    robust: Robust,
    /// Width of the robust loss in standard deviations.
    #[arg(long, default_value_t = 1.0, value_name = "W", value_parser = positive)]
    robust_width: f64,
    /// The cost: geodesic (Lie logarithm; x, y and angle in 2-D), chordal (translation and 2 sin(angle/2)), or se-sync
    /// (chordal, with isotropic information matrices as in the SE-Sync papers; chi2 is then their objective).
    #[arg(long, default_value = "geodesic", value_name = "WHAT")]
    cost: Cost,
    /// Largest number of iterations.
    #[arg(long, default_value_t = GraphConfig::default().iterations, value_name = "N")]
    iterations: usize,
    /// Converged when a step is predicted to lower the cost by less than this fraction.
    #[arg(long, default_value_t = GraphConfig::default().tolerance, value_name = "PART", value_parser = positive)]
    tolerance: f64,
    /// Writes the optimized graph here, in g2o format.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
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
    fixed: usize,
    method: MethodName,
    init: Init,
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
    let text = text_of(&arguments.file, "g2o")?;
    let mut file = g2o::read(&text).map_err(|e| {
        Failure::new(
            format!("{name}, line {}", e.line),
            e.reason,
            "give a graph of VERTEX_SE2 and EDGE_SE2 or of VERTEX_SE3:QUAT and EDGE_SE3:QUAT lines",
        )
    })?;
    if arguments.init == Some(Init::File) && !file.has_values {
        return Err(Failure::new(&name, "has no vertices to start from", "use --init odometry or chordal"));
    }
    let init = arguments.init.unwrap_or(if file.has_values { Init::File } else { Init::Odometry });
    let mut solved = match &mut file.graph {
        Graph::Plane(named) => solve(named, arguments, init),
        Graph::Space(named) => solve(named, arguments, init),
    }
    .map_err(|(why, hint)| Failure::new(&name, why, hint))?;
    solved.unknown = file.unknown.clone();
    if let Some(out) = &arguments.out {
        cairn_eval::write_whole(out, &g2o::write(&file))?;
    }
    output.result(&solved, summary)
}

fn solve<G: Rigid<D>, const D: usize>(
    named: &mut Named<G, D>,
    arguments: &Arguments,
    init: Init,
) -> Result<Solved, (String, &'static str)> {
    let original = named.graph.clone();
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
    match init {
        Init::File => {}
        Init::Odometry => odometry_start(graph),
        Init::Chordal => chordal_start(graph).map_err(|_| {
            let why = "the edges do not determine every pose, so there is no chordal initialisation";
            (why.to_owned(), "use --init odometry, or give edges with positive definite information")
        })?,
    }
    let progress = Progress::new(None);
    let mut steps = 0;
    let report = graph.solve(&config, || {
        steps += 1;
        progress.step(steps);
        false
    });
    let seconds = began.elapsed().as_secs_f64();
    drop(progress);
    check(&report)?;
    // The output file keeps the original measurements.
    for (edge, original) in graph.edges_mut().iter_mut().zip(original.edges()) {
        edge.information = original.information;
    }
    Ok(Solved {
        vertices: graph.values().len(),
        edges: graph.edges().len(),
        dimensions: if D == 3 { 2 } else { 3 },
        fixed: graph.fixed().iter().filter(|fixed| **fixed).count(),
        method: arguments.method,
        init,
        robust: arguments.robust,
        cost: arguments.cost,
        cost_before: report.cost_before,
        cost_after: report.cost_after,
        chi2_before: 2.0 * report.cost_before,
        chi2_after: 2.0 * report.cost_after,
        iterations: report.iterations,
        inliers: report.inliers,
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

fn summary(s: &Solved) -> String {
    let kind = if s.dimensions == 2 { "in the plane" } else { "in space" };
    let mut lines = vec![
        format!("graph       {} vertices {kind} ({} fixed), {} edges", s.vertices, s.fixed, s.edges),
        format!("cost        {:.9} before, {:.9} after", s.cost_before, s.cost_after),
        format!("chi2        {:.9} before, {:.9} after", s.chi2_before, s.chi2_after),
        format!("inliers     {} of {} edges within their 95 % bound", s.inliers, s.edges),
        format!("iterations  {} ({})", s.iterations, s.stop),
        format!("time        {:.3} s", s.seconds),
    ];
    for (tag, count) in &s.unknown {
        lines.push(format!("note        {count} lines of {tag} were ignored"));
    }
    lines.join("\n")
}
