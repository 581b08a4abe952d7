//! An office: a corridor with furnished rooms on both sides, each behind an open door.

use super::Way;
use super::build::Builder;
use super::corridor::{hallway, line_walls};
use super::furniture::Piece;
use super::plan::{self, Dress, Room};
use crate::texture::Material;
use cairn_geometry::Vec2;

const WALL: f64 = 0.16;
const DOOR: f64 = 1.0;

/// Four rooms on each side of a corridor of 2.4 m.
pub(super) fn build(b: &mut Builder) {
    let k = 2.4;
    let (wide, deep) = (b.random.range(5.2, 6.2), b.random.range(4.8, 5.6));
    let n = 4;
    let length = n as f64 * (wide + WALL) + 1.0;
    let mut rooms = vec![hallway(&mut b.random, [0.0, 0.0, length, k], 1)];
    let mut tour = vec![(1.2, k / 2.0)];
    let mut places = Vec::new();
    for i in 0..n {
        for side in [1.0, -1.0] {
            let x0 = 0.5 + i as f64 * (wide + WALL);
            let door_x = x0 + wide * b.random.range(0.3, 0.7);
            let (low, high) = if side > 0.0 { (k + WALL, k + WALL + deep) } else { (-WALL - deep, -WALL) };
            let index = rooms.len() as u64;
            let stream = if b.options.look_alike { 500 } else { index | 1 << 40 };
            b.stream(stream);
            let walls = [
                Material::Plaster(168.0),
                Material::Paper(165.0),
                Material::Plaster(145.0),
                Material::Brick(125.0),
            ];
            let floors = [Material::Carpet(105.0), Material::Planks(135.0), Material::Tiles(130.0, 0.5)];
            let (wall, floor) = (walls[b.random.below(4)], floors[b.random.below(3)]);
            rooms.push(Room {
                area: [x0, low, x0 + wide, high],
                height: 2.6,
                wall,
                floor,
                dress: Dress::Room,
                stream,
            });
            let jamb = if side > 0.0 {
                [door_x - DOOR / 2.0, k, door_x + DOOR / 2.0, k + WALL]
            } else {
                [door_x - DOOR / 2.0, -WALL, door_x + DOOR / 2.0, 0.0]
            };
            rooms.push(Room {
                area: jamb,
                height: 2.1,
                wall: Material::Board(90.0),
                floor: Material::Board(80.0),
                dress: Dress::Bare,
                stream: index | 1 << 41,
            });
            places.push((rooms.len() - 2, door_x, side));
            // The tour visits every second room, alternating sides: in, once round, out.
            if (i % 2 == 0) == (side > 0.0) {
                let (near, far) =
                    if side > 0.0 { (k + WALL + 0.9, high - 1.3) } else { (-WALL - 0.9, low + 1.3) };
                let (left, right) = (x0 + 1.3, x0 + wide - 1.3);
                tour.extend([
                    (door_x, k / 2.0),
                    (door_x, near),
                    (left, near),
                    (left, far),
                    (right, far),
                    (right, near),
                    (door_x, near),
                    (door_x, k / 2.0),
                ]);
            }
        }
    }
    tour.push((length - 1.2, k / 2.0));
    b.ways.push(Way::new("tour", &tour));
    b.ways.push(Way::new("there-and-back", &[&tour[..], &[(1.2, k / 2.0)]].concat()));
    b.ways.push(Way::new("straight", &[(1.2, k / 2.0), (length - 1.2, k / 2.0)]));
    let round: Vec<(f64, f64)> =
        (0..4).flat_map(|_| tour.clone().into_iter().chain([(1.2, k / 2.0)])).collect();
    let mut long = round;
    long.dedup();
    b.ways.push(Way::new("long", &long));
    plan::build(b, &rooms);
    for (index, door_x, side) in places {
        furnish(b, &rooms[index], door_x, side);
    }
    b.stream(77);
    line_walls(b, [0.0, 0.0, length, k], &[Piece::Plant, Piece::Cabinet, Piece::Shelf], 10, 0.5, 2.6);
}

/// Furniture along the walls and in the middle; the space before the door stays free.
fn furnish(b: &mut Builder, room: &Room, door_x: f64, side: f64) {
    b.stream(room.stream ^ 0xF00D);
    let [x0, y0, x1, y1] = room.area;
    let middle = Vec2::new(0.5 * (x0 + x1), 0.5 * (y0 + y1));
    let yaw =
        b.random.range(-0.3, 0.3) + if b.random.chance(0.5) { std::f64::consts::FRAC_PI_2 } else { 0.0 };
    for (piece, dx) in [(Piece::Desk, 0.0), (Piece::Chair, -0.75)] {
        let at = middle + Vec2::new(yaw.cos(), yaw.sin()) * dx;
        if b.has_room(at, piece.half(), yaw, 0.45) {
            piece.place(b, at, yaw, room.height);
        }
    }
    // A strip of half a metre on each side of the door stays empty.
    let keep = Way::new(
        "door",
        &[
            (door_x, if side > 0.0 { y0 - 0.3 } else { y1 + 0.3 }),
            (door_x, if side > 0.0 { y0 + 1.2 } else { y1 - 1.2 }),
        ],
    );
    b.ways.push(keep);
    let pieces =
        [Piece::Shelf, Piece::Cabinet, Piece::Plant, Piece::Sofa, Piece::Chair, Piece::Cartons, Piece::Shelf];
    line_walls(b, room.area, &pieces, 26, 0.5, room.height);
    b.ways.pop();
}
