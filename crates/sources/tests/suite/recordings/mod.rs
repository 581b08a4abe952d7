//! Recordings: the real ones of the data folder, and small ones of each kind made here.

use crate::common;
mod jpegs;

use cairn_geometry::Vec3;
use cairn_sensor::{Camera, FramePacket, Rig, Source, Stamp};
use cairn_sources::{OpenOptions, open, write_rig};
use common::{Folder, data, depth_png, gray_png, png, rgbd_rig};

fn all(source: &mut dyn Source) -> Vec<FramePacket> {
    let mut packets = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        packets.push(packet);
    }
    packets
}

fn play(folder: &str, options: OpenOptions) -> (Box<dyn Source>, Vec<FramePacket>) {
    let mut source = open(folder, options).unwrap();
    let packets = all(source.as_mut());
    (source, packets)
}

/// An EuRoC folder of 8x6 pixels: five stereo pairs 50 ms apart, IMU at 200 Hz from 3 s before.
fn euroc() -> Folder {
    let folder = Folder::new();
    for (i, camera) in ["cam0", "cam1"].iter().enumerate() {
        let mut csv = "#timestamp [ns],filename\r\n".to_owned();
        for n in 0..5u8 {
            let stamp = 10_000_000_000 + 50_000_000 * i64::from(n);
            csv += &format!("{stamp},{stamp}.png\r\n");
            folder.write(&format!("mav0/{camera}/data/{stamp}.png"), gray_png(8, 6, 10 * n));
        }
        folder.write(&format!("mav0/{camera}/data.csv"), csv);
        let sensor = format!(
            "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0.{i},\n   0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n\
             resolution: [8, 6]\ncamera_model: pinhole\nintrinsics: [7, 7, 4, 3]\n"
        );
        folder.write(&format!("mav0/{camera}/sensor.yaml"), sensor);
    }
    let imu = "sensor_type: imu\nrate_hz: 200\ngyroscope_noise_density: 1e-4\ngyroscope_random_walk: 1e-5\n\
               accelerometer_noise_density: 1e-3\naccelerometer_random_walk: 1e-4\n";
    folder.write("mav0/imu0/sensor.yaml", imu);
    let lines: String =
        (0..700).map(|i| format!("{},0,0,{i},0,0,9.81\n", 7_002_000_000i64 + 5_000_000 * i)).collect();
    folder.write("mav0/imu0/data.csv", "#header\n".to_owned() + &lines);
    folder.write(
        "mav0/state_groundtruth_estimate0/data.csv",
        "#t,p,q\n10000000000,1,2,3,0.5,0.5,0.5,0.5,0,0,0\n10050000000,1,2,4,1,0,0,0\n",
    );
    folder
}

fn csv(folder: &Folder, camera: &str, stamps: &[i64]) {
    let lines: String = stamps.iter().map(|s| format!("{s},{s}.png\n")).collect();
    folder.write(&format!("mav0/{camera}/data.csv"), lines);
    for s in stamps {
        folder.write(&format!("mav0/{camera}/data/{s}.png"), gray_png(8, 6, 1));
    }
}

#[test]
fn real_euroc() {
    let Some(path) = data("euroc-mh01") else { return };
    let (source, packets) = play(path.to_str().unwrap(), OpenOptions::default());
    assert_eq!((packets.len(), source.info().frames, source.skipped().len()), (399, Some(399), 0));
    assert!((source.info().rate_hz - 20.0).abs() < 0.01);
    assert_eq!(source.info().truth.len(), 4975);
    assert_eq!(source.info().truth[0].0, Stamp(1_403_636_580_838_560_000));
    assert_eq!(packets[0].stamp, Stamp(1_403_636_584_763_555_584));
    // One second before the first image, then 50 ms each; every sample once, one at or after each image.
    assert!((packets[0].stamp - packets[0].imu[0].stamp).abs() <= 1.0 && packets[0].imu.len() >= 200);
    let samples: Vec<Stamp> = packets.iter().flat_map(|p| p.imu.iter().map(|s| s.stamp)).collect();
    assert!(samples.windows(2).all(|w| w[0] < w[1]));
    assert_eq!(samples.len(), 4191);
    for packet in &packets {
        assert_eq!((packet.images.len(), packet.images[0].width()), (2, 752));
        let last = packet.imu.last().unwrap().stamp;
        assert!(last >= packet.stamp && last - packet.stamp < 0.005);
        assert!(packet.decode_ms > 0.0);
    }
    // No image twice, and none black.
    let mean =
        |i: usize| packets[0].images[i].data().iter().map(|v| f64::from(*v)).sum::<f64>() / (752.0 * 480.0);
    assert!(mean(0) > 20.0 && mean(1) > 20.0 && packets[0].images[0] != packets[0].images[1]);
}

#[test]
fn real_kitti() {
    let Some(path) = data("kitti-a") else { return };
    let (source, packets) = play(path.to_str().unwrap(), OpenOptions::default());
    assert_eq!((packets.len(), source.skipped().len(), source.info().truth.len()), (51, 0, 51));
    assert_eq!(packets[1].stamp, Stamp(103_700_000));
    assert!((source.info().rate_hz - 9.643).abs() < 0.01);
    assert!((source.info().truth[1].1.translation.z - 1.198998).abs() < 1e-9);
    assert!(packets.iter().all(|p| p.images.len() == 2 && p.imu.is_empty() && p.images[1].height() == 370));
}

#[test]
fn real_seven_scenes() {
    let Some(path) = data("7scenes-kitchen") else { return };
    let (source, packets) = play(path.to_str().unwrap(), OpenOptions::default());
    assert_eq!((packets.len(), source.skipped().len(), source.info().truth.len()), (300, 0, 300));
    assert_eq!((packets[1].stamp, packets[30].stamp), (Stamp(33_333_333), Stamp(1_000_000_000)));
    let depth = packets[7].depth.as_ref().unwrap();
    assert!(depth.data().iter().all(|d| *d != 65535) && depth.data().contains(&0));
    let rig = source.rig();
    let depth = rig.depth.as_ref().unwrap();
    assert!(depth.registered && depth.camera.fx == 585.0 && rig.cameras[0].camera == depth.camera);
}

#[test]
fn small_euroc_is_read_completely() {
    let folder = euroc();
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((packets.len(), source.skipped()), (5, &[][..]));
    assert_eq!(packets[3].images[1].at(1, 0), 31);
    assert_eq!(packets[0].imu[0].stamp, Stamp(9_002_000_000));
    assert_eq!(packets[0].imu.last().unwrap().stamp, Stamp(10_002_000_000));
    assert_eq!(packets[1].imu[0].stamp, Stamp(10_007_000_000));
    assert_eq!(packets[1].imu.len(), 10);
    assert_eq!(source.info().truth[1].1.translation, Vec3::new(1.0, 2.0, 4.0));
    assert_eq!(source.rig().cameras[1].body_from_camera.translation.x, 0.1);
    // The inner folder may be given too.
    assert_eq!(
        all(open(folder.path().join("mav0").to_str().unwrap(), OpenOptions::default()).unwrap().as_mut())
            .len(),
        5
    );
}

#[test]
fn start_and_frame_count_select_a_part() {
    let folder = euroc();
    let options = OpenOptions { start_s: 0.1, frames: Some(2), ..Default::default() };
    let (source, packets) = play(folder.name(), options);
    assert_eq!((packets.len(), source.info().frames), (2, Some(2)));
    assert_eq!(packets[0].stamp, Stamp(10_100_000_000));
    assert_eq!(packets[0].imu[0].stamp, Stamp(9_102_000_000));
    let error = |start_s| {
        let options = OpenOptions { start_s, ..Default::default() };
        open(folder.name(), options).err().unwrap().to_string()
    };
    assert!(error(9.0).contains("none of its 5 instants"), "{}", error(9.0));
    assert!(error(f64::NAN).contains("cannot start"));
}

#[test]
fn given_rig_decides_what_is_read() {
    let folder = euroc();
    let mono = Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0));
    let options = OpenOptions { rig: Some(mono.clone()), ..Default::default() };
    let (source, packets) = play(folder.name(), options);
    assert!(source.rig().imu.is_none() && packets.iter().all(|p| p.images.len() == 1 && p.imu.is_empty()));
    // A rig.toml in the folder takes precedence over sensor.yaml.
    folder.write("mav0/rig.toml", write_rig(&mono).unwrap());
    assert_eq!(play(folder.name(), OpenOptions::default()).1[0].images.len(), 1);
    let mut three = mono;
    for (name, x) in [("b", 0.1), ("c", 0.2)] {
        let mut camera = three.cameras[0].clone();
        camera.name = name.into();
        camera.body_from_camera.translation.x = x;
        three.cameras.push(camera);
    }
    let error = open(folder.name(), OpenOptions { rig: Some(three), ..Default::default() }).err().unwrap();
    assert!(error.to_string().contains("the rig has 3 cameras, the folder has images of 2"), "{error}");
}

#[test]
fn imu_stamps_are_in_the_images_clock() {
    let folder = euroc();
    let mut source = open(folder.name(), OpenOptions::default()).unwrap();
    let mut rig = source.rig().clone();
    let first = source.next_packet().unwrap().unwrap();
    rig.imu.as_mut().unwrap().offset_s = 0.0015;
    let (source, packets) = play(folder.name(), OpenOptions { rig: Some(rig), ..Default::default() });
    assert_eq!(packets[0].imu[0].stamp, first.imu[0].stamp.plus_seconds(0.0015));
    assert_eq!(source.rig().imu.as_ref().unwrap().offset_s, 0.0);
}

#[test]
fn unpaired_images_are_counted() {
    let folder = euroc();
    let ms = 1_000_000;
    csv(&folder, "cam0", &[0, 50 * ms, 100 * ms, 150 * ms]);
    csv(&folder, "cam1", &[400_000, 100 * ms, 180 * ms, 200 * ms]);
    folder.remove("mav0/imu0/data.csv");
    // Its poses are of another time.
    folder.remove("mav0/state_groundtruth_estimate0/data.csv");
    let (source, packets) = play(folder.name(), OpenOptions::default());
    let stamps: Vec<i64> = packets.iter().map(|p| p.stamp.0 / ms).collect();
    assert_eq!(stamps, [0, 100]);
    assert_eq!(source.skipped().len(), 4, "{:?}", source.skipped());
    assert!(source.rig().imu.is_none());
}

#[test]
fn pairs_that_are_apart_are_pairs_and_told() {
    let folder = euroc();
    let ms = 1_000_000;
    csv(&folder, "cam0", &[0, 50 * ms, 100 * ms, 150 * ms]);
    csv(&folder, "cam1", &[2 * ms, 52 * ms, 102 * ms, 152 * ms]);
    folder.remove("mav0/imu0/data.csv");
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!(packets.len(), 4);
    assert!(source.skipped()[0].contains("2.0 ms apart"), "{:?}", source.skipped());
}

#[test]
fn euroc_times_are_read_in_seconds_and_without_lists() {
    let folder = euroc();
    for camera in ["cam0", "cam1"] {
        let lines = "10.000000000,10000000000.png\n1.005e1,10050000000.png\n";
        folder.write(&format!("mav0/{camera}/data.csv"), lines);
    }
    let (_, packets) = play(folder.name(), OpenOptions::default());
    let stamps = |packets: &[FramePacket]| packets.iter().map(|p| p.stamp.0).collect::<Vec<_>>();
    assert_eq!(stamps(&packets), [10_000_000_000, 10_050_000_000]);
    assert!(!packets[1].imu.is_empty());
    ["cam0", "cam1"].iter().for_each(|camera| folder.remove(&format!("mav0/{camera}/data.csv")));
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((stamps(&packets)[4], packets.len(), source.rig().cameras.len()), (10_200_000_000, 5, 2));
}

#[test]
fn decreasing_times_are_dropped_and_counted() {
    let folder = euroc();
    let s = 1_000_000_000;
    for camera in ["cam0", "cam1"] {
        csv(&folder, camera, &[s, 2 * s, 2 * s, s / 2, 3 * s, 900 * s, 4 * s, 5 * s]);
    }
    let lines = "1000000000,0,0,0,0,0,1\n1500000000,0,0,0,0,0,2\n1500000000,0,0,0,0,0,3\n1200000000,0,0,0,0,0,4\n\
                 1600000000,0,0,0,0,0\n1600000000,0,0,nan,0,0,5\n2000000000,0,0,0,0,0,6\n";
    folder.write("mav0/imu0/data.csv", lines);
    let (source, packets) = play(folder.name(), OpenOptions::default());
    let stamps: Vec<i64> = packets.iter().map(|p| p.stamp.0 / s).collect();
    assert_eq!(stamps, [1, 2, 3, 4, 5]);
    let has = |text: &str| source.skipped().iter().filter(|l| l.contains(text)).count();
    assert_eq!(
        (has("is repeated, image"), has("goes backwards, image"), has("jumps ahead, image")),
        (1, 1, 1),
        "{:?}",
        source.skipped()
    );
    assert_eq!((has("sample dropped"), has("not an IMU sample")), (2, 2), "{:?}", source.skipped());
    let accel: Vec<f64> = packets.iter().flat_map(|p| p.imu.iter().map(|s| s.accel.z)).collect();
    assert_eq!(accel, [1.0, 2.0, 6.0]);
}

#[test]
fn broken_and_missing_images_are_skipped_and_counted() {
    let folder = euroc();
    let name = |n: i64| format!("mav0/cam{}/data/{}.png", n % 2, 10_000_000_000 + 50_000_000 * n);
    let whole = gray_png(8, 6, 0);
    folder.write(&name(0), &whole[..whole.len() - 20]);
    folder.remove(&name(1));
    folder.write(&name(2), "");
    folder.write(&name(3), gray_png(6, 6, 0));
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!(packets.len(), 1);
    assert_eq!(source.skipped().len(), 4, "{:?}", source.skipped());
    for (line, text) in source.skipped().iter().zip([
        "PNG",
        "No such file",
        "is empty",
        "cam1 has 6x6 pixels, the rig says 8x6",
    ]) {
        assert!(line.contains(text), "{line}");
    }
    // The IMU samples in between are not lost, except for those more than a second before the first packet.
    assert_eq!(packets[0].stamp, Stamp(10_200_000_000));
    assert_eq!(packets[0].imu[0].stamp, Stamp(9_202_000_000));
    assert_eq!(packets[0].imu.len(), 201);
}

#[test]
fn skipped_image_keeps_its_imu_samples() {
    let folder = euroc();
    folder.remove("mav0/cam0/data/10050000000.png");
    let (_, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((packets.len(), packets[1].imu.len()), (4, 20));
}

#[test]
fn every_pixel_format_becomes_luminance() {
    use png::{BitDepth::Eight, BitDepth::Sixteen, ColorType};
    let folder = Folder::new();
    folder.write("rig.toml", write_rig(&Rig::mono(Camera::pinhole(2, 1, 2.0, 2.0, 1.0, 0.5))).unwrap());
    let images: [(ColorType, png::BitDepth, &[u8], [u8; 2]); 6] = [
        (ColorType::Grayscale, Eight, &[3, 200], [3, 200]),
        (ColorType::Grayscale, Sixteen, &[0x12, 0xff, 0xff, 0x00], [0x12, 0xff]),
        (ColorType::GrayscaleAlpha, Eight, &[3, 255, 200, 0], [3, 200]),
        (ColorType::Rgb, Eight, &[255, 0, 0, 0, 255, 0], [76, 150]),
        (ColorType::Rgba, Eight, &[0, 0, 255, 9, 255, 255, 255, 9], [29, 255]),
        (ColorType::Rgb, Sixteen, &[255, 9, 0, 9, 0, 9, 10, 9, 10, 9, 10, 9], [76, 10]),
    ];
    let mut csv = String::new();
    for (i, (colour, depth, data, _)) in images.iter().enumerate() {
        folder.write(&format!("cam0/data/{i}.png"), png(2, 1, *colour, *depth, data));
        csv += &format!("{i}00000000,{i}.png\n");
    }
    folder.write("cam0/data.csv", csv);
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!(source.skipped(), &[] as &[String]);
    for (packet, (colour, depth, _, luminance)) in packets.iter().zip(images) {
        assert_eq!(packet.images[0].data(), luminance, "{colour:?} {depth:?}");
    }
}

#[test]
fn euroc_with_depth() {
    let folder = euroc();
    folder.write("mav0/rig.toml", write_rig(&rgbd_rig()).unwrap());
    folder.write("mav0/depth0/data/a.png", depth_png(8, 6, 7, 1234));
    folder.write("mav0/depth0/data.csv", "10050000000,a.png\n");
    let (_, packets) = play(folder.name(), OpenOptions::default());
    assert!(packets[0].depth.is_none());
    assert_eq!(packets[1].depth.as_ref().unwrap().data()[..2], [7, 1234]);
}

/// TUM-VI: no `sensor.yaml`, but a Kalibr chain in `dso/`, 16-bit images, ground truth in `mocap0`.
#[test]
fn tum_vi_folder() {
    let folder = Folder::new();
    let mut chain = String::new();
    for (i, x) in [(0, 0.0), (1, -0.1)] {
        chain += &format!(
            "cam{i}:\n  T_cam_imu:\n  - [1.0, 0.0, 0.0, {x}]\n  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n  \
             - [0.0, 0.0, 0.0, 1.0]\n  camera_model: pinhole\n  distortion_coeffs: [0.003, 0.0007, -0.002, 0.0002]\n  \
             distortion_model: equidistant\n  intrinsics: [4.0, 4.0, 3.5, 2.5]\n  resolution: [8, 6]\n"
        );
        folder.write(&format!("mav0/cam{i}/data/100.png"), depth_png(8, 6, 0x7fff, 0x1234));
        folder.write(&format!("mav0/cam{i}/data.csv"), "#timestamp [ns],filename\n100,100.png\n");
    }
    folder.write("dso/camchain.yaml", chain);
    let imu = "accelerometer_noise_density: 0.0014\naccelerometer_random_walk: 8.6e-05\n\
               gyroscope_noise_density: 8.0e-05\ngyroscope_random_walk: 2.2e-06\nrostopic: /imu0\nupdate_rate: 200.0\n";
    folder.write("dso/imu_config.yaml", imu);
    folder.write("mav0/imu0/data.csv", "50,0,0,0,0,0,9.8\n100,0,0,0,0,0,9.8\n");
    folder.write("mav0/mocap0/data.csv", "#timestamp [ns], p, q\n90,1,2,3,1,0,0,0\n");
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((packets.len(), packets[0].imu.len(), source.info().truth.len()), (1, 2, 1));
    assert_eq!(packets[0].images[1].data()[..2], [0x7f, 0x12]);
    assert_eq!(source.rig().cameras[1].body_from_camera.translation.x, 0.1);
    assert!(matches!(source.rig().cameras[0].camera.distortion, cairn_sensor::Distortion::Equidistant(_)));
}

/// A TUM folder with rig.toml, three colour and three depth images.
fn tum() -> Folder {
    let folder = Folder::new();
    folder.write("rig.toml", write_rig(&rgbd_rig()).unwrap());
    folder.write(
        "rgb.txt",
        "# color images\n# file: 'x.bag'\n1.000000 rgb/a.png\n1.033333 rgb/b.png\n1.066667 rgb/c.png\n",
    );
    folder.write("depth.txt", "1.015000 depth/a.png\n1.021000 depth/b.png\n1.500000 depth/c.png\n");
    folder.write("groundtruth.txt", "# t x y z q\n1.0 1 2 3 0 0 0 1\n1.1 4 5 6 0 0 1 0\n");
    for (i, name) in ["a", "b", "c"].iter().enumerate() {
        folder.write(&format!("rgb/{name}.png"), gray_png(8, 6, i as u8));
        folder.write(&format!("depth/{name}.png"), depth_png(8, 6, 100 + i as u16, 5000));
    }
    folder
}

#[test]
fn tum_folder() {
    let folder = tum();
    let (source, packets) = play(folder.name(), OpenOptions::default());
    let first = |p: &FramePacket| p.depth.as_ref().map(|d| d.at(0, 0));
    assert_eq!(packets.iter().map(first).collect::<Vec<_>>(), [Some(100), Some(101), None]);
    assert_eq!(packets[1].stamp, Stamp(1_033_333_000));
    assert_eq!(source.info().truth[1].0, Stamp(1_100_000_000));
    assert_eq!(source.skipped(), &[] as &[String]);
    // 8-bit depth is refused, image by image.
    folder.write("depth/b.png", gray_png(8, 6, 0));
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!(packets.len(), 2);
    assert!(source.skipped()[0].contains("depth must be 16-bit gray"), "{:?}", source.skipped());
}

#[test]
fn tum_without_intrinsics_states_its_assumption() {
    for (name, fx, said) in [
        ("rgbd_dataset_freiburg1_desk", 517.3, "freiburg1"),
        ("rgbd_dataset_freiburg2_xyz", 520.9, "freiburg2"),
        ("rgbd_dataset_freiburg3_walking", 535.4, "freiburg3"),
        ("kitchen", 525.0, "ROS default"),
    ] {
        let folder = Folder::new();
        folder.write(&format!("{name}/rgb.txt"), "1.0 a.png\n");
        folder.write(&format!("{name}/depth.txt"), "1.0 d.png\n");
        folder.write(&format!("{name}/a.png"), gray_png(640, 480, 0));
        folder.write(&format!("{name}/d.png"), depth_png(640, 480, 0, 5000));
        let path = folder.path().join(name);
        let (source, packets) = play(path.to_str().unwrap(), OpenOptions::default());
        assert_eq!((source.rig().cameras[0].camera.fx, packets.len()), (fx, 1));
        assert!(source.info().name.contains(said), "{}", source.info().name);
        let depth = source.rig().depth.as_ref().unwrap();
        assert!(depth.registered && depth.metres_per_unit == 1.0 / 5000.0);
    }
}

fn kitti() -> Folder {
    let folder = Folder::new();
    for i in 0..4 {
        for camera in 0..2 {
            folder.write(&format!("image_{camera}/{i:06}.png"), gray_png(8, 6, i + 50 * camera));
        }
    }
    let p = |x: f64| format!("7 0 4 {x} 0 7 3 0 0 0 1 0");
    folder.write("calib.txt", format!("P0: {}\nP1: {}\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n", p(0.0), p(-3.5)));
    folder.write("times.txt", "0.000000e+00\n1.037000e-01\n2.0e-01\n3.0e-01\n");
    folder.write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 0.5\n");
    folder
}

#[test]
fn kitti_folder() {
    let folder = kitti();
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((packets.len(), packets[1].stamp, packets[3].images[1].at(0, 0)), (4, Stamp(103_700_000), 53));
    assert_eq!(source.rig().cameras[1].body_from_camera.translation, Vec3::new(0.5, 0.0, 0.0));
    assert_eq!(source.info().truth.len(), 2);
    // A missing right image: that pair is skipped. Fewer times than images: those without are left out. No
    // times: 10 Hz.
    folder.remove("image_1/000001.png");
    folder.write("times.txt", "0.0\n0.1\n0.2\n");
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!((packets.len(), source.skipped().len()), (2, 2), "{:?}", source.skipped());
    folder.remove("times.txt");
    let (_, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!(packets.iter().map(|p| p.stamp.0 / 100_000_000).collect::<Vec<_>>(), [0, 2, 3]);
    folder.write("poses.txt", "1 0 0 0\n");
    let error = open(folder.name(), OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("poses.txt, line 1: a pose needs 12"), "{error}");
}

#[test]
fn seven_scenes_folder() {
    let folder = Folder::new();
    for (i, number) in [10, 11, 13].iter().enumerate() {
        folder.write(&format!("frame-{number:06}.color.png"), gray_png(640, 480, i as u8));
        folder.write(&format!("frame-{number:06}.depth.png"), depth_png(640, 480, 65535, 1000));
        folder.write(&format!("frame-{number:06}.pose.txt"), "1 0 0 0\n0 1 0 0\n0 0 1 2\n0 0 0 1\n");
    }
    folder.write("frame-000011.pose.txt", "nan nan nan nan\n0 1 0 0\n0 0 1 2\n0 0 0 1\n");
    folder.remove("frame-000013.depth.png");
    let (source, packets) = play(folder.name(), OpenOptions::default());
    assert_eq!(packets.iter().map(|p| p.stamp.0).collect::<Vec<_>>(), [0, 33_333_333, 100_000_000]);
    assert_eq!(packets[0].depth.as_ref().unwrap().data()[..2], [0, 1000]);
    assert!(packets[2].depth.is_none());
    assert_eq!(source.info().truth.len(), 2);
}
