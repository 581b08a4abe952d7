//! Image files to pixels: JPEG and PNG, 8 and 16 bit, gray or colour to luminance; 16-bit PNG to depth.
//!
//! The format is detected from the first bytes, not the name. JPEG luminance is the stored Y plane; colour
//! PNG is weighted as in BT.601 (0.299, 0.587, 0.114); 16-bit gray keeps its high byte.

use cairn_sensor::{DepthImage, GrayImage};
use png::{BitDepth, ColorType, Transformations};
use std::io::Cursor;
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Largest supported image, pixels; a broken header may claim more.
const MAX_PIXELS: usize = 64 << 20;

/// Largest image file, bytes.
const MAX_BYTES: u64 = 512 * cairn_files::MIB;

/// Luminance of an image file.
///
/// # Errors
///
/// A description when the file cannot be read or decoded.
pub fn gray(path: &Path) -> Result<GrayImage, String> {
    in_file(path, gray_of)
}

/// Luminance of a JPEG or PNG in memory; a panic of the decoder becomes an error.
///
/// # Errors
/// A description when it cannot be decoded.
pub fn gray_in(bytes: &[u8]) -> Result<GrayImage, String> {
    guarded(|| gray_of(bytes))
}

fn gray_of(bytes: &[u8]) -> Result<GrayImage, String> {
    match kind(bytes)? {
        Kind::Jpeg => jpeg_gray(bytes),
        Kind::Png => png_gray(bytes),
    }
}

/// Luminance of a JPEG in memory, as a phone's page sends it; a panic of the decoder becomes an error.
pub fn gray_jpeg(bytes: &[u8]) -> Result<GrayImage, String> {
    guarded(|| match kind(bytes)? {
        Kind::Jpeg => jpeg_gray(bytes),
        Kind::Png => Err("not a JPEG".into()),
    })
}

/// A depth image in the file's own units, or a description of the error.
pub fn depth(path: &Path) -> Result<DepthImage, String> {
    in_file(path, depth_of)
}

/// A depth image in memory.
///
/// # Errors
/// A description when it cannot be decoded.
pub fn depth_in(bytes: &[u8]) -> Result<DepthImage, String> {
    guarded(|| depth_of(bytes))
}

fn depth_of(bytes: &[u8]) -> Result<DepthImage, String> {
    match kind(bytes)? {
        Kind::Jpeg => Err("a JPEG cannot store 16-bit depth".into()),
        Kind::Png => png_depth(bytes),
    }
}

/// Width and height from the file's header.
pub fn size(path: &Path) -> Result<[usize; 2], String> {
    in_file(path, size_of)
}

/// Width and height of a file in memory.
pub fn size_in(bytes: &[u8]) -> Result<[usize; 2], String> {
    guarded(|| size_of(bytes))
}

fn size_of(bytes: &[u8]) -> Result<[usize; 2], String> {
    match kind(bytes)? {
        Kind::Jpeg => {
            let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), jpeg_options());
            decoder.decode_headers().map_err(|e| format!("JPEG: {e}"))?;
            decoder.dimensions().map(|(w, h)| [w, h]).ok_or_else(|| "JPEG without a size".into())
        }
        Kind::Png => {
            let reader =
                png::Decoder::new(Cursor::new(bytes)).read_info().map_err(|e| format!("PNG: {e}"))?;
            let info = reader.info();
            Ok([info.width as usize, info.height as usize])
        }
    }
}

enum Kind {
    Jpeg,
    Png,
}

fn kind(bytes: &[u8]) -> Result<Kind, String> {
    match bytes {
        [0xff, 0xd8, 0xff, ..] => Ok(Kind::Jpeg),
        [0x89, b'P', b'N', b'G', ..] => Ok(Kind::Png),
        [] => Err("the file is empty".into()),
        _ => Err("neither JPEG nor PNG".into()),
    }
}

/// Reads the file and decodes it.
fn in_file<T>(path: &Path, decode: impl Fn(&[u8]) -> Result<T, String>) -> Result<T, String> {
    let name = path.file_name().map(|n| n.to_string_lossy()).unwrap_or_default();
    let bytes = cairn_files::read(path, MAX_BYTES).map_err(|e| format!("{name}: {e}"))?;
    guarded(|| decode(&bytes)).map_err(|e| format!("{name}: {e}"))
}

/// A panic of a decoder on broken data becomes an error.
fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let decoded = std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode));
    decoded.unwrap_or_else(|_| Err("the decoder failed".into()))
}

fn jpeg_options() -> DecoderOptions {
    DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::Luma)
}

fn jpeg_gray(bytes: &[u8]) -> Result<GrayImage, String> {
    // The decoder fills in missing data; coded data never contains an end marker, so its absence reveals
    // truncation.
    let end = bytes.windows(2).rposition(|w| w == [0xff, 0xd9]);
    if end.is_none_or(|at| at < bytes.len() / 2) {
        return Err("JPEG: truncated (no end marker)".into());
    }
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), jpeg_options());
    decoder.decode_headers().map_err(|e| format!("JPEG: {e}"))?;
    let (w, h) = decoder.dimensions().ok_or("JPEG without a size")?;
    check_size(w, h)?;
    let pixels = decoder.decode().map_err(|e| format!("JPEG: {e}"))?;
    GrayImage::from_vec(w, h, pixels).ok_or_else(|| format!("JPEG: {w}x{h} expected, other length decoded"))
}

/// Pixels of a PNG as transformed samples: 8 or 16 bits big-endian, `channels` per pixel.
struct Raw {
    width: usize,
    height: usize,
    channels: usize,
    bytes_per_sample: usize,
    data: Vec<u8>,
}

fn png_raw(bytes: &[u8]) -> Result<Raw, String> {
    let text = |e: png::DecodingError| format!("PNG: {e}");
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(text)?;
    check_size(reader.info().width as usize, reader.info().height as usize)?;
    let length = reader.output_buffer_size().ok_or("PNG: too large")?;
    let mut data = vec![0; length];
    let info = reader.next_frame(&mut data).map_err(text)?;
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

fn png_gray(bytes: &[u8]) -> Result<GrayImage, String> {
    let raw = png_raw(bytes)?;
    let step = raw.channels * raw.bytes_per_sample;
    let s = raw.bytes_per_sample; // the high byte of each sample comes first
    let data = match (raw.channels, s) {
        (1, 1) => raw.data,
        (1 | 2, _) => raw.data.chunks_exact(step).map(|p| p[0]).collect(),
        _ => raw.data.chunks_exact(step).map(|p| luminance(p[0], p[s], p[2 * s])).collect(),
    };
    GrayImage::from_vec(raw.width, raw.height, data).ok_or_else(|| "PNG: rows are missing".into())
}

fn png_depth(bytes: &[u8]) -> Result<DepthImage, String> {
    let raw = png_raw(bytes)?;
    if raw.channels != 1 || raw.bytes_per_sample != 2 {
        return Err(format!(
            "depth must be 16-bit gray, this PNG has {} channel(s) of {} bits",
            raw.channels,
            8 * raw.bytes_per_sample
        ));
    }
    let data = raw.data.chunks_exact(2).map(|p| u16::from_be_bytes([p[0], p[1]])).collect();
    DepthImage::from_vec(raw.width, raw.height, data).ok_or_else(|| "PNG: rows are missing".into())
}

fn luminance(r: u8, g: u8, b: u8) -> u8 {
    ((u32::from(r) * 19595 + u32::from(g) * 38470 + u32::from(b) * 7471 + 32768) >> 16) as u8
}

fn check_size(w: usize, h: usize) -> Result<(), String> {
    if w == 0 || h == 0 || w.saturating_mul(h) > MAX_PIXELS {
        return Err(format!("{w}x{h} pixels is not a supported image size"));
    }
    Ok(())
}
