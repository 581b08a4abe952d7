//! Things that are put into a finished world and taken out again: boxes on the floor or hanging in the air.

use super::build::{sides, turned};
use super::footprint::Footprint;
use super::{Face, World};
use cairn_geometry::{Vec2, Vec3};

/// A box that stands or hangs in the way; it is seen by cameras and depth sensors, but is in no floor plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thing {
    /// Middle of its base on the floor, metres.
    pub at: Vec2,
    /// Height of its lower side above the floor, metres.
    pub base_m: f64,
    /// Sizes along its own x (depth), y (width) and z (height), metres.
    pub size: Vec3,
    /// Angle of its x axis, radians.
    pub yaw: f64,
}

impl Thing {
    /// Metres from a place on the floor to its outline seen from above; negative inside.
    pub fn distance(&self, p: &Vec2) -> f64 {
        Footprint { centre: self.at, half: 0.5 * self.size.xy(), yaw: self.yaw }.distance(p)
    }

    /// Its sides as faces, painted with clothes of the world's figures.
    pub(crate) fn faces(&self, world: &World) -> Vec<Face> {
        let Some((texture, texels_per_m)) = world.wardrobe.first().map(|w| w.cloth()) else {
            return Vec::new();
        };
        let middle = Vec3::new(self.at.x, self.at.y, self.base_m + self.size.z / 2.0);
        sides(&middle, &turned(self.yaw), &self.size)
            .into_iter()
            .map(|(_, (frame, w, h))| {
                let corners = vec![Vec2::zeros(), Vec2::new(w, 0.0), Vec2::new(w, h), Vec2::new(0.0, h)];
                Face::new(frame, corners, texture, texels_per_m)
            })
            .collect()
    }
}
