//! Colours of the pixels of a depth frame, one word each: a single gather reads red, green and blue.

use cairn_sensor::Image;

/// An image of colours that shows the same pixels as a depth frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourImage(pub(crate) Image<u32>);

impl Default for ColourImage {
    fn default() -> Self {
        Self(Image::new(0, 0))
    }
}

impl ColourImage {
    /// From red, green and blue.
    pub fn from_rgb(image: &Image<[u8; 3]>) -> Self {
        let mut words = Image::new(image.width(), image.height());
        let (fours, rest) = words.data_mut().as_chunks_mut();
        let (twelves, bytes) = image.data().as_flattened().as_chunks();
        for ([v0, v1, v2, v3], twelve) in fours.iter_mut().zip(twelves) {
            let [a, b, c, d, e, f, g, h, i, j, k, l]: [u8; 12] = *twelve;
            let [x, y, z] = [[a, b, c, d], [e, f, g, h], [i, j, k, l]].map(u32::from_le_bytes);
            (*v0, *v1) = (x & 0xff_ff_ff, x >> 24 | (y & 0xff_ff) << 8);
            (*v2, *v3) = (y >> 16 | (z & 0xff) << 16, z >> 8);
        }
        for (word, rgb) in rest.iter_mut().zip(bytes.as_chunks::<3>().0) {
            *word = u32::from_le_bytes([rgb[0], rgb[1], rgb[2], 0]);
        }
        Self(words)
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.0.width()
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.0.height()
    }

    /// Red, green and blue from the lowest byte, pixel by pixel.
    pub(crate) fn words(&self) -> &[u32] {
        self.0.data()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_has_its_colour_whatever_the_size() {
        for width in 1..=13 {
            let pixel = |i: usize| [i as u8, (3 * i + 100) as u8, (255 - 2 * i) as u8];
            let image = Image::from_vec(width, 3, (0..3 * width).map(pixel).collect()).expect("all pixels");
            let words: Vec<u32> =
                (0..3 * width).map(pixel).map(|[r, g, b]| u32::from_le_bytes([r, g, b, 0])).collect();
            assert_eq!(ColourImage::from_rgb(&image).words(), words, "{width}");
        }
    }
}
