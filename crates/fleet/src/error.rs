//! Why a step cannot be done, in one sentence: what, why, and what to do.

/// A failure that another try may not meet: the store, the address, or a blob that is damaged. A recording that cannot be mapped is
/// none; it is told in the outcome.
#[derive(Debug, thiserror::Error)]
#[error("{what}: {why}; {cure}")]
pub struct FleetError {
    /// The address or object concerned.
    pub what: String,
    /// What is wrong.
    pub why: String,
    /// What can be done.
    pub cure: String,
}

impl FleetError {
    /// From its three parts.
    pub fn new(what: impl Into<String>, why: impl ToString, cure: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.to_string(), cure: cure.into() }
    }

    /// Of an object whose content is not what a step wrote.
    pub(crate) fn damaged(what: impl Into<String>, why: impl ToString) -> Self {
        Self::new(what, why, "delete this object of the store and build again")
    }
}
