//! A walker in a world whose walls stop him, and things that were put into his way after his route was recorded.

mod body;
mod obstacles;

pub use body::Body;
pub use obstacles::{BODY_M, Obstacles};
