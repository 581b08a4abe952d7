//! g2o text to a graph.

use super::record::Record;
use crate::Loss;
use crate::graph::{PoseGraph, nearest_semi_definite, semi_definite};
use crate::text::{TextError, end, number, shown, whole};
use cairn_geometry::{Se2, Se3};
use nalgebra::SMatrix;
use std::collections::BTreeMap;

/// The content of a g2o text.
#[derive(Clone, Debug)]
pub struct G2o {
    /// The graph.
    pub graph: Graph,
    /// Whether vertices were given with values; otherwise they are the identity and need a start.
    pub has_values: bool,
    /// Tags that were not read, with the number of their lines (long tags are cut; of very many the rest is counted as
    /// `...`).
    pub unknown: BTreeMap<String, usize>,
    /// Edges whose information matrix was not positive semi-definite and was replaced by the nearest one that is; always
    /// `None` from [`read`].
    pub replaced: Option<Replaced>,
}

/// Information matrices that were replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Replaced {
    /// How many.
    pub edges: usize,
    /// Line of the first.
    pub first_line: usize,
}

/// A graph in the plane or in space.
#[derive(Clone, Debug)]
pub enum Graph {
    /// Of SE2 poses.
    Plane(Named<Se2, 3>),
    /// Of SE3 poses.
    Space(Named<Se3, 6>),
}

/// A graph whose vertices have numbers of their own.
#[derive(Clone, Debug)]
pub struct Named<G, const D: usize> {
    /// The graph, vertices by rising id.
    pub graph: PoseGraph<G, D>,
    /// The id of each vertex.
    pub ids: Vec<u64>,
}

/// Different unknown tags that are listed by name.
const TAGS: usize = 32;

/// Reads a g2o text.
///
/// # Errors
/// With the line: a wrong count of numbers, numbers that are not finite, quaternions far from norm one, information
/// matrices that are not positive semi-definite, an id twice, edges to what there is not or from a vertex to itself, the
/// plane and space mixed; and when there is no edge at all.
pub fn read(text: &str) -> Result<G2o, TextError> {
    let file = read_nearest(text)?;
    match file.replaced {
        None => Ok(file),
        Some(r) => Err(TextError::new(r.first_line, "the information matrix is not positive semi-definite")),
    }
}

/// Reads a g2o text, and replaces information matrices that are not positive semi-definite by the nearest that are
/// ([`nearest_semi_definite`]); how many is in [`G2o::replaced`].
///
/// # Errors
/// As [`read`], but for those information matrices.
pub fn read_nearest(text: &str) -> Result<G2o, TextError> {
    let mut rows: Rows = Rows::default();
    let mut unknown: BTreeMap<String, usize> = BTreeMap::new();
    for (k, content) in text.lines().enumerate() {
        let line = k + 1;
        let mut words = content.split_whitespace();
        let Some(tag) = words.next().filter(|tag| !tag.starts_with('#')) else { continue };
        match tag {
            "FIX" => {
                let mut words = words.peekable();
                loop {
                    rows.fixes.push((line, whole(&mut words, line, "the id")?));
                    if words.peek().is_none() {
                        break;
                    }
                }
            }
            _ if tag == Se2::VERTEX => rows.plane.vertex(line, &mut words)?,
            _ if tag == Se2::EDGE => rows.plane.edge(line, &mut words)?,
            _ if tag == Se3::VERTEX => rows.space.vertex(line, &mut words)?,
            _ if tag == Se3::EDGE => rows.space.edge(line, &mut words)?,
            _ => {
                let name = shown(tag);
                let known = unknown.len() < TAGS || unknown.contains_key(&name);
                *unknown.entry(if known { name } else { "...".into() }).or_default() += 1;
            }
        }
        if let (Some(a), Some(b)) = (rows.plane.first, rows.space.first) {
            let reason =
                format!("poses in the plane and in space are mixed (the others begin at line {})", a.min(b));
            return Err(TextError::new(a.max(b), reason));
        }
    }
    rows.finish(unknown, text.lines().count())
}

#[derive(Default)]
struct Rows {
    plane: Lines<Se2, 3>,
    space: Lines<Se3, 6>,
    fixes: Vec<(usize, u64)>,
}

impl Rows {
    fn finish(self, unknown: BTreeMap<String, usize>, lines: usize) -> Result<G2o, TextError> {
        if self.plane.edges.is_empty() && self.space.edges.is_empty() {
            return Err(TextError::new(lines.max(1), "the text ends without an edge of a pose graph"));
        }
        let replaced = self.plane.replaced.or(self.space.replaced);
        let (graph, has_values) = if self.plane.first.is_some() {
            let has_values = !self.plane.vertices.is_empty();
            (Graph::Plane(self.plane.build(&self.fixes)?), has_values)
        } else {
            let has_values = !self.space.vertices.is_empty();
            (Graph::Space(self.space.build(&self.fixes)?), has_values)
        };
        Ok(G2o { graph, has_values, unknown, replaced })
    }
}

/// The lines of one kind of pose.
struct Lines<G, const D: usize> {
    first: Option<usize>,
    vertices: BTreeMap<u64, G>,
    edges: Vec<EdgeLine<G, D>>,
    replaced: Option<Replaced>,
}

struct EdgeLine<G, const D: usize> {
    line: usize,
    ends: [u64; 2],
    a_from_b: G,
    information: SMatrix<f64, D, D>,
}

impl<G, const D: usize> Default for Lines<G, D> {
    fn default() -> Self {
        Self { first: None, vertices: BTreeMap::new(), edges: Vec::new(), replaced: None }
    }
}

impl<G: Record<D>, const D: usize> Lines<G, D> {
    fn vertex<'a>(
        &mut self,
        line: usize,
        words: &mut impl Iterator<Item = &'a str>,
    ) -> Result<(), TextError> {
        let id = whole(words, line, "the id")?;
        let value = G::take(words, line)?;
        end(words, line)?;
        self.first.get_or_insert(line);
        match self.vertices.insert(id, value) {
            None => Ok(()),
            Some(_) => Err(TextError::new(line, format!("vertex {id} is defined twice"))),
        }
    }

    fn edge<'a>(&mut self, line: usize, words: &mut impl Iterator<Item = &'a str>) -> Result<(), TextError> {
        let ends = [whole(words, line, "the first id")?, whole(words, line, "the second id")?];
        let a_from_b = G::take(words, line)?;
        let mut information = SMatrix::<f64, D, D>::zeros();
        for r in 0..D {
            for c in r..D {
                let v = number(words, line, "an entry of the information matrix")?;
                (information[(r, c)], information[(c, r)]) = (v, v);
            }
        }
        end(words, line)?;
        if ends[0] == ends[1] {
            return Err(TextError::new(line, format!("the edge connects vertex {} to itself", ends[0])));
        }
        if !semi_definite(&information) {
            let reason = "the information matrix has no eigenvalues that can be computed";
            information = nearest_semi_definite(&information).ok_or(TextError::new(line, reason))?;
            self.replaced.get_or_insert(Replaced { edges: 0, first_line: line }).edges += 1;
        }
        self.first.get_or_insert(line);
        self.edges.push(EdgeLine { line, ends, a_from_b, information });
        Ok(())
    }

    fn build(mut self, fixes: &[(usize, u64)]) -> Result<Named<G, D>, TextError> {
        if self.vertices.is_empty() {
            let named = self.edges.iter().flat_map(|e| e.ends);
            self.vertices = named.map(|id| (id, G::identity())).collect();
        }
        let ids: Vec<u64> = self.vertices.keys().copied().collect();
        let find = |line, id| {
            let missing = || TextError::new(line, format!("there is no vertex {id}"));
            ids.binary_search(&id).map_err(|_| missing())
        };
        let mut fixed = vec![false; ids.len()];
        for (line, id) in fixes {
            fixed[find(*line, *id)?] = true;
        }
        let mut graph = PoseGraph::new();
        for (value, fixed) in self.vertices.values().zip(fixed) {
            graph.add_vertex(*value, fixed);
        }
        for e in &self.edges {
            let (a, b) = (find(e.line, e.ends[0])?, find(e.line, e.ends[1])?);
            graph
                .add_edge(a, b, e.a_from_b, &e.information, Loss::Squared)
                .map_err(|why| TextError::new(e.line, why.to_string()))?;
        }
        Ok(Named { graph, ids })
    }
}
