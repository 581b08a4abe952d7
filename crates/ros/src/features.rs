//! The picture of the first camera with the features that were found in it, for people.

use crate::messages::{Header, Image};
use cairn::sensor::GrayImage;
use cairn::vision::Frame;

/// Half the side of the square around a feature, pixels.
const HALF: i64 = 2;
/// Of features with depth, and without, as red, green, blue.
const COLOURS: [[u8; 3]; 2] = [[0, 255, 0], [255, 200, 0]];

/// The picture as `rgb8`, with a square around each feature: green where its depth is measured, yellow where it is not.
pub fn message(header: Header, picture: &GrayImage, frame: &Frame) -> Image {
    let (width, height) = (picture.width(), picture.height());
    let mut data: Vec<u8> = picture.data().iter().flat_map(|gray| [*gray; 3]).collect();
    for (raw, depth) in frame.raw.iter().zip(&frame.depth) {
        let [x, y] = raw.map(|v| v.round() as i64);
        for (dx, dy) in (-HALF..=HALF).flat_map(|dx| (-HALF..=HALF).map(move |dy| (dx, dy))) {
            let (x, y) = (x + dx, y + dy);
            let is_edge = dx.abs() == HALF || dy.abs() == HALF;
            if is_edge && (0..width as i64).contains(&x) && (0..height as i64).contains(&y) {
                let at = 3 * (y as usize * width + x as usize);
                data[at..at + 3].copy_from_slice(&COLOURS[usize::from(depth.is_nan())]);
            }
        }
    }
    Image {
        header,
        height: height as u32,
        width: width as u32,
        encoding: "rgb8".into(),
        is_bigendian: 0,
        step: 3 * width as u32,
        data,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn::Stamp;

    #[test]
    fn features_have_squares_and_those_at_the_edge_are_cut_off() {
        let mut frame = Frame::default();
        (frame.raw, frame.depth) = (vec![[10.2, 8.0], [0.0, 19.0], [1e9, -1e9]], vec![2.0, f32::NAN, 1.0]);
        let mut picture = GrayImage::new(30, 20);
        picture.data_mut().fill(7);
        let image = message(Header::new(Stamp(5), "left"), &picture, &frame);
        assert_eq!((image.width, image.height, image.step, image.data.len()), (30, 20, 90, 1800));
        let at = |x: usize, y: usize| &image.data[90 * y + 3 * x..][..3];
        assert_eq!(
            (at(10, 8), at(12, 8), at(8, 6), at(13, 8)),
            (&[7; 3][..], &COLOURS[0][..], &COLOURS[0][..], &[7; 3][..])
        );
        assert_eq!((at(2, 19), at(0, 17), at(0, 19)), (&COLOURS[1][..], &COLOURS[1][..], &[7; 3][..]));
        let coloured = image.data.chunks(3).filter(|p| p[0] != p[1]).count();
        assert_eq!(coloured, 16 + 5);
    }
}
