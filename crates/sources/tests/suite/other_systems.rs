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
    assert!(ocam.contains("Ocam") && ocam.contains("Scaramuzza") && ocam.contains("Kalibr"), "{ocam}");
}

#[test]
fn cameras_of_vikit_under_their_names_with_places_in_both_directions() {
    let folder = Folder::new();
    let camera = |name: &str, model: &str, numbers: &str, place: &str| {
        format!("{name}:\n  cam_model: {model}\n  cam_width: 752\n  cam_height: 480\n{numbers}{place}")
    };
    let numbers = "  cam_fx: 463\n  cam_fy: 462\n  cam_cx: 361\n  cam_cy: 231\n  cam_d0: 0.1\n  cam_d1: 0.2\n  cam_d2: 0.3\n  cam_d3: 0.4\n";
    // Half a turn about z; the camera is 0.2 m along x of the IMU in both.
    let imu_cam = "  T_imu_cam: {tx: 0.2, ty: 0, tz: 0.1, qx: 0, qy: 0, qz: 1, qw: 0}\n";
    let cam_imu = "  T_cam_imu:\n    tx: 0.2\n    ty: 0.0\n    tz: -0.1\n    qx: 0.0\n    qy: 0.0\n    qz: 1.0\n    qw: 0.0\n";
    let lens = Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]);
    for place in [imu_cam, cam_imu] {
        let path = folder.write("vikit.yaml", camera("cam0", "PinholeEquidistant", numbers, place));
        let rig = read_rig(&path).unwrap();
        assert_eq!(
            rig.cameras[0].camera,
            Camera { distortion: lens, ..Camera::pinhole(752, 480, 463.0, 462.0, 361.0, 231.0) }
        );
        let off = rig.cameras[0].body_from_camera.translation - Vec3::new(0.2, 0.0, 0.1);
        assert!(off.norm() < 1e-12, "{off}");
        let along_x = rig.cameras[0].body_from_camera.rotation * Vec3::x();
        assert!((along_x + Vec3::x()).norm() < 1e-12, "{along_x}");
        assert!(assumed_in(&path).unwrap().contains("the IMU is left out"));
    }
    let atan = "  cam_fx: 0.5\n  cam_fy: 0.8\n  cam_cx: 0.5\n  cam_cy: 0.5\n  cam_d0: 0.93\n";
    let beside = imu_cam.replace("tx: 0.2", "tx: 0.3");
    let two =
        camera("cam0", "PinholeRadTan", numbers, imu_cam) + &camera("cam1", "PinholeAtan", atan, &beside);
    let rig = read_rig(folder.write("two.yaml", &two)).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::RadialTangential([0.1, 0.2, 0.3, 0.4, 0.0]));
    assert_eq!((rig.cameras[1].camera.fx, rig.cameras[1].camera.distortion), (376.0, Distortion::Fov(0.93)));
    assert!(refused("two.yaml", &two.replacen(imu_cam, "", 1)).contains("T_imu_cam is missing"));
    let alone = "cam_model: EquidistantCamera\ncam_width: 720\ncam_height: 540\nscale: 1.0\ncam_fx: 351\ncam_fy: 350\ncam_cx: 367\ncam_cy: 253\nk1: 0.1\nk2: 0.2\nk3: 0.3\nk4: 0.4\n";
    let rig = read_rig(folder.write("alone.yaml", alone)).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion, lens);
    folder.write(
        "imu.yaml",
        "accelerometer_noise_density: 0.02\naccelerometer_random_walk: 0.003\ngyroscope_noise_density: 0.002\ngyroscope_random_walk: 0.00002\nupdate_rate: 100\n",
    );
    let rig = read_rig(folder.write("vikit.yaml", camera("cam0", "Pinhole", numbers, imu_cam))).unwrap();
    assert_eq!(rig.imu.unwrap().rate_hz, 100.0);
}

#[test]
fn kimera_has_both_cameras_and_the_imu_in_one_file() {
    let square = |x: f64| {
        format!(
            "[1.0, 0.0, 0.0, {x},\n   0.0, 1.0, 0.0, 0.0,\n   0.0, 0.0, 1.0, 0.0,\n   0.0, 0.0, 0.0, 1.0]"
        )
    };
    let side = |side: &str, fx: f64, x: f64| {
        format!(
            "{side}_camera_intrinsics: [{fx},361.9,379.6,234.3] # fu, fv, cu, cv\n{side}_camera_distortion_coefficients: [0.1,-0.4,0.5,-0.2]\n\
             {side}_camera_extrinsics: {}\n",
            square(x)
        )
    };
    let text = format!(
        "# Calibration (Kalibr)\ncamera_hardware: MyntEye S - MIT\ncamera_rate_hz: 20\ncamera_model: pinhole\ndistortion_model: equidistant\n\
         camera_resolution: [752,480] # width, height\n{}{}calibration_to_body_frame: {}\nimu_rate_hz: 200\nimu_shift: -0.004 # t_imu0 = t_cam0 + imu_shift\n\
         gyroscope_noise_density: 0.009\ngyroscope_random_walk: 0.00005\naccelerometer_noise_density: 0.07\naccelerometer_random_walk: 0.05\nimu_extrinsics: {}\n",
        side("left", 362.6, 0.01),
        side("right", 367.0, 0.13),
        square(0.5),
        square(0.5)
    );
    let folder = Folder::new();
    let rig = read_rig(folder.write("calibration_MIT_equidistant.yaml", &text)).unwrap();
    let at = |i: usize| rig.cameras[i].body_from_camera.translation.x;
    assert_eq!((at(0), at(1), rig.cameras[1].camera.fx), (0.51, 0.63, 367.0));
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Equidistant([0.1, -0.4, 0.5, -0.2]));
    let imu = rig.imu.unwrap();
    assert_eq!((imu.rate_hz, imu.offset_s, imu.body_from_imu.translation.x), (200.0, 0.004, 0.5));
    assert!(
        refused("a.yaml", &text.replace("camera_model: pinhole", "camera_model: omni"))
            .contains("\"omni\" is not known")
    );
    assert!(refused("a.yaml", &text.replace("imu_shift", "shift")).contains("imu_shift is missing"));
}

#[test]
fn what_is_not_read_is_named_with_a_way_out() {
    let stella = |model: &str, more: &str| {
        format!(
            "Camera:\n  name: \"a\"\n  setup: \"monocular\"\n  model: \"{model}\"\n  cols: 1920\n  rows: 960\n{more}"
        )
    };
    let camodocal = "%YAML:1.0\n---\nmodel_type: SCARAMUZZA\ncamera_name: cam\nimage_width: 752\nimage_height: 480\n\
        poly_parameters:\n   p0: -2.4e+02\nprojection_parameters:\n   cx: 376\n   cy: 240\n";
    let ocam = "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). These are used by cam2world\n\n5 -2.38e+02 0 1.7e-03 0 1e-09\n";
    let rovio = "Common\n{\n}\nCamera0\n{\n  CalibrationFile  cam0.yaml;\n  qCM_x 0.0;\n}\n";
    for (name, text, what, way_out) in [
        ("a.yaml", stella("equirectangular", ""), "equirectangular", "perspective view"),
        ("a.yaml", camodocal.into(), "SCARAMUZZA", "Kalibr"),
        ("calib_results.txt", ocam.into(), "OCamCalib", "Kalibr"),
        ("rovio.info", rovio.into(), "a configuration of ROVIO", "CalibrationFile"),
    ] {
        let error = refused(name, &text);
        assert!(error.contains(what) && error.contains(way_out), "{error}");
    }
    let folder = Folder::new();
    let division =
        stella("radial_division", "  fx: 900\n  fy: 901\n  cx: 960\n  cy: 480\n  distortion: -0.25\n");
    let camera = read_rig(folder.write("division.yaml", division)).unwrap().cameras[0].camera;
    assert_eq!((camera.fy, camera.distortion), (901.0, Distortion::Division(-0.25)));
    // ROVIO's camera, which is that of ROS without a rectification.
    let camera = "image_width: 752\nimage_height: 480\ncamera_name: cam0\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [458.6, 0.0, 367.2, 0.0, 457.2, 248.3, 0.0, 0.0, 1.0]\n\
        distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data:  [-0.28, 0.07, 0.0002, 1.8e-05, 0.0]\n";
    assert_eq!(read_rig(folder.write("euroc_cam0.yaml", camera)).unwrap().cameras[0].camera.fx, 458.6);
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

#[test]
fn okvis2_x_has_lenses_of_its_own_and_xrslam_its_imu_in_one_file() {
    let folder = Folder::new();
    let okvis = "%YAML:1.2\ncameras:\n  - {T_SC:\n       [1, 0, 0, 0.1,\n        0, 1, 0, 0,\n        0, 0, 1, 0,\n        0, 0, 0, 1],\n     image_dimension: [960, 600],\n     \
        distortion_coefficients: [0.0, 0.0, 0.0, 0.0],\n     distortion_type: none,\n     focal_length: [308.5, 309.5],\n     principal_point: [480.5, 295.5],\n     \
        eucm_parameters: [0.66, 1.08],\n     cam_model: eucm,\n     slam_use: okvis}\n";
    let camera = read_rig(folder.write("okvis2_eucm.yaml", okvis)).unwrap().cameras[0].camera;
    assert_eq!(camera.distortion, Distortion::ExtendedUnified { alpha: 0.66, beta: 1.08 });
    let other = refused("a.yaml", &okvis.replace("cam_model: eucm", "cam_model: ds"));
    assert!(other.contains("cam_model \"ds\" is not known"), "{other}");
    let xrslam = "%YAML:1.0\nimu:\n  gyroscope_noise_density: 0.01\n  gyroscope_random_walk: 0.0001\n  accelerometer_noise_density: 0.1\n  accelerometer_random_walk: 0.001\n  \
        accelerometer_bias: [0.0, 0.0, 0.0]\n  extrinsic:\n    q_bi: [ 0.0, 0.0, 1.0, 0.0 ] # x y z w\n    p_bi: [ 0.0, 0.5, 0.0 ]\n  noise:\n    cov_g: [\n      2.9e-08, 0.0,\n      0.0, 2.9e-08]\ncam0:\n  \
        T_BS:\n    cols: 4\n    rows: 4\n    data: [0.0, -1.0, 0.0, 0.05,\n           -1.0, 0.0, 0.0, 0.0,\n           0.0, 0.0, -1.0, -0.01,\n           0.0, 0.0, 0.0, 1.0]\n  \
        resolution: [640, 480]\n  camera_model: pinhole\n  distortion_model: radtan\n  intrinsics: [489.5, 490.5, 323.5, 241.5]\n  distortion: [0.1, 0.2, 0.001, 0.002]\n  time_offset: 0.0\n";
    let path = folder.write("iPhone.yaml", xrslam);
    let rig = read_rig(&path).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::RadialTangential([0.1, 0.2, 0.001, 0.002, 0.0]));
    assert_eq!(rig.cameras[0].body_from_camera.translation, Vec3::new(0.05, 0.0, -0.01));
    let imu = rig.imu.unwrap();
    assert_eq!((imu.rate_hz, imu.noise.gyro, imu.body_from_imu.translation.y), (200.0, 0.01, 0.5));
    assert!((imu.body_from_imu.rotation * Vec3::x() + Vec3::x()).norm() < 1e-12);
    assert!(assumed_in(&path).unwrap().contains("states no rate of the IMU"));
    let placed = refused(
        "camchain.yaml",
        "cam0:\n  T_cam_imu:\n  - [1, 0, 0, 0]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n",
    );
    assert!(placed.contains("has no intrinsics") && placed.contains("camera.txt"), "{placed}");
}

#[test]
fn ov2slam_names_both_cameras_by_a_letter() {
    let folder = Folder::new();
    let side = |side: &str, l: &str, fx: f64| {
        format!(
            "Camera.model_{side}: pinhole\nCamera.{side}_nwidth: 752\nCamera.{side}_nheight: 480\nCamera.fx{l}: {fx}\nCamera.fy{l}: 457.5\nCamera.cx{l}: 367.5\nCamera.cy{l}: 248.5\n\
             Camera.k1{l}: -0.28\nCamera.k2{l}: 0.07\nCamera.p1{l}: 0.0002\nCamera.p2{l}: 0.00002\n"
        )
    };
    let place = |i: usize, x: f64| {
        format!(
            "body_T_cam{i}: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [1., 0., 0., {x},\n          0., 1., 0., 0.,\n          0., 0., 1., 0.,\n           0., 0., 0., 1.]\n"
        )
    };
    let text = format!(
        "%YAML 1.0\n---\n{}{}{}{}mono: 0\nstereo: 1\nalpha: 0.\n",
        side("left", "l", 458.5),
        side("right", "r", 459.5),
        place(0, 0.01),
        place(1, 0.12)
    );
    let rig = read_rig(folder.write("euroc_stereo.yaml", &text)).unwrap();
    let at = |i: usize| (rig.cameras[i].camera.fx, rig.cameras[i].body_from_camera.translation.x);
    assert_eq!((at(0), at(1)), ((458.5, 0.01), (459.5, 0.12)));
    assert_eq!(
        rig.cameras[1].camera.distortion,
        Distortion::RadialTangential([-0.28, 0.07, 0.0002, 0.00002, 0.0])
    );
    let mono = read_rig(folder.write("mono.yaml", text.replace("stereo: 1", "stereo: 0"))).unwrap();
    assert_eq!(mono.cameras.len(), 1);
    let fisheye =
        read_rig(folder.write("fisheye.yaml", text.replace("_left: pinhole", "_left: fisheye"))).unwrap();
    assert_eq!(fisheye.cameras[0].camera.distortion, Distortion::Equidistant([-0.28, 0.07, 0.0002, 0.00002]));
}

#[test]
fn cameras_of_gaussian_splatting_and_of_lidar_odometries() {
    let folder = Folder::new();
    let monogs = "inherit_from: \"configs/rgbd/tum/base_config.yaml\"\n\nDataset:\n  dataset_path: \"datasets\"\n  Calibration:\n    fx: 517.5\n    fy: 516.5\n    cx: 318.5\n    cy: 255.5\n    k1: 0.26\n    \
        k2: -0.95\n    p1: -0.005\n    p2: 0.002\n    k3: 1.16\n    distorted: True\n    width: 640\n    height: 480\n    depth_scale: 5000.0\n";
    let rig = read_rig(folder.write("fr1_desk.yaml", monogs)).unwrap();
    assert_eq!(
        rig.cameras[0].camera.distortion,
        Distortion::RadialTangential([0.26, -0.95, -0.005, 0.002, 1.16])
    );
    assert_eq!(rig.depth.unwrap().metres_per_unit, 0.0002);
    let straight =
        read_rig(folder.write("a.yaml", monogs.replace("distorted: True", "distorted: False"))).unwrap();
    assert_eq!(straight.cameras[0].camera.distortion, Distortion::None);
    let splatam = "dataset_name: 'tum'\ncamera_params:\n  image_height: 480\n  image_width: 640\n  fx: 517.5\n  fy: 516.5\n  cx: 318.5\n  cy: 255.5\n  crop_edge: 8\n  png_depth_scale: 6553.5\n";
    let rig = read_rig(folder.write("freiburg1.yaml", splatam)).unwrap();
    assert_eq!((rig.cameras[0].camera.width, rig.depth.unwrap().metres_per_unit), (640, 1.0 / 6553.5));
    let livo = "/**:\n  ros__parameters:\n    camera:\n      model: Pinhole\n      # HKisland\n      width: 2448\n      height: 2048\n      scale: 0.25\n      fx: 1444.5\n      fy: 1444.25\n      cx: 1177.5\n      \
        cy: 1043.5\n      d0: -0.05\n      d1: 0.12\n      d2: 0.001\n      d3: 0.0004\n";
    let camera = read_rig(folder.write("camera_MARS.yaml", livo)).unwrap().cameras[0].camera;
    assert_eq!((camera.width, camera.fy), (2448, 1444.25));
    assert_eq!(camera.distortion, Distortion::RadialTangential([-0.05, 0.12, 0.001, 0.0004, 0.0]));
    let r3live = "r3live_common:\n   image_downsample_ratio: 1\nr3live_vio:\n   image_width: 1280\n   image_height: 1024\n   camera_intrinsic:\n      [863.5, 0.0, 640.5,\n      0.0,  863.25, 518.5,\n      \
        0.0, 0.0, 1.0 ] \n   camera_dist_coeffs: [-0.1, 0.1, -1.2e-04, 5.7e-05, -0.02]  #k1, k2, p1, p2, k3\n";
    let camera = read_rig(folder.write("r3live_config.yaml", r3live)).unwrap().cameras[0].camera;
    assert_eq!(
        (camera.fy, camera.distortion),
        (863.25, Distortion::RadialTangential([-0.1, 0.1, -1.2e-4, 5.7e-5, -0.02]))
    );
    let mast3r = "width: 640\nheight: 480\n# With distortion (fx, fy, cx, cy, k1, k2, p1, p2)\ncalibration:  [517.5, 516.5, 318.5, 255.5, 0.26, -0.95, -0.005, 0.002, 1.16]\n";
    let camera = read_rig(folder.write("intrinsics.yaml", mast3r)).unwrap().cameras[0].camera;
    assert_eq!(
        (camera.cy, camera.distortion),
        (255.5, Distortion::RadialTangential([0.26, -0.95, -0.005, 0.002, 1.16]))
    );
}

#[test]
fn kimera_finds_the_right_camera_or_the_depth_beside_the_left_one() {
    let folder = Folder::new();
    let camera = |x: f64| {
        format!(
            "%YAML:1.0\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1.0, 0.0, 0.0, {x},\n         0.0, 1.0, 0.0, 0.0,\n         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\nresolution: [640, 360]\n\
             camera_model: pinhole\nintrinsics: [292.5, 292.25, 322.5, 190.5]\ndistortion_model: radtan\ndistortion_coefficients: [0.06, -0.02, 0.004, 0.0004]\n"
        )
    };
    let left = folder.write("LeftCameraParams.yaml", camera(0.25));
    let depth =
        folder.write("DepthCameraParams.yaml", "%YAML:1.0\nvirtual_baseline: 0.3\ndepth_to_meters: 0.001\n");
    let rig = read_rig(&left).unwrap();
    let found = rig.depth.unwrap();
    assert_eq!(
        (found.metres_per_unit, found.body_from_depth.translation.x, found.camera.width),
        (0.001, 0.25, 640)
    );
    assert!(read_rig(depth).unwrap_err().to_string().contains("give LeftCameraParams.yaml"));
    let left = folder.write("LeftCameraParamsS2BNO.yaml", camera(0.0));
    folder.write("RightCameraParamsS2BNO.yaml", camera(0.075));
    let rig = read_rig(left).unwrap();
    assert_eq!((rig.cameras[1].body_from_camera.translation.x, rig.depth), (0.075, None));
}
