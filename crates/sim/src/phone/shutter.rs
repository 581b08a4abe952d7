//! A camera with a lens and a rolling shutter, drawn with the pinhole renderer.
//!
//! The picture is drawn in bands of rows, each with the pose at its own time and with a pinhole camera that sees all that
//! the band's pixels see; then each pixel is fetched from its band along its ray (bilinear). What moves within a band's
//! time, a fraction of a millisecond, is not seen. Sensors have long rows: those of an upright picture are its columns.

use crate::effects::{Effects, Sensor};
use crate::render::Renderer;
use crate::world::World;
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::{Camera, GrayImage, RigError};
use std::sync::Arc;

/// Rows of a band.
const ROWS: usize = 24;
/// Pixels drawn beyond what a band needs: for interpolation and smooth edges.
const MARGIN: f64 = 3.0;

struct Band {
    renderer: Renderer,
    /// The first pixel along each axis of the picture, and their number.
    pixels: [[usize; 2]; 2],
    /// For each of its pixels the place in the drawn image: the pixel above and to the left, and the shares of those beside and below.
    from: Vec<(u32, [f32; 2])>,
}

/// The camera.
pub struct RollingCamera {
    bands: Vec<Band>,
    sensor: Sensor,
    size: [usize; 2],
    /// The axis of the picture along which the rows follow each other.
    along: usize,
    readout_s: f64,
    sharp: Vec<u16>,
}

impl RollingCamera {
    /// A camera of any lens; its rows are exposed one after the other over `readout_s` seconds.
    ///
    /// # Errors
    /// When the camera is not valid or a part of the picture has no ray.
    pub fn new(
        world: &Arc<World>,
        camera: &Camera,
        readout_s: f64,
        effects: Effects,
        seed: u64,
    ) -> Result<Self, RigError> {
        camera.validate()?;
        let size = [camera.width, camera.height];
        let along = usize::from(camera.height <= camera.width);
        let band = |first: usize| {
            let mut pixels = size.map(|count| [0, count]);
            pixels[along] = [first, ROWS.min(size[along] - first)];
            Band::new(world, camera, pixels)
        };
        let bands = (0..size[along]).step_by(ROWS).map(band).collect::<Result<_, _>>()?;
        let sensor = Sensor::new(camera, effects, seed, 0);
        let sharp = vec![0; camera.width * camera.height];
        Ok(Self { bands, sensor, size, along, readout_s, sharp })
    }

    /// Times of the bands in seconds from the exposure of the middle row, one for each pose that
    /// [`RollingCamera::picture`] takes.
    pub fn times(&self) -> Vec<f64> {
        let rows = self.size[self.along] as f64;
        let middle = |b: &Band| {
            let [first, count] = b.pixels[self.along].map(|n| n as f64);
            (first + 0.5 * count) / rows - 0.5
        };
        self.bands.iter().map(|b| self.readout_s * middle(b)).collect()
    }

    /// The picture at a time (seconds, for the exposure's wandering) from the poses of the camera in the world at
    /// [`RollingCamera::times`]; bands without a pose stay as they were.
    pub fn picture(&mut self, at_s: f64, world_from_camera: &[Se3]) -> GrayImage {
        let [width, height] = self.size;
        for (band, pose) in self.bands.iter_mut().zip(world_from_camera) {
            let w = band.renderer.camera().width;
            let drawn = band.renderer.draw(pose, &[], &[]);
            let [[x0, columns], [y0, _]] = band.pixels;
            for (k, row) in band.from.chunks(columns).enumerate() {
                let out = &mut self.sharp[(y0 + k) * width + x0..][..columns];
                for (out, (at, shares)) in out.iter_mut().zip(row) {
                    *out = bilinear(&drawn[*at as usize..], w, *shares);
                }
            }
        }
        let gain = self.sensor.gain(at_s);
        self.sensor.begin();
        self.sensor.add(&self.sharp);
        let mut image = GrayImage::new(width, height);
        self.sensor.develop(1, gain, &mut image);
        image
    }
}

impl Band {
    fn new(world: &Arc<World>, camera: &Camera, pixels: [[usize; 2]; 2]) -> Result<Self, RigError> {
        let [[x0, columns], [y0, rows]] = pixels;
        let mut from = Vec::with_capacity(columns * rows);
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for y in y0..y0 + rows {
            for x in x0..x0 + columns {
                let ray = camera.unproject(&Vec2::new(x as f64, y as f64)).filter(|r| r.z > 0.05);
                let ray = ray.ok_or_else(|| RigError(format!("pixel {x}, {y} has no ray ahead")))?;
                let p = [camera.fx * ray.x / ray.z, camera.fy * ray.y / ray.z];
                for k in 0..2 {
                    (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
                }
                from.push(p);
            }
        }
        let origin = low.map(|v| v.floor() - MARGIN);
        let size = [0, 1].map(|k| (high[k].ceil() + MARGIN - origin[k]) as usize + 1);
        let [w, h] = size.map(|s| s.max(8));
        let pinhole = Camera::pinhole(w, h, camera.fx, camera.fy, -origin[0], -origin[1]);
        let renderer = Renderer::off_centre(world, pinhole)?;
        let place = |p: &[f64; 2]| {
            let [x, y] = [0, 1].map(|k| (p[k] - origin[k]) as f32);
            let (i, j) = (x as usize, y as usize);
            ((j * w + i) as u32, [x - i as f32, y - j as f32])
        };
        let from = from.iter().map(place).collect();
        Ok(Self { renderer, pixels, from })
    }
}

/// The value between four pixels, the first of which begins the image's rest: by the shares of the one beside and of those below.
fn bilinear(image: &[u16], width: usize, [a, b]: [f32; 2]) -> u16 {
    let image = &image[..width + 2];
    let mixed = |at: usize| f32::from(image[at]) * (1.0 - a) + f32::from(image[at + 1]) * a;
    (mixed(0) * (1.0 - b) + mixed(width) * b + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{WorldKind, WorldOptions};
    use cairn_geometry::{So3, Vec3};
    use cairn_sensor::Distortion;

    fn world() -> Arc<World> {
        let options = WorldOptions { detail: 0.1, ..WorldOptions::default() };
        Arc::new(World::build(WorldKind::Corridor, 1, &options))
    }

    fn pose(world: &World, turned: f64) -> Se3 {
        let at = world.routes()[0].points[0];
        let ahead = cairn_geometry::Mat3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let turn = So3::from_matrix(&ahead) * So3::exp(&Vec3::new(0.0, turned, 0.0));
        Se3::new(turn, Vec3::new(at.x, at.y, 1.3))
    }

    #[test]
    fn pinhole_with_a_global_shutter_is_the_renderer_s_image() {
        let world = world();
        let camera = Camera::pinhole(96, 72, 70.0, 70.0, 47.5, 35.5);
        let mut rolling = RollingCamera::new(&world, &camera, 0.0, Effects::none(), 1).unwrap();
        let at = pose(&world, 0.2);
        let picture = rolling.picture(0.0, &vec![at; rolling.times().len()]);
        let mut plain = GrayImage::new(96, 72);
        Renderer::new(&world, camera).unwrap().render(&at, &mut plain, None);
        // Texture filters are chosen for blocks of pixels, which begin elsewhere here: places are compared, not greys.
        let square = |dx: usize, dy: usize| -> i64 {
            let apart = |x: usize, y: usize| {
                i64::from(picture.row(y + dy)[x + dx]) - i64::from(plain.row(y + 2)[x + 2])
            };
            (0..68).flat_map(|y| (0..92).map(move |x| (x, y))).map(|(x, y)| apart(x, y).pow(2)).sum()
        };
        let here = square(2, 2);
        for (dx, dy) in [(1, 2), (3, 2), (2, 1), (2, 3), (0, 2), (4, 2), (2, 0), (2, 4)] {
            assert!(here < square(dx, dy), "{here} here, {} at {dx}, {dy}", square(dx, dy));
        }
    }

    #[test]
    fn each_band_is_seen_from_its_own_pose_through_the_lens() {
        let world = world();
        let lens = Distortion::RadialTangential([-0.1, 0.0, 0.0, 0.0, 0.0]);
        let camera = Camera { distortion: lens, ..Camera::pinhole(96, 72, 70.0, 70.0, 47.5, 35.5) };
        let mut rolling = RollingCamera::new(&world, &camera, 0.02, Effects::none(), 1).unwrap();
        let times = rolling.times();
        assert!(times.len() == 3 && times[0] > -0.01 && times[2] < 0.01 && times[1].abs() < 1e-12);
        let poses: Vec<Se3> = times.iter().map(|t| pose(&world, 5.0 * t)).collect();
        let picture = rolling.picture(0.0, &poses);
        for (k, band) in picture.data().chunks(96 * ROWS).enumerate() {
            let still = rolling.picture(0.0, &[poses[k]; 3]);
            assert_eq!(band, &still.data()[96 * ROWS * k..][..band.len()], "band {k}");
        }
        let global = rolling.picture(0.0, &[poses[1]; 3]);
        assert_ne!(picture.data()[..96 * ROWS], global.data()[..96 * ROWS]);
    }

    #[test]
    fn an_upright_picture_is_read_column_by_column() {
        let world = world();
        let camera = Camera::pinhole(72, 96, 70.0, 70.0, 35.5, 47.5);
        let mut rolling = RollingCamera::new(&world, &camera, 0.02, Effects::none(), 1).unwrap();
        let times = rolling.times();
        assert!(times.len() == 3 && times[0] < 0.0 && times[2] > 0.0);
        let poses: Vec<Se3> = times.iter().map(|t| pose(&world, 5.0 * t)).collect();
        let picture = rolling.picture(0.0, &poses);
        let column = |image: &GrayImage, x: usize| (0..96).map(|y| image.row(y)[x]).collect::<Vec<u8>>();
        for (k, of_band) in poses.iter().enumerate() {
            let still = rolling.picture(0.0, &[*of_band; 3]);
            for x in ROWS * k..ROWS * (k + 1) {
                assert_eq!(column(&picture, x), column(&still, x), "column {x}");
            }
        }
    }
}
