//! Calibrations as tools and factories write them: OpenCV, ROS's `ost.txt`, ZED, DepthAI, nerfstudio, bare numbers.

use crate::common::Folder;
use cairn_geometry::Vec3;
use cairn_sensor::{Camera, Distortion};
use cairn_sources::{assumed_in, read_rig, read_rig_for};

const XML: &str = r#"<?xml version="1.0"?>
<opencv_storage>
<!-- a <comment> -->
<calibration_Time>"Fri Jul 31 16:23:59 2020"</calibration_Time>
<image_width>1280</image_width>
<image_height>720</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    6.2e+02 0. 6.3e+02 0.
    6.1e+02 3.5e+02 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    8.0e-02 -5.0e-02 2.0e-03
    -4.0e-03 2.0e-02</data></distortion_coefficients>
</opencv_storage>
"#;

fn brown(c: [f64; 5], size: [usize; 2], f: [f64; 2], centre: [f64; 2]) -> Camera {
    let lens = Distortion::RadialTangential(c);
    Camera { distortion: lens, ..Camera::pinhole(size[0], size[1], f[0], f[1], centre[0], centre[1]) }
}

#[test]
fn opencv_writes_xml_and_yaml_with_and_without_a_size() {
    let folder = Folder::new();
    let right = brown([0.08, -0.05, 0.002, -0.004, 0.02], [1280, 720], [620.0, 610.0], [630.0, 350.0]);
    assert_eq!(read_rig(folder.write("out_camera_data.xml", XML)).unwrap().cameras[0].camera, right);
    // The older tutorial's names; without a size it is that of the recording.
    let old = XML.replace("camera_matrix", "Camera_Matrix").replace("distortion_c", "Distortion_C");
    let old = old.replace("<image_width>1280</image_width>\n<image_height>720</image_height>\n", "");
    let path = folder.write("old.xml", old);
    let error = read_rig(&path).unwrap_err().to_string();
    assert!(error.contains("does not state the size") && error.contains("--with"), "{error}");
    assert_eq!(read_rig_for(&path, Some([1280, 720])).unwrap().cameras[0].camera, right);
    for cut in [XML.len() / 3, XML.len() - 20] {
        let error = read_rig(folder.write("cut.xml", &XML[..cut])).unwrap_err().to_string();
        assert!(error.contains("is no XML of OpenCV") || error.contains("known kind"), "{error}");
    }
    let kinect = "%YAML:1.0\ncameraMatrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1035., 0., 953., 0., 1036., 551., 0., 0., 1. ]\n\
        distortionCoefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ 0.05, -0.06, 0.002, -0.001, 0. ]\n";
    let rig = read_rig_for(folder.write("calib_color.yaml", kinect), Some([1920, 1080])).unwrap();
    assert_eq!(
        rig.cameras[0].camera,
        brown([0.05, -0.06, 0.002, -0.001, 0.0], [1920, 1080], [1035.0, 1036.0], [953.0, 551.0])
    );
    let script = r#"{"camera_matrix": [[910, 0, 645], [0, 905, 355], [0, 0, 1]], "dist_coeffs": [[0.1, 0.2, 0.003, 0.004, 0.5, 0.6, 0.7, 0.8]], "image_size": [1280, 720]}"#;
    let camera = read_rig(folder.write("calibration.json", script)).unwrap().cameras[0].camera;
    assert_eq!(camera.distortion, Distortion::Rational([0.1, 0.2, 0.003, 0.004, 0.5, 0.6, 0.7, 0.8]));
    // Four coefficients are of a fisheye where the file says so.
    let yaml = "%YAML:1.0\n---\nimage_width: 1280\nimage_height: 720\nfisheye_model: 1\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
        data: [ 910., 0., 645., 0., 905., 355., 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: [ -0.02, 0.013, -0.01, 0.002 ]\n";
    let lens = |text: &str| read_rig(folder.write("a.yml", text)).unwrap().cameras[0].camera.distortion;
    assert_eq!(lens(yaml), Distortion::Equidistant([-0.02, 0.013, -0.01, 0.002]));
    let pinhole = yaml.replace("fisheye_model: 1", "fisheye_model: 0");
    assert_eq!(lens(&pinhole), Distortion::RadialTangential([-0.02, 0.013, -0.01, 0.002, 0.0]));
}

#[test]
fn pairs_of_opencv_and_of_sptam_have_a_baseline_to_the_right() {
    let folder = Folder::new();
    let matrix = |name: &str, rows: usize, cols: usize, data: &str| {
        format!("{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n")
    };
    let k = |name: &str, f: f64| matrix(name, 3, 3, &format!("{f}, 0., 320., 0., {f}, 240., 0., 0., 1."));
    let d = |name: &str| matrix(name, 1, 5, "-0.1, 0.02, 0., 0., 0.");
    let path = folder.write(
        "intrinsics.yml",
        format!("%YAML:1.0\n---\n{}{}{}{}", k("M1", 500.0), d("D1"), k("M2", 510.0), d("D2")),
    );
    let error = read_rig_for(&path, Some([640, 480])).unwrap_err().to_string();
    assert!(error.contains("extrinsics.yml"), "{error}");
    let r = matrix("R", 3, 3, "1., 0., 0., 0., 1., 0., 0., 0., 1.");
    folder.write("extrinsics.yml", format!("%YAML:1.0\n---\n{r}{}", matrix("T", 3, 1, "-0.12, 0., 0.")));
    let rig = read_rig_for(&path, Some([640, 480])).unwrap();
    assert_eq!((rig.cameras[1].camera.fx, rig.cameras[1].body_from_camera.translation.x), (510.0, 0.12));
    assert!(rig.doubts().is_empty(), "{:?}", rig.doubts());
    // The squares of the board were given in millimetres.
    folder.write("extrinsics.yml", format!("%YAML:1.0\n---\n{r}{}", matrix("T", 3, 1, "-9., 0., 0.")));
    assert!(read_rig_for(&path, Some([640, 480])).unwrap().doubts()[0].contains("is the unit metres?"));
    let sptam = format!(
        "%YAML:1.0\n\nimage_width: 1242\nimage_height: 375\n{}\nbaseline: 5.4e-01\n",
        k("camera_matrix", 721.0)
    );
    let rig = read_rig(folder.write("kitti_cam_03.yaml", sptam)).unwrap();
    assert_eq!((rig.cameras.len(), rig.cameras[1].body_from_camera.translation.x), (2, 0.54));
}

#[test]
fn ost_of_ros_is_a_camera_info_and_a_right_camera_alone_is_told() {
    let folder = Folder::new();
    let ost = "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[narrow_stereo]\n\ncamera matrix\n511.5 0.000000 311.5\n0.000000 509.5 247.5\n\
        0.000000 0.000000 1.000000\n\ndistortion\n0.19 -0.31 0.002 -0.001 0.000000\n\nrectification\n1.000000 0.000000 0.000000\n0.000000 1.000000 0.000000\n0.000000 0.000000 1.000000\n\n\
        projection\n525.5 0.000000 310.0 0.000000\n0.000000 524.0 247.7 0.000000\n0.000000 0.000000 1.000000 0.000000\n";
    for name in ["ost.txt", "left.ini"] {
        assert_eq!(
            read_rig(folder.write(name, ost)).unwrap().cameras[0].camera,
            brown([0.19, -0.31, 0.002, -0.001, 0.0], [640, 480], [511.5, 509.5], [311.5, 247.5])
        );
    }
    let fisheye = ost.replace("0.19 -0.31 0.002 -0.001 0.000000", "0.19 -0.31 0.002 -0.001");
    let camera = read_rig(folder.write("fisheye.txt", fisheye)).unwrap().cameras[0].camera;
    assert_eq!(camera.distortion, Distortion::Equidistant([0.19, -0.31, 0.002, -0.001]));
    let right = ost.replace("525.5 0.000000 310.0 0.000000", "500.0 0.000000 310.0 -60.0");
    let left = folder.write("left.ini", ost);
    let right = folder.write("right.ini", right);
    assert_eq!(read_rig(&left).unwrap().cameras[1].body_from_camera.translation.x, 0.12);
    assert!(assumed_in(&right).unwrap().contains("is the right camera of a pair (0.120 m"));
    assert_eq!(assumed_in(&left), None);
}

const ZED: &str = "[LEFT_CAM_2K]\nfx=1398\nfy=1398\ncx=1125\ncy=617\nk1=-0.17\nk2=0.025\n\n[RIGHT_CAM_2K]\nfx=1395\nfy=1395\ncx=1158\ncy=610\nk1=-0.17\nk2=0.025\n\n\
    [LEFT_CAM_HD]\nfx=699.5\nfy=699.25\ncx=652.5\ncy=358.5\nk1=-0.17\nk2=0.025\np1=0.0001\np2=-0.0002\nk3=0.001\n\n\
    [RIGHT_CAM_HD]\nfx=697.5\nfy=697.25\ncx=671.5\ncy=354.5\nk1=-0.18\nk2=0.026\n\n[STEREO]\nBaseline=120\nTY=0\nTZ=-0.5\nCV_HD=0.01\nRX_HD=0\nRZ_HD=0\nCV_2K=0\nRX_2K=0\nRZ_2K=0\n";

#[test]
fn a_zed_has_its_baseline_in_millimetres_and_cameras_for_each_size() {
    let folder = Folder::new();
    let path = folder.write("SN12345.conf", ZED);
    let rig = read_rig(&path).unwrap();
    assert_eq!(
        rig.cameras[0].camera,
        brown([-0.17, 0.025, 0.0001, -0.0002, 0.001], [1280, 720], [699.5, 699.25], [652.5, 358.5])
    );
    // x_right = R x_left - t, with R a turn of 0.01 about y.
    let right = &rig.cameras[1];
    let (sin, cos) = 0.01_f64.sin_cos();
    let place = Vec3::new(0.12 * cos + 0.0005 * sin, 0.0, 0.12 * sin - 0.0005 * cos);
    assert!((right.body_from_camera.translation - place).norm() < 1e-12, "{:?}", right.body_from_camera);
    assert_eq!(right.camera.fx, 697.5);
    for size in [[2208, 1242], [4416, 1242]] {
        let rig = read_rig_for(&path, Some(size)).unwrap();
        assert_eq!((rig.cameras[0].camera.width, rig.cameras[0].camera.fx), (2208, 1398.0));
        assert_eq!(rig.cameras[1].body_from_camera.translation, Vec3::new(0.12, 0.0, -0.0005));
    }
    assert!(read_rig_for(&path, Some([640, 480])).unwrap_err().to_string().contains("640x480"));
    let cut = folder.write("cut.conf", ZED.replace("Baseline", "Base"));
    assert!(read_rig(cut).unwrap_err().to_string().contains("BASELINE is missing"));
}

#[test]
fn an_oak_has_its_baseline_in_centimetres() {
    let camera = |socket: usize, fx: f64, to: i32, x: f64| {
        format!(
            r#"[{socket}, {{"cameraType": 0, "distortionCoeff": [0.7, 0.1, -0.00002, -0.00008, 0.001, 1.06, 0.26, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            "extrinsics": {{"rotationMatrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "specTranslation": {{"x": 4.0, "y": 0, "z": 0}}, "toCameraSocket": {to},
            "translation": {{"x": {x}, "y": -0.5, "z": 0.0}}}}, "height": 800, "intrinsicMatrix": [[{fx}, 0, 640], [0, {fx}, 400], [0, 0, 1]], "width": 1280}}]"#
        )
    };
    let folder = Folder::new();
    let file =
        |all: &[String]| folder.write("calib.json", format!("{{\"cameraData\": [{}]}}", all.join(", ")));
    let colour = camera(0, 1500.0, -1, 0.0);
    // x_right = x_left - 7.5 cm: the right camera is to the right.
    let rig = read_rig(file(&[colour.clone(), camera(1, 800.0, 2, -7.5), camera(2, 801.0, 0, 4.0)])).unwrap();
    assert_eq!((rig.cameras[0].camera.fx, rig.cameras[1].camera.fx), (800.0, 801.0));
    assert_eq!(rig.cameras[1].body_from_camera.translation, Vec3::new(0.075, 0.005, 0.0));
    let lens = Distortion::Rational([0.7, 0.1, -0.00002, -0.00008, 0.001, 1.06, 0.26, 0.01]);
    assert_eq!(rig.cameras[0].camera.distortion, lens);
    // Both only to the colour camera between them.
    let rig = read_rig(file(&[colour.clone(), camera(1, 800.0, 0, -3.5), camera(2, 801.0, 0, 4.0)])).unwrap();
    assert!((rig.cameras[1].body_from_camera.translation.x - 0.075).abs() < 1e-12);
    assert_eq!(read_rig(file(&[colour])).unwrap().cameras[0].camera.fx, 1500.0);
}

#[test]
fn transforms_of_nerfstudio_count_pixels_from_their_corner() {
    let folder = Folder::new();
    let text = r#"{"camera_model": "OPENCV", "fl_x": 1072.5, "fl_y": 1073.5, "cx": 960.0, "cy": 540.0, "w": 1920, "h": 1080, "k1": 0.05, "k2": -0.06, "p1": 0.0001, "p2": 0.0002, "frames": []}"#;
    assert_eq!(
        read_rig(folder.write("transforms.json", text)).unwrap().cameras[0].camera,
        brown([0.05, -0.06, 0.0001, 0.0002, 0.0], [1920, 1080], [1072.5, 1073.5], [959.5, 539.5])
    );
    let synthetic = r#"{"camera_angle_x": 1.5707963267948966, "w": 800, "h": 600, "frames": []}"#;
    let camera = read_rig(folder.write("synthetic.json", synthetic)).unwrap().cameras[0].camera;
    assert!((camera.fx - 400.0).abs() < 1e-9 && camera.distortion == Distortion::None, "{camera:?}");
}

#[test]
fn bare_numbers_are_a_camera_with_the_size_of_the_recording() {
    let folder = Folder::new();
    let read = |name: &str, text: &str| read_rig_for(folder.write(name, text), Some([752, 480]));
    let droid = "458.5 457.5 367.5 248.5 -0.28 0.07 0.0002 1.8e-05";
    assert_eq!(
        read("euroc.txt", droid).unwrap().cameras[0].camera,
        brown([-0.28, 0.07, 0.0002, 1.8e-5, 0.0], [752, 480], [458.5, 457.5], [367.5, 248.5])
    );
    let pinhole = Camera::pinhole(752, 480, 585.0, 586.0, 320.0, 240.0);
    let matrix = "585.0 0.0 320.0\n0.0 586.0 240.0\n0.0 0.0 1.0\n";
    let scannet = "585.0 0 320.0 0\n0 586.0 240.0 0\n0 0 1 0\n0 0 0 1\n";
    for text in ["585 586 320 240\n", matrix, scannet] {
        assert_eq!(read("camera-intrinsics.txt", text).unwrap().cameras[0].camera, pinhole);
    }
    let error = read_rig(folder.write("a.txt", droid)).unwrap_err().to_string();
    assert!(error.contains("does not state the size") && error.contains("--with"), "{error}");
    // A pose is no camera.
    assert!(read("pose.txt", "0.9 0.1 0 1\n-0.1 0.9 0 2\n0 0 1 3\n0 0 0 1\n").is_err());
    assert!(read("pose.txt", "1.5 2.5 3.5 0 0 0 1\n").is_err());
}

#[test]
fn raw_kitti_states_the_size_of_its_rectified_images() {
    let folder = Folder::new();
    let p = |i: usize, t: f64| format!("P_rect_0{i}: 7.2e+02 0 6.0e+02 {t} 0 7.2e+02 1.7e+02 0 0 0 1 0\n");
    let text = format!("S_00: 1392 512\nS_rect_00: 1.242e+03 3.75e+02\n{}{}", p(0, 0.0), p(1, -360.0));
    let rig = read_rig(folder.write("calib_cam_to_cam.txt", text)).unwrap();
    assert_eq!((rig.cameras[0].camera.width, rig.cameras[0].camera.height), (1242, 375));
    assert_eq!(rig.cameras[1].body_from_camera.translation.x, 0.5);
}

#[test]
fn lenses_that_bend_back_or_have_no_coefficients_are_doubted() {
    let folder = Folder::new();
    let camera = |model: &str, d: &str| {
        format!(
            "image_width: 640\nimage_height: 480\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [650, 0, 315, 0, 630, 230, 0, 0, 1]\ndistortion_model: {model}\n\
             distortion_coefficients:\n  rows: 1\n  cols: {}\n  data: [{d}]\n",
            d.split(',').count()
        )
    };
    let doubts = |text: String| read_rig(folder.write("a.yaml", text)).unwrap().doubts();
    let [one] = &doubts(camera("plumb_bob", "-0.08, 2.26, -0.003, -0.002, -14.3"))[..] else { panic!() };
    assert!(one.contains("27 % of the image have no ray"), "{one}");
    let [one] = &doubts(camera("equidistant", "0, 0, 0, 0"))[..] else { panic!() };
    assert!(one.contains("is it a pinhole"), "{one}");
    for (model, d) in [
        ("plumb_bob", "-0.28, 0.07, 0, 0, 0"),
        ("equidistant", "0.01, 0, 0, 0"),
        ("plumb_bob", "0, 0, 0, 0, 0"),
    ] {
        assert_eq!(doubts(camera(model, d)), [""; 0], "{model} {d}");
    }
}
