//! From a depth image to a planar scan: for each bearing, the nearest surface that a body would touch.
//!
//! All pixels are used. Each is placed in the ground frame; what lies between two heights (a *height band* along gravity)
//! is an obstacle, the floor below it and ceilings above it are not. So a table top counts although the camera looks over
//! the legs, and a door lintel does not.

use cairn_geometry::{Se2, Se3, So3, Vec3};

/// How a depth image becomes a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthScanConfig {
    /// Surfaces between these heights above the ground are obstacles, in metres.
    pub band_m: (f64, f64),
    /// Surfaces farther than this, horizontally, are no obstacles yet, in metres.
    pub max_range_m: f64,
    /// So many pixels of a bearing must see an obstacle; fewer are taken for noise.
    pub min_pixels: usize,
}

impl Default for DepthScanConfig {
    fn default() -> Self {
        Self { band_m: (0.08, 1.3), max_range_m: 6.0, min_pixels: 2 }
    }
}

/// A pinhole depth camera over level ground.
#[derive(Clone, Debug)]
pub struct DepthCamera {
    /// Image size in pixels.
    pub size: (usize, usize),
    /// Focal lengths in pixels.
    pub focal: (f64, f64),
    /// Principal point in pixels.
    pub centre: (f64, f64),
    /// Metres for each unit of the image.
    pub metres_per_unit: f64,
    /// Pose of the camera (x right, y down, z ahead) over the ground (z up, height 0) below the body.
    pub body_from_camera: Se3,
}

/// Most pixels of one bearing that may be demanded.
const MOST_PIXELS: usize = 8;

/// What is the same for a pixel in every image.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    /// Its bearing's bin.
    bin: u32,
    /// Horizontal distance for each metre of depth.
    range: f32,
    /// Rise for each metre of depth.
    rise: f32,
}

/// Turns depth images of one camera into scans.
#[derive(Clone, Debug)]
pub struct DepthScanner {
    config: DepthScanConfig,
    camera: DepthCamera,
    pixels: Vec<Pixel>,
    /// The nearest obstacles of each bearing, ascending, and the farthest surface of any height.
    nearest: Vec<([f32; MOST_PIXELS], f32)>,
    /// Bearing of the first bin's edge and the width of a bin, in radians.
    bins: (f64, f64),
}

impl DepthScanner {
    /// For a camera; `None` when its numbers are not finite, or it has no pixels.
    pub fn new(camera: DepthCamera, config: DepthScanConfig) -> Option<Self> {
        let (width, height) = camera.size;
        let numbers = [camera.focal.0, camera.focal.1, camera.metres_per_unit];
        let sound = numbers.iter().all(|v| v.is_finite() && *v > 0.0)
            && camera.centre.0.is_finite()
            && camera.centre.1.is_finite()
            && camera.body_from_camera.is_finite();
        if !sound || width == 0 || height == 0 {
            return None;
        }
        let mut scanner = Self { config, camera, pixels: Vec::new(), nearest: Vec::new(), bins: (0.0, 1.0) };
        // Rays are turned so that x lies along the optical axis over the ground: bearings are then around 0.
        let turn = So3::exp(&Vec3::new(0.0, 0.0, -scanner.body_from_sensor().rotation.log()));
        let c = &scanner.camera;
        let rotation = (turn * c.body_from_camera.rotation).matrix();
        let ray = |x: usize, y: usize| {
            let (u, v) = (x as f64 - c.centre.0, y as f64 - c.centre.1);
            rotation * Vec3::new(u / c.focal.0, v / c.focal.1, 1.0)
        };
        let rays: Vec<Vec3> =
            (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| ray(x, y)).collect();
        let bearing = |r: &Vec3| r.y.atan2(r.x);
        let (low, high) =
            rays.iter().map(bearing).fold((f64::MAX, f64::MIN), |(l, h), b| (l.min(b), h.max(b)));
        // A bin is as wide as a column in the middle of the image.
        let step = 1.0 / c.focal.0;
        let pixel = |r: &Vec3| Pixel {
            bin: ((bearing(r) - low) / step) as u32,
            range: r.xy().norm() as f32,
            rise: r.z as f32,
        };
        scanner.pixels = rays.iter().map(pixel).collect();
        scanner.bins = (low, step);
        scanner.nearest = vec![([f32::INFINITY; MOST_PIXELS], 0.0); ((high - low) / step) as usize + 1];
        Some(scanner)
    }

    /// The camera.
    pub fn camera(&self) -> &DepthCamera {
        &self.camera
    }

    /// Pose of the scan's origin in the frame of the body: below the camera, x along its optical axis.
    pub fn body_from_sensor(&self) -> Se2 {
        let pose = &self.camera.body_from_camera;
        let axis = pose.rotation * Vec3::z();
        Se2::from_xy_angle(pose.translation.x, pose.translation.y, axis.y.atan2(axis.x))
    }

    /// Nearest range at which the lowest pixels of the image see the lower edge of the band, in metres: what stands nearer
    /// may be too low to be seen.
    pub fn blind_m(&self) -> f64 {
        let c = &self.camera;
        let ray = Vec3::new(0.0, (c.size.1 as f64 - 0.5 - c.centre.1) / c.focal.1, 1.0);
        let ray = c.body_from_camera.rotation * ray;
        let height = c.body_from_camera.translation.z - self.config.band_m.0;
        if ray.z >= 0.0 { self.config.max_range_m } else { (height / -ray.z) * ray.xy().norm() }
    }

    /// The scan of an image, row by row: bearings in radians and ranges in metres from
    /// [`DepthScanner::body_from_sensor`]. Infinite where nothing is in the way up to the greatest range; bearings without
    /// any depth are left out. Empty for an image of another size.
    pub fn scan(&mut self, depth: &[u16]) -> Vec<(f64, f64)> {
        let (width, height) = self.camera.size;
        if depth.len() != width * height {
            return Vec::new();
        }
        self.nearest.fill(([f32::INFINITY; MOST_PIXELS], 0.0));
        let metres = self.camera.metres_per_unit as f32;
        let mounted = self.camera.body_from_camera.translation.z;
        let (low, high) = self.config.band_m;
        let (low, high) = ((low - mounted) as f32, (high - mounted) as f32);
        let max_range = self.config.max_range_m as f32;
        let needed = self.config.min_pixels.clamp(1, MOST_PIXELS);
        for (&units, pixel) in depth.iter().zip(&self.pixels).filter(|(units, _)| **units > 0) {
            let z = f32::from(units) * metres;
            let (range, rise) = (pixel.range * z, pixel.rise * z);
            let Some(place) = self.nearest.get_mut(pixel.bin as usize) else { continue };
            place.1 = place.1.max(range);
            if rise >= low && rise <= high && range <= max_range {
                keep_nearest(&mut place.0[..needed], range);
            }
        }
        self.rays(needed)
    }

    fn rays(&self, needed: usize) -> Vec<(f64, f64)> {
        let ray = |(bin, (nearest, farthest)): (usize, &([f32; MOST_PIXELS], f32))| {
            let bearing = self.bins.0 + (bin as f64 + 0.5) * self.bins.1;
            let range = f64::from(nearest[needed - 1]);
            let open = f64::from(*farthest) > self.config.max_range_m;
            (range.is_finite() || open).then_some((bearing, range))
        };
        self.nearest.iter().enumerate().filter_map(ray).collect()
    }
}

/// Sorts a range into the nearest ones.
fn keep_nearest(nearest: &mut [f32], range: f32) {
    let mut range = range;
    for kept in nearest {
        if range < *kept {
            std::mem::swap(kept, &mut range);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera 0.8 m above the ground, pitched down by 20 degrees, looking along the body's x.
    fn camera() -> DepthCamera {
        let ahead = nalgebra::Matrix3::from_columns(&[-Vec3::y(), -Vec3::z(), Vec3::x()]);
        let tilt = So3::exp(&Vec3::new(-20f64.to_radians(), 0.0, 0.0));
        DepthCamera {
            size: (120, 100),
            focal: (70.0, 70.0),
            centre: (59.5, 49.5),
            metres_per_unit: 0.001,
            body_from_camera: Se3::new(So3::from_matrix(&ahead) * tilt, Vec3::new(0.1, 0.0, 0.8)),
        }
    }

    /// Depth of a floor, a wall across at `wall_m`, and a board between two heights at `board_m`, |y| < 0.3.
    fn image(wall_m: f64, board_m: f64, board: (f64, f64)) -> Vec<u16> {
        let c = camera();
        let pixel = |i: usize| {
            let ray = Vec3::new(
                ((i % 120) as f64 - c.centre.0) / c.focal.0,
                ((i / 120) as f64 - c.centre.1) / c.focal.1,
                1.0,
            );
            let ray = c.body_from_camera.rotation * ray;
            let at = |k: f64| c.body_from_camera.translation + ray * k;
            let floor = if ray.z < 0.0 { -0.8 / ray.z } else { f64::INFINITY };
            let wall = (wall_m - 0.1) / ray.x;
            let on_board = (board_m - 0.1) / ray.x;
            let p = at(on_board);
            let hit = p.y.abs() < 0.3 && p.z > board.0 && p.z < board.1;
            let k = floor.min(wall).min(if hit { on_board } else { f64::INFINITY });
            (k * 1000.0).round() as u16
        };
        (0..120 * 100).map(pixel).collect()
    }

    #[test]
    fn floor_and_lintel_are_no_obstacles_and_a_board_is() {
        let mut scanner = DepthScanner::new(camera(), DepthScanConfig::default()).unwrap();
        let range_ahead = |rays: &[(f64, f64)]| {
            rays.iter().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).map(|r| r.1).unwrap()
        };
        let wall = scanner.scan(&image(3.0, 2.0, (9.0, 9.0)));
        assert!((range_ahead(&wall) - 2.9).abs() < 0.02, "{}", range_ahead(&wall));
        // The whole wall is straight: x of each end is the same.
        for (bearing, range) in wall.iter().filter(|r| r.0.abs() < 0.6) {
            assert!((range * bearing.cos() - 2.9).abs() < 0.06, "{bearing} {range}");
        }
        let board = scanner.scan(&image(3.0, 2.0, (0.4, 0.5)));
        assert!((range_ahead(&board) - 1.9).abs() < 0.02, "{}", range_ahead(&board));
        let lintel = scanner.scan(&image(3.0, 2.0, (1.35, 9.0)));
        assert!((range_ahead(&lintel) - 2.9).abs() < 0.02, "{}", range_ahead(&lintel));
        let far = scanner.scan(&image(30.0, 2.0, (9.0, 9.0)));
        assert_eq!(range_ahead(&far), f64::INFINITY, "nothing within range");
        assert!(scanner.scan(&[0; 120 * 100]).is_empty(), "no depth at all says nothing");
        assert!(scanner.scan(&[0; 5]).is_empty());
    }

    #[test]
    fn what_the_camera_cannot_see_near_by_is_told() {
        let scanner = DepthScanner::new(camera(), DepthScanConfig::default()).unwrap();
        let lowest = 20f64.to_radians() + (50.0f64 / 70.0).atan();
        assert!((scanner.blind_m() - 0.72 / lowest.tan()).abs() < 0.01, "{}", scanner.blind_m());
        assert!(
            DepthScanner::new(DepthCamera { focal: (f64::NAN, 1.0), ..camera() }, DepthScanConfig::default())
                .is_none()
        );
    }
}
