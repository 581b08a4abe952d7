//! Pairwise consistency of loop closures between two robots.
//!
//! Two loops and the two routes between their ends form a cycle; if both loops are right, the transform around the
//! cycle is the identity within its covariance. Source: Mangelson, Dominic, Eustice, Vasudevan, "Pairwise consistent
//! measurement set maximization for robust multi-robot map merging" (2018), equations 5 to 8.

use crate::graphs::Measurement;
use crate::joint::{Team, Teammate};
use crate::{LoopId, PoseId, RobotId};
use cairn_geometry::LieGroup;
use cairn_solve::Loss;
use cairn_solve::graph::{GraphConfig, Metric, PoseGraph};
use nalgebra::{DMatrix, SMatrix};
use std::collections::{BTreeMap, BTreeSet};

/// The loops between two robots, and the pairwise disagreement of these loops.
#[derive(Clone, Debug)]
pub struct LoopGroup {
    /// The loops, in rising order.
    pub loops: Vec<LoopId>,
    /// Squared Mahalanobis distance of loops `a > b`, at `a (a - 1) / 2 + b`; infinite where it cannot be computed.
    pub distances: Vec<f64>,
}

impl LoopGroup {
    /// The distance of two loops.
    pub fn distance(&self, a: usize, b: usize) -> f64 {
        let (a, b) = (a.max(b), a.min(b));
        self.distances[a * (a - 1) / 2 + b]
    }
}

/// One robot alone: the poses at the ends of loops, estimated from its own measurements only, with their covariance.
struct Alone<G, const D: usize> {
    places: BTreeMap<PoseId, usize>,
    poses: Vec<G>,
    components: Vec<usize>,
    covariance: DMatrix<f64>,
}

impl<G: LieGroup<D>, const D: usize> Alone<G, D> {
    fn new(known: &Teammate<G, D>, touched: &BTreeSet<PoseId>) -> Option<Self> {
        let ids = &known.shared.ids;
        let mut graph = PoseGraph::new();
        for pose in &known.located.poses {
            graph.add_vertex(*pose, false);
        }
        for part in &known.located.parts {
            graph.add_condensed(part.clone()).ok()?;
        }
        for m in &known.shared.inner {
            let (a, b) = (ids.binary_search(&m.a).ok()?, ids.binary_search(&m.b).ok()?);
            graph.add_edge(a, b, m.a_from_b, &m.information, Loss::Squared).ok()?;
        }
        graph.solve(&GraphConfig::default(), || false);
        let vertices: Vec<usize> = touched.iter().filter_map(|id| ids.binary_search(id).ok()).collect();
        let components = graph.components();
        Some(Self {
            places: vertices.iter().enumerate().map(|(k, v)| (ids[*v], k)).collect(),
            poses: vertices.iter().map(|v| graph.values()[*v]).collect(),
            components: vertices.iter().map(|v| components[*v]).collect(),
            covariance: graph.covariance(&vertices, Metric::Geodesic).ok()?,
        })
    }

    /// `a_from_b` of two poses and its covariance; `None` where they are not connected.
    fn between(&self, a: PoseId, b: PoseId) -> Option<(G, SMatrix<f64, D, D>)> {
        let (a, b) = (*self.places.get(&a)?, *self.places.get(&b)?);
        if self.components[a] != self.components[b] {
            return None;
        }
        let a_from_b = self.poses[a].inverse().compose(&self.poses[b]);
        // The error depends on `b` directly, and on `a` through the adjoint with the opposite sign.
        let across = -a_from_b.inverse().adjoint();
        let block = |r: usize, c: usize| self.covariance.fixed_view::<D, D>(r * D, c * D).into_owned();
        let mixed = across * block(a, b);
        let covariance = across * block(a, a) * across.transpose() + mixed + mixed.transpose() + block(b, b);
        Some((a_from_b, covariance))
    }
}

/// A loop in the direction from the robot with the smaller id.
struct Seen<G, const D: usize> {
    id: LoopId,
    a_from_b: G,
    covariance: SMatrix<f64, D, D>,
}

impl<G: LieGroup<D>, const D: usize> Seen<G, D> {
    fn new(m: &Measurement<G, D>) -> Option<Self> {
        let covariance = m.information.cholesky()?.inverse();
        if m.a < m.b {
            return Some(Self { id: m.ends(), a_from_b: m.a_from_b, covariance });
        }
        let adjoint = m.a_from_b.adjoint();
        let covariance = adjoint * covariance * adjoint.transpose();
        Some(Self { id: m.ends(), a_from_b: m.a_from_b.inverse(), covariance })
    }
}

/// All loops between robots of a team, grouped by pairs of robots, with their consistency.
pub fn groups<G: LieGroup<D>, const D: usize>(
    team: &Team<G, D>,
    loops: &BTreeMap<LoopId, Measurement<G, D>>,
) -> Vec<LoopGroup> {
    let touched: BTreeSet<PoseId> = loops.keys().flat_map(|(a, b)| [*a, *b]).collect();
    let alone: BTreeMap<RobotId, Alone<G, D>> =
        team.iter().filter_map(|(id, known)| Some((*id, Alone::new(known, &touched)?))).collect();
    let mut by_pair: BTreeMap<(RobotId, RobotId), Vec<&Measurement<G, D>>> = BTreeMap::new();
    for ((a, b), m) in loops {
        by_pair.entry((a.robot, b.robot)).or_default().push(m);
    }
    let group = |((first, second), loops): (&(RobotId, RobotId), &Vec<&Measurement<G, D>>)| {
        let seen: Vec<Option<Seen<G, D>>> = loops.iter().map(|m| Seen::new(m)).collect();
        let ways = alone.get(first).zip(alone.get(second));
        let mut distances = Vec::with_capacity(loops.len() * loops.len() / 2);
        for k in 0..loops.len() {
            for l in 0..k {
                let far = || {
                    let (one, two) = (seen[k].as_ref()?, seen[l].as_ref()?);
                    let (first, second) = ways?;
                    distance(one, two, first, second)
                };
                distances.push(far().filter(|d| d.is_finite()).unwrap_or(f64::INFINITY));
            }
        }
        LoopGroup { loops: loops.iter().map(|m| m.ends()).collect(), distances }
    };
    by_pair.iter().map(group).collect()
}

/// Squared Mahalanobis distance of the transform around the cycle of both loops from the identity.
fn distance<G: LieGroup<D>, const D: usize>(
    one: &Seen<G, D>,
    two: &Seen<G, D>,
    first: &Alone<G, D>,
    second: &Alone<G, D>,
) -> Option<f64> {
    let (there, there_covariance) = first.between(one.id.0, two.id.0)?;
    let (back, back_covariance) = second.between(two.id.1, one.id.1)?;
    let rest = two.a_from_b.compose(&back);
    let around = one.a_from_b.inverse().compose(&there).compose(&rest);
    // Each error is transported to the end of the cycle.
    let moved = |by: G, covariance: &SMatrix<f64, D, D>| {
        let adjoint = by.inverse().adjoint();
        adjoint * covariance * adjoint.transpose()
    };
    let covariance = moved(around, &one.covariance)
        + moved(rest, &there_covariance)
        + moved(back, &two.covariance)
        + back_covariance;
    let error = around.coordinates();
    Some(error.dot(&covariance.cholesky()?.solve(&error)))
}
