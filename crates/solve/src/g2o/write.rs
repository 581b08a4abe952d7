//! A graph to g2o text.

use super::read::{G2o, Graph, Named};
use super::record::Record;
use std::fmt::Write;

/// The text of a graph: vertices, fixed ones, edges. Numbers keep every digit; what was not read is not written.
pub fn write(file: &G2o) -> String {
    match &file.graph {
        Graph::Plane(named) => lines(named),
        Graph::Space(named) => lines(named),
    }
}

fn lines<G: Record<D>, const D: usize>(named: &Named<G, D>) -> String {
    let (ids, graph) = (&named.ids, &named.graph);
    let mut text = String::new();
    // Writing to a string does not fail.
    for (id, value) in ids.iter().zip(graph.values()) {
        let _ = writeln!(text, "{} {id}{}", G::VERTEX, joined(value.numbers()));
    }
    for (id, _) in ids.iter().zip(graph.fixed()).filter(|(_, fixed)| **fixed) {
        let _ = writeln!(text, "FIX {id}");
    }
    for e in graph.edges() {
        let information = (0..D).flat_map(|r| (r..D).map(move |c| e.information[(r, c)]));
        let numbers = e.a_from_b.numbers().into_iter().chain(information);
        let _ = writeln!(text, "{} {} {}{}", G::EDGE, ids[e.a], ids[e.b], joined(numbers));
    }
    text
}

fn joined(numbers: impl IntoIterator<Item = f64>) -> String {
    numbers.into_iter().fold(String::new(), |mut text, v| {
        let _ = write!(text, " {v}");
        text
    })
}
