#![doc = include_str!("../README.md")]

mod by_tracks;
mod clocks;
mod closing;
mod cull;
mod depth_views;
mod disparity;
mod fuse;
mod gravity_refinement;
#[cfg(test)]
#[path = "../../adjust/tests/suite/common/imu_walk.rs"]
mod imu_walk;
mod inertial;
mod initialisation;
mod insert;
mod mapper;
#[cfg(test)]
mod mapper_tests;
mod recent;
mod rotation_only;
mod scale_check;
#[cfg(test)]
#[path = "../../adjust/tests/suite/common/mod.rs"]
mod synthetic;
#[cfg(test)]
mod tests;
mod triangulation;
mod windows;

#[doc(no_inline)]
pub use cairn_adjust::Recognised;
pub use closing::{
    Accepted, Adjust, Agreement, Apart, Closed, Closer, CloserConfig, FusedScales, INDEPENDENT_M,
    INDEPENDENT_RAD, Joined, Junction, MapComparison, MapJoin, Refusal, SAME_PLACE_M, SAME_WAY_COS,
    ScaleConflict, Seam, Support, Verdict,
};
pub use depth_views::DepthViews;
pub use inertial::InertialConfig;
pub use initialisation::{CameraAndImu, initialise_key_frames};
pub use mapper::{KeyFrameInput, MapStart, Mapped, Mapper, MapperConfig, StartClocks};
pub use scale_check::{ScaleCheck, ScaleVerdict};
