#![doc = include_str!("../README.md")]

mod config;
mod effects;
mod imu_fault;
mod imu_feed;
mod live;
mod phone;
mod render;
mod smooth;
mod source;
mod structured;
mod texture;
mod walk;
mod world;
mod write;

pub use config::{CameraPath, SimConfig, SimSensor};
pub use effects::Effects;
pub use imu_fault::{FaultyImu, ImuFault, ImuFaultKind};
pub use live::LiveRig;
pub use phone::{MotionSensors, PhoneMotion, PhoneTraits, RollingCamera};
pub use render::Renderer;
pub use smooth::SmoothRig;
pub use source::SimSource;
pub use walk::{
    Agreement, BodyState, ContinuousTrajectory, ImuConfig, ImuTroubles, Stride, Walker, read_readings,
    read_tum,
};
pub use world::{Figure, NamedRoute, Passer, Thing, UnknownWorld, World, WorldKind, WorldOptions};
pub use write::{write_euroc, write_tum};
