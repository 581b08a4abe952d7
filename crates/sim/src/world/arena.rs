//! One empty room: walls covered with pictures up to the ceiling, a textured floor, furniture along the walls.

use super::NamedRoute;
use super::build::Builder;
use super::corridor::line_walls;
use super::furniture::Piece;
use super::plan::{self, Dress, Room};
use crate::texture::Material;

/// A room of the size in the options.
pub(super) fn build(b: &mut Builder) {
    let [w, d, height] = b.options.size_m.unwrap_or([10.0, 8.0, 4.0]);
    let walls = [Material::Brick(120.0), Material::Plaster(160.0), Material::Paper(165.0)];
    let floors = [Material::Tiles(130.0, 0.6), Material::Planks(120.0), Material::Tiles(140.0, 0.35)];
    let room = Room {
        area: [0.0, 0.0, w, d],
        height,
        wall: walls[b.random.below(3)],
        floor: floors[b.random.below(3)],
        dress: Dress::Gallery,
        stream: 5 | 1 << 40,
    };
    let (mx, my) = (1.8f64.min(0.3 * w), 1.8f64.min(0.3 * d));
    b.routes
        .push(NamedRoute::new("loop", &[(mx, my), (w - mx, my), (w - mx, d - my), (mx, d - my), (mx, my)]));
    plan::build(b, &[room]);
    b.stream(0xA2E4A);
    let pieces = [Piece::Shelf, Piece::Cabinet, Piece::Plant, Piece::Bench, Piece::Cartons];
    line_walls(b, room.area, &pieces, (1.2 * (w + d)) as usize, 0.6, height);
}
