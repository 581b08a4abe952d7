//! A named route through a world.

use cairn_geometry::Vec2;

/// A polyline on the floor with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedRoute {
    /// Its name inside the world.
    pub name: String,
    /// Corners in the world's x and y, metres.
    pub points: Vec<Vec2>,
}

impl NamedRoute {
    /// From a name and corners.
    pub fn new(name: &str, points: &[(f64, f64)]) -> Self {
        Self { name: name.into(), points: points.iter().map(|&(x, y)| Vec2::new(x, y)).collect() }
    }

    /// Metres from the first corner to the last.
    pub fn length(&self) -> f64 {
        self.points.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }

    /// The same corners in reverse order.
    pub fn reversed(&self, name: &str) -> Self {
        Self { name: name.into(), points: self.points.iter().rev().copied().collect() }
    }
}
