//! `graphs`: solves the pose graphs of the recordings from odometry initialisation: is the known optimum reached, and
//! how fast?
//!
//! The known values are the global optima of SE-Sync's objective (Rosen, Carlone, Bandeira, Leonard, "SE-Sync", 2019,
//! table 1, to four digits); the digits beyond are certified by `tools/compare_graphs.py`.

use crate::MeasureError;
use crate::error::{file, of};
use crate::processor::thread_cpu_ms;
use cairn_solve::Report;
use cairn_solve::g2o::{Graph, read};
use cairn_solve::graph::{GraphConfig, Method, Metric, PoseGraph, Rigid, odometry_start};
use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

/// A graph and the minimum of SE-Sync's objective on it.
#[derive(Clone, Copy, Debug)]
pub struct KnownOptimum {
    /// Name of the file in `graphs/`, without extension.
    pub name: &'static str,
    /// The minimum.
    pub optimum: f64,
}

/// All graphs.
pub const KNOWN: [KnownOptimum; 6] = [
    KnownOptimum { name: "sphere2500", optimum: 1687.005814282 },
    KnownOptimum { name: "parking-garage", optimum: 1.262524427766 },
    KnownOptimum { name: "smallGrid3D", optimum: 1025.398055636 },
    KnownOptimum { name: "manhattan", optimum: 6431.391387218 },
    KnownOptimum { name: "intel", optimum: 52.348227286 },
    KnownOptimum { name: "kitti_05", optimum: 276.514377003 },
];

/// Result for one graph.
#[derive(Clone, Debug)]
pub struct Row {
    /// The graph.
    pub known: KnownOptimum,
    /// Numbers of vertices and edges.
    pub size: [usize; 2],
    /// SE-Sync's objective reached by Levenberg-Marquardt from odometry initialisation.
    pub reached: f64,
    /// The default cost, by Gauss-Newton and by Levenberg-Marquardt.
    pub solved: [Solved; 2],
}

/// A solve of the default cost.
#[derive(Clone, Copy, Debug)]
pub struct Solved {
    /// Its report.
    pub report: Report,
    /// Minimum wall time of the repetitions, ms.
    pub wall_ms: f64,
    /// Mean CPU time, ms; NaN where the system does not report it.
    pub cpu_ms: f64,
}

/// Solves the available graphs, each `times` times.
///
/// # Errors
/// When a file cannot be read; the message names it.
pub fn run(data: &Path, only: Option<&str>, times: usize) -> Result<Vec<Row>, MeasureError> {
    let mut rows = Vec::new();
    for known in KNOWN.iter().filter(|k| only.is_none_or(|o| k.name.contains(o))) {
        let path = data.join("graphs").join(format!("{}.g2o", known.name));
        if !path.exists() {
            eprintln!("skipped: {} does not exist", path.display());
            continue;
        }
        let text = std::fs::read_to_string(&path).map_err(file(&path))?;
        rows.push(match read(&text).map_err(|e| of(path.display(), e))?.graph {
            Graph::Plane(named) => row(*known, &named.graph, times),
            Graph::Space(named) => row(*known, &named.graph, times),
        });
    }
    Ok(rows)
}

fn row<G: Rigid<D>, const D: usize>(known: KnownOptimum, graph: &PoseGraph<G, D>, times: usize) -> Row {
    let mut relaxed = graph.clone();
    relaxed.edges_mut().iter_mut().for_each(|e| e.information = G::isotropic(&e.information));
    odometry_start(&mut relaxed);
    let config = GraphConfig { metric: Metric::Chordal, ..GraphConfig::default() };
    let reached = 2.0 * relaxed.solve(&config, || false).cost_after;
    // NaN where the system does not report it.
    let cpu_ms_now = || thread_cpu_ms().unwrap_or(f64::NAN);
    let solved = [Method::GaussNewton, Method::LevenbergMarquardt].map(|method| {
        let config = GraphConfig { method, ..GraphConfig::default() };
        let (mut wall_ms, mut cpu_ms, mut report) = (f64::INFINITY, 0.0, None);
        for _ in 0..times.max(1) {
            let mut graph = graph.clone();
            let (wall, before) = (Instant::now(), cpu_ms_now());
            odometry_start(&mut graph);
            report = Some(graph.solve(&config, || false));
            wall_ms = wall_ms.min(wall.elapsed().as_secs_f64() * 1e3);
            cpu_ms += (cpu_ms_now() - before) / times.max(1) as f64;
        }
        let empty = Report {
            iterations: 0,
            cost_before: 0.0,
            cost_after: 0.0,
            inliers: 0,
            stop: cairn_solve::Stop::Empty,
        };
        Solved { report: report.unwrap_or(empty), wall_ms, cpu_ms }
    });
    Row { known, size: [graph.values().len(), graph.edges().len()], reached, solved }
}

impl Row {
    /// How far the reached value is above the known optimum, relative to the optimum.
    pub fn excess(&self) -> f64 {
        self.reached / self.known.optimum - 1.0
    }
}

/// The table in Markdown.
pub fn table(rows: &[Row]) -> String {
    let mut t = String::from(
        "| graph | vertices, edges | known optimum | reached (relative difference) | default chi2 | iterations GN / LM | ms GN / LM: wall | ms GN / LM: CPU |\n|---|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let [gn, lm] = &row.solved;
        let _ = writeln!(
            t,
            "| {} | {}, {} | {:.6} | {:.6} ({:+.1e}) | {:.9} | {} / {} | {:.1} / {:.1} | {:.1} / {:.1} |",
            row.known.name,
            row.size[0],
            row.size[1],
            row.known.optimum,
            row.reached,
            row.excess(),
            2.0 * lm.report.cost_after.min(gn.report.cost_after),
            gn.report.iterations,
            lm.report.iterations,
            gn.wall_ms,
            lm.wall_ms,
            gn.cpu_ms,
            lm.cpu_ms,
        );
    }
    t
}
