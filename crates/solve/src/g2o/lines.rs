//! The lines of one kind of pose (in the plane or in space) to a graph.
//!
//! A point is a vertex whose rotation nothing measures, and a pose or position that is known in the world is measured from
//! one more vertex, the world, which is fixed: one kind of edge is enough for all.

use super::content::{Named, Replaced};
use super::record::Record;
use crate::Loss;
use crate::graph::{PoseGraph, nearest_semi_definite, semi_definite};
use crate::text::{TextError, end, number, whole};
use nalgebra::SMatrix;
use std::collections::{BTreeMap, BTreeSet};

/// What was read of one kind.
pub struct Lines<G, const D: usize> {
    /// The first line.
    pub first: Option<usize>,
    /// Poses and points.
    pub vertices: BTreeMap<u64, G>,
    pub replaced: Option<Replaced>,
    points: BTreeSet<u64>,
    offsets: BTreeMap<u64, G>,
    measured: Vec<Measured<G, D>>,
}

/// What a line measures: of a pose another one, a point, or what is known of it in the world.
struct Measured<G, const D: usize> {
    line: usize,
    kind: Kind,
    from: u64,
    to: u64,
    offset: Option<u64>,
    value: G,
    information: SMatrix<f64, D, D>,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Relative,
    Seen,
    Prior,
    Position,
}

impl<G, const D: usize> Default for Lines<G, D> {
    fn default() -> Self {
        Self {
            first: None,
            vertices: BTreeMap::new(),
            replaced: None,
            points: BTreeSet::new(),
            offsets: BTreeMap::new(),
            measured: Vec::new(),
        }
    }
}

impl<G: Record<D>, const D: usize> Lines<G, D> {
    /// Takes a line when its tag is of this kind. `None` when it is not; else whether it has to be kept as it is to be
    /// written again.
    pub fn take<'a>(
        &mut self,
        tag: &str,
        line: usize,
        words: &mut impl Iterator<Item = &'a str>,
    ) -> Result<Option<bool>, TextError> {
        let kind = match tag {
            _ if tag == G::VERTEX || tag == G::POINT => {
                self.vertex(line, words, tag == G::POINT)?;
                return Ok(Some(false));
            }
            _ if tag == G::OFFSET => {
                self.offset(line, words)?;
                return Ok(Some(true));
            }
            _ if tag == G::EDGE => Kind::Relative,
            _ if tag == G::SEEN => Kind::Seen,
            _ if tag == G::POSITION => Kind::Position,
            _ if G::PRIORS.contains(&tag) => Kind::Prior,
            _ => return Ok(None),
        };
        self.measured(line, kind, words)?;
        Ok(Some(kind != Kind::Relative))
    }

    /// Whether anything was measured.
    pub fn is_measured(&self) -> bool {
        !self.measured.is_empty()
    }

    fn vertex<'a>(
        &mut self,
        line: usize,
        words: &mut impl Iterator<Item = &'a str>,
        point: bool,
    ) -> Result<(), TextError> {
        let id = whole(words, line, "the id")?;
        let value = if point { G::take_point(words, line)? } else { G::take(words, line)? };
        end(words, line)?;
        self.first.get_or_insert(line);
        if point {
            self.points.insert(id);
        }
        match self.vertices.insert(id, value) {
            None => Ok(()),
            Some(_) => Err(TextError::new(line, format!("vertex {id} is defined twice"))),
        }
    }

    fn offset<'a>(
        &mut self,
        line: usize,
        words: &mut impl Iterator<Item = &'a str>,
    ) -> Result<(), TextError> {
        let id = whole(words, line, "the id")?;
        let value = G::take(words, line)?;
        end(words, line)?;
        self.first.get_or_insert(line);
        self.offsets.insert(id, value);
        Ok(())
    }

    fn measured<'a>(
        &mut self,
        line: usize,
        kind: Kind,
        words: &mut impl Iterator<Item = &'a str>,
    ) -> Result<(), TextError> {
        let from = whole(words, line, "the first id")?;
        let two = matches!(kind, Kind::Relative | Kind::Seen);
        let to = if two { whole(words, line, "the second id")? } else { from };
        let names_offset = G::NAMES_OFFSET && kind != Kind::Relative;
        let offset = names_offset.then(|| whole(words, line, "the id of the parameter")).transpose()?;
        let point = matches!(kind, Kind::Seen | Kind::Position);
        let value = if point { G::take_point(words, line)? } else { G::take(words, line)? };
        let mut information = SMatrix::<f64, D, D>::zeros();
        let n = if point { G::N } else { D };
        for r in 0..n {
            for c in r..n {
                let v = number(words, line, "an entry of the information matrix")?;
                (information[(r, c)], information[(c, r)]) = (v, v);
            }
        }
        end(words, line)?;
        if two && from == to {
            return Err(TextError::new(line, format!("the edge connects vertex {from} to itself")));
        }
        if !semi_definite(&information) {
            let reason = "the information matrix has no eigenvalues that can be computed";
            information = nearest_semi_definite(&information).ok_or(TextError::new(line, reason))?;
            self.replaced.get_or_insert(Replaced { edges: 0, first_line: line }).edges += 1;
        }
        self.first.get_or_insert(line);
        self.measured.push(Measured { line, kind, from, to, offset, value, information });
        Ok(())
    }

    /// The graph; vertices that the text does not define are those that edges name.
    pub fn build(mut self, fixes: &[(usize, u64)]) -> Result<Named<G, D>, TextError> {
        if self.vertices.is_empty() {
            self.vertices =
                self.measured.iter().flat_map(|m| [m.from, m.to]).map(|id| (id, G::identity())).collect();
            let points = self.measured.iter().filter(|m| m.kind == Kind::Seen);
            self.points = points.map(|m| m.to).collect();
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
        // Measurements between poses come first, as the writer needs them.
        self.measured.sort_by_key(|m| m.kind);
        let count = |kinds: &[Kind]| self.measured.iter().filter(|m| kinds.contains(&m.kind)).count();
        let (relative, priors) = (count(&[Kind::Relative]), count(&[Kind::Prior, Kind::Position]));
        let world = (priors > 0).then(|| graph.add_vertex(G::identity(), true));
        for m in &self.measured {
            self.check_ends(m)?;
            let (a_from_b, information) = self.placed(m)?;
            let (a, b) = match world.filter(|_| matches!(m.kind, Kind::Prior | Kind::Position)) {
                Some(world) => (world, find(m.line, m.to)?),
                None => (find(m.line, m.from)?, find(m.line, m.to)?),
            };
            let wrong = |why: crate::graph::EdgeError| TextError::new(m.line, why.to_string());
            graph.add_edge(a, b, a_from_b, &information, Loss::Squared).map_err(wrong)?;
        }
        Ok(Named { graph, ids, points: self.points, relative, priors })
    }

    /// Points are seen, and see nothing.
    fn check_ends(&self, m: &Measured<G, D>) -> Result<(), TextError> {
        let wrong = |id, is: &str| Err(TextError::new(m.line, format!("vertex {id} is a {is}")));
        match m.kind {
            Kind::Seen if !self.points.contains(&m.to) => wrong(m.to, "pose, not a point"),
            Kind::Relative if self.points.contains(&m.to) => wrong(m.to, "point, not a pose"),
            _ if self.points.contains(&m.from) => wrong(m.from, "point, not a pose"),
            _ => Ok(()),
        }
    }

    /// The measurement from pose to pose or point, with the sensor's offset: exact for points and positions, and to first
    /// order in the residual for poses that are known in the world.
    fn placed(&self, m: &Measured<G, D>) -> Result<(G, SMatrix<f64, D, D>), TextError> {
        let offset = match m.offset {
            // GTSAM writes files that name parameter 0 without defining it.
            Some(id) if !(self.offsets.is_empty() && id == 0) => {
                let missing = || TextError::new(m.line, format!("there is no {} {id}", G::OFFSET));
                *self.offsets.get(&id).ok_or_else(missing)?
            }
            _ => G::identity(),
        };
        match m.kind {
            Kind::Relative => Ok((m.value, m.information)),
            Kind::Seen => Ok((offset.compose(&m.value), m.information)),
            Kind::Prior => {
                let back = offset.inverse();
                let carried = back.adjoint().tr_mul(&(m.information * back.adjoint()));
                Ok((m.value.compose(&back), (carried + carried.transpose()) * 0.5))
            }
            Kind::Position if offset.coordinates().amax() > 0.0 => {
                let why = "a position that is measured beside the pose's own origin is not read";
                Err(TextError::new(m.line, why))
            }
            Kind::Position => Ok((m.value, m.information)),
        }
    }
}
