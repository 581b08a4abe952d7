//! The pose graphs of a team: what each robot holds before it has heard of anyone, and all of it as one graph.

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
    /// Inverse covariance of its coordinates.
    pub information: SMatrix<f64, D, D>,
}

impl<G, const D: usize> Measurement<G, D> {
    /// Its ends, the smaller id first.
    pub fn ends(&self) -> LoopId {
        (self.a.min(self.b), self.a.max(self.b))
    }

    /// The end that a robot has, and the other one; `None` when neither or both are its.
    pub fn own_end(&self, robot: RobotId) -> Option<(PoseId, PoseId)> {
        match (self.a.robot == robot, self.b.robot == robot) {
            (true, false) => Some((self.a, self.b)),
            (false, true) => Some((self.b, self.a)),
            _ => None,
        }
    }
}

/// What one robot holds: its poses, the measurements between them, and loops to poses of others.
#[derive(Clone, Debug)]
pub struct RobotGraph<G, const D: usize> {
    /// Whose it is.
    pub robot: RobotId,
    /// Its poses by number, in a frame of its own (any, where they are not known).
    pub poses: BTreeMap<u32, G>,
    /// Measurements with at least one end of its own.
    pub measurements: Vec<Measurement<G, D>>,
}

/// Why graphs do not make a team.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GraphsError {
    /// There is none, or not a pose for each robot.
    #[error("{robots} robots cannot share {poses} poses")]
    TooFew {
        /// Robots asked for.
        robots: usize,
        /// Poses that there are.
        poses: usize,
    },
    /// Two have the same id.
    #[error("robot {0} is there twice")]
    Twice(RobotId),
    /// A measurement names a pose that nobody has.
    #[error("pose {} of robot {} does not exist", .0.seq, .0.robot)]
    NoPose(PoseId),
    /// A measurement of a robot has no end of its own.
    #[error("robot {robot} holds a measurement between poses {} and {} of others", .ends.0.seq, .ends.1.seq)]
    Foreign {
        /// The robot.
        robot: RobotId,
        /// Its ends.
        ends: (PoseId, PoseId),
    },
    /// A measurement is invalid.
    #[error(transparent)]
    Edge(#[from] EdgeError),
}

/// All graphs as one: every pose, every measurement once. Of loops that several robots hold between the same two poses,
/// that of the robot with the smallest id counts.
#[derive(Clone, Debug)]
pub struct Whole<G, const D: usize> {
    /// The graph; vertices by rising id.
    pub graph: PoseGraph<G, D>,
    /// The id of each vertex.
    pub ids: Vec<PoseId>,
    /// The loop that each edge is, if it is one between robots.
    pub loops: Vec<Option<LoopId>>,
}

impl<G: LieGroup<D>, const D: usize> Whole<G, D> {
    /// Joins the graphs.
    ///
    /// # Errors
    /// When they are not those of a team.
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

/// Splits a graph among robots: each gets a run of vertices that follow each other, of nearly equal length, in the frame of the
/// first of them; both ends of a measurement hold it. Fixed vertices are not kept fixed.
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
