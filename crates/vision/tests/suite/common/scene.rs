//! A scene of textured rectangles, rendered by ray casting through any calibrated camera, with exact depth.

use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_random::Random;
use cairn_sensor::{Camera, Distortion, GrayImage, Rig, RigCamera};

/// A rectangle, given by a corner and two edges, with its own texture.
pub struct Rectangle {
    corner: Vec3,
    /// Unit vectors along the edges, their lengths, and the normal.
    axes: [Vec3; 2],
    lengths: [f64; 2],
    normal: Vec3,
    seed: u64,
    /// Size in metres of the largest patches of the texture.
    grain: f64,
}

impl Rectangle {
    pub fn new(corner: Vec3, edges: [Vec3; 2], seed: u64, grain: f64) -> Self {
        let lengths = edges.map(|e| e.norm());
        let axes = [edges[0] / lengths[0], edges[1] / lengths[1]];
        Self { corner, axes, lengths, normal: axes[0].cross(&axes[1]), seed, grain }
    }
}

pub struct Scene(pub Vec<Rectangle>);

impl Scene {
    /// A room of 8 x 3 x 8 m around the origin (y down) with slanted boards between 1 and 4 m; z is forward.
    pub fn room(seed: u64) -> Self {
        let mut rng = Random::new(seed);
        let wall = |corner: [f64; 3], a: [f64; 3], b: [f64; 3], k: u64| {
            Rectangle::new(Vec3::from(corner), [Vec3::from(a), Vec3::from(b)], seed * 100 + k, 0.25)
        };
        let mut all = vec![
            wall([-4.0, -1.5, 6.0], [8.0, 0.0, 0.5], [0.0, 3.0, 0.0], 0),
            wall([-4.0, 1.5, -2.0], [8.0, 0.0, 0.0], [0.0, 0.0, 9.0], 1),
            wall([-4.0, -1.5, -2.0], [0.0, 0.0, 9.0], [0.0, 3.0, 0.0], 2),
            wall([4.0, -1.5, -2.0], [0.0, 0.0, 9.0], [0.0, 3.0, 0.0], 3),
            wall([-4.0, -1.5, -2.0], [8.0, 0.0, 0.0], [0.0, 0.0, 9.0], 4),
        ];
        for k in 0..6 {
            let z = rng.uniform(1.2, 4.0);
            let yaw = rng.uniform(-0.7, 0.7);
            let pitch = rng.uniform(-0.4, 0.4);
            let r = So3::exp(&Vec3::new(0.0, yaw, 0.0)) * So3::exp(&Vec3::new(pitch, 0.0, 0.0));
            let size = 0.25 * z;
            let centre = Vec3::new(rng.uniform(-0.6, 0.6) * z, rng.uniform(-0.35, 0.35) * z, z);
            let edges = [r * Vec3::new(2.0 * size, 0.0, 0.0), r * Vec3::new(0.0, 1.4 * size, 0.0)];
            let corner = centre - (edges[0] + edges[1]) * 0.5;
            all.push(Rectangle::new(corner, edges, seed * 100 + 10 + k, 0.04 * z));
        }
        Self(all)
    }

    /// Distance along a ray (in units of its length) and brightness of the first surface it hits.
    pub fn cast(&self, origin: &Vec3, ray: &Vec3) -> Option<(f64, f64)> {
        let mut best: Option<(f64, f64, f64, &Rectangle)> = None;
        for r in &self.0 {
            let t = r.normal.dot(&(r.corner - origin)) / r.normal.dot(ray);
            if t.is_nan() || t <= 1e-6 || best.is_some_and(|b| b.0 <= t) {
                continue;
            }
            let p = origin + ray * t - r.corner;
            let (a, b) = (p.dot(&r.axes[0]), p.dot(&r.axes[1]));
            if a >= 0.0 && b >= 0.0 && a <= r.lengths[0] && b <= r.lengths[1] {
                best = Some((t, a, b, r));
            }
        }
        best.map(|(t, a, b, r)| (t, texture(a, b, r.grain, r.seed)))
    }

    /// The image of a camera: 3 x 3 rays per pixel, then gain, offset and noise in gray levels.
    pub fn render(&self, camera: &Camera, world_from_camera: &Se3, exposure: &Exposure) -> GrayImage {
        let mut rng = Random::stream(exposure.seed, 77);
        let mut image = GrayImage::new(camera.width, camera.height);
        const N: usize = 3;
        for y in 0..camera.height {
            for x in 0..camera.width {
                // Sub-pixel rays by linear interpolation of the bearing: accurate enough within one pixel.
                let at = |dx: f64, dy: f64| {
                    let b = camera.unproject(&Vec2::new(x as f64 + dx, y as f64 + dy)).unwrap();
                    world_from_camera.rotation * (b / b.z)
                };
                let middle = at(0.0, 0.0);
                let (ux, uy) = (at(0.5, 0.0) - at(-0.5, 0.0), at(0.0, 0.5) - at(0.0, -0.5));
                let mut sum = 0.0;
                for j in 0..N {
                    for i in 0..N {
                        let (dx, dy) = ((i as f64 + 0.5) / N as f64 - 0.5, (j as f64 + 0.5) / N as f64 - 0.5);
                        let ray = middle + ux * dx + uy * dy;
                        sum += self.cast(&world_from_camera.translation, &ray).map_or(20.0, |h| h.1);
                    }
                }
                let value = sum / (N * N) as f64 * exposure.gain
                    + exposure.offset
                    + exposure.noise * rng.standard_normal();
                image.row_mut(y)[x] = value.round().clamp(0.0, 255.0) as u8;
            }
        }
        image
    }

    /// True depth along the camera's z axis at a raw pixel.
    pub fn depth(&self, camera: &Camera, world_from_camera: &Se3, raw: [f32; 2]) -> Option<f64> {
        let b = camera.unproject(&Vec2::new(raw[0] as f64, raw[1] as f64))?;
        let ray = world_from_camera.rotation * (b / b.z);
        self.cast(&world_from_camera.translation, &ray).map(|h| h.0)
    }
}

pub struct Exposure {
    pub gain: f64,
    pub offset: f64,
    pub noise: f64,
    pub seed: u64,
}

/// Patches of three sizes with sharp edges, so that there are corners at all scales.
fn texture(u: f64, v: f64, grain: f64, seed: u64) -> f64 {
    let mut value = 128.0;
    for (k, weight) in [(1.0, 50.0), (0.45, 35.0), (0.2, 25.0)] {
        let size = grain * k;
        // Rows of cells are shifted by random offsets, so that no two places have the same texture.
        let row = (v / size).floor();
        let shift = hash(row as i64, 0, seed ^ 0x51) * size;
        let column = ((u + shift) / size).floor();
        value += weight * (hash(column as i64, row as i64, seed ^ (k * 64.0) as u64) * 2.0 - 1.0);
    }
    value
}

fn hash(a: i64, b: i64, seed: u64) -> f64 {
    let mut z =
        (a as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (b as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    z ^= seed.wrapping_mul(0x1656_67b1_9e37_79f9);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A pair as on a drone: strong distortion, cameras a degree off parallel, baseline 0.11 m.
pub fn lens_pair() -> Rig {
    let camera = |f: [f64; 4], d: [f64; 4]| Camera {
        distortion: Distortion::RadialTangential([d[0], d[1], d[2], d[3], 0.0]),
        ..Camera::pinhole(752, 480, f[0], f[1], f[2], f[3])
    };
    let cam0 = camera([458.6, 457.3, 367.2, 248.4], [-0.2834, 0.07396, 1.9e-4, 1.8e-5]);
    let cam1 = camera([457.6, 456.1, 380.0, 255.2], [-0.2837, 0.07451, -1.0e-4, -3.6e-5]);
    let right = Se3::new(So3::exp(&Vec3::new(0.0007, 0.0141, 0.0022)), Vec3::new(0.1100, -0.0002, -0.0009));
    pair(cam0, cam1, right)
}

/// A pair as on a car: already rectified; the baseline of 0.12 m suits the room.
pub fn pinhole_pair() -> Rig {
    let camera = Camera::pinhole(640, 400, 460.0, 460.0, 319.0, 201.0);
    pair(camera, camera, Se3::new(So3::identity(), Vec3::new(0.12, 0.0, 0.0)))
}

fn pair(cam0: Camera, cam1: Camera, left_from_right: Se3) -> Rig {
    let body_from_left = Se3::new(So3::exp(&Vec3::new(0.02, -0.4, 1.5)), Vec3::new(0.03, -0.06, 0.01));
    let named =
        |name: &str, camera, body_from_camera| RigCamera { name: name.into(), camera, body_from_camera };
    let cameras =
        vec![named("cam0", cam0, body_from_left), named("cam1", cam1, body_from_left * left_from_right)];
    Rig { cameras, depth: None, imu: None }
}
