//! Images with the two pictures of a stereo camera side by side.

use cairn_sensor::{GrayImage, Rig, RigCamera};

/// The left (0) or right (1) half of an image with two side by side; of an odd width the middle column is left out.
pub fn half(both: &GrayImage, side: usize) -> GrayImage {
    let (width, height) = (both.width() / 2, both.height());
    let from = if side == 0 { 0 } else { both.width() - width };
    let mut half = GrayImage::new(width, height);
    for y in 0..height {
        half.row_mut(y).copy_from_slice(&both.row(y)[from..from + width]);
    }
    half
}

/// Whether images of this size are two of a rig's cameras side by side.
pub fn side_by_side(rig: &Rig, [width, height]: [usize; 2]) -> bool {
    let is_half = |c: &RigCamera| 2 * c.camera.width == width && c.camera.height == height;
    rig.cameras.len() >= 2 && rig.cameras[..2].iter().all(is_half)
}

/// What is told of such images without a rig.
pub const DOUBT: &str = "the images look like left and right of a stereo camera side by side, and are taken as of one camera: \
                         give a --rig of both, each of half the width";

/// Least correlation of two halves that show one scene from beside each other. Of 26 pictures of KITTI and EuRoC the halves had at
/// most 0.50; of the 26 pairs of left and right all but one had at least 0.55, those of KITTI 0.72.
const ALIKE: f64 = 0.55;

/// Whether left and right half of a wide image show nearly the same: the correlation of their pixels, at the shift that suits
/// best, up to a quarter of the width.
pub fn alike(image: &GrayImage) -> bool {
    image.width() >= 2 * image.height() && image.width() >= 128 && correlated(image) > ALIKE
}

/// The correlation of left and right half, at the shift of the right one that suits best.
fn correlated(image: &GrayImage) -> f64 {
    let (width, height) = (image.width() / 2, image.height());
    let correlation = |shift: usize| {
        let mut sums = [0.0; 6];
        for y in (0..height).step_by(4) {
            let row = image.row(y);
            for x in (shift..width).step_by(4) {
                let (a, b) = (f64::from(row[x]), f64::from(row[width + x - shift]));
                let terms = [1.0, a, b, a * a, b * b, a * b];
                sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
            }
        }
        let [n, a, b, aa, bb, ab] = sums;
        let variance = (aa - a * a / n) * (bb - b * b / n);
        if variance > 0.0 { (ab - a * b / n) / variance.sqrt() } else { 0.0 }
    };
    (0..width / 4).step_by(2).map(correlation).fold(0.0, f64::max)
}
