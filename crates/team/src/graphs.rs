//! The pose graphs of a team: the graph of each robot before any exchange, and all graphs combined.

use crate::{LoopId, PoseId, RobotId};
use cairn_geometry::LieGroup;
use cairn_solve::Loss;
use cairn_solve::graph::{EdgeError, PoseGraph};
use nalgebra::SMatrix;
use std::collections::BTreeMap;

/// A measured transform between two poses.
#[derive(Clone, Debug)]
pub struct Measurement<G, const D: usize> {
    /// The first pose.
    pub a: PoseId,
    /// The second pose.
    pub b: PoseId,
    /// The measurement.
    pub a_from_b: G,
    /// Information matrix (inverse covariance) of its coordinates.
    pub information: SMatrix<f64, D, D>,
}

impl<G, const D: usize> Measurement<G, D> {
    /// Both ends, the smaller id first.
    pub fn ends(&self) -> LoopId {
        (self.a.min(self.b), self.a.max(self.b))
    }

    /// The end that belongs to a robot, and the other one; `None` when neither or both belong to it.
    pub fn own_end(&self, robot: RobotId) -> Option<(PoseId, PoseId)> {
        match (self.a.robot == robot, self.b.robot == robot) {
            (true, false) => Some((self.a, self.b)),
            (false, true) => Some((self.b, self.a)),
            _ => None,
        }
    }
}

/// The graph of one robot: its poses, the measurements between them, and loops to poses of others.
#[derive(Clone, Debug)]
pub struct RobotGraph<G, const D: usize> {
    /// The robot that owns the graph.
    pub robot: RobotId,
    /// Its poses by number, in its own frame (arbitrary values where they are unknown).
    pub poses: BTreeMap<u32, G>,
    /// Measurements with at least one end on its own poses.
    pub measurements: Vec<Measurement<G, D>>,
}

/// Why graphs do not form a team.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GraphsError {
    /// There is no robot, or there are fewer poses than robots.
    #[error("{robots} robots cannot share {poses} poses")]
    TooFew {
        /// Robots asked for.
        robots: usize,
        /// Number of poses available.
        poses: usize,
    },
    /// Two robots have the same id.
    #[error("robot {0} is there twice")]
    Twice(RobotId),
    /// A measurement names a pose that no robot has.
    #[error("pose {} of robot {} does not exist", .0.seq, .0.robot)]
    NoPose(PoseId),
    /// A measurement of a robot has no end on the robot's own poses.
    #[error("robot {robot} holds a measurement between poses {} and {} of others", .ends.0.seq, .ends.1.seq)]
    Foreign {
        /// The robot.
        robot: RobotId,
        /// The ends of the measurement.
        ends: (PoseId, PoseId),
    },
    /// A measurement is invalid.
    #[error(transparent)]
    Edge(#[from] EdgeError),
}

/// All graphs combined: every pose, and every measurement once. If several robots have a loop between the same two
/// poses, that of the robot with the smallest id is used.
#[derive(Clone, Debug)]
pub struct CentralGraph<G, const D: usize> {
    /// The graph; vertices in order of their ids.
    pub graph: PoseGraph<G, D>,
    /// The id of each vertex.
    pub ids: Vec<PoseId>,
    /// The loop between robots that each edge belongs to, if any.
    pub loops: Vec<Option<LoopId>>,
}

impl<G: LieGroup<D>, const D: usize> CentralGraph<G, D> {
    /// Combines the graphs.
    ///
    /// # Errors
    /// When they do not form a team.
    pub fn new(team: &[RobotGraph<G, D>]) -> Result<Self, GraphsError> {
        let mut poses = BTreeMap::new();
        let mut robots = BTreeMap::new();
        for (k, own) in team.iter().enumerate() {
            if robots.insert(own.robot, k).is_some() {
                return Err(GraphsError::Twice(own.robot));
            }
            poses.extend(own.poses.iter().map(|(seq, pose)| (PoseId { robot: own.robot, seq: *seq }, *pose)));
        }
        let mut graph = PoseGraph::new();
        let mut index = BTreeMap::new();
        for (id, pose) in &poses {
            index.insert(*id, graph.add_vertex(*pose, false));
        }
        let find = |id: PoseId| index.get(&id).copied().ok_or(GraphsError::NoPose(id));
        let (mut seen, mut loops) = (BTreeMap::new(), Vec::new());
        for k in robots.values() {
            for m in &team[*k].measurements {
                let (a, b, own) = (find(m.a)?, find(m.b)?, team[*k].robot);
                if m.a.robot != own && m.b.robot != own {
                    return Err(GraphsError::Foreign { robot: own, ends: (m.a, m.b) });
                }
                let is_loop = m.a.robot != m.b.robot;
                let id = m.ends();
                if is_loop && seen.insert(id, ()).is_some() {
                    continue;
                }
                graph.add_edge(a, b, m.a_from_b, &m.information, Loss::Squared)?;
                loops.push(is_loop.then_some(id));
            }
        }
        let ids = poses.into_keys().collect();
        Ok(Self { graph, ids, loops })
    }
}

/// Splits a graph among robots: each gets a run of consecutive vertices, of nearly equal length, in the frame of the
/// first of them; a measurement between two robots is given to both. Fixed vertices are not kept fixed.
///
/// # Errors
/// When there are fewer vertices than robots, or no robot.
pub fn split<G: LieGroup<D>, const D: usize>(
    graph: &PoseGraph<G, D>,
    robots: usize,
) -> Result<Vec<RobotGraph<G, D>>, GraphsError> {
    let n = graph.values().len();
    if robots == 0 || robots > n || robots > usize::from(RobotId::MAX) {
        return Err(GraphsError::TooFew { robots, poses: n });
    }
    let first = |k: usize| k * n / robots;
    let owner = |v: usize| {
        let guess = v * robots / n;
        let k = if first(guess + 1) <= v { guess + 1 } else { guess };
        PoseId { robot: k as RobotId, seq: (v - first(k)) as u32 }
    };
    let mut team: Vec<RobotGraph<G, D>> = (0..robots)
        .map(|k| RobotGraph { robot: k as RobotId, poses: BTreeMap::new(), measurements: Vec::new() })
        .collect();
    for (v, pose) in graph.values().iter().enumerate() {
        let id = owner(v);
        let origin = graph.values()[first(usize::from(id.robot))].inverse();
        team[usize::from(id.robot)].poses.insert(id.seq, origin.compose(pose));
    }
    for e in graph.edges() {
        let (a, b) = (owner(e.a), owner(e.b));
        let m = Measurement { a, b, a_from_b: e.a_from_b, information: e.information };
        team[usize::from(a.robot)].measurements.push(m.clone());
        if b.robot != a.robot {
            team[usize::from(b.robot)].measurements.push(m);
        }
    }
    Ok(team)
}
