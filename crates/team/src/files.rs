//! A team's graphs from text of g2o, TORO or iSAM, one text per robot.

use crate::graphs::{GraphsError, Measurement, RobotGraph};
use crate::{PoseId, RobotId};
use cairn_geometry::{LieGroup, Se2, Se3};
use cairn_solve::TextError;
use cairn_solve::g2o::{self, Graph, Named};
use std::collections::{BTreeMap, BTreeSet};

/// A team in 2D or 3D.
#[derive(Clone, Debug)]
pub enum TeamGraphs {
    /// SE(2) poses.
    Plane(Vec<RobotGraph<Se2, 3>>),
    /// SE(3) poses.
    Space(Vec<RobotGraph<Se3, 6>>),
}

/// The graph of one robot in 2D or 3D.
#[derive(Clone, Debug)]
pub enum OwnGraph {
    /// SE(2) poses.
    Plane(RobotGraph<Se2, 3>),
    /// SE(3) poses.
    Space(RobotGraph<Se3, 6>),
}

/// Bits of a vertex id that are the number of the pose; those above are the robot, as in the symbols of GTSAM.
const SEQ_BITS: u32 = 56;

/// Why texts do not describe a team.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// A line of one text is invalid.
    #[error("text {text}, line {line}: {reason}")]
    Text {
        /// Which text, from 0.
        text: usize,
        /// Line, from 1.
        line: usize,
        /// What is wrong there.
        reason: String,
    },
    /// A vertex is used by an edge but is in no text.
    #[error("vertex {0} is in none of the texts")]
    Nobody(u64),
    /// A vertex id that names no robot and pose.
    #[error(
        "vertex {0} does not name its robot: its upper byte is the robot (a letter in GTSAM), the rest the number of the pose, below 2^32"
    )]
    Key(u64),
    /// A vertex of another robot.
    #[error("vertex {0} is of another robot than the first one, of robot {1}")]
    OtherRobot(u64, RobotId),
    /// Lines of other kinds than poses and what was measured between them.
    #[error("measurements that a team does not use would be left out: {0}")]
    LeftOut(String),
    /// There is no text, or there are more texts than robot ids.
    #[error("{0} texts are not a team")]
    Count(usize),
    /// The graphs do not form a team.
    #[error(transparent)]
    Graphs(#[from] GraphsError),
}

/// Reads one g2o text per robot. A robot owns the vertices of its text; its edges may connect them to those of others.
/// Poses are numbered from the smallest vertex id of the robot. Fixed vertices are not kept fixed. Lines of other kinds are left
/// out where `leave_out` says so.
///
/// # Errors
/// When a text is invalid, names a vertex that no text has, or has lines of other kinds.
pub fn read(texts: &[&str], leave_out: bool) -> Result<TeamGraphs, ReadError> {
    if texts.is_empty() || texts.len() > usize::from(RobotId::MAX) {
        return Err(ReadError::Count(texts.len()));
    }
    let in_text = |k: usize, e: ReadError| match e {
        ReadError::Text { line, reason, .. } => ReadError::Text { text: k, line, reason },
        other => other,
    };
    let texts = texts.iter().enumerate();
    let texts: Vec<String> = texts
        .map(|(k, t)| relative_only(t, leave_out).map_err(|e| in_text(k, e)))
        .collect::<Result<_, _>>()?;
    let file = g2o::read(&texts.concat()).map_err(|e| locate(&texts, e))?;
    let mut owners = BTreeMap::new();
    for (k, text) in texts.iter().enumerate() {
        for id in text.lines().filter_map(vertex_of) {
            owners.entry(id).or_insert(k);
        }
    }
    // The text that each edge came from, in the order of the edges.
    let is_edge = |line: &&str| line.trim_start().starts_with("EDGE_SE");
    let from: Vec<usize> = texts
        .iter()
        .enumerate()
        .flat_map(|(k, t)| std::iter::repeat_n(k, t.lines().filter(is_edge).count()))
        .collect();
    match &file.graph {
        Graph::Plane(named) => Ok(TeamGraphs::Plane(divide(named, texts.len(), &owners, &from)?)),
        Graph::Space(named) => Ok(TeamGraphs::Space(divide(named, texts.len(), &owners, &from)?)),
    }
}

/// The text in g2o's form, with an empty line in place of each that is neither a pose nor measured between two, when those are to be left out.
///
/// # Errors
/// When there are such lines, but they are not to be left out; when a line of TORO or iSAM is invalid.
pub fn relative_only(text: &str, leave_out: bool) -> Result<String, ReadError> {
    let (text, _) =
        g2o::as_g2o(text).map_err(|TextError { line, reason }| ReadError::Text { text: 0, line, reason })?;
    let (mut kept, mut others) = (String::new(), BTreeMap::new());
    for line in text.trim_end_matches('\n').lines() {
        match line.split_whitespace().next() {
            None | Some("VERTEX_SE2" | "EDGE_SE2" | "VERTEX_SE3:QUAT" | "EDGE_SE3:QUAT" | "FIX") => {
                kept += line
            }
            // What a sensor's offset is means nothing without its measurements.
            Some(tag) if tag.starts_with('#') || tag.starts_with("PARAMS_") => {}
            Some(tag) => *others.entry(tag.chars().take(24).collect::<String>()).or_default() += 1,
        }
        kept.push('\n');
    }
    // A text of nothing else is told as such by the reader.
    if others.is_empty() || leave_out || kept.trim().is_empty() {
        let text = if kept.trim().is_empty() { &*text } else { &kept };
        return Ok(format!("{}\n", text.trim_end_matches('\n')));
    }
    Err(ReadError::LeftOut(g2o::tags_text(&others)))
}

/// Reads the g2o text of one robot of a team whose other graphs are elsewhere: vertices are its own, edges lead to them or to vertices
/// of others, which the text does not have. The upper byte of a vertex id is its robot (97 for `a`, as in the symbols of GTSAM), the
/// rest the number of the pose.
///
/// # Errors
/// When the text is invalid, has no vertex or those of several robots, lines of other kinds, or an id names no robot and pose.
pub fn read_own(text: &str) -> Result<OwnGraph, ReadError> {
    let text = relative_only(text, false)?;
    let own: BTreeSet<u64> = text.lines().filter_map(vertex_of).collect();
    let Some(first) = own.first() else {
        let reason = "the text has no vertex, so its robot has no pose".to_owned();
        return Err(ReadError::Text { text: 0, line: 1, reason });
    };
    let robot = pose_of(*first)?.robot;
    if let Some(other) = own.iter().find(|id| pose_of(**id).map(|p| p.robot) != Ok(robot)) {
        pose_of(*other)?;
        return Err(ReadError::OtherRobot(*other, robot));
    }
    let others: BTreeSet<u64> = text.lines().flat_map(ends_of).filter(|id| !own.contains(id)).collect();
    // The reader wants a vertex at both ends of an edge.
    let mut whole = format!("{}\n", text.trim_end_matches('\n'));
    let zeros =
        if text.contains("EDGE_SE2") { "VERTEX_SE2 {} 0 0 0" } else { "VERTEX_SE3:QUAT {} 0 0 0 0 0 0 1" };
    others.iter().for_each(|id| whole += &format!("{}\n", zeros.replace("{}", &id.to_string())));
    let file =
        g2o::read(&whole).map_err(|TextError { line, reason }| ReadError::Text { text: 0, line, reason })?;
    match &file.graph {
        Graph::Plane(named) => Ok(OwnGraph::Plane(own_graph(named, robot, &own)?)),
        Graph::Space(named) => Ok(OwnGraph::Space(own_graph(named, robot, &own)?)),
    }
}

/// The pose that a vertex id names.
fn pose_of(id: u64) -> Result<PoseId, ReadError> {
    let seq = u32::try_from(id & ((1 << SEQ_BITS) - 1)).map_err(|_| ReadError::Key(id))?;
    match (id >> SEQ_BITS) as RobotId {
        0 => Err(ReadError::Key(id)),
        robot => Ok(PoseId { robot, seq }),
    }
}

/// The vertex id of a pose, as [`read_own`] reads it.
pub fn vertex_id(pose: PoseId) -> u64 {
    u64::from(pose.robot) << SEQ_BITS | u64::from(pose.seq)
}

fn own_graph<G: LieGroup<D>, const D: usize>(
    named: &Named<G, D>,
    robot: RobotId,
    own: &BTreeSet<u64>,
) -> Result<RobotGraph<G, D>, ReadError> {
    let ids = named.ids.iter().map(|id| pose_of(*id)).collect::<Result<Vec<_>, _>>()?;
    let values = named.ids.iter().zip(&ids).zip(named.graph.values());
    let poses = values.filter(|((id, _), _)| own.contains(id)).map(|((_, pose), value)| (pose.seq, *value));
    let poses = poses.collect();
    let edges = named.graph.edges().iter();
    let measurements = edges
        .map(|e| Measurement { a: ids[e.a], b: ids[e.b], a_from_b: e.a_from_b, information: e.information })
        .collect();
    Ok(RobotGraph { robot, poses, measurements })
}

/// The ids of an edge line.
fn ends_of(line: &str) -> Vec<u64> {
    let mut words = line.split_whitespace();
    match words.next() {
        Some(tag) if tag.starts_with("EDGE_SE") => words.take(2).filter_map(|w| w.parse().ok()).collect(),
        _ => Vec::new(),
    }
}

/// The id of a vertex line.
fn vertex_of(line: &str) -> Option<u64> {
    let mut words = line.split_whitespace();
    words.next().filter(|tag| tag.starts_with("VERTEX_SE"))?;
    words.next()?.parse().ok()
}

fn locate(texts: &[String], error: TextError) -> ReadError {
    let mut line = error.line;
    for (k, text) in texts.iter().enumerate() {
        let lines = text.lines().count();
        if line <= lines || k + 1 == texts.len() {
            return ReadError::Text { text: k, line, reason: error.reason };
        }
        line -= lines;
    }
    ReadError::Count(0)
}

fn divide<G: LieGroup<D>, const D: usize>(
    named: &Named<G, D>,
    robots: usize,
    owners: &BTreeMap<u64, usize>,
    from: &[usize],
) -> Result<Vec<RobotGraph<G, D>>, ReadError> {
    let mut smallest = vec![u64::MAX; robots];
    owners.iter().for_each(|(id, k)| smallest[*k] = smallest[*k].min(*id));
    let pose = |v: usize| {
        let id = named.ids[v];
        let k = *owners.get(&id).ok_or(ReadError::Nobody(id))?;
        let seq = u32::try_from(id - smallest[k]).map_err(|_| ReadError::Nobody(id))?;
        Ok::<PoseId, ReadError>(PoseId { robot: k as RobotId, seq })
    };
    let mut team: Vec<RobotGraph<G, D>> = (0..robots)
        .map(|k| RobotGraph { robot: k as RobotId, poses: BTreeMap::new(), measurements: Vec::new() })
        .collect();
    for (v, value) in named.graph.values().iter().enumerate() {
        let id = pose(v)?;
        team[usize::from(id.robot)].poses.insert(id.seq, *value);
    }
    for (e, k) in named.graph.edges().iter().zip(from) {
        let m =
            Measurement { a: pose(e.a)?, b: pose(e.b)?, a_from_b: e.a_from_b, information: e.information };
        team[*k].measurements.push(m);
    }
    if let Some(k) = team.iter().position(|r| r.poses.is_empty()) {
        let reason = "the text has no vertex, so its robot has no pose".to_owned();
        return Err(ReadError::Text { text: k, line: 1, reason });
    }
    Ok(team)
}
