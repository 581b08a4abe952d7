//! Grey images: reads PGM and PBM (P1, P2, P4 and P5, up to 16 bits), PNG and BMP; writes PGM.

use crate::grid::{MAX_CELLS, MAX_SIDE};

/// Why an image is not a readable grey image.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// There are no bytes.
    #[error("the file is empty")]
    EmptyFile,
    /// It begins like none of the formats.
    #[error("neither PGM (P2, P5), PBM (P1, P4), PNG nor BMP")]
    Format,
    /// It has no pixels.
    #[error("{0} x {1} pixels: the image is empty")]
    NoPixels(usize, usize),
    /// It has more pixels than a grid may have cells.
    #[error("{0} x {1} pixels are too many")]
    TooLarge(usize, usize),
    /// Its pixels have more than 16 bits, or none.
    #[error("grey values up to {0}: only 1 to 65535 are read")]
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
    /// The BMP is malformed.
    #[error("BMP: {0}")]
    Bmp(String),
}

/// A grey image, top row first; with alpha where the file has it.
#[derive(Debug, PartialEq)]
pub struct Pixels {
    pub width: usize,
    pub height: usize,
    pub grey: Vec<u8>,
    pub alpha: Option<Vec<u8>>,
}

/// Reads an image, recognised by its first bytes.
pub fn read(bytes: &[u8]) -> Result<Pixels, ImageError> {
    match bytes {
        [b'P', kind @ (b'1' | b'2' | b'4' | b'5'), rest @ ..] => read_netpbm(*kind, rest),
        [0x89, b'P', b'N', b'G', ..] => read_png(bytes),
        [b'B', b'M', ..] => read_bmp(bytes),
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

/// Netpbm after its kind: P1 and P4 are bits, of which 1 is black; P2 and P5 grey values; P1 and P2 in text.
fn read_netpbm(kind: u8, mut rest: &[u8]) -> Result<Pixels, ImageError> {
    let bits = matches!(kind, b'1' | b'4');
    let [width, height] = [number(&mut rest)?, number(&mut rest)?];
    let greatest = if bits { 1 } else { number(&mut rest)? };
    let pixels = checked(width, height)?;
    if greatest == 0 || greatest > 65535 {
        return Err(ImageError::Depth(greatest));
    }
    let values = match kind {
        b'4' | b'5' => binary(bits, [width, height], greatest, rest)?,
        _ => texts(pixels, bits, &mut rest)?,
    };
    if let Some(k) = values.iter().position(|&v| v > greatest) {
        return Err(ImageError::Bright { pixel: k, value: values[k], greatest });
    }
    let grey = |v: usize| ((v * 255 + greatest / 2) / greatest) as u8;
    let grey = values.into_iter().map(|v| if bits { 255 - grey(v) } else { grey(v) }).collect();
    Ok(Pixels { width, height, grey, alpha: None })
}

/// Values as bytes, or as the bits of whole bytes for each row.
fn binary(
    bits: bool,
    [width, height]: [usize; 2],
    greatest: usize,
    rest: &[u8],
) -> Result<Vec<usize>, ImageError> {
    let wide = greatest > 255;
    let row = if bits { width.div_ceil(8) } else { width * (1 + usize::from(wide)) };
    // A single white space ends the header; lines of Windows end with two characters.
    let data = match rest.strip_prefix(b"\r\n") {
        Some(data) if data.len() >= row * height => data,
        _ => rest.get(1..).unwrap_or_default(),
    };
    let found = data.len() * width / row.max(1);
    let data = data.get(..row * height).ok_or(ImageError::Truncated { found, expected: width * height })?;
    let bit = |k: usize| usize::from(data[k / width * row + k % width / 8] >> (7 - k % width % 8) & 1);
    Ok(match (bits, wide) {
        (true, _) => (0..width * height).map(bit).collect(),
        (false, true) => {
            data.chunks_exact(2).map(|b| usize::from(u16::from_be_bytes([b[0], b[1]]))).collect()
        }
        (false, false) => data.iter().map(|v| usize::from(*v)).collect(),
    })
}

/// Values in text; bits may stand without blanks between them.
fn texts(pixels: usize, bits: bool, rest: &mut &[u8]) -> Result<Vec<usize>, ImageError> {
    let mut values = Vec::with_capacity(pixels.min(rest.len()));
    for k in 0..pixels {
        let value = match bits {
            true => {
                let blanks = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
                let digit = rest.get(blanks).filter(|b| b.is_ascii_digit()).map(|b| usize::from(b - b'0'));
                *rest = rest.get(blanks + 1..).unwrap_or_default();
                digit
            }
            false => number(rest).ok(),
        };
        values.push(value.ok_or(ImageError::Number { pixel: Some(k) })?);
    }
    Ok(values)
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

fn read_bmp(bytes: &[u8]) -> Result<Pixels, ImageError> {
    use zune_bmp::zune_core::{bytestream::ZCursor, colorspace::ColorSpace};
    let wrong = |e: zune_bmp::BmpDecoderErrors| ImageError::Bmp(format!("{e:?}"));
    let mut decoder = zune_bmp::BmpDecoder::new(ZCursor::new(bytes));
    decoder.decode_headers().map_err(wrong)?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let pixels = checked(width, height)?;
    let colours = match decoder.colorspace() {
        Some(ColorSpace::Luma) => 1,
        Some(ColorSpace::RGBA | ColorSpace::BGRA) => 4,
        _ => 3,
    };
    let data = decoder.decode().map_err(wrong)?;
    if data.len() < pixels * colours {
        return Err(ImageError::Truncated { found: data.len() / colours, expected: pixels });
    }
    // What its fourth byte means, no two programs agree on.
    let used = colours.min(3);
    let mean = |p: &[u8]| (p[..used].iter().map(|&v| u32::from(v)).sum::<u32>() / used as u32) as u8;
    let grey = data.chunks_exact(colours).take(pixels).map(mean).collect();
    Ok(Pixels { width, height, grey, alpha: None })
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
    fn every_kind_of_netpbm_is_the_same_image() {
        let wanted = [0, 255, 255, 0, 255, 0];
        for bytes in [
            &b"P1\n3 2\n1 0 0\n1 0 1\n"[..],
            b"P1 3 2 100101",
            b"P4\n3 2\n\x80\xa0",
            b"P2 3 2 1 0 1 1 0 1 0",
            b"P2 3 2 65535 0 65535 65535 0 65535 0",
            b"P5\r\n3 2\r\n255\r\n\x00\xff\xff\x00\xff\x00",
            b"P5\n3 2\n65535\n\x00\x00\xff\xff\xff\xff\x00\x00\xff\xff\x00\x00",
        ] {
            assert_eq!(read(bytes).unwrap().grey, wanted, "{}", bytes.escape_ascii());
        }
    }

    #[test]
    fn bitmaps_are_read_from_their_last_row_up() {
        let header = |size: u32, bits: u16, colours: u32, at: u32| {
            let words = [40u32, 2, 2, u32::from(bits) << 16 | 1, 0, 0, 0, 0, colours, 0];
            let mut bytes = b"BM".to_vec();
            bytes.extend([size, 0, at].iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend(words.iter().flat_map(|v| v.to_le_bytes()));
            bytes
        };
        let mut colour = header(70, 24, 0, 54);
        colour.extend([30, 30, 30, 40, 40, 40, 0, 0, 10, 10, 10, 20, 20, 20, 0, 0]);
        assert_eq!(read(&colour).unwrap().grey, [10, 20, 30, 40]);
        let mut palette = header(70, 8, 2, 54);
        palette.extend([0, 0, 0, 0, 255, 255, 255, 0]);
        palette.extend([1, 0, 0, 0, 0, 1, 0, 0]);
        palette[10] = 62;
        assert_eq!(read(&palette).unwrap().grey, [0, 255, 255, 0]);
        (0..colour.len()).for_each(|n| drop(read(&colour[..n])));
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
            (b"P5 1 1 65536\n\x00\x00", "65536"),
            (b"P5 1 1 65535\n\x00", "truncated"),
            (b"P2 1 1 255\n300", "300, above 255"),
            (b"P2 1 1 10\n11", "above 10"),
        ] {
            let told = read(bytes).unwrap_err().to_string();
            assert!(told.contains(word), "{told}");
        }
    }
}
