//! Grey images: reads and writes PGM (P2 and P5, up to 8 bits), reads PNG.

use crate::grid::{MAX_CELLS, MAX_SIDE};

/// Why an image is not a readable grey image.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// There are no bytes.
    #[error("the file is empty")]
    EmptyFile,
    /// It begins like neither of the two formats.
    #[error("neither PGM (P2, P5) nor PNG")]
    Format,
    /// It has no pixels.
    #[error("{0} x {1} pixels: the image is empty")]
    NoPixels(usize, usize),
    /// It has more pixels than a grid may have cells.
    #[error("{0} x {1} pixels are too many")]
    TooLarge(usize, usize),
    /// Its pixels have more than 8 bits, or none.
    #[error("grey values up to {0}: only 1 to 255 are read")]
    Depth(usize),
    /// A number is missing in a PGM, or too large.
    #[error("{}a number is missing: truncated or no PGM", pixel.map(|k| format!("pixel {k}: ")).unwrap_or_default())]
    Number {
        /// The pixel that it should be of; `None` in the header.
        pixel: Option<usize>,
    },
    /// The file ends before its last pixel.
    #[error("truncated: {found} of {expected} pixels")]
    Truncated {
        /// Pixels in the file.
        found: usize,
        /// Pixels that its header states.
        expected: usize,
    },
    /// A pixel is brighter than the header allows.
    #[error("pixel {pixel} is {value}, above {greatest}")]
    Bright {
        /// Its index, row by row.
        pixel: usize,
        /// Its value.
        value: usize,
        /// Greatest value by the header.
        greatest: usize,
    },
    /// The PNG is malformed.
    #[error(transparent)]
    Png(#[from] png::DecodingError),
}

/// A grey image, top row first; with alpha where the file has it.
#[derive(Debug, PartialEq)]
pub struct Pixels {
    pub width: usize,
    pub height: usize,
    pub grey: Vec<u8>,
    pub alpha: Option<Vec<u8>>,
}

/// Reads a PGM or PNG, recognised by its first bytes.
pub fn read(bytes: &[u8]) -> Result<Pixels, ImageError> {
    match bytes {
        [b'P', b'2' | b'5', ..] => read_pgm(bytes),
        [0x89, b'P', b'N', b'G', ..] => read_png(bytes),
        [] => Err(ImageError::EmptyFile),
        _ => Err(ImageError::Format),
    }
}

fn checked(width: usize, height: usize) -> Result<usize, ImageError> {
    let fits = width <= MAX_SIDE && height <= MAX_SIDE && width * height <= MAX_CELLS;
    if width == 0 || height == 0 {
        return Err(ImageError::NoPixels(width, height));
    }
    if fits { Ok(width * height) } else { Err(ImageError::TooLarge(width, height)) }
}

fn read_pgm(bytes: &[u8]) -> Result<Pixels, ImageError> {
    let mut rest = &bytes[2..];
    let [width, height, greatest] = [number(&mut rest)?, number(&mut rest)?, number(&mut rest)?];
    let pixels = checked(width, height)?;
    if greatest == 0 || greatest > 255 {
        return Err(ImageError::Depth(greatest));
    }
    let mut grey = if bytes[1] == b'5' {
        // A single white space ends the header.
        let data = rest.get(1..).unwrap_or_default();
        let whole = data.get(..pixels);
        whole.ok_or(ImageError::Truncated { found: data.len(), expected: pixels })?.to_vec()
    } else {
        let mut grey = Vec::with_capacity(pixels.min(rest.len()));
        for k in 0..pixels {
            let value = number(&mut rest).map_err(|_| ImageError::Number { pixel: Some(k) })?;
            grey.push(u8::try_from(value).map_err(|_| ImageError::Bright { pixel: k, value, greatest })?);
        }
        grey
    };
    if let Some(k) = grey.iter().position(|&v| usize::from(v) > greatest) {
        return Err(ImageError::Bright { pixel: k, value: usize::from(grey[k]), greatest });
    }
    if greatest < 255 {
        grey.iter_mut().for_each(|v| *v = ((usize::from(*v) * 255 + greatest / 2) / greatest) as u8);
    }
    Ok(Pixels { width, height, grey, alpha: None })
}

/// The next whole number in the text of a PGM, after white space and comments.
fn number(rest: &mut &[u8]) -> Result<usize, ImageError> {
    loop {
        match rest.first() {
            Some(b'#') => {
                let line = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
                *rest = &rest[line..];
            }
            Some(b) if b.is_ascii_whitespace() => *rest = &rest[1..],
            _ => break,
        }
    }
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    let (text, after) = rest.split_at(digits);
    *rest = after;
    let value = std::str::from_utf8(text).ok().and_then(|t| t.parse::<u32>().ok());
    value.map(|v| v as usize).ok_or(ImageError::Number { pixel: None })
}

pub fn write_pgm(pixels: &Pixels) -> Vec<u8> {
    let mut bytes = format!("P5\n{} {}\n255\n", pixels.width, pixels.height).into_bytes();
    bytes.extend_from_slice(&pixels.grey);
    bytes
}

fn read_png(bytes: &[u8]) -> Result<Pixels, ImageError> {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info()?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let pixels = checked(width, height)?;
    let mut data = vec![0; reader.output_buffer_size().ok_or(ImageError::TooLarge(width, height))?];
    let info = reader.next_frame(&mut data)?;
    let channels = info.color_type.samples();
    if data.len() < pixels * channels {
        return Err(ImageError::Truncated { found: data.len() / channels, expected: pixels });
    }
    let has_alpha = channels % 2 == 0;
    let colours = channels - usize::from(has_alpha);
    // As documented for `map_server`: the mean of the colours.
    let mean = |p: &[u8]| (p[..colours].iter().map(|&v| u32::from(v)).sum::<u32>() / colours as u32) as u8;
    let data = &data[..pixels * channels];
    let grey = data.chunks_exact(channels).map(mean).collect();
    let alpha = has_alpha.then(|| data.chunks_exact(channels).map(|p| p[colours]).collect());
    Ok(Pixels { width, height, grey, alpha })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_binary_are_read_with_comments() {
        let text = read(b"P2 # made by hand\n# two comments\n3 2\n255\n0 1 2\n3 4 255\n").unwrap();
        assert_eq!((text.width, text.height, text.grey.as_slice()), (3, 2, &[0, 1, 2, 3, 4, 255][..]));
        assert_eq!(read(&write_pgm(&text)).unwrap(), text);
        let few = read(b"P5 2 1 1\n\x00\x01").unwrap();
        assert_eq!(few.grey, [0, 255], "scaled to 255");
    }

    #[test]
    fn every_truncation_is_an_error() {
        let whole = b"P5\n# c\n7 3\n255\n012345678901234567890".to_vec();
        assert!(read(&whole).is_ok());
        (0..whole.len()).for_each(|n| assert!(read(&whole[..n]).is_err(), "{n} bytes were read"));
    }

    #[test]
    fn what_is_no_image_says_so() {
        for (bytes, word) in [
            (&b""[..], "empty"),
            (b"GIF89a", "neither"),
            (b"P5 0 4 255\n", "empty"),
            (b"P5 99999 99999 255\n", "too many"),
            (b"P5 99999999999999999999 1 255\n", "number"),
            (b"P5 1 1 65535\n\x00\x00", "65535"),
            (b"P2 1 1 255\n300", "300"),
            (b"P2 1 1 10\n11", "above 10"),
        ] {
            let told = read(bytes).unwrap_err().to_string();
            assert!(told.contains(word), "{told}");
        }
    }
}
