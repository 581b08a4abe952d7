//! Tests: the image positions of a checkerboard's corners, and equality of both builds of the passes.

use super::setup::{Setup, View};
use super::{Renderer, passes, raster::Visibility};
use crate::texture::Texture;
use crate::world::{Face, World, WorldKind, WorldOptions};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage, GrayImage};
use std::sync::Arc;

fn camera() -> Camera {
    Camera::pinhole(640, 480, 420.0, 415.0, 317.3, 241.8)
}

/// A board of 8 by 8 squares of 0.2 m in the plane x = 3, seen from the origin along x.
fn board(texels_per_square: usize) -> World {
    let mut world = World::build(WorldKind::Hall, 1, &WorldOptions { detail: 0.02, ..Default::default() });
    let side = 8 * texels_per_square;
    let texels: Vec<u8> = (0..side * side)
        .map(|i| {
            if (i % side / texels_per_square + i / side / texels_per_square).is_multiple_of(2) {
                230
            } else {
                25
            }
        })
        .collect();
    world.textures.push(Texture::new(side, side, &texels));
    let frame = [Vec3::new(3.0, 0.8, 1.6), -Vec3::y(), -Vec3::z()];
    let corners = vec![Vec2::zeros(), Vec2::new(1.6, 0.0), Vec2::new(1.6, 1.6), Vec2::new(0.0, 1.6)];
    world.faces = vec![Face::new(frame, corners, world.textures.len() - 1, texels_per_square as f64 / 0.2)];
    world
}

/// The camera at a place, facing the middle of the board with a roll.
fn camera_pose(from: Vec3, roll: f64) -> Se3 {
    let forward = (Vec3::new(3.0, 0.0, 0.8) - from).normalize();
    let right = forward.cross(&Vec3::z()).normalize();
    let m = nalgebra::Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    Se3::new(So3::from_matrix(&m) * So3::exp(&Vec3::new(0.0, 0.0, roll)), from)
}

/// The saddle point near a guess: where the gradients around are perpendicular to the direction to it (Förstner 1987).
fn saddle(image: &GrayImage, guess: Vec2) -> Option<Vec2> {
    let mut at = guess;
    for _ in 0..12 {
        let (mut a, mut b) = (nalgebra::Matrix2::<f64>::zeros(), Vec2::zeros());
        let (cx, cy) = (at.x.round() as i64, at.y.round() as i64);
        for y in cy - 6..=cy + 6 {
            for x in cx - 6..=cx + 6 {
                let v = |x: i64, y: i64| image.get(x as usize, y as usize).map(f64::from);
                let g = Vec2::new(v(x + 1, y)? - v(x - 1, y)?, v(x, y + 1)? - v(x, y - 1)?);
                let p = Vec2::new(x as f64, y as f64);
                let weight = (-(p - at).norm_squared() / 18.0).exp();
                let m = g * g.transpose() * weight;
                a += m;
                b += m * p;
            }
        }
        at = a.try_inverse()? * b;
    }
    Some(at)
}

#[test]
fn rendered_corners_match_projection() {
    let (mut image, mut depth) = (GrayImage::new(1, 1), DepthImage::new(1, 1));
    // Magnified, at scale, and minified by mip levels and several taps.
    for texels in [16, 50, 400] {
        let world = Arc::new(board(texels));
        let mut renderer = Renderer::new(&world, camera()).unwrap();
        let (mut sum, mut worst, mut count) = (Vec2::zeros(), 0f64, 0);
        for (from, roll) in [
            (Vec3::new(1.2, 0.0, 0.8), 0.0),
            (Vec3::new(0.9, 0.9, 1.1), 0.3),
            (Vec3::new(0.6, -1.3, 0.4), -0.7),
            (Vec3::new(0.2, 0.4, 1.9), 1.3),
        ] {
            let pose = camera_pose(from, roll);
            renderer.render(&pose, &mut image, Some(&mut depth));
            for i in 1..8 {
                for j in 1..8 {
                    let p = Vec3::new(3.0, 0.8 - 0.2 * f64::from(i), 1.6 - 0.2 * f64::from(j));
                    let in_camera = pose.inverse() * p;
                    let px = camera().project(&in_camera).unwrap();
                    if px.x < 12.0 || px.y < 12.0 || px.x > 627.0 || px.y > 467.0 {
                        continue;
                    }
                    let found = saddle(&image, px).unwrap();
                    let off = found - px;
                    sum += off;
                    worst = worst.max(off.norm());
                    count += 1;
                    let mm = f64::from(depth.at(px.x.round() as usize, px.y.round() as usize));
                    let slope = 6.0 * in_camera.z;
                    assert!((mm - 1000.0 * in_camera.z).abs() < 1.0 + slope, "{mm} mm for {}", in_camera.z);
                }
            }
        }
        let mean = (sum / f64::from(count)).norm();
        assert!(count > 120, "{count} corners");
        assert!(worst < 0.1, "{texels} texels a square: {worst} px");
        assert!(mean < 0.01, "{texels} texels a square: {mean} px on average");
    }
}

#[test]
fn avx2_and_portable_builds_agree() {
    let world = World::build(WorldKind::Office, 4, &WorldOptions { detail: 0.3, ..Default::default() });
    let view = View::new(&camera(), &camera_pose(Vec3::new(1.2, 1.2, 1.3), 0.05));
    let setups: Vec<Setup> = world.faces.iter().filter_map(|f| view.setup(f)).collect();
    let (mut a, mut b) = (Visibility::new(640, 480), Visibility::new(640, 480));
    let (mut grey_a, mut grey_b) = (vec![0; a.inverse_depth.len()], vec![0; b.inverse_depth.len()]);
    passes::run(&mut a, &setups, &world.textures, &mut grey_a);
    passes::all::<false>(&mut b, &setups, &world.textures, &mut grey_b);
    assert_eq!(grey_a, grey_b);
    assert_eq!(a.inverse_depth, b.inverse_depth);
}
