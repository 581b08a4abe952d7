//! Image files to pixels: JPEG, PNG (8 and 16 bit) and BMP, gray or colour to luminance; 16-bit PNG to depth.
//!
//! The format is detected from the first bytes, not the name. JPEG luminance is the stored Y plane; colour
//! PNG is weighted as in BT.601 (0.299, 0.587, 0.114); 16-bit gray keeps its high byte.

use crate::exif;
use cairn_sensor::{DepthImage, GrayImage};
use png::{BitDepth, ColorType, Transformations};
use std::io::Cursor;
use std::path::Path;
use zune_bmp::BmpDecoder;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Largest supported image, pixels; a broken header may claim more.
const MAX_PIXELS: usize = 64 << 20;

/// Largest image file, bytes.
const MAX_BYTES: u64 = 512 * cairn_files::MIB;

/// Why an image could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] std::io::Error),
    /// Not a file of a kind that holds such an image.
    #[error("{0}")]
    Kind(&'static str),
    /// A depth image of other samples than 16 bits.
    #[error("depth must be 16-bit gray, this PNG has {channels} channel(s) of {bits} bits")]
    NotDepth {
        /// Samples of a pixel.
        channels: usize,
        /// Bits of each.
        bits: usize,
    },
    /// No pixels, or more than are read.
    #[error("{0}x{1} pixels is not a supported image size")]
    Size(usize, usize),
    /// What the decoder says of damaged data.
    #[error("{0}")]
    Damaged(String),
    /// The same of a file with this name.
    #[error("{name}: {why}")]
    InFile {
        /// Its name.
        name: String,
        /// What is wrong with it.
        why: Box<ImageError>,
    },
}

fn jpeg_error(e: impl std::fmt::Display) -> ImageError {
    ImageError::Damaged(format!("JPEG: {e}"))
}

fn png_error(e: impl std::fmt::Display) -> ImageError {
    ImageError::Damaged(format!("PNG: {e}"))
}

fn bmp_error(e: impl std::fmt::Debug) -> ImageError {
    ImageError::Damaged(format!("BMP: {e:?}"))
}

/// Whether the ending of a name is that of an image that is read.
pub fn is_image(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    ending.is_some_and(|e| matches!(e.as_str(), "png" | "jpg" | "jpeg" | "bmp"))
}

/// Luminance of an image file; of pixels of 16 bits all are in use.
///
/// # Errors
///
/// [`ImageError`] when the file cannot be read or decoded.
pub fn gray(path: &Path) -> Result<GrayImage, ImageError> {
    gray_of_bits(path, 16)
}

/// As [`gray`]; of pixels of 16 bits so many are in use, as [`bits`] finds, and what is larger is white.
///
/// # Errors
///
/// As [`gray`].
pub fn gray_of_bits(path: &Path, bits: u32) -> Result<GrayImage, ImageError> {
    in_file(path, |bytes| gray_of(bytes, bits))
}

/// How many bits of 16-bit pixels are in use: of cameras of 10, 12 or 14 bits the others may be zero. `None` for files of 8 bits.
pub fn bits(path: &Path) -> Option<u32> {
    let of = |bytes: &[u8]| if is_wide(bytes)? { png_raw(bytes).map(Some) } else { Ok(None) };
    let raw = in_file(path, of).ok().flatten()?;
    Some(cairn_bag::bits_in_use(raw.wide().max().unwrap_or(0)))
}

/// Whether a file is a PNG with samples of 16 bits.
fn is_wide(bytes: &[u8]) -> Result<bool, ImageError> {
    match kind(bytes)? {
        Kind::Png => {
            let reader = png::Decoder::new(Cursor::new(bytes)).read_info().map_err(png_error)?;
            Ok(reader.info().bit_depth == BitDepth::Sixteen)
        }
        Kind::Jpeg | Kind::Bmp => Ok(false),
    }
}

/// Luminance of a JPEG, PNG or BMP in memory; a panic of the decoder becomes an error.
///
/// # Errors
/// [`ImageError`] when it cannot be decoded.
pub fn gray_in(bytes: &[u8]) -> Result<GrayImage, ImageError> {
    guarded(|| gray_of(bytes, 16))
}

fn gray_of(bytes: &[u8], bits: u32) -> Result<GrayImage, ImageError> {
    match kind(bytes)? {
        Kind::Jpeg => jpeg_gray(bytes),
        Kind::Png => png_gray(bytes, bits),
        Kind::Bmp => bmp_gray(bytes),
    }
}

/// Luminance of a JPEG in memory, as a phone's page sends it; a panic of the decoder becomes an error.
pub fn gray_jpeg(bytes: &[u8]) -> Result<GrayImage, ImageError> {
    guarded(|| match kind(bytes)? {
        Kind::Jpeg => jpeg_gray(bytes),
        Kind::Png | Kind::Bmp => Err(ImageError::Kind("not a JPEG")),
    })
}

/// A depth image in the file's own units.
pub fn depth(path: &Path) -> Result<DepthImage, ImageError> {
    in_file(path, depth_of)
}

/// A depth image in memory.
///
/// # Errors
/// [`ImageError`] when it cannot be decoded.
pub fn depth_in(bytes: &[u8]) -> Result<DepthImage, ImageError> {
    guarded(|| depth_of(bytes))
}

fn depth_of(bytes: &[u8]) -> Result<DepthImage, ImageError> {
    match kind(bytes)? {
        Kind::Jpeg | Kind::Bmp => Err(ImageError::Kind("a JPEG or BMP cannot store 16-bit depth")),
        Kind::Png => png_depth(bytes),
    }
}

/// The orientation that a JPEG states, if it is another than upright.
pub fn orientation(path: &Path) -> Option<u16> {
    in_file(path, |bytes| Ok(matches!(kind(bytes)?, Kind::Jpeg).then(|| exif::orientation(bytes)).flatten()))
        .ok()?
}

/// Width and height from the file's header.
pub fn size(path: &Path) -> Result<[usize; 2], ImageError> {
    in_file(path, size_of)
}

/// Width and height of a file in memory.
pub fn size_in(bytes: &[u8]) -> Result<[usize; 2], ImageError> {
    guarded(|| size_of(bytes))
}

fn size_of(bytes: &[u8]) -> Result<[usize; 2], ImageError> {
    match kind(bytes)? {
        Kind::Jpeg => {
            let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), jpeg_options());
            decoder.decode_headers().map_err(jpeg_error)?;
            decoder.dimensions().map(|(w, h)| [w, h]).ok_or_else(|| jpeg_error("no size is stated"))
        }
        Kind::Png => {
            let reader = png::Decoder::new(Cursor::new(bytes)).read_info().map_err(png_error)?;
            let info = reader.info();
            Ok([info.width as usize, info.height as usize])
        }
        Kind::Bmp => {
            let mut decoder = BmpDecoder::new(ZCursor::new(bytes));
            decoder.decode_headers().map_err(bmp_error)?;
            decoder.dimensions().map(|(w, h)| [w, h]).ok_or_else(|| bmp_error("no size is stated"))
        }
    }
}

enum Kind {
    Jpeg,
    Png,
    Bmp,
}

fn kind(bytes: &[u8]) -> Result<Kind, ImageError> {
    match bytes {
        [0xff, 0xd8, 0xff, ..] => Ok(Kind::Jpeg),
        [0x89, b'P', b'N', b'G', ..] => Ok(Kind::Png),
        [b'B', b'M', ..] => Ok(Kind::Bmp),
        [] => Err(ImageError::Kind("the file is empty")),
        [b'R', b'I', b'F', b'F', ..] => {
            Err(ImageError::Kind("WebP, which is not read: JPEG, PNG and BMP are"))
        }
        [b'I', b'I', b'*', 0, ..] | [b'M', b'M', 0, b'*', ..] => {
            Err(ImageError::Kind("TIFF, which is not read: JPEG, PNG and BMP are"))
        }
        [b'P', b'1'..=b'6', ..] => {
            Err(ImageError::Kind("PGM or PPM, which is not read: JPEG, PNG and BMP are"))
        }
        [b'v', b'/', b'1', 1, ..] => Err(ImageError::Kind("EXR, which is not read: JPEG, PNG and BMP are")),
        _ => Err(ImageError::Kind("neither JPEG, PNG nor BMP")),
    }
}

/// Reads the file and decodes it.
fn in_file<T>(path: &Path, decode: impl Fn(&[u8]) -> Result<T, ImageError>) -> Result<T, ImageError> {
    let name = path.file_name().map(|n| n.to_string_lossy()).unwrap_or_default();
    let read = cairn_files::read(path, MAX_BYTES).map_err(ImageError::from);
    let decoded = read.and_then(|bytes| guarded(|| decode(&bytes)));
    decoded.map_err(|why| ImageError::InFile { name: name.into_owned(), why: Box::new(why) })
}

/// A panic of a decoder on broken data becomes an error.
fn guarded<T>(decode: impl FnOnce() -> Result<T, ImageError>) -> Result<T, ImageError> {
    let decoded = std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode));
    decoded.unwrap_or_else(|_| Err(ImageError::Damaged("the decoder failed".into())))
}

fn jpeg_options() -> DecoderOptions {
    DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::Luma)
}

fn jpeg_gray(bytes: &[u8]) -> Result<GrayImage, ImageError> {
    // The decoder fills in missing data; coded data never contains an end marker, so its absence reveals
    // truncation.
    let end = bytes.windows(2).rposition(|w| w == [0xff, 0xd9]);
    if end.is_none_or(|at| at < bytes.len() / 2) {
        return Err(jpeg_error("truncated (no end marker)"));
    }
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), jpeg_options());
    decoder.decode_headers().map_err(jpeg_error)?;
    let (w, h) = decoder.dimensions().ok_or_else(|| jpeg_error("no size is stated"))?;
    check_size(w, h)?;
    let pixels = decoder.decode().map_err(jpeg_error)?;
    GrayImage::from_vec(w, h, pixels)
        .ok_or_else(|| jpeg_error(format!("{w}x{h} expected, other length decoded")))
}

/// Pixels of a PNG as transformed samples: 8 or 16 bits big-endian, `channels` per pixel.
struct Raw {
    width: usize,
    height: usize,
    channels: usize,
    bytes_per_sample: usize,
    data: Vec<u8>,
}

fn png_raw(bytes: &[u8]) -> Result<Raw, ImageError> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(png_error)?;
    check_size(reader.info().width as usize, reader.info().height as usize)?;
    let length = reader.output_buffer_size().ok_or_else(|| png_error("too large"))?;
    let mut data = vec![0; length];
    let info = reader.next_frame(&mut data).map_err(png_error)?;
    data.truncate(info.buffer_size());
    let channels = match info.color_type {
        ColorType::Grayscale | ColorType::Indexed => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
    };
    let bytes_per_sample = if info.bit_depth == BitDepth::Sixteen { 2 } else { 1 };
    Ok(Raw { width: info.width as usize, height: info.height as usize, channels, bytes_per_sample, data })
}

impl Raw {
    /// The samples of 16 bits that are light, not alpha.
    fn wide(&self) -> impl Iterator<Item = u16> {
        let light = if self.channels < 3 { 1 } else { 3 };
        let sample = |p: &[u8]| u16::from_be_bytes([p[0], p[1]]);
        self.data
            .chunks_exact(2 * self.channels)
            .flat_map(move |p| p[..2 * light].chunks_exact(2).map(sample))
    }
}

fn png_gray(bytes: &[u8], bits: u32) -> Result<GrayImage, ImageError> {
    let raw = png_raw(bytes)?;
    let light: Vec<u8> = match (raw.bytes_per_sample, raw.channels) {
        (2, _) => raw.wide().map(|v| (v >> (bits.clamp(8, 16) - 8)).min(255) as u8).collect(),
        (_, 2) => raw.data.chunks_exact(2).map(|p| p[0]).collect(),
        (_, 4) => raw.data.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect(),
        _ => raw.data,
    };
    let data = match raw.channels {
        1 | 2 => light,
        _ => light.chunks_exact(3).map(|p| luminance(p[0], p[1], p[2])).collect(),
    };
    GrayImage::from_vec(raw.width, raw.height, data).ok_or_else(|| png_error("rows are missing"))
}

fn png_depth(bytes: &[u8]) -> Result<DepthImage, ImageError> {
    let raw = png_raw(bytes)?;
    if raw.channels != 1 || raw.bytes_per_sample != 2 {
        return Err(ImageError::NotDepth { channels: raw.channels, bits: 8 * raw.bytes_per_sample });
    }
    let data = raw.data.chunks_exact(2).map(|p| u16::from_be_bytes([p[0], p[1]])).collect();
    DepthImage::from_vec(raw.width, raw.height, data).ok_or_else(|| png_error("rows are missing"))
}

fn bmp_gray(bytes: &[u8]) -> Result<GrayImage, ImageError> {
    let mut decoder = BmpDecoder::new(ZCursor::new(bytes));
    decoder.decode_headers().map_err(bmp_error)?;
    let (w, h) = decoder.dimensions().ok_or_else(|| bmp_error("no size is stated"))?;
    check_size(w, h)?;
    let channels = decoder.colorspace().map_or(3, |c| c.num_components());
    let data = decoder.decode().map_err(bmp_error)?;
    let data = match channels {
        1 => data,
        _ => data.chunks_exact(channels).map(|p| luminance(p[0], p[1], p[2])).collect(),
    };
    GrayImage::from_vec(w, h, data).ok_or_else(|| bmp_error("rows are missing"))
}

fn luminance(r: u8, g: u8, b: u8) -> u8 {
    ((u32::from(r) * 19595 + u32::from(g) * 38470 + u32::from(b) * 7471 + 32768) >> 16) as u8
}

fn check_size(w: usize, h: usize) -> Result<(), ImageError> {
    if w == 0 || h == 0 || w.saturating_mul(h) > MAX_PIXELS {
        return Err(ImageError::Size(w, h));
    }
    Ok(())
}
