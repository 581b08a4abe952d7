//! Noise model of depth.

/// Standard deviation of a depth: `floor_m + growth * (z - nearest_m)^2`, `z` in metres.
///
/// The form and the default numbers are those of a structured-light sensor: Nguyen, Izadi and Lovell, "Modeling
/// Kinect sensor noise for improved 3D reconstruction and tracking" (3DIMPVT 2012), eq. 6.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthNoise {
    /// Standard deviation at the nearest depth, in metres.
    pub floor_m: f64,
    /// Growth with the square of the depth, in 1/m.
    pub growth: f64,
    /// Depth at which the growth begins, in metres.
    pub nearest_m: f64,
}

impl Default for DepthNoise {
    fn default() -> Self {
        Self { floor_m: 0.0012, growth: 0.0019, nearest_m: 0.4 }
    }
}

impl DepthNoise {
    /// Standard deviation in metres of a depth in metres.
    pub fn sigma_m(&self, z: f64) -> f64 {
        self.floor_m + self.growth * (z - self.nearest_m).powi(2)
    }
}
