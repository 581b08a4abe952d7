//! Rig files: all real ones of the data folder, and small ones with every fault we could think of.

use crate::common;

use cairn_geometry::{So3, Vec2, Vec3};
use cairn_sensor::{Camera, Distortion, Rig};
use cairn_sources::{read_rig, read_rig_for, write_rig};
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
    let text = refused(&kalibr.replace("pinhole", "omni"), "camchain.yaml");
    assert!(text.contains("line 2") && text.contains("\"omni\" is not known"), "{text}");
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
