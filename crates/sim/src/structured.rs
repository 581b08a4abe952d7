//! Depth as sensors with structured light have it: quantised disparity, ragged edges, holes beside near things, and noise
//! that grows with the square of the depth.
//!
//! The model is that of Handa, Whelan, McDonald and Davison, "A Benchmark for RGB-D Visual Odometry, 3D Reconstruction and
//! SLAM" (2014), section III.C, after Barron and Malik, "Intrinsic Scene Properties from a Single RGB-D Image" (2013): each
//! pixel is read at a place that is off by a normal shift of half a pixel, and its disparity, in eighths of a pixel, is
//! rounded after noise of a sixth is added. Added here: what the projector, beside the camera, does not light has no depth.

use cairn_random::Random;
use cairn_sensor::DepthImage;

/// Steps of disparity in one pixel.
const STEPS: f64 = 8.0;
/// Standard deviation of disparity, steps.
const NOISE_STEPS: f64 = 1.0 / 6.0;
/// Standard deviation of the place that is read, pixels.
const SHIFT_PX: f64 = 0.5;
/// Normal numbers that rows begin at random places of.
const TABLE: usize = 4096;

/// A sensor with structured light.
pub(crate) struct StructuredLight {
    /// Disparity in steps times depth in millimetres.
    steps_mm: f64,
    normal: Vec<f32>,
    read: Vec<u16>,
}

impl StructuredLight {
    /// `fx` in pixels, the distance from camera to projector, to the right, in metres.
    pub(crate) fn new(fx: f64, baseline_m: f64, random: &mut Random) -> Self {
        let normal = (0..TABLE).map(|_| random.standard_normal() as f32).collect();
        Self { steps_mm: STEPS * fx * baseline_m * 1000.0, normal, read: Vec::new() }
    }

    /// Makes of true depth, in millimetres (0: none), what the sensor measures.
    pub(crate) fn measure(&mut self, depth: &mut DepthImage, random: &mut Random) {
        let (width, height) = (depth.width(), depth.height());
        self.read.clear();
        self.read.extend_from_slice(depth.data());
        for row in self.read.chunks_exact_mut(width.max(1)) {
            shade(row, self.steps_mm / STEPS);
        }
        for (y, row) in depth.data_mut().chunks_exact_mut(width.max(1)).enumerate() {
            let mut at = random.below(TABLE);
            let mut next = || {
                at = (at + 1) % TABLE;
                f64::from(self.normal[at])
            };
            for (x, d) in row.iter_mut().enumerate() {
                let place = |c: usize, shift: f64, size: usize| {
                    (c as f64 + SHIFT_PX * shift).round().clamp(0.0, size as f64 - 1.0) as usize
                };
                let (u, v) = (place(x, next(), width), place(y, next(), height));
                let noise = NOISE_STEPS * next();
                *d = self.quantised(self.read[v * width + u], noise);
            }
        }
    }

    fn quantised(&self, mm: u16, noise_steps: f64) -> u16 {
        if mm == 0 {
            return 0;
        }
        let steps = (self.steps_mm / f64::from(mm) + noise_steps).round();
        if steps < 1.0 {
            return 0;
        }
        (self.steps_mm / steps).round().min(65_534.0) as u16
    }
}

/// Removes what the projector does not light: from right to left, a point that lies in the projector's image behind
/// one that was passed. `px_mm`: disparity in pixels times depth in millimetres.
fn shade(row: &mut [u16], px_mm: f64) {
    let mut passed = f64::INFINITY;
    for (x, d) in row.iter_mut().enumerate().rev().filter(|(_, d)| **d > 0) {
        let projected = x as f64 - px_mm / f64::from(*d);
        if projected > passed {
            *d = 0;
        }
        passed = passed.min(projected);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor() -> (StructuredLight, Random) {
        let mut random = Random::new(1);
        (StructuredLight::new(525.0, 0.075, &mut random), random)
    }

    /// An image whose depth in millimetres is `of(x, y)`.
    fn image(of: impl Fn(usize, usize) -> u16) -> DepthImage {
        let mut image = DepthImage::new(160, 40);
        for y in 0..40 {
            for x in 0..160 {
                image.data_mut()[y * 160 + x] = of(x, y);
            }
        }
        image
    }

    #[test]
    fn a_wall_keeps_its_inverse_depth_in_the_mean_and_is_quantised() {
        let (mut light, mut random) = sensor();
        for mm in [1000u16, 2500, 4000] {
            let mut wall = image(|_, _| mm);
            light.measure(&mut wall, &mut random);
            let mean = wall.data().iter().map(|d| 1.0 / f64::from(*d)).sum::<f64>() / 6400.0;
            let step = f64::from(mm) / light.steps_mm;
            assert!((mean * f64::from(mm) - 1.0).abs() < 0.6 * step, "{mm}: {}", mean * f64::from(mm));
            let mut values = wall.data().to_vec();
            values.sort_unstable();
            values.dedup();
            assert!(values.len() <= 4, "{values:?}");
        }
    }

    #[test]
    fn left_of_a_near_thing_is_a_shadow_as_wide_as_the_difference_of_disparity() {
        let (mut light, mut random) = sensor();
        let near = |x: usize| (60..100).contains(&x);
        let mut scene = image(|x, _| if near(x) { 1000 } else { 3000 });
        light.measure(&mut scene, &mut random);
        // 525 * 0.075 * (1 / 1 - 1 / 3) = 26 pixels.
        let holes = scene.data()[20 * 160..21 * 160].iter().filter(|d| **d == 0).count();
        assert!((22..=30).contains(&holes), "{holes} holes");
        assert!(scene.data()[20 * 160 + 40] == 0 && scene.data()[20 * 160 + 110] > 2900);
    }

    #[test]
    fn no_depth_stays_none() {
        let (mut light, mut random) = sensor();
        let mut nothing = image(|_, _| 0);
        light.measure(&mut nothing, &mut random);
        assert!(nothing.data().iter().all(|d| *d == 0));
    }
}
