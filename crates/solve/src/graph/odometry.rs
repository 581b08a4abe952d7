//! A start from the measurements alone: poses chained along the edges.

use super::{Edge, PoseGraph};
use cairn_geometry::LieGroup;
use std::collections::VecDeque;

/// Sets every vertex that is not held by chaining measurements from the held ones: along edges between neighbours in
/// index first (the odometry), then breadth first along the other edges.
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
    let is_odometry = |e: &Edge<G, D>| e.a.abs_diff(e.b) == 1;
    // Vertices with known value, the chain of odometry ahead of everything else.
    let mut queue: VecDeque<(usize, bool)> = (0..n).filter(|i| known[*i]).map(|i| (i, false)).collect();
    while let Some((from, all)) = queue.pop_front() {
        for &k in &next[from] {
            let e = &edges[k];
            let to = if e.a == from { e.b } else { e.a };
            if known[to] || !(all || is_odometry(e)) {
                continue;
            }
            known[to] = true;
            graph.values[to] = if e.a == from {
                graph.values[from].compose(&e.a_from_b)
            } else {
                graph.values[from].compose(&e.a_from_b.inverse())
            };
            queue.push_front((to, false));
        }
        if !all {
            queue.push_back((from, true));
        }
    }
}
