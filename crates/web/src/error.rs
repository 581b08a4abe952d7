//! Why the page cannot be served.

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// The port cannot be bound.
    #[error("port {port}: {source}")]
    Port {
        /// The port.
        port: u16,
        /// The system's error.
        source: std::io::Error,
    },
    /// The routes cannot be kept where they should be.
    #[error(transparent)]
    Routes(#[from] cairn_session::LibraryError),
    /// Another failure of the system, such as no thread or no random numbers.
    #[error("{0}")]
    Machine(String),
}

impl WebError {
    /// A failure of the system in its words.
    pub(crate) fn machine<E: std::fmt::Display>(why: E) -> Self {
        Self::Machine(why.to_string())
    }
}
