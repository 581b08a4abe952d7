//! Textures: painted with band-limited shapes, kept as mip chains.

mod canvas;
mod decor;
mod lattice;
mod material;
mod mips;
mod noise;

pub(crate) use canvas::Canvas;
pub(crate) use decor::Decor;
pub(crate) use material::Material;
pub(crate) use mips::{Level, TILE, Texture};
pub(crate) use noise::Noise;
