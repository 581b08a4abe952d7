//! Simulated drives through halls: the body stays on its path, touches nothing, and gives a reason when it cannot go
//! on.

mod halls;
mod obstacles;
mod paths;
mod people;
