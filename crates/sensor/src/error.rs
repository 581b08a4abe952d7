//! Why a rig is impossible.

/// What is wrong with a rig, with the number that is wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct RigError(pub String);
