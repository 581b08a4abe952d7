//! The results of the last sightings of a robot, by which recovery is judged.

use nalgebra::Matrix3;
use std::collections::VecDeque;

/// The results of the last sightings, and how much uncertainty motion has added meanwhile.
#[derive(Clone, Debug)]
pub(crate) struct Recent {
    window: usize,
    pub rejected: VecDeque<bool>,
    /// Largest position and angle variance that motion added since the last accepted sighting.
    pub position: f64,
    pub angle: f64,
}

impl Recent {
    pub fn new(window: usize) -> Self {
        Self { window: window.max(1), rejected: VecDeque::new(), position: 0.0, angle: 0.0 }
    }

    pub fn moved(&mut self, covariance: &Matrix3<f64>) {
        self.position += covariance[(0, 0)].max(covariance[(1, 1)]);
        self.angle += covariance[(2, 2)];
    }

    pub fn judged(&mut self, rejected: bool) {
        self.rejected.push_back(rejected);
        if self.rejected.len() > self.window {
            self.rejected.pop_front();
        }
        if !rejected {
            (self.position, self.angle) = (0.0, 0.0);
        }
    }

    pub fn fraction(&self) -> f64 {
        self.rejected.iter().filter(|r| **r).count() as f64 / self.window as f64
    }
}
