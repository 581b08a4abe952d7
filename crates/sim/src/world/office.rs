//! An office: a corridor with furnished rooms on both sides, each behind an open door.

use super::NamedRoute;
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
    let (wide, deep) = (b.random.uniform(5.2, 6.2), b.random.uniform(4.8, 5.6));
    let n = 4;
    let length = n as f64 * (wide + WALL) + 1.0;
    let mut rooms = vec![hallway(&mut b.random, [0.0, 0.0, length, k], 1)];
    let mut tour = vec![(1.2, k / 2.0)];
    let mut places = Vec::new();
    for i in 0..n {
        for side in [1.0, -1.0] {
            let x0 = 0.5 + i as f64 * (wide + WALL);
            let (low, high) = if side > 0.0 { (k + WALL, k + WALL + deep) } else { (-WALL - deep, -WALL) };
            let index = rooms.len() as u64;
            let stream = if b.options.look_alike { 500 } else { index | 1 << 40 };
            b.stream(stream);
            let door_x = x0 + wide * b.random.uniform(0.3, 0.7);
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
            let (near, far) =
                if side > 0.0 { (k + WALL + 0.9, high - 1.3) } else { (-WALL - 0.9, low + 1.3) };
            let (left, right, out) = (x0 + 1.3, x0 + wide - 1.3, (door_x, k / 2.0));
            let inside =
                [(door_x, near), (left, near), (left, far), (right, far), (right, near), (door_x, near)];
            // The tour visits every second room, alternating sides: in, once round, out.
            if (i % 2 == 0) == (side > 0.0) {
                tour.push(out);
                tour.extend(inside);
                tour.push(out);
            }
            // Rooms that look alike keep the same places free whether they are visited or not.
            let keep = if b.options.look_alike { &inside[..] } else { &[(door_x, near)] };
            let keep = [&[out], keep].concat();
            places.push((rooms.len() - 2, NamedRoute::new("kept free", &keep)));
        }
    }
    tour.push((length - 1.2, k / 2.0));
    b.routes.push(NamedRoute::new("tour", &tour));
    b.routes.push(NamedRoute::new("there-and-back", &[&tour[..], &[(1.2, k / 2.0)]].concat()));
    b.routes.push(NamedRoute::new("straight", &[(1.2, k / 2.0), (length - 1.2, k / 2.0)]));
    let round: Vec<(f64, f64)> =
        (0..4).flat_map(|_| tour.clone().into_iter().chain([(1.2, k / 2.0)])).collect();
    let mut long = round;
    long.dedup();
    b.routes.push(NamedRoute::new("long", &long));
    plan::build(b, &rooms);
    for (index, keep) in places {
        furnish(b, &rooms[index], keep);
    }
    b.stream(77);
    line_walls(b, [0.0, 0.0, length, k], &[Piece::Plant, Piece::Cabinet, Piece::Shelf], 10, 0.5, 2.6);
}

/// Furniture along the walls and in the middle, clear of the routes and of places that must stay free.
pub(super) fn furnish(b: &mut Builder, room: &Room, keep: NamedRoute) {
    b.routes.push(keep);
    b.stream(room.stream ^ 0xF00D);
    let [x0, y0, x1, y1] = room.area;
    let middle = Vec2::new(0.5 * (x0 + x1), 0.5 * (y0 + y1));
    let yaw =
        b.random.uniform(-0.3, 0.3) + if b.random.chance(0.5) { std::f64::consts::FRAC_PI_2 } else { 0.0 };
    for (piece, dx) in [(Piece::Desk, 0.0), (Piece::Chair, -0.75)] {
        let at = middle + Vec2::new(yaw.cos(), yaw.sin()) * dx;
        if b.has_room(at, piece.half(), yaw, 0.45) {
            piece.place(b, at, yaw, room.height);
        }
    }
    let pieces =
        [Piece::Shelf, Piece::Cabinet, Piece::Plant, Piece::Sofa, Piece::Chair, Piece::Cartons, Piece::Shelf];
    line_walls(b, room.area, &pieces, 26, 0.5, room.height);
    b.routes.pop();
}

#[cfg(test)]
mod tests {
    use crate::{Renderer, World, WorldKind, WorldOptions};
    use cairn_geometry::{Se3, So3, Vec3};
    use cairn_sensor::{Camera, GrayImage};
    use std::sync::Arc;

    /// Mean difference in grey levels between the same view in two rooms on the same side.
    fn difference(look_alike: bool) -> f64 {
        let options = WorldOptions { look_alike, detail: 0.3, ..Default::default() };
        let world = Arc::new(World::build(WorldKind::Office, 3, &options));
        let mut renderer =
            Renderer::new(&world, Camera::pinhole(160, 120, 105.0, 105.0, 79.5, 59.5)).unwrap();
        // Areas: the corridor, then a room and its door for each side in turn.
        let mut view = |room: usize| {
            let area = world.areas[room];
            let along_y = nalgebra::Matrix3::from_columns(&[Vec3::x(), -Vec3::z(), Vec3::y()]);
            let pose = Se3::new(So3::from_matrix(&along_y), Vec3::new(area[0] + 1.3, area[1] + 0.7, 1.3));
            let mut image = GrayImage::new(1, 1);
            renderer.render(&pose, &mut image, None);
            image
        };
        let (a, b) = (view(1), view(5));
        let sum: i64 =
            a.data().iter().zip(b.data()).map(|(a, b)| (i64::from(*a) - i64::from(*b)).abs()).sum();
        sum as f64 / a.data().len() as f64
    }

    #[test]
    fn rooms_look_alike_only_with_the_option() {
        let (same, other) = (difference(true), difference(false));
        assert!(same < 1.0, "{same} grey levels between rooms that look alike");
        assert!(other > 15.0, "{other} grey levels between rooms that do not");
    }
}
