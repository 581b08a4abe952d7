//! A start from the measurements alone: poses chained along the edges.

use super::{Edge, PoseGraph};
use cairn_geometry::LieGroup;
use std::collections::VecDeque;

/// Sets every vertex that is not held by chaining measurements from the held ones: along edges between neighbours in
/// index first (the odometry), then breadth first along the other edges, and at last from poses to the points that they saw.
pub fn odometry_start<G: LieGroup<D>, const D: usize>(graph: &mut PoseGraph<G, D>) {
    let n = graph.values.len();
    let mut known = graph.held();
    let mut next: Vec<Vec<usize>> = vec![Vec::new(); n];
    let stars = graph.condensed.iter().flat_map(|c| c.star());
    let edges: Vec<Edge<G, D>> = graph.edges.iter().copied().chain(stars).collect();
    for (k, e) in edges.iter().enumerate() {
        next[e.a].push(k);
        next[e.b].push(k);
    }
    // Which edges lead on: those between neighbours, then every one that measures a whole pose, then those to positions.
    let leads = |stage: usize, from: usize, e: &Edge<G, D>| match stage {
        0 => e.a.abs_diff(e.b) == 1 && !e.is_position(),
        1 => !e.is_position(),
        _ => e.a == from,
    };
    // Vertices with known value, the chain of odometry ahead of everything else.
    let mut queues: [VecDeque<usize>; 3] =
        [(0..n).filter(|i| known[*i]).collect(), VecDeque::new(), VecDeque::new()];
    while let Some(stage) = queues.iter().position(|q| !q.is_empty()) {
        let Some(from) = queues[stage].pop_front() else { continue };
        for &k in &next[from] {
            let e = &edges[k];
            let to = if e.a == from { e.b } else { e.a };
            if known[to] || !leads(stage, from, e) {
                continue;
            }
            known[to] = true;
            graph.values[to] = if e.a == from {
                graph.values[from].compose(&e.a_from_b)
            } else {
                graph.values[from].compose(&e.a_from_b.inverse())
            };
            queues[0].push_front(to);
        }
        if let Some(later) = queues.get_mut(stage + 1) {
            later.push_back(from);
        }
    }
}
