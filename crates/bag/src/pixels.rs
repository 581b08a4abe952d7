//! Converts the pixels of `sensor_msgs/Image` to luminance, and to depth in millimetres.
//!
//! Encodings are those of `sensor_msgs/image_encodings` and of the RealSense SDK. The luminance of colour is weighted
//! as in BT.601 (0.299, 0.587, 0.114); of 16-bit pixels the highest eight of the bits in use are taken. Bayer mosaics are
//! interpolated bilinearly. Of planar and semi-planar YUV the first plane is the luminance.

use crate::error::DecodeError;
use crate::message::{ImageMessage, millimetres};
use cairn_sensor::{DepthImage, GrayImage};

/// Size of the largest image, pixels.
const MAX_PIXELS: usize = 64 << 20;

impl ImageMessage<'_> {
    /// The rows without padding, each `bytes_per_pixel * width` bytes long.
    fn rows(&self, bytes_per_pixel: usize) -> Result<impl Iterator<Item = &[u8]>, DecodeError> {
        let (w, h, step) = (self.width as usize, self.height as usize, self.step as usize);
        if w == 0 || h == 0 || w.saturating_mul(h) > MAX_PIXELS {
            return Err(DecodeError::new(format!("{w}x{h} pixels is not a supported image size")));
        }
        let row = w * bytes_per_pixel;
        // Drivers that leave it at zero mean rows without padding.
        let step = if step == 0 { row } else { step };
        // The last row may lack its padding.
        let needed = step.saturating_mul(h - 1).saturating_add(row);
        if step < row || needed > self.data.len() {
            return Err(DecodeError::new(format!(
                "{w}x{h} pixels of {} need {needed} bytes in rows of {row}, there are {} in rows of {step}",
                self.encoding,
                self.data.len()
            )));
        }
        Ok(self.data.chunks(step).take(h).map(move |r| &r[..row]))
    }

    /// How many bits of 16-bit pixels are in use here: cameras of 10, 12 or 14 bits leave the others at zero. `None` for other
    /// encodings, and where the data does not have the stated size.
    pub fn bits(&self) -> Option<u32> {
        let wide = Mosaic::of(&self.encoding).is_some_and(|m| m.is_wide);
        let samples = match self.encoding.as_str() {
            "mono16" | "16UC1" | "y16" => 1,
            "rgb16" | "bgr16" | "16UC3" => 3,
            "rgba16" | "bgra16" | "16UC4" => 4,
            _ if wide => 1,
            _ => return None,
        };
        let most =
            self.rows(2 * samples).ok()?.flat_map(|row| row.chunks_exact(2)).map(|p| self.wide(p)).max()?;
        Some(bits_in_use(most))
    }

    /// A sample of 16 bits.
    fn wide(&self, p: &[u8]) -> u16 {
        let raw = [p[0], p[1]];
        if self.big_endian { u16::from_be_bytes(raw) } else { u16::from_le_bytes(raw) }
    }

    /// Luminance image; of 16-bit pixels all bits are in use.
    ///
    /// # Errors
    /// When the encoding is not supported, or the data does not have the stated size.
    pub fn gray(&self) -> Result<GrayImage, DecodeError> {
        self.gray_of_bits(16)
    }

    /// Luminance image; of 16-bit pixels so many bits are in use, as [`Self::bits`] finds, and what is larger is white.
    ///
    /// # Errors
    /// When the encoding is not supported, or the data does not have the stated size.
    pub fn gray_of_bits(&self, bits: u32) -> Result<GrayImage, DecodeError> {
        let (w, h) = (self.width as usize, self.height as usize);
        let high = |p: &[u8]| (self.wide(p) >> (bits.clamp(8, 16) - 8)).min(255) as u8;
        if let Some(mosaic) = Mosaic::of(&self.encoding) {
            return GrayImage::from_vec(w, h, self.mosaic(mosaic, &high)?)
                .ok_or_else(|| DecodeError::new("rows are missing"));
        }
        let mut out: Vec<u8> = Vec::new();
        // Offsets of red, green and blue in a pixel, and samples per pixel.
        let colour = match self.encoding.as_str() {
            "mono8" | "8UC1" | "y8" | "nv12" | "nv21" | "nv16" | "nv61" | "nv24" | "nv42" | "i420"
            | "yv12" => {
                self.rows(1)?.for_each(|row| out.extend_from_slice(row));
                None
            }
            "mono16" | "16UC1" | "y16" => {
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(high)));
                None
            }
            "yuv422" | "uyvy" => {
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(|p| p[1])));
                None
            }
            "yuv422_yuy2" | "yuyv" | "YUYV" => {
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(|p| p[0])));
                None
            }
            "rgb8" | "rgb16" => Some(([0, 1, 2], 3)),
            "bgr8" | "8UC3" | "bgr16" | "16UC3" => Some(([2, 1, 0], 3)),
            "rgba8" | "rgba16" => Some(([0, 1, 2], 4)),
            "bgra8" | "8UC4" | "bgra16" | "16UC4" => Some(([2, 1, 0], 4)),
            other => {
                return Err(DecodeError::new(format!(
                    "images of encoding \"{other}\" are not read; known are mono, rgb, bgr, rgba and bgra of 8 and 16 \
                     bits, yuv422, yuv422_yuy2, nv12 and its kind, and Bayer patterns of 8 and 16 bits"
                )));
            }
        };
        if let Some(([r, g, b], n)) = colour {
            if self.encoding.contains("16") {
                self.rows(2 * n)?.for_each(|row| {
                    let of = |p: &[u8]| [r, g, b].map(|c| high(&p[2 * c..]));
                    out.extend(row.chunks_exact(2 * n).map(of).map(|[r, g, b]| luminance(r, g, b)));
                });
            } else {
                self.rows(n)?.for_each(|row| {
                    out.extend(row.chunks_exact(n).map(|p| luminance(p[r], p[g], p[b])));
                });
            }
        }
        GrayImage::from_vec(w, h, out).ok_or_else(|| DecodeError::new("rows are missing"))
    }

    /// Luminance of a mosaic: the two colours that a pixel lacks are the means of its neighbours that have them. At the border
    /// neighbours are mirrored, which keeps their colours.
    fn mosaic(&self, mosaic: Mosaic, high: &dyn Fn(&[u8]) -> u8) -> Result<Vec<u8>, DecodeError> {
        let (w, h) = (self.width as usize, self.height as usize);
        let bytes = if mosaic.is_wide { 2 } else { 1 };
        let rows: Vec<&[u8]> = self.rows(bytes)?.collect();
        if w < 2 || h < 2 || rows.len() < h {
            return Err(DecodeError::new(format!("{w}x{h} pixels are no Bayer pattern")));
        }
        // A row with a mirrored pixel at each end.
        let padded = |y: usize| {
            let mut out: Vec<u32> = Vec::with_capacity(w + 2);
            out.push(0);
            out.extend(
                rows[y].chunks_exact(bytes).map(|p| u32::from(if mosaic.is_wide { high(p) } else { p[0] })),
            );
            out.push(out[w - 1]);
            out[0] = out[2];
            out
        };
        let mut out = Vec::with_capacity(w * h);
        let (mut up, mut middle) = (padded(1), padded(0));
        for y in 0..h {
            let down = padded(if y + 1 < h { y + 1 } else { h - 2 });
            for x in 0..w {
                let [a, b, c] = [&up[x..x + 3], &middle[x..x + 3], &down[x..x + 3]];
                let (own, beside, above) = (4 * b[1], b[0] + b[2], a[1] + c[1]);
                let across = a[0] + a[2] + c[0] + c[2];
                let (row_has_red, is_green) = (y % 2 == mosaic.red_row, (x + y) % 2 == mosaic.green);
                let (red, green, blue) = match (is_green, row_has_red) {
                    (true, true) => (2 * beside, own, 2 * above),
                    (true, false) => (2 * above, own, 2 * beside),
                    (false, true) => (own, beside + above, across),
                    (false, false) => (across, beside + above, own),
                };
                out.push(((red * RED + green * GREEN + blue * BLUE + (1 << 17)) >> 18) as u8);
            }
            (up, middle) = (middle, down);
        }
        Ok(out)
    }

    /// Depth image. 16-bit pixels are kept, in the unit of the sensor (millimetres by REP 118); 32-bit metres are
    /// converted to millimetres, where any value that is not a positive number below 65.5 m becomes 0 (no measurement).
    ///
    /// # Errors
    /// When the encoding is not supported, or the data does not have the stated size.
    pub fn depth(&self) -> Result<DepthImage, DecodeError> {
        let mut out: Vec<u16> = Vec::new();
        let big = self.big_endian;
        match self.encoding.as_str() {
            "16UC1" | "mono16" | "z16" => {
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(|p| self.wide(p))));
            }
            "32FC1" => {
                let of = |p: &[u8]| {
                    let raw = [p[0], p[1], p[2], p[3]];
                    let metres = if big { f32::from_be_bytes(raw) } else { f32::from_le_bytes(raw) };
                    millimetres(metres)
                };
                self.rows(4)?.for_each(|row| out.extend(row.chunks_exact(4).map(of)));
            }
            other => {
                let why = format!("depth of encoding \"{other}\" is not read; known are 16UC1 and 32FC1");
                return Err(DecodeError::new(why));
            }
        }
        let (w, h) = (self.width as usize, self.height as usize);
        DepthImage::from_vec(w, h, out).ok_or_else(|| DecodeError::new("rows are missing"))
    }
}

/// Weights of the colours in the luminance, in 1/65536.
const RED: u32 = 19595;
const GREEN: u32 = 38470;
const BLUE: u32 = 7471;

fn luminance(r: u8, g: u8, b: u8) -> u8 {
    ((u32::from(r) * RED + u32::from(g) * GREEN + u32::from(b) * BLUE + 32768) >> 16) as u8
}

/// The bits of 16 that are in use where this is the largest value: those of cameras of 8, 10, 12 or 14 bits, else 16.
pub fn bits_in_use(largest: u16) -> u32 {
    [8, 10, 12, 14].into_iter().find(|bits| largest >> bits == 0).unwrap_or(16)
}

/// A Bayer pattern.
#[derive(Clone, Copy)]
struct Mosaic {
    /// Parity of the rows that have red pixels.
    red_row: usize,
    /// Parity of column plus row of the green pixels.
    green: usize,
    /// Whether pixels have 16 bits.
    is_wide: bool,
}

impl Mosaic {
    /// Of an encoding such as `bayer_rggb8`: the colours of the first four pixels, row by row.
    fn of(encoding: &str) -> Option<Self> {
        let (pattern, bits) = encoding.strip_prefix("bayer_")?.split_at_checked(4)?;
        let (red_row, green) = match pattern {
            "rggb" => (0, 1),
            "grbg" => (0, 0),
            "gbrg" => (1, 0),
            "bggr" => (1, 1),
            _ => return None,
        };
        let is_wide = match bits {
            "8" => false,
            "16" => true,
            _ => return None,
        };
        Some(Self { red_row, green, is_wide })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message<'a>(encoding: &str, [width, height]: [u32; 2], step: u32, data: &'a [u8]) -> ImageMessage<'a> {
        let header = crate::wire::Header { stamp_ns: 0, frame_id: String::new() };
        ImageMessage { header, height, width, encoding: encoding.into(), big_endian: false, step, data }
    }

    /// A picture whose colours change evenly over it, as the sensor of each pattern sees it: bilinear interpolation is exact
    /// inside.
    #[test]
    fn mosaics_have_the_luminance_of_their_colours() {
        let (w, h) = (12usize, 9usize);
        let colour = |x: usize, y: usize| [40 + 4 * x + 2 * y, 200 - 6 * x + 4 * y, 10 + 2 * x + 8 * y];
        let patterns =
            [("rggb", [0, 1, 1, 2]), ("grbg", [1, 0, 2, 1]), ("gbrg", [1, 2, 0, 1]), ("bggr", [2, 1, 1, 0])];
        for ((pattern, first), bytes) in patterns.into_iter().flat_map(|p| [(p, 1usize), (p, 2)]) {
            let step = w * bytes + 3;
            let mut data = vec![99; step * h];
            for (x, y) in (0..w * h).map(|i| (i % w, i / w)) {
                data[y * step + x * bytes + bytes - 1] = colour(x, y)[first[2 * (y % 2) + x % 2]] as u8;
            }
            let encoding = format!("bayer_{pattern}{}", 8 * bytes);
            let gray = message(&encoding, [w as u32, h as u32], step as u32, &data).gray().unwrap();
            for (x, y) in (0..w * h).map(|i| (i % w, i / w)) {
                let [r, g, b] = colour(x, y).map(|v| v as u8);
                let off = i32::from(gray.data()[y * w + x]) - i32::from(luminance(r, g, b));
                // At the border the missing colours are those of a column or row farther in.
                let inside = (1..w - 1).contains(&x) && (1..h - 1).contains(&y);
                assert!(off.abs() <= if inside { 0 } else { 6 }, "{encoding} at {x}, {y}: {off}");
            }
        }
    }

    #[test]
    fn what_is_no_mosaic_is_refused() {
        for encoding in ["bayer_rggb12", "bayer_rgbg8", "bayer_", "bayer_rgg\u{e4}8"] {
            let refused = message(encoding, [2, 2], 2, &[0; 4]).gray().unwrap_err().to_string();
            assert!(refused.contains("are not read"), "{refused}");
        }
        assert!(message("bayer_rggb8", [1, 4], 1, &[0; 4]).gray().is_err());
        assert!(message("bayer_rggb8", [4, 4], 4, &[0; 15]).gray().is_err());
        assert_eq!(message("bayer_bggr16", [2, 2], 4, &[0; 8]).gray().unwrap().data(), [0; 4]);
    }
}
