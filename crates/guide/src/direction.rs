//! Sides and directions as a walker hears them.

use serde::{Deserialize, Serialize};

/// A side of the walker's own body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Left.
    Left,
    /// Right.
    Right,
}

/// The class of a direction, with limits at 20, 60, 120 and 150 degrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Below 20 degrees.
    Straight,
    /// 20 to 60.
    Slight(Side),
    /// 60 to 120.
    Turn(Side),
    /// 120 to 150.
    Sharp(Side),
    /// Above 150.
    Around,
}

impl Side {
    /// The side of an angle in radians, positive to the left.
    pub fn of(angle_rad: f64) -> Self {
        if angle_rad >= 0.0 { Side::Left } else { Side::Right }
    }

    /// Its name in the catalogue.
    pub fn name(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }
}

impl Direction {
    /// The class of an angle in radians, positive to the left, within plus and minus pi.
    pub fn of(angle_rad: f64) -> Self {
        let (deg, side) = (angle_rad.abs().to_degrees(), Side::of(angle_rad));
        match deg {
            d if d < 20.0 => Direction::Straight,
            d if d < 60.0 => Direction::Slight(side),
            d if d < 120.0 => Direction::Turn(side),
            d if d <= 150.0 => Direction::Sharp(side),
            _ => Direction::Around,
        }
    }
}
