//! Errors from input.

/// Why an input was refused; the map is unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DenseError {
    /// An invalid config value.
    #[error("dense config: {0}")]
    Config(String),
    /// The camera of the depth images cannot be used.
    #[error("depth camera: {0}")]
    Camera(String),
    /// An image whose size is not the camera's.
    #[error("the {what} image is {width}x{height}, the camera is {expected_width}x{expected_height}")]
    Size {
        /// Which image.
        what: &'static str,
        /// Its width in pixels.
        width: usize,
        /// Its height in pixels.
        height: usize,
        /// The camera's width in pixels.
        expected_width: usize,
        /// The camera's height in pixels.
        expected_height: usize,
    },
    /// Too few pixels with a depth in range: a covered or failed sensor, or a wrong unit.
    #[error(
        "{valid} of {pixels} depth pixels are in range ({nearest_m:.3} to {farthest_m:.3} m seen): {hint}"
    )]
    NoDepth {
        /// Pixels with a depth in range.
        valid: usize,
        /// Pixels of the image.
        pixels: usize,
        /// Least non-zero depth, in metres.
        nearest_m: f64,
        /// Greatest depth, in metres.
        farthest_m: f64,
        /// The likely cause.
        hint: &'static str,
    },
    /// A pose that is not finite, or outside the range of block coordinates.
    #[error("pose: {0}")]
    Pose(String),
    /// An unknown anchor.
    #[error("anchor {0} is not in the map")]
    UnknownAnchor(u64),
    /// A saved map that cannot be read.
    #[error("saved map: {0}")]
    Saved(String),
}
