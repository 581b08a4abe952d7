//! x
#![allow(missing_docs)]
pub mod angle;
pub mod batch;
pub mod chi2;
pub mod covariance;
pub mod ekf;
pub mod log;
pub mod measure;
pub mod motion;
