#![doc = include_str!("../README.md")]

mod altered;
pub mod build;
pub mod busy;
#[cfg(unix)]
pub mod city;
pub mod dense;
mod drawn;
pub mod ekf;
pub mod error;
pub mod figures;
pub mod graphs;
pub mod guide;
pub mod halves;
pub mod inertial;
#[cfg(unix)]
pub mod kills;
pub mod live;
pub mod memory;
pub mod newcomers;
pub mod nextday;
pub mod pages;
pub mod places;
pub mod processor;
pub mod robot;
pub mod run;
pub mod scale_sigma;
pub mod scenario;
pub mod source;
pub mod spot;
pub mod store;
pub mod street;
pub mod surface;

pub use cairn_engine::Sensors;
pub use error::MeasureError;
pub use run::{Figures, RunOptions, measure};

use std::path::{Path, PathBuf};

/// The folder of the recordings: `CAIRN_DATA`, else `../shared/data` beside the checkout.
pub fn data_folder() -> PathBuf {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    std::env::var_os("CAIRN_DATA").map_or_else(|| Path::new(beside).to_path_buf(), PathBuf::from)
}
