//! Calibrations of other systems that are read otherwise than they look, and what they state that is not used.

use crate::common;

use cairn_geometry::Vec3;
use cairn_sensor::{Camera, Distortion, Rig};
use cairn_sources::{assumed_in, read_rig};
use common::Folder;

fn refused(name: &str, text: &str) -> String {
    let folder = Folder::new();
    read_rig(folder.write(name, text)).expect_err(text).to_string()
}

/// Body from camera: turned by a right angle about z, at 0.1, 0.2, 0.3.
const PLACE: &str = "[0.0, -1.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0]";

fn is_placed(rig: &Rig, i: usize, at: Vec3) {
    let placed = rig.cameras[i].body_from_camera;
    assert!((placed.translation - at).norm() < 1e-9, "{placed:?}");
    let x = placed.rotation * Vec3::new(1.0, 0.0, 0.0);
    assert!((x - Vec3::new(0.0, 1.0, 0.0)).norm() < 1e-9, "{placed:?}");
}

fn svo_of(place: &str, more: &str) -> String {
    format!(
        "cameras:\n- camera:\n    distortion:\n      parameters: {{cols: 1, rows: 0, data: []}}\n      type: none\n    image_height: 480\n    image_width: 640\n    intrinsics: {{cols: 1, rows: 4, data: \
         [500.0, 501.0, 320.0, 240.0]}}\n    {more}\n    type: pinhole\n  {place}\nimu_params:\n  delay_imu_cam: 0.008\n  sigma_omega_c: 2.0e-4\n  \
         sigma_acc_c: 2.0e-3\n  sigma_omega_bias_c: 2.0e-5\n  sigma_acc_bias_c: 3.0e-3\n  imu_rate: 200.0\n"
    )
}

#[test]
fn svos_delay_is_that_of_the_camera_and_its_pose_is_read_in_both_directions() {
    let folder = Folder::new();
    let place = format!("T_B_C: {{cols: 4, rows: 4, data: {PLACE}}}");
    let file = folder.write("svo.yaml", svo_of(&place, "line-delay-nanoseconds: 0"));
    let rig = read_rig(&file).unwrap();
    is_placed(&rig, 0, Vec3::new(0.1, 0.2, 0.3));
    // t_image - delay = t_imu.
    assert_eq!((rig.imu.unwrap().offset_s, assumed_in(file)), (0.008, None));
    let inverse = "T_C_B: [[0, 1, 0, -0.2], [-1, 0, 0, 0.1], [0, 0, 1, -0.3], [0, 0, 0, 1]]";
    let file = folder.write("svo.yaml", svo_of(inverse, "line-delay-nanoseconds: 50000"));
    is_placed(&read_rig(&file).unwrap(), 0, Vec3::new(0.1, 0.2, 0.3));
    let told = assumed_in(file).unwrap();
    assert!(told.contains("rolling shutter of 24.0 ms") && told.contains("tracker.readout_s"), "{told}");
}

#[test]
fn okvis_delays_its_images_and_places_its_imu_in_the_body() {
    let okvis = |t_bs: &str| {
        format!(
            "%YAML:1.0\ncameras:\n     - {{T_SC:\n        {PLACE},\n        image_dimension: [640, 480],\n        distortion_coefficients: [0.1, 0.0, 0.0, 0.0],\n        \
             distortion_type: radialtangential,\n        focal_length: [500.0, 501.0],\n        principal_point: [320.0, 240.0]}}\n\nimu_params:\n    \
             sigma_g_c: 2.0e-4\n    sigma_a_c: 2.0e-3\n    sigma_gw_c: 2.0e-5\n    sigma_aw_c: 3.0e-3\n    imu_rate: 200\n    T_BS:\n        {t_bs}\n\
             # delay of images [s]:\nimageDelay: 0.05  # to be calibrated\n"
        )
    };
    let folder = Folder::new();
    let rig = read_rig(folder.write("okvis.yaml", okvis("[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]")))
        .unwrap();
    is_placed(&rig, 0, Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(rig.imu.unwrap().offset_s, 0.05);
    let rig = read_rig(folder.write("okvis.yaml", okvis("[1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]")))
        .unwrap();
    is_placed(&rig, 0, Vec3::new(1.1, 0.2, 0.3));
    assert_eq!(rig.imu.unwrap().body_from_imu.translation, Vec3::new(1.0, 0.0, 0.0));
}

#[test]
fn vins_that_does_not_know_its_extrinsics_leaves_the_imu_out_and_says_so() {
    let folder = Folder::new();
    let mono = |more: &str| {
        format!(
            "%YAML:1.0\nmodel_type: PINHOLE\nimage_width: 640\nimage_height: 480\nprojection_parameters:\n   fx: 500\n   fy: 501\n   cx: 320\n   cy: 240\n\
             acc_n: 0.1\ngyr_n: 0.01\nacc_w: 0.001\ngyr_w: 0.0001\ntd: 0.0\n{more}"
        )
    };
    let extrinsics = "extrinsicRotation: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [0, -1, 0, 1, 0, 0, 0, 0, 1]\n\
        extrinsicTranslation: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [0.1, 0.2, 0.3]\n";
    for (more, imu) in [
        (format!("estimate_extrinsic: 0\n{extrinsics}"), true),
        (format!("estimate_extrinsic: 2\n{extrinsics}"), false),
        ("estimate_extrinsic: 1\n".into(), false),
    ] {
        let file = folder.write("mono.yaml", mono(&more));
        assert_eq!(read_rig(&file).unwrap().imu.is_some(), imu, "{more}");
        let told = assumed_in(&file).unwrap_or_default();
        assert_eq!(told.contains("the IMU is left out"), !imu, "{told}");
    }
    for (rolling, told) in [("0", false), ("1", true)] {
        let more = format!("{extrinsics}rolling_shutter: {rolling}\nrolling_shutter_tr: 0.033 # s\n");
        let said = assumed_in(folder.write("mono.yaml", mono(&more))).unwrap();
        assert_eq!(said.contains("rolling shutter of 33.0 ms"), told, "{said}");
    }
}

#[test]
fn what_openvins_kalibr_and_basalt_say_of_the_imus_axes_is_told() {
    let folder = Folder::new();
    let camera = |shift: &str| {
        format!(
            "  T_imu_cam: {PLACE}\n  camera_model: pinhole\n  distortion_coeffs: [0.1, 0.0, 0.0, 0.0]\n  distortion_model: radtan\n  \
             intrinsics: [500, 501, 320, 240]\n  resolution: [640, 480]\n  timeshift_cam_imu: {shift}\n"
        )
    };
    let other = camera("0.0041").replace("0.1, 1.0", "0.21, 1.0");
    let write = |imu: &str, most: &str, cam1: &str| {
        folder.write("v/chain.yaml", format!("%YAML:1.0\n\ncam0:\n{}cam1:\n{cam1}", camera("0.004")));
        folder.write(
            "v/noise.yaml",
            format!(
                "%YAML:1.0\nimu0:\n  accelerometer_noise_density: 2.0e-3\n  accelerometer_random_walk: 3.0e-3\n  gyroscope_noise_density: 2.0e-4\n  \
                 gyroscope_random_walk: 2.0e-5\n  update_rate: 200.0\n{imu}"
            ),
        );
        folder.write(
            "v/estimator_config.yaml",
            format!("%YAML:1.0\nmax_cameras: {most}\nrelative_config_imu: \"noise.yaml\"\nrelative_config_imucam: \"chain.yaml\"\n"),
        )
    };
    let matrix = |name: &str, first: f64, second: f64| {
        format!(
            "  {name}:\n    - [ {first}, 0.0, 0.0 ]\n    - [ 0.0, {second}, 0.0 ]\n    - [ 0.0, 0.0, {second} ]\n"
        )
    };
    let ideal =
        matrix("Tw", 1.0, 1.0) + &matrix("Ta", 1.0, 1.0) + &matrix("Tg", 0.0, 0.0) + "  time_offset: 0.0\n";
    let file = write(&ideal, "2", &other);
    assert_eq!((read_rig(&file).unwrap().cameras.len(), assumed_in(&file)), (2, None));
    assert_eq!(read_rig(write(&ideal, "1", &other)).unwrap().cameras.len(), 1, "max_cameras");
    for (imu, word) in [
        (matrix("Tw", 1.02, 1.0), "2.00 %"),
        (matrix("Tg", 0.001, 0.0), "0.10 %"),
        (matrix("R_IMUtoACC", 0.99, 1.0), "1.00 %"),
        ("  gyroscopes:\n    M: [[1.003, 0, 0], [0, 1, 0], [0, 0, 1]]\n".into(), "0.30 %"),
        ("  time_offset: 0.009\n".into(), "time_offset of 0.009 s"),
    ] {
        let told = assumed_in(write(&imu, "2", &other)).unwrap_or_default();
        assert!(told.contains(word) && told.contains("not used"), "{imu}: {told}");
    }
    // Of a chain by itself the same, and two cameras whose shifts differ.
    write(&ideal, "2", &other);
    let late = other.replace("0.0041", "0.014");
    folder.write("k/chain.yaml", format!("cam0:\n{}cam1:\n{late}", camera("0.004")));
    let told = assumed_in(folder.path().join("k/chain.yaml")).unwrap();
    assert!(told.contains("cam1 a time shift 10.0 ms off"), "{told}");
    let basalt = folder.write(
        "b.json",
        r#"{"value0": {"T_imu_cam": [], "intrinsics": [], "calib_accel_bias": [9, 9, 9, 0.0, -0.016, 0.0], "calib_gyro_bias": [9, 9, 9, 0.001]}}"#,
    );
    assert!(assumed_in(basalt).unwrap().contains("1.60 %"));
}

#[test]
fn a_raw_pair_of_openvslam_with_flat_keys_is_not_taken_as_rectified() {
    let folder = Folder::new();
    let text = "Camera.setup: \"stereo\"\nCamera.model: \"perspective\"\nCamera.fx: 60\nCamera.fy: 60\nCamera.cx: 240\nCamera.cy: 255\nCamera.cols: 512\n\
        Camera.rows: 512\nCamera.focal_x_baseline: 6.0\nStereoRectifier.model: \"fisheye\"\nStereoRectifier.K_left: [190.0, 0.0, 254.0, 0.0, 191.0, 256.0, 0, 0, 1]\n\
        StereoRectifier.D_left: [0.003, 0.0007, -0.002, 0.0002]\nStereoRectifier.R_left: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n\
        StereoRectifier.K_right: [192.0, 0.0, 252.0, 0.0, 193.0, 254.0, 0.0, 0.0, 1.0]\nStereoRectifier.D_right: [0.0034, 0.0017, -0.0026, 0.0003]\n\
        StereoRectifier.R_right: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n";
    let rig = read_rig(folder.write("tumvi.yaml", text)).unwrap();
    assert_eq!((rig.cameras[0].camera.fx, rig.cameras[1].camera.fy), (190.0, 193.0));
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Equidistant([0.003, 0.0007, -0.002, 0.0002]));
    assert_eq!(rig.cameras[1].body_from_camera.translation, Vec3::new(0.1, 0.0, 0.0));
    assert!(
        refused("tumvi.yaml", &text.replace("StereoRectifier.R_right", "Other"))
            .contains("StereoRectifier.R_right is missing")
    );
}

#[test]
fn rvio_has_its_place_its_noise_its_fisheye_and_a_colon_in_a_key() {
    let folder = Folder::new();
    let rvio = |fisheye: u8, more: &str| {
        format!(
            "%YAML:1.0\nIMU.dps: 200\nIMU.sigma_g: 2e-04\nIMU.sigma_wg: 2e-05\nIMU.sigma_a: 2.0e-3\nIMU.sigma_wa: 3.0e-3\nCamera.Fisheye: {fisheye}\n\
             Camera.width: 640\nCamera.height: 480\nCamera.fx: 500\nCamera.fy: 501\nCamera.cx: 320\nCamera.cy: 240\nCamera.k1: -0.2\nCamera.k2: 0.07\n\
             Camera.p1: 0.001\nCamera.p2: 0.002\nCamera.T_BC0: !!opencv-matrix\n    rows: 4\n    cols: 4\n    dt: d\n    data: {PLACE}\n{more}"
        )
    };
    let rig = read_rig(folder.write("rvio.yaml", rvio(0, "Camera:nTimeOffset: 0.01\n"))).unwrap();
    is_placed(&rig, 0, Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(
        rig.cameras[0].camera.distortion,
        Distortion::RadialTangential([-0.2, 0.07, 0.001, 0.002, 0.0])
    );
    let imu = rig.imu.unwrap();
    assert_eq!((imu.rate_hz, imu.noise.accel_walk, imu.offset_s), (200.0, 3e-3, -0.01));
    let truth = format!(
        "Camera.T_BC0_GT: !!opencv-matrix\n    rows: 4\n    cols: 4\n    dt: d\n    data: {}\nCamera.nTimeOffset_GT: 0.02\nINI.UseGroundTruthCalib: 1\n",
        PLACE.replace("0.1, 1.0", "0.5, 1.0")
    );
    let rig = read_rig(folder.write("rvio2.yaml", rvio(1, &truth))).unwrap();
    is_placed(&rig, 0, Vec3::new(0.5, 0.2, 0.3));
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Equidistant([-0.2, 0.07, 0.001, 0.002]));
    assert_eq!(rig.imu.unwrap().offset_s, -0.02);
    let unplaced = rvio(0, "").replace("Camera.T_BC0", "Camera.T_other");
    let file = folder.write("rvio.yaml", unplaced);
    assert!(read_rig(&file).unwrap().imu.is_none() && assumed_in(&file).unwrap().contains("IMU is left out"));
}

#[test]
fn a_raw_pair_has_the_size_of_its_own_images() {
    let folder = Folder::new();
    let k = |side: &str, fx: f64| {
        format!(
            "{side}.height: 720\n{side}.width: 640\n{side}.D: {{rows: 1, cols: 5, data: [0.1, 0.0, 0.0, 0.0, 0.0]}}\n{side}.K: {{rows: 3, cols: 3, data: [{fx}, 0, 330, 0, {fx}, \
             365, 0, 0, 1]}}\n{side}.R: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}\n"
        )
    };
    let p = "RIGHT.P: {rows: 3, cols: 4, data: [500, 0, 320, -50, 0, 500, 240, 0, 0, 0, 1, 0]}\n";
    let pair = k("LEFT", 700.0) + &k("RIGHT", 701.0) + p;
    let orb = format!(
        "%YAML:1.0\nCamera.fx: 500\nCamera.fy: 500\nCamera.cx: 320\nCamera.cy: 240\nCamera.width: 752\nCamera.height: 480\nCamera.bf: 50\n{pair}"
    );
    let camera = read_rig(folder.write("orb.yaml", orb)).unwrap().cameras[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx), (640, 720, 700.0));
    // AirVO's, with a fisheye.
    let air = format!("%YAML:1.0\nimage_height: 720\nimage_width: 640\nbf: 50\ndistortion_type: 1\n{pair}")
        .replace("LEFT.width: 640\n", "")
        .replace("LEFT.height: 720\n", "");
    let rig = read_rig(folder.write("air.yaml", air)).unwrap();
    assert_eq!((rig.cameras[1].camera.width, rig.cameras[1].body_from_camera.translation.x), (640, 0.1));
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Equidistant([0.1, 0.0, 0.0, 0.0]));
}

#[test]
fn larvio_airslam_and_maplab_are_read() {
    let folder = Folder::new();
    let larvio = "%YAML:1.0\ncamera_model: \"pinhole\"       # only\ndistortion_model: \"equidistant\"\nresolution_width: 640\nresolution_height: 480\nintrinsics:\n   fx: 500\n   fy: 501\n   \
        cx: 320\n   cy: 240\ndistortion_coeffs:\n   k1: 0.1\n   k2: 0.2\n   p1: 0.3\n   p2: 0.4\nT_cam_imu: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data:\n    \
        [0, 1, 0, -0.2, -1, 0, 0, 0.1, 0, 0, 1, -0.3, 0, 0, 0, 1]\ntd: 0.01\nnoise_gyro: 0.004\nnoise_acc: 0.08\nnoise_gyro_bias: 2e-5\nnoise_acc_bias: 4e-4\nimu_rate: 400\n";
    let rig = read_rig(folder.write("larvio.yaml", larvio)).unwrap();
    is_placed(&rig, 0, Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]));
    let imu = rig.imu.unwrap();
    assert!(imu.noise.accel == 0.08 && imu.offset_s == -0.01 && imu.rate_hz == 400.0);
    let air = |t_type: u8, imu: u8| {
        let inverse = "[[0, 1, 0, -0.2], [-1, 0, 0, 0.1], [0, 0, 1, -0.3], [0, 0, 0, 1]]";
        let t = if t_type == 0 { PLACE } else { inverse };
        format!(
            "%YAML:1.0\nimage_height: 480\nimage_width: 640\nuse_imu: {imu}\ndistortion_type: 1  # 0 for\ncam0:\n  intrinsics: [500, 501, 320, 240] # fx\n  \
             distortion_coeffs: [-0.2, 0.07, 0.001, 0.002, 0]\n  T_type: {t_type}           # 0\n  T: {t}\nrate_hz: 200\ngyroscope_noise_density: 2e-4\n\
             gyroscope_random_walk: 2e-5\naccelerometer_noise_density: 2e-3\naccelerometer_random_walk: 3e-3\n"
        )
    };
    for t_type in [0, 1] {
        let rig = read_rig(folder.write("air.yaml", air(t_type, 1))).unwrap();
        is_placed(&rig, 0, Vec3::new(0.1, 0.2, 0.3));
        assert_eq!(
            rig.cameras[0].camera.distortion,
            Distortion::RadialTangential([-0.2, 0.07, 0.001, 0.002, 0.0])
        );
        assert_eq!(rig.imu.unwrap().noise.gyro, 2e-4);
    }
    assert!(read_rig(folder.write("air.yaml", air(0, 0))).unwrap().imu.is_none());
    assert!(
        refused("air.yaml", &air(0, 1).replace("T_type: 0", "T_type: 7")).contains("T_type 7 is not known")
    );
    let maplab = format!(
        "sensors:\n  - id: c63\n    topic: /imu0\n    sensor_type: IMU\n    sigmas:\n      acc_noise_density: 4e-3\n      acc_bias_random_walk_noise_density: 3e-3\n      \
         gyro_noise_density: 1e-4\n      gyro_bias_random_walk_noise_density: 2e-4\n  - id: 412\n    sensor_type: NCAMERA\n    topic: \"\"\n    cameras:\n      - camera:\n          \
         line-delay-nanoseconds: 0\n          image_height: 480\n          image_width: 640\n          type: pinhole\n          intrinsics:\n            rows: 4\n            cols: 1\n            \
         data:\n              - 500.0\n              - 501.0\n              - 320.0\n              - 240.0\n          distortion:\n            type:                equidistant\n            \
         parameters: {{rows: 4, cols: 1, data: [0.1, 0.2, 0.3, 0.4]}}\n        T_B_C: {{rows: 4, cols: 4, data: {PLACE}}}\n  - id: aab\n    sensor_type: ODOMETRY_6DOF\nextrinsics:\n  \
         - sensor_id: 412\n    base_sensor_id: c63\n    T_B_S:\n      rows: 4\n      cols: 4\n      data:\n        - [1,0,0,1.0]\n        - [0,1,0,0]\n        - [0,0,1,0]\n        - [0,0,0,1]\n"
    );
    let file = folder.write("maplab.yaml", maplab);
    let rig = read_rig(&file).unwrap();
    is_placed(&rig, 0, Vec3::new(1.1, 0.2, 0.3));
    assert_eq!((rig.imu.as_ref().unwrap().noise.accel_walk, rig.cameras[0].camera.fy), (3e-3, 501.0));
    assert!(assumed_in(file).unwrap().contains("200 samples a second are taken"));
}

#[test]
fn cameras_of_dso_are_read_with_shares_and_with_pixels() {
    let folder = Folder::new();
    for (text, camera, distortion) in [
        (
            "0.5 0.75 0.5 0.5 0.9\n640 480\ncrop\n320 240\n",
            [320.0, 360.0, 319.5, 239.5],
            Distortion::Fov(0.9),
        ),
        (
            "Pinhole 500 501 320 240 0\n640 480\ncrop\n620 460\n",
            [500.0, 501.0, 320.0, 240.0],
            Distortion::None,
        ),
        (
            "500 501 320 240 -0.2 0.07 0.001 0.002\n640 480\nnone\n640 480\n",
            [500.0, 501.0, 320.0, 240.0],
            Distortion::RadialTangential([-0.2, 0.07, 0.001, 0.002, 0.0]),
        ),
        (
            "RadTan 0.5 0.75 0.5 0.5 -0.2 0.07 0.001 0.002\n640 480\n0.6 0.9 0.5 0.5 0\n640 480",
            [320.0, 360.0, 319.5, 239.5],
            Distortion::RadialTangential([-0.2, 0.07, 0.001, 0.002, 0.0]),
        ),
        (
            "EquiDistant 500 501 320 240 0.1 0.2 0.3 0.4\n640 480\nfull\n640 480\n",
            [500.0, 501.0, 320.0, 240.0],
            Distortion::Equidistant([0.1, 0.2, 0.3, 0.4]),
        ),
    ] {
        let [fx, fy, cx, cy] = camera;
        let read = read_rig(folder.write("camera.txt", text)).unwrap().cameras[0].camera;
        assert_eq!(read, Camera { distortion, ..Camera::pinhole(640, 480, fx, fy, cx, cy) }, "{text}");
    }
    assert!(refused("camera.txt", "FOV 0.5 0.75 0.5 0.5 1 2 3 4\n640 480\n").contains("is not known"));
    assert!(refused("camera.txt", "1 2 3\n4 5 6\n").contains("is not a rig file of a known kind"));
}

#[test]
fn nice_slam_takes_what_a_scene_does_not_state_from_above() {
    let folder = Folder::new();
    folder.write(
        "configs/TUM/tum.yaml",
        "dataset: 'tumrgbd'\ncam:  #NOTE\n  H: 480 \n  W: 640 \n  fx: 517.0\n  fy: 516.0\n  cx: 318.0\n  cy: 255.0\n  png_depth_scale: 5000.0\n",
    );
    let scene = folder.write(
        "configs/TUM/desk.yaml",
        "inherit_from: configs/TUM/tum.yaml\ncam:  #other\n  H: 480 \n  W: 640 \n  fx: 535.0\n  fy: 539.0\n  cx: 320.0\n  cy: 247.0\n  crop_size: [384,512]\n",
    );
    let rig = read_rig(scene).unwrap();
    assert_eq!((rig.cameras[0].camera.fx, rig.depth.unwrap().metres_per_unit), (535.0, 0.0002));
}
