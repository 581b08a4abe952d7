//! g2o text: any bytes are read or refused; what was read is written, read again, and solved for a few steps.
#![no_main]

use cairn_solve::g2o::{Graph, read, write};
use cairn_solve::graph::{GraphConfig, Rigid, chordal_start, odometry_start};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(file) = read(text) else { return };
    assert!(read(&write(&file)).is_ok(), "what was written is not read");
    match file.graph {
        Graph::Plane(named) => solve(named.graph),
        Graph::Space(named) => solve(named.graph),
    }
});

fn solve<G: Rigid<D>, const D: usize>(mut graph: cairn_solve::graph::PoseGraph<G, D>) {
    let setting = GraphConfig { iterations: 3, ..GraphConfig::default() };
    graph.solve(&setting, || false);
    odometry_start(&mut graph);
    if chordal_start(&mut graph).is_ok() {
        graph.solve(&setting, || false);
    }
}
