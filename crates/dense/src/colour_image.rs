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
        for (word, &[r, g, b]) in words.data_mut().iter_mut().zip(image.data()) {
            *word = u32::from_le_bytes([r, g, b, 0]);
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
