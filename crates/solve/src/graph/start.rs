//! Which start a graph is solved from: of the values it has, odometry and the chordal relaxation the one of least cost.

use super::{Metric, PoseGraph, Rigid, chordal_start, odometry_start};

/// Where the poses of a graph start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At the values that the graph has.
    Values,
    /// Chained along the measurements ([`odometry_start`]).
    Odometry,
    /// At the chordal relaxation ([`chordal_start`]).
    Chordal,
}

/// A start and the cost there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartCost {
    /// The start.
    pub start: Start,
    /// Half the sum of the losses there.
    pub cost: f64,
}

/// Moves the graph to the start of least cost, of equal ones the first; `has_values` says whether the graph's own values
/// are one of them. Returns every start that there is, the chosen one first, the others by rising cost. There is no chordal
/// start where the edges do not determine every pose.
pub fn lowest_start<G: Rigid<D>, const D: usize>(
    graph: &mut PoseGraph<G, D>,
    has_values: bool,
    metric: Metric,
) -> Vec<StartCost> {
    let mut starts = Vec::new();
    if has_values {
        starts.push((Start::Values, graph.clone()));
    }
    let mut odometry = graph.clone();
    odometry_start(&mut odometry);
    starts.push((Start::Odometry, odometry));
    let mut chordal = graph.clone();
    if chordal_start(&mut chordal).is_ok() {
        starts.push((Start::Chordal, chordal));
    }
    let mut costs: Vec<(StartCost, PoseGraph<G, D>)> = starts
        .into_iter()
        .map(|(start, graph)| (StartCost { start, cost: graph.cost(metric) }, graph))
        .collect();
    // NaN, of whatever sign, is worse than any cost.
    let rank = |cost: f64| if cost.is_nan() { f64::INFINITY } else { cost };
    costs.sort_by(|a, b| rank(a.0.cost).total_cmp(&rank(b.0.cost)));
    if let Some((_, best)) = costs.first() {
        graph.values.copy_from_slice(&best.values);
    }
    costs.into_iter().map(|(cost, _)| cost).collect()
}
