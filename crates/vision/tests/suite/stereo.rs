//! Stereo matching against exact ground truth, and match rates on recordings.

use crate::common;

use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{FramePacket, GrayImage, Rig, Stamp};
use cairn_vision::{Frame, FrontEnd, FrontEndConfig, OrbConfig, SensorMode};
use common::recordings::{euroc_rig, folder, jpeg, kitti_rig, listing};
use common::scene::{Exposure, Rectangle, Scene, lens_pair, pinhole_pair};
use std::sync::Arc;

fn packet(images: Vec<Arc<GrayImage>>) -> FramePacket {
    FramePacket { stamp: Stamp(0), images, depth: None, imu: Vec::new(), decode_ms: 0.0 }
}

fn config(features: usize) -> FrontEndConfig {
    FrontEndConfig { orb: OrbConfig { features, ..OrbConfig::default() }, ..FrontEndConfig::default() }
}

/// Disparity errors of some frames.
#[derive(Default)]
struct Score {
    features: usize,
    matched: usize,
    /// Matches with an error of more than one pixel of the feature's level.
    wrong: usize,
    /// Errors in pixels of the level, of the other matches.
    errors: Vec<f64>,
}

impl Score {
    fn quantile(&self, q: f64) -> f64 {
        let mut sorted: Vec<f64> = self.errors.iter().map(|e| e.abs()).collect();
        sorted.sort_by(f64::total_cmp);
        sorted[(q * (sorted.len() - 1) as f64) as usize]
    }

    /// Adds the frame of a pair whose left camera is at the world origin.
    fn add(&mut self, rig: &Rig, scene: &Scene, images: [Arc<GrayImage>; 2]) {
        let mut front_end = FrontEnd::new(rig, SensorMode::Stereo, config(1200)).unwrap();
        let left = &rig.cameras[0];
        let frame: Frame = front_end.extract(&packet(images.to_vec())).unwrap();
        let rectified_from_left = front_end.model().body_from_camera.inverse() * left.body_from_camera;
        self.features += frame.len();
        for i in (0..frame.len()).filter(|&i| frame.has_depth(i)) {
            let raw = frame.raw[i];
            let Some(z) = scene.depth(&left.camera, &Se3::identity(), raw) else { continue };
            let b = left.camera.unproject(&Vec2::new(raw[0] as f64, raw[1] as f64)).unwrap();
            let [u, v, right_x] = front_end.model().project(&(rectified_from_left * (b / b.z * z))).unwrap();
            assert!((u - frame.px[i][0] as f64).abs() < 0.01 && (v - frame.px[i][1] as f64).abs() < 0.01);
            let product = frame.depth[i] as f64 * (frame.px[i][0] - frame.right_x[i]) as f64;
            assert!((product / front_end.model().baseline_fx - 1.0).abs() < 1e-3);
            self.matched += 1;
            let error = (frame.right_x[i] as f64 - right_x) / front_end.octaves().scale(frame.octave[i]);
            if error.abs() > 1.0 { self.wrong += 1 } else { self.errors.push(error) }
        }
    }
}

#[test]
fn disparity_matches_the_ground_truth() {
    for (name, rig) in [("pinhole", pinhole_pair()), ("lens", lens_pair())] {
        let mut scores: [Score; 2] = Default::default();
        for seed in 0..3 {
            let scene = Scene::room(seed);
            let (left, right) = (&rig.cameras[0], &rig.cameras[1]);
            let world_from_right = left.body_from_camera.inverse() * right.body_from_camera;
            let exposure = |gain, offset, seed| Exposure { gain, offset, noise: 2.0, seed };
            let l = Arc::new(scene.render(&left.camera, &Se3::identity(), &exposure(1.0, 0.0, seed)));
            let r = scene.render(&right.camera, &world_from_right, &exposure(1.0, 0.0, seed + 50));
            let mut darker = r.clone();
            darker.data_mut().iter_mut().for_each(|v| *v = (*v as f32 * 0.7 + 20.0).round() as u8);
            scores[0].add(&rig, &scene, [l.clone(), Arc::new(r)]);
            scores[1].add(&rig, &scene, [l, Arc::new(darker)]);
        }
        for (exposure, s) in ["equal", "right darker"].iter().zip(&scores) {
            let n = s.errors.len() as f64;
            let bias = s.errors.iter().sum::<f64>() / n;
            let rms = (s.errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
            let share = s.matched as f64 / s.features as f64;
            let wrong = s.wrong as f64 / s.matched as f64;
            println!(
                "{name}, exposure {exposure}: {} of {} matched ({share:.3}), {} wrong ({:.2} %); error in level \
                 pixels: median {:.4}, 90 % {:.4}, 99 % {:.3}, rms {rms:.4}, bias {bias:+.4}",
                s.matched,
                s.features,
                s.wrong,
                100.0 * wrong,
                s.quantile(0.5),
                s.quantile(0.9),
                s.quantile(0.99)
            );
            assert!(share > 0.5, "{share}");
            assert!(wrong < 0.01, "{wrong}");
            assert!(rms < 0.15 && s.quantile(0.5) < 0.06 && bias.abs() < 0.02);
        }
    }
}

#[test]
fn distant_points_keep_right_x_without_bias() {
    let rig = pinhole_pair();
    let (left, right) = (&rig.cameras[0], &rig.cameras[1]);
    let world_from_right = left.body_from_camera.inverse() * right.body_from_camera;
    // A wall with a disparity of 0.14 pixels: noise makes many negative, and some large enough for a depth.
    let wall = |z: f64| {
        let edges = [Vec3::new(2.0 * z, 0.0, 0.0), Vec3::new(0.0, 1.4 * z, 0.0)];
        Scene(vec![Rectangle::new(Vec3::new(-z, -0.7 * z, z), edges, 5, 0.04 * z)])
    };
    let scene = wall(400.0);
    let exposure = |seed| Exposure { gain: 1.0, offset: 0.0, noise: 4.0, seed };
    let l = scene.render(&left.camera, &Se3::identity(), &exposure(1));
    let r = scene.render(&right.camera, &world_from_right, &exposure(2));
    let mut front_end = FrontEnd::new(&rig, SensorMode::Stereo, config(1200)).unwrap();
    let frame = front_end.extract(&packet(vec![Arc::new(l), Arc::new(r)])).unwrap();
    let matched: Vec<usize> = (0..frame.len()).filter(|i| frame.right_x[*i].is_finite()).collect();
    let truth = front_end.model().baseline_fx / 400.0;
    let disparity = |i: usize| (frame.px[i][0] - frame.right_x[i]) as f64;
    let mean = matched.iter().map(|i| disparity(*i)).sum::<f64>() / matched.len() as f64;
    let with_depth: Vec<f64> =
        matched.iter().filter(|i| frame.has_depth(**i)).map(|i| disparity(*i)).collect();
    let below = matched.iter().filter(|i| disparity(**i) < 0.0).count();
    println!(
        "{} of {} matched, {below} below zero, {} with depth; disparity {mean:.3} of {truth:.3}, of those with depth {:.3}",
        matched.len(),
        frame.len(),
        with_depth.len(),
        with_depth.iter().sum::<f64>() / with_depth.len() as f64
    );
    assert!(matched.len() * 2 > frame.len() && below > 20);
    assert!((mean - truth).abs() < 0.03, "{mean} of {truth}");
    assert!(with_depth.iter().all(|d| *d >= 0.3) && with_depth.len() * 3 < matched.len());
}

/// Means per pair of a recording: `[features, features with depth, of them close]`; prints the time too.
fn recording(rig: &Rig, pairs: &[(std::path::PathBuf, std::path::PathBuf)], features: usize) -> [f64; 3] {
    let mut front_end = FrontEnd::new(rig, SensorMode::Stereo, config(features)).unwrap();
    let (mut n, mut matched, mut close) = (0.0, 0.0, 0.0);
    let mut times = Vec::new();
    for (l, r) in pairs {
        let packet = packet(vec![jpeg(l), jpeg(r)]);
        for _ in 0..5 {
            let start = std::time::Instant::now();
            front_end.extract(&packet).unwrap();
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        let frame = front_end.extract(&packet).unwrap();
        n += frame.len() as f64;
        matched += frame.depth.iter().filter(|d| **d > 0.0).count() as f64;
        close += frame.depth.iter().filter(|d| (**d as f64) < front_end.model().close_depth).count() as f64;
    }
    times.sort_by(f64::total_cmp);
    let frames = pairs.len() as f64;
    println!(
        "{} pairs: {:.0} features, {:.0} with depth, {:.0} of them close; {:.2} ms per frame (fastest tenth)",
        pairs.len(),
        n / frames,
        matched / frames,
        close / frames,
        times[times.len() / 10]
    );
    [n / frames, matched / frames, close / frames]
}

#[test]
fn recordings_match_rates() {
    if let Some(path) = folder("kitti-a") {
        let (l, r) = (listing(&path.join("image_0"), ".jpg"), listing(&path.join("image_1"), ".jpg"));
        let pairs: Vec<_> = l.into_iter().zip(r).step_by(10).collect();
        let [n, matched, close] = recording(&kitti_rig(), &pairs, 2000);
        assert!(n > 1800.0 && matched > 0.4 * n && close > 300.0);
    }
    if let Some(path) = folder("euroc-mh01") {
        let (l, r) =
            (listing(&path.join("mav0/cam0/data"), ".jpg"), listing(&path.join("mav0/cam1/data"), ".jpg"));
        let pairs: Vec<_> = l.into_iter().zip(r).step_by(40).collect();
        let [n, matched, close] = recording(&euroc_rig(), &pairs, 1200);
        assert!(n > 1100.0 && matched > 0.4 * n && close > 300.0);
    }
}
