//! The small graph that every robot solves by itself: the shared poses of all robots it has heard of, their condensed graphs,
//! and the loops between them.

use crate::digest::{Located, SharedGraph};
use crate::graphs::Measurement;
use crate::{LoopId, PoseId, RobotId};
use cairn_geometry::LieGroup;
use cairn_solve::Loss;
use cairn_solve::graph::{GraphConfig, Metric, PoseGraph, Rigid, lowest_start};
use std::collections::BTreeMap;

/// What is known of a robot.
#[derive(Clone, Debug)]
pub struct Known<G, const D: usize> {
    /// What it shares.
    pub shared: SharedGraph<G, D>,
    /// Where it was when it last said so.
    pub located: Located<G, D>,
}

/// All that is known of a team.
pub type Team<G, const D: usize> = BTreeMap<RobotId, Known<G, D>>;

/// The shared poses of a team with what is known about them.
#[derive(Clone, Debug)]
pub struct Joint<G, const D: usize> {
    /// The poses, rising; the vertices of the graph.
    pub ids: Vec<PoseId>,
    /// The graph, without loops that were left out.
    pub graph: PoseGraph<G, D>,
    /// The loops that it has.
    pub loops: Vec<LoopId>,
}

/// Every loop between two robots that is known with both ends, once: of the same one closed twice, that of the robot with the
/// smaller id counts.
pub fn loops<G: LieGroup<D>, const D: usize>(team: &Team<G, D>) -> BTreeMap<LoopId, Measurement<G, D>> {
    let mut all: BTreeMap<LoopId, Measurement<G, D>> = BTreeMap::new();
    let is_known =
        |id: PoseId| team.get(&id.robot).is_some_and(|known| known.shared.ids.binary_search(&id).is_ok());
    for m in team.values().flat_map(|known| &known.shared.loops) {
        if is_known(m.a) && is_known(m.b) {
            all.entry(m.ends()).or_insert_with(|| m.clone());
        }
    }
    all
}

impl<G: Rigid<D>, const D: usize> Joint<G, D> {
    /// The graph of these robots with the loops that `accepts` lets pass. Poses start where `from` has them, others where their
    /// robot says it is, moved along with what `from` has of it. The first pose of the first robot is held. Returns also
    /// whether `from` lacks a robot altogether.
    pub fn new(
        team: &Team<G, D>,
        loops: &BTreeMap<LoopId, Measurement<G, D>>,
        accepts: impl Fn(&LoopId) -> bool,
        from: &BTreeMap<PoseId, G>,
    ) -> (Self, bool) {
        let mut joint = Self { ids: Vec::new(), graph: PoseGraph::new(), loops: Vec::new() };
        let mut has_new = false;
        for known in team.values() {
            let first = joint.ids.len();
            let (ids, poses) = (&known.shared.ids, &known.located.poses);
            let moved = ids.iter().zip(poses).find_map(|(id, p)| Some(from.get(id)?.compose(&p.inverse())));
            has_new |= moved.is_none() && !ids.is_empty();
            for (id, pose) in ids.iter().zip(poses) {
                let is_first = joint.ids.is_empty();
                let start = match (is_first, from.get(id), &moved) {
                    (false, Some(known), _) => *known,
                    (false, None, Some(moved)) => moved.compose(pose),
                    _ => *pose,
                };
                joint.ids.push(*id);
                joint.graph.add_vertex(start, is_first);
            }
            let to: Vec<usize> = (first..joint.ids.len()).collect();
            for part in &known.located.parts {
                // Checked when the message was read.
                let _ = joint.graph.add_condensed(part.clone().renamed(&to));
            }
            for m in &known.shared.inner {
                joint.add(m);
            }
        }
        for (id, m) in loops.iter().filter(|(id, _)| accepts(id)) {
            if joint.add(m).is_some() {
                joint.loops.push(*id);
            }
        }
        (joint, has_new)
    }

    fn add(&mut self, m: &Measurement<G, D>) -> Option<usize> {
        let find = |id| self.ids.binary_search(&id).ok();
        let (a, b) = (find(m.a)?, find(m.b)?);
        self.graph.add_edge(a, b, m.a_from_b, &m.information, Loss::Squared).ok()
    }

    /// Solves it; a graph with robots that were not in the last one starts anew where the cost is least.
    pub fn solve(&mut self, is_new: bool) {
        if is_new {
            lowest_start(&mut self.graph, true, Metric::Geodesic);
        }
        let config = GraphConfig { tolerance: 1e-12, iterations: 50, ..GraphConfig::default() };
        self.graph.solve(&config, || false);
    }

    /// Where its poses are.
    pub fn poses(&self) -> BTreeMap<PoseId, G> {
        self.ids.iter().copied().zip(self.graph.values().iter().copied()).collect()
    }
}
