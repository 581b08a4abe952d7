//! Why something could not be measured: any error, with what it is of.

use std::error::Error;
use std::fmt::Display;
use std::path::Path;

/// Why something could not be measured. Nothing but people reads it.
pub type MeasureError = Box<dyn Error + Send + Sync>;

/// An error of one of several things that are measured.
pub fn of(what: impl Display, source: impl Display) -> MeasureError {
    format!("{what}: {source}").into()
}

/// An error of a file or folder.
pub fn file(path: &Path) -> impl Fn(std::io::Error) -> MeasureError + '_ {
    move |source| of(path.display(), source)
}
