//! The space around a walker: ground, obstacles, drops, and things that come and go, from synthetic depth.

use cairn_dense::walk::{Blocked, LocalConfig, LocalSpace, first_hit};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage};
use scene::{Scene, camera};

use crate::scene;

/// The scene has y down and its floor at y = 1.2; level: x along the scene's z (ahead), y to the left, z up.
fn level() -> So3 {
    let axes = nalgebra::Matrix3::from_columns(&[Vec3::z(), -Vec3::x(), -Vec3::y()]);
    So3::from_matrix(&axes).inverse()
}

/// A corridor 2.4 m wide, 2.4 m high and long, with the floor at y = 1.2.
fn corridor() -> Scene {
    Scene { room: Some((Vec3::new(-1.2, -1.2, -3.0), Vec3::new(1.2, 1.2, 9.0))), spheres: Vec::new() }
}

/// Depth with noise that grows with its square, in millimetres.
fn depth(scene: &Scene, pose: &Se3, seed: u64) -> DepthImage {
    depth_by(&camera(), scene, pose, seed)
}

fn depth_by(camera: &Camera, scene: &Scene, pose: &Se3, seed: u64) -> DepthImage {
    let exact = scene.depth(camera, pose);
    let mut random = cairn_random::Random::new(seed);
    let mut noisy = |z: f32| {
        let z = f64::from(z);
        ((z + 0.002 * z * z * random.standard_normal()) * 1000.0).max(0.0) as u16
    };
    DepthImage::from_vec(exact.width(), exact.height(), exact.data().iter().map(|&z| noisy(z)).collect())
        .expect("all pixels")
}

/// A camera 1.3 m above the floor that looks 5 degrees down.
fn eye(z: f64) -> Se3 {
    Se3::new(So3::exp(&Vec3::new(-0.09, 0.0, 0.0)), Vec3::new(0.0, -0.1, z))
}

fn space() -> LocalSpace {
    LocalSpace::new(LocalConfig::default(), camera(), 0.001).expect("a camera")
}

/// The straight way ahead of a place in the level frame, whose x is the scene's z.
fn straight(z: f64) -> [Vec2; 2] {
    [Vec2::new(z, 0.0), Vec2::new(z + 4.0, 0.0)]
}

fn ahead(space: &LocalSpace, z: f64) -> Option<f64> {
    first_hit(&space.obstacles(), &straight(z), 0.3, 3.3, 4).map(|hit| hit.along_m)
}

#[test]
fn an_empty_corridor_is_free_on_a_long_walk_with_noise() {
    let mut space = space();
    for i in 0..100u64 {
        let z = 0.05 * i as f64;
        space.observe(&depth(&corridor(), &eye(z), i + 1), &eye(z), &level()).expect("depth");
        assert_eq!(ahead(&space, z), None, "at {z} m");
    }
    let ground = space.ground_m(&Vec2::new(6.0, 0.0)).expect("seen");
    assert!((ground + 1.2).abs() < 0.03, "{ground}");
    assert!(space.drop_along(&straight(5.0), 0.3, 2.5).is_none());
}

/// Before a wall no ground is in view, only the lower part of the wall: it must not be taken for the ground.
#[test]
fn a_walk_that_begins_before_a_wall_finds_its_ground() {
    let mut space = space();
    for i in 0..140u64 {
        // Facing the wall behind the start, then turning round, then walking.
        let turn = std::f64::consts::PI * (1.0 - (i as f64 - 20.0).clamp(0.0, 40.0) / 40.0);
        let z = -1.7 + 0.05 * (i as f64 - 60.0).max(0.0);
        let pose = Se3::new(So3::exp(&Vec3::new(0.0, turn, 0.0)), Vec3::zeros()) * eye(0.0);
        let pose = Se3::new(pose.rotation, Vec3::new(0.0, -0.1, z));
        space.observe(&depth(&corridor(), &pose, i + 1), &pose, &level()).expect("depth");
        let ground = space.ground_m(&Vec2::new(z, 0.0));
        assert!(ground.is_none_or(|g| (g + 1.2).abs() < 0.05), "image {i}: {ground:?}");
        if i >= 62 {
            assert!(ground.is_some(), "image {i}");
            assert_eq!(ahead(&space, z), None, "image {i}");
            assert_eq!(space.drop_along(&straight(z), 0.3, 3.0), None, "image {i}");
        }
    }
}

/// What was seen through is free again within a second: at 20 images a second, 20 images.
#[test]
fn what_comes_is_seen_and_what_left_is_free_within_a_second() {
    // Behind it a wall, and for the last two nothing within the range of the sensor.
    let large = Camera::pinhole(480, 360, 315.0, 315.0, 239.5, 179.5);
    for (y, end, camera) in [
        (0.9, 4.2, camera()),
        (0.2, 4.2, camera()),
        (-0.35, 4.2, camera()),
        (0.2, 15.0, large),
        (-0.35, 15.0, large),
    ] {
        let mut space = LocalSpace::new(LocalConfig::default(), camera, 0.001).expect("a camera");
        let empty = Scene {
            room: Some((Vec3::new(-1.2, -1.2, -3.0), Vec3::new(1.2, 1.2, end))),
            spheres: Vec::new(),
        };
        let ball = Scene { spheres: vec![(Vec3::new(0.1, y, 2.2), 0.25)], ..empty.clone() };
        let mut see = |scene: &Scene, seed: u64| {
            space.observe(&depth_by(&camera, scene, &eye(0.0), seed), &eye(0.0), &level()).expect("depth");
            first_hit(&space.obstacles(), &straight(0.0), 0.3, 3.3, 4)
        };
        for i in 0..25 {
            assert_eq!(see(&empty, i + 1), None);
        }
        let came = (0..6).find_map(|i| see(&ball, i + 40)).expect("the ball within 0.3 s");
        assert!((1.75..2.2).contains(&came.along_m), "{came:?}");
        let hit = (0..14).map(|i| see(&ball, i + 60)).last().flatten().expect("still there");
        assert!(hit.at.y < 0.05, "to the right: {}", hit.at.y);
        assert_eq!(hit.low_m > LocalConfig::default().chest_m, y < -0.2, "{}", hit.low_m);
        assert!((0..20).any(|i| see(&empty, i + 90).is_none()), "not free within a second: {y} {end}");
    }
}

/// The corridor with a counter across it: its front stands at `front` along z, and its top, at `top` along y, reaches to `back`.
fn with_counter(pose: &Se3, front: f64, back: f64, top: f64) -> DepthImage {
    let far = corridor().depth(&camera(), pose);
    let mut image = DepthImage::new(far.width(), far.height());
    for (k, out) in image.data_mut().iter_mut().enumerate() {
        let (x, y) = (k % far.width(), k / far.width());
        let ray = camera().unproject(&Vec2::new(x as f64, y as f64)).expect("a pixel");
        let turned = pose.rotation * ray;
        let at = |t: f64| pose.translation + turned * t;
        let mut z = f64::from(far.at(x, y));
        let (to_front, to_top) =
            ((front - pose.translation.z) / turned.z, (top - pose.translation.y) / turned.y);
        if to_front > 0.0 && at(to_front).y > top {
            z = z.min(to_front * ray.z);
        }
        if to_top > 0.0 && (front..back).contains(&at(to_top).z) {
            z = z.min(to_top * ray.z);
        }
        *out = (z * 1000.0) as u16;
    }
    image
}

#[test]
fn a_counter_close_by_is_not_the_ground() {
    let mut space = space();
    for i in 0..60u64 {
        let pose = eye(0.04 * f64::from(i.min(50) as u32));
        space.observe(&with_counter(&pose, 2.6, 9.0, 0.4), &pose, &level()).expect("depth");
        let ground = space.ground_m(&Vec2::new(pose.translation.z, 0.0)).expect("ground");
        assert!((ground + 1.2).abs() < 0.1, "the ground at {ground} m in image {i}");
    }
    assert!(ahead(&space, 2.0).is_some_and(|m| (m - 0.6).abs() < 0.15), "{:?}", ahead(&space, 2.0));
}

#[test]
fn what_was_taken_away_close_by_is_gone_as_a_whole() {
    let mut space = space();
    for i in 0..50u64 {
        let pose = eye(0.03 * f64::from(i.min(40) as u32));
        space.observe(&with_counter(&pose, 2.3, 2.4, 0.2), &pose, &level()).expect("depth");
    }
    assert!(ahead(&space, 1.2).is_some_and(|m| (m - 1.1).abs() < 0.15), "{:?}", ahead(&space, 1.2));
    // From here its lower half is below the image.
    let gone = (0..20).any(|i| {
        space.observe(&depth(&corridor(), &eye(1.2), i + 1), &eye(1.2), &level()).expect("depth");
        ahead(&space, 1.2).is_none()
    });
    assert!(gone, "still there: {:?}", ahead(&space, 1.2));
}

#[test]
fn ground_that_ends_is_a_drop() {
    // A floor 0.8 m lower beyond 3 m: the near part hides its edge only from below.
    let low =
        Scene { room: Some((Vec3::new(-1.2, -1.2, -3.0), Vec3::new(1.2, 2.0, 9.0))), spheres: Vec::new() };
    let mut space = space();
    for i in 0..40u64 {
        let pose = eye(0.02 * i as f64);
        let (near, far) = (corridor().depth(&camera(), &pose), low.depth(&camera(), &pose));
        let mut image = DepthImage::new(near.width(), near.height());
        for (k, out) in image.data_mut().iter_mut().enumerate() {
            let (x, y) = (k % near.width(), k / near.width());
            let ray = camera().unproject(&Vec2::new(x as f64, y as f64)).expect("a pixel");
            let hit = pose * (ray * (f64::from(near.at(x, y)) / ray.z));
            let z = if hit.y > 1.19 && hit.z > 3.0 { far.at(x, y) } else { near.at(x, y) };
            *out = (z * 1000.0) as u16;
        }
        space.observe(&image, &pose, &level()).expect("depth");
    }
    let at = space.drop_along(&straight(0.78), 0.3, 3.3).expect("a drop");
    assert!((at - 2.22).abs() < 0.45, "{at} m ahead");
}

#[test]
fn hits_are_clusters_near_the_line_in_its_order() {
    let cell = |x: f64, y: f64, voxels| Blocked { at: Vec2::new(x, y), low_m: 0.4, voxels };
    let line = [Vec2::zeros(), Vec2::new(2.0, 0.0), Vec2::new(2.0, 2.0)];
    let hit = |cells: &[Blocked]| first_hit(cells, &line, 0.3, 3.5, 4).map(|h| h.along_m);
    assert_eq!(hit(&[cell(1.0, 0.2, 3)]), None, "too few voxels");
    assert_eq!(hit(&[cell(1.0, 0.2, 3), cell(1.2, 0.0, 2)]), Some(1.0));
    assert_eq!(hit(&[cell(1.0, 0.4, 9), cell(-0.2, 0.0, 9)]), None, "beside and behind");
    assert_eq!(hit(&[cell(2.1, 1.0, 9)]), Some(3.0), "around the corner");
    assert_eq!(hit(&[cell(2.0, 1.9, 9)]), None, "too far along");
}

#[test]
fn bad_input_adds_nothing() {
    let mut space = space();
    let nowhere = Se3::new(So3::identity(), Vec3::new(f64::NAN, 0.0, 0.0));
    assert!(space.observe(&depth(&corridor(), &eye(0.0), 1), &nowhere, &level()).is_err());
    assert!(space.observe(&DepthImage::new(160, 120), &eye(0.0), &level()).is_err(), "all zero");
    assert!(space.observe(&DepthImage::new(8, 8), &eye(0.0), &level()).is_err(), "another size");
    assert_eq!((space.obstacles().len(), space.ground_m(&Vec2::zeros())), (0, None));
    let bad = LocalConfig { reach_m: 60.0, ..LocalConfig::default() };
    assert!(LocalSpace::new(bad, camera(), 0.001).is_err());
}

/// Prints what an image costs; measured with `cargo test --release -p cairn-dense --test suite cost -- --nocapture`.
#[test]
fn the_cost_of_an_image_is_small() {
    let cpu_ms = || {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
    };
    for (width, height, focal) in [(640, 480, 420.0), (480, 360, 315.0)] {
        let camera =
            Camera::pinhole(width, height, focal, focal, 0.5 * width as f64 - 0.5, 0.5 * height as f64 - 0.5);
        let mut space = LocalSpace::new(LocalConfig::default(), camera, 0.001).expect("a camera");
        let ball = Scene { spheres: vec![(Vec3::new(0.1, 0.2, 3.5), 0.25)], ..corridor() };
        let mut times = Vec::new();
        for i in 0..30u64 {
            let pose = eye(0.05 * i as f64);
            let image = depth_by(&camera, &ball, &pose, i + 1);
            let begin = cpu_ms();
            space.observe(&image, &pose, &level()).expect("depth");
            let seen = cpu_ms();
            let hit = first_hit(&space.obstacles(), &straight(0.05 * i as f64), 0.3, 3.3, 4);
            let _ = space.drop_along(&straight(0.05 * i as f64), 0.3, 3.0);
            times.push([cpu_ms() - begin, cpu_ms() - seen]);
            assert!(i < 12 || hit.is_some(), "image {i}");
        }
        times.sort_by(|a, b| a[0].total_cmp(&b[0]));
        println!(
            "{width}x{height}: median {:.2} ms ({:.2} for looking), most {:.2} ms",
            times[15][0], times[15][1], times[29][0]
        );
        assert!(times[15][0] < 30.0, "{:?}", times[15]);
    }
}
