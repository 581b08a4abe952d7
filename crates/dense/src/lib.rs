#![doc = include_str!("../README.md")]

mod backend;
mod block;
mod colour_image;
mod error;
mod export;
mod frame;
mod grid;
mod mesh;
mod noise;
mod occupancy;
mod photometric;
mod pixel;
mod prepare;
mod project;
mod pyramid;
mod raycast;
mod register;
mod rendered;
mod sample;
mod shaded;
mod submap;
mod track;
mod tsdf;
mod view;
pub mod walk;

pub use backend::Backend;
pub use block::BlockKey;
pub use colour_image::ColourImage;
pub use error::DenseError;
pub use export::{write_glb, write_heights, write_obj, write_ply};
pub use frame::DepthFrame;
pub use mesh::{Mesh, MeshConfig, Mesher, draw, overview};
pub use noise::DepthNoise;
pub use occupancy::{Occupancy, OccupancyConfig, OccupancyGrid};
pub use photometric::track_photometric;
pub use prepare::{DepthConfig, DepthPreparer};
pub use raycast::raycast;
pub use register::{RegisterConfig, Registration, Surface, SurfaceFeatures, Verdict, register};
pub use rendered::RayCast;
pub use shaded::ShadedView;
pub use submap::{
    AnchorId, ColumnChange, ColumnChanges, DenseMap, Followed, Located, Locator, MapId, PackedDepth,
    PackedGray, Place, Progress, SavedFrame, SavedSubmap, SubmapConfig, SubmapView, SurfaceChange,
    SurfaceChanges,
};
pub use track::{DenseTracked, TrackConfig, track, track_from};
pub use tsdf::{Fused, TsdfConfig, TsdfVolume};
