//! The normal equations of a graph: where each edge's blocks go, and what they are at a state.

use super::condensed::{CondensedLinear, pair_indices};
use super::{Edge, Metric, PoseGraph, residual};
use crate::Loss;
use crate::sparse::Analysis;
use cairn_geometry::LieGroup;
use nalgebra::{SMatrix, SVector};

/// Block rows of the free vertices, and blocks of the edges between them.
pub struct Layout {
    /// Place of each vertex among the free ones.
    pub slot: Vec<Option<u32>>,
    /// For each edge between free vertices the index of its block.
    pub pair: Vec<Option<u32>>,
    /// The same for the pairs of each condensed part.
    pub condensed_pair: Vec<Vec<Option<u32>>>,
    pub analysis: Analysis,
}

impl Layout {
    pub fn new<G: LieGroup<D>, const D: usize>(held: &[bool], graph: &PoseGraph<G, D>) -> Self {
        let mut free = 0;
        let slot: Vec<Option<u32>> = held
            .iter()
            .map(|held| {
                (!held).then(|| {
                    free += 1;
                    free - 1
                })
            })
            .collect();
        let ends = |a: usize, b: usize| Some((slot[a]? as usize, slot[b]? as usize));
        let pairs = graph.edges.iter().map(|e| (e.a, e.b));
        let all = pairs.chain(graph.condensed.iter().flat_map(|c| c.pairs()));
        let analysis = Analysis::new(free as usize, D, all.filter_map(|(a, b)| ends(a, b)));
        let place =
            |(a, b): (usize, usize)| ends(a, b).and_then(|(a, b)| analysis.pair(a, b)).map(|p| p as u32);
        let pair = graph.edges.iter().map(|e| place((e.a, e.b))).collect();
        let condensed_pair = graph.condensed.iter().map(|c| c.pairs().map(place).collect()).collect();
        Self { slot, pair, condensed_pair, analysis }
    }
}

/// A square matrix by columns.
pub type Block<const D: usize> = [[f64; D]; D];

/// The system at one state: `H` by blocks, the gradient, and the cost.
#[derive(Clone)]
pub struct Normal<const D: usize> {
    pub diagonal: Vec<Block<D>>,
    pub off_diagonal: Vec<Block<D>>,
    pub gradient: Vec<[f64; D]>,
    pub cost: f64,
}

impl<const D: usize> Normal<D> {
    /// Room for the system.
    pub fn new(layout: &Layout) -> Self {
        let (n, pairs) = (layout.analysis.rows(), layout.analysis.pairs().len());
        Self {
            diagonal: vec![[[0.0; D]; D]; n],
            off_diagonal: vec![[[0.0; D]; D]; pairs],
            gradient: vec![[0.0; D]; n],
            cost: 0.0,
        }
    }

    /// Linearises all edges and condensed parts of the graph at `values`.
    pub fn fill<G: LieGroup<D>>(
        &mut self,
        layout: &Layout,
        values: &[G],
        graph: &PoseGraph<G, D>,
        metric: Metric,
    ) {
        self.diagonal.fill([[0.0; D]; D]);
        self.off_diagonal.fill([[0.0; D]; D]);
        self.gradient.fill([0.0; D]);
        self.cost = 0.0;
        for (edge, pair) in graph.edges.iter().zip(&layout.pair) {
            let l = Linear::new(edge, &values[edge.a], &values[edge.b], metric);
            self.cost += 0.5 * l.loss;
            let (a, b) = (layout.slot[edge.a], layout.slot[edge.b]);
            if let Some(b) = b {
                add(&mut self.diagonal[b as usize], &l.by_b);
                add(std::slice::from_mut(&mut self.gradient[b as usize]), &l.gradient_b);
            }
            if let Some(a) = a {
                // The error moves with `a` as with `b`, through the adjoint and with the other sign.
                let across = -l.adjoint.tr_mul(&l.by_b);
                add(&mut self.diagonal[a as usize], &-(across * l.adjoint));
                add(std::slice::from_mut(&mut self.gradient[a as usize]), &-l.adjoint.tr_mul(&l.gradient_b));
                if let (Some(b), Some(pair)) = (b, pair) {
                    let block = &mut self.off_diagonal[*pair as usize];
                    if a > b { add(block, &across) } else { add(block, &across.transpose()) }
                }
            }
        }
        for (part, pairs) in graph.condensed.iter().zip(&layout.condensed_pair) {
            self.add_condensed(layout, &part.linearise(values), part.vertices(), pairs);
        }
        self.hold_untouched();
    }

    /// A rotation that no measurement touches (that of a point) has rows of zeros: with a one on the diagonal it stays.
    fn hold_untouched(&mut self) {
        let translations = if D == 3 { 2 } else { 3 };
        for block in &mut self.diagonal {
            for k in translations..D {
                if block[k][k] == 0.0 {
                    block[k][k] = 1.0;
                }
            }
        }
    }

    fn add_condensed(
        &mut self,
        layout: &Layout,
        linear: &CondensedLinear<D>,
        vertices: &[usize],
        pairs: &[Option<u32>],
    ) {
        self.cost += linear.cost;
        for (k, v) in vertices.iter().enumerate() {
            if let Some(s) = layout.slot[*v] {
                add(&mut self.diagonal[s as usize], &linear.block(k, k));
                add(std::slice::from_mut(&mut self.gradient[s as usize]), &linear.gradient[k]);
            }
        }
        for ((k, l), pair) in pair_indices(vertices.len()).zip(pairs) {
            let (Some(pair), Some(row), Some(column)) =
                (pair, layout.slot[vertices[k]], layout.slot[vertices[l]])
            else {
                continue;
            };
            let block = linear.block(k, l);
            let to = &mut self.off_diagonal[*pair as usize];
            if row > column { add(to, &block) } else { add(to, &block.transpose()) }
        }
    }

    /// The diagonal with `lambda` times its own entries added.
    pub fn damped(&self, lambda: f64) -> Vec<Block<D>> {
        let mut diagonal = self.diagonal.clone();
        for block in &mut diagonal {
            for k in 0..D {
                block[k][k] += lambda * block[k][k].max(1e-12);
            }
        }
        diagonal
    }
}

/// Adds a matrix to one that is stored by columns.
fn add<const R: usize, const C: usize>(to: &mut [[f64; R]], m: &SMatrix<f64, R, C>) {
    for (to, column) in to.iter_mut().zip(&m.data.0) {
        to.iter_mut().zip(column).for_each(|(t, v)| *t += v);
    }
}

/// An edge at a state.
pub struct Linear<const D: usize> {
    /// Robust loss of the squared whitened residual.
    pub loss: f64,
    /// `J^T W J` by the second vertex.
    pub by_b: SMatrix<f64, D, D>,
    pub gradient_b: SVector<f64, D>,
    /// Adjoint of `b^-1 * a`.
    pub adjoint: SMatrix<f64, D, D>,
}

impl<const D: usize> Linear<D> {
    pub fn new<G: LieGroup<D>>(edge: &Edge<G, D>, a: &G, b: &G, metric: Metric) -> Self {
        let relative = a.inverse().compose(b);
        let error = edge.a_from_b.inverse().compose(&relative);
        let metric = edge.metric(metric);
        let r = residual(&error, metric);
        let j = match metric {
            Metric::Geodesic => error.coordinates_jacobian(),
            Metric::Chordal => error.chordal_jacobian(),
        };
        let weighted = edge.information * r;
        let chi2 = r.dot(&weighted);
        let (loss, weight) = edge.loss.of(chi2);
        let mut by_b = j.tr_mul(&(edge.information * j));
        let mut gradient_b = j.tr_mul(&weighted);
        if edge.loss != Loss::Squared {
            by_b *= weight;
            gradient_b *= weight;
        }
        Self { loss, by_b, gradient_b, adjoint: relative.inverse().adjoint() }
    }
}
