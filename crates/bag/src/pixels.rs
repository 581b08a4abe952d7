//! Converts the pixels of `sensor_msgs/Image` to luminance, and to depth in millimetres.
//!
//! Encodings are those of `sensor_msgs/image_encodings` and of the RealSense SDK. The luminance of colour is weighted
//! as in BT.601 (0.299, 0.587, 0.114); of 16-bit gray the high byte is used.

use crate::error::DecodeError;
use crate::message::ImageMessage;
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

    /// Luminance image.
    ///
    /// # Errors
    /// When the encoding is not supported, or the data does not have the stated size.
    pub fn gray(&self) -> Result<GrayImage, DecodeError> {
        let (w, h) = (self.width as usize, self.height as usize);
        let mut out: Vec<u8> = Vec::new();
        // Offsets of red, green and blue in a pixel, and bytes per pixel.
        let colour = match self.encoding.as_str() {
            "mono8" | "8UC1" | "y8" => {
                self.rows(1)?.for_each(|row| out.extend_from_slice(row));
                None
            }
            "mono16" | "16UC1" | "y16" => {
                let high = usize::from(!self.big_endian);
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(|p| p[high])));
                None
            }
            "yuv422" | "uyvy" => {
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(|p| p[1])));
                None
            }
            "yuv422_yuy2" | "yuyv" => {
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(|p| p[0])));
                None
            }
            "rgb8" => Some(([0, 1, 2], 3)),
            "bgr8" | "8UC3" => Some(([2, 1, 0], 3)),
            "rgba8" => Some(([0, 1, 2], 4)),
            "bgra8" | "8UC4" => Some(([2, 1, 0], 4)),
            other => {
                return Err(DecodeError::new(format!(
                    "images of encoding \"{other}\" are not read; known are mono8, mono16, rgb8, bgr8, rgba8, bgra8, \
                     yuv422 and yuv422_yuy2"
                )));
            }
        };
        if let Some(([r, g, b], n)) = colour {
            self.rows(n)?.for_each(|row| {
                out.extend(row.chunks_exact(n).map(|p| luminance(p[r], p[g], p[b])));
            });
        }
        GrayImage::from_vec(w, h, out).ok_or_else(|| DecodeError::new("rows are missing"))
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
                let of = |p: &[u8]| {
                    let raw = [p[0], p[1]];
                    if big { u16::from_be_bytes(raw) } else { u16::from_le_bytes(raw) }
                };
                self.rows(2)?.for_each(|row| out.extend(row.chunks_exact(2).map(of)));
            }
            "32FC1" => {
                let of = |p: &[u8]| {
                    let raw = [p[0], p[1], p[2], p[3]];
                    let metres = if big { f32::from_be_bytes(raw) } else { f32::from_le_bytes(raw) };
                    let mm = (metres * 1000.0).round();
                    if mm > 0.0 && mm <= f32::from(u16::MAX) { mm as u16 } else { 0 }
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

fn luminance(r: u8, g: u8, b: u8) -> u8 {
    ((u32::from(r) * 19595 + u32::from(g) * 38470 + u32::from(b) * 7471 + 32768) >> 16) as u8
}
