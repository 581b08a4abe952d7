//! Layouts of recordings that people have: ICL-NUIM, UZH-FPV, an iPhone's, pictures side by side.

use crate::common;

use cairn_geometry::{So3, Vec3};
use cairn_sensor::{Camera, Distortion, FramePacket, Rig, RigCamera, Source};
use cairn_sources::{OpenOptions, open};
use common::{Folder, depth_png, gray_png, png};

fn opened(folder: &Folder, rig: Option<Rig>) -> Box<dyn Source> {
    open(folder.name(), OpenOptions { rig, ..OpenOptions::default() }).unwrap_or_else(|e| panic!("{e}"))
}

fn packets(source: &mut dyn Source) -> Vec<FramePacket> {
    std::iter::from_fn(|| source.next_packet().unwrap()).collect()
}

fn refused(folder: &Folder) -> String {
    open(folder.name(), OpenOptions::default()).err().expect("it is refused").to_string()
}

#[test]
fn icl_nuim_has_numbers_for_times_and_a_camera_with_y_up() {
    let folder = Folder::new();
    let mut lines = String::new();
    for k in 0..3 {
        folder.write(&format!("rgb/{k}.png"), gray_png(640, 480, k));
        folder.write(&format!("depth/{k}.png"), depth_png(640, 480, 5000, 5000));
        lines += &format!("{k} depth/{k}.png {k} rgb/{k}.png\n");
    }
    folder.write("associations.txt", lines);
    // Turned about y, which both have, and moved up.
    let (s, c) = (0.1f64.sin(), 0.1f64.cos());
    folder.write("livingRoom9.gt.freiburg", format!("1 0 0.5 -2 0 0 0 1\n2 0.1 0.6 -2 {s} 0 0 {c}\n"));
    let mut source = opened(&folder, None);
    let info = source.info().clone();
    assert!(info.name.contains("numbers of frames: 30 images a second"), "{}", info.name);
    assert!(info.assumed.as_ref().is_some_and(|what| what.contains("y points down")), "{:?}", info.assumed);
    let camera = source.rig().cameras[0].camera;
    assert_eq!((camera.fx, camera.fy, camera.cy), (481.2, 480.0, 239.5));
    assert_eq!(info.truth.len(), 2);
    let (at, pose) = info.truth[1];
    assert_eq!((at.0, pose.translation), (66_666_667, Vec3::new(0.1, -0.6, -2.0)));
    // A rotation about x is the other way round where y points down.
    assert!((pose.rotation.inverse() * So3::exp(&Vec3::new(-0.2, 0.0, 0.0))).angle() < 1e-9, "{pose:?}");
    let all = packets(&mut *source);
    assert_eq!(all.iter().map(|p| p.stamp.0).collect::<Vec<_>>(), [0, 33_333_333, 66_666_667]);
    assert!(all.iter().all(|p| p.depth.is_some()));
}

#[test]
fn times_in_seconds_are_no_numbers_of_frames() {
    let folder = Folder::new();
    let images = ["1.png", "3.png"];
    images.iter().for_each(|name| drop(folder.write(&format!("rgb/{name}"), gray_png(640, 480, 0))));
    folder.write("rgb.txt", "1 rgb/1.png\n2.5 rgb/3.png\n");
    let mut source = opened(&folder, None);
    let stamps: Vec<i64> = packets(&mut *source).iter().map(|p| p.stamp.0).collect();
    assert_eq!(stamps, [1_000_000_000, 2_500_000_000], "{:?}", source.skipped());
}

#[test]
fn the_last_image_is_given_after_a_gap_in_the_times() {
    for times in [&[0.0, 0.1, 2.0][..], &[0.0, 2.0, 4.0], &[0.0, 0.1, 2.0, 2.1, 2.2]] {
        let folder = Folder::new();
        let mut lines = String::new();
        for (k, time) in times.iter().enumerate() {
            folder.write(&format!("rgb/{k}.png"), gray_png(640, 480, 0));
            lines += &format!("{time:.1} rgb/{k}.png\n");
        }
        folder.write("rgb.txt", lines);
        let found: Vec<f64> =
            packets(&mut *opened(&folder, None)).iter().map(|p| p.stamp.seconds()).collect();
        assert_eq!(found, times);
    }
}

/// Lines of an IMU at rest that lies on its back: 9.8 m/s^2 along z.
fn at_rest(line: fn(usize, f64) -> String) -> String {
    (0..60).map(|k| line(k, 1.0 + 0.005 * k as f64)).collect()
}

#[test]
fn uzh_fpv_and_rpg_folders_are_read() {
    let fpv = Folder::new();
    for (k, side) in [(0, "left"), (1, "left"), (0, "right"), (1, "right")] {
        fpv.write(&format!("img/image_{side}_{k}.png"), gray_png(8, 6, k));
    }
    let list = |side: &str| {
        format!("# id timestamp image_name\n0 1.05 img/image_{side}_0.png\n1 1.10 img/image_{side}_1.png\n")
    };
    fpv.write("left_images.txt", list("left"));
    fpv.write("right_images.txt", list("right"));
    fpv.write("imu.txt", at_rest(|k, t| format!("{k} {t} 0.01 0 0 0 0 9.8\n")));
    fpv.write("groundtruth.txt", "# timestamp tx ty tz qx qy qz qw\n1.05 1 2 3 0 0 0 1\n");
    assert!(refused(&fpv).contains("no chain of Kalibr"), "{}", refused(&fpv));
    let chain = "cam0:\n  camera_model: pinhole\n  intrinsics: [7, 7, 4, 3]\n  distortion_model: equidistant\n  \
        distortion_coeffs: [0.1, 0, 0, 0]\n  resolution: [8, 6]\n  T_cam_imu:\n  - [1, 0, 0, 0]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n";
    let second = chain.replace("cam0", "cam1").replace("[1, 0, 0, 0]", "[1, 0, 0, -0.1]");
    fpv.write("camchain-indoor.yaml", format!("{chain}{second}"));
    fpv.write(
        "imu-indoor.yaml",
        "gyroscope_noise_density: 2e-3\ngyroscope_random_walk: 2e-5\naccelerometer_noise_density: 2e-2\naccelerometer_random_walk: 3e-3\nupdate_rate: 200\n",
    );
    let mut source = opened(&fpv, None);
    assert_eq!((source.rig().cameras.len(), source.info().truth.len()), (2, 1));
    let all = packets(&mut *source);
    assert_eq!((all.len(), all[0].images.len(), all[0].stamp.0), (2, 2, 1_050_000_000));
    let sample = all[0].imu.first().expect("a sample");
    assert_eq!((sample.accel.z, sample.gyro.x), (9.8, 0.01));
    // The other recordings of that laboratory: no numbers, the accelerometer first, the calibration in one line.
    let davis = Folder::new();
    davis.write("images/frame_00000000.png", gray_png(8, 6, 0));
    davis.write("images/frame_00000001.png", gray_png(8, 6, 1));
    davis.write("images.txt", "1.05 images/frame_00000000.png\n1.10 images/frame_00000001.png\n");
    davis.write("calib.txt", "7.5 7.25 4 3 -0.3 0.1 0.001 0.002 0\n");
    davis.write("imu.txt", at_rest(|_, t| format!("{t} 0 0 -9.8 0.01 0 0\n")));
    davis.write("stamped_groundtruth.txt", "0 1.05 1 2 3 0 0 0 1\n1 1.10 1 2 3 0 0 0 1\n");
    let mut source = opened(&davis, None);
    let camera = source.rig().cameras[0].camera;
    assert_eq!(camera.distortion, Distortion::RadialTangential([-0.3, 0.1, 0.001, 0.002, 0.0]));
    assert_eq!((camera.fy, camera.width, source.info().truth.len()), (7.25, 8, 2));
    assert_eq!(packets(&mut *source).len(), 2);
    let rig = |imu: &str| {
        let sensor = cairn_sensor::ImuSensor {
            body_from_imu: cairn_geometry::Se3::identity(),
            rate_hz: 200.0,
            noise: cairn_sensor::ImuNoise { gyro: 2e-3, gyro_walk: 2e-5, accel: 2e-2, accel_walk: 3e-3 },
            offset_s: 0.0,
        };
        davis.write("imu.txt", imu);
        Some(Rig { imu: Some(sensor), ..Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0)) })
    };
    let mut source = opened(&davis, rig(&at_rest(|_, t| format!("{t} 0 0 -9.8 0.01 0 0\n"))));
    let first = packets(&mut *source).remove(0);
    assert_eq!((first.imu[0].accel.z, first.imu[0].gyro.x), (-9.8, 0.01), "gravity tells which is which");
    let source = opened(&davis, rig(&at_rest(|_, t| format!("{t} 0 0 0.1 0.01 0 0\n"))));
    assert!(source.rig().imu.is_none() && source.skipped().iter().any(|s| s.contains("IMU is not used")));
}

fn stray(accel: [f64; 3]) -> Folder {
    let folder = Folder::new();
    folder.write("camera_matrix.csv", "14.0, 0.0, 8.0\n0.0, 14.0, 6.0\n0.0, 0.0, 1.0\n");
    // The phone is held upright and looks along -z of ARKit's world: its camera's picture is turned, so that down is to the
    // right in it.
    let camera = So3::from_matrix(&cairn_geometry::Mat3::from_columns(&[-Vec3::y(), -Vec3::x(), -Vec3::z()]));
    let q = camera.quaternion();
    let mut rows = "timestamp, frame, x, y, z, qx, qy, qz, qw\n".to_owned();
    for k in 0..3 {
        folder.write(&format!("rgb/00000{k}.png"), gray_png(16, 12, k));
        folder.write(&format!("depth/00000{k}.png"), depth_png(8, 6, 1, 2000));
        rows +=
            &format!("{}, 00000{k}, 0, 0, 0, {}, {}, {}, {}\n", 5.5 + 0.1 * f64::from(k), q.i, q.j, q.k, q.w);
    }
    folder.write("odometry.csv", rows);
    let mut imu = "timestamp, a_x, a_y, a_z, alpha_x, alpha_y, alpha_z\n".to_owned();
    for k in 0..40 {
        let [x, y, z] = accel;
        imu += &format!("{}, {x}, {y}, {z}, 0.5, 0, 0\n", 5.45 + 0.01 * f64::from(k));
    }
    folder.write("imu.csv", imu);
    folder
}

#[test]
fn an_iphones_imu_is_used_in_whatever_unit_it_is_and_not_without_gravity() {
    // Core Motion gives -1 g along the phone's y axis while it is held upright.
    for accel in [[0.0, -1.0, 0.0], [0.0, -9.81, 0.0], [0.0, 9.81, 0.0]] {
        let folder = stray(accel);
        let mut source = opened(&folder, None);
        let rig = source.rig().clone();
        let imu = rig.imu.as_ref().unwrap_or_else(|| panic!("{:?}", source.skipped()));
        assert!((imu.rate_hz - 100.0).abs() < 1e-3, "{}", imu.rate_hz);
        let all = packets(&mut *source);
        let sample = all[1].imu[0];
        assert!((sample.accel.y - 9.81).abs() < 0.01 && sample.gyro.x == 0.5, "{accel:?}: {sample:?}");
        // Up along the phone is to the left in the picture.
        let up = rig.cameras[0].body_from_camera.inverse().rotation * sample.accel;
        assert!((up.normalize() + Vec3::x()).norm() < 1e-6, "{up}");
        assert!(all.iter().all(|p| p.depth.is_some()) && rig.depth.is_some());
    }
    let folder = stray([0.1, 0.05, 0.2]);
    let source = opened(&folder, None);
    assert!(source.rig().imu.is_none());
    let told = source.skipped().join(" ");
    assert!(told.contains("gravity is not in it") && told.contains("IMU is not used"), "{told}");
}

#[test]
fn record3d_has_its_own_times_and_sizes() {
    let folder = Folder::new();
    (0..3).for_each(|k| drop(folder.write(&format!("rgbd/{k}.png"), gray_png(16, 12, k))));
    let metadata =
        |more: &str| format!(r#"{{"w": 8, "h": 6, "K": [7.0, 0, 0, 0, 7.5, 0, 4.0, 3.0, 1]{more}}}"#);
    let stamps = |folder: &Folder| -> Vec<i64> {
        packets(&mut *opened(folder, None)).iter().map(|p| p.stamp.0).collect()
    };
    folder.write("metadata", metadata(r#", "fps": 60"#));
    let source = opened(&folder, None);
    // The images are twice as large as those the matrix is of.
    let camera = source.rig().cameras[0].camera;
    assert_eq!((camera.width, camera.fx, camera.fy, camera.cx), (16, 14.0, 15.0, 8.0));
    assert!(source.info().name.contains("60 images a second, as it states"), "{}", source.info().name);
    assert!(source.skipped().iter().any(|s| s.contains("depth") && s.contains("not read")));
    assert_eq!(stamps(&folder), [0, 16_666_666, 33_333_333]);
    folder.write("metadata", metadata(r#", "fps": 60, "frameTimestamps": [7.25, 7.5, 8.0]"#));
    assert_eq!(stamps(&folder), [7_250_000_000, 7_500_000_000, 8_000_000_000]);
    folder.write("metadata", metadata("").replace("\"h\": 6", "\"h\": 7"));
    assert!(refused(&folder).contains("is of images of 8x7, but these have 16x12"), "{}", refused(&folder));
}

/// A wall of random bricks as two cameras beside each other see it, right of left in one picture.
fn both(shift: usize, unlike: bool) -> Vec<u8> {
    let (width, height) = (96u32, 64u32);
    let shade =
        |x: usize, y: usize| ((x / 7).wrapping_mul(97) ^ (y / 5).wrapping_mul(61)).wrapping_mul(41) as u8;
    let mut data = Vec::new();
    for y in 0..height as usize {
        data.extend((0..width as usize).map(|x| shade(x, y)));
        data.extend(
            (0..width as usize)
                .map(|x| shade(if unlike { 1000 - 3 * x } else { x + shift }, y + 400 * usize::from(unlike))),
        );
    }
    png(2 * width, height, png::ColorType::Grayscale, png::BitDepth::Eight, &data)
}

#[test]
fn pictures_side_by_side_are_two_cameras_of_a_rig_and_are_told_without_one() {
    let folder = Folder::new();
    (0..2).for_each(|k| drop(folder.write(&format!("{k}.png"), both(8, false))));
    let source = opened(&folder, None);
    assert!(source.skipped().iter().any(|s| s.contains("side by side")), "{:?}", source.skipped());
    let mut rig = Rig::mono(Camera::pinhole(96, 64, 80.0, 80.0, 48.0, 32.0));
    let first = rig.cameras[0].clone();
    let mut body_from_camera = first.body_from_camera;
    body_from_camera.translation.x = 0.1;
    rig.cameras.push(RigCamera { name: "cam1".into(), body_from_camera, ..first });
    let mut source = opened(&folder, Some(rig.clone()));
    assert!(source.info().name.contains("side by side"), "{}", source.info().name);
    let all = packets(&mut *source);
    assert_eq!((all.len(), all[0].images.len()), (2, 2));
    let [left, right] = &all[1].images[..] else { panic!() };
    assert_eq!(
        (left.width(), right.width(), left.row(3)[8], left.row(3)[20]),
        (96, 96, right.row(3)[0], right.row(3)[12])
    );
    // One above the other: the same two pictures.
    let above = Folder::new();
    let data: Vec<u8> = [left, right].iter().flat_map(|image| image.data().to_vec()).collect();
    let tall = png(96, 128, png::ColorType::Grayscale, png::BitDepth::Eight, &data);
    (0..2).for_each(|k| drop(above.write(&format!("{k}.png"), &tall)));
    let mut source = opened(&above, Some(rig));
    assert!(source.info().name.contains("left above right"), "{}", source.info().name);
    assert_eq!(packets(&mut *source)[0].images, all[1].images);
    let other = Folder::new();
    (0..2).for_each(|k| drop(other.write(&format!("{k}.png"), both(0, true))));
    assert!(opened(&other, None).skipped().is_empty(), "a wide picture is one camera's");
}

#[test]
fn numbered_colour_and_depth_beside_each_other_are_rgbd_whatever_they_are_called() {
    for (colour, before, of_depth) in [
        ("rgb", "rgb_", "depth_"),
        ("color", "", ""),
        ("image", "0000001-00000", "0000001-00000"),
        ("images", "frame", "d"),
    ] {
        let folder = Folder::new();
        for k in 0..3 {
            // Two before ten, and depth in another order of writing.
            let number = [2, 10, 100][k];
            folder.write(&format!("{colour}/{before}{number}.png"), gray_png(16, 12, k as u8));
            folder.write(&format!("depth/{of_depth}{number}.png"), depth_png(8, 6, 1, 1000 + k as u16));
        }
        let mut source = opened(&folder, None);
        let assumed = source.info().assumed.clone().unwrap();
        assert!(assumed.contains("focal length of 11 px") && assumed.contains("millimetres"), "{assumed}");
        let all = packets(&mut *source);
        assert_eq!(all.len(), 3);
        for (k, packet) in all.iter().enumerate() {
            assert_eq!(packet.images[0].at(0, 0), k as u8, "{colour}");
            assert_eq!(packet.depth.as_ref().unwrap().at(3, 3), 1000 + k as u16, "{colour}");
        }
        folder.write(
            "camera_intrinsic.json",
            r#"{"width": 16, "height": 12, "intrinsic_matrix": [14.0, 0, 0, 0, 15.0, 0, 8.0, 6.0, 1]}"#,
        );
        folder.write("times.txt", "5.0\n5.1\n5.3\n");
        folder.write("traj_w_c.txt", "1 0 0 7 0 1 0 0 0 0 1 0 0 0 0 1\n".repeat(101));
        let source = opened(&folder, None);
        let camera = source.rig().cameras[0].camera;
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (14.0, 15.0, 8.0, 6.0));
        let assumed = source.info().assumed.as_deref();
        assert_eq!(assumed, Some("depth in millimetres, registered to the camera"));
        assert_eq!((source.info().truth.len(), source.info().truth[0].1.translation.x), (3, 7.0));
        let stamps: Vec<i64> =
            packets(&mut *opened(&folder, None)).iter().map(|p| p.stamp.0 / 1_000_000).collect();
        assert_eq!(stamps, [5000, 5100, 5300]);
    }
}

#[test]
fn depth_that_is_there_and_not_read_is_told() {
    let folder = stray([0.0, -1.0, 0.0]);
    for k in 0..3 {
        folder.remove(&format!("depth/00000{k}.png"));
        folder.write(&format!("depth/00000{k}.npy"), "\u{93}NUMPY");
    }
    let told = opened(&folder, None).skipped().join(" ");
    assert!(told.contains("has no numbered PNG") && told.contains("000000.npy"), "{told}");
    let folder = Folder::new();
    folder.write("rgb.txt", "1.0 rgb/a.png\n1.1 rgb/b.png\n");
    for name in ["a", "b"] {
        folder.write(&format!("rgb/{name}.png"), gray_png(8, 6, 0));
        folder.write(&format!("depth/{name}.png"), depth_png(8, 6, 1, 5000));
    }
    folder.write("calibration.txt", "7 7 4 3\n");
    let source = opened(&folder, None);
    assert!(source.rig().depth.is_none() && source.info().assumed.is_none());
    let told = source.skipped().join(" ");
    assert!(told.contains("depth/ is not used: no depth.txt with times lists its images"), "{told}");
    // A little late for each is paired, and told; with a rig of one camera nobody wants depth.
    folder.write("depth.txt", "1.04 depth/a.png\n1.14 depth/b.png\n");
    let mut source = opened(&folder, None);
    let told = source.skipped().join(" ");
    assert!(told.contains("colour and depth images 40.0 ms apart"), "{told}");
    assert!(packets(&mut *source).iter().all(|p| p.depth.is_some()));
    folder.remove("depth.txt");
    let rig = Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0));
    assert_eq!(opened(&folder, Some(rig)).skipped(), [""; 0]);
}

#[test]
fn ground_truth_of_another_time_or_form_is_told() {
    let folder = Folder::new();
    folder.write("rgb.txt", "100.0 rgb/a.png\n100.1 rgb/b.png\n");
    ["a", "b"].iter().for_each(|name| drop(folder.write(&format!("rgb/{name}.png"), gray_png(8, 6, 0))));
    folder.write("calibration.txt", "7 7 4 3\n");
    let told = |truth: &str| {
        folder.write("groundtruth.txt", truth);
        opened(&folder, None).skipped().join(" ")
    };
    assert_eq!(told("99.9 0 0 0 0 0 0 1\n100.2 1 0 0 0 0 0 1\n"), "");
    for other in ["0.0 0 0 0 0 0 0 1\n0.1 1 0 0 0 0 0 1\n", "1e5 0 0 0 0 0 0 1\n1.001e5 1 0 0 0 0 0 1\n"] {
        let told = told(other);
        assert!(
            told.contains("no time in common with the images") && told.contains("100.000 to 100.100 s"),
            "{told}"
        );
    }
    let of_another_form = told("1.0 0 0\n1.1 0 0 1\n");
    assert!(of_another_form.contains("groundtruth.txt, line 2: no line is a pose"), "{of_another_form}");
}

#[test]
fn openloris_brings_its_calibration_and_millimetres() {
    let folder = Folder::new();
    folder.write("color.txt", "#Time\n1.0 color/a.png\n1.1 color/b.png\n");
    folder.write("aligned_depth.txt", "#Time\n1.0 aligned_depth/a.png\n1.1 aligned_depth/b.png\n");
    for name in ["a", "b"] {
        folder.write(&format!("color/{name}.png"), gray_png(8, 6, 0));
        folder.write(&format!("aligned_depth/{name}.png"), depth_png(8, 6, 1, 2000));
    }
    folder.write(
        "sensors.yaml",
        "%YAML:1.0\nd400_color_optical_frame:\n   sensor_type: camera\n   fps: 30\n   width: 8\n   height: 6\n   model: pinhole\n   \
         intrinsics: !!opencv-matrix\n      rows: 1\n      cols: 4\n      dt: d\n      data: [ 7.5e+00, 4.25,\n          7.25, 3.5 ]\n",
    );
    let source = opened(&folder, None);
    let rig = source.rig();
    let camera = rig.cameras[0].camera;
    assert_eq!((camera.fx, camera.cx, camera.fy, camera.cy), (7.5, 4.25, 7.25, 3.5));
    assert_eq!((rig.depth.as_ref().unwrap().metres_per_unit, source.info().assumed.as_ref()), (0.001, None));
}

#[test]
fn images_of_a_kind_that_is_not_read_are_named_with_a_way_out() {
    let folder = Folder::new();
    (0..3).for_each(|k| drop(folder.write(&format!("{k}.webp"), "RIFF1234WEBPVP8 ")));
    let told = refused(&folder);
    assert!(
        told.contains("0.webp is an image of a kind that is not read") && told.contains("mogrify"),
        "{told}"
    );
    let folder = Folder::new();
    folder.write("rgb.txt", "1.0 rgb/a.tif\n1.1 rgb/b.tif\n");
    folder.write("calibration.txt", "7 7 4 3\n");
    ["a", "b"].iter().for_each(|name| drop(folder.write(&format!("rgb/{name}.tif"), b"II*\0....")));
    let told = refused(&folder);
    assert!(told.contains("calibration.txt") && told.contains("a.tif is an image of a kind"), "{told}");
    folder.write(
        "rig.toml",
        cairn_sources::write_rig(&Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0))).unwrap(),
    );
    let told = refused(&folder);
    assert!(told.contains("a.tif: TIFF, which is not read: JPEG, PNG and BMP are"), "{told}");
}

#[test]
fn images_of_two_cameras_in_one_folder_are_told() {
    let folder = Folder::new();
    for k in 0..12 {
        folder.write(&format!("left_{k:04}.png"), gray_png(8, 6, k));
        folder.write(&format!("right_{k:04}.png"), gray_png(8, 6, k));
    }
    let told = opened(&folder, None).skipped().join(" ");
    assert!(told.contains("names of 2 kinds (left_... and right_...)"), "{told}");
    let folder = Folder::new();
    for k in 0..12 {
        folder.write(&format!("IMG_{k}.png"), gray_png(8, 6, k));
    }
    folder.write("cover.png", gray_png(8, 6, 0));
    assert_eq!(opened(&folder, None).skipped(), [""; 0]);
}

#[test]
fn euroc_without_folders_of_data_is_read() {
    let folder = Folder::new();
    for camera in ["cam0", "cam1"] {
        for k in 0..3 {
            folder.write(
                &format!("{camera}/{}.png", 1_403_636_580_000_000_000_i64 + 50_000_000 * k),
                gray_png(8, 6, k as u8),
            );
        }
    }
    let mut rig = Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0));
    let mut second = rig.cameras[0].clone();
    (second.name, second.body_from_camera.translation.x) = ("cam1".into(), 0.1);
    rig.cameras.push(second);
    let all = packets(&mut *opened(&folder, Some(rig)));
    assert_eq!((all.len(), all[0].images.len(), all[1].stamp - all[0].stamp), (3, 2, 0.05));
}
