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

/// Least correlation of two halves that show one scene from beside each other: those of a street or a room by themselves had
/// at most 0.4, stereo pairs of EuRoC and KITTI at least 0.6.
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
mod measure {
    use super::*;
    use crate::decode;
    use std::path::PathBuf;
    #[test]
    fn measure_alike() {
        let data = PathBuf::from(std::env::var("CAIRN_DATA").unwrap());
        let join = |a: &GrayImage, b: &GrayImage| {
            let mut out = GrayImage::new(a.width() + b.width(), a.height());
            for y in 0..a.height() {
                out.row_mut(y)[..a.width()].copy_from_slice(a.row(y));
                out.row_mut(y)[a.width()..].copy_from_slice(b.row(y));
            }
            out
        };
        let list = |p: &str| {
            let mut v: Vec<PathBuf> = std::fs::read_dir(data.join(p))
                .unwrap()
                .map(|e| e.unwrap().path())
                .filter(|p| decode::is_image(p))
                .collect();
            v.sort();
            v
        };
        for (l, r) in [
            ("kitti-a/image_0", "kitti-a/image_1"),
            ("euroc-mh01/mav0/cam0/data", "euroc-mh01/mav0/cam1/data"),
        ] {
            let (l, r) = (list(l), list(r));
            let n = l.len().min(r.len());
            let mut single: Vec<f64> = vec![];
            let mut pair: Vec<f64> = vec![];
            for k in (0..n).step_by((n / 12).max(1)) {
                let (a, b) = (decode::gray(&l[k]).unwrap(), decode::gray(&r[k]).unwrap());
                single.push(correlated(&a));
                pair.push(correlated(&join(&a, &b)));
            }
            println!("single {single:.2?}\npair {pair:.2?}");
        }
    }
}
