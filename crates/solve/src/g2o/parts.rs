//! A graph that is several: which parts there are, and laying them beside each other.

use super::content::Named;
use crate::graph::Rigid;
use cairn_geometry::{LieGroup, Mat3, Vec3};
use std::collections::{BTreeMap, BTreeSet};

impl<G: LieGroup<D>, const D: usize> Named<G, D> {
    /// Parts without a measurement between them, as the vertices of each; all those that are fixed or known in the world are
    /// in one, the first. Poses of different parts mean nothing to each other.
    pub fn parts(&self) -> Vec<Vec<usize>> {
        let components = self.graph.components();
        let fixed = components.iter().zip(self.graph.fixed()).filter(|(_, fixed)| **fixed);
        let in_world: BTreeSet<usize> = fixed.map(|(c, _)| *c).collect();
        let mut parts: BTreeMap<Option<usize>, Vec<usize>> = BTreeMap::new();
        for (v, component) in components.iter().enumerate().take(self.ids.len()) {
            parts.entry(Some(*component).filter(|c| !in_world.contains(c))).or_default().push(v);
        }
        parts.into_values().collect()
    }
}

impl<G: Rigid<D>, const D: usize> Named<G, D> {
    /// Lays parts beside each other along x, each behind the one before it with a tenth of its length between: of a text
    /// without vertices all would begin at one spot.
    pub fn lay_apart(&mut self) {
        let mut end: Option<f64> = None;
        for part in self.parts() {
            let x = |v: &usize| self.graph.values()[*v].to_space().1.x;
            let least = part.iter().map(x).fold(f64::INFINITY, f64::min);
            let most = part.iter().map(x).fold(f64::NEG_INFINITY, f64::max);
            let by = end.map_or(0.0, |end| end - least);
            let moved = G::from_space(&Mat3::identity(), &Vec3::new(by, 0.0, 0.0));
            for v in part {
                self.graph.values_mut()[v] = moved.compose(&self.graph.values()[v]);
            }
            end = Some(most + by + (0.1 * (most - least)).max(1.0));
        }
    }
}
