//! The integration tests of this crate, as one program.

mod evo_golden;
mod kitti_metric;
