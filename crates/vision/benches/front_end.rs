//! Time to process one frame in the front end: `cargo bench -p cairn-vision --bench front_end`.
//!
//! Prints the fastest of many runs (the figure least disturbed by other load on the machine) and the median; on Linux
//! also the mean CPU time of the calling thread, which excludes the second thread and waiting for a processor.

#[path = "../tests/suite/common/mod.rs"]
mod common;

use cairn_sensor::{FramePacket, GrayImage, Rig, Stamp};
use cairn_vision::{FrontEnd, FrontEndConfig, OrbConfig, SensorMode};
use common::recordings::{depth_png, euroc_rig, folder, jpeg, kitti_rig, listing};
use std::sync::Arc;
use std::time::Instant;

fn packet(images: Vec<Arc<GrayImage>>) -> FramePacket {
    FramePacket { stamp: Stamp(0), images, depth: None, imu: Vec::new(), decode_ms: 0.0 }
}

/// CPU time of this thread in nanoseconds, 0 where the system does not report it.
fn cpu_ns() -> u64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|t| t.parse().ok()).unwrap_or(0)
}

fn time(
    name: &str,
    rig: &Rig,
    sensor: SensorMode,
    features: usize,
    two_threads: bool,
    packets: &[FramePacket],
) {
    let orb = OrbConfig { features, ..OrbConfig::default() };
    let config = FrontEndConfig { orb, two_threads, ..FrontEndConfig::default() };
    let mut front_end = FrontEnd::new(rig, sensor, config).unwrap();
    let mut times = Vec::new();
    let mut cpu_start = 0;
    let (mut features_total, mut with_depth) = (0, 0);
    for round in 0..12 {
        if round == 1 {
            cpu_start = cpu_ns();
        }
        for p in packets {
            let start = Instant::now();
            let frame = front_end.extract(p).unwrap();
            if round > 0 {
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            features_total += frame.len();
            with_depth += frame.depth.iter().filter(|d| **d > 0.0).count();
        }
    }
    times.sort_by(f64::total_cmp);
    let cpu_ms = (cpu_ns() - cpu_start) as f64 * 1e-6 / times.len() as f64;
    println!(
        "{name:<34} fastest {:6.2} ms, median {:6.2} ms; CPU time {cpu_ms:5.2} ms; {} features, {} with depth",
        times[0],
        times[times.len() / 2],
        features_total / (12 * packets.len()),
        with_depth / (12 * packets.len())
    );
}

fn main() {
    if let Some(path) = folder("euroc-mh01") {
        let list = |cam: &str| listing(&path.join("mav0").join(cam).join("data"), ".jpg");
        let packets: Vec<_> = list("cam0")
            .iter()
            .zip(list("cam1"))
            .step_by(80)
            .map(|(l, r)| packet(vec![jpeg(l), jpeg(&r)]))
            .collect();
        let rig = euroc_rig();
        time("euroc mono 1000", &rig, SensorMode::Mono, 1000, false, &packets);
        time("euroc mono 1200", &rig, SensorMode::Mono, 1200, false, &packets);
        time("euroc stereo 1200, one thread", &rig, SensorMode::Stereo, 1200, false, &packets);
        time("euroc stereo 1200, two threads", &rig, SensorMode::Stereo, 1200, true, &packets);
    }
    if let Some(path) = folder("kitti-a") {
        let list = |cam: &str| listing(&path.join(cam), ".jpg");
        let packets: Vec<_> = list("image_0")
            .iter()
            .zip(list("image_1"))
            .step_by(10)
            .map(|(l, r)| packet(vec![jpeg(l), jpeg(&r)]))
            .collect();
        let rig = kitti_rig();
        time("kitti mono 2000", &rig, SensorMode::Mono, 2000, false, &packets);
        time("kitti stereo 2000, one thread", &rig, SensorMode::Stereo, 2000, false, &packets);
        time("kitti stereo 2000, two threads", &rig, SensorMode::Stereo, 2000, true, &packets);
    }
    if let Some(path) = folder("7scenes-kitchen") {
        let depths = listing(&path, ".depth.png");
        let packets: Vec<_> = listing(&path, ".color.jpg")
            .iter()
            .zip(depths)
            .step_by(60)
            .map(|(c, d)| FramePacket { depth: Some(depth_png(&d)), ..packet(vec![jpeg(c)]) })
            .collect();
        let rig = common::recordings::kitchen_rig(false);
        time("kitchen mono 1000", &rig, SensorMode::Mono, 1000, false, &packets);
        time(
            "kitchen rgb-d 1000, registered",
            &common::recordings::kitchen_rig(true),
            SensorMode::Rgbd,
            1000,
            false,
            &packets,
        );
        time("kitchen rgb-d 1000, not registered", &rig, SensorMode::Rgbd, 1000, false, &packets);
    }
}
