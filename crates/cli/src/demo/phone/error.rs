//! Why a walk with a phone could not go on.

use crate::socket::ConnectError;
use std::io;
use tokio_tungstenite::tungstenite;

/// Why a walk with a phone could not go on.
#[derive(Debug, thiserror::Error)]
pub enum PhoneError {
    /// The folder of its routes cannot be made.
    #[error("{path}: {source}")]
    Folder {
        /// The folder.
        path: String,
        /// The system's error.
        source: io::Error,
    },
    /// The server does not start.
    #[error(transparent)]
    Server(#[from] cairn_web::WebError),
    /// The system has nothing to wait on sockets with.
    #[error(transparent)]
    Runtime(io::Error),
    /// The phone's camera is none.
    #[error(transparent)]
    Camera(#[from] cairn_sensor::RigError),
    /// The server cannot be reached.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The connection has failed.
    #[error("{0}")]
    Connection(Box<tungstenite::Error>),
    /// The server has closed the connection.
    #[error("the server has closed the connection")]
    Closed,
    /// A message of the server is not JSON.
    #[error(transparent)]
    Message(#[from] serde_json::Error),
    /// The server took an image without saying which.
    #[error("the server names no image")]
    Unnamed,
    /// Drawing a picture ended with an error of the program.
    #[error(transparent)]
    Picture(#[from] tokio::task::JoinError),
    /// There is nowhere to walk.
    #[error("the world has no route")]
    NoRoute,
    /// The server refuses a command.
    #[error("{command}: {why}")]
    Refused {
        /// The command.
        command: String,
        /// The server's words.
        why: String,
    },
    /// The server did not do something in time.
    #[error("{what} within {seconds} s ({troubles})")]
    TooLate {
        /// What is missing.
        what: &'static str,
        /// How long was waited.
        seconds: f64,
        /// What the page was told meanwhile.
        troubles: String,
    },
}

impl From<tungstenite::Error> for PhoneError {
    fn from(e: tungstenite::Error) -> Self {
        Self::Connection(Box::new(e))
    }
}
