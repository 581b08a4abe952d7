//! The renderer against geometry: depth of known planes, landmarks, disparity, clearance of routes.

use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage, GrayImage, Source};
use cairn_sim::{Effects, Renderer, SimConfig, SimSource, Walker, World, WorldKind, WorldOptions};
use std::sync::Arc;

fn camera() -> Camera {
    Camera::pinhole(640, 480, 420.0, 420.0, 319.5, 239.5)
}

/// The camera at a place, looking along a heading and down by a pitch.
fn pose(x: f64, y: f64, heading: f64, pitch: f64) -> Se3 {
    let (s, c) = heading.sin_cos();
    let m = nalgebra::Matrix3::from_columns(&[Vec3::new(s, -c, 0.0), -Vec3::z(), Vec3::new(c, s, 0.0)]);
    Se3::new(So3::from_matrix(&m) * So3::exp(&Vec3::new(-pitch, 0.02, 0.05)), Vec3::new(x, y, 1.3))
}

#[test]
fn floor_and_wall_depth() {
    let world = Arc::new(World::build(WorldKind::Demo, 1, &WorldOptions::default()));
    let mut r = Renderer::new(&world, camera()).unwrap();
    let (mut image, mut depth) = (GrayImage::new(1, 1), DepthImage::new(1, 1));
    let p = pose(3.0, 1.2, 0.3, 0.35);
    r.render(&p, &mut image, Some(&mut depth));
    // Each pixel on the floor or the left wall (y = 2.4) without furniture in between agrees to the millimetre.
    let (mut floor, mut wall) = (0, 0);
    for y in (0..480).step_by(7) {
        for x in (0..640).step_by(7) {
            let ray = camera().unproject(&Vec2::new(x as f64, y as f64)).unwrap();
            let ray = ray / ray.z;
            let d = p.rotation * ray;
            let seen = f64::from(depth.at(x, y)) / 1000.0;
            let (to_floor, to_wall) = (-1.3 / d.z, 1.2 / d.y);
            if to_floor > 0.0 && (seen - to_floor).abs() <= 0.00055 {
                floor += 1;
            }
            if to_wall > 0.0 && (seen - to_wall).abs() <= 0.00055 {
                wall += 1;
            }
        }
    }
    assert!(floor > 1000 && wall > 800, "floor {floor}, wall {wall} of 6348 pixels");
}

#[test]
fn disparity_agrees_with_depth() {
    let mut config = SimConfig::new(WorldKind::Hall, 2);
    config.effects = Effects::none();
    config.duration_s = Some(0.0);
    config.start_s = 5.0;
    let mut source = SimSource::new(&config).unwrap();
    let packet = source.next_packet().unwrap().unwrap();
    let mut r = Renderer::new(source.world(), camera()).unwrap();
    let (mut image, mut depth) = (GrayImage::new(1, 1), DepthImage::new(1, 1));
    r.render(&source.info().truth[0].1, &mut image, Some(&mut depth));
    assert_eq!(*packet.images[0], image);
    // Around corner-rich pixels of smooth depth, the right image at the predicted disparity matches the left one.
    let right = &packet.images[1];
    let (mut good, mut errors) = (0, Vec::new());
    for y in (20..460).step_by(3) {
        for x in (80..600).step_by(3) {
            let z = f64::from(depth.at(x, y)) / 1000.0;
            let flat = [(x - 6, y), (x + 6, y), (x, y - 3), (x, y + 3)]
                .iter()
                .all(|&(a, b)| (f64::from(depth.at(a, b)) / 1000.0 - z).abs() < 0.03 * z);
            let slope: i32 = (x - 3..x + 3)
                .map(|a| (i32::from(image.at(a + 1, y)) - i32::from(image.at(a, y))).abs())
                .sum();
            let disparity = 420.0 * 0.12 / z;
            if !flat || slope < 30 || disparity > 60.0 {
                continue;
            }
            // The shift that matches best, by a parabola through the sums of squares of a 9x5 window.
            let cost = |shift: f64| -> f64 {
                let mut sum = 0.0;
                for dy in -2..=2i32 {
                    for dx in -4..=4i32 {
                        let (px, py) =
                            (x as f64 + f64::from(dx) - disparity - shift, (y as i32 + dy) as usize);
                        let (i, f) = (px.floor() as usize, px.fract());
                        let v = f64::from(right.at(i, py)) * (1.0 - f) + f64::from(right.at(i + 1, py)) * f;
                        sum += (v - f64::from(image.at((x as i32 + dx) as usize, py))).powi(2);
                    }
                }
                sum
            };
            let (a, b, c) = (cost(-1.0), cost(0.0), cost(1.0));
            good += 1;
            if b < a && b < c {
                errors.push(0.5 * (a - c) / (a - 2.0 * b + c));
            }
        }
    }
    assert!(good > 300, "{good} places");
    assert!(errors.len() * 10 > good * 8, "{} of {good} match", errors.len());
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    assert!(median.abs() < 0.03, "median disparity error {median} px");
}

#[test]
fn routes_keep_clearance() {
    for kind in WorldKind::ALL {
        for seed in 0..3 {
            let options = WorldOptions { look_alike: seed == 2, detail: 0.1, ..Default::default() };
            let world = World::build(kind, seed, &options);
            // "long" repeats the legs of the first route.
            for route in world.routes().iter().filter(|w| w.name != "long") {
                let motion = Walker::default().motion(&route.points);
                let n = (motion.end() * 5.0) as usize;
                for i in 0..n {
                    let p = motion.pose(i as f64 / 5.0).translation;
                    let clear = world.clearance(p.x, p.y);
                    assert!(
                        clear > 0.35,
                        "{kind} seed {seed} way {}: {clear:.2} m at {:.2} {:.2}",
                        route.name,
                        p.x,
                        p.y
                    );
                }
            }
        }
    }
}

#[test]
fn demo_route_length_and_turns() {
    for seed in 0..20 {
        let world = World::build(WorldKind::Demo, seed, &WorldOptions { detail: 0.05, ..Default::default() });
        let route = world.route("out").unwrap();
        assert_eq!(route.points.len(), 5);
        assert!((35.0..46.0).contains(&route.length()), "{}", route.length());
    }
}
