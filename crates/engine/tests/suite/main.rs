//! The integration tests of this crate, as one program.

mod bare_walls;
mod delayed;
mod dense;
mod first_seconds;
mod frames;
mod inertial;
mod journal;
mod locate;
mod lost_by_depth;
mod odometry;
mod resume;
