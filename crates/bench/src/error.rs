//! Why something could not be measured.

use std::borrow::Cow;
use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

/// Why something could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A source could not be opened or read.
    #[error(transparent)]
    Source(#[from] cairn_sensor::SourceError),
    /// The rig cannot serve the sensors that are used.
    #[error(transparent)]
    Rig(#[from] cairn_sensor::RigError),
    /// Images do not fit the rig.
    #[error(transparent)]
    FrontEnd(#[from] cairn_vision::FrontEndError),
    /// A saved map could not be continued.
    #[error(transparent)]
    OpenMap(#[from] cairn_engine::OpenMapError),
    /// A saved map could not be read or written.
    #[error(transparent)]
    Store(#[from] cairn_atlas::store::StoreError),
    /// The poses are no trajectory.
    #[error(transparent)]
    Trajectory(#[from] cairn_geometry::TrajectoryError),
    /// A file of poses could not be read.
    #[error(transparent)]
    TrajectoryFile(#[from] cairn_eval::FileError),
    /// Two trajectories could not be aligned.
    #[error(transparent)]
    Alignment(#[from] cairn_geometry::Degenerate),
    /// The map contradicts itself.
    #[error(transparent)]
    Unsound(#[from] cairn_atlas::Unsound),
    /// A pose graph could not be read.
    #[error(transparent)]
    Graph(#[from] cairn_solve::TextError),
    /// An image could not be read.
    #[error(transparent)]
    Image(#[from] cairn_sources::ImageError),
    /// A run in processes failed.
    #[cfg(unix)]
    #[error(transparent)]
    Supervise(#[from] cairn_workers::SuperviseError),
    /// Surfaces could not be made.
    #[error(transparent)]
    Dense(#[from] cairn_dense::DenseError),
    /// A stage of the engine failed.
    #[error("{0}")]
    Stage(String),
    /// The system refused something.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A report could not be written or read.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// A file or folder could not be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// One of several things that are measured.
    #[error("{what}: {source}")]
    Of {
        /// Which one.
        what: String,
        /// What is wrong with it.
        source: Box<MeasureError>,
    },
    /// A program or thread beside this one failed.
    #[error("{0}")]
    Program(String),
    /// What is measured lacks something, or is not what it should be.
    #[error("{0}")]
    Unfit(Cow<'static, str>),
}

impl MeasureError {
    /// An error of one of several things that are measured.
    pub fn of(what: impl Display, source: impl Into<Self>) -> Self {
        Self::Of { what: what.to_string(), source: Box::new(source.into()) }
    }

    /// An error of a file or folder.
    pub fn file(path: &Path) -> impl Fn(io::Error) -> Self + '_ {
        move |source| Self::File { path: path.to_owned(), source }
    }
}

impl From<&'static str> for MeasureError {
    fn from(why: &'static str) -> Self {
        Self::Unfit(why.into())
    }
}

impl From<String> for MeasureError {
    fn from(why: String) -> Self {
        Self::Unfit(why.into())
    }
}
