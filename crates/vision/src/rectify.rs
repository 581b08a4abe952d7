//! From raw pixels to the pixels of the rectified camera and back: points are rectified, images never.
//!
//! A stereo pair is mapped to a virtual pair of identical pinholes whose x axis is the baseline and whose optical axes
//! are parallel (Fusiello, Trucco, Verri, "A compact algorithm for rectification of stereo pairs", 2000), so that
//! corresponding points lie on the same row whatever the lenses and the mounting of the cameras.

use crate::RectifiedCamera;
use cairn_geometry::{Mat3, Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, RigCamera, RigError};

/// Cosine of the largest angle between a bearing and the optical axis: 75 degrees.
const MIN_COSINE: f64 = 0.258_819_045;
/// Raw pixels between nodes of the lookup table.
const STEP: f64 = 8.0;

/// Maps raw pixels of one camera to pixels of an ideal pinhole with the same optical centre, and back.
///
/// The table holds the stereographic projection of the bearing (`x / (1 + z)`, `y / (1 + z)`, smooth for every lens up
/// to 180 degrees) at every eighth pixel; between the nodes it is interpolated by a bicubic through sixteen of them.
#[derive(Clone, Debug)]
pub struct Rectifier {
    camera: Camera,
    rectified_from_camera: Mat3,
    camera_from_rectified: Mat3,
    focal: Vec2,
    centre: Vec2,
    /// True when raw and rectified pixels are the same.
    identity: bool,
    columns: usize,
    rows: usize,
    nodes: Vec<[f32; 2]>,
}

impl Rectifier {
    /// For a camera, the rotation from its frame to the rectified camera, and the focal lengths and principal point of
    /// the rectified camera.
    pub fn new(camera: &Camera, rectified_from_camera: &So3, focal: Vec2, centre: Vec2) -> Self {
        let rotation = rectified_from_camera.matrix();
        let columns = (camera.width as f64 / STEP).ceil() as usize + 4;
        let rows = (camera.height as f64 / STEP).ceil() as usize + 4;
        let mut this = Self {
            camera: *camera,
            rectified_from_camera: rotation,
            camera_from_rectified: rotation.transpose(),
            focal,
            centre,
            identity: false,
            columns,
            rows,
            nodes: Vec::with_capacity(columns * rows),
        };
        let mut deviation: f64 = 0.0;
        for j in 0..rows {
            for i in 0..columns {
                let raw = Vec2::new((i as f64 - 1.0) * STEP, (j as f64 - 1.0) * STEP);
                let bearing = camera.unproject(&raw).map(|b| rotation * b);
                let node = bearing.filter(|b| b.z > -0.9).map(|b| [b.x / (1.0 + b.z), b.y / (1.0 + b.z)]);
                this.nodes.push(node.map_or([f32::NAN; 2], |n| n.map(|v| v as f32)));
                deviation = deviation
                    .max(bearing.and_then(|b| this.pixel(&b)).map_or(f64::INFINITY, |p| (p - raw).amax()));
            }
        }
        this.identity = deviation < 1e-6;
        this
    }

    /// Rectified pixel of a raw pixel; `None` where the lens has no bearing for it or the bearing is more than 75
    /// degrees off the optical axis. Within 0.001 px of the exact mapping.
    #[inline]
    pub fn rectify(&self, raw: [f32; 2]) -> Option<[f32; 2]> {
        if self.identity {
            return Some(raw);
        }
        let [sx, sy] = self.interpolate(raw);
        let s2 = sx * sx + sy * sy;
        // Back from the stereographic plane: x / z = 2 s / (1 - s^2), z = (1 - s^2) / (1 + s^2).
        let z = 1.0 - s2;
        if z > MIN_COSINE as f32 * (1.0 + s2) {
            let scale = 2.0 / z;
            return Some([
                sx * scale * self.focal.x as f32 + self.centre.x as f32,
                sy * scale * self.focal.y as f32 + self.centre.y as f32,
            ]);
        }
        if z.is_nan() {
            return self.rectify_exactly(raw);
        }
        None
    }

    /// The exact mapping, by inverting the camera model instead of the table.
    pub fn rectify_exactly(&self, raw: [f32; 2]) -> Option<[f32; 2]> {
        let bearing = self.camera.unproject(&Vec2::new(raw[0] as f64, raw[1] as f64))?;
        let pixel = self.pixel(&(self.rectified_from_camera * bearing))?;
        Some([pixel.x as f32, pixel.y as f32])
    }

    /// Raw pixel of a rectified one, exact; `None` where the lens has no image of it.
    #[inline]
    pub fn raw(&self, px: [f64; 2]) -> Option<Vec2> {
        if self.identity {
            return Some(Vec2::new(px[0], px[1]));
        }
        let ray =
            Vec3::new((px[0] - self.centre.x) / self.focal.x, (px[1] - self.centre.y) / self.focal.y, 1.0);
        self.camera.project(&(self.camera_from_rectified * ray))
    }

    /// True when raw and rectified pixels are the same, so that the images are already rectified.
    pub fn is_identity(&self) -> bool {
        self.identity
    }

    /// Focal length of the rectified camera along x in pixels.
    pub fn focal_x(&self) -> f64 {
        self.focal.x
    }

    /// Bounding box of the image in rectified pixels, `[min_x, min_y, max_x, max_y]`; `None` when no pixel is
    /// within the view of the rectified camera.
    pub fn bounds(&self) -> Option<[f64; 4]> {
        let (w, h) = ((self.camera.width - 1) as f32, (self.camera.height - 1) as f32);
        let mut bounds: Option<[f64; 4]> = None;
        for j in 0..=48 {
            for i in 0..=64 {
                let raw = [w * i as f32 / 64.0, h * j as f32 / 48.0];
                if let Some([x, y]) = self.rectify_exactly(raw).map(|p| p.map(f64::from)) {
                    let b = bounds.get_or_insert([x, y, x, y]);
                    *b = [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)];
                }
            }
        }
        // Half a pixel of margin, so that the outermost pixel centres are inside.
        bounds.map(|b| [b[0] - 0.5, b[1] - 0.5, b[2] + 0.5, b[3] + 0.5])
    }

    fn pixel(&self, bearing: &Vec3) -> Option<Vec2> {
        (bearing.z >= MIN_COSINE * bearing.norm())
            .then(|| (bearing.xy() / bearing.z).component_mul(&self.focal) + self.centre)
    }

    /// Cubic Lagrange interpolation in both directions.
    #[inline]
    fn interpolate(&self, raw: [f32; 2]) -> [f32; 2] {
        let gx = raw[0] / STEP as f32 + 1.0;
        let gy = raw[1] / STEP as f32 + 1.0;
        let x0 = (gx.max(1.0) as usize).min(self.columns - 3);
        let y0 = (gy.max(1.0) as usize).min(self.rows - 3);
        let (wx, wy) = (cubic(gx - x0 as f32), cubic(gy - y0 as f32));
        let mut sum = [0.0; 2];
        for (j, wy) in wy.iter().enumerate() {
            let row = &self.nodes[(y0 - 1 + j) * self.columns + x0 - 1..][..4];
            let (mut x, mut y) = (0.0, 0.0);
            for (node, wx) in row.iter().zip(&wx) {
                x += node[0] * wx;
                y += node[1] * wx;
            }
            sum[0] += x * wy;
            sum[1] += y * wy;
        }
        sum
    }
}

/// Weights of the nodes at -1, 0, 1 and 2 for a position `t` between 0 and 1.
#[inline]
fn cubic(t: f32) -> [f32; 4] {
    let (a, b, c) = (t + 1.0, t - 1.0, t - 2.0);
    [-t * b * c / 6.0, a * b * c * 0.5, -a * t * c * 0.5, a * t * b / 6.0]
}

/// A rectified stereo pair.
#[derive(Clone, Debug)]
pub struct RectifiedPair {
    /// The virtual left camera; `close_depth` is zero, for the caller to set.
    pub camera: RectifiedCamera,
    /// Distance in metres between the two optical centres.
    pub baseline: f64,
    /// Maps raw left pixels to rectified ones.
    pub left: Rectifier,
    /// Maps raw right pixels to rectified ones.
    pub right: Rectifier,
}

/// Builds the virtual parallel pair of two calibrated cameras: x along the baseline, z as near to the mean of both
/// optical axes as that allows; the focal length is the mean of the left camera's two, the principal point is the left
/// camera's.
///
/// # Errors
/// When a camera is invalid, the baseline is shorter than 0.1 mm or along the viewing direction, or the cameras have no
/// common field of view.
pub fn rectify_pair(left: &RigCamera, right: &RigCamera) -> Result<RectifiedPair, RigError> {
    left.camera.validate()?;
    right.camera.validate()?;
    let left_from_body = left.body_from_camera.inverse();
    let left_from_right = left_from_body * right.body_from_camera;
    let baseline = left_from_right.translation.norm();
    if !(baseline > 1e-4 && baseline.is_finite()) {
        let (a, b) = (&left.name, &right.name);
        return Err(RigError(format!("{a} and {b} are {baseline:.6} m apart: no baseline")));
    }
    let x = left_from_right.translation / baseline;
    let forward = Vec3::z() + left_from_right.rotation * Vec3::z();
    let y = forward.cross(&x);
    // Less than 15 degrees between baseline and viewing direction, or opposite optical axes.
    if y.norm() < 0.26 * 2.0 {
        return Err(RigError(format!(
            "{} and {} cannot be used for stereo: the baseline {:.3?} m (in {}) runs along the line of sight, \
             or the cameras point in different directions",
            left.name,
            right.name,
            left_from_right.translation.as_slice(),
            left.name
        )));
    }
    let y = y.normalize();
    let z = x.cross(&y);
    let left_from_rectified = So3::from_matrix(&Mat3::from_columns(&[x, y, z]));
    let rectified_from_left = left_from_rectified.inverse();
    let focal = 0.5 * (left.camera.fx + left.camera.fy);
    let (focal, centre) = (Vec2::new(focal, focal), Vec2::new(left.camera.cx, left.camera.cy));
    let left_map = Rectifier::new(&left.camera, &rectified_from_left, focal, centre);
    let rectified_from_right = rectified_from_left * left_from_right.rotation;
    let right_map = Rectifier::new(&right.camera, &rectified_from_right, focal, centre);
    let (Some(bounds), Some(_)) = (left_map.bounds(), right_map.bounds()) else {
        return Err(RigError(format!("{} and {} have no common field of view", left.name, right.name)));
    };
    let camera = RectifiedCamera {
        fx: focal.x,
        fy: focal.y,
        cx: centre.x,
        cy: centre.y,
        baseline_fx: baseline * focal.x,
        bounds,
        close_depth: 0.0,
        body_from_camera: left.body_from_camera * Se3::new(left_from_rectified, Vec3::zeros()),
    };
    Ok(RectifiedPair { camera, baseline, left: left_map, right: right_map })
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;
    use cairn_sensor::Distortion;

    fn euroc() -> [RigCamera; 2] {
        let camera = |f: [f64; 4], d: [f64; 4]| Camera {
            width: 752,
            height: 480,
            fx: f[0],
            fy: f[1],
            cx: f[2],
            cy: f[3],
            distortion: Distortion::RadialTangential([d[0], d[1], d[2], d[3], 0.0]),
        };
        let pose = |r: [f64; 3], t: [f64; 3]| Se3::new(So3::exp(&Vec3::from(r)), Vec3::from(t));
        [
            RigCamera {
                name: "cam0".into(),
                camera: camera(
                    [458.654, 457.296, 367.215, 248.375],
                    [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
                ),
                body_from_camera: pose([-0.017, 0.024, 1.556], [-0.0216, -0.0647, 0.0098]),
            },
            RigCamera {
                name: "cam1".into(),
                camera: camera(
                    [457.587, 456.134, 379.999, 255.238],
                    [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05],
                ),
                body_from_camera: pose([-0.006, 0.035, 1.558], [-0.0198, 0.0454, 0.0079]),
            },
        ]
    }

    #[test]
    fn table_matches_the_exact_mapping() {
        let [left, right] = euroc();
        let pair = rectify_pair(&left, &right).unwrap();
        let mut rng = Random::new(1);
        let mut worst: f32 = 0.0;
        for map in [&pair.left, &pair.right] {
            for _ in 0..20_000 {
                let raw = [rng.uniform(0.0, 751.0) as f32, rng.uniform(0.0, 479.0) as f32];
                let (a, b) = (map.rectify(raw).unwrap(), map.rectify_exactly(raw).unwrap());
                worst = worst.max((a[0] - b[0]).abs()).max((a[1] - b[1]).abs());
                let back = map.raw(b.map(f64::from)).unwrap();
                assert!((back - Vec2::new(raw[0] as f64, raw[1] as f64)).amax() < 1e-3);
            }
        }
        println!("largest error of the table: {worst:.6} px");
        assert!(worst < 1e-3, "{worst}");
    }

    #[test]
    fn matching_points_share_a_row_with_correct_disparity() {
        // The pair as it is, with the cameras swapped, and with a rolled right camera.
        let [left, right] = euroc();
        let mut rolled = right.clone();
        rolled.body_from_camera.rotation =
            rolled.body_from_camera.rotation * So3::exp(&Vec3::new(0.1, 0.05, 0.3));
        for (a, b) in [(&left, &right), (&right, &left), (&left, &rolled)] {
            let pair = rectify_pair(a, b).unwrap();
            assert!((pair.baseline - 0.1101).abs() < 1e-3);
            let mut rng = Random::new(2);
            let mut visible = 0;
            for _ in 0..2000 {
                let depth = rng.uniform(0.5, 30.0);
                let raw = Vec2::new(rng.uniform(0.0, 751.0), rng.uniform(0.0, 479.0));
                let body = a.body_from_camera * (a.camera.unproject(&raw).unwrap() * depth);
                let Some(raw_right) = b.camera.project(&(b.body_from_camera.inverse() * body)) else {
                    continue;
                };
                if !b.camera.contains(&raw_right) {
                    continue;
                }
                visible += 1;
                let l = pair.left.rectify([raw.x as f32, raw.y as f32]).unwrap();
                let r = pair.right.rectify([raw_right.x as f32, raw_right.y as f32]).unwrap();
                let [u, v, ur] =
                    pair.camera.project(&(pair.camera.body_from_camera.inverse() * body)).unwrap();
                assert!((l[0] as f64 - u).abs() < 2e-3 && (l[1] as f64 - v).abs() < 2e-3);
                assert!((r[1] - l[1]).abs() < 3e-3, "{l:?} {r:?}");
                assert!((r[0] as f64 - ur).abs() < 3e-3, "{r:?} {ur}");
            }
            assert!(visible > 500, "{visible}");
        }
    }

    #[test]
    fn rectified_pair_is_unchanged() {
        let camera = Camera::pinhole(1226, 370, 707.0912, 707.0912, 601.8873, 183.1104);
        let at = |x| RigCamera {
            name: format!("at {x}"),
            camera,
            body_from_camera: Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0)),
        };
        let pair = rectify_pair(&at(0.0), &at(0.537)).unwrap();
        assert!(pair.left.is_identity() && pair.right.is_identity());
        assert_eq!(pair.left.rectify([3.25, 7.5]), Some([3.25, 7.5]));
        assert!((pair.camera.baseline_fx - 379.7).abs() < 0.1);
        assert!(pair.camera.body_from_camera.rotation.angle() < 1e-9);
    }

    #[test]
    fn invalid_pairs_are_rejected() {
        let [left, right] = euroc();
        let mut ahead = right.clone();
        ahead.body_from_camera.translation =
            left.body_from_camera.translation + left.body_from_camera.rotation * Vec3::new(0.0, 0.01, 0.3);
        assert!(rectify_pair(&left, &ahead).unwrap_err().0.contains("line of sight"));
        let mut behind = right.clone();
        behind.body_from_camera.rotation =
            behind.body_from_camera.rotation * So3::exp(&Vec3::new(0.0, std::f64::consts::PI, 0.0));
        assert!(rectify_pair(&left, &behind).is_err());
        assert!(rectify_pair(&left, &left).unwrap_err().0.contains("no baseline"));
    }
}
