//! Photometric alignment: what a bare wall leaves free is found by the texture on it, and by nothing else.

use cairn_dense::{
    DenseError, DenseTracked, DepthConfig, DepthPreparer, ShadedView, TrackConfig, TsdfConfig, TsdfVolume,
    track_from, track_photometric,
};
use cairn_geometry::{Manifold, Se3, Vec2, Vec3};
use cairn_random::Random;
use cairn_sensor::{Camera, GrayImage, Image};
use nalgebra::{Matrix6, Vector6};
use scene::{Scene, pose};

use crate::scene;

/// One wall that fills the view: it fixes the distance and two rotations, nothing else.
fn wall() -> Scene {
    Scene { room: Some((Vec3::new(-50.0, -50.0, -50.0), Vec3::new(50.0, 50.0, 1.7))), spheres: Vec::new() }
}

fn camera() -> Camera {
    Camera::pinhole(320, 240, 280.0, 280.0, 159.5, 119.5)
}

/// Waves of 6 to 40 cm in all directions, a few shades high: dark cloth, no corner of a feature.
fn cloth(p: &Vec3) -> f64 {
    let waves = [(15.0, 2.0), (-4.0, 22.0), (40.0, -30.0), (60.0, 80.0), (-90.0, 35.0)];
    let sum: f64 = waves.iter().map(|(a, b)| (a * p.x + b * p.y + a).sin()).sum();
    60.0 + 4.0 * sum
}

/// What a camera sees of the wall, with noise in depth and shades of its own.
struct Seen {
    depth: Image<f32>,
    gray: GrayImage,
}

fn see(at: &Se3, texture: impl Fn(&Vec3) -> f64, seed: u64) -> Seen {
    see_with(2.0, at, texture, seed)
}

fn see_with(noise: f64, at: &Se3, texture: impl Fn(&Vec3) -> f64, seed: u64) -> Seen {
    see_by(&camera(), noise, at, texture, seed)
}

fn see_by(camera: &Camera, noise: f64, at: &Se3, texture: impl Fn(&Vec3) -> f64, seed: u64) -> Seen {
    let mut random = Random::new(seed);
    let mut depth = wall().depth(camera, at);
    let mut gray = GrayImage::new(camera.width, camera.height);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let z = f64::from(depth.at(x, y));
            let ray = camera.unproject(&Vec2::new(x as f64, y as f64)).expect("a ray");
            // The lens darkens the corners, whatever is seen there.
            let corner = Vec2::new((x as f64 - camera.cx) / 200.0, (y as f64 - camera.cy) / 200.0);
            let light = 1.0 - 0.15 * corner.norm_squared();
            let shade = light * texture(&(*at * (ray * (z / ray.z)))) + random.normal(0.0, noise);
            gray.row_mut(y)[x] = shade.round().clamp(0.0, 255.0) as u8;
            let sigma = cairn_dense::DepthNoise::default().sigma_m(z);
            depth.row_mut(y)[x] += (sigma * random.normal(0.0, 1.0)) as f32;
        }
    }
    Seen { depth, gray }
}

impl Seen {
    fn view(&self, preparer: &mut DepthPreparer) -> ShadedView {
        let frame = preparer.prepare_metres(&self.depth).expect("depth").clone();
        ShadedView::new(&frame, &preparer.shades(&self.gray).expect("its size")).expect("its size")
    }
}

/// What was known of the guess.
fn known() -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::new(0.06, 0.06, 0.06, 0.03, 0.03, 0.03).map(|s| s * s))
}

/// Where the camera is, by the surface, and by the shades as well.
fn aligned(before: &Seen, now: &Seen, guess: &Se3) -> (DenseTracked, Option<DenseTracked>) {
    let mut preparer = DepthPreparer::new(DepthConfig::default(), camera(), 0.001).expect("a camera");
    let mut volume = TsdfVolume::new(TsdfConfig::default()).expect("in range");
    for i in 0..4u32 {
        let at = pose([0.02 * f64::from(i), 0.0, 0.0], [0.0, 0.005 * f64::from(i), 0.0]);
        let seen = see(&at, |_| 0.0, 1000 + u64::from(i));
        let frame = preparer.prepare_metres(&seen.depth).expect("depth");
        volume.integrate(frame, None, &at).expect("a pose");
    }
    let (before, now_view) = (before.view(&mut preparer), now.view(&mut preparer));
    let frame = preparer.prepare_metres(&now.depth).expect("depth");
    let config = TrackConfig { fixed_m: 0.02, ..TrackConfig::default() };
    let by_surface = track_from(&volume, frame, guess, &known(), &config).expect("finite");
    let by_shades = track_photometric(&before, &Se3::identity(), &now_view, &by_surface, &known(), &config);
    (by_surface, by_shades)
}

/// The camera has slid along the wall, and turned about its axis.
fn truth() -> Se3 {
    pose([0.06, -0.04, 0.01], [0.004, -0.003, 0.02])
}

/// Nothing of the motion along the wall is known.
fn guess() -> Se3 {
    pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
}

fn off(tracked: &DenseTracked) -> f64 {
    truth().local(&tracked.volume_from_camera).norm()
}

#[test]
fn along_a_textured_wall_the_shades_tell_where_the_camera_is() {
    for seed in 0..3 {
        let (before, now) = (see(&Se3::identity(), cloth, 2 * seed), see(&truth(), cloth, 2 * seed + 1));
        let (by_surface, by_shades) = aligned(&before, &now, &guess());
        assert_eq!(by_surface.free.len(), 3, "seed {seed}");
        assert!(off(&by_surface) > 0.05, "the surface alone does not tell: {}", off(&by_surface));
        let found = by_shades.expect("texture");
        assert!(found.free.is_empty(), "seed {seed}: {:?}", found.free);
        let error = truth().local(&found.volume_from_camera);
        assert!(error.norm() < 0.003, "seed {seed}: {error}");
        // As certain as it is said to be: no direction is off by more than four standard deviations and a millimetre.
        let sigma = found.covariance.diagonal().map(f64::sqrt);
        assert!((0..6).all(|k| error[k].abs() < 4.0 * sigma[k] + 0.001), "seed {seed}: {error} {sigma}");
        assert!(sigma.iter().all(|s| *s < 0.01), "seed {seed}: {sigma}");
    }
}

#[test]
fn brightness_may_change() {
    let darker = |p: &Vec3| 0.8 * cloth(p) + 15.0;
    let (before, now) = (see(&Se3::identity(), cloth, 20), see(&truth(), darker, 21));
    let (_, by_shades) = aligned(&before, &now, &guess());
    let found = by_shades.expect("texture");
    assert!(found.free.is_empty() && off(&found) < 0.004, "{}", off(&found));
}

#[test]
fn a_blank_wall_and_another_texture_tell_nothing() {
    let blank = |_: &Vec3| 180.0;
    let other = |p: &Vec3| cloth(&Vec3::new(7.0 - 1.3 * p.y, 0.7 * p.x - 3.0, 0.0));
    for seed in 0..4 {
        let (before, now) = (see(&Se3::identity(), blank, 30 + seed), see(&truth(), blank, 40 + seed));
        let (by_surface, by_shades) = aligned(&before, &now, &guess());
        assert_eq!(by_surface.free.len(), 3);
        assert!(by_shades.is_none(), "seed {seed}, blank: {by_shades:?}");
        let (before, now) = (see(&Se3::identity(), cloth, 50 + seed), see(&truth(), other, 60 + seed));
        let (_, by_shades) = aligned(&before, &now, &guess());
        assert!(by_shades.is_none(), "seed {seed}, another: {by_shades:?}");
    }
}

/// The dark corners stay where they are in the image: they must not say that the camera stands still.
#[test]
fn dark_corners_before_a_blank_wall_tell_nothing() {
    for noise in [0.2, 0.5, 1.0] {
        let see = |at: &Se3, seed| see_with(noise, at, |_| 180.0, seed);
        let (_, by_shades) = aligned(&see(&Se3::identity(), 90), &see(&truth(), 91), &guess());
        assert!(by_shades.is_none(), "noise {noise}: {by_shades:?}");
    }
}

/// Stripes tell the way across them, not the way along.
#[test]
fn along_stripes_the_guess_is_kept() {
    let stripes = |p: &Vec3| 70.0 + 12.0 * (25.0 * p.x).sin() + 6.0 * (60.0 * p.x).sin();
    let (before, now) = (see(&Se3::identity(), stripes, 70), see(&truth(), stripes, 71));
    let (by_surface, by_shades) = aligned(&before, &now, &guess());
    let found = by_shades.expect("stripes");
    assert_eq!(found.free.len(), 1, "{:?}", found.free);
    assert!(found.free[0][1].abs() > 0.95, "up and down: {:?}", found.free[0]);
    let error = truth().local(&found.volume_from_camera);
    assert!(error[0].abs() < 0.003 && error[5].abs() < 0.003, "{error}");
    let kept = by_surface.volume_from_camera.local(&found.volume_from_camera);
    assert!(kept[1].abs() < 0.005, "{kept}");
    let information =
        found.covariance.try_inverse().expect("regular") + known().try_inverse().expect("regular");
    let sigma = information.try_inverse().expect("regular").diagonal().map(f64::sqrt);
    assert!(sigma[1] > 0.04 && sigma[0] < 0.01 && sigma[5] < 0.01, "{sigma}");
}

#[test]
fn a_gray_image_of_another_size_is_refused() {
    let mut preparer = DepthPreparer::new(DepthConfig::default(), camera(), 0.001).expect("a camera");
    let seen = see(&Se3::identity(), cloth, 80);
    let small = GrayImage::new(160, 120);
    assert!(matches!(preparer.shades(&small), Err(DenseError::Size { .. })));
    let frame = preparer.prepare_metres(&seen.depth).expect("depth");
    assert!(matches!(ShadedView::new(frame, &small), Err(DenseError::Size { .. })));
}

/// Prints what the shades of an image cost beside its surface; measured with `cargo test --release -p cairn-dense --test suite photometric::
/// -- --nocapture cost`.
#[test]
fn the_cost_of_an_image_is_small() {
    let cpu_ms = || {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
    };
    let camera = Camera::pinhole(640, 480, 560.0, 560.0, 319.5, 239.5);
    let mut preparer = DepthPreparer::new(DepthConfig::default(), camera, 0.001).expect("a camera");
    let mut volume = TsdfVolume::new(TsdfConfig::default()).expect("in range");
    for i in 0..4u32 {
        let at = pose([0.02 * f64::from(i), 0.0, 0.0], [0.0, 0.005 * f64::from(i), 0.0]);
        let seen = see_by(&camera, 2.0, &at, |_| 0.0, 1000 + u64::from(i));
        volume.integrate(preparer.prepare_metres(&seen.depth).expect("depth"), None, &at).expect("a pose");
    }
    let before = see_by(&camera, 2.0, &Se3::identity(), cloth, 0).view(&mut preparer);
    let now = see_by(&camera, 2.0, &truth(), cloth, 1);
    preparer.prepare_metres(&now.depth).expect("depth");
    let config = TrackConfig { fixed_m: 0.02, ..TrackConfig::default() };
    let mut times = [Vec::new(), Vec::new(), Vec::new()];
    for _ in 0..25 {
        let begin = cpu_ms();
        let by_surface = track_from(&volume, preparer.frame(), &guess(), &known(), &config).expect("finite");
        let aligned = cpu_ms();
        let shades = preparer.shades(&now.gray).expect("its size");
        let view = ShadedView::new(preparer.frame(), &shades).expect("its size");
        let viewed = cpu_ms();
        let found = track_photometric(&before, &Se3::identity(), &view, &by_surface, &known(), &config);
        let spans = [aligned - begin, viewed - aligned, cpu_ms() - viewed];
        assert!(found.is_some_and(|found| found.free.is_empty()));
        times.iter_mut().zip(spans).for_each(|(times, ms)| times.push(ms));
    }
    let [surface, view, shades] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    });
    println!("640x480, medians: surface {surface:.2} ms, view {view:.2} ms, shades {shades:.2} ms");
    assert!(view + shades < 60.0, "{view} {shades}");
}
