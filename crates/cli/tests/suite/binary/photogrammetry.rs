//! `cairn map export --colmap`, `--nerfstudio`: what the files say is read here as their formats define it.

use crate::binary::{cairn, fails, folder, json, stderr};
use cairn_geometry::{Mat3, Vec2, Vec3};
use cairn_sources::{OpenOptions, open, read_gray};
use cairn_vision::{Features, OrbConfig, OrbExtractor};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const WORLD: &str = "sim:demo?duration=3&resolution=320x240&sensor=rgbd";

/// An image of COLMAP: its name, the world in the camera, and features with the points they show.
struct Image {
    name: String,
    rotation: Mat3,
    translation: Vec3,
    features: Vec<(Vec2, Option<usize>)>,
}

/// The matrix of a unit quaternion.
fn matrix(w: f64, v: Vec3) -> Mat3 {
    let cross = v.cross_matrix();
    Mat3::identity() + 2.0 * w * cross + 2.0 * cross * cross
}

/// A model of one camera: its parameters, its images, and the positions of its points.
struct Colmap {
    size: [usize; 2],
    focal: Vec2,
    centre: Vec2,
    images: Vec<Image>,
    points: BTreeMap<usize, Vec3>,
    tracks: usize,
}

impl Colmap {
    fn read(folder: &Path) -> Self {
        let file = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
        let data =
            |text: &str| text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect::<Vec<_>>();
        let numbers = |words: &[&str]| words.iter().map(|w| w.parse::<f64>().unwrap()).collect::<Vec<_>>();
        let [camera] = &data(&file("cameras.txt"))[..] else { panic!("several cameras") };
        let words: Vec<&str> = camera.split(' ').collect();
        assert_eq!(words[..2], ["1", "PINHOLE"]);
        let c = numbers(&words[2..]);
        let image = |lines: &[String]| {
            let words: Vec<&str> = lines[0].split(' ').collect();
            let p = numbers(&words[1..8]);
            assert_eq!(words[8], "1", "its camera");
            let of_features = numbers(&lines[1].split_whitespace().collect::<Vec<_>>());
            let shown = |id: f64| (id >= 0.0).then_some(id as usize);
            Image {
                name: words[9].into(),
                rotation: matrix(p[0], Vec3::new(p[1], p[2], p[3])),
                translation: Vec3::new(p[4], p[5], p[6]),
                features: of_features.chunks(3).map(|f| (Vec2::new(f[0], f[1]), shown(f[2]))).collect(),
            }
        };
        let images: Vec<Image> = data(&file("images.txt")).chunks(2).map(image).collect();
        let (mut points, mut tracks) = (BTreeMap::new(), 0);
        for line in data(&file("points3D.txt")) {
            let p = numbers(&line.split(' ').collect::<Vec<_>>());
            points.insert(p[0] as usize, Vec3::new(p[1], p[2], p[3]));
            for at in p[8..].chunks(2) {
                let feature = images[at[0] as usize - 1].features[at[1] as usize];
                assert_eq!(feature.1, Some(p[0] as usize), "track and image differ");
                tracks += 1;
            }
        }
        let (size, focal, centre) =
            ([c[0] as usize, c[1] as usize], Vec2::new(c[2], c[3]), Vec2::new(c[4], c[5]));
        Self { size, focal, centre, images, points, tracks }
    }

    /// Mean distance between features and the projections of their points.
    fn error_px(&self) -> f64 {
        let of_image = |i: &Image| {
            let error = |(px, point): &(Vec2, Option<usize>)| {
                let p = i.rotation * self.points[&(*point)?] + i.translation;
                assert!(p.z > 0.0, "behind the camera");
                Some(((p.xy() / p.z).component_mul(&self.focal) + self.centre - px).norm())
            };
            i.features.iter().filter_map(error).collect::<Vec<_>>()
        };
        let errors: Vec<f64> = self.images.iter().flat_map(of_image).collect();
        assert_eq!(errors.len(), self.tracks, "an observation is in one file only");
        errors.iter().sum::<f64>() / errors.len() as f64
    }
}

/// A saved map of a run.
fn map_of(folder: &Path, name: &str, run: &[&str]) -> String {
    let map = folder.join(name).to_str().unwrap().to_owned();
    let done = cairn(&[&["run"], run, &["--map-out", &map]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    map
}

#[test]
fn a_map_is_a_model_of_colmap_and_nerfstudio() {
    let folder = folder("photogrammetry");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let map = map_of(&folder, "a.map", &[WORLD]);
    let (colmap, nerf) = (path("colmap"), path("nerf"));
    let export = ["map", "export", &map, "--colmap", &colmap, "--nerfstudio", &nerf];
    let report =
        json(&cairn(&[&export[..], &["--images", WORLD, "--json"]].concat()))["photogrammetry"].clone();
    let model = Colmap::read(Path::new(&colmap));
    assert_eq!(report["views"], report["pictures"], "{report}");
    assert_eq!((&report["metric"], model.size), (&true.into(), [320, 240]), "{report}");
    assert!(model.tracks > 500 && model.images.len() >= 4, "{} of {}", model.tracks, model.images.len());
    let error = model.error_px();
    assert!(error < 1.0, "{error} px");

    // The sensor has no lens: its pictures are as they were.
    let first = open(WORLD, OpenOptions::default()).unwrap().next_packet().unwrap().unwrap();
    let picture = |name: &str| read_gray(&Path::new(&colmap).join("images").join(name)).unwrap();
    assert!(picture(&model.images[0].name) == *first.images[0], "another picture");
    assert!(!Path::new(&colmap).join("mask.png").exists(), "all pixels are of the world");

    // nerfstudio's points are COLMAP's in the same order; its cameras look along -z with y up.
    let text = std::fs::read_to_string(path("nerf/transforms.json")).unwrap();
    let json: Value = serde_json::from_str(&text).unwrap();
    let number = |name: &str| json[name].as_f64().unwrap();
    let frames = json["frames"].as_array().unwrap();
    assert_eq!(frames.len(), model.images.len());
    let mut off = Vec::new();
    for (frame, image) in frames.iter().zip(&model.images) {
        assert_eq!(frame["file_path"], format!("images/{}", image.name));
        assert!(Path::new(&nerf).join("images").join(&image.name).exists());
        let m = |row: usize, column: usize| frame["transform_matrix"][row][column].as_f64().unwrap();
        let [axes, at] = [Mat3::from_fn(m), Mat3::from_fn(|row, _| m(row, 3))];
        for (px, id) in image.features.iter().filter_map(|(px, id)| Some((px, (*id)?))) {
            let p = axes.transpose() * (model.points[&id] - at.column(0));
            let [u, v] = [number("fl_x") * p.x / -p.z, number("fl_y") * -p.y / -p.z];
            assert!(p.z < 0.0, "behind the camera");
            off.push((Vec2::new(u + number("cx"), v + number("cy")) - px).norm());
        }
    }
    let of_nerf = off.iter().sum::<f64>() / off.len() as f64;
    assert!((of_nerf - error).abs() < 1e-6, "{of_nerf} px, in COLMAP's model {error} px");
    let ply = std::fs::read_to_string(path("nerf/points.ply")).unwrap();
    let vertices = ply.lines().skip_while(|l| *l != "end_header").skip(1);
    let vertices: Vec<Vec<f64>> =
        vertices.map(|l| l.split(' ').map(|v| v.parse().unwrap()).collect()).collect();
    assert_eq!(vertices.len(), model.points.len());
    assert!(vertices.iter().zip(model.points.values()).all(|(v, p)| v[..3] == p.as_slice()[..]));
    assert!(vertices.iter().any(|v| v[3] != vertices[0][3]), "the points have no luminance");

    fails(&export, &["cameras.txt", "exists"]);
    let other = "sim:demo?duration=3&resolution=320x240&sensor=rgbd&seed=9";
    let again = ["map", "export", &map, "--overwrite", "--colmap", &colmap, "--images"];
    fails(&[&again[..], &[other]].concat(), &["seed=9", "no image is that of a key frame"]);
    fails(&[&again[..], &["sim:demo?sensor=rgbd"]].concat(), &["another camera"]);
    let misused = cairn(&["map", "export", &map, "--images", WORLD]);
    assert_eq!(misused.status.code(), Some(2), "{}", stderr(&misused));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_model_without_pictures_or_metres_says_so() {
    let folder = folder("photogrammetry-mono");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let map = map_of(&folder, "a.map", &[WORLD, "--sensor", "mono"]);
    let done = cairn(&["map", "export", &map, "--colmap", &path("colmap")]);
    assert!(stderr(&done).contains("no pictures: give the recording with --images"), "{}", stderr(&done));
    let text = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(text.contains("0 pictures; lengths have no unit"), "{text}");
    let images = std::fs::read_to_string(path("colmap/images.txt")).unwrap();
    assert!(images.starts_with("# Lengths have no unit."), "{images}");
    assert!(Colmap::read(&folder.join("colmap")).error_px() < 1.5);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A recording of the data folder; `None` where it is missing.
fn recording(name: &str) -> Option<String> {
    let data = std::env::var_os("CAIRN_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let recording = data.join(name);
    if !recording.exists() {
        assert!(std::env::var("CI").is_err(), "recordings are missing");
        println!("skipped: {} is missing", recording.display());
        return None;
    }
    Some(recording.to_str().unwrap().to_owned())
}

/// A phone that nobody calibrated: the run found another focal length than is assumed where the recording is opened again.
#[test]
fn the_focal_length_that_a_run_found_is_that_of_the_model() {
    let Some(recording) = recording("phone/b") else { return };
    let folder = folder("photogrammetry-phone");
    let map = map_of(&folder, "a.map", &[&recording, "--frames", "250"]);
    let colmap = folder.join("colmap");
    let done = cairn(&["map", "export", &map, "--colmap", colmap.to_str().unwrap(), "--images", &recording]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let model = Colmap::read(&colmap);
    let assumed = open(&recording, OpenOptions::default()).unwrap().rig().cameras[0].camera.fx;
    assert!(model.focal.x > 1.02 * assumed, "{} where {assumed} is assumed", model.focal.x);
    assert!(model.error_px() < 1.5, "{} px", model.error_px());
    assert!(colmap.join("images").join(&model.images[0].name).exists());
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A pair of lenses that are not pinholes and not parallel: corners of the rectified pictures are where the model says.
#[test]
fn rectified_pictures_show_the_features_of_the_model() {
    let Some(recording) = recording("euroc-mh01") else { return };
    let folder = folder("photogrammetry-euroc");
    let map = map_of(&folder, "a.map", &[&recording, "--frames", "60", "--sensor", "stereo"]);
    let colmap = folder.join("colmap");
    let done = cairn(&["map", "export", &map, "--colmap", colmap.to_str().unwrap(), "--images", &recording]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let model = Colmap::read(&colmap);
    assert!(model.error_px() < 1.5, "{} px", model.error_px());
    let picture = read_gray(&colmap.join("images").join(&model.images[0].name)).unwrap();
    assert_eq!([picture.width(), picture.height()], model.size);
    assert!(read_gray(&colmap.join("mask.png")).unwrap().data().contains(&0), "a lens leaves corners");
    let mut corners = Features::default();
    OrbExtractor::new(OrbConfig { features: 4000, ..OrbConfig::default() }).extract(&picture, &mut corners);
    let nearest = |px: &Vec2| {
        // A corner's pixel is counted from the centre of the first, COLMAP's from its edge.
        let off = |raw: &[f32; 2]| (Vec2::new(raw[0].into(), raw[1].into()).add_scalar(0.5) - px).norm();
        corners.raw.iter().map(off).fold(f64::INFINITY, f64::min)
    };
    let mut off: Vec<f64> = model.images[0].features.iter().map(|(px, _)| nearest(px)).collect();
    off.sort_by(f64::total_cmp);
    let median = off[off.len() / 2];
    assert!(median < 1.0, "{median} px");
    std::fs::remove_dir_all(&folder).unwrap();
}
