//! The integration tests of this crate, as one program.

mod bow;
mod common;
mod front_end;
mod pattern;
mod rgbd_motion;
mod stereo;
mod stereo_motion;
mod two_view;
mod two_view_recordings;
