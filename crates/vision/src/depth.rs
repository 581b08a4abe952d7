//! Depth of features from a depth image: looked up at the feature's pixel where the image is registered to the
//! camera, else found along the feature's ray; refused at depth edges, where a feature has two depths.

use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage, DepthSensor};

/// What is asked of the depth lookup.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthSetting {
    /// Baseline in metres of the virtual projector: one pixel of error in `right_x` stands for a depth error of
    /// `depth^2 / (baseline * fx)`. 0.075 m (the distance between a Kinect's projector and camera) and fx = 535 give
    /// depth^2 / 40 m. That is well above the sensor's random noise (depth^2 / 700 m, Khoshelham and Elberink 2012),
    /// and leaves room for imperfect registration, rounding and motion between the two shutters.
    pub virtual_baseline: f64,
    /// Depth in metres up to which a point is "close".
    pub close_depth: f64,
    /// Largest depth in metres that is believed.
    pub max_depth: f64,
    /// Largest spread (largest minus smallest) of the 3x3 depths around the feature, relative to the depth.
    pub edge_spread: f32,
}

impl Default for DepthSetting {
    fn default() -> Self {
        Self { virtual_baseline: 0.075, close_depth: 3.6, max_depth: 20.0, edge_spread: 0.05 }
    }
}

/// Finds depth in the images of one sensor.
#[derive(Clone, Debug)]
pub(crate) struct DepthLookup {
    setting: DepthSetting,
    metres_per_unit: f32,
    /// Depth pixels per pixel of the camera, for registered images of another size.
    ratio: Option<[f64; 2]>,
    camera: Camera,
    depth_from_camera: Se3,
    camera_from_depth: Se3,
}

impl DepthLookup {
    /// For a sensor and the camera whose features want depth.
    pub(crate) fn new(
        setting: DepthSetting,
        sensor: &DepthSensor,
        camera: &Camera,
        body_from_camera: &Se3,
    ) -> Self {
        let depth_from_camera = sensor.body_from_depth.inverse() * *body_from_camera;
        let ratio = [
            sensor.camera.width as f64 / camera.width as f64,
            sensor.camera.height as f64 / camera.height as f64,
        ];
        Self {
            setting,
            metres_per_unit: sensor.metres_per_unit as f32,
            ratio: sensor.registered.then_some(ratio),
            camera: sensor.camera,
            depth_from_camera,
            camera_from_depth: depth_from_camera.inverse(),
        }
    }

    /// Depth along the camera's z axis in metres of a feature at raw pixel `raw`, whose ray (z = 1, camera frame) is `ray`.
    pub(crate) fn find(&self, image: &DepthImage, raw: [f32; 2], ray: &Vec3) -> Option<f32> {
        match self.ratio {
            Some([rx, ry]) => {
                let at = Vec2::new((raw[0] as f64 + 0.5) * rx - 0.5, (raw[1] as f64 + 0.5) * ry - 0.5);
                self.surface(image, &at)
            }
            None => self.search(image, ray),
        }
    }

    /// Walks along the ray: where a point of guessed depth would be in the depth image, the image tells a better guess.
    /// Of several surfaces that the ray seems to meet, the nearest is what the camera sees.
    fn search(&self, image: &DepthImage, ray: &Vec3) -> Option<f32> {
        // With a baseline of centimetres the guess matters little; the far one finds surfaces that the near one jumps.
        const GUESSES: [f64; 3] = [0.7, 1.5, 4.0];
        let mut nearest: Option<f32> = None;
        for guess in GUESSES {
            let mut depth = guess;
            for _ in 0..6 {
                let Some(at) = self.camera.project(&(self.depth_from_camera * (ray * depth))) else { break };
                let Some(z) = self.surface(image, &at) else { break };
                let Some(bearing) = self.camera.unproject(&at) else { break };
                // The surface point, seen from the camera; its depth is the next guess.
                let point = self.camera_from_depth * (bearing * (z as f64 / bearing.z));
                let change = (point.z - depth).abs();
                depth = point.z;
                if change < 1e-3 * depth {
                    if depth > 0.0 && nearest.is_none_or(|n| (depth as f32) < n) {
                        nearest = Some(depth as f32);
                    }
                    break;
                }
            }
            if self.depth_from_camera.translation.norm() < 1e-6 {
                break;
            }
        }
        nearest
    }

    /// Depth in metres at a sub-pixel place; `None` outside, where too little is measured, and at edges.
    fn surface(&self, image: &DepthImage, at: &Vec2) -> Option<f32> {
        let (cx, cy) = (at.x.round(), at.y.round());
        if !(cx >= 1.0 && cy >= 1.0 && cx + 2.0 <= image.width() as f64 && cy + 2.0 <= image.height() as f64)
        {
            return None;
        }
        let (x, y) = (cx as usize, cy as usize);
        let (mut low, mut high, mut sum, mut count) = (u16::MAX, 0, 0u32, 0u32);
        let (mut slope_x, mut slope_y) = (0i32, 0i32);
        for dy in 0..3 {
            let row = &image.row(y + dy - 1)[x - 1..x + 2];
            for (dx, &v) in row.iter().enumerate() {
                // Both ends of the range mean "nothing measured", depending on the sensor.
                if v == 0 || v == u16::MAX {
                    continue;
                }
                low = low.min(v);
                high = high.max(v);
                sum += v as u32;
                count += 1;
                slope_x += (dx as i32 - 1) * v as i32;
                slope_y += (dy as i32 - 1) * v as i32;
            }
        }
        if count < 6 || image.at(x, y) == 0 || image.at(x, y) == u16::MAX {
            return None;
        }
        let mean = sum as f32 / count as f32;
        if (high - low) as f32 > self.setting.edge_spread * mean {
            return None;
        }
        let units = if count == 9 {
            // The plane through the nine, at the feature.
            mean + (slope_x as f32 * (at.x - cx) as f32 + slope_y as f32 * (at.y - cy) as f32) / 6.0
        } else {
            image.at(x, y) as f32
        };
        let depth = units * self.metres_per_unit;
        (depth > 0.0 && (depth as f64) < self.setting.max_depth).then_some(depth)
    }
}
