//! Depth of features from a depth image: looked up at the feature's pixel where the image is registered to the
//! camera, else found along the feature's ray; refused at depth edges, where a feature has two depths.
//!
//! How far from an edge is far enough grows with the feature's pyramid level. Corners sit on the outline of what is near, and are
//! found there to a pixel or two of their level: on the wrong side of it the depth is that of what is behind, never of something
//! nearer, so that such errors do not cancel but stretch the whole map.

use cairn_geometry::{Mat3, Se3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage, DepthSensor};

/// How far from a feature its depth has to be that of one plane, in pixels of its level.
const REACH: f64 = 2.0;

/// What is asked of the depth lookup.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthConfig {
    /// Baseline in metres of the virtual projector: one pixel of error in `right_x` stands for a depth error of
    /// `depth^2 / (baseline * fx)`. 0.075 m (the distance between a Kinect's projector and camera) and fx = 535 give
    /// depth^2 / 40 m. That is well above the sensor's random noise (depth^2 / 700 m, Khoshelham and Elberink 2012),
    /// and leaves room for imperfect registration, rounding and motion between the two shutters.
    pub virtual_baseline: f64,
    /// Depth in metres up to which a point is "close".
    pub close_depth: f64,
    /// Largest depth in metres that is believed.
    pub max_depth: f64,
    /// Largest spread (largest minus smallest) of the depths around the feature about the plane through them, relative to the
    /// depth.
    pub edge_spread: f32,
}

impl Default for DepthConfig {
    fn default() -> Self {
        Self { virtual_baseline: 0.075, close_depth: 3.6, max_depth: 20.0, edge_spread: 0.05 }
    }
}

/// Finds depth in the images of one sensor.
#[derive(Clone, Debug)]
pub(crate) struct DepthLookup {
    config: DepthConfig,
    metres_per_unit: f64,
    /// Depth pixels per pixel of the camera, for registered images of another size.
    ratio: Option<[f64; 2]>,
    /// Depth pixels per pixel of the camera, roughly.
    finer: f64,
    camera: Camera,
    depth_from_camera: Se3,
    camera_from_depth: Se3,
}

impl DepthLookup {
    /// For a sensor and the camera whose features want depth.
    pub(crate) fn new(
        config: DepthConfig,
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
            config,
            metres_per_unit: sensor.metres_per_unit,
            ratio: sensor.registered.then_some(ratio),
            finer: if sensor.registered { ratio[0] } else { sensor.camera.fx / camera.fx },
            camera: sensor.camera,
            depth_from_camera,
            camera_from_depth: depth_from_camera.inverse(),
        }
    }

    /// Depth along the camera's z axis in metres of a feature at raw pixel `raw`, whose ray (z = 1, camera frame) is `ray`, of a
    /// level whose pixels are `scale` wide.
    pub(crate) fn find(&self, image: &DepthImage, raw: [f32; 2], ray: &Vec3, scale: f64) -> Option<f32> {
        let reach = REACH * scale * self.finer;
        match self.ratio {
            Some([rx, ry]) => {
                let at = Vec2::new((raw[0] as f64 + 0.5) * rx - 0.5, (raw[1] as f64 + 0.5) * ry - 0.5);
                self.surface(image, &at, reach).map(|depth| depth as f32)
            }
            None => self.search(image, ray, reach),
        }
    }

    /// Walks along the ray: where a point of guessed depth would be in the depth image, the image tells a better guess.
    /// Of several surfaces that the ray seems to meet, the nearest is what the camera sees.
    fn search(&self, image: &DepthImage, ray: &Vec3, reach: f64) -> Option<f32> {
        // With a baseline of centimetres the guess matters little; the far one finds surfaces that the near one jumps.
        const GUESSES: [f64; 3] = [0.7, 1.5, 4.0];
        let same_place = self.depth_from_camera.translation.norm() < 1e-6;
        let guesses = if same_place { &GUESSES[..1] } else { &GUESSES[..] };
        let nearest = guesses
            .iter()
            .filter_map(|guess| {
                let mut depth = *guess;
                for _ in 0..6 {
                    // Of the pixel alone: whether an edge is near is asked of what is found, or else the ray would pass by
                    // the edge of what is near to what is behind.
                    let next = self.step(ray, depth, |at| self.pixel(image, at))?;
                    let change = (next - depth).abs();
                    depth = next;
                    if change < 1e-2 * depth {
                        return Some(depth);
                    }
                }
                None
            })
            .min_by(f64::total_cmp)?;
        let depth = self.step(ray, nearest, |at| self.surface(image, at, reach))?;
        self.step(ray, depth, |at| self.surface(image, at, reach)).map(|depth| depth as f32)
    }

    /// The depth in the camera of what is measured where a point of the ray at a depth would be.
    fn step(&self, ray: &Vec3, depth: f64, measured: impl Fn(&Vec2) -> Option<f64>) -> Option<f64> {
        let at = self.camera.project(&(self.depth_from_camera * (ray * depth)))?;
        let bearing = self.camera.unproject(&at)?;
        let z = (self.camera_from_depth * (bearing * (measured(&at)? / bearing.z))).z;
        (z > 0.0).then_some(z)
    }

    /// Depth in metres of the nearest pixel.
    fn pixel(&self, image: &DepthImage, at: &Vec2) -> Option<f64> {
        let inside = |c: f64, size: usize| (c >= -0.5 && c < size as f64 - 0.5).then_some(c.round() as usize);
        let units = image.at(inside(at.x, image.width())?, inside(at.y, image.height())?);
        is_measured(units).then_some(units as f64 * self.metres_per_unit)
    }

    /// Depth in metres at a sub-pixel place, of the plane through nine places `reach` depth pixels apart: a feature of a coarse
    /// level is made of what is as far around. `None` outside, where too little is measured, and at edges.
    fn surface(&self, image: &DepthImage, at: &Vec2, reach: f64) -> Option<f64> {
        let step = reach.round().max(1.0);
        let (cx, cy) = (at.x.round(), at.y.round());
        let (w, h) = (image.width() as f64, image.height() as f64);
        if !(cx >= step && cy >= step && cx + step < w && cy + step < h) {
            return None;
        }
        let (x, y, apart) = (cx as usize, cy as usize, step as usize);
        // One over depth changes evenly over the picture of a plane.
        let (mut places, mut count) = ([[0.0; 3]; 9], 0);
        for k in 0..9 {
            let v = image.at(x + k % 3 * apart - apart, y + k / 3 * apart - apart);
            if is_measured(v) {
                places[count] = [(k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0, 1.0 / v as f64];
                count += 1;
            } else if k == 4 {
                return None;
            }
        }
        let places = &places[..count];
        let [mean, slope_x, slope_y] = plane(places)?;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for [dx, dy, v] in places {
            let off = v - mean - slope_x * dx - slope_y * dy;
            (low, high) = (low.min(off), high.max(off));
        }
        if high - low > f64::from(self.config.edge_spread) * mean {
            return None;
        }
        let inverse = mean + (slope_x * (at.x - cx) + slope_y * (at.y - cy)) / step;
        let depth = self.metres_per_unit / inverse;
        (depth > 0.0 && depth < self.config.max_depth).then_some(depth)
    }
}

/// Both ends of the range mean "nothing measured", depending on the sensor.
fn is_measured(units: u16) -> bool {
    units != 0 && units != u16::MAX
}

/// The plane through places (x, y, value) in the sense of least squares: its value at the origin and its slopes; `None` with fewer
/// than six places.
fn plane(places: &[[f64; 3]]) -> Option<[f64; 3]> {
    if places.len() < 6 {
        return None;
    }
    let (mut normal, mut right) = (Mat3::zeros(), Vec3::zeros());
    for [x, y, value] in places {
        let row = Vec3::new(1.0, *x, *y);
        normal += row * row.transpose();
        right += row * *value;
    }
    Some(normal.cholesky()?.solve(&right).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    const RAW: [f32; 2] = [80.3, 59.6];

    /// A registered sensor and what it measures of a surface that is so deep along the ray of a pixel.
    fn looked_up(scale: f64, metres: impl Fn(f64, f64) -> f64) -> Option<f32> {
        let camera = Camera::pinhole(160, 120, 100.0, 100.0, 79.5, 59.5);
        let sensor =
            DepthSensor { camera, body_from_depth: Se3::identity(), metres_per_unit: 1e-3, registered: true };
        let lookup = DepthLookup::new(DepthConfig::default(), &sensor, &camera, &Se3::identity());
        let mut image = DepthImage::new(160, 120);
        for y in 0..120 {
            for x in 0..160 {
                image.data_mut()[y * 160 + x] = (1000.0 * metres(x as f64, y as f64)).round() as u16;
            }
        }
        lookup.find(&image, RAW, &Vec3::z(), scale)
    }

    #[test]
    fn a_steep_plane_is_a_surface_and_no_edge() {
        // A floor 1.4 m below, which changes by a tenth from one feature's end to the other, with holes and without.
        let floor = |_: f64, y: f64| 1.4 * 100.0 / (y - 39.5);
        let truth = floor(0.0, RAW[1] as f64);
        for (scale, holes) in [(1.0, false), (1.0, true), (1.7, false), (1.7, true)] {
            let hole = |x: f64, y: f64| holes && x > 81.0 && y < 60.0;
            let found = looked_up(scale, |x, y| if hole(x, y) { 0.0 } else { floor(x, y) }).unwrap() as f64;
            assert!((found / truth - 1.0).abs() < 3e-3, "scale {scale}, holes {holes}: {found} of {truth}");
        }
    }

    #[test]
    fn near_an_edge_there_is_no_depth_and_coarse_features_keep_farther_away() {
        for scale in [1.0, 1.2, 2.0, 3.5] {
            for apart in 1..12 {
                // The outline of something near, so many pixels beside the feature.
                let outline = RAW[0].round() as f64 + apart as f64;
                let found = looked_up(scale, |x, _| if x < outline { 4.0 } else { 2.0 });
                let free = apart as f64 > (REACH * scale).round();
                assert_eq!(found.is_some(), free, "scale {scale}, {apart} pixels from the edge");
                assert!(found.is_none_or(|z| (z - 4.0).abs() < 1e-3));
            }
        }
    }

    #[test]
    fn too_little_measured_is_no_depth() {
        assert!(looked_up(1.0, |x, _| if x > 79.0 { 0.0 } else { 3.0 }).is_none(), "the feature's own pixel");
        assert!(looked_up(1.0, |_, _| 0.0).is_none());
        assert!(
            looked_up(1.0, |x, y| if x == 80.0 || y == 60.0 { 3.0 } else { 0.0 }).is_none(),
            "five of nine"
        );
        assert!(looked_up(1.0, |_, _| 25.0).is_none(), "beyond what is believed");
        assert!(
            looked_up(20.0, |_, _| 3.0).is_some() && looked_up(40.0, |_, _| 3.0).is_none(),
            "the image's end"
        );
    }
}
