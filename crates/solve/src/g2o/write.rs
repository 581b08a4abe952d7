//! A graph to g2o text.

use super::content::{G2o, Graph, Named};
use super::record::Record;
use std::fmt::Write;

/// The text of a graph: vertices, fixed ones, edges. Numbers keep every digit. Lines of points that were seen, of what is
/// known in the world and of unknown tags are as they were read.
pub fn write(file: &G2o) -> String {
    let mut text = match &file.graph {
        Graph::Plane(named) => lines(named),
        Graph::Space(named) => lines(named),
    };
    for line in &file.kept {
        text.push_str(line);
        text.push('\n');
    }
    text
}

fn lines<G: Record<D>, const D: usize>(named: &Named<G, D>) -> String {
    let (ids, graph) = (&named.ids, &named.graph);
    let mut text = String::new();
    // Writing to a string does not fail.
    for (id, value) in ids.iter().zip(graph.values()) {
        let (tag, n) = if named.points.contains(id) { (G::POINT, G::N) } else { (G::VERTEX, usize::MAX) };
        let _ = writeln!(text, "{tag} {id}{}", joined(value.numbers().into_iter().take(n)));
    }
    for (id, _) in ids.iter().zip(graph.fixed()).filter(|(_, fixed)| **fixed) {
        let _ = writeln!(text, "FIX {id}");
    }
    for e in graph.edges().iter().take(named.relative) {
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
