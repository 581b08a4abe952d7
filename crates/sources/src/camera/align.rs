//! Depth seen from another camera than the sensor that measured it.
//!
//! Every depth pixel is moved to a point, carried over by the extrinsics and projected; where several fall on one pixel the
//! nearest counts (z-buffer; Catmull 1974). Each covers as many pixels as it does at its new distance, so that an image of a
//! longer focal length has no holes between them.

use cairn_geometry::{Mat3, Vec3};
use cairn_sensor::{Camera, DepthImage, DepthSensor, Distortion, RigCamera};

/// Moves depth images from their sensor to a camera.
pub struct DepthAligner {
    /// Ray of each depth pixel with z = 1, turned into the camera; zero where the lens has none.
    rays: Vec<Vec3>,
    size: [usize; 2],
    /// Where the depth sensor is, in the camera's frame.
    offset: Vec3,
    metres_per_unit: f64,
    camera: Camera,
    /// Pixels of the camera per pixel of depth at equal distance, x and y.
    ratio: [f64; 2],
}

impl DepthAligner {
    /// For the images of a depth sensor and the camera that they are to be seen from.
    pub fn new(depth: &DepthSensor, target: &RigCamera) -> Self {
        let camera_from_depth = target.body_from_camera.inverse() * depth.body_from_depth;
        let turn: Mat3 = camera_from_depth.rotation.matrix();
        let from = &depth.camera;
        let mut rays = Vec::with_capacity(from.width * from.height);
        for y in 0..from.height {
            for x in 0..from.width {
                let ray =
                    from.unproject(&cairn_geometry::Vec2::new(x as f64, y as f64)).filter(|r| r.z > 1e-6);
                rays.push(ray.map_or(Vec3::zeros(), |r| turn * (r / r.z)));
            }
        }
        Self {
            rays,
            size: [from.width, from.height],
            offset: camera_from_depth.translation,
            metres_per_unit: depth.metres_per_unit,
            camera: target.camera,
            ratio: [target.camera.fx / from.fx, target.camera.fy / from.fy],
        }
    }

    /// The sensor that aligned images are of: the camera itself.
    pub fn sensor(&self, target: &RigCamera) -> DepthSensor {
        DepthSensor {
            camera: target.camera,
            body_from_depth: target.body_from_camera,
            metres_per_unit: self.metres_per_unit,
            registered: true,
        }
    }

    /// The image seen from the camera, in the same unit; 0 where nothing was measured. `None` for an image of another size.
    pub fn align(&self, depth: &DepthImage) -> Option<DepthImage> {
        if [depth.width(), depth.height()] != self.size {
            return None;
        }
        let (width, height) = (self.camera.width, self.camera.height);
        let mut out = DepthImage::new(width, height);
        let pixels = out.data_mut();
        for (raw, ray) in depth.data().iter().zip(&self.rays) {
            if *raw == 0 {
                continue;
            }
            let z = f64::from(*raw) * self.metres_per_unit;
            let p = ray * z + self.offset;
            let units = (p.z / self.metres_per_unit).round();
            if !(1.0..=65_535.0).contains(&units) {
                continue;
            }
            let Some([u, v]) = self.project(&p) else { continue };
            // Half of the pixel's extent and a little more, since neighbours move apart on a tilted surface; never less than
            // the pixel that it falls on.
            let half = |ratio: f64| (0.54 * ratio * z / p.z).clamp(0.5, 8.0);
            let (hx, hy) = (half(self.ratio[0]), half(self.ratio[1]));
            let range = |centre: f64, half: f64, side: usize| {
                // Pixels whose centre is inside; of a border between two, one.
                let end = ((centre + half).ceil().max(0.0) as usize).min(side);
                let first = ((centre - half).ceil().max(0.0) as usize).min(end);
                first..end
            };
            for y in range(v, hy, height) {
                for pixel in &mut pixels[y * width..][range(u, hx, width)] {
                    if *pixel == 0 || units < f64::from(*pixel) {
                        *pixel = units as u16;
                    }
                }
            }
        }
        Some(out)
    }

    fn project(&self, p: &Vec3) -> Option<[f64; 2]> {
        let c = &self.camera;
        if c.distortion == Distortion::None {
            return Some([c.fx * p.x / p.z + c.cx, c.fy * p.y / p.z + c.cy]);
        }
        c.project(p).map(|px| [px.x, px.y])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Se3, So3, Vec2};

    /// A depth sensor and a colour camera as those of a D435i: other focal lengths, 15 mm apart, turned by some mrad, and the
    /// colour's lens with inverse Brown-Conrady.
    fn pair(lens: Distortion) -> (DepthSensor, RigCamera) {
        let body_from_depth = Se3::identity();
        let body_from_camera =
            Se3::new(So3::exp(&Vec3::new(0.004, -0.006, 0.009)), Vec3::new(0.015, -0.001, 0.002));
        let camera = Camera { distortion: lens, ..Camera::pinhole(320, 240, 308.0, 307.0, 158.0, 121.5) };
        let own = Camera::pinhole(320, 240, 192.0, 192.0, 160.5, 118.0);
        (
            DepthSensor { camera: own, body_from_depth, metres_per_unit: 0.001, registered: false },
            RigCamera { name: "color".into(), camera, body_from_camera },
        )
    }

    /// What a camera sees of a tilted plane, as depth along its axis: `n . p = d` in the body's frame, metres.
    fn plane_z(camera: &Camera, body_from: &Se3, x: usize, y: usize, n: &Vec3, d: f64) -> Option<f64> {
        let ray = camera.unproject(&Vec2::new(x as f64, y as f64))?;
        let (origin, direction) = (body_from.translation, body_from.rotation * (ray / ray.z));
        Some((d - n.dot(&origin)) / n.dot(&direction)).filter(|z| *z > 0.0)
    }

    #[test]
    fn a_plane_is_where_the_camera_sees_it() {
        let lens = Distortion::InverseRadialTangential([-0.055, 0.066, 0.0008, -0.0003, -0.02]);
        for lens in [Distortion::None, lens] {
            let (sensor, target) = pair(lens);
            let (n, d) = (Vec3::new(0.3, -0.2, 1.0), 1.5);
            let mut depth = DepthImage::new(320, 240);
            for y in 0..240 {
                for x in 0..320 {
                    let z = plane_z(&sensor.camera, &sensor.body_from_depth, x, y, &n, d).unwrap();
                    depth.data_mut()[y * 320 + x] = (z / 0.001).round() as u16;
                }
            }
            let aligned = DepthAligner::new(&sensor, &target).align(&depth).unwrap();
            let (mut holes, mut worst) = (0, 0.0_f64);
            for y in 8..232 {
                for x in 8..312 {
                    let expected = plane_z(&target.camera, &target.body_from_camera, x, y, &n, d).unwrap();
                    match aligned.at(x, y) {
                        0 => holes += 1,
                        z => worst = worst.max((f64::from(z) * 0.001 - expected).abs() / expected),
                    }
                }
            }
            assert!(holes < 10, "{lens:?}: {holes} holes");
            // Half a pixel of depth on a plane that is tilted by 20 degrees.
            assert!(worst < 0.004, "{lens:?}: {worst}");
        }
    }

    #[test]
    fn the_nearest_counts_and_nothing_is_invented() {
        let (mut sensor, mut target) = pair(Distortion::None);
        target.camera = sensor.camera;
        sensor.metres_per_unit = 0.001;
        // 0.1 m at 192 px of focal length: at 1 m a shift of 19.2 px, at 2 m of 9.6, so that both fall on one pixel, in the one
        // direction the far one first, in the other the near one.
        for (side, near_x, far_x, both_x) in [(1.0, 109, 100, 90), (-1.0, 100, 109, 119)] {
            target.body_from_camera = Se3::new(So3::identity(), Vec3::new(0.1 * side, 0.0, 0.0));
            let mut depth = DepthImage::new(320, 240);
            depth.data_mut()[100 * 320 + far_x] = 2000;
            depth.data_mut()[100 * 320 + near_x] = 1000;
            let aligned = DepthAligner::new(&sensor, &target).align(&depth).unwrap();
            let filled: Vec<(usize, u16)> =
                aligned.data().iter().enumerate().filter(|(_, v)| **v > 0).map(|(i, v)| (i, *v)).collect();
            assert_eq!(filled, [(100 * 320 + both_x, 1000)]);
        }
        let aligner = DepthAligner::new(&sensor, &target);
        assert!(aligner.align(&DepthImage::new(64, 48)).is_none());
        assert!(aligner.sensor(&target).registered);
        // Farther than the unit can say from there: left out, not wrapped.
        target.body_from_camera = Se3::new(So3::identity(), Vec3::new(0.0, 0.0, -2.0));
        let mut depth = DepthImage::new(320, 240);
        depth.data_mut().fill(65_000);
        let far = DepthAligner::new(&sensor, &target).align(&depth).unwrap();
        assert!(far.data().iter().all(|v| *v == 0));
    }
}
