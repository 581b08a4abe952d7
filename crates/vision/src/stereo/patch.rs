//! The left patch of an alignment: its pixels at integer positions and its derivative along the epipolar line.

use cairn_sensor::GrayImage;

/// Half side of the patch in pixels of its level.
pub(super) const RADIUS: i32 = 4;
/// Side of the patch in pixels.
pub(super) const SIDE: usize = 2 * RADIUS as usize + 1;
/// Number of pixels of the patch.
pub(super) const AREA: usize = SIDE * SIDE;
/// Number of pixels rounded up for vector code; those beyond [`AREA`] have weight zero in a [`Fit`].
pub(super) const PADDED: usize = 96;

/// Pixel values of a patch, row by row.
pub(super) type Patch = [f32; PADDED];

/// A left patch with its gradients.
pub(super) struct Template {
    value: Patch,
    gradient_x: Patch,
    gradient_y: Patch,
}

/// Quantities that are constant over the iterations of one alignment.
pub(super) struct Fit {
    /// The patch with its mean removed.
    pub contrast: Patch,
    /// Sum of squares of `contrast`.
    pub contrast_energy: f32,
    /// Derivative with respect to the shift, made orthogonal to changes of offset and gain.
    pub slope: Patch,
    /// Sum of squares of `slope`.
    pub slope_energy: f32,
}

impl Template {
    /// Cuts the patch around an integer position; `None` at the image border.
    pub(super) fn cut(image: &GrayImage, centre: [f64; 2]) -> Option<Self> {
        let (w, h) = (image.width() as i32, image.height() as i32);
        let (cx, cy) = (centre[0] as i32, centre[1] as i32);
        let reach = RADIUS + 1;
        if cx < reach || cy < reach || cx + reach >= w || cy + reach >= h {
            return None;
        }
        let mut t = Self { value: [0.0; PADDED], gradient_x: [0.0; PADDED], gradient_y: [0.0; PADDED] };
        for j in 0..SIDE {
            let y = (cy - RADIUS) as usize + j;
            let x = (cx - reach) as usize;
            let above = &image.row(y - 1)[x..x + SIDE + 2];
            let here = &image.row(y)[x..x + SIDE + 2];
            let below = &image.row(y + 1)[x..x + SIDE + 2];
            for i in 0..SIDE {
                let k = j * SIDE + i;
                t.value[k] = here[i + 1] as f32;
                t.gradient_x[k] = 0.5 * (here[i + 2] as f32 - here[i] as f32);
                t.gradient_y[k] = 0.5 * (below[i + 1] as f32 - above[i + 1] as f32);
            }
        }
        Some(t)
    }

    /// Computes the derivative along the epipolar line, whose direction in this image is given (pixels per pixel of
    /// disparity); `None` without contrast or without texture along the line.
    pub(super) fn prepare(&self, [dx, dy]: [f32; 2]) -> Option<Fit> {
        let mut contrast = self.value;
        centre(&mut contrast);
        let contrast_energy = dot(&contrast, &contrast);
        // A contrast of one gray level or less is noise.
        if contrast_energy < AREA as f32 {
            return None;
        }
        let mut slope = [0.0; PADDED];
        for k in 0..PADDED {
            slope[k] = self.gradient_x[k] * dx + self.gradient_y[k] * dy;
        }
        centre(&mut slope);
        let along = dot(&slope, &contrast) / contrast_energy;
        for k in 0..PADDED {
            slope[k] -= along * contrast[k];
        }
        let slope_energy = dot(&slope, &slope);
        (slope_energy > 1.0).then_some(Fit { contrast, contrast_energy, slope, slope_energy })
    }
}

/// One for each pixel of the patch and zero in the padding.
static ONES: Patch = {
    let mut ones = [0.0; PADDED];
    let mut k = 0;
    while k < AREA {
        ones[k] = 1.0;
        k += 1;
    }
    ones
};

/// Subtracts the mean from all pixels of the patch; the padding becomes zero.
fn centre(patch: &mut Patch) {
    let mean = dot(patch, &ONES) / AREA as f32;
    for (v, one) in patch.iter_mut().zip(&ONES) {
        *v = (*v - mean) * one;
    }
}

/// Sum of squared deviations from the mean.
pub(super) fn energy(mut patch: Patch) -> f32 {
    centre(&mut patch);
    dot(&patch, &patch)
}

/// Inner product accumulated in sixteen fixed lanes, so that it vectorises with identical rounding everywhere.
pub(super) fn dot(a: &Patch, b: &Patch) -> f32 {
    let mut lanes = [0.0f32; 16];
    for (x, y) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for k in 0..16 {
            lanes[k] += x[k] * y[k];
        }
    }
    lanes.iter().sum()
}
