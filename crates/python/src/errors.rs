//! The facade's errors as the exceptions of `cairn._errors`.

use pyo3::prelude::*;
use std::ffi::CString;

pyo3::import_exception!(cairn._errors, Error);
pyo3::import_exception!(cairn._errors, SourceError);
pyo3::import_exception!(cairn._errors, RigError);
pyo3::import_exception!(cairn._errors, ConfigError);
pyo3::import_exception!(cairn._errors, FrameError);
pyo3::import_exception!(cairn._errors, DataWarning);
pyo3::import_exception!(cairn._errors, MapError);
pyo3::import_exception!(cairn._errors, RouteError);
pyo3::import_exception!(cairn._errors, RefusedError);
pyo3::import_exception!(cairn._errors, TrajectoryError);
pyo3::import_exception!(cairn._errors, DenseError);

/// The exception for an error of the facade, with its message.
pub fn raise(error: impl Into<cairn::Error>) -> PyErr {
    use cairn::Error as E;
    let error = error.into();
    let words = error.to_string();
    match error {
        E::Source(_) => SourceError::new_err(words),
        E::Rig(_) => RigError::new_err(words),
        E::Config(_) | E::Rate(_) => ConfigError::new_err(words),
        E::Frame { .. } => FrameError::new_err(words),
        E::MapFile(_) | E::OpenMap(_) | E::EmptyMap | E::MappingStopped => MapError::new_err(words),
        E::Route(_) => RouteError::new_err(words),
        E::Refused(_) => RefusedError::new_err(words),
        E::Trajectory(_) | E::Evaluation(_) => TrajectoryError::new_err(words),
        _ => Error::new_err(words),
    }
}

/// Issues each doubt as a `DataWarning` of the line that called; an error where the user's filters make it one.
pub fn warn(py: Python<'_>, doubts: &[String]) -> PyResult<()> {
    let category = py.get_type::<DataWarning>();
    doubts.iter().try_for_each(|doubt| PyErr::warn(py, &category, &CString::new(doubt.as_str())?, 1))
}

/// The exception for a dense surface that refuses its input.
pub fn raise_dense(error: cairn::dense::DenseError) -> PyErr {
    DenseError::new_err(error.to_string())
}
