//! An apartment: five furnished rooms around a corridor, with inner doors that make loops.

use super::NamedRoute;
use super::build::{Block, Builder};
use super::corridor::{hallway, line_walls};
use super::furniture::Piece;
use super::office::furnish;
use super::plan::{self, Dress, Room};
use crate::texture::{Decor, Material};
use cairn_geometry::{Vec2, Vec3};
use std::f64::consts::FRAC_PI_2;

/// Thickness of walls, metres.
const WALL: f64 = 0.16;
/// Width of doors, metres.
const DOOR: f64 = 1.0;
/// Height of doors, metres.
const DOOR_HEIGHT: f64 = 2.1;
/// Height of rooms, metres.
const HEIGHT: f64 = 2.6;
/// Width of the corridor, metres.
const CORRIDOR: f64 = 1.9;
/// Names of the rooms: three above the corridor, two below it.
const NAMES: [&str; 5] = ["bedroom", "study", "bathroom", "kitchen", "living room"];

/// A door as a rectangle of floor: the jamb.
struct Jamb {
    area: [f64; 4],
}

impl Jamb {
    /// In a wall along x whose lower side is at `y`.
    fn along_x(x: f64, y: f64) -> Self {
        Self { area: [x - DOOR / 2.0, y, x + DOOR / 2.0, y + WALL] }
    }

    /// In a wall along y whose left side is at `x`.
    fn along_y(x: f64, y: f64) -> Self {
        Self { area: [x, y - DOOR / 2.0, x + WALL, y + DOOR / 2.0] }
    }

    fn middle(&self) -> Vec2 {
        let [x0, y0, x1, y1] = self.area;
        Vec2::new(0.5 * (x0 + x1), 0.5 * (y0 + y1))
    }

    /// The closed leaf: its ends.
    fn leaf(&self) -> (Vec2, Vec2) {
        let [x0, y0, x1, y1] = self.area;
        let half = if x1 - x0 > y1 - y0 { Vec2::new(DOOR / 2.0, 0.0) } else { Vec2::new(0.0, DOOR / 2.0) };
        (self.middle() - half, self.middle() + half)
    }
}

/// Three rooms above a corridor and two below it. The first door leads from the corridor into the first room, which has a
/// second one from its neighbour.
pub(super) fn build(b: &mut Builder) {
    let r = &mut b.random;
    let widths = [r.range(3.6, 4.4), r.range(3.6, 4.4), r.range(3.6, 4.4)];
    let (above, below) = (r.range(3.6, 4.4), r.range(3.6, 4.4));
    let length = widths.iter().sum::<f64>() + 2.0 * WALL;
    let split = 0.5 * (length - WALL) + r.range(-0.5, 0.5);
    let (low, high) = (CORRIDOR + WALL, CORRIDOR + WALL + above);
    let second = widths[0] + WALL;
    let third = second + widths[1] + WALL;
    let areas = [
        [0.0, low, widths[0], high],
        [second, low, second + widths[1], high],
        [third, low, length, high],
        [0.0, -WALL - below, split, -WALL],
        [split + WALL, -WALL - below, length, -WALL],
    ];
    let mut jambs = Vec::new();
    for (i, [x0, _, x1, _]) in areas.iter().enumerate() {
        let x = x0 + (x1 - x0) * r.range(0.3, 0.7);
        jambs.push(Jamb::along_x(x, if i < 3 { CORRIDOR } else { -WALL }));
    }
    let inner = [(widths[0], low + above * r.range(0.4, 0.65)), (split, -WALL - below * r.range(0.4, 0.65))];
    jambs.extend(inner.map(|(x, y)| Jamb::along_y(x, y)));
    let spots = areas.map(|[x0, y0, x1, y1]| {
        Vec2::new(x0 + (x1 - x0) * r.range(0.35, 0.65), y0 + (y1 - y0) * r.range(0.4, 0.6))
    });
    let mut rooms = vec![hallway(r, [0.0, 0.0, length, CORRIDOR], 1)];
    for (i, area) in areas.into_iter().enumerate() {
        rooms.push(furnished_room(b, area, 2 + i as u64));
    }
    rooms.extend(jambs.iter().enumerate().map(|(i, jamb)| Room {
        area: jamb.area,
        height: DOOR_HEIGHT,
        wall: Material::Board(90.0),
        floor: Material::Board(80.0),
        dress: Dress::Bare,
        stream: i as u64 | 1 << 41,
    }));
    let tour = tour(&jambs, &spots, length);
    b.routes.push(NamedRoute::new("tour", &tour));
    let middle = CORRIDOR / 2.0;
    b.routes.push(NamedRoute::new("corridor", &[(1.0, middle), (length - 1.0, middle)]));
    plan::build(b, &rooms);
    for (i, room) in rooms[1..6].iter().enumerate() {
        furnish(b, room, NamedRoute { name: "kept free".into(), points: vec![spots[i], spots[i]] });
    }
    b.stream(0xF00D);
    line_walls(b, rooms[0].area, &[Piece::Plant, Piece::Shelf, Piece::Cabinet], 5, 0.5, HEIGHT);
    b.places.extend(NAMES.iter().zip(spots).map(|(name, at)| ((*name).to_owned(), at)));
    b.doors.extend(jambs.iter().map(Jamb::leaf));
    if let Some(jamb) = b.options.closed_door.and_then(|door| jambs.get(door)) {
        close(b, jamb);
    }
}

fn furnished_room(b: &mut Builder, area: [f64; 4], stream: u64) -> Room {
    b.stream(stream | 1 << 40);
    let walls =
        [Material::Plaster(168.0), Material::Paper(165.0), Material::Plaster(145.0), Material::Brick(125.0)];
    let floors = [Material::Carpet(105.0), Material::Planks(135.0), Material::Tiles(130.0, 0.5)];
    let (wall, floor) = (walls[b.random.below(4)], floors[b.random.below(3)]);
    Room { area, height: HEIGHT, wall, floor, dress: Dress::Room, stream: stream | 1 << 40 }
}

/// Through all rooms and doors, from the left end of the corridor and back to it.
fn tour(jambs: &[Jamb], spots: &[Vec2; 5], length: f64) -> Vec<(f64, f64)> {
    let middle = CORRIDOR / 2.0;
    let beside = |jamb: usize, by: Vec2| jambs[jamb].middle() + by;
    let (up, right) = (Vec2::new(0.0, 0.7), Vec2::new(0.7, 0.0));
    let out = |jamb: usize| Vec2::new(jambs[jamb].middle().x, middle);
    let through = |jamb: usize, by: Vec2| [beside(jamb, -by), beside(jamb, by)];
    let mut line = vec![Vec2::new(1.0, middle), out(0)];
    line.extend([beside(0, up), spots[0]]);
    line.extend(through(5, right));
    line.extend([spots[1], beside(1, up), out(1), out(2), beside(2, up), spots[2], beside(2, up), out(2)]);
    line.extend([out(4), beside(4, -up), spots[4]]);
    line.extend(through(6, -right));
    line.extend([spots[3], beside(3, -up), out(3), Vec2::new(1.0, middle)]);
    line.iter().map(|p| (p.x.clamp(0.0, length), p.y)).collect()
}

/// Fills a door with its leaf.
fn close(b: &mut Builder, jamb: &Jamb) {
    let at = jamb.middle();
    let along_x = jamb.area[2] - jamb.area[0] > jamb.area[3] - jamb.area[1];
    let yaw = if along_x { FRAC_PI_2 } else { 0.0 };
    b.add_obstacle(at, Vec2::new(0.025, DOOR / 2.0), yaw);
    b.stream(0xD002);
    let size = Vec3::new(0.05, DOOR, DOOR_HEIGHT);
    b.block(&Block { at, base: 0.0, size, yaw, texel: 0.004 }, |_, c, r| {
        Material::Planks(120.0).coat(c);
        Decor::wear(c, r, 4.0, 50.0);
        let (w, h) = (c.width_m(), c.height_m());
        c.frame(0.12, 0.15, w - 0.24, 0.8, 0.03, 60.0);
        c.frame(0.12, h - 1.0, w - 0.24, 0.85, 0.03, 60.0);
        c.rect(w - 0.12, h - 1.05, 0.08, 0.03, 225.0, 1.0);
    });
}

#[cfg(test)]
mod tests {
    use crate::{World, WorldKind, WorldOptions};

    #[test]
    fn a_closed_door_is_the_only_difference() {
        let open = WorldOptions { detail: 0.05, ..Default::default() };
        for seed in 0..4 {
            let world = World::build(WorldKind::Apartment, seed, &open);
            assert_eq!((world.places().len(), world.doors().len()), (5, 7));
            for (name, at) in world.places() {
                assert!(world.clearance(at.x, at.y) > 0.35, "seed {seed}: {name}");
            }
            let (a, b) = world.doors()[0];
            let middle = (a + b) / 2.0;
            assert!(world.clearance(middle.x, middle.y) > 0.4);
            let closed =
                World::build(WorldKind::Apartment, seed, &WorldOptions { closed_door: Some(0), ..open });
            assert!(!closed.is_free(middle.x, middle.y));
            assert_eq!(closed.plan().len(), world.plan().len() + 4);
            assert_eq!(closed.plan()[..world.plan().len()], *world.plan());
        }
    }
}
