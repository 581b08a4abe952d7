//! Images with the two pictures of a stereo camera side by side, or one above the other.

use cairn_sensor::{Camera, GrayImage, Rig, RigCamera};

/// The first or second half of an image with two of this camera: above and below where it is twice as high, else left and right. Half of
/// an image of another size has not that of the camera either.
pub fn half(both: &GrayImage, side: usize, camera: &Camera) -> GrayImage {
    let (width, height) = match both.height() == 2 * camera.height {
        true => (both.width(), camera.height),
        false => (both.width() / 2, both.height()),
    };
    let (x, y) = if side == 0 { (0, 0) } else { (both.width() - width, both.height() - height) };
    let mut half = GrayImage::new(width, height);
    for row in 0..height {
        half.row_mut(row).copy_from_slice(&both.row(y + row)[x..x + width]);
    }
    half
}

/// How images of this size have two of a rig's cameras, for people.
pub fn two_in_one(rig: &Rig, size: [usize; 2]) -> Option<&'static str> {
    let all = |fits: fn(&Camera) -> [usize; 2]| {
        rig.cameras.len() >= 2 && rig.cameras[..2].iter().all(|c: &RigCamera| fits(&c.camera) == size)
    };
    if all(|c| [2 * c.width, c.height]) {
        Some("left and right side by side in each")
    } else {
        all(|c| [c.width, 2 * c.height]).then_some("left above right in each")
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_an_image_of_another_size_has_not_that_of_the_camera() {
        let camera = Camera::pinhole(64, 48, 50.0, 50.0, 31.5, 23.5);
        let of = |width: usize, height: usize| {
            let mut both = GrayImage::new(width, height);
            both.row_mut(height - 1)[width - 1] = 9;
            let halves = [0, 1].map(|side| half(&both, side, &camera));
            let last = halves[1].row(halves[1].height() - 1)[halves[1].width() - 1];
            (halves.map(|half| [half.width(), half.height()]), last)
        };
        assert_eq!([of(128, 48), of(64, 96)], [([[64, 48]; 2], 9); 2]);
        for [width, height] in [[140, 48], [100, 48], [128, 50], [70, 96], [64, 90]] {
            assert!(of(width, height).0.iter().all(|size| *size != [64, 48]), "{width}x{height}");
        }
    }
}
