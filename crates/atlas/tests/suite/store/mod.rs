//! Map files: saved maps round-trip bit for bit, damage is detected, and a failed save keeps the previous
//! file.

mod combine;
mod commits;
mod damage;
mod depth;
mod fixtures;
mod history;
mod own;
mod paging;
mod pieces;
mod pieces_imu;
mod relative_poses;
mod round_trip;
mod salvage;
mod saving;
mod scales;
