//! How long a graph of poses takes: `cargo bench -p cairn-solve --bench graph [NAME]`. One thread; prints the minimum and
//! the median of many repetitions, of which a busy machine disturbs the first least, and on Linux the least time that the
//! thread ran. Graphs are a torus made here and the
//! g2o files below `graphs/` of the recordings (`CAIRN_DATA`, else `../shared/data`), from the odometry start.

use cairn_geometry::{LieGroup, Se3, So3, Vec3};
use cairn_solve::Loss;
use cairn_solve::g2o::{Graph, read};
use cairn_solve::graph::{GraphConfig, Method, PoseGraph, odometry_start};
use cairn_solve::sparse::{Analysis, Factor, UniformBlocks};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

fn main() {
    let only = std::env::args().skip(1).find(|a| !a.starts_with('-')).unwrap_or_default();
    if "torus".contains(&only) {
        time("torus of 50 x 50, made here", &torus(50));
    }
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let data = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(data.join("graphs")).into_iter().flatten().flatten().map(|e| e.path()).collect();
    files.sort();
    if files.is_empty() {
        println!("skipped: no graphs in {}", data.display());
    }
    for file in files.iter().filter(|f| f.to_string_lossy().contains(&only)) {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(file).expect("a g2o file");
        match read(&text).expect("a g2o file").graph {
            Graph::Plane(named) => time(&name, &named.graph),
            Graph::Space(named) => time(&name, &named.graph),
        }
    }
}

/// A torus of poses, each tied to its four neighbours.
fn torus(side: usize) -> PoseGraph<Se3, 6> {
    let mut graph = PoseGraph::new();
    let turn = |i: usize| i as f64 / side as f64 * std::f64::consts::TAU;
    for i in 0..side * side {
        let (a, b) = (turn(i / side), turn(i % side));
        let rotation = So3::exp(&Vec3::new(0.0, 0.0, a)) * So3::exp(&Vec3::new(0.0, b, 0.0));
        let place =
            Vec3::new((10.0 + 4.0 * b.cos()) * a.cos(), (10.0 + 4.0 * b.cos()) * a.sin(), 4.0 * b.sin());
        graph.add_vertex(Se3::new(rotation, place), i == 0);
    }
    for i in 0..side * side {
        for j in [(i + 1) % (side * side), (i + side) % (side * side)] {
            let mut measured = graph.values()[i].inverse().compose(&graph.values()[j]);
            let k = (i * 7 + j * 3) as f64;
            measured.translation += Vec3::new(k.sin(), k.cos(), (2.0 * k).sin()) * 0.05;
            let information = nalgebra::Matrix6::from_diagonal_element(100.0);
            graph.add_edge(i, j, measured, &information, Loss::Squared).expect("a proper edge");
        }
    }
    graph
}

fn time<G: LieGroup<D>, const D: usize>(name: &str, graph: &PoseGraph<G, D>) {
    let mut start = graph.clone();
    odometry_start(&mut start);
    println!("{name}: {} vertices, {} edges", graph.values().len(), graph.edges().len());
    for method in [Method::GaussNewton, Method::LevenbergMarquardt] {
        let config = GraphConfig { method, ..GraphConfig::default() };
        let mut told = String::new();
        repeat(&format!("{method:?}"), || {
            let mut graph = start.clone();
            let report = graph.solve(&config, || false);
            told = format!("{} iterations, cost {:.9}", report.iterations, report.cost_after);
        });
        println!("    {told}");
    }
    let free = |i: usize| i.checked_sub(1);
    let pairs = || graph.edges().iter().filter_map(|e| Some((free(e.a)?, free(e.b)?)));
    let rows = graph.values().len() - 1;
    repeat("analysis", || drop(Analysis::new(rows, D, pairs())));
    let analysis = Arc::new(Analysis::new(rows, D, pairs()));
    let off = vec![0.1; analysis.pairs().len() * D * D];
    let mut diagonal = vec![0.0; rows * D * D];
    for block in diagonal.chunks_exact_mut(D * D) {
        (0..D).for_each(|k| block[k * D + k] = 1e3);
    }
    let blocks = UniformBlocks { size: D, diagonal: &diagonal, off_diagonal: &off };
    let mut factor = Factor::new(Arc::clone(&analysis));
    repeat("factor", || factor.factor(&blocks).expect("dominant"));
    let mut x = vec![1.0; rows * D];
    repeat("solve", || factor.solve(&mut x));
    repeat("gradient and Hessian", || drop(graph.gradient(GraphConfig::default().metric)));
}

fn repeat(name: &str, mut run: impl FnMut()) {
    let (mut times, mut least_ran): (Vec<f64>, f64) = (Vec::new(), f64::INFINITY);
    let began = Instant::now();
    while times.len() < 5 || (times.len() < 40 && began.elapsed().as_secs_f64() < 1.5) {
        let (from, ran) = (Instant::now(), cpu_ns());
        run();
        times.push(from.elapsed().as_secs_f64() * 1e3);
        least_ran = least_ran.min((cpu_ns() - ran) * 1e-6);
    }
    times.sort_by(f64::total_cmp);
    let (least, median) = (times[0], times[times.len() / 2]);
    println!(
        "    {name:<24} min {least:8.3} ms, median {median:8.3} ms; on the processor min {least_ran:8.3} ms"
    );
}

/// Nanoseconds that this thread has run, not a number where the system does not say.
fn cpu_ns() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|t| t.parse().ok()).unwrap_or(f64::NAN)
}
