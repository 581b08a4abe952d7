//! The outline of an obstacle on the floor.

use cairn_geometry::Vec2;

/// The outline of an obstacle on the floor: a rotated rectangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Footprint {
    /// Middle.
    pub centre: Vec2,
    /// Half sizes along its own axes.
    pub half: Vec2,
    /// Angle of its x axis.
    pub yaw: f64,
}

impl Footprint {
    /// Metres from the outline; negative inside.
    pub fn distance(&self, p: &Vec2) -> f64 {
        let d = p - self.centre;
        let (s, c) = self.yaw.sin_cos();
        let (x, y) = ((c * d.x + s * d.y).abs() - self.half.x, (c * d.y - s * d.x).abs() - self.half.y);
        if x <= 0.0 && y <= 0.0 { x.max(y) } else { x.max(0.0).hypot(y.max(0.0)) }
    }

    /// The four corners.
    pub fn corners(&self) -> [Vec2; 4] {
        let (s, c) = self.yaw.sin_cos();
        [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].map(|(i, j)| {
            let (x, y) = (i * self.half.x, j * self.half.y);
            self.centre + Vec2::new(c * x - s * y, s * x + c * y)
        })
    }
}

/// Metres from a point to a segment.
pub(crate) fn distance_to_segment(p: &Vec2, a: &Vec2, b: &Vec2) -> f64 {
    let ab = b - a;
    let k = ((p - a).dot(&ab) / ab.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (p - a - ab * k).norm()
}
