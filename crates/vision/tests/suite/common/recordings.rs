//! Recordings from the folder in `CAIRN_DATA`, else `../shared/data` beside the workspace.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthImage, DepthSensor, Distortion, GrayImage, Rig, RigCamera};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zune_jpeg::zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions};

/// The folder of a recording, or `None` after printing that the test is skipped.
pub fn folder(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("CAIRN_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join(name);
    if !path.is_dir() {
        println!("skipped: no recording at {}", path.display());
        return None;
    }
    Some(path)
}

pub fn jpeg(path: &Path) -> Arc<GrayImage> {
    let bytes = std::fs::read(path).unwrap();
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let data = decoder.decode().unwrap();
    let (w, h) = decoder.dimensions().unwrap();
    Arc::new(GrayImage::from_vec(w, h, data).unwrap())
}

pub fn depth_png(path: &Path) -> Arc<DepthImage> {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(info.bit_depth, png::BitDepth::Sixteen);
    let data = bytes.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
    Arc::new(DepthImage::from_vec(info.width as usize, info.height as usize, data).unwrap())
}

/// All numbers in a text file.
pub fn numbers(path: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    text.split_whitespace().filter_map(|t| t.parse().ok()).collect()
}

/// Files of a folder with a given suffix, sorted by name.
pub fn listing(path: &Path, ending: &str) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(path).unwrap().map(|e| e.unwrap().path()).collect();
    all.retain(|p| p.to_string_lossy().ends_with(ending));
    all.sort();
    all
}

fn rigid(m: [f64; 12]) -> Se3 {
    Se3::from_matrix(&nalgebra::Matrix4::from_row_slice(&[m.as_slice(), &[0.0, 0.0, 0.0, 1.0]].concat()))
}

/// The calibration that EuRoC publishes for its MAV (sensor.yaml of both cameras).
pub fn euroc_rig() -> Rig {
    let camera = |f: [f64; 4], d: [f64; 4]| Camera {
        distortion: Distortion::RadialTangential([d[0], d[1], d[2], d[3], 0.0]),
        ..Camera::pinhole(752, 480, f[0], f[1], f[2], f[3])
    };
    #[rustfmt::skip]
    let left = rigid([
        0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
        0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
    ]);
    #[rustfmt::skip]
    let right = rigid([
        0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556,
        0.999598781151, 0.0130119051815, 0.0251588363115, 0.0453689425024,
        -0.0253898008918, 0.0179005838253, 0.999517347078, 0.00786212447038,
    ]);
    let cameras = vec![
        RigCamera {
            name: "cam0".into(),
            camera: camera(
                [458.654, 457.296, 367.215, 248.375],
                [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
            ),
            body_from_camera: left,
        },
        RigCamera {
            name: "cam1".into(),
            camera: camera(
                [457.587, 456.134, 379.999, 255.238],
                [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05],
            ),
            body_from_camera: right,
        },
    ];
    Rig { cameras, depth: None, imu: None }
}

/// The rectified pair of `kitti-a` (its calib.txt).
pub fn kitti_rig() -> Rig {
    let camera = Camera::pinhole(1226, 370, 707.0912, 707.0912, 601.8873, 183.1104);
    let at = |name: &str, x: f64| RigCamera {
        name: name.into(),
        camera,
        body_from_camera: Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0)),
    };
    Rig { cameras: vec![at("cam0", 0.0), at("cam1", 379.8145 / 707.0912)], depth: None, imu: None }
}

/// The Kinect of `7scenes-kitchen`: one camera for colour and depth as published, or the two real cameras (the pose of
/// the colour camera was estimated from the depth and colour edges of the recording). The body is the depth camera.
pub fn kitchen_rig(registered: bool) -> Rig {
    let depth = Camera::pinhole(640, 480, 585.0, 585.0, 320.0, 240.0);
    let mut rig = Rig::mono(depth);
    if !registered {
        let turn = So3::exp(&Vec3::new(0.0047, -0.0012, 0.0074));
        let colour_from_depth = Se3::new(turn, Vec3::new(-0.0220, 0.0017, 0.0));
        rig = Rig::mono(Camera::pinhole(640, 480, 526.4, 526.4, 320.0, 240.0));
        rig.cameras[0].body_from_camera = colour_from_depth.inverse();
    }
    rig.depth = Some(DepthSensor {
        camera: depth,
        body_from_depth: Se3::identity(),
        metres_per_unit: 0.001,
        registered,
    });
    rig
}

/// Left and right image and the ground-truth `world_from_body`.
pub type Shot = (PathBuf, PathBuf, Se3);

/// All of `kitti-a`; the body is the left camera.
pub fn kitti_shots() -> Option<Vec<Shot>> {
    let path = folder("kitti-a")?;
    let truth = numbers(&path.join("poses.txt"));
    let pairs =
        listing(&path.join("image_0"), ".jpg").into_iter().zip(listing(&path.join("image_1"), ".jpg"));
    let pose = |m: &[f64]| m.try_into().map(rigid).unwrap();
    Some(pairs.zip(truth.chunks_exact(12)).map(|((l, r), m)| (l, r, pose(m))).collect())
}

/// The pairs of `euroc-mh01` with a ground-truth pose within 3 ms; the body is the IMU.
pub fn euroc_shots() -> Option<Vec<Shot>> {
    let mav = folder("euroc-mh01")?.join("mav0");
    let text = std::fs::read_to_string(mav.join("state_groundtruth_estimate0/data.csv")).unwrap();
    let truth: Vec<(i64, Se3)> = text
        .lines()
        .filter(|l| !l.starts_with('#'))
        .filter_map(|l| {
            let mut fields = l.split(',').map(str::trim);
            let stamp = fields.next()?.parse().ok()?;
            let v: Vec<f64> = fields.filter_map(|f| f.parse().ok()).collect();
            let r = So3::from_xyzw(*v.get(4)?, *v.get(5)?, *v.get(6)?, v[3])?;
            Some((stamp, Se3::new(r, Vec3::new(v[0], v[1], v[2]))))
        })
        .collect();
    let pairs =
        listing(&mav.join("cam0/data"), ".jpg").into_iter().zip(listing(&mav.join("cam1/data"), ".jpg"));
    let with_truth = |(l, r): (PathBuf, PathBuf)| {
        let stamp: i64 = l.file_stem()?.to_str()?.parse().ok()?;
        let near = truth.get(truth.partition_point(|t| t.0 < stamp)).filter(|t| t.0 - stamp < 3_000_000)?;
        Some((l, r, near.1))
    };
    Some(pairs.filter_map(with_truth).collect())
}
