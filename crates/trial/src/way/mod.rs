//! A walker in a world whose walls stop him, and things that were put into his way after his route was recorded.

mod body;
mod carried;
mod obstacles;

pub use body::Body;
pub use carried::{BODY_HZ, CarriedPhone, TURN_CAMERA_S, corners};
pub use obstacles::{BODY_M, Obstacles};
