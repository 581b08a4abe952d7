//! The depth of a key frame with less noise than one image has: the mean of what the images before it measured of the same points.
//!
//! In: depth images, one after the other, with poses that no correction of the map moves. Out: an image as the sensor would have made it,
//! each depth averaged with those that earlier images have where its point projects to (a motion-compensated temporal filter). A depth that
//! differs by more than noise is of something else: behind an edge, or moved. Depths of structured light are quantised by centimetres at
//! three metres; while the camera moves the steps lie elsewhere on the surface in each image, and the mean is finer than they are.
//!
//! Depths come out in steps of half their standard deviation, so that packed images are no larger than those of the sensor.

use crate::{DenseError, DepthNoise, PackedDepth};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthImage, Distortion};
use std::collections::VecDeque;

/// Earlier images that are averaged.
const IMAGES: usize = 8;
/// Standard deviations by which two depths of one point may differ, and what is added for the pose, metres.
const GATE_SIGMAS: f64 = 4.0;
const GATE_M: f64 = 0.003;
/// Steps of the result in a standard deviation of the depth.
const STEPS: f64 = 2.0;

/// Averages the depth of images that follow each other.
#[derive(Clone, Debug)]
pub struct TemporalFilter {
    camera: Camera,
    metres_per_unit: f64,
    /// By the units of a depth: how far another one of the same point may be from it, and the step that it is rounded to.
    gates: Vec<u16>,
    rounded: Vec<u16>,
    earlier: VecDeque<(Se3, PackedDepth)>,
}

impl TemporalFilter {
    /// For the images of a camera, in units of `metres_per_unit`; `None` for one with a lens that distorts.
    pub fn new(camera: Camera, metres_per_unit: f64) -> Option<Self> {
        if camera.distortion != Distortion::None || camera.validate().is_err() || !(metres_per_unit > 0.0) {
            return None;
        }
        let noise = DepthNoise::default();
        let units = |m: f64| (m / metres_per_unit).min(f64::from(u16::MAX - 1)) as u16;
        let sigma_m = |depth: u16| noise.sigma_m(f64::from(depth) * metres_per_unit);
        let gates = (0..=u16::MAX).map(|depth| units(GATE_SIGMAS * sigma_m(depth) + GATE_M)).collect();
        let mut rounded = vec![0; usize::from(u16::MAX) + 1];
        let mut step = 0u16;
        while step < u16::MAX {
            let width = units(sigma_m(step) / STEPS).max(1);
            let next = step.saturating_add(width);
            for depth in step..next {
                rounded[usize::from(depth)] = if depth - step < next - depth { step } else { next };
            }
            step = next;
        }
        // Too far stays too far.
        rounded[usize::from(u16::MAX)] = u16::MAX;
        Some(Self { camera, metres_per_unit, gates, rounded, earlier: VecDeque::new() })
    }

    /// The images before do not belong to those that come.
    pub fn clear(&mut self) {
        self.earlier.clear();
    }

    /// Takes an image for those that come.
    pub fn add(&mut self, world_from_camera: Se3, image: &DepthImage) {
        if self.earlier.len() == IMAGES {
            self.earlier.pop_front();
        }
        self.earlier.push_back((world_from_camera, PackedDepth::pack(image)));
    }

    /// An image, averaged with those that were added.
    ///
    /// # Errors
    /// An image of another size than the camera's.
    pub fn filter(&self, world_from_camera: &Se3, image: &DepthImage) -> Result<DepthImage, DenseError> {
        let [width, height] = [self.camera.width, self.camera.height];
        if [image.width(), image.height()] != [width, height] {
            let why = format!("{}x{} pixels, the camera has {width}x{height}", image.width(), image.height());
            return Err(DenseError::Camera(why));
        }
        // Of each pixel the sum of depths, and how many there are.
        let mut sums: Vec<(f32, u16)> = image.data().iter().map(|d| (f32::from(*d), 1)).collect();
        for (world_from_earlier, packed) in &self.earlier {
            let earlier = packed.unpack()?;
            if [earlier.width(), earlier.height()] == [width, height] {
                self.add_to(&mut sums, image, &(world_from_earlier.inverse() * *world_from_camera), &earlier);
            }
        }
        let mean = |(sum, n): (f32, u16)| self.rounded[(sum / f32::from(n)).round() as usize];
        DepthImage::from_vec(width, height, sums.into_iter().map(mean).collect())
            .ok_or_else(crate::submap::broken)
    }

    /// Adds to each depth the one that an earlier image has of its point. Along the ray, a depth changes as that in the earlier image
    /// does, over the cosine between the two views.
    fn add_to(
        &self,
        sums: &mut [(f32, u16)],
        image: &DepthImage,
        earlier_from_here: &Se3,
        earlier: &DepthImage,
    ) {
        let width = self.camera.width;
        let [fx, fy, cx, cy] =
            [self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy].map(|v| v as f32);
        let turn = earlier_from_here.rotation.matrix().map(|v| v as f32);
        let moved = (earlier_from_here.translation / self.metres_per_unit).map(|v| v as f32);
        for (y, (row, sums)) in image.data().chunks_exact(width).zip(sums.chunks_exact_mut(width)).enumerate()
        {
            let up = (y as f32 - cy) / fy;
            let of_row: [f32; 3] = std::array::from_fn(|k| turn[(k, 1)] * up + turn[(k, 2)]);
            for (x, (&depth, sum)) in row.iter().zip(sums).enumerate() {
                if matches!(depth, 0 | u16::MAX) {
                    continue;
                }
                let (aside, far) = ((x as f32 - cx) / fx, f32::from(depth));
                let ray: [f32; 3] = std::array::from_fn(|k| turn[(k, 0)] * aside + of_row[k]);
                let z = ray[2] * far + moved[2];
                if z <= 1.0 || ray[2] < 0.5 {
                    continue;
                }
                let px = (ray[0] * far + moved[0]) / z * fx + cx;
                let py = (ray[1] * far + moved[1]) / z * fy + cy;
                if let Some(there) = sample(earlier, [px, py], z, f32::from(self.gates[usize::from(depth)])) {
                    *sum = (sum.0 + far + (there - z) / ray[2], sum.1 + 1);
                }
            }
        }
    }
}

/// The depth of an image between its pixels, where all four are within the gate.
fn sample(image: &DepthImage, [x, y]: [f32; 2], near: f32, gate: f32) -> Option<f32> {
    let [width, height] = [image.width(), image.height()];
    // What is not a number is not inside either.
    if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f32 && y < (height - 1) as f32) {
        return None;
    }
    let (left, top) = (x as usize, y as usize);
    let first = top * width + left;
    let (above, below) =
        (image.data().get(first..first + 2)?, image.data().get(first + width..first + width + 2)?);
    let four = [above[0], above[1], below[0], below[1]].map(f32::from);
    if four.iter().any(|depth| (depth - near).abs() > gate) {
        return None;
    }
    let (u, v) = (x - left as f32, y - top as f32);
    let along = |a: f32, b: f32| a + (b - a) * u;
    let (above, below) = (along(four[0], four[1]), along(four[2], four[3]));
    Some(above + (below - above) * v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};
    use cairn_random::Random;

    const FX: f64 = 60.0;

    fn camera() -> Camera {
        Camera::pinhole(80, 60, FX, FX, 39.5, 29.5)
    }

    /// A slanted wall behind a box, as structured light sees it: in steps of the square of the depth, with noise. And the true depths.
    fn seen(pose: &Se3, random: &mut Random) -> (DepthImage, Vec<f64>) {
        let (mut image, mut all) = (DepthImage::new(80, 60), Vec::new());
        for (at, depth) in image.data_mut().iter_mut().enumerate() {
            let ray = Vec3::new(((at % 80) as f64 - 39.5) / FX, ((at / 80) as f64 - 29.5) / FX, 1.0);
            let along = pose.rotation * ray;
            let to = |n: Vec3, d: f64| (d - n.dot(&pose.translation)) / n.dot(&along);
            let wall = to(Vec3::new(0.3, 0.0, 1.0), 3.0);
            let front = to(Vec3::z(), 1.5);
            let hit = pose.translation + along * front;
            let z = if hit.x.abs() < 0.3 && hit.y.abs() < 0.2 { front } else { wall };
            all.push(z * 1000.0);
            let disparity = (300.0 / z + random.standard_normal() / 6.0).round();
            *depth = (300_000.0 / disparity).round() as u16;
        }
        (image, all)
    }

    fn rms(image: &DepthImage, truth: &[f64]) -> f64 {
        let off = image.data().iter().zip(truth).map(|(d, z)| (f64::from(*d) - z).powi(2));
        // What is seen of another surface for want of pixels is no noise.
        let near: Vec<f64> = off.filter(|off| *off < 100.0 * 100.0).collect();
        (near.iter().sum::<f64>() / near.len() as f64).sqrt()
    }

    fn moving(k: usize) -> Se3 {
        let s = k as f64;
        Se3::new(So3::exp(&Vec3::new(0.0, 0.01 * s, 0.002 * s)), Vec3::new(0.02 * s, 0.0, 0.03 * s))
    }

    #[test]
    fn depth_of_a_moving_camera_has_less_than_half_the_noise_and_keeps_its_edges() {
        let mut filter = TemporalFilter::new(camera(), 0.001).expect("a pinhole");
        let mut random = Random::new(5);
        for k in 0..IMAGES {
            filter.add(moving(k), &seen(&moving(k), &mut random).0);
        }
        let here = moving(IMAGES);
        let (image, truth) = seen(&here, &mut random);
        let filtered = filter.filter(&here, &image).expect("of this camera");
        let (before, after) = (rms(&image, &truth), rms(&filtered, &truth));
        assert!(after < 0.5 * before, "{after:.1} mm, one image {before:.1}");
        let far =
            filtered.data().iter().zip(&truth).filter(|(d, z)| (f64::from(**d) - **z).abs() > 100.0).count();
        assert!(far < 10, "{far} pixels between box and wall");
        // Without poses that belong to it an image stays as it is, but for its steps.
        filter.clear();
        let alone = filter.filter(&here, &image).expect("of this camera");
        let moved = alone.data().iter().zip(image.data()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(moved <= Some(6), "{moved:?}");
    }

    #[test]
    fn what_has_moved_and_what_was_not_measured_stays() {
        let mut filter = TemporalFilter::new(camera(), 0.001).expect("a pinhole");
        let mut image = DepthImage::new(80, 60);
        image.data_mut().fill(2000);
        filter.add(Se3::identity(), &image);
        filter.add(Se3::identity(), &DepthImage::new(40, 30));
        image.data_mut()[80 * 30..].fill(1500);
        image.data_mut()[..3].copy_from_slice(&[0, u16::MAX, 2004]);
        let filtered = filter.filter(&Se3::identity(), &image).expect("of this camera");
        assert_eq!(filtered.data()[..2], [0, u16::MAX]);
        assert!(filtered.data()[2].abs_diff(2002) <= 2, "the mean: {}", filtered.data()[2]);
        assert!(
            filtered.data()[80 * 30..].iter().all(|d| d.abs_diff(1500) <= 2),
            "nothing of what was there"
        );
        assert!(filter.filter(&Se3::identity(), &DepthImage::new(40, 30)).is_err());
        for metres in [0.0, -1.0, f64::NAN] {
            assert!(TemporalFilter::new(camera(), metres).is_none());
        }
    }
}
