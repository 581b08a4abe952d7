//! Frames as the kernel delivers them to images, and the choice of a mode.

use super::device::{DeviceError, Mode, PixelFormat, Trouble};
use crate::decode::{ImageError, gray_jpeg};
use cairn_sensor::{DepthImage, GrayImage};

/// Formats of one gray or colour image, the cheapest to read first.
pub const IMAGE: [PixelFormat; 5] =
    [PixelFormat::GREY, PixelFormat::NV12, PixelFormat::YUYV, PixelFormat::UYVY, PixelFormat::MJPG];

/// Why a frame of the kernel is no image.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// Bytes are missing.
    #[error("{bytes} bytes are too few for {mode}")]
    Short {
        /// Bytes that there are.
        bytes: usize,
        /// The mode of the stream.
        mode: Mode,
    },
    /// Its size is none.
    #[error("not a frame of {0}")]
    Size(Mode),
    /// A JPEG that cannot be decoded.
    #[error(transparent)]
    Jpeg(#[from] ImageError),
    /// A JPEG of another size than the stream's.
    #[error("a JPEG of {width}x{height}, not {mode}")]
    JpegSize {
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// The mode of the stream.
        mode: Mode,
    },
    /// The format has no images.
    #[error("{0} is no format of images")]
    NoImage(PixelFormat),
    /// The format has no depth.
    #[error("{0} is no format of depth")]
    NoDepth(PixelFormat),
}

/// What a stream is to deliver.
#[derive(Clone, Debug, PartialEq)]
pub struct ModeRequest {
    /// The formats that will do, the best first.
    pub formats: Vec<PixelFormat>,
    /// Width and height; without one, near to 640x480.
    pub size: Option<[usize; 2]>,
    /// Frames per second.
    pub rate_hz: f64,
}

/// The mode that fits best: of the wanted size, at the wanted rate or the next to it, and then by format.
///
/// # Errors
/// A sentence that says what the node has instead.
pub fn choose(what: &str, modes: &[Mode], wanted: &ModeRequest) -> Result<Mode, DeviceError> {
    let fail = |why: String| DeviceError::new(Trouble::Unsuitable, what, why);
    let names =
        |formats: &[PixelFormat]| formats.iter().map(|f| f.to_string()).collect::<Vec<_>>().join(", ");
    let readable: Vec<&Mode> = modes.iter().filter(|m| wanted.formats.contains(&m.format)).collect();
    if readable.is_empty() {
        let mut has: Vec<PixelFormat> = modes.iter().map(|m| m.format).collect();
        has.dedup();
        let has = if has.is_empty() { "no format".to_owned() } else { names(&has) };
        return Err(fail(format!("has {has}, one of {} is needed", names(&wanted.formats))));
    }
    let away = |m: &Mode| (m.width * m.height).abs_diff(640 * 480);
    let size = wanted.size.or_else(|| readable.iter().min_by_key(|m| away(m)).map(|m| [m.width, m.height]));
    let fits: Vec<&Mode> = readable.iter().copied().filter(|m| Some([m.width, m.height]) == size).collect();
    let rank = |m: &Mode| {
        let slow = (wanted.rate_hz - m.rate_hz).max(0.0).round() as u64;
        let fast = (m.rate_hz - wanted.rate_hz).max(0.0).round() as u64;
        (slow, fast, wanted.formats.iter().position(|f| *f == m.format))
    };
    fits.into_iter().min_by_key(|m| rank(m)).copied().ok_or_else(|| {
        let mut sizes: Vec<[usize; 2]> = readable.iter().map(|m| [m.width, m.height]).collect();
        sizes.sort_unstable();
        sizes.dedup();
        let has: Vec<String> = sizes.iter().map(|[w, h]| format!("{w}x{h}")).collect();
        let [w, h] = size.unwrap_or_default();
        fail(format!("has no images of {w}x{h}, as the rig says, but {}", has.join(", ")))
    })
}

/// A row of the frame, and how many bytes of it are pixels.
fn rows<'a>(mode: &Mode, bytes: &'a [u8], row: usize) -> Result<impl Iterator<Item = &'a [u8]>, FormatError> {
    let stride = mode.stride.max(row);
    let needed = mode.height.saturating_sub(1).checked_mul(stride).and_then(|n| n.checked_add(row));
    if row == 0 || mode.height == 0 || needed.is_none_or(|needed| bytes.len() < needed) {
        return Err(FormatError::Short { bytes: bytes.len(), mode: *mode });
    }
    Ok(bytes.chunks(stride).take(mode.height).map(move |r| &r[..row]))
}

fn image(mode: &Mode, data: Vec<u8>) -> Result<GrayImage, FormatError> {
    GrayImage::from_vec(mode.width, mode.height, data).ok_or(FormatError::Size(*mode))
}

/// Every second byte of the frame, from the first or the second on.
fn every_second(mode: &Mode, bytes: &[u8], first: usize) -> Result<GrayImage, FormatError> {
    let rows = rows(mode, bytes, 2 * mode.width)?;
    let mut data = Vec::with_capacity(mode.width * mode.height);
    for row in rows {
        data.extend(row[first..].iter().step_by(2));
    }
    image(mode, data)
}

/// The images of a frame: one, or the pair of an interleaved format.
///
/// # Errors
/// When bytes are missing, or a JPEG cannot be decoded or has another size.
pub fn images(mode: &Mode, bytes: &[u8]) -> Result<Vec<GrayImage>, FormatError> {
    match mode.format {
        PixelFormat::GREY | PixelFormat::NV12 => {
            let rows = rows(mode, bytes, mode.width)?;
            let mut data = Vec::with_capacity(mode.width * mode.height);
            rows.for_each(|row| data.extend_from_slice(row));
            Ok(vec![image(mode, data)?])
        }
        PixelFormat::YUYV => Ok(vec![every_second(mode, bytes, 0)?]),
        PixelFormat::UYVY => Ok(vec![every_second(mode, bytes, 1)?]),
        PixelFormat::Y8I => Ok(vec![every_second(mode, bytes, 0)?, every_second(mode, bytes, 1)?]),
        PixelFormat::MJPG => {
            let image = gray_jpeg(bytes)?;
            if [image.width(), image.height()] != [mode.width, mode.height] {
                let (width, height) = (image.width(), image.height());
                return Err(FormatError::JpegSize { width, height, mode: *mode });
            }
            Ok(vec![image])
        }
        other => Err(FormatError::NoImage(other)),
    }
}

/// The depth image of a frame.
///
/// # Errors
/// When bytes are missing.
pub fn depth(mode: &Mode, bytes: &[u8]) -> Result<DepthImage, FormatError> {
    if mode.format != PixelFormat::Z16 {
        return Err(FormatError::NoDepth(mode.format));
    }
    let rows = rows(mode, bytes, 2 * mode.width)?;
    let mut data = Vec::with_capacity(mode.width * mode.height);
    for row in rows {
        data.extend(row.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b)));
    }
    DepthImage::from_vec(mode.width, mode.height, data).ok_or(FormatError::Size(*mode))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(format: PixelFormat, width: usize, height: usize, stride: usize, rate_hz: f64) -> Mode {
        Mode { format, width, height, stride, rate_hz }
    }

    #[test]
    fn luminance_is_found_in_every_layout() {
        let m = |format, stride| mode(format, 2, 2, stride, 30.0);
        let one =
            |format, stride, bytes: &[u8]| images(&m(format, stride), bytes).unwrap()[0].data().to_vec();
        assert_eq!(one(PixelFormat::GREY, 2, &[1, 2, 3, 4]), [1, 2, 3, 4]);
        // Rows padded to four bytes, the last one not.
        assert_eq!(one(PixelFormat::GREY, 4, &[1, 2, 0, 0, 3, 4]), [1, 2, 3, 4]);
        assert_eq!(one(PixelFormat::NV12, 2, &[1, 2, 3, 4, 9, 9]), [1, 2, 3, 4]);
        assert_eq!(one(PixelFormat::YUYV, 4, &[1, 9, 2, 9, 3, 9, 4, 9]), [1, 2, 3, 4]);
        assert_eq!(one(PixelFormat::UYVY, 4, &[9, 1, 9, 2, 9, 3, 9, 4]), [1, 2, 3, 4]);
        let pair = images(&m(PixelFormat::Y8I, 4), &[1, 5, 2, 6, 3, 7, 4, 8]).unwrap();
        assert_eq!((pair[0].data(), pair[1].data()), (&[1, 2, 3, 4][..], &[5, 6, 7, 8][..]));
        let z = depth(&m(PixelFormat::Z16, 4), &[1, 0, 0, 1, 255, 255, 0, 0]).unwrap();
        assert_eq!(z.data(), [1, 256, 65535, 0]);
    }

    #[test]
    fn what_is_too_short_or_of_another_kind_is_refused() {
        for format in [PixelFormat::GREY, PixelFormat::YUYV, PixelFormat::Y8I, PixelFormat::MJPG] {
            for bytes in [&[][..], &[7; 3]] {
                assert!(images(&mode(format, 2, 2, 0, 30.0), bytes).is_err(), "{format}");
            }
        }
        assert!(images(&mode(PixelFormat::GREY, 0, 0, 0, 30.0), &[]).is_err());
        assert!(images(&mode(PixelFormat::GREY, 1, usize::MAX, 8, 30.0), &[0; 64]).is_err());
        assert!(depth(&mode(PixelFormat::Z16, 2, 2, 4, 30.0), &[0; 7]).is_err());
        assert!(depth(&mode(PixelFormat::GREY, 2, 2, 4, 30.0), &[0; 8]).is_err());
    }

    #[test]
    fn the_mode_is_of_the_size_then_the_rate_then_the_format() {
        let modes = [
            mode(PixelFormat::YUYV, 1280, 720, 0, 10.0),
            mode(PixelFormat::MJPG, 1280, 720, 0, 30.0),
            mode(PixelFormat::YUYV, 640, 480, 0, 30.0),
            mode(PixelFormat::YUYV, 640, 480, 0, 60.0),
            mode(PixelFormat::MJPG, 640, 480, 0, 30.0),
        ];
        let wanted = |size, rate_hz| ModeRequest { formats: IMAGE.to_vec(), size, rate_hz };
        let of = |size, rate| choose("/dev/video9", &modes, &wanted(size, rate)).map(|m| m.to_string());
        assert_eq!(of(None, 30.0).unwrap(), "YUYV 640x480 at 30 Hz");
        assert_eq!(of(Some([1280, 720]), 30.0).unwrap(), "MJPG 1280x720 at 30 Hz");
        assert_eq!(of(Some([640, 480]), 90.0).unwrap(), "YUYV 640x480 at 60 Hz");
        // Faster is better than slower.
        assert_eq!(of(Some([640, 480]), 45.0).unwrap(), "YUYV 640x480 at 60 Hz");
        let error = of(Some([800, 600]), 30.0).unwrap_err().to_string();
        assert!(error.contains("no images of 800x600") && error.contains("640x480, 1280x720"), "{error}");
        let depth = ModeRequest { formats: vec![PixelFormat::Z16], size: None, rate_hz: 30.0 };
        let error = choose("/dev/video9", &modes, &depth).unwrap_err().to_string();
        assert!(error.contains("Z16 is needed") && error.contains("YUYV"), "{error}");
    }
}
