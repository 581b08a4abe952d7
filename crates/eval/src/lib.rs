//! ATE, RPE, coverage, timing, reports and plots.
