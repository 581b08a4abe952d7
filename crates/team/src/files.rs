//! A team's graphs from g2o text, one text per robot.

use crate::graphs::{GraphsError, Measurement, RobotGraph};
use crate::{PoseId, RobotId};
use cairn_geometry::{LieGroup, Se2, Se3};
use cairn_solve::TextError;
use cairn_solve::g2o::{self, Graph, Named};
use std::collections::BTreeMap;

/// A team in 2D or 3D.
#[derive(Clone, Debug)]
pub enum TeamGraphs {
    /// SE(2) poses.
    Plane(Vec<RobotGraph<Se2, 3>>),
    /// SE(3) poses.
    Space(Vec<RobotGraph<Se3, 6>>),
}

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
    /// There is no text, or there are more texts than robot ids.
    #[error("{0} texts are not a team")]
    Count(usize),
    /// The graphs do not form a team.
    #[error(transparent)]
    Graphs(#[from] GraphsError),
}

/// Reads one g2o text per robot. A robot owns the vertices of its text; its edges may connect them to those of others.
/// Poses are numbered from the smallest vertex id of the robot. Fixed vertices are not kept fixed.
///
/// # Errors
/// When a text is invalid, or names a vertex that no text has.
pub fn read(texts: &[&str]) -> Result<TeamGraphs, ReadError> {
    if texts.is_empty() || texts.len() > usize::from(RobotId::MAX) {
        return Err(ReadError::Count(texts.len()));
    }
    let ends_with_line = texts.iter().map(|t| format!("{}\n", t.trim_end_matches('\n')));
    let texts: Vec<String> = ends_with_line.collect();
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
