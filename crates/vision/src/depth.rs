//! Depth of features from a depth image: looked up at the feature's pixel when the image is registered to the camera,
//! otherwise searched along the feature's ray; rejected at depth edges, where the depth is ambiguous.
//!
//! The required distance to a depth edge grows with the feature's pyramid level. Corners are often detected on the
//! outline of a near object and localised to a pixel or two of their level. On the wrong side of the outline the depth
//! is that of the background, never of something nearer, so these errors do not average out but enlarge the whole map.

use cairn_geometry::{Mat3, Se3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage, DepthSensor};
use cairn_settings::Settings;

/// Radius around a feature within which the depth must fit one plane, in pixels of its level: that of the circle by
/// which a corner is found (FAST), so that no outline has taken part in its position.
const REACH: f64 = 3.0;

/// Configuration of the depth lookup.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct DepthConfig {
    /// Baseline in metres of the virtual projector: one pixel of error in `right_x` corresponds to a depth error of
    /// `depth^2 / (baseline * fx)`. 0.3 m and fx = 535 give depth^2 / 160 m. That is above the sensor's random noise
    /// (depth^2 / 700 m, Khoshelham and Elberink 2012) and leaves a margin for imperfect registration, rounding and
    /// motion between the two exposures.
    #[setting(default = 0.3, range = 1e-3..=10.0)]
    pub virtual_baseline: f64,
    /// Depth in metres up to which a point is "close".
    #[setting(default = 3.6, range = 0.1..=1e3)]
    pub close_depth: f64,
    /// Maximum depth in metres; larger measurements are ignored.
    #[setting(default = 20.0, range = 0.1..=1e3)]
    pub max_depth: f64,
    /// Maximum spread (largest minus smallest) of the residuals of the depths around the feature from the plane
    /// fitted to them, relative to the depth.
    #[setting(default = 0.03, range = 0.0..=10.0)]
    pub edge_spread: f32,
}

/// Looks up feature depths in the images of one sensor.
#[derive(Clone, Debug)]
pub(crate) struct DepthLookup {
    config: DepthConfig,
    metres_per_unit: f64,
    /// Depth pixels per camera pixel in x and y, for registered images (which may differ in size); `None` if not
    /// registered.
    ratio: Option<[f64; 2]>,
    /// Approximate number of depth pixels per camera pixel.
    depth_pixels_per_pixel: f64,
    camera: Camera,
    depth_from_camera: Se3,
    camera_from_depth: Se3,
}

impl DepthLookup {
    /// For a depth sensor and the camera whose features are looked up.
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
            depth_pixels_per_pixel: if sensor.registered { ratio[0] } else { sensor.camera.fx / camera.fx },
            camera: sensor.camera,
            depth_from_camera,
            camera_from_depth: depth_from_camera.inverse(),
        }
    }

    /// Depth in metres along the camera's z axis of a feature at raw pixel `raw` with ray `ray` (z = 1, camera frame);
    /// `scale` is the pixel size of its pyramid level.
    pub(crate) fn find(&self, image: &DepthImage, raw: [f32; 2], ray: &Vec3, scale: f64) -> Option<f32> {
        let reach = REACH * scale * self.depth_pixels_per_pixel;
        match self.ratio {
            Some([rx, ry]) => {
                let at = Vec2::new((raw[0] as f64 + 0.5) * rx - 0.5, (raw[1] as f64 + 0.5) * ry - 0.5);
                self.surface(image, &at, reach).map(|depth| depth as f32)
            }
            None => self.search(image, ray, reach),
        }
    }

    /// Fixed-point iteration along the ray: a point at the guessed depth is projected into the depth image, whose value
    /// there is the next guess. If different start depths converge to several surfaces, the nearest is the visible one.
    fn search(&self, image: &DepthImage, ray: &Vec3, reach: f64) -> Option<f32> {
        // With a baseline of centimetres the start matters little; the far start finds surfaces that the near one
        // skips.
        const GUESSES: [f64; 3] = [0.7, 1.5, 4.0];
        let same_place = self.depth_from_camera.translation.norm() < 1e-6;
        let guesses = if same_place { &GUESSES[..1] } else { &GUESSES[..] };
        let nearest = guesses
            .iter()
            .filter_map(|guess| {
                let mut depth = *guess;
                for _ in 0..6 {
                    // Uses the single pixel: the edge check is applied only to the converged depth, otherwise the
                    // iteration would skip the rejected border of a near object and converge to the background.
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

    /// One iteration: camera depth of the measurement at the projection of the ray's point at `depth`.
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

    /// Depth in metres at a sub-pixel position, from a plane fitted to nine samples `reach` depth pixels apart, as the
    /// patch of a feature on a coarse level extends that far. `None` outside the image, with too few measurements, and
    /// at edges.
    fn surface(&self, image: &DepthImage, at: &Vec2, reach: f64) -> Option<f64> {
        let step = reach.round().max(1.0);
        let (cx, cy) = (at.x.round(), at.y.round());
        let (w, h) = (image.width() as f64, image.height() as f64);
        if !(cx >= step && cy >= step && cx + step < w && cy + step < h) {
            return None;
        }
        let (x, y, apart) = (cx as usize, cy as usize, step as usize);
        // The image of a plane is linear in inverse depth.
        let (mut samples, mut count) = ([[0.0; 3]; 9], 0);
        for k in 0..9 {
            let v = image.at(x + k % 3 * apart - apart, y + k / 3 * apart - apart);
            if is_measured(v) {
                samples[count] = [(k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0, 1.0 / v as f64];
                count += 1;
            } else if k == 4 {
                return None;
            }
        }
        let samples = &samples[..count];
        let [mean, slope_x, slope_y] = plane(samples)?;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for [dx, dy, v] in samples {
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

/// Both ends of the range mean "no measurement", depending on the sensor.
fn is_measured(units: u16) -> bool {
    units != 0 && units != u16::MAX
}

/// Least-squares plane through samples (x, y, value): its value at the origin and its slopes; `None` with fewer than
/// six samples.
fn plane(samples: &[[f64; 3]]) -> Option<[f64; 3]> {
    if samples.len() < 6 {
        return None;
    }
    let (mut normal, mut right) = (Mat3::zeros(), Vec3::zeros());
    for [x, y, value] in samples {
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

    /// Looks up the depth of the feature at [`RAW`] in a registered image whose depth at pixel (x, y) is
    /// `metres(x, y)`.
    fn lookup_depth(scale: f64, metres: impl Fn(f64, f64) -> f64) -> Option<f32> {
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
    fn steep_plane_is_not_an_edge() {
        // A floor 1.4 m below, whose depth changes by a tenth across a feature, with and without holes.
        let floor = |_: f64, y: f64| 1.4 * 100.0 / (y - 39.5);
        let truth = floor(0.0, RAW[1] as f64);
        for (scale, holes) in [(1.0, false), (1.0, true), (1.7, false), (1.7, true)] {
            let hole = |x: f64, y: f64| holes && x > 81.0 && y < 60.0;
            let found =
                lookup_depth(scale, |x, y| if hole(x, y) { 0.0 } else { floor(x, y) }).unwrap() as f64;
            assert!((found / truth - 1.0).abs() < 3e-3, "scale {scale}, holes {holes}: {found} of {truth}");
        }
    }

    #[test]
    fn no_depth_near_an_edge_with_margin_growing_by_level() {
        for scale in [1.0, 1.2, 2.0, 3.5] {
            for apart in 1..12 {
                // The outline of a near object, `apart` pixels beside the feature.
                let outline = RAW[0].round() as f64 + apart as f64;
                let found = lookup_depth(scale, |x, _| if x < outline { 4.0 } else { 2.0 });
                let free = apart as f64 > (REACH * scale).round();
                assert_eq!(found.is_some(), free, "scale {scale}, {apart} pixels from the edge");
                assert!(found.is_none_or(|z| (z - 4.0).abs() < 1e-3));
            }
        }
    }

    #[test]
    fn no_depth_with_too_few_measurements() {
        assert!(
            lookup_depth(1.0, |x, _| if x > 79.0 { 0.0 } else { 3.0 }).is_none(),
            "the feature's own pixel"
        );
        assert!(lookup_depth(1.0, |_, _| 0.0).is_none());
        assert!(
            lookup_depth(1.0, |x, y| if x == 80.0 || y == 60.0 { 3.0 } else { 0.0 }).is_none(),
            "five of nine samples"
        );
        assert!(lookup_depth(1.0, |_, _| 25.0).is_none(), "beyond the maximum depth");
        assert!(
            lookup_depth(13.0, |_, _| 3.0).is_some() && lookup_depth(27.0, |_, _| 3.0).is_none(),
            "at the image border"
        );
    }
}
