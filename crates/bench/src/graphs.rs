//! `graphs`: solves the pose graphs of the recordings from odometry initialisation: is the known optimum reached, and
//! how fast?
//!
//! The known values are the global optima of SE-Sync's objective (Rosen, Carlone, Bandeira, Leonard, "SE-Sync", 2019,
//! table 1, to four digits); the digits beyond are certified by `tools/compare_graphs.py`.

use crate::MeasureError;
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
        let text = std::fs::read_to_string(&path).map_err(MeasureError::file(&path))?;
        rows.push(match read(&text).map_err(|e| MeasureError::of(path.display(), e))?.graph {
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

/// The complete page `docs/graphs.md`.
pub fn page(rows: &[Row]) -> String {
    format!("{HEAD}{}\nMeasured on {}.\n{TAIL}", table(rows), crate::build::measured_on())
}

const HEAD: &str = "# Pose graphs

`cargo run --release -p bench -- graphs --write` writes this page from the g2o files in `graphs/` of the recordings
(`CAIRN_DATA`, else `../shared/data` beside the checkout).

";

const TAIL: &str = "
All solves start from odometry: poses chained along the measurements between neighbours. *KnownOptimum optimum* is the optimum of
SE-Sync's objective (Rosen, Carlone, Bandeira, Leonard, 2019, whose table has its first four digits), and *reached* is the
value at which `cairn solve graph FILE --init odometry --cost se-sync` ends. `tools/compare_graphs.py` certifies it: the dual
certificate matrix at our solution is positive semi-definite, so no other poses have a lower cost.

*Default chi2* is the sum of squared whitened residuals with the full information matrices of the file (`cairn solve graph
FILE`; twice its cost). In 3-D the residual is the Lie logarithm, in 2-D x, y and angle. The time includes chaining the
odometry, the symbolic analysis, and all iterations until one is predicted to lower the cost by less than 1e-9 of it, on one
thread: the minimum wall time of the repetitions, which other load on the machine increases, and the mean CPU time of the thread.

## Comparison with other libraries

`tools/compare_graphs.py` on the same files from the same initial poses, on one core of an Intel Xeon with other load and an
earlier build, so CPU times are given (ms, minimum of five; for cairn of the whole process, including reading the file):

| graph | cairn GN / LM | GTSAM 4.3 GN / LM | g2o 0.0.12 for Python (Eigen) GN |
|---|---|---|---|
| sphere2500 | 209 / 211 | 433 / 473 | 2235 |
| parking-garage | 54 / 72 | 123 / 255 | 118 |
| smallGrid3D | 8 / 8 | 17 / 18 | 26 |
| manhattan | 31 / 57 | 110 / 152 | 55 |
| intel | 11 / 11 | 39 / 58 | 15 |
| kitti_05 | 12 / 14 | 42 / 59 | 13 |

There, idle, cairn solved sphere2500 in 153 ms (`cargo bench -p cairn-solve --bench graph -- sphere`). In 2-D g2o's
Gauss-Newton reaches our cost to all nine decimals; its Levenberg-Marquardt stops early with the tool's stopping rule. In 3-D
GTSAM ends within 6e-8 of our cost, on parking-garage 3e-6 above it; its own error function agrees with ours at our poses within
4e-8.
";
