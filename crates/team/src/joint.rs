//! The joint graph that every robot solves by itself: the shared poses of all known robots, their condensed graphs, and
//! the loops between them.

use crate::digest::{Located, SharedGraph};
use crate::graphs::Measurement;
use crate::{LoopId, PoseId, RobotId};
use cairn_geometry::LieGroup;
use cairn_solve::Loss;
use cairn_solve::graph::{GraphConfig, Metric, PoseGraph, Rigid, lowest_start};
use std::collections::BTreeMap;

/// What is known about a robot.
#[derive(Clone, Debug)]
pub struct Teammate<G, const D: usize> {
    /// What it shares.
    pub shared: SharedGraph<G, D>,
    /// Its last estimate.
    pub located: Located<G, D>,
}

/// What is known about all robots of a team.
pub type Team<G, const D: usize> = BTreeMap<RobotId, Teammate<G, D>>;

/// The joint graph of the shared poses of a team.
#[derive(Clone, Debug)]
pub struct Joint<G, const D: usize> {
    /// The poses in rising order; they are the vertices of the graph.
    pub ids: Vec<PoseId>,
    /// The graph, without the loops that were left out.
    pub graph: PoseGraph<G, D>,
    /// The loops in the graph.
    pub loops: Vec<LoopId>,
}

/// Every loop between two robots whose ends are both known, once: if both robots have it, that of the robot with the
/// smaller id is used.
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
    /// The joint graph of these robots with the loops that `accepts` returns true for. Poses start at their values in
    /// `from`; others start at the estimate of their robot, transformed to fit the robot's poses in `from`. The first
    /// pose of the first robot is fixed. Also returns whether `from` has no pose of some robot.
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
                // It was checked when the message was read.
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

    /// Solves the graph. If it has robots that the last one did not have, it first looks for the start of lowest cost.
    pub fn solve(&mut self, is_new: bool) {
        if is_new {
            lowest_start(&mut self.graph, true, Metric::Geodesic);
        }
        let config = GraphConfig { tolerance: 1e-12, iterations: 50, ..GraphConfig::default() };
        self.graph.solve(&config, || false);
    }

    /// The estimated poses.
    pub fn poses(&self) -> BTreeMap<PoseId, G> {
        self.ids.iter().copied().zip(self.graph.values().iter().copied()).collect()
    }
}
