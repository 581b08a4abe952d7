//! What a g2o text has: a graph in the plane or in space, and lines that are kept as they were read.

use super::toro::Form;
use crate::graph::PoseGraph;
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
    /// `None` from [`read`](super::read).
    pub replaced: Option<Replaced>,
    /// Lines that solving does not change, as they were read: of points that were seen, of what is known in the world, and of
    /// unknown tags.
    pub kept: Vec<String>,
    /// Whose text it was.
    pub form: Form,
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
