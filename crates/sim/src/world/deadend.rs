//! A straight corridor that ends in plain walls: a camera that turns around there sees no texture during the turn.

use super::NamedRoute;
use super::build::Builder;
use super::corridor::{hallway, line_walls};
use super::furniture::Piece;
use super::plan::{self, Dress, Room};
use crate::texture::Material;

/// Length of the way out, metres.
const OUT_M: f64 = 20.0;
/// Where the route starts.
const START_M: f64 = 1.5;
/// How much of the corridor's end is plain, metres before the turn.
const PLAIN_M: f64 = 4.0;

/// A corridor of 2.4 m with a route of 20 m out and home again.
pub(super) fn build(b: &mut Builder) {
    let k = 2.4;
    let turn = START_M + OUT_M;
    let plain_from = turn - PLAIN_M;
    let dressed = hallway(&mut b.random, [0.0, 0.0, plain_from, k], 0);
    let plain = Room {
        area: [plain_from, 0.0, turn + 2.0, k],
        wall: Material::Plain(172.0),
        dress: Dress::Plain,
        stream: 1 | 1 << 40,
        ..dressed
    };
    let ends = [(START_M, k / 2.0), (turn, k / 2.0)];
    b.routes.push(NamedRoute::new("out-and-home", &[ends[0], ends[1], ends[0]]));
    b.routes.push(NamedRoute::new("out", &ends));
    plan::build(b, &[dressed, plain]);
    b.stream(0xF00D);
    let pieces = [Piece::Plant, Piece::Bench, Piece::Shelf, Piece::Cartons, Piece::Cabinet];
    line_walls(b, dressed.area, &pieces, 24, 0.5, dressed.height);
}
