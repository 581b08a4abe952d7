//! g2o text to a graph.

use super::lines::Lines;
use crate::graph::PoseGraph;
use crate::text::{TextError, shown, whole};
use cairn_geometry::{LieGroup, Se2, Se3};
use std::collections::{BTreeMap, BTreeSet};

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
    /// Lines that solving does not change, as they were read: of points that were seen, of what is known in the world, and of
    /// unknown tags.
    pub kept: Vec<String>,
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
    /// The graph, vertices by rising id. Where something is known in the world, the world is the last vertex, without an id.
    pub graph: PoseGraph<G, D>,
    /// The id of each vertex.
    pub ids: Vec<u64>,
    /// Those of them that are points.
    pub points: BTreeSet<u64>,
    /// Edges between poses; they are the first, those to points and from the world follow.
    pub relative: usize,
    /// Poses and positions that are known in the world: the last edges.
    pub priors: usize,
}

impl<G: LieGroup<D>, const D: usize> Named<G, D> {
    /// A graph of poses and edges between them alone.
    pub fn of_poses(graph: PoseGraph<G, D>, ids: Vec<u64>) -> Self {
        let relative = graph.edges().len();
        Self { graph, ids, points: BTreeSet::new(), relative, priors: 0 }
    }
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

/// Reads a g2o text, and replaces information matrices that are not positive semi-definite by the nearest that are;
/// how many is in [`G2o::replaced`].
///
/// # Errors
/// As [`read`], but for those information matrices.
pub fn read_nearest(text: &str) -> Result<G2o, TextError> {
    let mut rows: Rows = Rows::default();
    let mut unknown: BTreeMap<String, usize> = BTreeMap::new();
    for (k, content) in text.lines().enumerate() {
        let line = k + 1;
        let mut words = content.split('#').next().unwrap_or_default().split_whitespace();
        let Some(tag) = words.next() else { continue };
        if tag == "FIX" {
            rows.fix(line, words)?;
        } else {
            let taken = match rows.plane.take(tag, line, &mut words)? {
                None => rows.space.take(tag, line, &mut words)?,
                taken => taken,
            };
            if taken.is_none() {
                let name = shown(tag);
                let known = unknown.len() < TAGS || unknown.contains_key(&name);
                *unknown.entry(if known { name } else { "...".into() }).or_default() += 1;
            }
            if taken != Some(false) {
                rows.kept.push(content.to_owned());
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
    kept: Vec<String>,
}

impl Rows {
    fn fix<'a>(&mut self, line: usize, words: impl Iterator<Item = &'a str>) -> Result<(), TextError> {
        let mut words = words.peekable();
        loop {
            self.fixes.push((line, whole(&mut words, line, "the id")?));
            if words.peek().is_none() {
                return Ok(());
            }
        }
    }

    fn finish(self, unknown: BTreeMap<String, usize>, lines: usize) -> Result<G2o, TextError> {
        if !self.plane.is_measured() && !self.space.is_measured() {
            let found = match tags_text(&unknown) {
                tags if tags.is_empty() => String::new(),
                tags => format!("; what is in it is not known: {tags}"),
            };
            let reason = format!("the text ends without an edge of a pose graph{found}");
            return Err(TextError::new(lines.max(1), reason));
        }
        let replaced = self.plane.replaced.or(self.space.replaced);
        let (graph, has_values) = if self.plane.first.is_some() {
            let has_values = !self.plane.vertices.is_empty();
            (Graph::Plane(self.plane.build(&self.fixes)?), has_values)
        } else {
            let has_values = !self.space.vertices.is_empty();
            (Graph::Space(self.space.build(&self.fixes)?), has_values)
        };
        Ok(G2o { graph, has_values, unknown, replaced, kept: self.kept })
    }
}

/// Tags and how often each was found, in words.
pub fn tags_text(tags: &BTreeMap<String, usize>) -> String {
    let each: Vec<String> = tags.iter().map(|(tag, n)| format!("{tag} ({n} lines)")).collect();
    each.join(", ")
}
