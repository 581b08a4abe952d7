//! The integration tests of this crate, as one program.

mod graphs;
mod inertial;
mod newcomers;
mod odometry;
mod phone;
mod places;
mod recordings;
mod revisit;
mod run;
mod scale;
mod scenarios;
mod spot_turn;
mod walkers;
mod walks;
