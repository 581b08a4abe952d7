//! A whole team in one process over a simulated network, exchange by exchange, with its cost and accuracy.

use crate::graphs::{CentralGraph, RobotGraph};
use crate::judge::JudgeConfig;
use crate::network::{Network, NetworkConfig};
use crate::robot::{Robot, RobotError};
use crate::{LoopId, PoseId, RobotId};
use cairn_solve::graph::{Certificate, GraphConfig, Metric, PoseGraph, Rigid, certify, lowest_start};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Cost of one exchange.
#[derive(Clone, Debug, PartialEq)]
pub struct Round {
    /// Bytes of each robot's message, in the order of the team.
    pub sent: Vec<usize>,
    /// Bytes that arrived at each robot.
    pub received: Vec<usize>,
    /// Messages that were refused: late ones and duplicates.
    pub refused: usize,
    /// CPU time of each robot, s.
    pub cpu_s: Vec<f64>,
}

/// A team over a network.
#[derive(Debug)]
pub struct Exchange<G, const D: usize> {
    robots: Vec<Robot<G, D>>,
    central: CentralGraph<G, D>,
    network: Network,
    gone: Vec<bool>,
    history: Vec<Vec<G>>,
}

impl<G: Rigid<D>, const D: usize> Exchange<G, D> {
    /// A team whose robots know only their own graphs. Without `judge`, they accept every loop.
    ///
    /// # Errors
    /// When the graphs do not form a team.
    pub fn new(
        team: &[RobotGraph<G, D>],
        network: NetworkConfig,
        judge: Option<JudgeConfig>,
    ) -> Result<Self, RobotError> {
        let central = CentralGraph::new(team)?;
        let robots = team.iter().map(|own| Robot::new(own, judge)).collect::<Result<Vec<_>, _>>()?;
        let gone = vec![false; robots.len()];
        Ok(Self { robots, central, network: Network::new(network), gone, history: Vec::new() })
    }

    /// The robots.
    pub fn robots(&self) -> &[Robot<G, D>] {
        &self.robots
    }

    /// All graphs combined into one.
    pub fn central_graph(&self) -> &CentralGraph<G, D> {
        &self.central
    }

    /// A robot leaves the team: it no longer sends, receives or computes.
    pub fn leave(&mut self, robot: RobotId) {
        self.set_gone(robot, true);
    }

    /// A robot returns, with its knowledge from before.
    pub fn come_back(&mut self, robot: RobotId) {
        self.set_gone(robot, false);
    }

    fn set_gone(&mut self, robot: RobotId, gone: bool) {
        if let Some(k) = self.robots.iter().position(|r| r.id() == robot) {
            self.gone[k] = gone;
        }
    }

    /// One exchange: every robot sends, receives what arrives, and computes one step.
    ///
    /// # Errors
    /// When a robot cannot continue.
    pub fn round(&mut self, mut clock: impl FnMut() -> f64) -> Result<Round, RobotError> {
        let n = self.robots.len();
        let mut round = Round { sent: vec![0; n], received: vec![0; n], refused: 0, cpu_s: vec![0.0; n] };
        for k in (0..n).filter(|k| !self.gone[*k]) {
            let began = clock();
            let bytes = Arc::new(self.robots[k].message()?);
            round.cpu_s[k] += clock() - began;
            round.sent[k] = bytes.len();
            let from = self.robots[k].id();
            for other in self.robots.iter().filter(|r| r.id() != from) {
                self.network.send(from, other.id(), &bytes);
            }
        }
        let places: BTreeMap<RobotId, usize> =
            self.robots.iter().enumerate().map(|(k, r)| (r.id(), k)).collect();
        for packet in self.network.deliver() {
            let Some(&k) = places.get(&packet.to).filter(|k| !self.gone[**k]) else { continue };
            let began = clock();
            let result = self.robots[k].receive(packet.from, &packet.bytes);
            round.cpu_s[k] += clock() - began;
            round.received[k] += packet.bytes.len();
            round.refused += usize::from(result.is_err());
        }
        for k in (0..n).filter(|k| !self.gone[*k]) {
            let began = clock();
            self.robots[k].step()?;
            round.cpu_s[k] += clock() - began;
        }
        self.history.push(self.poses());
        Ok(round)
    }

    /// The own poses of each robot as it estimates them; in the order of [`CentralGraph::ids`].
    pub fn poses(&self) -> Vec<G> {
        let poses: BTreeMap<PoseId, &G> = self.robots.iter().flat_map(|r| r.own_poses()).collect();
        self.central.ids.iter().filter_map(|id| poses.get(id).map(|p| **p)).collect()
    }

    /// The poses after each exchange.
    pub fn history(&self) -> &[Vec<G>] {
        &self.history
    }

    /// Rejected loops; the robot with the smaller id decides for each.
    pub fn rejected(&self) -> BTreeSet<LoopId> {
        let rejects = |id: &LoopId| self.robots.iter().any(|r| r.id() == id.0.robot && r.rejects(id));
        self.central.loops.iter().flatten().filter(|id| rejects(id)).copied().collect()
    }
}

impl<G: Rigid<D>, const D: usize> CentralGraph<G, D> {
    /// The graph without some loops, with its vertices at these poses.
    ///
    /// # Panics
    /// When the number of poses is not the number of vertices.
    pub fn at(&self, poses: &[G], without: &BTreeSet<LoopId>) -> PoseGraph<G, D> {
        let mut graph = PoseGraph::new();
        for pose in poses {
            graph.add_vertex(*pose, false);
        }
        assert_eq!(poses.len(), self.ids.len(), "a pose for each vertex");
        for (e, id) in self.graph.edges().iter().zip(&self.loops) {
            if !id.is_some_and(|id| without.contains(&id)) {
                // The edge was accepted before, so it is valid.
                let _ = graph.add_edge(e.a, e.b, e.a_from_b, &e.information, e.loss);
            }
        }
        graph
    }

    /// Sum of the squared whitened residuals of all measurements, except some loops.
    ///
    /// # Panics
    /// When the number of poses is not the number of vertices.
    pub fn chi2(&self, poses: &[G], without: &BTreeSet<LoopId>) -> f64 {
        2.0 * self.at(poses, without).cost(Metric::Geodesic)
    }

    /// The optimum without some loops, found by one central solver with all measurements: the reference for comparison.
    /// Its chi2 is [`CentralGraph::chi2`] at its values.
    pub fn optimum(&self, without: &BTreeSet<LoopId>) -> PoseGraph<G, D> {
        let mut graph = self.at(self.graph.values(), without);
        lowest_start(&mut graph, true, Metric::Geodesic);
        let config = GraphConfig { tolerance: 1e-12, ..GraphConfig::default() };
        graph.solve(&config, || false);
        graph
    }

    /// Upper bound of the gap between the optimum reached from these poses and the global one: the SE-Sync objective of
    /// the measurements (except some loops), minimised from the poses, with its lower bound. That objective weights
    /// measurements isotropically and measures rotations by chordal distance, so about the poses themselves it only
    /// says which basin of attraction they are in. `None` where no bound is found.
    ///
    /// # Panics
    /// When the number of poses is not the number of vertices.
    pub fn certificate(&self, poses: &[G], without: &BTreeSet<LoopId>) -> Option<Certificate> {
        let mut graph = self.at(poses, without);
        for e in graph.edges_mut() {
            e.information = G::isotropic(&e.information);
        }
        let config = GraphConfig { metric: Metric::Chordal, tolerance: 1e-14, ..GraphConfig::default() };
        graph.solve(&config, || false);
        certify(&graph)
    }
}
