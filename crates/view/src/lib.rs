#![doc = include_str!("../README.md")]

mod columns;
mod drawing;
mod frames;
mod keys;
mod model;
mod orbit;
mod read;
mod scene;
mod surface;
mod vector;

pub use columns::{Columns, Run, TILE, Tile};
pub use drawing::{By, Choice, Disc, Line, Marks, Palette, Shading, marks, round_length, shading};
pub use frames::{begin, read_message, walker, write_message};
pub use keys::{Act, KEYS, Key, key_of};
pub use model::{KeyFrame, Model};
pub use orbit::{Look, Orbit, ground};
pub use read::Malformed;
pub use scene::Scene;
pub use surface::{Block, Cube, Part, Surface};
pub use vector::V3;
