//! Cairn in Python: the native half of the package `cairn`, on numpy arrays. It holds no algorithm: each class is a view of
//! one of the facade's types, and `python/cairn/_cairn.pyi` says what its users see.
//!
//! Arrays that come in are copied once while the interpreter is held; the work itself runs without it, so that other
//! Python threads go on. Nothing of a caller's array is kept after a call.

// Without the feature there is nothing here: see Cargo.toml.
#![cfg(feature = "module")]

mod arrays;
mod config;
mod dense;
mod errors;
mod events;
mod fleet;
mod imu;
mod interrupt;
mod map;
mod output;
mod rig;
mod slam;
mod source;
mod trajectory;
mod walk;

use pyo3::prelude::*;

/// The native half of the package `cairn`; import that one.
#[pymodule(gil_used = true)]
fn _cairn(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<rig::Camera>()?;
    module.add_class::<rig::Imu>()?;
    module.add_class::<rig::Rig>()?;
    module.add_class::<config::Config>()?;
    module.add_class::<imu::ImuBatch>()?;
    module.add_class::<source::Source>()?;
    module.add_class::<source::Frame>()?;
    module.add_class::<slam::Slam>()?;
    output::add_to(module)?;
    events::add_to(module)?;
    walk::add_to(module)?;
    module.add_class::<map::Map>()?;
    module.add_class::<map::KeyFrames>()?;
    module.add_class::<map::Landmarks>()?;
    module.add_class::<trajectory::Trajectory>()?;
    module.add_class::<trajectory::Evaluation>()?;
    module.add_class::<dense::DenseVolume>()?;
    module.add_class::<dense::Mesh>()?;
    module.add_class::<dense::Voxels>()?;
    fleet::add_to(module)?;
    module.add_function(wrap_pyfunction!(source::open, module)?)?;
    module.add_function(wrap_pyfunction!(map::load_map, module)?)?;
    Ok(())
}
