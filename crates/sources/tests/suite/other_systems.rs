//! Calibrations as other systems publish them, with what is odd in their files.

use crate::common;

use cairn_geometry::Vec3;
use cairn_sensor::{Camera, Distortion};
use cairn_sources::{assumed_in, read_rig};
use common::Folder;

fn refused(name: &str, text: &str) -> String {
    let folder = Folder::new();
    read_rig(folder.write(name, text)).expect_err(text).to_string()
}

#[test]
fn cameras_of_svos_first_version() {
    let folder = Folder::new();
    let pinhole = "cam_model: Pinhole\ncam_width: 752\ncam_height: 480\ncam_fx: 414.5\ncam_fy: 414.25\ncam_cx: 348.8\ncam_cy: 240.0\n\
        cam_d0: -0.28\ncam_d1: 0.06\ncam_d2: 0.0009\ncam_d3: 0.0007\n";
    let camera = read_rig(folder.write("camera_pinhole.yaml", pinhole)).unwrap().cameras[0].camera;
    let lens = Distortion::RadialTangential([-0.28, 0.06, 0.0009, 0.0007, 0.0]);
    assert_eq!(camera, Camera { distortion: lens, ..Camera::pinhole(752, 480, 414.5, 414.25, 348.8, 240.0) });
    // PTAM's: shares of the sides, from the corner of the first pixel.
    let atan = "cam_model: ATAN\ncam_width: 640\ncam_height: 480\ncam_fx: 1.0\ncam_fy: 1.5\ncam_cx: 0.5\ncam_cy: 0.5\ncam_d0: 0.9\n";
    let camera = read_rig(folder.write("camera_atan.yaml", atan)).unwrap().cameras[0].camera;
    assert_eq!(
        camera,
        Camera { distortion: Distortion::Fov(0.9), ..Camera::pinhole(640, 480, 640.0, 720.0, 319.5, 239.5) }
    );
    let ocam = refused(
        "camera.yaml",
        "cam_model: Ocam\ncam_width: 640\ncam_height: 480\ncam_fx: 1\ncam_fy: 1\ncam_cx: 1\ncam_cy: 1\n",
    );
    assert!(ocam.contains("Ocam") && ocam.contains("Pinhole and ATAN are"), "{ocam}");
}

#[test]
fn svo_leaves_a_last_row_zero_and_a_lens_of_scaramuzzas_is_refused_with_a_way_out() {
    let svo = |kind: &str, row: &str| {
        format!(
            "cameras:\n- camera:\n    distortion:\n      parameters: {{cols: 1, rows: 1, data: [0.93]}}\n      type: fisheye\n    image_height: 480\n    \
             image_width: 752\n    intrinsics: {{cols: 1, rows: 4, data: [383.0, 382.5, 344.5, 244.25]}}\n    label: cam\n    type: {kind}\n  \
             T_B_C:\n    cols: 4\n    rows: 4\n    data: [1, 0, 0, 0,\n           0, 1, 0, 0.5,\n           0, 0, 1, 0,\n           {row}]\nlabel: test\n"
        )
    };
    let folder = Folder::new();
    let rig = read_rig(folder.write("calib.yaml", svo("pinhole", "0, 0, 0, 0"))).unwrap();
    assert_eq!(rig.cameras[0].body_from_camera.translation, Vec3::new(0.0, 0.5, 0.0));
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Fov(0.93));
    assert!(refused("calib.yaml", &svo("pinhole", "0, 0, 1, 0")).contains("the last row must be 0 0 0 1"));
    let omni = refused("calib.yaml", &svo("omni", "0, 0, 0, 1"));
    assert!(omni.contains("omni") && omni.contains("calibrate") && omni.contains("Kalibr"), "{omni}");
}

#[test]
fn nice_slam_inherits_its_camera_from_a_folder_above() {
    let folder = Folder::new();
    let scene = folder.write(
        "configs/ScanNet/scene0000.yaml",
        "inherit_from: configs/ScanNet/scannet.yaml\nmapping:\n  bound: [[-2.0,11.0],[-2.0,11.5],[-2.0,5.5]]\n",
    );
    let error = read_rig(&scene).unwrap_err().to_string();
    assert!(error.contains("configs/ScanNet/scannet.yaml, is in no folder above"), "{error}");
    folder.write(
        "configs/ScanNet/scannet.yaml",
        "dataset: 'scannet'\ncam: \n  H: 480 \n  W: 640\n  fx: 577.5\n  fy: 578.5\n  cx: 318.5\n  cy: 242.5\n  png_depth_scale: 1000. #for depth image in png format\n  crop_edge: 10",
    );
    let rig = read_rig(&scene).unwrap();
    assert_eq!((rig.cameras[0].camera.fy, rig.depth.unwrap().metres_per_unit), (578.5, 0.001));
    let round = folder.write("a.yaml", "inherit_from: a.yaml\n");
    assert!(read_rig(round).unwrap_err().to_string().contains("inherits from"));
}

#[test]
fn camodocals_full_pinhole_and_colmaps_cameras() {
    let folder = Folder::new();
    let full = "%YAML:1.0\n---\nmodel_type: PINHOLE_FULL\ncamera_name: camera\nimage_width: 640\nimage_height: 480\ndistortion_parameters:\n   \
        k1: 0.1\n   k2: 0.2\n   k3: 0.3\n   k4: 0.4\n   k5: 0.5\n   k6: 0.6\n   p1: 0.01\n   p2: 0.02\nprojection_parameters:\n   fx: 500\n   fy: 501\n   cx: 320\n   cy: 240\n";
    let camera = read_rig(folder.write("full.yaml", full)).unwrap().cameras[0].camera;
    assert_eq!(camera.distortion, Distortion::Rational([0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.6]));
    let head = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 1\n";
    for (line, f, c, distortion) in [
        ("1 SIMPLE_PINHOLE 640 480 500 320 240", [500.0; 2], [319.5, 239.5], Distortion::None),
        (
            "1 SIMPLE_RADIAL 640 480 500 320 240 -0.1",
            [500.0; 2],
            [319.5, 239.5],
            Distortion::RadialTangential([-0.1, 0.0, 0.0, 0.0, 0.0]),
        ),
        (
            "3 OPENCV 640 480 500 510 320 240 1 2 3 4",
            [500.0, 510.0],
            [319.5, 239.5],
            Distortion::RadialTangential([1.0, 2.0, 3.0, 4.0, 0.0]),
        ),
        (
            "1 OPENCV_FISHEYE 640 480 500 510 320 240 0.1 0.2 0.3 0.4",
            [500.0, 510.0],
            [319.5, 239.5],
            Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]),
        ),
    ] {
        let camera =
            read_rig(folder.write("cameras.txt", format!("{head}{line}\n"))).unwrap().cameras[0].camera;
        assert_eq!(
            camera,
            Camera { distortion, ..Camera::pinhole(640, 480, f[0], f[1], c[0], c[1]) },
            "{line}"
        );
    }
    let two = format!("{head}1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 500 500 320 240\n");
    assert!(refused("cameras.txt", &two).contains("holds 2 cameras of COLMAP"));
    let wrong = refused("cameras.txt", "1 PINHOLE 640 480 500 320 240\n");
    assert!(wrong.contains("PINHOLE with 3 parameters") && wrong.contains("line 1"), "{wrong}");
    assert!(refused("cameras.txt", "1 THIN_PRISM_FISHEYE 640 480 1 2 3 4\n").contains("is not known"));
}

#[test]
fn a_negative_fy_is_a_camera_with_y_up_and_is_told() {
    let folder = Folder::new();
    let orb = "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera.fx: 481.2\nCamera.fy: -480.0\nCamera.cx: 319.5\nCamera.cy: 239.5\nCamera.width: 640\nCamera.height: 480\n";
    let own = "[[cameras]]\nresolution = [640, 480]\nfocal = [481.2, -480.0]\ncentre = [319.5, 239.5]\n";
    let kalibr =
        "cam0: {camera_model: pinhole, intrinsics: [481.2, -480.0, 319.5, 239.5], resolution: [640, 480]}\n";
    let nice = "cam:\n  H: 480\n  W: 640\n  fx: 481.2\n  fy: -480.0\n  cx: 319.5\n  cy: 239.5\n  png_depth_scale: 5000.0\n";
    for (name, text) in [("orb.yaml", orb), ("own.toml", own), ("kalibr.yaml", kalibr), ("nice.yaml", nice)] {
        let path = folder.write(name, text);
        assert_eq!(
            read_rig(&path).unwrap().cameras[0].camera,
            Camera::pinhole(640, 480, 481.2, 480.0, 319.5, 239.5),
            "{name}"
        );
        let told = assumed_in(&path).unwrap_or_default();
        assert!(told.contains("negative focal length along y"), "{name}: {told}");
        let usual = folder.write(name, text.replace("-480", "480"));
        assert_eq!(assumed_in(usual), None, "{name}");
    }
}

#[test]
fn a_chain_of_msckf_without_an_imu_file_says_that_the_imu_is_left_out() {
    let folder = Folder::new();
    let flat =
        "[1.0, 0.0, 0.0, 0.05,\n    0.0, 1.0, 0.0, 0.0,\n    0.0, 0.0, 1.0, 0.0,\n    0.0, 0.0, 0.0, 1.0]";
    let chain = format!(
        "# The modifications of the output file from Kalibr:\ncam0:\n  T_cam_imu:\n    {flat}\n  camera_model: pinhole\n  \
         distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]\n  distortion_model: radtan\n  intrinsics: [458.5, 457.5, 367.5, 248.5]\n  \
         resolution: [752, 480]\n  timeshift_cam_imu: 0.01\nT_imu_body:\n  {flat}\n"
    );
    let path = folder.write("camchain-imucam-msckf.yaml", chain);
    let rig = read_rig(&path).unwrap();
    assert_eq!((rig.cameras[0].body_from_camera.translation.x, rig.imu.is_some()), (-0.05, false));
    assert!(assumed_in(&path).unwrap().contains("the IMU is left out"));
    folder.write(
        "imu0.yaml",
        "accelerometer_noise_density: 0.02\naccelerometer_random_walk: 0.003\ngyroscope_noise_density: 0.002\ngyroscope_random_walk: 0.00002\nupdate_rate: 200\n",
    );
    assert_eq!((read_rig(&path).unwrap().imu.unwrap().offset_s, assumed_in(&path)), (-0.01, None));
}

#[test]
fn values_that_no_sensor_has_are_refused_or_doubted_whatever_the_file() {
    let folder = Folder::new();
    let orb = |more: &str| {
        format!(
            "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera.fx: 500\nCamera.fy: 500\nCamera.cx: 320\nCamera.cy: 240\nCamera.width: 640\nCamera.height: 480\n{more}"
        )
    };
    let said = |text: &str| match read_rig(folder.write("orb.yaml", text)) {
        Ok(rig) => rig.doubts().join(" "),
        Err(error) => error.to_string(),
    };
    for factor in ["1e308", "1e-4", "-5000", "1e309", "nan", "0.5e10"] {
        assert!(!said(&orb(&format!("DepthMapFactor: {factor}\n"))).is_empty(), "DepthMapFactor: {factor}");
    }
    assert!(
        said(&orb("DepthMapFactor: 5000\n")).is_empty() && said(&orb("DepthMapFactor: 1000.0\n")).is_empty()
    );
    for (from, to) in [
        ("Camera.fx: 500", "Camera.fx: 1e308"),
        ("Camera.fx: 500", "Camera.fx: 0.5"),
        ("Camera.cx: 320", "Camera.cx: 1e308"),
        ("Camera.cx: 320", "Camera.cx: 0.5"),
        ("Camera.width: 640", "Camera.width: 1e308"),
        ("Camera.width: 640", "Camera.width: 640.5"),
        ("Camera.height: 480", "Camera.height: -480"),
        ("\nCamera.fy", "\nCamera.k1: 1e308\nCamera.fy"),
        ("\nCamera.fy", "\nCamera.bf: 1e308\nCamera.fy"),
        ("\nCamera.fy", "\nCamera.bf: -40\nCamera.fy"),
    ] {
        assert!(!said(&orb("").replace(from, to)).is_empty(), "{to}");
    }
}
