//! Prints frames a second of the renderer on one core, for every world: 640x480 gray and depth along the first route.
//! Times are CPU times of the process (`/proc/self/schedstat`) where the system provides them, so that other programs
//! on the machine have little influence; elsewhere wall-clock times.
//! `cargo run --release -p cairn-sim --example render_speed [SNAPSHOT_DIR]`; with a folder, also writes some images.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthImage, GrayImage, Source};
use cairn_sim::{Renderer, SimConfig, SimSensor, SimSource, World, WorldKind, WorldOptions};
use std::sync::Arc;
use std::time::Instant;

/// Milliseconds since some instant: of CPU time where the system provides it.
struct Clock(Instant);

impl Clock {
    fn ms(&self) -> f64 {
        let told = std::fs::read_to_string("/proc/self/schedstat").ok();
        let nanos = told.and_then(|s| s.split(' ').next()?.parse::<f64>().ok());
        nanos.map_or_else(|| self.0.elapsed().as_secs_f64() * 1e3, |n| n * 1e-6)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let clock = Clock(Instant::now());
    let folder = std::env::args().nth(1);
    let camera = Camera::pinhole(640, 480, 420.0, 420.0, 319.5, 239.5);
    for kind in WorldKind::ALL {
        let begin = clock.ms();
        let world = Arc::new(World::build(kind, 1, &WorldOptions::default()));
        let build_ms = clock.ms() - begin;
        let mut renderer = Renderer::new(&world, camera)?;
        let (mut image, mut depth) = (GrayImage::new(640, 480), DepthImage::new(640, 480));
        let route = &world.routes()[0];
        let mut ms = Vec::new();
        for s in route.points.windows(2) {
            let d = s[1] - s[0];
            let heading = d.y.atan2(d.x);
            for k in 0..40 {
                let p = s[0] + d * (f64::from(k) / 40.0);
                let turn = heading + 0.3 * (f64::from(k) * 0.4).sin();
                let right = Vec3::new(turn.sin(), -turn.cos(), 0.0);
                let forward = Vec3::new(turn.cos(), turn.sin(), -0.1).normalize();
                let m = nalgebra::Matrix3::from_columns(&[right, forward.cross(&right), forward]);
                let pose = Se3::new(So3::from_matrix(&m), Vec3::new(p.x, p.y, 1.3));
                let begin = clock.ms();
                renderer.render(&pose, &mut image, Some(&mut depth));
                ms.push(clock.ms() - begin);
                if let (Some(folder), 0 | 20) = (&folder, k) {
                    write(&format!("{folder}/{kind}-{}.png", ms.len() - 1), &image)?;
                }
            }
        }
        let mut config = SimConfig::new(kind, 1);
        config.start_s = 3.0;
        config.duration_s = Some(2.0);
        config.sensor = SimSensor::Rgbd;
        let mut source = SimSource::in_world(&config, Arc::clone(&world))?;
        let begin = clock.ms();
        let mut packets = 0;
        while source.next_packet()?.is_some() {
            packets += 1;
        }
        let packet_ms = (clock.ms() - begin) / f64::from(packets);
        let mean = ms.iter().sum::<f64>() / ms.len() as f64;
        ms.sort_by(f64::total_cmp);
        println!(
            "{kind:9} build {build_ms:5.0} ms, {:4} faces, {:5.1} MB textures; frame p50 {:.2} p95 {:.2} mean {mean:.2} ms: {:.0} frames/s; with sensor effects and IMU {packet_ms:.2} ms",
            world.face_count(),
            world.texture_bytes() as f64 / 1e6,
            ms[ms.len() / 2],
            ms[ms.len() * 95 / 100],
            1e3 / mean
        );
    }
    Ok(())
}

fn write(path: &str, image: &GrayImage) -> Result<(), Box<dyn std::error::Error>> {
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut e = png::Encoder::new(file, image.width() as u32, image.height() as u32);
    e.set_color(png::ColorType::Grayscale);
    e.write_header()?.write_image_data(image.data())?;
    Ok(())
}
