//! The report of every solve.

/// Why a solve ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The cost no longer changed.
    Converged,
    /// The maximum number of iterations was reached.
    Iterations,
    /// The caller interrupted it; the best state so far is kept.
    Interrupted,
    /// No step lowered the cost, or the normal equations were singular.
    NoDescent,
    /// There was nothing to solve.
    Empty,
}

/// How a solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Accepted and rejected steps together.
    pub iterations: usize,
    /// Half the robust sum of squares before.
    pub cost_before: f64,
    /// The same after.
    pub cost_after: f64,
    /// Residuals within their chi-square bound after.
    pub inliers: usize,
    /// Why it ended.
    pub stop: Stop,
}
