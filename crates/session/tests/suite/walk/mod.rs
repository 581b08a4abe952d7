//! Walks through a rendered world with every command and with failures on the way: the stream stops, the disk is
//! full, the map is corrected. The walker returns with the camera facing back, so that the images of the way out in
//! reverse order are the images of the way home.

mod lens;
mod losses;
mod pausing;
mod recording;
mod scripted;
