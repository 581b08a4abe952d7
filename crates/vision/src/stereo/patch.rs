//! The left patch of an alignment: its pixels on whole positions, and how they change along the epipolar line.

use super::warp::Warp;
use cairn_sensor::GrayImage;

/// Half the side of the patch in pixels of its level.
pub(super) const RADIUS: i32 = 4;
/// Its side.
pub(super) const SIDE: usize = 2 * RADIUS as usize + 1;
/// Its pixels.
pub(super) const AREA: usize = SIDE * SIDE;
/// Its pixels, rounded up for vector code; those beyond [`AREA`] have weight zero in a [`Fit`].
pub(super) const PADDED: usize = 96;

/// Pixel values of a patch, row after row.
pub(super) type Patch = [f32; PADDED];

/// A left patch with its gradients.
pub(super) struct Template {
    value: Patch,
    gradient_x: Patch,
    gradient_y: Patch,
}

/// What stays the same over the steps of one alignment.
pub(super) struct Fit {
    /// The patch without its mean.
    pub contrast: Patch,
    pub contrast_energy: f32,
    /// Derivative by the shift, made orthogonal to a change of offset and of gain.
    pub slope: Patch,
    pub slope_energy: f32,
}

impl Template {
    /// Cuts the patch around a whole position; `None` at the image's edge.
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

    /// Derivatives along the epipolar line; `None` without contrast or without texture along it.
    pub(super) fn prepare(&self, warp: &Warp) -> Option<Fit> {
        let mut contrast = self.value;
        centre(&mut contrast);
        let contrast_energy = dot(&contrast, &contrast);
        // A contrast of one gray level is noise.
        if contrast_energy < AREA as f32 {
            return None;
        }
        let mut slope = [0.0; PADDED];
        let [dx, dy] = warp.direction_left;
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

/// One for each pixel of the patch, zero in the padding.
static ONES: Patch = {
    let mut ones = [0.0; PADDED];
    let mut k = 0;
    while k < AREA {
        ones[k] = 1.0;
        k += 1;
    }
    ones
};

/// Takes the mean from all pixels of the patch; the padding becomes zero.
fn centre(patch: &mut Patch) {
    let mean = dot(patch, &ONES) / AREA as f32;
    for (v, one) in patch.iter_mut().zip(&ONES) {
        *v = (*v - mean) * one;
    }
}

/// Sum of squares about the mean.
pub(super) fn energy(mut patch: Patch) -> f32 {
    centre(&mut patch);
    dot(&patch, &patch)
}

/// Inner product in sixteen fixed lanes, so that it vectorises and always rounds alike.
pub(super) fn dot(a: &Patch, b: &Patch) -> f32 {
    let mut lanes = [0.0f32; 16];
    for (x, y) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
        for k in 0..16 {
            lanes[k] += x[k] * y[k];
        }
    }
    lanes.iter().sum()
}
