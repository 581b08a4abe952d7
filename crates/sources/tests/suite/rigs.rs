//! Rig files: all real ones of the data folder, and small ones with every fault we could think of.

use crate::common;

use cairn_geometry::{So3, Vec2, Vec3};
use cairn_sensor::{Camera, Distortion, Rig};
use cairn_sources::{assumed_in, read_rig, read_rig_for, write_rig};
use common::{Folder, data};

fn refused(text: &str, name: &str) -> String {
    let folder = Folder::new();
    read_rig(folder.write(name, text)).expect_err(text).to_string()
}

#[test]
fn kalibr_and_euroc_agree_on_the_same_rig() {
    let (Some(kalibr), Some(own)) =
        (data("rigs/kalibr-euroc/kalibr_imucam_chain.yaml"), data("euroc-mh01/mav0"))
    else {
        return;
    };
    let (a, b) = (read_rig(kalibr).unwrap(), read_rig(&own).unwrap());
    assert_eq!(a, b);
    assert_eq!(read_rig(own.parent().unwrap()).unwrap(), b);
    assert_eq!(a.cameras.len(), 2);
    let camera = a.cameras[0].camera;
    assert_eq!((camera.width, camera.fx, camera.cy), (752, 458.654, 248.375));
    assert_eq!(
        camera.distortion,
        Distortion::RadialTangential([-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0])
    );
    let imu = a.imu.unwrap();
    assert_eq!((imu.rate_hz, imu.noise.gyro, imu.noise.accel_walk), (200.0, 1.6968e-04, 3.0e-3));
    let baseline = a.cameras[0].body_from_camera.inverse() * a.cameras[1].body_from_camera;
    assert!((baseline.translation.norm() - 0.1101).abs() < 1e-4 && baseline.translation.x > 0.1);
    // One sensor alone is a rig too.
    let single = read_rig(own.join("cam1/sensor.yaml")).unwrap();
    assert_eq!(single.cameras[0].camera, b.cameras[1].camera);
}

#[test]
fn orbslam_and_euroc_agree_on_the_same_rig() {
    let (Some(folder), Some(own)) = (data("rigs/orbslam-settings"), data("euroc-mh01/mav0")) else { return };
    let (a, b) = (read_rig(folder.join("EuRoC_stereo_inertial.yaml")).unwrap(), read_rig(own).unwrap());
    for (a, b) in a.cameras.iter().zip(&b.cameras) {
        assert_eq!(a.camera, b.camera);
        let off = a.body_from_camera.inverse() * b.body_from_camera;
        assert!(off.translation.norm() < 1e-5 && off.rotation.angle() < 1e-5, "{off:?}");
    }
    assert_eq!(a.imu.unwrap().noise.gyro, 1.7e-4);
    let mono = read_rig(folder.join("EuRoC_mono_inertial.yaml")).unwrap();
    assert_eq!((mono.cameras.len(), mono.cameras[0].camera), (1, a.cameras[0].camera));
}

#[test]
fn all_real_settings_are_read() {
    let Some(folder) = data("rigs/orbslam-settings") else { return };
    let tum = read_rig(folder.join("TUM1_rgbd.yaml")).unwrap();
    let depth = tum.depth.unwrap();
    assert_eq!((tum.cameras.len(), depth.registered, depth.metres_per_unit), (1, true, 1.0 / 5000.0));
    assert_eq!(
        tum.cameras[0].camera.distortion,
        Distortion::RadialTangential([0.262383, -0.953104, -0.005358, 0.002628, 1.163314])
    );
    let kitti = read_rig(folder.join("KITTI00_stereo.yaml")).unwrap();
    assert_eq!(kitti.cameras[1].body_from_camera.translation, Vec3::new(0.53716, 0.0, 0.0));
    assert_eq!(kitti.cameras[1].camera, Camera::pinhole(1241, 376, 718.856, 718.856, 607.1928, 185.2157));
    let d435 = read_rig(folder.join("D435i_rgbd_inertial.yaml")).unwrap();
    assert_eq!((d435.cameras.len(), d435.depth.unwrap().metres_per_unit), (1, 0.001));
    assert_eq!(d435.cameras[0].camera.distortion, Distortion::None);
    assert_eq!(d435.imu.unwrap().noise.gyro_walk, 1e-6);

    let vi = read_rig(folder.join("TUM-VI_mono_inertial.yaml")).unwrap();
    let chain = read_rig(data("rigs/kalibr-tumvi/kalibr_imucam_chain.yaml").unwrap()).unwrap();
    let (Distortion::Equidistant(a), Distortion::Equidistant(b)) =
        (vi.cameras[0].camera.distortion, chain.cameras[0].camera.distortion)
    else {
        panic!("a fisheye is expected");
    };
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-9));
    let off = vi.cameras[0].body_from_camera.inverse() * chain.cameras[0].body_from_camera;
    assert!(off.rotation.angle() < 1e-6, "T_b_c1 and the inverse of T_cam_imu: {off:?}");
    assert_eq!(chain.cameras.len(), 2);

    let d455 = read_rig(data("rigs/kalibr-d455/kalibr_imucam_chain.yaml").unwrap()).unwrap();
    assert_eq!(d455.imu.as_ref().unwrap().offset_s, -0.002524377913673846);
    assert_eq!((d455.cameras[0].camera.width, d455.imu.unwrap().rate_hz), (848, 400.0));
}

/// Every third pixel of every real camera has a ray that projects back to it.
#[test]
fn real_cameras_project_and_unproject() {
    let Some(rigs) = data("rigs") else { return };
    let mut cameras = 0;
    for folder in std::fs::read_dir(rigs).unwrap().map(|e| e.unwrap().path()) {
        for file in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
            if file.to_str().unwrap().ends_with("kalibr_imu_chain.yaml") {
                continue;
            }
            for c in read_rig(&file).unwrap().cameras {
                for (x, y) in
                    (0..c.camera.height).step_by(3).flat_map(|y| (0..c.camera.width).map(move |x| (x, y)))
                {
                    let px = Vec2::new(x as f64, y as f64);
                    let back = c.camera.unproject(&px).and_then(|ray| c.camera.project(&(2.0 * ray)));
                    assert!(
                        back.is_some_and(|b| (b - px).norm() < 1e-6),
                        "{}: {px} is {back:?}",
                        file.display()
                    );
                }
                cameras += 1;
            }
        }
    }
    assert_eq!(cameras, 13);
}

#[test]
fn kitti_rig_takes_the_size_from_its_images() {
    let Some(folder) = data("kitti-a") else { return };
    let rig = read_rig(folder.join("calib.txt")).unwrap();
    assert_eq!(rig.cameras[0].camera, Camera::pinhole(1226, 370, 707.0912, 707.0912, 601.8873, 183.1104));
    assert!((rig.cameras[1].body_from_camera.translation - Vec3::new(0.537151, 0.0, 0.0)).norm() < 1e-5);
    let alone = Folder::new();
    let calib = alone.write("calib.txt", std::fs::read_to_string(folder.join("calib.txt")).unwrap());
    assert!(read_rig(&calib).unwrap_err().to_string().contains("size of the images"));
    assert_eq!(read_rig_for(&calib, Some([1226, 370])).unwrap(), rig);
}

#[test]
fn every_rig_round_trips() {
    let folder = Folder::new();
    let mut rigs = vec![common::rgbd_rig()];
    for name in ["kalibr-d455", "kalibr-tumvi", "kalibr-euroc"] {
        rigs.extend(data(&format!("rigs/{name}/kalibr_imucam_chain.yaml")).map(|p| read_rig(p).unwrap()));
    }
    for distortion in [
        Distortion::Rational([0.1, 0.2, 0.0, 0.001, 0.3, 0.1, 0.1, 0.1]),
        Distortion::InverseRadialTangential([0.1, 0.2, 0.0, 0.001, 0.3]),
        Distortion::Fov(0.9),
        Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 },
    ] {
        rigs.push(Rig::mono(Camera { distortion, ..Camera::pinhole(64, 48, 50.0, 51.0, 31.5, 24.25) }));
    }
    for rig in rigs {
        let back = read_rig(folder.write("rig.toml", write_rig(&rig).unwrap())).unwrap();
        assert_eq!(
            (back.cameras.len(), &back.depth, back.imu.is_some()),
            (rig.cameras.len(), &rig.depth, rig.imu.is_some())
        );
        for (a, b) in rig.cameras.iter().zip(&back.cameras) {
            assert_eq!((&a.name, a.camera), (&b.name, b.camera));
            let off = a.body_from_camera.inverse() * b.body_from_camera;
            assert!(off.translation.norm() < 1e-12 && off.rotation.angle() < 1e-12);
        }
    }
}

/// The settings format before version 1.0, with the raw cameras of a rectified pair.
#[test]
fn old_orbslam_settings_with_rectification() {
    let text = "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera.fx: 435.2\nCamera.fy: 435.2\nCamera.cx: 367.4\n\
        Camera.cy: 252.2\nCamera.bf: 47.9\nCamera.width: 752\nCamera.height: 480\n\
        LEFT.K: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  data:[458.6, 0.0, 367.2, 0.0, 457.2, 248.3, 0.0, 0.0, 1.0]\n\
        LEFT.D: !!opencv-matrix\n  rows: 1\n  cols: 5\n  dt: d\n  data:[-0.28, 0.07, 0.0001, 1.7e-05, 0.0]\n\
        LEFT.R: !!opencv-matrix\n  rows: 3\n  cols: 3\n  data: [0. -1. 0. 1. 0. 0. 0. 0. 1.]\n\
        RIGHT.K: !!opencv-matrix\n  rows: 3\n  cols: 3\n  data:[457.5, 0.0, 379.9, 0.0, 456.1, 255.2, 0.0, 0.0, 1]\n\
        RIGHT.R: !!opencv-matrix\n  rows: 3\n  cols: 3\n  data: [1. 0. 0. 0. 1. 0. 0. 0. 1.]\n\
        RIGHT.P: !!opencv-matrix\n  rows: 3\n  cols: 4\n  data: [435.2, 0, 367.4, -47.9, 0, 435.2, 252.2, 0, 0, 0, 1, 0]\n";
    let folder = Folder::new();
    let rig = read_rig(folder.write("EuRoC.yaml", text)).unwrap();
    assert_eq!((rig.cameras[0].camera.fx, rig.cameras[1].camera.cx), (458.6, 379.9));
    // Rectification rotates the left camera by 90 degrees about z: the right one lies along rectified x,
    // which is left -y.
    let second = rig.cameras[1].body_from_camera;
    let right_angle = So3::exp(&Vec3::new(0.0, 0.0, -std::f64::consts::FRAC_PI_2));
    assert!((second.translation - Vec3::new(0.0, -47.9 / 435.2, 0.0)).norm() < 1e-12, "{second:?}");
    assert!((second.rotation.inverse() * right_angle).angle() < 1e-9, "{second:?}");
}

/// Cameras that rectify themselves come with a file of EuRoC's in which only `Camera.*` was changed.
#[test]
fn raw_cameras_of_another_pair_are_not_taken_and_it_is_told() {
    let matrix = |rows: usize, columns: usize, data: &str| {
        format!("!!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n  data:[{data}]\n")
    };
    let file = |fx: f64, lens: &str, rotation: &str| {
        let k = matrix(3, 3, "458.6, 0, 367.2, 0, 457.2, 248.3, 0, 0, 1");
        let [r, d] = [matrix(3, 3, rotation), matrix(1, 5, lens)];
        let p =
            |along: &str| matrix(3, 4, &format!("435.2, 0, 367.4, {along}, 0, 435.2, 252.2, 0, 0, 0, 1, 0"));
        format!(
            "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera.fx: {fx}\nCamera.fy: {fx}\nCamera.cx: 639.3\nCamera.cy: 412.3\n\
             Camera.bf: 64.4\nCamera.width: 1280\nCamera.height: 720\nLEFT.width: 752\nLEFT.height: 480\nLEFT.K: {k}LEFT.D: {d}\
             LEFT.R: {r}LEFT.P: {}RIGHT.K: {k}RIGHT.D: {d}RIGHT.R: {r}RIGHT.P: {}",
            p("0"),
            p("-47.9")
        )
    };
    let (lens, none) = ("-0.28, 0.07, 0.0001, 1.7e-05, 0.0", "0, 0, 0, 0, 0, 0, 0, 0, 0");
    let eye = "1, 0, 0, 0, 1, 0, 0, 0, 1";
    let folder = Folder::new();
    for (fx, lens, rotation) in [(859.0, lens, eye), (435.2, "", eye), (435.2, lens, none)] {
        let path = folder.write("oak.yaml", file(fx, lens, rotation));
        let rig = read_rig(&path).unwrap();
        assert_eq!((rig.cameras[0].camera.fx, rig.cameras[0].camera.width), (fx, 1280));
        assert_eq!(rig.cameras[0].camera.distortion, Distortion::None);
        assert!((rig.cameras[1].body_from_camera.translation.x - 64.4 / fx).abs() < 1e-12);
        let told = assumed_in(&path).unwrap();
        assert!(told.contains("do not belong to its Camera.fx"), "{told}");
    }
    let path = folder.write("euroc.yaml", file(435.2, lens, eye));
    let rig = read_rig(&path).unwrap();
    assert_eq!((rig.cameras[0].camera.fx, rig.cameras[0].camera.width), (458.6, 752));
    assert_eq!(assumed_in(&path), None);
}

#[test]
fn kalibr_chain_without_imu_and_double_sphere() {
    let text = "cam0:\n  camera_model: ds\n  intrinsics: [-0.2, 0.6, 150, 151, 255, 256]\n  distortion_model: none\n  \
        distortion_coeffs: []\n  resolution: [512, 512]\ncam1:\n  camera_model: pinhole\n  \
        intrinsics: [150, 151, 255, 256]\n  distortion_model: equidistant\n  distortion_coeffs: [0.1, 0, 0, 0]\n  \
        resolution: [512, 512]\n  T_cn_cnm1:\n  - [1, 0, 0, -0.1]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n";
    let folder = Folder::new();
    let rig = read_rig(folder.write("camchain.yaml", text)).unwrap();
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 });
    assert_eq!(rig.cameras[1].body_from_camera.translation, Vec3::new(0.1, 0.0, 0.0));
    assert!(rig.imu.is_none());
}

#[test]
fn faults_are_reported_with_file_line_and_reason() {
    let kalibr = "cam0:\n  camera_model: pinhole\n  intrinsics: [1, 2, nan, 4]\n  resolution: [640, 480]\n";
    let text = refused(kalibr, "camchain.yaml");
    assert!(
        text.contains("camchain.yaml, line 3") && text.contains("\"nan\" is not a finite number"),
        "{text}"
    );
    let text = refused(&kalibr.replace("[1, 2, nan, 4]", "[1, 2, 3]"), "camchain.yaml");
    assert!(text.contains("needs 4 numbers, here are 3"), "{text}");
    let text = refused(&kalibr.replace("pinhole", "ocam"), "camchain.yaml");
    assert!(text.contains("line 2") && text.contains("\"ocam\" is not known"), "{text}");
    let text = refused(&kalibr.replace("nan", "3").replace("640, 480", "0, 480"), "camchain.yaml");
    assert!(text.contains("resolution 0x480"), "{text}");

    let orb = "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera1.fx: 500\nCamera1.fy: 500\nCamera1.cx: 320\nCamera1.cy: 240\n\
        Camera.width: 640\nCamera.height: 480\nIMU.T_b_c1: !!opencv-matrix\n  rows: 4\n  cols: 4\n  \
        data: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0]\n";
    let text = refused(orb, "settings.yaml");
    assert!(text.contains("rows x cols is 16, but data has 15 numbers"), "{text}");
    let text = refused(&orb.replace("0,0,0]", "0,0,0,1]").replace("[1,0,0,0", "[2,0,0,0"), "settings.yaml");
    assert!(text.contains("not a rotation"), "{text}");
    let text = refused(&orb.replace("Camera1.fy: 500\n", "").replace("0,0,0]", "0,0,0,1]"), "settings.yaml");
    assert!(text.contains("Camera1.fy is missing"), "{text}");
    let text = refused(&orb.replace("PinHole", "Spherical"), "settings.yaml");
    assert!(text.contains("line 2") && text.contains("Spherical"), "{text}");

    let toml = "[[cameras]]\nresolution = [640, 480]\nfocal = [500.0, 500.0]\ncentre = [320.0, 240.0]\n";
    assert!(refused(&toml.replace("320.0", "nan"), "rig.toml").contains("cx is NaN"));
    let text = refused(&toml.replace("focal", "fokal"), "rig.toml");
    assert!(text.contains("rig.toml, line 3") && text.contains("fokal"), "{text}");
    let text =
        refused(&(toml.to_owned() + "distortion = { model = \"fov\", coefficients = [] }\n"), "rig.toml");
    assert!(text.contains("fov distortion needs 1"), "{text}");
    let text = refused(
        &(toml.to_owned() + "body_from_camera = { rotation_xyzw = [0.0, 0.0, 0.0, 0.0] }\n"),
        "rig.toml",
    );
    assert!(text.contains("norm 0"), "{text}");

    assert!(
        refused("P0: 1 2 3\n", "calib.txt").contains("calib.txt, line 1: a projection needs 12"),
        "kitti"
    );
    assert!(refused("hello\n", "notes.txt").contains("not a rig file of a known kind"));
    assert!(refused("hello: 1\n", "notes.yaml").contains("not a rig file of a known kind"));
    assert!(refused("imu0:\n  update_rate: 200\n", "imu.yaml").contains("give the camera chain"));
    assert!(refused("", "empty.yaml").contains("not a rig file of a known kind"));
    assert!(read_rig("/no/such/rig.yaml").unwrap_err().to_string().contains("cannot be read"));
    assert!(read_rig(Folder::new().path()).unwrap_err().to_string().contains("holds no rig"));
}

/// The camera of EuRoC's first and second sensor, as one system after the other writes it.
#[test]
fn calibrations_of_other_systems_are_the_same_rig() {
    let folder = Folder::new();
    let camera = Camera {
        distortion: Distortion::RadialTangential([-0.28, 0.07, 0.0002, 1.8e-5, 0.0]),
        ..Camera::pinhole(752, 480, 458.6, 457.2, 367.2, 248.3)
    };
    let flat = "0.0, -1.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0";
    let matrix = format!("{{cols: 4, rows: 4, data: [{flat}]}}");
    let check = |file: std::path::PathBuf, imu: bool| {
        let name = file.display().to_string();
        let rig = read_rig(file).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(rig.cameras[0].camera, camera, "{name}");
        let at = rig.cameras[0].body_from_camera;
        assert!((at.translation - Vec3::new(0.1, 0.2, 0.3)).norm() < 1e-9, "{name}: {at:?}");
        let x = at.rotation * Vec3::new(1.0, 0.0, 0.0);
        assert!((x - Vec3::new(0.0, 1.0, 0.0)).norm() < 1e-9, "{name}: {at:?}");
        assert_eq!(rig.imu.is_some(), imu, "{name}");
        rig
    };
    // VINS-Fusion, with its camera in camodocal's form.
    folder.write(
        "vins/cam0.yaml",
        "%YAML:1.0\n---\nmodel_type: PINHOLE\nimage_width: 752\nimage_height: 480\ndistortion_parameters:\n   k1: -0.28\n   \
         k2: 0.07\n   p1: 0.0002\n   p2: 1.8e-05\nprojection_parameters:\n   fx: 458.6\n   fy: 457.2\n   cx: 367.2\n   cy: 248.3\n",
    );
    let vins = folder.write(
        "vins/config.yaml",
        format!(
            "%YAML:1.0\n\nimu: 1\nnum_of_cam: 1\ncam0_calib: \"cam0.yaml\"\nbody_T_cam0: !!opencv-matrix\n   rows: 4\n   cols: 4\n   \
             dt: d\n   data: [{flat}]\nacc_n: 0.1\ngyr_n: 0.01\nacc_w: 0.001\ngyr_w: 0.0001\ntd: -0.03\n"
        ),
    );
    let assumed = cairn_sources::assumed_in(&vins).unwrap();
    assert!(assumed.contains("states no rate of the IMU: 200 samples"), "{assumed}");
    let imu = check(vins, true).imu.unwrap();
    assert!((imu.offset_s - 0.03).abs() < 1e-12 && (imu.noise.accel - 0.1 / 200f64.sqrt()).abs() < 1e-12);
    // OKVIS2.
    let okvis = folder.write(
        "okvis.yaml",
        format!(
            "%YAML:1.0\ncameras:\n     - {{T_SC:\n        [{flat}],\n        image_dimension: [752, 480],\n        \
             distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05],\n        distortion_type: radialtangential,\n        \
             focal_length: [458.6, 457.2],\n        principal_point: [367.2, 248.3],\n        camera_type: gray, #[gray or gray+depth or rgb]\n        \
             slam_use: okvis }}\ncamera_parameters:\n    image_delay: 0.01 # [s]\nimu_parameters:\n    use: true\n    sigma_g_c: 2.0e-4\n    \
             sigma_a_c: 2.0e-3\n    sigma_gw_c: 2.0e-5\n    sigma_aw_c: 3.0e-3\n"
        ),
    );
    assert!(cairn_sources::assumed_in(&okvis).unwrap().contains("states no rate of the IMU: 200 samples"));
    assert_eq!(check(okvis, true).imu.unwrap().offset_s, 0.01);
    // SVO.
    let svo = folder.write(
        "svo.yaml",
        format!(
            "label: euroc\ncameras:\n- camera:\n    distortion:\n      parameters:\n        cols: 1\n        rows: 4\n        \
             data: [-0.28, 0.07, 0.0002, 1.8e-05]\n      type: radial-tangential\n    image_height: 480\n    image_width: 752\n    \
             intrinsics:\n      cols: 1\n      rows: 4\n      data: [458.6, 457.2, 367.2, 248.3]\n    label: cam0\n    type: pinhole\n  \
             T_B_C: {matrix}\nimu_params:\n  delay_imu_cam: 0.0\n  sigma_omega_c: 2.0e-4\n  sigma_acc_c: 2.0e-3\n  \
             sigma_omega_bias_c: 2.0e-5\n  sigma_acc_bias_c: 3.0e-3\n  imu_rate: 200.0\n"
        ),
    );
    assert_eq!(cairn_sources::assumed_in(&svo), None, "it states its rate");
    check(svo, true);
    // Kimera.
    let camera_of = |matrix: &str| {
        format!(
            "%YAML:1.0\ncamera_id: left_cam\nT_BS: {matrix}\nrate_hz: 20\nresolution: [752, 480]\ncamera_model: pinhole\n\
             intrinsics: [458.6, 457.2, 367.2, 248.3]\ndistortion_model: radial-tangential\n\
             distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]\n"
        )
    };
    let kimera = folder.write("kimera/LeftCameraParams.yaml", camera_of(&matrix));
    check(kimera.clone(), false);
    let right = matrix.replace("0.1", "0.21");
    folder.write("kimera/RightCameraParams.yaml", camera_of(&right));
    folder.write(
        "kimera/ImuParams.yaml",
        "%YAML:1.0\nsensor_type: imu\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nrate_hz: 200\n\
         gyroscope_noise_density: 2.0e-4\ngyroscope_random_walk: 2.0e-5\naccelerometer_noise_density: 2.0e-3\n\
         accelerometer_random_walk: 3.0e-3\nimu_time_shift: 0.02\n",
    );
    let rig = check(kimera, true);
    assert_eq!((rig.cameras.len(), rig.imu.unwrap().offset_s), (2, -0.02));
    // OpenVINS names a chain of Kalibr, with camera in IMU.
    folder.write(
        "openvins/chain.yaml",
        format!(
            "%YAML:1.0\ncam0:\n  T_imu_cam: #rotation from camera to IMU R_CtoI\n    [{flat}]\n  cam_overlaps: [1]\n  camera_model: pinhole\n  \
             distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]\n  distortion_model: radtan\n  intrinsics: [458.6, 457.2, 367.2,\n    248.3] #fu, fv, cu, cv\n  \
             resolution: [752, 480]\n"
        ),
    );
    let noise = "accelerometer_noise_density: 2.0e-3\n  accelerometer_random_walk: 3.0e-3\n  gyroscope_noise_density: 2.0e-4\n  \
                 gyroscope_random_walk: 2.0e-5\n  update_rate: 200.0\n";
    folder.write("openvins/noise.yaml", format!("%YAML:1.0\nimu0:\n  {noise}"));
    let openvins = folder.write(
        "openvins/estimator_config.yaml",
        "%YAML:1.0\nverbosity: \"INFO\"\nuse_fej: true\nrelative_config_imu: \"noise.yaml\"\nrelative_config_imucam: \"chain.yaml\"\n",
    );
    check(openvins, true);
    // Basalt: JSON, with quaternions.
    let half = 0.5f64.sqrt();
    let basalt = folder.write(
        "basalt.json",
        format!(
            r#"{{"value0": {{"T_imu_cam": [{{"px": 0.1, "py": 0.2, "pz": 0.3, "qx": 0, "qy": 0, "qz": {half}, "qw": {half}}}],
            "intrinsics": [{{"camera_type": "pinhole-radtan8", "intrinsics": {{"fx": 458.6, "fy": 457.2, "cx": 367.2, "cy": 248.3,
            "k1": -0.28, "k2": 0.07, "p1": 0.0002, "p2": 1.8e-5, "k3": 0, "k4": 0, "k5": 0, "k6": 0}}}}],
            "resolution": [[752, 480]], "imu_update_rate": 200.0, "gyro_noise_std": [2e-4, 2e-4, 2e-4],
            "accel_noise_std": [2e-3, 2e-3, 2e-3], "gyro_bias_std": [2e-5, 2e-5, 2e-5], "accel_bias_std": [3e-3, 3e-3, 3e-3],
            "cam_time_offset_ns": 0}}}}"#
        ),
    );
    let rig = read_rig(basalt).unwrap();
    assert_eq!(
        rig.cameras[0].camera.distortion,
        Distortion::Rational([-0.28, 0.07, 0.0002, 1.8e-5, 0.0, 0.0, 0.0, 0.0])
    );
    assert!((rig.cameras[0].body_from_camera.rotation.angle() - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    assert_eq!((rig.cameras[0].camera.fx, rig.imu.unwrap().noise.accel_walk), (458.6, 3e-3));
    // NICE-SLAM: depth registered to colour.
    let nice = folder.write(
        "nice.yaml",
        "inherit_from: configs/TUM_RGBD/tum.yaml\ncam: #NOTE: intrinsics of freiburg1\n  H: 480\n  W: 640\n  fx: 517.3\n  fy: 516.5\n  \
         cx: 318.6\n  cy: 255.3\n  crop_size: [384,512]\n  png_depth_scale: 5000.0\n  distortion: [0.2624, -0.9531, -0.0054, 0.0026, 1.1633]\n",
    );
    let rig = read_rig(nice).unwrap();
    assert_eq!((rig.cameras[0].camera.fx, rig.depth.unwrap().metres_per_unit), (517.3, 1.0 / 5000.0));
}

#[test]
fn lenses_of_other_systems_are_read() {
    let lens = |text: &str| {
        let folder = Folder::new();
        let rig = read_rig(folder.write("rig.yaml", text)).unwrap_or_else(|e| panic!("{text}: {e}"));
        (rig.cameras[0].camera.fx, rig.cameras[0].camera.distortion)
    };
    let camodocal = |model: &str, more: &str| {
        format!(
            "%YAML:1.0\n---\nmodel_type: {model}\ncamera_name: camera\nimage_width: 752\nimage_height: 480\n{more}"
        )
    };
    let mei = camodocal(
        "MEI",
        "mirror_parameters:\n   xi: 1.9\ndistortion_parameters:\n   k1: 0.02\n   k2: 0.5\n   p1: 0.001\n   p2: 0.0007\nprojection_parameters:\n   \
         gamma1: 1170.0\n   gamma2: 1166.0\n   u0: 370.0\n   v0: 240.0\n",
    );
    assert_eq!(lens(&mei), (1170.0, Distortion::Unified([1.9, 0.02, 0.5, 0.001, 0.0007])));
    let kannala = camodocal(
        "KANNALA_BRANDT",
        "projection_parameters:\n   k2: 0.01\n   k3: -0.02\n   k4: 0.03\n   k5: -0.004\n   mu: 460.0\n   mv: 461.0\n   u0: 370.0\n   v0: 240.0\n",
    );
    assert_eq!(lens(&kannala), (460.0, Distortion::Equidistant([0.01, -0.02, 0.03, -0.004])));
    let chain = |model: &str, intrinsics: &str, distortion: &str| {
        format!(
            "cam0: {{camera_model: {model}, intrinsics: [{intrinsics}], {distortion}, resolution: [752, 480]}}\n"
        )
    };
    let omni = chain(
        "omni",
        "1.9, 1170.0, 1166.0, 370.0, 240.0",
        "distortion_model: radtan, distortion_coeffs: [0.02, 0.5, 0.001, 0.0007]",
    );
    assert_eq!(lens(&omni), lens(&mei));
    let none = "distortion_model: none, distortion_coeffs: []";
    let eucm = chain("eucm", "0.6, 1.1, 300.0, 300.0, 370.0, 240.0", none);
    assert_eq!(lens(&eucm), (300.0, Distortion::ExtendedUnified { alpha: 0.6, beta: 1.1 }));
    let own = |model: &str, c: &str| {
        let folder = Folder::new();
        let text = format!(
            "[[cameras]]\nresolution = [752, 480]\nfocal = [300.0, 300.0]\ncentre = [370.0, 240.0]\n[cameras.distortion]\nmodel = \"{model}\"\ncoefficients = {c}\n"
        );
        let rig = read_rig(folder.write("rig.toml", text)).unwrap();
        assert_eq!(read_rig(folder.write("again.toml", write_rig(&rig).unwrap())).unwrap(), rig);
        rig.cameras[0].camera.distortion
    };
    assert_eq!(own("division", "[-0.2]"), Distortion::Division(-0.2));
    assert_eq!(
        own("unified", "[1.9, 0.02, 0.5, 0.001, 0.0007]"),
        Distortion::Unified([1.9, 0.02, 0.5, 0.001, 0.0007])
    );
    assert_eq!(own("extended-unified", "[0.6, 1.1]"), Distortion::ExtendedUnified { alpha: 0.6, beta: 1.1 });
    assert!(
        refused(&camodocal("SCARAMUZZA", "projection_parameters: {}\n"), "a.yaml").contains("SCARAMUZZA")
    );
}
