#![doc = include_str!("../README.md")]

mod effects;
mod feel;
mod live;
mod random;
mod render;
mod setting;
mod source;
mod texture;
mod walk;
mod world;
mod write;

pub use effects::Effects;
pub use live::LiveRig;
pub use render::Renderer;
pub use setting::{Route, SimSensor, SimSetting};
pub use source::SimSource;
pub use walk::{
    Agreement, BodyState, GRAVITY_M_S2, ImuSetting, ImuTroubles, Motion, Stride, Walker, read_readings,
    read_tum,
};
pub use world::{Figure, Passer, Way, World, WorldKind, WorldOptions};
pub use write::{write_euroc, write_tum};
