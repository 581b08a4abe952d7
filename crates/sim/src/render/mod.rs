//! The renderer: visibility (a buffer of faces and inverse depths), then one textured lookup per
//! pixel, then finer sampling where two faces meet.
//!
//! Everything about a flat face is a linear function of the pixel: with the face's frame `M = [along down origin]`
//! in camera coordinates and the pixel's ray `d`, `(s, t, 1) / z = M^-1 d` (Heckbert, "Fundamentals of texture
//! mapping and image warping", 1989; homogeneous edges: Olano and Greer 1997). So depth and texture coordinates
//! are exact at every pixel centre.

mod edges;
mod passes;
mod raster;
mod renderer;
mod sample;
mod setup;
mod shade;

#[cfg(test)]
mod tests;

pub use renderer::Renderer;
