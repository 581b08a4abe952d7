//! A flat textured piece of surface.

use super::footprint::distance_to_segment;
use cairn_geometry::{Vec2, Vec3};

/// A convex polygon in a plane. The plane's frame has its origin at the texture's upper left corner, `along`
/// to the viewer's right, `down` downwards; `along x down` points away from the viewer, so the back is not seen.
#[derive(Clone, Debug)]
pub(crate) struct Face {
    /// Origin of the plane's frame in the world, metres.
    pub origin: Vec3,
    /// Unit vector of the first texture axis.
    pub along: Vec3,
    /// Unit vector of the second texture axis.
    pub down: Vec3,
    /// Corners in the plane's frame in metres, clockwise as seen; three or four.
    pub corners: Vec<Vec2>,
    /// Which texture.
    pub texture: usize,
    /// Texels per metre.
    pub texels_per_m: f64,
    /// Middle of a ball around the face.
    pub centre: Vec3,
    /// Radius of that ball.
    pub radius: f64,
}

impl Face {
    /// From its frame and corners.
    pub fn new(
        [origin, along, down]: [Vec3; 3],
        corners: Vec<Vec2>,
        texture: usize,
        texels_per_m: f64,
    ) -> Self {
        let mid = corners.iter().sum::<Vec2>() / corners.len().max(1) as f64;
        let radius = corners.iter().map(|c| (c - mid).norm()).fold(0.0, f64::max);
        let centre = origin + along * mid.x + down * mid.y;
        Self { origin, along, down, corners, texture, texels_per_m, centre, radius }
    }

    /// Metres from a point to the nearest point of the polygon.
    pub fn distance(&self, p: &Vec3) -> f64 {
        let d = p - self.origin;
        let at = Vec2::new(d.dot(&self.along), d.dot(&self.down));
        let off = d.dot(&self.along.cross(&self.down));
        let edges = || self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        let across = |(a, b): (&Vec2, &Vec2)| (b - a).perp(&(at - a));
        let sides = edges().map(across);
        let (low, high) = sides.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        let beside = match low >= 0.0 || high <= 0.0 {
            true => 0.0,
            false => edges().map(|(a, b)| distance_to_segment(&at, a, b)).fold(f64::MAX, f64::min),
        };
        off.hypot(beside)
    }
}
