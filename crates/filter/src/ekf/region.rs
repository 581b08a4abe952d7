//! The active region and the passive store outside it.

use super::active::Active;
use super::passive::Passive;
use cairn_geometry::Vec2;
use nalgebra::Matrix2;

/// The active region and the passive store outside it.
#[derive(Clone, Debug)]
pub(crate) struct Region {
    pub radius_m: f64,
    pub passive: Passive,
    /// Positions of the robots when the region was chosen.
    pub centres: Vec<Vec2>,
}

impl Region {
    pub fn new(radius_m: f64) -> Self {
        Self { radius_m, passive: Passive::default(), centres: Vec::new() }
    }

    pub fn settle(&mut self) {
        self.passive.settle();
    }

    pub fn release(&mut self, store: usize) {
        self.passive.release(store);
    }

    pub fn landmark(&self, active: &Active, store: usize) -> (Vec2, Matrix2<f64>) {
        self.passive.landmark(active, store)
    }
}
