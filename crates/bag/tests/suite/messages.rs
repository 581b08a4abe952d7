//! Messages: pixel formats, calibrations, transforms, and invalid bytes.

use crate::common;

use cairn_bag::foxglove::camera_calibration;
use cairn_bag::{
    CameraInfo, CompressedImage, ImageMessage, ImuMessage, Wire, WireFormat, static_transforms,
    stereo_left_from_right,
};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion};
use common::{Info, camera_info, compressed, image, tf_static};
use proptest::prelude::*;

const FORMATS: [(bool, WireFormat); 2] = [(true, WireFormat::Ros1), (false, WireFormat::Cdr)];

fn gray(encoding: &str, pixels: &[u8]) -> Result<Vec<u8>, String> {
    let m = image(true, "/a", 1, "a", [2, 1], encoding, pixels);
    let image = ImageMessage::decode(WireFormat::Ros1, &m.data).unwrap();
    image.gray().map(|g| g.data().to_vec()).map_err(|e| e.to_string())
}

#[test]
fn pixels_become_luminance() {
    assert_eq!(gray("mono8", &[3, 250]).unwrap(), [3, 250]);
    assert_eq!(gray("mono16", &[1, 3, 2, 250]).unwrap(), [3, 250]);
    let (rgb, bgr) =
        (gray("rgb8", &[255, 0, 0, 0, 0, 255]).unwrap(), gray("bgr8", &[0, 0, 255, 255, 0, 0]).unwrap());
    assert_eq!((rgb.as_slice(), bgr.as_slice()), (&[76, 29][..], &[76, 29][..]));
    assert_eq!(gray("rgba8", &[255, 0, 0, 9, 0, 0, 255, 9]).unwrap(), [76, 29]);
    assert_eq!(gray("bgra8", &[0, 0, 255, 9, 255, 0, 0, 9]).unwrap(), [76, 29]);
    assert_eq!(gray("yuv422", &[9, 3, 9, 250]).unwrap(), [3, 250]);
    assert_eq!(gray("yuv422_yuy2", &[3, 9, 250, 9]).unwrap(), [3, 250]);
    assert!(gray("bayer_rggb10", &[1, 2]).unwrap_err().contains("\"bayer_rggb10\" are not read"));
    assert!(gray("rgb8", &[1, 2]).unwrap_err().contains("need 6 bytes"));
    // Chroma follows the luminance, of 16 bits the high byte counts.
    assert_eq!(gray("nv12", &[3, 250, 128, 128]).unwrap(), [3, 250]);
    assert_eq!(gray("rgb16", &[9, 255, 9, 0, 9, 0, 9, 0, 9, 0, 9, 255]).unwrap(), [76, 29]);
    assert_eq!(gray("bgra16", &[9, 0, 9, 0, 9, 255, 9, 9, 9, 255, 9, 0, 9, 0, 9, 9]).unwrap(), [76, 29]);
}

#[test]
fn pixels_of_fewer_than_16_bits_are_not_black_and_rows_of_no_stated_length_have_no_padding() {
    let header = cairn_bag::Header { stamp_ns: 0, frame_id: String::new() };
    for (encoding, bits) in
        ["mono16", "16UC1", "bayer_rggb16"].into_iter().flat_map(|e| [8, 10, 12, 14, 16].map(|b| (e, b)))
    {
        let pixels = [0, 1 << (bits - 1), u16::MAX >> (16 - bits), 1 << (bits - 2)];
        for big_endian in [false, true] {
            let data: Vec<u8> = pixels
                .iter()
                .flat_map(|v| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() })
                .collect();
            let image = ImageMessage {
                header: header.clone(),
                height: 2,
                width: 2,
                encoding: encoding.into(),
                big_endian,
                step: 0,
                data: &data,
            };
            assert_eq!(image.bits(), Some(bits), "{encoding} {bits}");
            let gray = image.gray_of_bits(bits).unwrap();
            assert!(
                encoding.starts_with("bayer") || gray.data() == [0, 128, 255, 64],
                "{encoding} {bits}: {:?}",
                gray.data()
            );
            assert!(gray.data().iter().any(|v| *v > 60), "{encoding} {bits}: {:?}", gray.data());
        }
    }
}

#[test]
fn depth_is_sixteen_bits_or_metres() {
    let m = image(false, "/d", 1, "d", [2, 1], "16UC1", &[0x10, 0x27, 0, 0]);
    let depth = ImageMessage::decode(WireFormat::Cdr, &m.data).unwrap().depth().unwrap();
    assert_eq!(depth.data(), [10_000, 0]);
    let metres: Vec<u8> =
        [1.2345f32, f32::NAN, -1.0, f32::INFINITY].iter().flat_map(|v| v.to_le_bytes()).collect();
    let m = image(false, "/d", 1, "d", [4, 1], "32FC1", &metres);
    let depth = ImageMessage::decode(WireFormat::Cdr, &m.data).unwrap().depth().unwrap();
    assert_eq!(depth.data(), [1235, 0, 0, 0]);
}

/// Groups of three bits of a number, the lowest first, each with a bit that says whether more follow.
fn groups(mut v: u32, out: &mut Vec<u8>) {
    while v > 7 {
        out.push((v & 7) as u8 | 8);
        v >>= 3;
    }
    out.push(v as u8);
}

/// A message of depth packed as RVL.
fn rvl(encoding: &str, head: [f32; 2], [width, height]: [u32; 2], data: &[u16]) -> Vec<u8> {
    let mut all = Vec::new();
    let (mut at, mut before) = (0, 0i32);
    while at < data.len() {
        let empty = data[at..].iter().take_while(|v| **v == 0).count();
        let full = data[at + empty..].iter().take_while(|v| **v != 0).count();
        groups(empty as u32, &mut all);
        groups(full as u32, &mut all);
        for &v in &data[at + empty..at + empty + full] {
            let step = i32::from(v) - before;
            groups(((step << 1) ^ (step >> 31)) as u32, &mut all);
            before = i32::from(v);
        }
        at += empty + full;
    }
    let mut file = vec![0; 4];
    file.extend(head.iter().flat_map(|v| v.to_le_bytes()));
    file.extend([width, height].iter().flat_map(|v| v.to_le_bytes()));
    for word in all.chunks(8) {
        let word = (0..8).fold(0u32, |w, k| w << 4 | u32::from(word.get(k).copied().unwrap_or(0)));
        file.extend(word.to_le_bytes());
    }
    compressed(false, "/d", 1, "d", &format!("{encoding}; compressedDepth rvl"), &file).data
}

#[test]
fn depth_packed_as_rvl_is_that_which_was_packed() {
    // By hand: no empty pixels, one of 3, in the groups 0, 1, 6 of one word.
    let mut by_hand = vec![0; 12];
    by_hand.extend([1, 0, 0, 0, 1, 0, 0, 0, 0x00, 0x00, 0x60, 0x01]);
    let m = compressed(false, "/d", 1, "d", "16UC1; compressedDepth rvl", &by_hand);
    let read = |data: &[u8]| CompressedImage::decode(WireFormat::Cdr, data).unwrap().rvl().unwrap();
    assert_eq!(read(&m.data).unwrap().data(), [3]);
    let image: Vec<u16> = (0..64 * 48u32)
        .map(|k| match k.wrapping_mul(2_654_435_761) >> 16 {
            v if v % 5 == 0 => 0,
            v if v % 5 == 1 => v as u16,
            _ => 1000 + k as u16 % 97,
        })
        .collect();
    let bytes = rvl("16UC1", [0.0; 2], [64, 48], &image);
    let depth = read(&bytes).unwrap();
    assert_eq!((depth.width(), depth.height(), depth.data()), (64, 48, image.as_slice()));
    // Cut off or damaged it is an error or another image, never a panic.
    assert!(read(&rvl("16UC1", [0.0; 2], [64, 49], &image)).is_err(), "too few pixels");
    assert!(read(&rvl("16UC1", [0.0; 2], [0, 48], &image)).is_err());
    assert!(read(&rvl("16UC1", [0.0; 2], [u32::MAX, u32::MAX], &image)).is_err());
    // Metres as the inverse depth that the transport writes.
    let bytes = rvl("32FC1", [10_100.0, -1_009.0], [4, 1], &[9091, 3031, 0, 1]);
    let m = CompressedImage::decode(WireFormat::Cdr, &bytes).unwrap();
    let mut depth = m.rvl().unwrap().unwrap();
    m.dequantise(&mut depth);
    assert_eq!(depth.data(), [1000, 2500, 0, 10_000]);
}

#[test]
fn compressed_depth_has_a_head_before_its_png() {
    let mut file = vec![0; 12];
    file.extend(b"\x89PNG");
    let m = compressed(true, "/d", 1, "d", "16UC1; compressedDepth png", &file);
    let m = CompressedImage::decode(WireFormat::Ros1, &m.data).unwrap();
    assert_eq!(m.file().unwrap(), b"\x89PNG");
    let m = compressed(true, "/d", 1, "d", "16UC1; compressedDepth zstd", &[0; 40]);
    let refused = CompressedImage::decode(WireFormat::Ros1, &m.data).unwrap().file().unwrap_err().to_string();
    assert!(refused.contains("compressedDepth zstd\" is not read, only that as PNG or RVL"), "{refused}");
    // Metres as the inverse depth that the transport writes.
    let numbers = [10_100.0f32, -1_009.0];
    file[..4].copy_from_slice(&1u32.to_le_bytes());
    (0..2).for_each(|k| file[4 + 4 * k..8 + 4 * k].copy_from_slice(&numbers[k].to_le_bytes()));
    let m = compressed(true, "/d", 1, "d", "32FC1; compressedDepth png", &file);
    let m = CompressedImage::decode(WireFormat::Ros1, &m.data).unwrap();
    assert_eq!(m.file().unwrap(), b"\x89PNG");
    // 1 m, 2.5 m, nothing, and beyond what is far.
    let written = [9091, 3031, 0, 1];
    let mut depth = cairn_sensor::DepthImage::from_vec(4, 1, written.to_vec()).unwrap();
    m.dequantise(&mut depth);
    assert_eq!(depth.data(), [1000, 2500, 0, 10_000]);
}

fn info(model: &str, d: &[f64]) -> CameraInfo {
    let m = camera_info(
        false,
        "/c",
        1,
        &Info {
            frame: "c",
            size: [640, 480],
            model,
            d,
            k: [400.0, 0.0, 320.0, 0.0, 401.0, 240.0, 0.0, 0.0, 1.0],
            r: [0.0; 9],
            p: [390.0, 0.0, 321.0, 0.0, 0.0, 390.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        },
    );
    CameraInfo::decode(WireFormat::Cdr, &m.data).unwrap()
}

#[test]
fn calibrations_keep_their_model() {
    let lens = |model: &str, d: &[f64]| info(model, d).camera(false).unwrap().distortion;
    let five = [0.1, -0.2, 0.001, 0.002, 0.05];
    assert_eq!(lens("plumb_bob", &five), Distortion::RadialTangential(five));
    assert_eq!(lens("plumb_bob", &five[..4]), Distortion::RadialTangential([0.1, -0.2, 0.001, 0.002, 0.0]));
    assert_eq!(lens("Inverse Brown Conrady", &five), Distortion::InverseRadialTangential(five));
    assert_eq!(lens("Brown Conrady", &five), Distortion::RadialTangential(five));
    let eight = [0.1, 0.2, 0.001, 0.002, 0.05, 0.3, 0.1, 0.01];
    assert_eq!(lens("rational_polynomial", &eight), Distortion::Rational(eight));
    assert_eq!(lens("equidistant", &[0.1, 0.2, 0.3, 0.4]), Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]));
    assert_eq!(lens("anything", &[0.0; 5]), Distortion::None);
    assert_eq!(
        lens("Modified Brown Conrady", &[0.1, 0.2, 0.0, 0.0, 0.3]),
        Distortion::RadialTangential([0.1, 0.2, 0.0, 0.0, 0.3])
    );
    assert!(
        info("Modified Brown Conrady", &five).camera(false).is_err(),
        "it is another model with tangential parts"
    );
    assert!(info("thin_prism", &five).camera(false).unwrap_err().to_string().contains("thin_prism"));
    assert!(info("equidistant", &five).camera(false).is_err(), "a fifth coefficient");
    let rectified = info("plumb_bob", &five).camera(true).unwrap();
    assert_eq!((rectified.fx, rectified.cx, rectified.distortion), (390.0, 321.0, Distortion::None));
    let raw = info("plumb_bob", &five).camera(false).unwrap();
    assert_eq!((raw.fx, raw.fy, raw.cx, raw.cy), (400.0, 401.0, 320.0, 240.0));
    let mut never = info("", &[]);
    never.k = [0.0; 9];
    assert!(never.camera(false).unwrap_err().to_string().contains("not calibrated"));
    never.k[0] = f64::NAN;
    assert!(never.camera(false).is_err());
}

/// A point seen by both cameras of a known pair: `R` and `P` give back the poses of the cameras.
#[test]
fn a_pair_is_placed_by_its_rectification() {
    let left_from_right = Se3::new(So3::exp(&Vec3::new(0.01, -0.03, 0.02)), Vec3::new(0.11, 0.004, -0.002));
    // The x axis of the rectified frames points to the other camera.
    let x = left_from_right.translation.normalize();
    let y = Vec3::z().cross(&x).normalize();
    let z = x.cross(&y);
    let rectified_from_left = nalgebra_rows(x, y, z);
    let (mut left, mut right) = (info("plumb_bob", &[]), info("plumb_bob", &[]));
    let right_r = rectified_from_left.matrix() * left_from_right.rotation.matrix();
    for (i, v) in rectified_from_left.matrix().transpose().iter().enumerate() {
        left.r[i] = *v;
    }
    for (i, v) in right_r.transpose().iter().enumerate() {
        right.r[i] = *v;
    }
    right.p[3] = -390.0 * left_from_right.translation.norm();
    let found = stereo_left_from_right(&left, &right, false).unwrap().unwrap();
    assert!((found.matrix() - left_from_right.matrix()).norm() < 1e-9, "{found:?}");
    let flat = stereo_left_from_right(&left, &right, true).unwrap().unwrap();
    assert!((flat.translation - Vec3::new(left_from_right.translation.norm(), 0.0, 0.0)).norm() < 1e-12);
    right.p[3] = 0.0;
    assert_eq!(stereo_left_from_right(&left, &right, false).unwrap(), None);
}

fn nalgebra_rows(x: Vec3, y: Vec3, z: Vec3) -> So3 {
    So3::from_matrix(&cairn_geometry::Mat3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]))
}

#[test]
fn transforms_are_parent_from_child_in_both_forms() {
    for (ros1, format) in FORMATS {
        let m = tf_static(ros1, 1, &[("/base", "cam", [1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.0])]);
        let found = static_transforms(format, &m.data).unwrap();
        assert_eq!((found[0].parent.as_str(), found[0].child.as_str()), ("base", "cam"));
        assert_eq!(found[0].parent_from_child.translation, Vec3::new(1.0, 2.0, 3.0));
        let wrong = tf_static(ros1, 1, &[("base", "cam", [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0])]);
        assert!(static_transforms(format, &wrong.data).unwrap_err().to_string().contains("norm"));
    }
}

#[test]
fn big_endian_cdr_and_unknown_kinds() {
    let mut wire = Wire::new(WireFormat::Cdr, &[0, 0, 0, 0, 0, 0, 1, 2]).unwrap();
    assert_eq!(wire.u32().unwrap(), 258);
    assert!(Wire::new(WireFormat::Cdr, &[0, 6, 0, 0]).is_err(), "XCDR2");
    assert!(Wire::new(WireFormat::Cdr, &[0]).is_err());
    assert!(Wire::new(WireFormat::Other, &[0; 8]).is_err());
}

/// A protobuf field: tag, length and bytes.
fn part(number: u8, bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![number << 3 | 2];
    let mut n = bytes.len();
    while n > 127 {
        out.push(n as u8 | 0x80);
        n >>= 7;
    }
    out.push(n as u8);
    out.extend_from_slice(bytes);
    out
}

fn fixed(number: u8, v: u32) -> Vec<u8> {
    [&[number << 3 | 5][..], &v.to_le_bytes()].concat()
}

fn doubles(v: &[f64]) -> Vec<u8> {
    v.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// 300 s and 5 ns.
const STAMP: [u8; 5] = [1 << 3, 0xac, 0x02, 2 << 3, 5];

#[test]
fn foxglove_in_protobuf() {
    let format = WireFormat::Protobuf;
    let image = [
        part(1, &STAMP),
        fixed(2, 2),
        fixed(3, 1),
        part(4, b"mono8"),
        fixed(5, 2),
        part(6, &[3, 250]),
        part(7, b"cam"),
    ]
    .concat();
    let m = ImageMessage::of("foxglove.RawImage", format, &image).unwrap();
    assert_eq!((m.header.stamp_ns, m.header.frame_id.as_str()), (300_000_000_005, "cam"));
    assert_eq!(m.gray().unwrap().data(), [3, 250]);
    let file = [part(1, &STAMP), part(2, &[7; 300]), part(3, b"jpeg"), part(4, b"cam")].concat();
    let m = CompressedImage::of("foxglove.CompressedImage", format, &file).unwrap();
    assert_eq!((m.data, m.format.as_str(), m.header.frame_id.as_str()), (&[7; 300][..], "jpeg", "cam"));
    let k = [400.0, 0.0, 320.0, 0.0, 401.0, 240.0, 0.0, 0.0, 1.0];
    let calibration = [
        part(1, &STAMP),
        fixed(2, 640),
        fixed(3, 480),
        part(4, b"plumb_bob"),
        part(5, &doubles(&[0.1, -0.2, 0.0, 0.0, 0.0])),
        part(6, &doubles(&k)),
    ]
    .concat();
    let m = CameraInfo::of("foxglove.CameraCalibration", format, &calibration).unwrap();
    let camera = m.camera(false).unwrap();
    assert_eq!((camera.width, camera.height, camera.fy), (640, 480, 401.0));
    assert_eq!(camera.distortion, Distortion::RadialTangential([0.1, -0.2, 0.0, 0.0, 0.0]));
    for cut in 1..calibration.len() {
        let _ = CameraInfo::of("foxglove.CameraCalibration", format, &calibration[..cut]);
    }
    assert!(
        ImageMessage::of("foxglove.RawImage", format, &[0x32, 0xff, 0xff, 0xff, 0xff, 0x0f, 1]).is_err(),
        "4 GB"
    );
}

/// This crate reads what it writes in ROS 2 form.
#[test]
fn foxglove_in_ros2_form() {
    let image = cairn_sensor::GrayImage::from_vec(2, 1, vec![3, 250]).unwrap();
    let bytes = cairn_bag::foxglove::raw_image(300_000_000_005, "cam", &image);
    let m = ImageMessage::of("foxglove_msgs/RawImage", WireFormat::Cdr, &bytes).unwrap();
    assert_eq!((m.header.stamp_ns, m.header.frame_id.as_str()), (300_000_000_005, "cam"));
    assert_eq!(m.gray().unwrap(), image);

    let lens = |distortion| Camera { distortion, ..Camera::pinhole(64, 48, 50.5, 51.5, 31.25, 23.75) };
    for camera in [
        lens(Distortion::None),
        lens(Distortion::RadialTangential([-0.3, 0.1, 0.01, -0.02, 0.003])),
        lens(Distortion::Rational([0.1, -0.2, 0.01, -0.02, 0.03, 0.2, -0.1, 0.05])),
        lens(Distortion::Equidistant([0.03, -0.01, 0.002, -0.001])),
    ] {
        let bytes = camera_calibration(300_000_000_005, "cam", &camera).unwrap();
        let info = CameraInfo::of("foxglove_msgs/CameraCalibration", WireFormat::Cdr, &bytes).unwrap();
        assert_eq!((info.header.stamp_ns, info.header.frame_id.as_str()), (300_000_000_005, "cam"));
        assert_eq!(info.camera(false).unwrap(), camera);
    }
    assert_eq!(camera_calibration(0, "cam", &lens(Distortion::Fov(0.9))), None);
}

proptest! {
    #[test]
    fn any_bytes_are_decoded_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..400), small in any::<bool>()) {
        let mut bytes = bytes;
        if small {
            // Small lengths, so that the following fields are reached.
            bytes.iter_mut().for_each(|b| *b &= 0x0f);
        }
        for (_, format) in FORMATS {
            if format == WireFormat::Cdr && bytes.len() > 4 {
                bytes[..4].copy_from_slice(&[0, 1, 0, 0]);
            }
            if let Ok(image) = ImageMessage::decode(format, &bytes) {
                let _ = (image.gray(), image.depth());
            }
            let _ = CompressedImage::decode(format, &bytes).map(|c| c.file().map(drop));
            let _ = ImuMessage::decode(format, &bytes);
            let _ = CameraInfo::decode(format, &bytes).map(|c| c.camera(false).map(drop));
            let _ = static_transforms(format, &bytes);
        }
        let _ = ImageMessage::of("foxglove.RawImage", WireFormat::Protobuf, &bytes).map(|i| i.gray().map(drop));
        let _ = CameraInfo::of("foxglove.CameraCalibration", WireFormat::Protobuf, &bytes);
    }
}
