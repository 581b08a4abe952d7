//! Bags of every format: their content, truncated at any byte, and with invalid lengths.

use crate::common;

use cairn_bag::{Bag, BagError, ImageMessage, ImuMessage, McapWriter, WireFormat, foxglove, is_bag};
use cairn_geometry::{Se3, Vec3};
use common::{Message, Temporary, image, imu, mcap, mcap_record, mcap_text, record, rosbag1};
use std::path::{Path, PathBuf};

fn all(_: &str, _: &str) -> usize {
    usize::MAX
}

/// Four images and eight IMU samples.
fn messages(ros1: bool) -> Vec<Message> {
    let mut out = Vec::new();
    for i in 0..4u8 {
        let ns = 5_000_000_000 + i64::from(i) * 100_000_000;
        let pixels: Vec<u8> = (0..12 * 8).map(|p| p + i).collect();
        out.push(image(ros1, "/cam/image_raw", ns, "cam", [12, 8], "mono8", &pixels));
        for j in 0..2 {
            out.push(imu(ros1, "/imu", ns + j * 50_000_000, "imu", [0.1, 0.2, j as f64], [0.0, 9.8, 0.0]));
        }
    }
    out
}

fn check_whole(bag: &mut Bag, what: &str) {
    assert!(bag.notes().is_empty(), "{what}: {:?}", bag.notes());
    let topics = bag.topics().to_vec();
    let of =
        |kind: &str| topics.iter().find(|t| t.kind == kind).unwrap_or_else(|| panic!("{what}: no {kind}"));
    let (images, samples) = (of("sensor_msgs/Image"), of("sensor_msgs/Imu"));
    assert_eq!((images.count, samples.count), (4, 8), "{what}");
    for (i, entry) in images.entries.iter().enumerate() {
        assert_eq!(entry.stamp_ns, 5_000_000_000 + i as i64 * 100_000_000, "{what}");
        let bytes = bag.read(entry).unwrap();
        let image = ImageMessage::decode(images.format, &bytes).unwrap();
        assert_eq!((image.width, image.height, image.header.frame_id.as_str()), (12, 8, "cam"), "{what}");
        assert_eq!(image.gray().unwrap().at(3, 2), 27 + i as u8, "{what}");
    }
    let bytes = bag.read(&samples.entries[1]).unwrap();
    let sample = ImuMessage::decode(samples.format, &bytes).unwrap();
    assert_eq!((sample.gyro, sample.accel), (Vec3::new(0.1, 0.2, 1.0), Vec3::new(0.0, 9.8, 0.0)), "{what}");
}

/// Every container format with every compression that the tests can write.
fn variants() -> Vec<(String, Vec<u8>)> {
    let mut out = Vec::new();
    for compression in ["none", "lz4"] {
        out.push((format!("{compression}.bag"), rosbag1(&messages(true), compression, 5)));
    }
    for (encoding, ros1) in [("cdr", false), ("ros1", true)] {
        for (compression, per_chunk) in [("", 0), ("", 5), ("lz4", 5)] {
            let name = format!("{encoding}-{compression}{per_chunk}.mcap");
            out.push((name, mcap(&messages(ros1), encoding, compression, per_chunk)));
        }
    }
    out
}

#[test]
fn every_kind_gives_the_same_messages() {
    for (name, bytes) in variants() {
        let file = Temporary::new(&format!("whole-{name}"), &bytes);
        assert!(is_bag(&file.0));
        check_whole(&mut Bag::open(&file.0, &all).unwrap(), &name);
    }
}

/// Truncated after every byte: everything before the cut is read, never less in a longer file, and the cut is reported.
#[test]
fn cut_files_are_read_up_to_the_cut() {
    for (name, bytes) in variants() {
        let mut most = 0;
        for length in 13..bytes.len() - 40 {
            let file = Temporary::new(&format!("cut-{name}"), &bytes[..length]);
            let mut bag = Bag::open(&file.0, &all).unwrap_or_else(|e| panic!("{name} cut at {length}: {e}"));
            let topics = bag.topics().to_vec();
            let mut count = 0;
            for topic in &topics {
                count += topic.entries.len();
                for entry in &topic.entries {
                    assert!(!bag.read(entry).unwrap().is_empty());
                }
            }
            // LZ4 is decoded in whole blocks only: a longer piece may give no more messages, but never wrong bytes.
            assert!(count >= most, "{name} cut at {length}: {count} messages, {most} before");
            most = count;
            if count < 12 {
                // Without the index of rosbag1, a cut between two records cannot be detected.
                let told = bag.notes().iter().any(|n| n.contains("read up to there"));
                assert!(told || name.ends_with(".bag"), "{name} cut at {length}: {:?}", bag.notes());
            }
        }
        assert!(most >= 7, "{name}: {most} messages before the cut");
    }
}

#[test]
fn damaged_bytes_never_panic() {
    for (name, bytes) in variants() {
        for at in 0..bytes.len() {
            for value in [0xff, bytes[at] ^ 0x10] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                let file = Temporary::new(&format!("flip-{name}"), &damaged);
                if let Ok(mut bag) = Bag::open(&file.0, &all) {
                    for topic in bag.topics().to_vec() {
                        for entry in &topic.entries {
                            let Ok(bytes) = bag.read(entry) else { continue };
                            let _ = ImageMessage::decode(topic.format, &bytes).map(|i| i.gray().map(drop));
                            let _ = ImuMessage::decode(topic.format, &bytes);
                        }
                    }
                }
            }
        }
    }
}

/// A length of 4 GB (and of 2^63) is checked against the size of the file before anything is allocated.
#[test]
fn absurd_lengths_are_refused_by_the_size_of_the_file() {
    let mut start = rosbag1(&messages(true), "none", 5);
    let whole = start.len();
    start.extend(u32::MAX.to_le_bytes());
    let file = Temporary::new("header-4gb.bag", &start);
    let bag = Bag::open(&file.0, &all).unwrap();
    assert!(bag.notes()[0].contains("4294967295 bytes"), "{:?}", bag.notes());
    assert!(bag.notes()[0].contains("12 messages"), "{:?}", bag.notes());

    start.truncate(whole);
    let size = u32::MAX.to_le_bytes();
    let mut chunk = record(&[("op", &[5]), ("compression", b"lz4"), ("size", &size)], b"");
    let end = chunk.len();
    chunk[end - 4..].copy_from_slice(&u32::MAX.to_le_bytes());
    start.extend(chunk);
    let file = Temporary::new("chunk-4gb.bag", &start);
    let bag = Bag::open(&file.0, &all).unwrap();
    assert!(bag.notes().iter().any(|n| n.contains("a record of 4294967295 bytes begins, 0 follow")));

    let mut start = mcap(&messages(false), "cdr", "", 0);
    start.truncate(start.len() - 13 - 29 - 8);
    start.push(5);
    start.extend((1u64 << 63).to_le_bytes());
    let file = Temporary::new("record-2-63.mcap", &start);
    let bag = Bag::open(&file.0, &all).unwrap();
    assert!(bag.notes()[0].contains("9223372036854775808 bytes begins"), "{:?}", bag.notes());
}

#[test]
fn a_small_chunk_cannot_unpack_to_more_than_it_states() {
    let packed = common::lz4(&vec![0; 40 << 20]);
    let mut file = rosbag1(&messages(true), "none", 5);
    let size = 1000u32.to_le_bytes();
    file.extend(record(&[("op", &[5]), ("compression", b"lz4"), ("size", &size)], &packed));
    let file = Temporary::new("bomb.bag", &file);
    let bag = Bag::open(&file.0, &all).unwrap();
    assert!(bag.notes()[0].contains("more than the 1000 bytes"), "{:?}", bag.notes());
}

#[test]
fn what_is_not_read_is_said_with_a_cure() {
    let refused = |name: &str, bytes: &[u8]| {
        let file = Temporary::new(name, bytes);
        let error = Bag::open(&file.0, &all).err().expect(name);
        assert!(!error.cure().is_empty());
        error.to_string()
    };
    assert!(refused("old.bag", b"#ROSBAG V1.2\n...").ends_with("is a bag of an old version"));
    assert!(refused("empty.bag", b"").ends_with("is empty"));
    assert!(refused("text.bag", b"hello, this is text").contains("is neither rosbag1"));
    assert!(refused("short.db3", b"SQLite format 3\0").contains("damaged at byte"));
    let mut secret = b"#ROSBAG V2.0\n".to_vec();
    secret.extend(record(&[("op", &[3]), ("encryptor", b"rosbag/AesCbcEncryptor")], b""));
    assert!(refused("secret.bag", &secret).ends_with("is encrypted"));

    let mut unknown = rosbag1(&messages(true), "none", 5);
    let size = 10u32.to_le_bytes();
    unknown.extend(record(&[("op", &[5]), ("compression", b"xz"), ("size", &size)], b"abc"));
    let file = Temporary::new("xz.bag", &unknown);
    let bag = Bag::open(&file.0, &all).unwrap();
    assert!(bag.notes()[0].contains("compression \"xz\" is unknown"), "{:?}", bag.notes());

    assert!(matches!(Bag::open(Path::new("/no/such.bag"), &all), Err(BagError::Io { .. })));
}

/// The difference of any two times does not overflow.
#[test]
fn absurd_times_are_held_within_bounds() {
    let mut all_messages = messages(false);
    for m in &mut all_messages {
        m.log_ns = -1; // as an unsigned number beyond all bounds
        m.data[4..8].copy_from_slice(&i32::MIN.to_le_bytes());
    }
    let file = Temporary::new("times.mcap", &mcap(&all_messages, "cdr", "", 0));
    let bag = Bag::open(&file.0, &all).unwrap();
    let entry = bag.topics()[0].entries[0];
    assert_eq!(entry.stamp_ns, i64::from(i32::MIN) * 1_000_000_000);
    assert_eq!(entry.log_ns, 4_400_000_000_000_000_000);
    assert!(entry.log_ns.checked_sub(entry.stamp_ns).is_some());
}

#[test]
fn a_wrong_checksum_is_told() {
    let mut bytes = mcap(&messages(false), "cdr", "lz4", 100);
    // The checksum of the only chunk is after: magic, header record, head of the chunk, two times, size.
    let header = mcap_record(1, &[mcap_text(""), mcap_text("test")].concat()).len();
    bytes[8 + header + 9 + 24] ^= 1;
    let file = Temporary::new("crc.mcap", &bytes);
    let bag = Bag::open(&file.0, &all).unwrap();
    assert!(bag.notes()[0].contains("checksum"), "{:?}", bag.notes());
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// Files written by rosbags, by SQLite and by mcap (tools/make_bag_fixtures.py).
#[test]
fn files_of_other_writers_are_read() {
    for name in ["small.bag", "small.db3", "small.mcap"] {
        let mut bag = Bag::open(&fixture(name), &all).unwrap();
        assert!(bag.notes().is_empty(), "{name}: {:?}", bag.notes());
        let topics = bag.topics().to_vec();
        let [images, samples] =
            ["/cam/image_raw", "/imu"].map(|n| topics.iter().find(|t| t.name == n).unwrap().clone());
        assert_eq!((images.entries.len(), samples.entries.len()), (6, 30), "{name}");
        for (i, entry) in images.entries.iter().enumerate() {
            let ns = 1_000_000_000_000 + i as i64 * 100_000_000;
            assert_eq!((entry.stamp_ns, entry.log_ns), (ns, ns + 5), "{name}");
            let bytes = bag.read(entry).unwrap();
            let gray = ImageMessage::decode(images.format, &bytes).unwrap().gray().unwrap();
            for y in 0..30 {
                for x in 0..40 {
                    assert_eq!(usize::from(gray.at(x, y)), (x + 2 * y + 10 * i) % 256, "{name}");
                }
            }
        }
        for (i, entry) in samples.entries.iter().enumerate() {
            let bytes = bag.read(entry).unwrap();
            let m = ImuMessage::decode(samples.format, &bytes).unwrap();
            assert_eq!(m.gyro, Vec3::new(0.1 * i as f64, -0.2, 0.3), "{name}");
            assert_eq!(m.accel, Vec3::new(0.0, 9.81, 0.01 * i as f64), "{name}");
        }
    }
}

#[test]
fn files_of_other_writers_cut_or_damaged() {
    for name in ["small.bag", "small.db3", "small.mcap"] {
        let bytes = std::fs::read(fixture(name)).unwrap();
        let mut most = 0;
        for length in (0..bytes.len()).step_by(61) {
            let file = Temporary::new(&format!("cut-{name}"), &bytes[..length]);
            let Ok(mut bag) = Bag::open(&file.0, &all) else { continue };
            let topics = bag.topics().to_vec();
            let count: usize = topics.iter().map(|t| t.entries.len()).sum();
            if length < bytes.len() / 2 && count > 0 {
                assert!(!bag.notes().is_empty(), "{name} cut at {length}");
            }
            let read = topics.iter().flat_map(|t| &t.entries).filter(|e| bag.read(e).is_ok()).count();
            most = most.max(read);
        }
        assert!(most >= 20, "{name}: {most} messages of cut files");
        for at in (0..bytes.len()).step_by(7) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x55;
            let file = Temporary::new(&format!("flip-{name}"), &damaged);
            if let Ok(mut bag) = Bag::open(&file.0, &all) {
                for topic in bag.topics().to_vec() {
                    topic.entries.iter().for_each(|e| drop(bag.read(e)));
                }
            }
        }
    }
}

#[test]
fn folders_are_read_in_the_order_of_their_files() {
    let folder = std::env::temp_dir().join(format!("cairn-bag-folder-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let part = |range: std::ops::Range<usize>| mcap(&messages(false)[range], "cdr", "lz4", 5);
    std::fs::write(folder.join("a_0.mcap"), part(0..5)).unwrap();
    std::fs::write(folder.join("a_1.mcap"), part(5..12)).unwrap();
    assert!(is_bag(&folder));
    let bag = Bag::open(&folder, &all).unwrap();
    assert!(bag.notes()[0].contains("metadata.yaml is missing"), "{:?}", bag.notes());
    let metadata =
        "rosbag2_bagfile_information:\n  relative_file_paths:\n    - a_0.mcap\n    - a_1.mcap\n  duration:\n";
    std::fs::write(folder.join("metadata.yaml"), metadata).unwrap();
    check_whole(&mut Bag::open(&folder, &all).unwrap(), "folder");
    let zipped = format!("{metadata}  compression_format: zstd\n  compression_mode: ZIP\n");
    std::fs::write(folder.join("metadata.yaml"), zipped).unwrap();
    let error = Bag::open(&folder, &all).err().unwrap();
    assert!(error.to_string().contains("compression of \"zip\" by \"zstd\""), "{error}");
    // Of a recording compressed by files the metadata still names them so when they are decompressed.
    let files =
        metadata.replace(".mcap", ".mcap.zstd") + "  compression_format: zstd\n  compression_mode: FILE\n";
    std::fs::write(folder.join("metadata.yaml"), &files).unwrap();
    check_whole(&mut Bag::open(&folder, &all).unwrap(), "decompressed");
    std::fs::rename(folder.join("a_1.mcap"), folder.join("a_1.mcap.zstd")).unwrap();
    let error = Bag::open(&folder, &all).err().unwrap();
    assert!(error.to_string().contains("a_1.mcap.zstd is compressed as a whole"), "{error}");
    assert!(error.cure().contains("zstd -d"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_database_of_rtabmap_says_what_it_is() {
    let error = Bag::open(&fixture("rtabmap.db"), &all).err().unwrap();
    assert!(error.to_string().contains("RTAB-Map") && error.cure().contains("rtabmap-export"), "{error}");
}

#[test]
fn a_log_beside_a_database_is_told() {
    let folder = std::env::temp_dir().join(format!("cairn-bag-wal-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::copy(fixture("small.db3"), folder.join("small.db3")).unwrap();
    std::fs::write(folder.join("small.db3-wal"), [7; 40]).unwrap();
    let text = "rosbag2_bagfile_information: {relative_file_paths: [small.db3]}\n";
    std::fs::write(folder.join("metadata.yaml"), text).unwrap();
    let bag = Bag::open(&folder, &all).unwrap();
    assert!(bag.notes().iter().any(|note| note.contains("wal_checkpoint")), "{:?}", bag.notes());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn written_files_are_read_back() {
    let mut file = McapWriter::new(Vec::new()).unwrap();
    let pose = file.channel("/pose", &foxglove::POSE_IN_FRAME);
    let cloud = file.channel("/points", &foxglove::POINT_CLOUD);
    let log = file.channel("/said", &foxglove::LOG);
    let big: Vec<Vec3> = (0..100_000).map(|i| Vec3::new(i as f64, 0.5, -1.0)).collect();
    for i in 0..20 {
        file.message(pose, i * 10, &foxglove::pose_in_frame(i * 10, "map", &Se3::identity())).unwrap();
        file.message(cloud, i * 10, &foxglove::point_cloud(i * 10, "map", big.iter().copied())).unwrap();
        file.message(log, i * 10, &foxglove::log(i * 10, foxglove::Level::Info, "guide", "Turn left."))
            .unwrap();
    }
    let file = Temporary::new("written.mcap", &file.finish().unwrap());
    let mut bag = Bag::open(&file.0, &all).unwrap();
    assert!(bag.notes().is_empty(), "{:?}", bag.notes());
    let topics = bag.topics().to_vec();
    assert_eq!(topics.iter().map(|t| t.count).collect::<Vec<_>>(), [20, 20, 20]);
    assert!(topics.iter().all(|t| t.format == WireFormat::Cdr));
    let bytes = bag.read(&topics[1].entries[7]).unwrap();
    assert!(bytes.len() > 1_200_000);
    let x = f32::from_le_bytes(bytes[bytes.len() - 12..bytes.len() - 8].try_into().unwrap());
    assert_eq!(x, 99_999.0);
}
