//! What a camera would see of a surface: drawn ([`crate::draw`]) or cast ([`crate::raycast`]).

use cairn_sensor::Image;

/// A rendered view.
#[derive(Clone, Debug, PartialEq)]
pub struct RayCast {
    /// Depth along the optical axis in metres; 0 where the ray meets no surface.
    pub depth_m: Image<f32>,
    /// Unit normals in the camera frame, towards the camera; zero where the ray meets no surface.
    pub normals: Image<[f32; 3]>,
}
