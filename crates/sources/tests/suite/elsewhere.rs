//! What people bring from elsewhere: folders of images, associations alone, KITTI roots, and the calibrations of other
//! programs.

use crate::common;

use cairn_sensor::{Camera, Distortion, Rig, SkipKind, Source};
use cairn_sources::{OpenOptions, SourceKind, image_size, open, read_rig, read_rig_for};
use common::{Folder, depth_png, gray_png, rgbd_rig};

fn packets(source: &mut dyn Source) -> Vec<i64> {
    std::iter::from_fn(|| source.next_packet().unwrap().map(|p| p.stamp.0)).collect()
}

fn opened(folder: &Folder, options: OpenOptions) -> Box<dyn Source> {
    open(folder.name(), options).unwrap()
}

fn refused(source: &str, options: OpenOptions) -> String {
    open(source, options).map(|source| source.info().name.clone()).expect_err("it is refused").to_string()
}

fn with_rig() -> OpenOptions {
    let rig = Some(Rig::mono(Camera::pinhole(8, 6, 7.0, 7.0, 4.0, 3.0)));
    OpenOptions { rig, ..OpenOptions::default() }
}

#[test]
fn images_are_played_in_the_order_of_their_numbers() {
    let folder = Folder::new();
    for n in [10, 2, 1] {
        folder.write(&format!("shot{n}.png"), gray_png(8, 6, n));
    }
    folder.write("notes.txt", "not an image");
    folder.write("._shot1.png", "what a Mac leaves behind");
    let mut source = opened(&folder, with_rig());
    assert!(source.info().name.contains("30 images a second"), "{}", source.info().name);
    let mut first_pixels = Vec::new();
    let mut stamps = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        first_pixels.push(packet.images[0].data()[0]);
        stamps.push(packet.stamp.0);
    }
    assert_eq!((first_pixels, stamps), (vec![1, 2, 10], vec![0, 33_333_333, 66_666_666]));
}

#[test]
fn times_of_images_are_those_of_names_or_of_a_file() {
    let folder = Folder::new();
    folder.write("1403636579763555584.png", gray_png(8, 6, 0));
    folder.write("1403636579813555456.png", gray_png(8, 6, 1));
    assert_eq!(
        packets(&mut *opened(&folder, with_rig())),
        [1_403_636_579_763_555_584, 1_403_636_579_813_555_456]
    );
    // A file of times counts more than names.
    folder.write("times.txt", "# seconds\n0.5\n0.75\n");
    assert_eq!(packets(&mut *opened(&folder, with_rig())), [500_000_000, 750_000_000]);
    folder.write("times.txt", "0.5\n");
    let text = refused(folder.name(), with_rig());
    assert!(text.contains("has 1 lines, the folder 2 images"), "{text}");
}

#[test]
fn a_folder_of_images_takes_the_first_camera_of_any_rig_or_guesses() {
    let folder = Folder::new();
    folder.write("a.png", gray_png(8, 6, 0));
    folder.write("b.png", gray_png(8, 6, 1));
    let rig = rgbd_rig();
    let source = opened(&folder, OpenOptions { rig: Some(rig.clone()), ..OpenOptions::default() });
    assert_eq!((source.rig().cameras.len(), source.rig().depth.is_some()), (1, false));
    assert_eq!(source.rig().cameras[0].camera, rig.cameras[0].camera);
    assert!(source.info().name.contains("only the first camera"), "{}", source.info().name);
    let source = opened(&folder, OpenOptions::default());
    let assumed = source.info().assumed.clone().unwrap();
    assert!(assumed.contains("0.7 of the longer side") && assumed.contains("30 images"), "{assumed}");
    folder.write("b.png", gray_png(10, 6, 1));
    let mut source = opened(&folder, with_rig());
    assert_eq!(packets(&mut *source).len(), 1);
    assert_eq!(source.skips().count(SkipKind::Frame), 1);
}

#[test]
fn as_decides_where_a_folder_is_two_things() {
    let folder = Folder::new();
    folder.write("rgb.txt", "1.0 rgb/a.png\n2.0 rgb/b.png\n");
    for name in ["rgb/a.png", "rgb/b.png", "image_0/000000.png", "image_0/000001.png"] {
        folder.write(name, gray_png(8, 6, 0));
    }
    let text = refused(folder.name(), with_rig());
    assert!(text.contains("more than one kind") && text.contains("--as"), "{text}");
    for (kind, stamps) in
        [(SourceKind::Tum, [1_000_000_000, 2_000_000_000]), (SourceKind::Kitti, [0, 100_000_000])]
    {
        let mut source = opened(&folder, OpenOptions { kind: Some(kind), ..with_rig() });
        assert_eq!(packets(&mut *source), stamps, "{kind:?}");
    }
    let text = refused(folder.name(), OpenOptions { kind: Some(SourceKind::Images), ..with_rig() });
    assert!(text.contains("holds no PNG, JPEG or BMP"), "{text}");
}

#[test]
fn tum_with_associations_alone() {
    let folder = Folder::new();
    let mut rig = rgbd_rig();
    rig.depth.as_mut().unwrap().registered = true;
    for name in ["rgb/a.png", "rgb/b.png"] {
        folder.write(name, gray_png(8, 6, 0));
        folder.write(&name.replace("rgb", "depth"), depth_png(8, 6, 1, 2));
    }
    for lines in [
        "1.00 rgb/a.png 1.01 depth/a.png\n2.00 rgb/b.png 2.01 depth/b.png\n",
        "1.01 depth/a.png 1.00 rgb/a.png\n2.01 depth/b.png 2.00 rgb/b.png\nbroken\n",
    ] {
        folder.write("associations.txt", lines);
        let mut source = opened(&folder, OpenOptions { rig: Some(rig.clone()), ..OpenOptions::default() });
        let packet = source.next_packet().unwrap().unwrap();
        assert_eq!(packet.stamp.0, 1_000_000_000);
        assert_eq!(packet.depth.unwrap().data()[0], 1);
        assert!(source.next_packet().unwrap().unwrap().depth.is_some());
        assert!(source.next_packet().unwrap().is_none());
        assert_eq!(source.skips().count(SkipKind::Line), usize::from(lines.contains("broken")));
    }
}

#[test]
fn kitti_roots_lead_to_their_sequences() {
    let folder = Folder::new();
    let sequence = |n: &str| {
        folder.write(&format!("dataset/sequences/{n}/calib.txt"), "P0: 7 0 4 0 0 7 3 0 0 0 1 0\n");
        folder.write(&format!("dataset/sequences/{n}/image_0/000000.png"), gray_png(8, 6, 0));
    };
    sequence("03");
    let below = |path: &str| format!("{}/{path}", folder.name());
    for root in [
        folder.name().to_owned(),
        below("dataset"),
        below("dataset/sequences"),
        below("dataset/03"),
        below("03"),
    ] {
        let source = open(&root, OpenOptions::default()).unwrap();
        assert!(source.info().name.ends_with("sequences/03"), "{root}: {}", source.info().name);
        assert_eq!(image_size(&root), Some([8, 6]), "{root}");
    }
    sequence("07");
    let text = refused(folder.name(), OpenOptions::default());
    assert!(text.contains("KITTI root with 2 sequences") && text.contains("sequences/03"), "{text}");
    assert!(open(&below("dataset/07"), OpenOptions::default()).is_ok());
}

#[test]
fn orb_slam_settings_without_a_size_take_that_of_the_images() {
    let folder = Folder::new();
    let settings = "%YAML:1.0\n\nCamera.fx: 517.3\nCamera.fy: 516.5\nCamera.cx: 318.6\nCamera.cy: 255.3\n\
        Camera.k1: 0.2624\nCamera.k2: -0.9531\nCamera.p1: -0.0054\nCamera.p2: 0.0026\nCamera.k3: 1.1633\n\
        Camera.fps: 30.0\nCamera.RGB: 1\n";
    let path = folder.write("TUM1.yaml", settings);
    assert!(read_rig(&path).unwrap_err().to_string().contains("Camera.width"));
    let rig = read_rig_for(&path, Some([640, 480])).unwrap();
    let camera = rig.cameras[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx), (640, 480, 517.3));
    assert_eq!(camera.distortion, Distortion::RadialTangential([0.2624, -0.9531, -0.0054, 0.0026, 1.1633]));
}

#[test]
fn stella_vslam_configurations_are_read() {
    let folder = Folder::new();
    let camera = |setup: &str, more: &str| {
        format!(
            "# of stella_vslam\nCamera:\n  name: \"here\"\n  setup: \"{setup}\"\n  model: \"perspective\"\n\n  fx: 458.654\n  \
             fy: 457.296\n  cx: 367.215\n  cy: 248.375\n\n  k1: -0.28340811\n  k2: 0.07395907\n  p1: 0.00019359\n  \
             p2: 1.76187114e-05\n  k3: 0.0\n\n  fps: 20.0\n  cols: 752\n  rows: 480\n{more}\n  color_order: \"Gray\"\n\n\
             Preprocessing:\n  min_size: 800\n  depthmap_factor: 5000.0\n"
        )
    };
    let rig = read_rig(folder.write("mono.yaml", camera("monocular", ""))).unwrap();
    let c = rig.cameras[0].camera;
    assert_eq!((rig.cameras.len(), c.width, c.height, c.fy), (1, 752, 480, 457.296));
    assert!(matches!(c.distortion, Distortion::RadialTangential(k) if k[0] == -0.283_408_11));
    let rig = read_rig(folder.write("rgbd.yaml", camera("RGBD", ""))).unwrap();
    assert!((rig.depth.unwrap().metres_per_unit - 0.0002).abs() < 1e-12);
    let stereo = camera("stereo", "  focal_x_baseline: 47.90639384423901");
    let rig = read_rig(folder.write("stereo.yaml", &stereo)).unwrap();
    assert!((rig.cameras[1].body_from_camera.translation.x - 0.104_450).abs() < 1e-5);
    // A rotation of both by the same angle leaves the baseline as long as it is, and turns it.
    let (s, co) = (0.1f64.sin(), 0.1f64.cos());
    let raw = format!(
        "{stereo}\nStereoRectifier:\n  model: \"perspective\"\n  K_left: [458.0, 0, 367.0, 0, 457.0, 248.0, 0, 0, 1]\n  \
         D_left: [-0.28, 0.07, 0.0, 0.0, 0.0]\n  R_left: [{co}, 0, {s}, 0, 1, 0, {0}, 0, {co}]\n  \
         K_right: [457.0, 0, 379.0, 0, 456.0, 255.0, 0, 0, 1]\n  D_right: [-0.28, 0.07, 0.0, 0.0, 0.0]\n  \
         R_right: [{co}, 0, {s}, 0, 1, 0, {0}, 0, {co}]\n",
        -s
    );
    let rig = read_rig(folder.write("raw.yaml", raw)).unwrap();
    let arm = rig.cameras[1].body_from_camera;
    assert!((arm.translation.norm() - 0.104_450).abs() < 1e-5 && arm.rotation.angle() < 1e-9);
    assert!((arm.translation.z / arm.translation.x - 0.1f64.tan()).abs() < 1e-9, "{arm:?}");
    assert_eq!((rig.cameras[0].camera.fx, rig.cameras[1].camera.cx), (458.0, 379.0));
    // Flat keys, as OpenVSLAM had them.
    let flat = "Camera.setup: \"monocular\"\nCamera.model: \"fisheye\"\nCamera.fx: 300\nCamera.fy: 300\nCamera.cx: 320\n\
        Camera.cy: 240\nCamera.k1: 0.01\nCamera.k2: 0.02\nCamera.k3: 0.03\nCamera.k4: 0.04\nCamera.cols: 640\nCamera.rows: 480\n";
    let rig = read_rig(folder.write("flat.yaml", flat)).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Equidistant([0.01, 0.02, 0.03, 0.04]));
    for (from, to, why) in [
        ("perspective", "equirectangular", "cut a perspective view out"),
        ("monocular", "quartet", "is not known"),
        ("fx: 458.654", "fx: far", "line 7"),
        ("  cols: 752\n", "", "Camera.cols"),
    ] {
        let text = camera("monocular", "").replacen(from, to, 1);
        let error = read_rig(folder.write("wrong.yaml", text)).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
}

/// The YAML of `camera_calibration`.
fn camera_info(fx: f64, baseline: f64, model: &str, d: &str) -> String {
    let count = d.split(',').count();
    format!(
        "image_width: 640\nimage_height: 480\ncamera_name: narrow\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
         data: [{fx}, 0., 320.5, 0., {fx}, 240.5, 0., 0., 1.]\ndistortion_model: {model}\ndistortion_coefficients:\n  \
         rows: 1\n  cols: {count}\n  data: [{d}]\nrectification_matrix:\n  rows: 3\n  cols: 3\n  \
         data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\nprojection_matrix:\n  rows: 3\n  cols: 4\n  \
         data: [500., 0., 320., {}, 0., 500., 240., 0., 0., 0., 1., 0.]\n",
        -500.0 * baseline
    )
}

#[test]
fn ros_camera_info_is_read_alone_and_as_a_pair() {
    let folder = Folder::new();
    let left = folder.write("left.yaml", camera_info(430.0, 0.0, "plumb_bob", "-0.3, 0.1, 0.001, 0.002, 0."));
    let rig = read_rig(&left).unwrap();
    let c = rig.cameras[0].camera;
    assert_eq!((rig.cameras.len(), c.width, c.height, c.fx, c.cx), (1, 640, 480, 430.0, 320.5));
    assert_eq!(c.distortion, Distortion::RadialTangential([-0.3, 0.1, 0.001, 0.002, 0.0]));
    folder.write("right.yaml", camera_info(431.0, 0.12, "plumb_bob", "0, 0, 0, 0, 0"));
    let rig = read_rig(&left).unwrap();
    assert_eq!(rig.cameras[1].camera.distortion, Distortion::None);
    assert!((rig.cameras[1].body_from_camera.translation.x - 0.12).abs() < 1e-12);
    folder.write("right.yaml", camera_info(431.0, 0.0, "plumb_bob", "0, 0, 0, 0, 0"));
    assert!(read_rig(&left).unwrap_err().to_string().contains("no baseline"));
    // A message as `ros2 topic echo` prints it.
    let message = "header:\n  frame_id: cam\nheight: 480\nwidth: 640\ndistortion_model: equidistant\nd:\n- 0.1\n- 0.2\n- 0.3\n- 0.4\nk:\n\
        - 300.0\n- 0.0\n- 320.0\n- 0.0\n- 301.0\n- 240.0\n- 0.0\n- 0.0\n- 1.0\nbinning_x: 0\n";
    let rig = read_rig(folder.write("info.yaml", message)).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]));
    let rational = camera_info(430.0, 0.0, "rational_polynomial", "1, 2, 3, 4, 5, 6, 7, 8");
    let rig = read_rig(folder.write("rational.yaml", rational)).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Rational([1., 2., 3., 4., 5., 6., 7., 8.]));
    for (model, d, why) in [
        ("plumb_bob", "1, 2, 3, 4, 5, 6", "more than the lens model has"),
        ("equidistant", "1, 2", "is not known"),
        ("thin_glass", "1, 2, 3, 4", "thin_glass"),
    ] {
        let error = read_rig(folder.write("wrong.yaml", camera_info(430.0, 0.0, model, d))).unwrap_err();
        assert!(error.to_string().contains(why), "{error}");
    }
}

#[test]
fn a_pipe_is_no_source() {
    if cfg!(unix) {
        let folder = Folder::new();
        let path = folder.path().join("pipe.mp4");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let text = refused(path.to_str().unwrap(), OpenOptions::default());
        assert!(text.contains("a device or a pipe"), "{text}");
    }
}

#[test]
fn kitti_raw_has_its_times_as_dates_and_its_calibration_above() {
    let folder = Folder::new();
    for k in 0..3 {
        folder.write(&format!("drive/image_00/data/000000000{k}.png"), gray_png(8, 6, k));
        folder.write(&format!("drive/image_01/data/000000000{k}.png"), gray_png(8, 6, k));
    }
    let times =
        "2011-09-26 13:02:25.000000000\n2011-09-26 13:02:25.103700000\n2011-09-26 13:02:25.207300000\n";
    folder.write("drive/image_00/timestamps.txt", times);
    folder.write(
        "calib_cam_to_cam.txt",
        "calib_time: 09-Jan-2012 13:57:47\nP_rect_00: 7 0 4 0 0 7 3 0 0 0 1 0\nP_rect_01: 7 0 4 -3.5 0 7 3 0 0 0 1 0\n",
    );
    let drive = folder.path().join("drive");
    let mut source = open(drive.to_str().unwrap(), OpenOptions::default()).unwrap();
    assert_eq!(source.rig().cameras.len(), 2);
    assert!((source.rig().cameras[1].body_from_camera.translation.x - 0.5).abs() < 1e-12);
    let stamps = packets(&mut *source);
    assert_eq!((stamps[0], stamps[1] - stamps[0]), (1_317_042_145_000_000_000, 103_700_000));
}

#[test]
fn replica_scannet_stray_scanner_and_record3d_are_read() {
    let turned = "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n";
    let line = turned.replace('\n', " ");
    let replica = Folder::new();
    for k in 0..2 {
        replica.write(&format!("office0/results/frame00000{k}.png"), gray_png(8, 6, k));
        replica.write(&format!("office0/results/depth00000{k}.png"), depth_png(8, 6, 1, 6553));
    }
    replica.write("office0/traj.txt", format!("{line}\n{line}\n"));
    let camera =
        r#"{"camera": {"w": 8, "h": 6, "fx": 7.0, "fy": 7.0, "cx": 3.5, "cy": 2.5, "scale": 6553.5}}"#;
    replica.write("cam_params.json", camera);
    let scannet = Folder::new();
    for k in [0, 1, 10] {
        scannet.write(&format!("color/{k}.png"), gray_png(16, 12, k));
        scannet.write(&format!("depth/{k}.png"), depth_png(8, 6, 1, 2000));
        let pose = if k == 1 { "-inf ".repeat(16) } else { turned.to_owned() };
        scannet.write(&format!("pose/{k}.txt"), pose);
    }
    let matrix = |f: f64| format!("{f} 0 4 0\n0 {f} 3 0\n0 0 1 0\n0 0 0 1\n");
    scannet.write("intrinsic/intrinsic_color.txt", matrix(14.0));
    scannet.write("intrinsic/intrinsic_depth.txt", matrix(7.0));
    let stray = Folder::new();
    stray.write("camera_matrix.csv", "14.0, 0.0, 8.0\n0.0, 14.0, 6.0\n0.0, 0.0, 1.0\n");
    stray.write("odometry.csv", "timestamp, frame, x, y, z, qx, qy, qz, qw\n5.5, 000000, 0, 0, 0, 0, 0, 0, 1\n5.6, 000001, 0, 0, 0, 0, 0, 0, 1\n");
    stray.write("rgb.mp4", "a film");
    for k in 0..2 {
        stray.write(&format!("depth/00000{k}.png"), depth_png(8, 6, 1, 2000));
    }
    let text = refused(stray.name(), OpenOptions::default());
    assert!(text.contains("rgb.mp4") && text.contains("ffmpeg -noautorotate -i"), "{text}");
    for k in 0..2 {
        stray.write(&format!("rgb/00000{k}.png"), gray_png(16, 12, k));
    }
    let record3d = Folder::new();
    record3d
        .write("metadata.json", r#"{"w": 8, "h": 6, "K": [7.0, 0, 0, 0, 7.5, 0, 4.0, 3.0, 1], "fps": 60}"#);
    (0..2).for_each(|k| drop(record3d.write(&format!("rgb/{k}.png"), gray_png(8, 6, k))));

    let play = |path: std::path::PathBuf| {
        let mut source =
            open(path.to_str().unwrap(), OpenOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        let (rig, truth) = (source.rig().clone(), source.info().truth.clone());
        let packets: Vec<_> = std::iter::from_fn(|| source.next_packet().unwrap()).collect();
        (rig, truth, packets)
    };
    let (rig, truth, frames) = play(replica.path().join("office0"));
    assert_eq!((frames.len(), truth.len(), rig.depth.unwrap().metres_per_unit), (2, 2, 1.0 / 6553.5));
    assert!(frames[0].depth.is_some() && (truth[0].1.translation.z - 3.0).abs() < 1e-12);
    let (rig, truth, frames) = play(scannet.path().to_owned());
    assert_eq!((frames.len(), truth.len()), (3, 2), "a pose that is not finite is not known");
    assert_eq!(frames[2].stamp.0, 333_333_333);
    let depth = rig.depth.unwrap();
    assert_eq!((depth.camera.fx, depth.camera.width, depth.registered), (7.0, 8, false));
    let (rig, _, frames) = play(stray.path().to_owned());
    assert_eq!((frames[0].stamp.0, frames[1].stamp.0), (5_500_000_000, 5_600_000_000));
    let depth = rig.depth.unwrap();
    // The centre of a pixel twice as large lies between those of four.
    assert_eq!((depth.camera.fx, depth.camera.cx, depth.camera.cy), (7.0, 3.75, 2.75));
    let (rig, _, frames) = play(record3d.path().to_owned());
    assert_eq!((frames.len(), rig.cameras[0].camera.fy, rig.cameras[0].camera.cx), (2, 7.5, 4.0));
}

#[test]
fn tum_is_read_as_others_write_it() {
    // Without lists, by the names of the images; with a calibration as ETH3D has it; with names of Windows; as BMP.
    let folder = Folder::new();
    for name in ["rgb/1.00.png", "rgb/1.10.png"] {
        folder.write(name, gray_png(8, 6, 0));
        folder.write(&name.replace("rgb", "depth"), depth_png(8, 6, 1, 5000));
    }
    folder.write("calibration.txt", "7.25 7.5 4 3\n");
    let source = opened(&folder, OpenOptions::default());
    assert_eq!((source.rig().cameras[0].camera.fx, source.rig().cameras[0].camera.width), (7.25, 8));
    let stamps = packets(&mut *opened(&folder, OpenOptions::default()));
    assert_eq!(stamps, [1_000_000_000, 1_100_000_000]);
    folder.write("rgb.txt", "1.00 rgb\\1.00.png\n1.10 rgb\\1.10.png\n");
    folder.write("depth.txt", "1.00 depth\\1.00.png\n");
    let mut source = opened(&folder, OpenOptions::default());
    assert!(source.next_packet().unwrap().unwrap().depth.is_some());
    assert!(source.next_packet().unwrap().unwrap().depth.is_none());
    folder.remove("rgb.txt");
    folder.remove("depth.txt");
    folder.write("color.txt", "1.00 rgb/1.00.png\n1.10 rgb/1.10.png\n");
    folder.write("aligned_depth.txt", "1.00 depth/1.00.png\n");
    assert!(opened(&folder, OpenOptions::default()).next_packet().unwrap().unwrap().depth.is_some());
}

/// What is doubted of a folder of TUM's layout with this depth image of 320x240 pixels.
fn doubts_of_depth(depth: &[u8]) -> String {
    let folder = Folder::new();
    folder.write("rgb.txt", "1.0 rgb/a.png\n2.0 rgb/b.png\n");
    folder.write("depth.txt", "1.0 depth/a.png\n2.0 depth/b.png\n");
    folder.write("calibration.txt", "250 250 160 120\n");
    for name in ["a", "b"] {
        folder.write(&format!("rgb/{name}.png"), gray_png(320, 240, 0));
        folder.write(&format!("depth/{name}.png"), depth);
    }
    let mut source = opened(&folder, OpenOptions::default());
    packets(&mut *source);
    source.skipped().join(" ")
}

#[test]
fn depth_in_millimetres_where_a_fifth_of_one_is_usual_is_told() {
    let told = |value: u16| doubts_of_depth(&depth_png(320, 240, 1, value));
    // 1.2 m in millimetres, and in units of a fifth of one.
    let (wrong, right) = (told(1200), told(6000));
    assert!(wrong.contains("nearer than 0.24 m") && wrong.contains("metres_per_unit = 0.001"), "{wrong}");
    assert!(right.is_empty(), "{right}");
    // A room of 2.5 m, whose nearest depth could be that of a camera in either unit.
    let (wrong, right) = (told(2500), told(12500));
    assert!(wrong.contains("nearly all of it is nearer than 0.50 m") && wrong.contains("2.50 m"), "{wrong}");
    assert!(right.is_empty(), "{right}");
}

#[test]
fn depth_of_a_hall_in_millimetres_is_told_by_the_steps_in_which_a_camera_measures() {
    // Depths of 2 to 9 m as a camera gives them that measures disparity in steps: focal length times baseline times steps a pixel.
    let told = |steps_m: f64, units_in_m: f64| {
        let of = |k: usize| (steps_m / (steps_m / 9.0 + k as f64 * 0.05).round() * units_in_m).round() as u16;
        let all: Vec<u16> = (0..320 * 240).map(|i| of(i % (7.0 * steps_m / 18.0 / 0.05) as usize)).collect();
        let bytes: Vec<u8> = all.iter().flat_map(|v| v.to_be_bytes()).collect();
        doubts_of_depth(&common::png(320, 240, png::ColorType::Grayscale, png::BitDepth::Sixteen, &bytes))
    };
    let (kinect, realsense) = (580.0 * 0.075 * 8.0, 425.0 * 0.05 * 32.0);
    for (camera, by_mm) in [(kinect, "2.9 mm"), (realsense, "1.5 mm")] {
        let wrong = told(camera, 1000.0);
        assert!(wrong.contains("five times too small") && wrong.contains(by_mm), "{by_mm}: {wrong}");
        assert_eq!(told(camera, 5000.0), "", "{by_mm} at 5000 units a metre");
    }
}

#[test]
fn times_in_another_unit_than_the_layout_s_are_an_error() {
    for (step, unit) in [(33.0, "milliseconds"), (33_000.0, "microseconds"), (33e6, "nanoseconds")] {
        let folder = Folder::new();
        let lines: String =
            (0..9).map(|k| format!("{:.0} rgb/{k}.png\n", 1.0e9 + step * f64::from(k))).collect();
        folder.write("rgb.txt", lines);
        (0..9).for_each(|k| drop(folder.write(&format!("rgb/{k}.png"), gray_png(8, 6, k))));
        let text = refused(folder.name(), with_rig());
        assert!(
            text.contains("the times are in another unit") && text.contains("--number-frames"),
            "{unit}: {text}"
        );
    }
}

#[test]
fn times_that_do_not_go_forward_are_an_error_that_says_what_they_look_like() {
    let list = |stamps: &[f64]| {
        let folder = Folder::new();
        let lines: String = stamps.iter().enumerate().map(|(k, s)| format!("{s:.1} rgb/{k}.png\n")).collect();
        folder.write("rgb.txt", lines);
        (0..stamps.len()).for_each(|k| drop(folder.write(&format!("rgb/{k}.png"), gray_png(8, 6, k as u8))));
        folder
    };
    let reversed: Vec<f64> = (0..9).rev().map(f64::from).collect();
    let again: Vec<f64> = (0..40).map(|k| f64::from(k % 8)).collect();
    // Nine, ninety and nine hundred in the order of text: of ten more are lost than stay.
    let mut text: Vec<u32> = (1..=12).collect();
    text.sort_by_key(|n| n.to_string());
    let text: Vec<f64> = text.into_iter().map(f64::from).collect();
    for (stamps, word) in [
        (&reversed, "in reverse"),
        (&again, "begin anew 4 times"),
        (&text, "in the order of text, 10 before 9"),
    ] {
        let folder = list(stamps);
        let text = refused(folder.name(), with_rig());
        assert!(text.contains(word) && text.contains("--number-frames"), "{text}");
        let numbered = OpenOptions { number_frames_hz: Some(10.0), ..with_rig() };
        let found = packets(&mut *opened(&folder, numbered));
        assert_eq!(found, (0..stamps.len() as i64).map(|k| k * 100_000_000).collect::<Vec<_>>());
    }
}

#[test]
fn a_tenth_of_times_that_do_not_go_forward_is_told_with_what_they_look_like() {
    let folder = Folder::new();
    let mut lines = String::new();
    for k in 0..40 {
        folder.write(&format!("rgb/{k}.png"), gray_png(8, 6, k));
        // The last eight are the first again.
        lines += &format!("{}.5 rgb/{k}.png\n", if k < 32 { k } else { k - 32 });
    }
    folder.write("rgb.txt", lines);
    let mut source = opened(&folder, with_rig());
    let told = source.skipped().join(" ");
    assert!(told.contains("8 of its 40 images") && told.contains("begin anew 1 times"), "{told}");
    assert!(told.contains("--number-frames"), "{told}");
    assert_eq!(packets(&mut *source).len(), 32);
}

#[test]
fn a_bitmap_is_an_image() {
    let folder = Folder::new();
    let mut bytes = b"BM".to_vec();
    let words = [86u32, 0, 54, 40, 4, 2, 24 << 16 | 1, 0, 32, 0, 0, 0, 0];
    bytes.extend(words.iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend((0..24).map(|k| 10 * (k / 3)));
    folder.write("a.bmp", &bytes);
    folder.write("b.bmp", &bytes);
    let rig = Some(Rig::mono(Camera::pinhole(4, 2, 3.0, 3.0, 2.0, 1.0)));
    let mut source = opened(&folder, OpenOptions { rig, ..OpenOptions::default() });
    let packet = source.next_packet().unwrap().unwrap();
    assert_eq!(packet.images[0].data(), [40, 50, 60, 70, 0, 10, 20, 30]);
}

#[test]
fn pictures_of_fewer_bits_than_sixteen_are_not_black_and_it_is_told() {
    use png::{BitDepth, ColorType};
    let folder = |colour: ColorType, samples: usize, values: [u16; 2]| {
        let folder = Folder::new();
        for k in 0..20 {
            // Most are darker than the brightest, which decides for all.
            let value = if k == 10 { values[1] } else { values[0] };
            let data: Vec<u8> = (0..48 * samples).flat_map(|_| value.to_be_bytes()).collect();
            folder.write(&format!("{k}.png"), common::png(8, 6, colour, BitDepth::Sixteen, &data));
        }
        folder
    };
    for (colour, samples, values, bits, gray) in [
        (ColorType::Grayscale, 1, [512, 1023], 10, 128),
        (ColorType::Rgb, 3, [2048, 4000], 12, 128),
        (ColorType::Grayscale, 1, [100, 255], 8, 100),
        (ColorType::Grayscale, 1, [128 << 8, 255 << 8], 16, 128),
    ] {
        let folder = folder(colour, samples, values);
        let mut source = opened(&folder, OpenOptions::default());
        assert_eq!(source.next_packet().unwrap().unwrap().images[0].at(3, 3), gray, "{bits} bits");
        let told = source.skipped().join(" ");
        assert_eq!(
            told.contains(&format!("of the 16 bits of a pixel {bits} are in use")),
            bits < 16,
            "{told}"
        );
    }
}

#[test]
fn an_android_phones_sensors_are_joined_in_its_axes() {
    let folder = Folder::new();
    folder.write("images/frame_1.png", gray_png(8, 6, 1));
    folder.write("images/frame_2.png", gray_png(8, 6, 2));
    folder.write("frames.csv", "# time, file\n1000000000,frame_1.png\n1040000000,frame_2.png\n");
    let lines = |from_ms: i64, value: fn(i64) -> String| -> String {
        (0..14).map(|k| from_ms + 5 * k).map(|ms| format!("{},{}\n", ms * 1_000_000, value(ms))).collect()
    };
    folder.write("gyroscope.csv", lines(990, |ms| format!("0.1,0,{ms}")));
    folder.write("accelerometer.csv", "# x, y, z\n".to_owned() + &lines(992, |ms| format!("0,9.8,{ms}")));
    let mut source = opened(&folder, OpenOptions::default());
    assert!(source.info().assumed.as_ref().is_some_and(|what| what.contains("focal length")));
    let rig = source.rig().clone();
    assert!(rig.imu.as_ref().is_some_and(|imu| (imu.rate_hz - 200.0).abs() < 1e-6));
    // Up along the phone is to the left in the picture of its rear camera.
    let up = rig.cameras[0].body_from_camera.inverse().rotation * cairn_geometry::Vec3::y();
    assert!((up + cairn_geometry::Vec3::x()).norm() < 1e-9, "{up}");
    let first = source.next_packet().unwrap().expect("a packet");
    let second = source.next_packet().unwrap().expect("a packet");
    assert_eq!((first.stamp.0, first.images[0].data()[0]), (1_000_000_000, 1));
    let samples: Vec<_> = first.imu.iter().chain(&second.imu).filter(|s| !s.is_synthesised()).collect();
    assert!(samples.len() >= 9, "{}", samples.len());
    for s in samples {
        let ms = 1e3 * s.stamp.seconds();
        assert!((s.gyro.z - ms).abs() < 1e-6 && (s.accel.z - ms).abs() < 1e-6, "{s:?}");
    }
    folder.write("gyroscope.csv", "# nothing\n");
    let text = refused(folder.name(), OpenOptions::default());
    assert!(text.contains("gyroscope.csv") && text.contains("contains no sample"), "{text}");
}
