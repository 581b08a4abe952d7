//! One robot of a team: its own graph, the messages it received, and the distributed optimisation step.
//!
//! Nonlinear least squares with elimination of the variables that only one robot has (variable projection; Golub and
//! Pereyra, 1973): each robot condenses its own graph to the poses it shares and sends the result ([`crate::Message`]);
//! every robot solves the graph of all shared poses ([`crate::Joint`]), takes its own shared poses from it, optimises
//! the rest of its graph with these fixed, and condenses again. When all robots have received all messages and nothing
//! changes any more, the gradient of the whole graph is zero. There is no coordinator. For a robot that sends no new
//! messages, its last condensed graph stays in use; it does not depend on the frame it was made in.

use crate::digest::{
    Located, SharedGraph, decode_estimate, decode_shared, encode_part, encode_poses, encode_shared,
};
use crate::envelope::Refused;
use crate::graphs::{GraphsError, Measurement, RobotGraph};
use crate::joint::{Joint, Team, Teammate, loops};
use crate::judge::{JudgeConfig, Judgement, judge};
use crate::keep::choose;
use crate::message::{Estimate, Message, Shared};
use crate::{LoopId, MAX_ROBOTS, PoseId, RobotId};
use cairn_solve::Loss;
use cairn_solve::graph::{CondenseError, Edge, GraphConfig, Metric, PoseGraph, Rigid, lowest_start};
use std::collections::{BTreeMap, BTreeSet};

/// Why a robot cannot continue.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RobotError {
    /// Its graph is invalid.
    #[error(transparent)]
    Graph(#[from] GraphsError),
    /// Its measurements do not determine its poses.
    #[error(transparent)]
    Condense(#[from] CondenseError),
    /// What it shares does not fit into a message.
    #[error("robot {0} shares too much for one message")]
    TooMuch(RobotId),
}

/// What was received from another robot.
#[derive(Clone, Debug, Default)]
struct Heard {
    /// Number of the newest message.
    number: u32,
    /// The epoch of the newest message.
    epoch: u32,
    /// The epoch of the stored [`Shared`].
    known_epoch: u32,
    /// What the robot shares, as received.
    shared: Option<Shared>,
    /// Loops of its own that it rejects, by index; `None` if it has not judged them yet.
    rejected: Option<Vec<u32>>,
}

impl Heard {
    /// Whether what the robot shares is missing or outdated.
    fn is_missing(&self) -> bool {
        self.shared.is_none() || self.known_epoch != self.epoch
    }
}

/// One robot of a team.
#[derive(Clone, Debug)]
pub struct Robot<G, const D: usize> {
    id: RobotId,
    /// Numbers of its poses, in rising order.
    seqs: Vec<u32>,
    /// Its own graph: its poses, and the measurements between them.
    graph: PoseGraph<G, D>,
    /// All known loops from its own poses to others.
    loops: BTreeMap<LoopId, Measurement<G, D>>,
    keep: Vec<bool>,
    number: u32,
    epoch: u32,
    /// Whether the next message includes what is shared.
    says_shared: bool,
    own: (Shared, Estimate),
    heard: BTreeMap<RobotId, Heard>,
    team: Team<G, D>,
    /// Configuration of the outlier rejection; if `None`, all loops are accepted.
    judge: Option<JudgeConfig>,
    judgement: Judgement,
    /// Epochs of all robots when the loops were last judged.
    judged: BTreeMap<RobotId, u32>,
    /// Its estimate of all shared poses.
    poses: BTreeMap<PoseId, G>,
}

impl<G: Rigid<D>, const D: usize> Robot<G, D> {
    /// A robot without messages from others; it solves its own graph first. Without `judge`, it accepts every loop.
    ///
    /// # Errors
    /// When the graph is invalid, or does not determine its poses.
    pub fn new(own: &RobotGraph<G, D>, judge: Option<JudgeConfig>) -> Result<Self, RobotError> {
        let seqs: Vec<u32> = own.poses.keys().copied().collect();
        let mut graph = PoseGraph::new();
        for pose in own.poses.values() {
            graph.add_vertex(*pose, false);
        }
        let mut loops: BTreeMap<LoopId, Measurement<G, D>> = BTreeMap::new();
        for m in &own.measurements {
            if m.a.robot != own.robot && m.b.robot != own.robot {
                return Err(GraphsError::Foreign { robot: own.robot, ends: (m.a, m.b) }.into());
            }
            if m.a.robot != m.b.robot {
                let end = if m.a.robot == own.robot { m.a } else { m.b };
                seqs.binary_search(&end.seq).map_err(|_| GraphsError::NoPose(end))?;
                loops.entry(m.ends()).or_insert_with(|| m.clone());
                continue;
            }
            let find = |id: PoseId| seqs.binary_search(&id.seq).map_err(|_| GraphsError::NoPose(id));
            graph
                .add_edge(find(m.a)?, find(m.b)?, m.a_from_b, &m.information, Loss::Squared)
                .map_err(GraphsError::from)?;
        }
        lowest_start(&mut graph, true, Metric::Geodesic);
        graph.solve(&local(), || false);
        let mut robot = Self {
            id: own.robot,
            keep: vec![false; seqs.len()],
            seqs,
            graph,
            loops,
            number: 0,
            epoch: 0,
            says_shared: true,
            own: Default::default(),
            heard: BTreeMap::new(),
            team: BTreeMap::new(),
            judge,
            judgement: Judgement::default(),
            judged: BTreeMap::new(),
            poses: BTreeMap::new(),
        };
        robot.choose_shared();
        robot.condense()?;
        Ok(robot)
    }

    /// Adds loops from its own poses to others, found after it began; one between the same two poses is replaced. Returns how many
    /// there are of it now.
    ///
    /// # Errors
    /// When one has no end on its own poses, or its graph cannot be condensed; nothing has changed in the first case.
    pub fn add_loops(&mut self, loops: Vec<Measurement<G, D>>) -> Result<usize, RobotError> {
        for m in &loops {
            let own = m.own_end(self.id).map(|(own, _)| own);
            let own = own.ok_or(GraphsError::Foreign { robot: self.id, ends: m.ends() })?;
            self.seqs.binary_search(&own.seq).map_err(|_| GraphsError::NoPose(own))?;
        }
        if !loops.is_empty() {
            self.loops.extend(loops.into_iter().map(|m| (m.ends(), m)));
            self.choose_shared();
            self.condense()?;
        }
        Ok(self.loops.len())
    }

    /// Its loops to others, its own and those that others reported.
    pub fn loops(&self) -> impl Iterator<Item = &Measurement<G, D>> {
        self.loops.values()
    }

    /// Numbers its messages and epochs from here on: above all that it sent before it was started again, or others take its messages
    /// for old ones.
    #[must_use]
    pub fn starting_at(self, number: u32) -> Self {
        Self { number, epoch: self.epoch.saturating_add(number), ..self }
    }

    /// Its id.
    pub fn id(&self) -> RobotId {
        self.id
    }

    /// Its estimate of its own poses, by number.
    pub fn own_poses(&self) -> impl Iterator<Item = (PoseId, &G)> {
        let id = |seq: &u32| PoseId { robot: self.id, seq: *seq };
        self.seqs.iter().map(id).zip(self.graph.values())
    }

    /// Robots that it knows, including itself.
    pub fn known(&self) -> impl Iterator<Item = RobotId> {
        self.team.keys().copied()
    }

    /// Number of poses that it shares.
    pub fn shares(&self) -> usize {
        self.own.0.poses()
    }

    /// The next message, for all other robots.
    ///
    /// # Errors
    /// When it would be too long.
    pub fn message(&mut self) -> Result<Vec<u8>, RobotError> {
        let says_shared = std::mem::take(&mut self.says_shared);
        self.next_message(says_shared).encode().ok_or(RobotError::TooMuch(self.id))
    }

    /// The next message with all that it shares, for a channel on which only the newest one counts, and the lengths of its pieces
    /// ([`Message::encode_pieces`]).
    ///
    /// # Errors
    /// When it would be too long.
    pub fn whole_message(&mut self) -> Result<(Vec<u8>, [usize; 3]), RobotError> {
        self.next_message(true).encode_pieces().ok_or(RobotError::TooMuch(self.id))
    }

    fn next_message(&mut self, says_shared: bool) -> Message {
        self.number = self.number.saturating_add(1);
        Message {
            dimension: D as u8,
            robot: self.id,
            number: self.number,
            epoch: self.epoch,
            requests: self.missing(),
            shared: says_shared.then(|| self.own.0.clone()),
            estimate: self.own.1.clone(),
            rejected: self.rejected(),
        }
    }

    /// Robots whose [`Shared`] is missing or outdated here.
    fn missing(&self) -> Vec<RobotId> {
        self.heard.iter().filter_map(|(id, h)| h.is_missing().then_some(*id)).collect()
    }

    /// Processes a message. `from` is the sender according to the network, which must authenticate it.
    ///
    /// # Errors
    /// When the message is refused; nothing is changed then.
    pub fn receive(&mut self, from: RobotId, bytes: &[u8]) -> Result<(), Refused> {
        let message = Message::decode(bytes)?;
        if message.robot == self.id {
            return Err(Refused::OwnId);
        }
        if message.robot != from {
            return Err(Refused::WrongSender { from, claimed: message.robot });
        }
        if usize::from(message.dimension) != D {
            return Err(Refused::Dimension { found: message.dimension, expected: D as u8 });
        }
        let mut heard = self.heard.get(&from).cloned().unwrap_or_default();
        // What is said once may be overtaken by the next message: it still holds as long as its epoch is the newest.
        let is_late = message.number <= heard.number;
        let holds = message.shared.is_some() && message.epoch == heard.epoch && heard.is_missing();
        if is_late && !holds {
            return Err(Refused::Old { robot: from, number: message.number, newest: heard.number });
        }
        if !self.heard.contains_key(&from) && self.heard.len() + 1 >= MAX_ROBOTS {
            return Err(Refused::TooManyRobots);
        }
        if !is_late {
            (heard.number, heard.epoch) = (message.number, message.epoch);
        }
        if let Some(shared) = message.shared {
            let known = SharedGraph::read(from, &shared, &message.estimate)?;
            (heard.known_epoch, heard.shared, heard.rejected) =
                (message.epoch, Some(shared), message.rejected);
            self.team.insert(from, known);
        } else if let (Some(shared), true) = (&heard.shared, heard.known_epoch == heard.epoch) {
            shared.fits(&message.estimate, message.rejected.as_deref(), D)?;
            let Some(known) = self.team.get_mut(&from) else { return Err(Refused::Encoding) };
            known.located = decode_estimate(&message.estimate, &known.shared.parts)?;
            heard.rejected = message.rejected;
        }
        self.says_shared |= message.requests.contains(&self.id);
        self.heard.insert(from, heard);
        Ok(())
    }

    /// Forgets a robot: its messages are no longer used.
    pub fn forget(&mut self, robot: RobotId) {
        if robot != self.id {
            self.team.remove(&robot);
            self.heard.remove(&robot);
            self.poses.retain(|id, _| id.robot != robot);
        }
    }

    /// One optimisation step: solves for all shared poses, takes its own from the result, optimises its other poses
    /// with these fixed, and condenses its graph again.
    ///
    /// # Errors
    /// When its own graph cannot be condensed.
    pub fn step(&mut self) -> Result<(), RobotError> {
        let known = loops(&self.team);
        self.judge(&known);
        let believed = |id: &LoopId| self.believes(id);
        let (mut joint, is_new) = Joint::new(&self.team, &known, believed, &self.poses);
        joint.solve(is_new);
        self.poses = joint.poses();
        self.follow();
        if self.adopt() {
            self.choose_shared();
        }
        self.condense()
    }

    /// Judges the loops again when what robots share has changed.
    fn judge(&mut self, known: &BTreeMap<LoopId, Measurement<G, D>>) {
        let Some(config) = self.judge else { return };
        let mut epochs: BTreeMap<RobotId, u32> =
            self.heard.iter().map(|(id, h)| (*id, h.known_epoch)).collect();
        epochs.insert(self.id, self.epoch);
        if epochs != self.judged {
            self.judgement = judge(&self.team, known, &config);
            self.judged = epochs;
        }
    }

    /// Whether a loop is accepted: as decided by the robot with the smaller id, if that has judged it, else by this
    /// one.
    fn believes(&self, id: &LoopId) -> bool {
        if self.judge.is_none() {
            return true;
        }
        let said = || {
            let heard = self.heard.get(&id.0.robot)?;
            let loops = &self.team.get(&id.0.robot)?.shared.loops;
            let place = loops.iter().position(|m| m.ends() == *id)?;
            Some(!heard.rejected.as_ref()?.contains(&(place as u32)))
        };
        let own = || self.judgement.verdicts.get(id).is_some_and(|v| v.is_accepted());
        said().unwrap_or_else(own)
    }

    /// Increases whenever what it shares changes.
    pub(crate) fn epoch(&self) -> u32 {
        self.epoch
    }

    /// The own loops that it rejects, as indices of what it shares.
    pub(crate) fn rejected(&self) -> Option<Vec<u32>> {
        self.judge.filter(|_| !self.judged.is_empty())?;
        let places = self.loops.keys().enumerate().filter(|(_, id)| self.rejects(id));
        Some(places.map(|(k, _)| k as u32).collect())
    }

    /// Whether it has judged a loop and rejects it.
    pub fn rejects(&self, id: &LoopId) -> bool {
        self.judgement.verdicts.get(id).is_some_and(|v| !v.is_accepted())
    }

    /// Its decisions about every loop whose ends are both known.
    pub fn judgement(&self) -> &Judgement {
        &self.judgement
    }

    /// Adds loops to its own poses that other robots reported; returns true if there are any.
    fn adopt(&mut self) -> bool {
        let before = self.loops.len();
        for m in self.team.values().flat_map(|k| &k.shared.loops) {
            let own = m.own_end(self.id).map(|(own, _)| own.seq);
            if own.is_some_and(|seq| self.seqs.binary_search(&seq).is_ok()) {
                self.loops.entry(m.ends()).or_insert_with(|| m.clone());
            }
        }
        self.loops.len() > before
    }

    /// Chooses again which poses it shares.
    fn choose_shared(&mut self) {
        let ends: BTreeSet<u32> =
            self.loops.values().filter_map(|m| Some(m.own_end(self.id)?.0.seq)).collect();
        let shared: Vec<bool> = self.seqs.iter().map(|seq| ends.contains(seq)).collect();
        let edges: Vec<(usize, usize)> = self.graph.edges().iter().map(|e| (e.a, e.b)).collect();
        let bits = |e: &Edge<G, D>| e.information.iter().map(|v| v.to_bits()).collect::<Vec<u64>>();
        let informations: BTreeSet<Vec<u64>> = self.graph.edges().iter().map(bits).collect();
        self.keep = choose::<D>(&shared, &edges, informations.len());
        if ends.is_empty() {
            self.keep.fill(false);
        }
        self.epoch += 1;
        self.says_shared = true;
    }

    /// Moves its own poses with the shared ones: every other pose moves with the shared pose before it.
    fn follow(&mut self) {
        let moved = |k: usize| {
            let now = self.poses.get(&PoseId { robot: self.id, seq: self.seqs[k] })?;
            Some(now.compose(&self.graph.values()[k].inverse()))
        };
        let moves: Vec<Option<G>> = (0..self.seqs.len()).map(moved).collect();
        let mut last = moves.iter().flatten().next().copied();
        for (value, moved) in self.graph.values_mut().iter_mut().zip(&moves) {
            last = moved.or(last);
            if let Some(by) = last {
                *value = by.compose(value);
            }
        }
    }

    /// Rounds its shared poses to the values others will read, optimises its other poses with these fixed, and
    /// condenses its graph there.
    fn condense(&mut self) -> Result<(), RobotError> {
        let kept: Vec<usize> = (0..self.keep.len()).filter(|k| self.keep[*k]).collect();
        let poses: Vec<G> = kept.iter().map(|k| self.graph.values()[*k]).collect();
        let (mut estimate, read) = encode_poses(&poses);
        for (k, pose) in kept.iter().zip(read) {
            self.graph.values_mut()[*k] = pose;
        }
        self.graph.set_fixed(&self.keep);
        self.graph.solve(&local(), || false);
        let mut place = vec![usize::MAX; self.keep.len()];
        kept.iter().enumerate().for_each(|(at, k)| place[*k] = at);
        let parts = self.graph.condense(&self.keep, Metric::Geodesic)?;
        let parts: Vec<_> = parts.into_iter().map(|p| p.renamed(&place)).collect();
        parts.iter().for_each(|p| encode_part(p, &mut estimate.parts));
        self.own = (self.shared(&kept, parts.iter().map(|p| p.vertices().to_vec()).collect())?, estimate);
        // It uses the same rounded data as the others, so that all solve the same graph.
        let too_much = |_| RobotError::TooMuch(self.id);
        let known = SharedGraph::read(self.id, &self.own.0, &self.own.1).map_err(too_much)?;
        self.team.insert(self.id, known);
        Ok(())
    }

    fn shared(&self, kept: &[usize], parts: Vec<Vec<usize>>) -> Result<Shared, RobotError> {
        let id = |k: usize| PoseId { robot: self.id, seq: self.seqs[k] };
        let seqs: Vec<u32> = kept.iter().map(|k| self.seqs[*k]).collect();
        let between = self.graph.edges().iter().filter(|e| self.keep[e.a] && self.keep[e.b]);
        let inner: Vec<Measurement<G, D>> = between
            .map(|e| Measurement { a: id(e.a), b: id(e.b), a_from_b: e.a_from_b, information: e.information })
            .collect();
        let loops: Vec<Measurement<G, D>> = self.loops.values().cloned().collect();
        encode_shared(self.id, &seqs, &inner, &loops, &parts).ok_or(RobotError::TooMuch(self.id))
    }
}

/// Configuration for solving its own graph.
fn local() -> GraphConfig {
    GraphConfig { tolerance: 1e-12, iterations: 50, ..GraphConfig::default() }
}

impl<G: Rigid<D>, const D: usize> SharedGraph<G, D> {
    fn read(robot: RobotId, shared: &Shared, estimate: &Estimate) -> Result<Teammate<G, D>, Refused> {
        let shared = decode_shared(robot, shared)?;
        let located: Located<G, D> = decode_estimate(estimate, &shared.parts)?;
        Ok(Teammate { shared, located })
    }
}
