//! Eliminating vertices of a graph: what is left of it over the others.
//!
//! The vertices to be eliminated fall into connected parts. Each part with its edges is linearised, its Schur complement onto
//! the kept vertices around it is taken, and written relative to one of them ([`Condensed`]). Source: Dellaert and Kaess,
//! "Factor graphs for robot perception" (2017), chapter 5; a use between robots: Cunningham, Paluri, Dellaert, "DDF-SAM: fully
//! distributed SLAM using constrained factor graphs" (2010).

use super::condensed::Condensed;
use super::normal::Linear;
use super::{Metric, PoseGraph};
use crate::sparse::{Analysis, Factor, UniformBlocks};
use cairn_geometry::LieGroup;
use nalgebra::{Cholesky, DMatrix, DVector, SMatrix};
use std::sync::Arc;

/// Why a graph could not be condensed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CondenseError {
    /// The edges of a part do not determine its poses, or not those of the kept vertices around it.
    #[error("the edges around vertex {0} do not determine its pose")]
    Undetermined(usize),
    /// A vertex to be eliminated is part of a condensed part already.
    #[error("vertex {0} belongs to a condensed part")]
    Nested(usize),
}

impl<G: LieGroup<D>, const D: usize> PoseGraph<G, D> {
    /// Eliminates every vertex that is not kept, at the current values. Returns what is left of each connected part of
    /// them over the kept vertices around it; parts with fewer than two such vertices leave nothing. Edges between kept
    /// vertices are not touched. Whether a vertex is fixed plays no part.
    ///
    /// # Errors
    /// When the edges of a part do not determine its poses, or it reaches into a condensed part.
    ///
    /// # Panics
    /// When there is not one flag for each vertex.
    pub fn condense(&self, keep: &[bool], metric: Metric) -> Result<Vec<Condensed<G, D>>, CondenseError> {
        let inside = |v: &usize| !keep[*v];
        if let Some(v) = self.condensed.iter().flat_map(|c| c.vertices()).find(|v| inside(v)) {
            return Err(CondenseError::Nested(*v));
        }
        let mut next: Vec<Vec<usize>> = vec![Vec::new(); keep.len()];
        for (k, e) in self.edges.iter().enumerate() {
            [e.a, e.b].into_iter().filter(inside).for_each(|v| next[v].push(k));
        }
        let mut seen = keep.to_vec();
        let mut left = Vec::new();
        for first in 0..keep.len() {
            if !seen[first] {
                let part = self.part(first, keep, &next, &mut seen);
                if part.around.len() >= 2 {
                    left.push(self.condense_part(&part, metric)?);
                }
            }
        }
        Ok(left)
    }

    /// The connected part of eliminated vertices that `first` belongs to.
    fn part(&self, first: usize, keep: &[bool], next: &[Vec<usize>], seen: &mut [bool]) -> Part {
        let (mut vertices, mut around, mut edges) = (vec![first], Vec::new(), Vec::new());
        seen[first] = true;
        let mut k = 0;
        while let Some(v) = vertices.get(k).copied() {
            k += 1;
            for &e in &next[v] {
                edges.push(e);
                let other = if self.edges[e].a == v { self.edges[e].b } else { self.edges[e].a };
                if keep[other] {
                    around.push(other);
                } else if !seen[other] {
                    seen[other] = true;
                    vertices.push(other);
                }
            }
        }
        for list in [&mut vertices, &mut around, &mut edges] {
            list.sort_unstable();
            list.dedup();
        }
        Part { vertices, around, edges }
    }

    fn condense_part(&self, part: &Part, metric: Metric) -> Result<Condensed<G, D>, CondenseError> {
        let undetermined = || CondenseError::Undetermined(part.vertices[0]);
        let system = System::new(self, part, metric);
        let (mut hessian, mut gradient) = system.schur_complement().ok_or_else(undetermined)?;
        // The cost is that of relative poses: with the base held, what remains is all there is.
        hessian = 0.5 * (&hessian + hessian.transpose());
        let root = Cholesky::new(hessian).ok_or_else(undetermined)?.unpack().transpose();
        gradient.neg_mut();
        let rhs = root.tr_solve_upper_triangular(&gradient).ok_or_else(undetermined)?;
        let from_base = self.values[part.around[0]].inverse();
        let poses = part.around[1..].iter().map(|v| from_base.compose(&self.values[*v])).collect();
        Condensed::new(part.around.clone(), poses, root, rhs).map_err(|_| undetermined())
    }
}

/// Eliminated vertices that hang together, the kept ones around them, and all edges that touch the eliminated ones.
struct Part {
    vertices: Vec<usize>,
    around: Vec<usize>,
    edges: Vec<usize>,
}

/// The normal equations of a part; the base, the first vertex around it, is held.
struct System<const D: usize> {
    analysis: Arc<Analysis>,
    diagonal: Vec<SMatrix<f64, D, D>>,
    off_diagonal: Vec<SMatrix<f64, D, D>>,
    gradient: Vec<f64>,
    /// For each vertex around the part but the base, its blocks `(inside, block)`: rows inside, columns outside.
    coupling: Vec<Vec<(usize, SMatrix<f64, D, D>)>>,
    outside: DMatrix<f64>,
    outside_gradient: DVector<f64>,
}

/// Where a vertex is in a [`System`].
#[derive(Clone, Copy)]
enum Place {
    Inside(usize),
    Base,
    Outside(usize),
}

impl<const D: usize> System<D> {
    fn new<G: LieGroup<D>>(graph: &PoseGraph<G, D>, part: &Part, metric: Metric) -> Self {
        let place = |v: usize| match part.vertices.binary_search(&v) {
            Ok(k) => Place::Inside(k),
            Err(_) => match part.around.binary_search(&v) {
                Ok(k) if k > 0 => Place::Outside(k - 1),
                _ => Place::Base,
            },
        };
        let inside = |v: usize| part.vertices.binary_search(&v).ok();
        let edges = || part.edges.iter().map(|k| &graph.edges[*k]);
        let pairs = edges().filter_map(|e| Some((inside(e.a)?, inside(e.b)?)));
        let analysis = Arc::new(Analysis::new(part.vertices.len(), D, pairs));
        let around = part.around.len() - 1;
        let mut system = Self {
            diagonal: vec![SMatrix::zeros(); part.vertices.len()],
            off_diagonal: vec![SMatrix::zeros(); analysis.pairs().len()],
            gradient: vec![0.0; part.vertices.len() * D],
            coupling: vec![Vec::new(); around],
            outside: DMatrix::zeros(around * D, around * D),
            outside_gradient: DVector::zeros(around * D),
            analysis,
        };
        for e in edges() {
            let l = Linear::new(e, &graph.values[e.a], &graph.values[e.b], metric);
            // Rows of the second vertex, columns of the first.
            let across = -l.by_b * l.adjoint;
            let by_a = l.adjoint.tr_mul(&(l.by_b * l.adjoint));
            let (a, b) = (place(e.a), place(e.b));
            system.own(b, &l.by_b, l.gradient_b.as_slice());
            system.own(a, &by_a, (-l.adjoint.tr_mul(&l.gradient_b)).as_slice());
            system.across(b, a, &across);
        }
        system
    }

    fn own(&mut self, place: Place, block: &SMatrix<f64, D, D>, gradient: &[f64]) {
        let to = match place {
            Place::Inside(k) => {
                self.diagonal[k] += block;
                &mut self.gradient[k * D..][..D]
            }
            Place::Outside(k) => {
                let mut to = self.outside.fixed_view_mut::<D, D>(k * D, k * D);
                to += block;
                &mut self.outside_gradient.as_mut_slice()[k * D..][..D]
            }
            Place::Base => return,
        };
        to.iter_mut().zip(gradient).for_each(|(t, g)| *t += g);
    }

    /// Adds a block with these rows and columns; every edge has an end inside.
    fn across(&mut self, row: Place, column: Place, block: &SMatrix<f64, D, D>) {
        match (row, column) {
            (Place::Inside(r), Place::Inside(c)) => {
                if let Some(pair) = self.analysis.pair(r, c) {
                    self.off_diagonal[pair] += if r > c { *block } else { block.transpose() };
                }
            }
            (Place::Inside(r), Place::Outside(c)) => self.coupling[c].push((r, *block)),
            (Place::Outside(r), Place::Inside(c)) => self.coupling[r].push((c, block.transpose())),
            _ => {}
        }
    }

    /// `H_oo - H_oi H_ii^-1 H_io` and `g_o - H_oi H_ii^-1 g_i`; `None` when `H_ii` is not positive definite.
    fn schur_complement(mut self) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let flat = |blocks: &[SMatrix<f64, D, D>]| -> Vec<f64> {
            blocks.iter().flat_map(|b| b.iter().copied()).collect()
        };
        let (diagonal, off_diagonal) = (flat(&self.diagonal), flat(&self.off_diagonal));
        let blocks = UniformBlocks { size: D, diagonal: &diagonal, off_diagonal: &off_diagonal };
        let mut factor = Factor::new(Arc::clone(&self.analysis));
        factor.factor(&blocks).ok()?;
        let mut x = self.gradient.clone();
        factor.solve(&mut x);
        for (k, blocks) in self.coupling.iter().enumerate() {
            for (inside, block) in blocks {
                let part = nalgebra::SVector::<f64, D>::from_column_slice(&x[inside * D..][..D]);
                let mut to = self.outside_gradient.fixed_rows_mut::<D>(k * D);
                to -= block.tr_mul(&part);
            }
        }
        for column in 0..self.coupling.len() * D {
            let (k, d) = (column / D, column % D);
            x.fill(0.0);
            for (inside, block) in &self.coupling[k] {
                let to = &mut x[inside * D..][..D];
                to.iter_mut().zip(block.column(d).iter()).for_each(|(t, v)| *t += v);
            }
            factor.solve(&mut x);
            // The upper triangle follows from the lower one.
            for (l, blocks) in self.coupling.iter().enumerate() {
                for (inside, block) in blocks {
                    let part = nalgebra::SVector::<f64, D>::from_column_slice(&x[inside * D..][..D]);
                    let mut to = self.outside.fixed_view_mut::<D, 1>(l * D, column);
                    to -= block.tr_mul(&part);
                }
            }
        }
        Some((self.outside, self.outside_gradient))
    }
}
