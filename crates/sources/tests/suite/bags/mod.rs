//! Bags as sources: topics found and named, rigs from what the bag has, pairs by approximate time, damage.

mod realsense;
#[path = "../../../../bag/tests/suite/common/mod.rs"]
mod written;

use cairn_geometry::Vec3;
use cairn_sensor::{FramePacket, Rig, Source, SourceError};
use cairn_sources::{NamedTopic, OpenOptions, open};
use written::{
    Info, Message, Temporary, camera_info, compressed, image, imu, mcap, rosbag1, tf_static, truth,
};

const SIZE: [u32; 2] = [32, 24];
const K: [f64; 9] = [30.0, 0.0, 15.5, 0.0, 30.0, 11.5, 0.0, 0.0, 1.0];
const EYE: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
const T0: i64 = 100_000_000_000;
const STEP: i64 = 50_000_000;

fn info<'a>(frame: &'a str, baseline_m: f64) -> Info<'a> {
    let p = [30.0, 0.0, 15.5, -30.0 * baseline_m, 0.0, 30.0, 11.5, 0.0, 0.0, 0.0, 1.0, 0.0];
    Info { frame, size: SIZE, model: "plumb_bob", d: &[0.0; 5], k: K, r: EYE, p }
}

fn gray(ros1: bool, topic: &str, ns: i64, frame: &str, level: u8) -> Message {
    image(ros1, topic, ns, frame, SIZE, "mono8", &[level; 32 * 24])
}

/// Ten pairs whose right image is 2 ms late, with calibration, and an IMU at 200 Hz with a transform to the left camera.
fn stereo(ros1: bool) -> Vec<Message> {
    let mut out = vec![
        camera_info(ros1, "/stereo/left/camera_info", T0, &info("left", 0.0)),
        camera_info(ros1, "/stereo/right/camera_info", T0, &info("right", 0.12)),
        tf_static(ros1, T0, &[("imu", "left", [0.01, 0.02, 0.03, 0.0, 0.0, 0.0, 1.0])]),
    ];
    for i in 0..10 {
        let ns = T0 + i * STEP;
        out.push(gray(ros1, "/stereo/left/image_raw", ns, "left", i as u8));
        out.push(gray(ros1, "/stereo/right/image_raw", ns + 2_000_000, "right", 100 + i as u8));
    }
    for i in 0..120 {
        let ns = T0 - 20_000_000 + i * 5_000_000;
        out.push(imu(ros1, "/imu/data", ns, "imu", [0.1, 0.0, i as f64], [0.0, 0.0, 9.81]));
    }
    out.sort_by_key(|m| m.log_ns);
    out
}

type Played = (Box<dyn Source>, Vec<FramePacket>);

fn play(file: &Temporary, options: OpenOptions) -> Result<Played, SourceError> {
    play_path(file.name(), options)
}

fn play_path(path: &str, options: OpenOptions) -> Result<Played, SourceError> {
    let mut source = open(path, options)?;
    let mut packets = Vec::new();
    while let Some(packet) = source.next_packet()? {
        packets.push(packet);
    }
    Ok((source, packets))
}

fn named(names: &[&str]) -> OpenOptions {
    let topics: Vec<NamedTopic> = names.iter().map(|n| n.parse().unwrap()).collect();
    OpenOptions { topics, ..OpenOptions::default() }
}

fn refused(messages: &[Message], options: OpenOptions, name: &str) -> String {
    let file = Temporary::new(name, &mcap(messages, "cdr", "lz4", 50));
    play(&file, options).err().expect(name).to_string()
}

#[test]
fn a_stereo_pair_with_imu_is_found_by_its_types() {
    for (name, bytes) in [
        ("pair.bag", rosbag1(&stereo(true), "lz4", 20)),
        ("pair.mcap", mcap(&stereo(false), "cdr", "", 0)),
        ("pair-ros1.mcap", mcap(&stereo(true), "ros1", "lz4", 20)),
    ] {
        let file = Temporary::new(name, &bytes);
        let (source, packets) = play(&file, OpenOptions::default()).unwrap();
        assert_eq!(packets.len(), 10, "{name}: {:?}", source.skipped());
        let rig = source.rig();
        let [left, right] = [&rig.cameras[0], &rig.cameras[1]];
        assert_eq!(
            left.body_from_camera.translation,
            Vec3::new(0.01, 0.02, 0.03),
            "{name}: the body is the IMU"
        );
        let baseline = right.body_from_camera.translation - left.body_from_camera.translation;
        assert!((baseline - Vec3::new(0.12, 0.0, 0.0)).norm() < 1e-12, "{name}");
        assert_eq!(rig.imu.as_ref().map(|i| i.rate_hz), Some(200.0), "{name}");
        assert_eq!(source.info().rate_hz, 20.0, "{name}");
        let assumed = source.info().assumed.clone().unwrap();
        assert!(assumed.contains("noise of the IMU"), "{name}: {assumed}");
        assert!(
            source.skipped().iter().any(|s| s.contains("2.0 ms apart")),
            "{name}: {:?}",
            source.skipped()
        );
        for (i, packet) in packets.iter().enumerate() {
            assert_eq!(packet.stamp.0, T0 + i as i64 * STEP);
            assert_eq!([packet.images[0].at(3, 3), packet.images[1].at(3, 3)], [i as u8, 100 + i as u8]);
            let last = packet.imu.last().unwrap();
            assert!(last.stamp >= packet.stamp && !last.is_synthesised(), "{name}");
        }
        let z: Vec<f64> = packets.iter().flat_map(|p| &p.imu).map(|s| s.gyro.z).collect();
        assert!(z.windows(2).all(|w| w[1] == w[0] + 1.0), "{name}: a sample is missing or twice");
    }
}

/// Poses by another system, in each type that is read; the order of writing does not matter, and what is none is counted.
#[test]
fn poses_of_a_named_topic_are_the_truth() {
    let at = |i: i64| [0.1 * i as f64, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8];
    for kind in [
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "geometry_msgs/msg/TransformStamped",
        "nav_msgs/msg/Odometry",
    ] {
        for ros1 in [true, false] {
            let mut messages = stereo(ros1);
            for i in [3, 0, 1, 2] {
                messages.push(truth(ros1, "/vicon/body", kind, T0 + i * STEP, at(i)));
            }
            messages.push(truth(ros1, "/vicon/body", kind, T0 + 4 * STEP, [0.0; 7]));
            let bytes = if ros1 { rosbag1(&messages, "", 20) } else { mcap(&messages, "cdr", "", 20) };
            let file = Temporary::new(&format!("truth-{}-{ros1}", kind.len()), &bytes);
            let (source, packets) = play(&file, named(&["truth=/vicon/body"])).unwrap();
            assert_eq!(packets.len(), 10, "{kind}: the sensors are found as before");
            let found = &source.info().truth;
            assert_eq!(found.len(), 4, "{kind}");
            for (i, (stamp, pose)) in (0..).zip(found) {
                assert_eq!(stamp.0, T0 + i * STEP, "{kind}");
                assert_eq!(pose.translation, Vec3::new(0.1 * i as f64, 2.0, 3.0), "{kind}");
                assert!((pose.rotation.log().z - 2.0 * 0.6f64.atan2(0.8)).abs() < 1e-9, "{kind}");
            }
            assert!(
                source.skipped().iter().any(|s| s.contains("quaternion")),
                "{kind}: {:?}",
                source.skipped()
            );
            let (without, _) = play(&file, OpenOptions::default()).unwrap();
            assert!(without.info().truth.is_empty(), "{kind}: nobody asked");
        }
    }
    let nowhere = refused(&stereo(false), named(&["truth=/nowhere"]), "truth-nowhere.mcap");
    assert!(nowhere.contains("no messages on \"/nowhere\""), "{nowhere}");
    let images = refused(&stereo(false), named(&["truth=/stereo/left/image_raw"]), "truth-images.mcap");
    assert!(images.contains("is no pose that is read"), "{images}");
}

/// A bag whose topics were written one after the other, and whose chunks are not in order, gives the same packets.
#[test]
fn the_order_of_writing_does_not_matter() {
    let mut by_topic = stereo(false);
    by_topic.sort_by_key(|m| (m.topic.clone(), m.log_ns));
    let (a, b) = (mcap(&stereo(false), "cdr", "lz4", 20), mcap(&by_topic, "cdr", "lz4", 7));
    let [a, b] = [("time.mcap", a), ("topic.mcap", b)].map(|(name, bytes)| {
        let file = Temporary::new(name, &bytes);
        let (_, packets) = play(&file, OpenOptions::default()).unwrap();
        packets.into_iter().map(|p| (p.stamp, p.images, p.imu)).collect::<Vec<_>>()
    });
    assert_eq!(a, b);
}

#[test]
fn topics_are_named_where_several_could_be_meant() {
    let mut messages = vec![];
    for i in 0..3 {
        for camera in ["front", "back"] {
            let (topic, info_topic) = (format!("/{camera}/image_raw"), format!("/{camera}/camera_info"));
            messages.push(gray(false, &topic, T0 + i * STEP, camera, 7));
            messages.push(camera_info(false, &info_topic, T0 + i * STEP, &info(camera, 0.0)));
        }
    }
    let why = refused(&messages, OpenOptions::default(), "two.mcap");
    assert!(
        why.contains("several topics that could be meant") && why.contains("--topic left=TOPIC"),
        "{why}"
    );
    assert!(why.contains("/front/image_raw") && why.contains("/back/image_raw"), "{why}");
    let file = Temporary::new("named.mcap", &mcap(&messages, "cdr", "lz4", 50));
    let (source, packets) = play(&file, named(&["left=/back/image_raw"])).unwrap();
    assert_eq!((source.rig().cameras.len(), packets.len()), (1, 3));
    let why = refused(&messages, named(&["left=/none"]), "wrong-name.mcap");
    assert!(why.contains("no messages") && why.contains("\"/none\""), "{why}");
    let why = refused(&messages, named(&["right=/back/image_raw"]), "right-only.mcap");
    assert!(why.contains("without a left camera"), "{why}");
    let why = refused(&messages, named(&["left=/front/image_raw", "right=/back/image_raw"]), "unplaced.mcap");
    assert!(why.contains("where they are to each other") && why.contains("--rig"), "{why}");
}

#[test]
fn missing_calibration_names_the_cure_and_a_rig_overrides() {
    let messages: Vec<Message> = (0..3).map(|i| gray(false, "/cam/image", T0 + i * STEP, "cam", 7)).collect();
    let why = refused(&messages, OpenOptions::default(), "bare.mcap");
    assert!(
        why.contains("/cam/image: the bag has no camera_info for it; give its calibration with --rig FILE"),
        "{why}"
    );
    let camera = cairn_sensor::Camera::pinhole(32, 24, 40.0, 40.0, 15.5, 11.5);
    let rig = || OpenOptions { rig: Some(Rig::mono(camera)), ..OpenOptions::default() };
    let file = Temporary::new("rig.mcap", &mcap(&messages, "cdr", "lz4", 50));
    let (source, packets) = play(&file, rig()).unwrap();
    assert_eq!((source.rig().cameras[0].camera.fx, packets.len()), (40.0, 3));
    let file = Temporary::new("override.bag", &rosbag1(&stereo(true), "none", 20));
    let (source, packets) = play(&file, rig()).unwrap();
    assert_eq!((source.rig().cameras[0].camera.fx, packets.len()), (40.0, 10));
    assert!(packets.iter().all(|p| p.images.len() == 1 && p.imu.is_empty()));
    let small = Rig::mono(cairn_sensor::Camera::pinhole(16, 24, 40.0, 40.0, 7.5, 11.5));
    let options = OpenOptions { rig: Some(small), ..OpenOptions::default() };
    assert!(play(&file, options).err().unwrap().to_string().contains("32x24 pixels, the rig says 16x24"));
    let mut uncalibrated = info("cam", 0.0);
    uncalibrated.k = [0.0; 9];
    let mut messages = messages;
    messages.insert(0, camera_info(false, "/cam/camera_info", T0, &uncalibrated));
    assert!(refused(&messages, OpenOptions::default(), "zero-k.mcap").contains("was not calibrated"));
}

#[test]
fn rgbd_by_approximate_time_in_millimetres_and_metres() {
    let metres: Vec<u8> = (0..32 * 24).flat_map(|_| 1.5f32.to_le_bytes()).collect();
    let millimetres: Vec<u8> = (0..32 * 24).flat_map(|_| 1500u16.to_le_bytes()).collect();
    for (encoding, pixels) in [("16UC1", &millimetres), ("32FC1", &metres)] {
        let mut messages = vec![
            camera_info(false, "/camera/rgb/camera_info", T0, &info("optical", 0.0)),
            camera_info(false, "/camera/depth/camera_info", T0, &info("optical", 0.0)),
        ];
        for i in 0..5 {
            let ns = T0 + i * STEP;
            messages.push(image(
                false,
                "/camera/rgb/image_color",
                ns,
                "optical",
                SIZE,
                "bgr8",
                &[9; 3 * 32 * 24],
            ));
            if i != 3 {
                messages.push(image(
                    false,
                    "/camera/depth/image",
                    ns + 9_000_000,
                    "optical",
                    SIZE,
                    encoding,
                    pixels,
                ));
            }
        }
        let file = Temporary::new(&format!("rgbd-{encoding}.mcap"), &mcap(&messages, "cdr", "lz4", 3));
        let (source, packets) = play(&file, OpenOptions::default()).unwrap();
        let depth = source.rig().depth.clone().unwrap();
        assert!(depth.registered && depth.metres_per_unit == 0.001);
        let seen: Vec<Option<u16>> = packets.iter().map(|p| p.depth.as_ref().map(|d| d.at(5, 5))).collect();
        assert_eq!(seen, [Some(1500), Some(1500), Some(1500), None, Some(1500)], "{encoding}");
        assert_eq!(packets[0].images[0].at(0, 0), 9);
    }
}

#[test]
fn compressed_images_are_read_and_damaged_ones_skipped() {
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, SIZE[0], SIZE[1]);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&[77; 32 * 24]).unwrap();
    let mut messages = vec![camera_info(false, "/cam/camera_info", T0, &info("cam", 0.0))];
    for i in 0..4 {
        let cut = if i == 2 { png.len() / 2 } else { png.len() };
        messages.push(compressed(
            false,
            "/cam/image_raw/compressed",
            T0 + i * STEP,
            "cam",
            "png",
            &png[..cut],
        ));
    }
    let file = Temporary::new("png.mcap", &mcap(&messages, "cdr", "lz4", 3));
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    assert_eq!(packets.len(), 3);
    assert!(packets.iter().all(|p| p.images[0].at(1, 1) == 77));
    assert!(
        source.skipped().iter().any(|s| s.contains("compressed as \"png\": PNG")),
        "{:?}",
        source.skipped()
    );
    let mut video = vec![camera_info(false, "/cam/camera_info", T0, &info("cam", 0.0))];
    video.push(compressed(false, "/cam/image_raw/compressed", T0, "cam", "h264", &[0, 0, 0, 1, 0x67]));
    let text = refused(&video, OpenOptions::default(), "h264.mcap");
    assert!(text.contains("compressed as \"h264\": neither JPEG"), "{text}");
}

#[test]
fn cameras_of_ten_bits_are_not_black_and_compressed_metres_are_depth() {
    let mut messages = vec![camera_info(false, "/cam/camera_info", T0, &info("cam", 0.0))];
    messages.push(camera_info(false, "/depth/camera_info", T0, &info("cam", 0.0)));
    // Half of the white of ten bits, and 2.5 m in the numbers of the transport.
    let pixels: Vec<u8> =
        (0..32 * 24).flat_map(|i| [512u16, 1023][usize::from(i == 9)].to_le_bytes()).collect();
    let mut file = [1u32.to_le_bytes(), 10_100.0f32.to_le_bytes(), (-1_009.0f32).to_le_bytes()].concat();
    let mut encoder = png::Encoder::new(&mut file, SIZE[0], SIZE[1]);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let depth: Vec<u8> = (0..32 * 24).flat_map(|_| 3031u16.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&depth).unwrap();
    // The same as RVL, in groups of three bits: none is empty, 768 are full, the first is 3031 more than zero, the others none.
    let mut groups = vec![0, 8, 8, 12, 1, 14, 13, 14, 11, 1];
    groups.resize(groups.len() + 767, 0);
    let mut rvl = [&file[..12], &SIZE[0].to_le_bytes(), &SIZE[1].to_le_bytes()].concat();
    let word = |groups: &[u32]| (0..8).fold(0, |w, k| w << 4 | groups.get(k).unwrap_or(&0));
    rvl.extend(groups.chunks(8).flat_map(|groups| word(groups).to_le_bytes()));
    for i in 0..4 {
        let ns = T0 + i * STEP;
        messages.push(image(false, "/cam/image_raw", ns, "cam", SIZE, "mono16", &pixels));
        let (of, file) =
            if i < 2 { ("32FC1; compressedDepth png", &file) } else { ("32FC1; compressedDepth rvl", &rvl) };
        messages.push(compressed(false, "/depth/image_rect/compressedDepth", ns, "cam", of, file));
    }
    let bag = Temporary::new("bits.mcap", &mcap(&messages, "cdr", "lz4", 3));
    let (source, packets) = play(&bag, OpenOptions::default()).unwrap();
    assert_eq!(packets.len(), 4);
    assert_eq!((packets[0].images[0].at(0, 0), packets[0].images[0].at(9, 0)), (128, 255));
    assert!(packets.iter().all(|p| p.depth.as_ref().unwrap().at(3, 3) == 2500));
    let told = source.skipped().join("; ");
    assert!(told.contains("/cam/image_raw: of the 16 bits of a pixel 10 are in use"), "{told}");
}

#[test]
fn time_that_goes_backwards_and_numbers_that_are_none_are_dropped_and_told() {
    let mut messages = stereo(false);
    let mut late = gray(false, "/stereo/left/image_raw", T0 + STEP, "left", 1);
    late.log_ns = T0 + 6 * STEP + 1;
    messages.push(late);
    let mut wrong = imu(false, "/imu/data", T0 + 2 * STEP + 1, "imu", [f64::NAN, 0.0, 0.0], [0.0; 3]);
    wrong.log_ns = T0 + 2 * STEP + 1;
    messages.push(wrong);
    messages.sort_by_key(|m| m.log_ns);
    let file = Temporary::new("backwards.mcap", &mcap(&messages, "cdr", "lz4", 20));
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    assert_eq!(packets.len(), 10);
    let told = |what: &str| source.skipped().iter().any(|s| s.contains(what));
    assert!(told("the time goes backwards, image dropped"), "{:?}", source.skipped());
    assert!(told("a number is not finite"), "{:?}", source.skipped());
}

#[test]
fn a_cut_bag_plays_up_to_the_cut_and_says_so() {
    let whole = rosbag1(&stereo(true), "none", 20);
    let file = Temporary::new("cut.bag", &whole[..whole.len() / 2]);
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    assert!((3..8).contains(&packets.len()), "{} packets", packets.len());
    let told = source.skipped().iter().find(|s| s.contains("read up to there")).expect("a sentence");
    assert!(told.contains(&format!("of {}", whole.len() / 2)), "{told}");
}

#[test]
fn an_imu_without_a_place_is_left_out_and_told() {
    let messages: Vec<Message> = stereo(false).into_iter().filter(|m| m.topic != "/tf_static").collect();
    let file = Temporary::new("unplaced-imu.mcap", &mcap(&messages, "cdr", "lz4", 20));
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    assert!(source.rig().imu.is_none() && packets.iter().all(|p| p.imu.is_empty()));
    let told = source.skipped().iter().find(|s| s.contains("the IMU is not used")).expect("a sentence");
    assert!(told.contains("--rig"), "{told}");
}

/// Foxglove's schemas in protobuf, whose stamps are in front of the message.
#[test]
fn foxglove_images_are_a_source() {
    let part = |number: u8, bytes: &[u8]| {
        let n = bytes.len();
        let length = if n < 128 { vec![n as u8] } else { vec![n as u8 | 0x80, (n >> 7) as u8] };
        [&[number << 3 | 2][..], &length, bytes].concat()
    };
    let fixed = |number: u8, v: u32| [&[number << 3 | 5][..], &v.to_le_bytes()].concat();
    let message = |topic: &str, kind: &'static str, ns: i64, data: Vec<u8>| Message {
        topic: topic.into(),
        kind,
        log_ns: ns + 7,
        data,
    };
    let stamp = |ns: i64| {
        let nanos = (ns % 1_000_000_000) as u32;
        let mut out = vec![1 << 3, (ns / 1_000_000_000) as u8, 2 << 3];
        out.extend((0..5).map(|i| (nanos >> (7 * i)) as u8 & 0x7f | if i < 4 { 0x80 } else { 0 }));
        part(1, &out)
    };
    let k: Vec<u8> = K.iter().flat_map(|v| v.to_le_bytes()).collect();
    let calibration = [stamp(T0), fixed(2, 32), fixed(3, 24), part(6, &k), part(9, b"cam")].concat();
    let mut messages = vec![message("/cam/calibration", "foxglove.CameraCalibration", T0, calibration)];
    for i in 0..3 {
        let ns = T0 + i * STEP;
        let image = [
            stamp(ns),
            fixed(2, 32),
            fixed(3, 24),
            part(4, b"mono8"),
            fixed(5, 32),
            part(6, &[9; 32 * 24]),
            part(7, b"cam"),
        ];
        messages.push(message("/cam/image", "foxglove.RawImage", ns, image.concat()));
    }
    let file = Temporary::new("foxglove.mcap", &mcap(&messages, "protobuf", "lz4", 2));
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    let stamps: Vec<i64> = packets.iter().map(|p| p.stamp.0).collect();
    assert_eq!(stamps, [T0, T0 + STEP, T0 + 2 * STEP]);
    assert_eq!((source.rig().cameras[0].camera.fx, packets[1].images[0].at(31, 23)), (30.0, 9));
}

#[test]
fn a_bag_without_images_lists_its_topics() {
    let messages = vec![imu(false, "/imu", T0, "imu", [0.0; 3], [0.0; 3])];
    let why = refused(&messages, OpenOptions::default(), "imu-only.mcap");
    assert!(why.contains("has no images") && why.contains("/imu (sensor_msgs/Imu)"), "{why}");
}

/// The first 30 pairs of EuRoC MH_01 as bags: packets are equal to those of the folder, bit for bit.
#[test]
fn a_bag_gives_the_packets_of_the_folder() {
    let root = std::env::var("CAIRN_DATA")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data").into());
    let folder = std::path::Path::new(&root).join("euroc-mh01");
    if !folder.exists() {
        println!("skipped: {} is missing", folder.display());
        return;
    }
    let csv = |path: &str| std::fs::read_to_string(folder.join("mav0").join(path)).unwrap();
    let rows = |text: &str| -> Vec<Vec<String>> {
        let lines = text.lines().filter(|l| !l.starts_with('#') && !l.is_empty());
        lines.map(|l| l.split(',').map(|f| f.trim().to_owned()).collect()).collect()
    };
    let frames = 30;
    for ros1 in [true, false] {
        let mut messages = Vec::new();
        let mut last = 0;
        for camera in ["cam0", "cam1"] {
            for row in rows(&csv(&format!("{camera}/data.csv"))).iter().take(frames) {
                let jpeg =
                    std::fs::read(folder.join("mav0").join(camera).join("data").join(&row[1])).unwrap();
                let (ns, topic) = (row[0].parse().unwrap(), format!("/{camera}/image_raw/compressed"));
                last = last.max(ns);
                messages.push(compressed(ros1, &topic, ns, camera, "jpeg", &jpeg));
            }
        }
        for row in rows(&csv("imu0/data.csv")) {
            let ns: i64 = row[0].parse().unwrap();
            let v: Vec<f64> = row[1..7].iter().map(|f| f.parse().unwrap()).collect();
            if ns <= last + 20_000_000 {
                messages.push(imu(ros1, "/imu0", ns, "imu0", [v[0], v[1], v[2]], [v[3], v[4], v[5]]));
            }
        }
        messages.sort_by_key(|m| m.log_ns);
        let bytes = if ros1 { rosbag1(&messages, "lz4", 100) } else { mcap(&messages, "cdr", "lz4", 100) };
        let file = Temporary::new(if ros1 { "euroc.bag" } else { "euroc.mcap" }, &bytes);
        let rig = cairn_sources::read_rig(&folder).unwrap();
        let (_, of_bag) = play(&file, OpenOptions { rig: Some(rig), ..Default::default() }).unwrap();
        let options = OpenOptions { frames: Some(frames), ..Default::default() };
        let mut source = open(folder.to_str().unwrap(), options).unwrap();
        assert_eq!(of_bag.len(), frames);
        for packet in of_bag {
            let expected = source.next_packet().unwrap().unwrap();
            assert_eq!((packet.stamp, &packet.imu), (expected.stamp, &expected.imu));
            assert!(packet.images == expected.images, "images at {}", packet.stamp);
        }
    }
}
