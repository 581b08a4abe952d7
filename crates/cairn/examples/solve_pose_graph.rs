//! Optimises a pose graph: a g2o file in the plane or in space, else a small loop that is built here.
//!
//! `cargo run --release -p cairn --example solve_pose_graph -- [FILE.g2o] [OUT.g2o]`

use cairn::geometry::{Mat3, Se2};
use cairn::solve::g2o::{self, Graph};
use cairn::solve::graph::{GraphConfig, PoseGraph};
use cairn::solve::{Loss, Report};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let Some(path) = arguments.next() else { return square() };
    let mut file = g2o::read(&std::fs::read_to_string(&path)?)?;
    let config = GraphConfig::default();
    let (kind, report) = match &mut file.graph {
        Graph::Plane(named) => ("plane", named.graph.solve(&config, || false)),
        Graph::Space(named) => ("space", named.graph.solve(&config, || false)),
    };
    print(kind, &report);
    if let Some(out) = arguments.next() {
        std::fs::write(out, g2o::write(&file))?;
    }
    Ok(())
}

/// A robot drives round a square with an odometer that turns one degree too far at each step, and recognises its start.
fn square() -> Result<(), Box<dyn Error>> {
    const SIDE: usize = 5;
    let measured = |nth: usize| {
        let corner = if nth % SIDE == SIDE - 1 { 90.0_f64 } else { 0.0 };
        Se2::from_xy_angle(1.0, 0.0, (corner + 1.0).to_radians())
    };
    let information = Mat3::from_diagonal(&[100.0, 100.0, 400.0].into());

    // The first guess is the odometry itself. The first vertex is fixed: edges alone leave the frame open.
    let mut graph = PoseGraph::new();
    let mut world_from_robot = Se2::identity();
    let first = graph.add_vertex(world_from_robot, true);
    let mut last = first;
    for nth in 0..4 * SIDE {
        world_from_robot = world_from_robot * measured(nth);
        let next = graph.add_vertex(world_from_robot, false);
        graph.add_edge(last, next, measured(nth), &information, Loss::Squared)?;
        last = next;
    }
    let gap = |graph: &PoseGraph<Se2, 3>| {
        (graph.values()[last].translation - graph.values()[first].translation).norm()
    };
    let before = gap(&graph);

    // The loop: the last vertex is the first place. A robust loss bounds the harm of a wrong one.
    graph.add_edge(first, last, Se2::identity(), &information, Loss::Huber(2.0))?;
    let report = graph.solve(&GraphConfig::default(), || false);
    print("plane", &report);
    println!("gap       {before:.3} m before, {:.3} m after", gap(&graph));
    if gap(&graph) < 0.1 * before { Ok(()) } else { Err("the loop was not closed".into()) }
}

fn print(kind: &str, report: &Report) {
    println!("graph     in the {kind}");
    println!("cost      {:.6} before, {:.6} after", report.cost_before, report.cost_after);
    println!("solver    {} iterations, {:?}", report.iterations, report.stop);
}
