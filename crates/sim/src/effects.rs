//! Image effects of a sensor: motion blur, exposure, vignette, noise.

use crate::structured::StructuredLight;
use cairn_random::Random;
use cairn_sensor::{Camera, DepthImage, GrayImage};

/// The sensor's deviations from a perfect one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects {
    /// Standard deviation of the noise of each pixel, in grey levels.
    pub noise: f64,
    /// Loss of light in the corners, 0 to 1.
    pub vignette: f64,
    /// Slow variation of the exposure, as a share (0.1: plus or minus ten per cent).
    pub exposure: f64,
    /// Flicker of the lamps from frame to frame, as a share.
    pub flicker: f64,
    /// Exposure time in seconds; the image is blurred by the motion during it. 0: none.
    pub blur_s: f64,
    /// Maximum number of sub-frames that are averaged for the blur.
    pub blur_frames: usize,
    /// Noise of depth at 1 m, in metres; it grows with the square of the depth.
    pub depth_noise: f64,
    /// Depth outside this range (metres) is not measured by a depth sensor.
    pub depth_range: [f64; 2],
    /// Depth is measured with structured light, from a projector this far to the right of the camera, metres: disparity is
    /// quantised, edges are ragged, and what the projector does not light has no depth. Replaces [`Self::depth_noise`].
    pub projector_m: Option<f64>,
}

impl Default for Effects {
    fn default() -> Self {
        Self {
            noise: 2.0,
            vignette: 0.15,
            exposure: 0.06,
            flicker: 0.01,
            blur_s: 0.0,
            blur_frames: 6,
            depth_noise: 0.0012,
            depth_range: [0.3, 10.0],
            projector_m: None,
        }
    }
}

impl Effects {
    /// A perfect sensor.
    pub fn none() -> Self {
        Self {
            noise: 0.0,
            vignette: 0.0,
            exposure: 0.0,
            flicker: 0.0,
            blur_s: 0.0,
            blur_frames: 6,
            depth_noise: 0.0,
            depth_range: [0.0, 65.5],
            projector_m: None,
        }
    }
}

/// Applies the effects to one camera's images.
pub(crate) struct Sensor {
    effects: Effects,
    /// Transmission for each pixel, in 1/4096.
    vignette: Vec<u16>,
    /// Normal noise in 1/256 grey level, longer than any row.
    noise: Vec<i16>,
    random: Random,
    sum: Vec<u32>,
    structured: Option<StructuredLight>,
}

const NOISE_TABLE: usize = 1 << 16;

impl Sensor {
    /// For a camera; `seed` and `stream` select its noise.
    pub fn new(camera: &Camera, effects: Effects, seed: u64, stream: u64) -> Self {
        let mut random = Random::stream(seed, 0x5E11 ^ stream << 8);
        let scale = effects.noise * 256.0;
        let noise = if scale > 0.0 {
            (0..NOISE_TABLE)
                .map(|_| (random.standard_normal() * scale).clamp(-32000.0, 32000.0) as i16)
                .collect()
        } else {
            Vec::new()
        };
        let (cx, cy) = (camera.width as f64 / 2.0, camera.height as f64 / 2.0);
        let reach = cx * cx + cy * cy;
        let vignette = (0..camera.width * camera.height)
            .map(|i| {
                let (x, y) = ((i % camera.width) as f64 - cx, (i / camera.width) as f64 - cy);
                ((1.0 - effects.vignette.clamp(0.0, 1.0) * (x * x + y * y) / reach) * 4096.0) as u16
            })
            .collect();
        let structured = effects.projector_m.map(|m| StructuredLight::new(camera.fx, m, &mut random));
        Self { effects, vignette, noise, random, sum: Vec::new(), structured }
    }

    /// Starts the mean of several sub-frames.
    pub fn begin(&mut self) {
        self.sum.clear();
    }

    /// Adds a sub-frame of 256 times the grey level.
    pub fn add(&mut self, grey: &[u16]) {
        if self.sum.is_empty() {
            self.sum.extend(grey.iter().map(|g| u32::from(*g)));
            return;
        }
        for (s, g) in self.sum.iter_mut().zip(grey) {
            *s += u32::from(*g);
        }
    }

    /// Finishes the mean of `frames` sub-frames: exposure, vignette, noise, eight bits.
    pub fn develop(&mut self, frames: usize, gain: f64, image: &mut GrayImage) {
        // 20 bits of gain keep the rounding under a thousandth of a grey level.
        let gain = (gain / frames.max(1) as f64 * 1_048_576.0) as u64;
        let width = image.width();
        for (y, row) in image.data_mut().chunks_exact_mut(width).enumerate() {
            let sum = &self.sum[y * width..(y + 1) * width];
            let vignette = &self.vignette[y * width..(y + 1) * width];
            let light =
                sum.iter().zip(vignette).map(|(s, v)| ((u64::from(*s) * gain * u64::from(*v)) >> 32) as i32);
            if self.noise.is_empty() {
                for (p, l) in row.iter_mut().zip(light) {
                    *p = ((l + 128) >> 8).clamp(0, 255) as u8;
                }
            } else {
                let noise = &self.noise[self.random.below(NOISE_TABLE - width)..][..width];
                for ((p, l), n) in row.iter_mut().zip(light).zip(noise) {
                    *p = ((l + 128 + i32::from(*n)) >> 8).clamp(0, 255) as u8;
                }
            }
        }
    }

    /// The exposure gain at a time.
    pub fn gain(&mut self, seconds: f64) -> f64 {
        let e = &self.effects;
        let wander = (0.37 * seconds).sin() + 0.5 * (1.13 * seconds + 1.0).sin();
        let (exposure, flicker) = (e.exposure, e.flicker);
        (1.0 + exposure * wander / 1.5 + flicker * (self.random.unit() * 2.0 - 1.0)).max(0.05)
    }

    /// Applies the range and noise of a depth sensor.
    pub fn depth(&mut self, depth: &mut DepthImage) {
        let [near, far] = self.effects.depth_range;
        let (near, far) = ((near * 1000.0) as u16, (far * 1000.0).min(65535.0) as u16);
        if let Some(structured) = &mut self.structured {
            structured.measure(depth, &mut self.random);
        }
        let k = if self.structured.is_some() { 0.0 } else { self.effects.depth_noise / 1000.0 };
        let width = depth.width().max(1);
        let mut table = [0f32; 1024];
        if k > 0.0 {
            for t in &mut table {
                *t = (self.random.standard_normal() * k) as f32;
            }
        }
        for row in depth.data_mut().chunks_exact_mut(width) {
            let start = self.random.bits() as usize;
            for (i, d) in row.iter_mut().enumerate() {
                if *d < near || *d > far {
                    *d = 0;
                } else if k > 0.0 {
                    let mm = f32::from(*d);
                    // A multiplier that is coprime to the table's length visits it in a new order per row.
                    let n = table[(start.wrapping_add(i * ((start >> 10) | 1) % 1024)) % 1024];
                    *d = (mm + mm * mm * n + 0.5).clamp(1.0, 65535.0) as u16;
                }
            }
        }
    }
}
