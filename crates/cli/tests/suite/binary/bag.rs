//! `cairn run` on a bag, and `--mcap`.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};

/// 1.5 s of the demo world at low resolution, to keep tests short.
const WORLD: &str = "sim:demo?duration=1.5&resolution=320x240&sensor=rgbd";

#[test]
fn a_run_is_written_as_mcap_and_its_images_are_a_source() {
    let folder = folder("mcap");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (file, live) = (path("run.mcap"), path("live.tum"));
    let output = cairn(&["run", WORLD, "--mcap", &file, "--live-trajectory", &live]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let mut bag = cairn_bag::Bag::open(file.as_ref(), &|_, _| usize::MAX).unwrap();
    assert!(bag.notes().is_empty(), "{:?}", bag.notes());
    let poses = bag.topics().iter().find(|t| t.name == "/pose").unwrap().clone();
    let lines = std::fs::read_to_string(&live).unwrap();
    let lines: Vec<&str> = lines.lines().filter(|l| !l.starts_with('#')).collect();
    assert_eq!((poses.entries.len(), lines.len()), (31, 31));
    for (entry, line) in poses.entries.iter().zip(lines) {
        let bytes = bag.read(entry).unwrap();
        let mut wire = cairn_bag::Wire::new(poses.format, &bytes).unwrap();
        wire.time().unwrap();
        assert_eq!(wire.string().unwrap(), "map");
        let written: [f64; 7] = wire.f64s().unwrap();
        let expected: Vec<f64> = line.split(' ').skip(1).map(|f| f.parse().unwrap()).collect();
        assert!(written.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6), "{written:?} {line}");
    }
    let count = |name: &str| bag.topics().iter().find(|t| t.name == name).map_or(0, |t| t.count);
    assert_eq!([count("/tf"), count("/image"), count("/features")], [31, 8, 8]);
    assert_eq!([count("/calibration"), count("/tf_static"), count("/path"), count("/points")], [1, 1, 2, 2]);
    assert!(count("/events") >= 1);
    // At first the key frames, at the end all frames.
    let paths = bag.topics().iter().find(|t| t.name == "/path").unwrap().clone();
    let poses_of = |bytes: &[u8]| {
        let mut wire = cairn_bag::Wire::new(paths.format, bytes).unwrap();
        wire.time().unwrap();
        assert_eq!(wire.string().unwrap(), "map");
        wire.u32().unwrap()
    };
    assert_eq!([0, 1].map(|i| poses_of(&bag.read(&paths.entries[i]).unwrap())), [1, 31]);
    fails(&["run", WORLD, "--mcap", &file], &["run.mcap", "exists already"]);
    let again = json(&cairn(&["run", &file, "--json"]));
    assert_eq!((&again["sensor"], again["frames"].as_u64()), (&"mono".into(), Some(8)), "{again}");
    assert!(again["tracked"].as_u64() > Some(6), "its calibration is that of its images: {again}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn names_of_topics_are_checked_before_the_run() {
    let output = cairn(&["run", WORLD, "--topic", "top=/a"]);
    assert_eq!(output.status.code(), Some(2), "{}", stdout(&output));
    assert!(stderr(&output).contains("known are left, right, depth, imu"), "{}", stderr(&output));
    fails(&["run", "Cargo.toml", "--topic", "left=/a"], &["is no bag, so it has no topics"]);
}

#[test]
fn a_bag_of_which_every_image_is_skipped_says_why_in_its_last_line() {
    use cairn_bag::foxglove::{RAW_IMAGE, raw_image};
    let folder = folder("bag-unread");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let image = cairn_sensor::GrayImage::from_vec(32, 24, vec![7; 32 * 24]).unwrap();
    let mut bag = cairn_bag::McapWriter::new(std::fs::File::create(path("a.mcap")).unwrap()).unwrap();
    let channel = bag.channel("/image", &RAW_IMAGE);
    for k in 0..8 {
        let ns = 1_000_000_000 + k * 50_000_000;
        let message = raw_image(ns, "cam", &image);
        let at = message.windows(5).position(|w| w == b"mono8").unwrap();
        let other = [&message[..at], b"mooo8", &message[at + 5..]].concat();
        bag.message(channel, ns, &other).unwrap();
    }
    bag.finish().unwrap();
    let rig = cairn_sensor::Rig::mono(cairn_sensor::Camera::pinhole(32, 24, 30.0, 30.0, 15.5, 11.5));
    std::fs::write(path("rig.toml"), cairn_sources::write_rig(&rig).unwrap()).unwrap();
    let output = cairn(&["run", &path("a.mcap"), "--rig", &path("rig.toml")]);
    assert_eq!(output.status.code(), Some(1), "{}", stdout(&output));
    let told = stderr(&output);
    let last = told.lines().last().unwrap();
    assert!(
        last.contains("8 of 8 were skipped") && last.contains("encoding \"mooo8\" are not read"),
        "{told}"
    );
    std::fs::remove_dir_all(&folder).unwrap();
}
