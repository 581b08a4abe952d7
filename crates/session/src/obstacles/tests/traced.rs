//! A depth sensor in the plane: rays to walls, furniture and things seen from above, remembered where they ended. It has no
//! noise and takes a fraction of the time of images.

use cairn_dense::walk::Blocked;
use cairn_geometry::Vec2;
use cairn_sim::{Thing, World};
use std::collections::BTreeMap;

/// Side of the cells that are remembered, metres.
const CELL_M: f64 = 0.05;
/// Half of the sensor's field of view, degrees, and its rays.
const HALF_DEG: f64 = 37.0;
const RAYS: i32 = 75;
const FARTHEST_M: f64 = 6.0;
/// Nearer to a surface than this a ray ends.
const ENDS_M: f64 = 0.02;

/// What was seen in the plane.
#[derive(Default)]
pub(super) struct Traced {
    /// With whether it is one of the things.
    cells: BTreeMap<[i32; 2], (Blocked, bool)>,
}

impl Traced {
    /// Looks from a place in a heading.
    pub fn look(&mut self, world: &World, things: &[Thing], at: Vec2, heading: f64) {
        for k in 0..RAYS {
            let angle = heading + HALF_DEG.to_radians() * (2.0 * f64::from(k) / f64::from(RAYS - 1) - 1.0);
            let ray = Vec2::new(angle.cos(), angle.sin());
            let mut far = 0.0;
            while far < FARTHEST_M {
                let p = at + ray * far;
                let thing = things.iter().min_by(|a, b| a.distance(&p).total_cmp(&b.distance(&p)));
                let to_thing = thing.map_or(f64::INFINITY, |t| t.distance(&p));
                let to_world = world.clearance(p.x, p.y);
                let left = to_world.min(to_thing);
                if left < ENDS_M {
                    let is_thing = to_thing < to_world;
                    let low_m = thing.filter(|_| is_thing).map_or(0.13, |t| t.base_m.max(0.13));
                    let cell = [p.x, p.y].map(|v| (v / CELL_M).floor() as i32);
                    let at = Vec2::new(f64::from(cell[0]) + 0.5, f64::from(cell[1]) + 0.5) * CELL_M;
                    self.cells.insert(cell, (Blocked { at, low_m, voxels: 8 }, is_thing));
                    break;
                }
                far += left;
            }
        }
        // What was taken away is seen to have gone.
        let stands = |at: &Vec2| things.iter().any(|t| t.distance(at) < 2.0 * CELL_M);
        self.cells.retain(|_, (b, is_thing)| !*is_thing || stands(&b.at));
    }

    /// What is known within a distance of a place.
    pub fn obstacles(&self, at: &Vec2, reach_m: f64) -> Vec<Blocked> {
        self.cells.values().map(|c| c.0).filter(|b| (b.at - at).norm() <= reach_m).collect()
    }
}
