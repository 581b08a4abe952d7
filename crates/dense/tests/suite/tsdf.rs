//! The signed distance field: equal on all backends, independent of order, reversible, exact, robust to bad input.

use cairn_dense::{
    Backend, ColourImage, DenseError, DepthConfig, DepthPreparer, Mesh, MeshConfig, Mesher, TsdfConfig,
    TsdfVolume, raycast,
};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{Camera, DepthImage, Distortion, Image};
use scene::{Scene, camera, pose, turn};
use std::collections::BTreeMap;

use crate::scene;

fn volume(voxel_m: f64, colour: bool) -> TsdfVolume {
    TsdfVolume::new(TsdfConfig { voxel_m, colour, ..TsdfConfig::default() }).expect("in range")
}

fn mesh(volume: &TsdfVolume) -> Mesh {
    Mesher::new(MeshConfig::default()).whole(volume)
}

/// All voxels that were seen, block by block.
fn voxels(volume: &TsdfVolume) -> BTreeMap<[i32; 3], (f64, i32)> {
    let mut out = BTreeMap::new();
    for key in volume.changed_since(0) {
        for i in 0..512 {
            let at = [i & 7, i >> 3 & 7, i >> 6];
            let voxel = [0, 1, 2].map(|k| key.0[k] * 8 + at[k]);
            out.extend(volume.voxel(voxel).map(|v| (voxel, v)));
        }
    }
    out
}

fn painted(n: usize) -> ColourImage {
    let data = (0..160 * 120).map(|i| [(i % 251) as u8, (i / 160) as u8, n as u8]).collect();
    ColourImage::from_rgb(&Image::from_vec(160, 120, data).expect("all pixels"))
}

#[test]
fn all_instructions_give_the_same_bits() {
    let scene = Scene::room();
    let all: Vec<TsdfVolume> = Backend::ALL
        .into_iter()
        .filter(|b| b.available())
        .map(|backend| {
            let mut preparer = DepthPreparer::new(DepthConfig::default(), camera(), 0.001)
                .expect("a camera")
                .with_backend(backend);
            let mut volume = volume(0.03, true).with_backend(backend);
            for (i, pose) in turn(9).iter().enumerate() {
                let image = scene.depth(&camera(), pose);
                volume
                    .integrate(preparer.prepare_metres(&image).expect("depth"), Some(&painted(i)), pose)
                    .expect("a pose");
            }
            volume
        })
        .collect();
    let first = voxels(&all[0]);
    assert!(first.len() > 10_000);
    for other in &all[1..] {
        assert_eq!(first, voxels(other));
        assert_eq!(mesh(&all[0]), mesh(other));
    }
    if all.len() < 3 {
        println!("skipped: AVX2 or AVX-512, which this processor has not");
    }
}

#[test]
fn images_come_in_any_order_and_go_without_a_trace() {
    let scene = Scene::room();
    let frames: Vec<_> = turn(8).into_iter().map(|p| (scene.frame(&camera(), &p), p)).collect();
    let mut forth = volume(0.04, false);
    for (frame, pose) in &frames[..5] {
        forth.integrate(frame, None, pose).expect("a pose");
    }
    let mut back = volume(0.04, false);
    for (frame, pose) in frames.iter().rev() {
        back.integrate(frame, None, pose).expect("a pose");
    }
    for (frame, pose) in &frames[5..] {
        back.remove(frame, pose).expect("a pose");
    }
    assert_eq!(voxels(&forth), voxels(&back));
    assert_eq!(forth.blocks(), back.blocks());
    for (frame, pose) in &frames[..5] {
        back.remove(frame, pose).expect("a pose");
    }
    assert_eq!(back.blocks(), 0, "nothing is left");
}

#[test]
fn the_surface_is_where_it_is() {
    let scene = Scene::room();
    let mut volume = volume(0.03, false);
    for pose in turn(24) {
        volume.integrate(&scene.frame(&camera(), &pose), None, &pose).expect("a pose");
    }
    let mesh = mesh(&volume);
    let mut off: Vec<f64> =
        mesh.positions.iter().map(|p| scene.distance(Vec3::from(p.map(f64::from)))).collect();
    off.sort_by(f64::total_cmp);
    assert!(off[off.len() / 2] < 0.002, "median {}", off[off.len() / 2]);
    assert!(off[off.len() * 95 / 100] < 0.012, "95 % {}", off[off.len() * 95 / 100]);
    // Normals point into the room: each wall's towards the middle.
    let inwards = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .filter(|(p, _)| p[0].abs() > 1.97 && p[1].abs() < 1.0 && p[2].abs() < 1.3);
    for (p, n) in inwards {
        assert!(n[0] * p[0].signum() < -0.8, "{p:?} {n:?}");
    }
    let at = pose([0.0, 0.05, -0.1], [0.0, 0.4, 0.0]);
    let cast = raycast(&volume, &camera(), &at, 5.0).expect("a pose");
    let drawn = Mesher::new(MeshConfig::default()).view(&volume, &camera(), &at, 5.0).expect("a pinhole");
    let truth = scene.depth(&camera(), &at);
    for cast in [cast, drawn] {
        let seen = |i: &usize| cast.depth_m.data()[*i] > 0.0;
        let off = |i: usize| (cast.depth_m.data()[i] - truth.data()[i]).abs();
        let mut off: Vec<f32> = (0..truth.data().len()).filter(seen).map(off).collect();
        off.sort_by(f32::total_cmp);
        assert!(off.len() > 160 * 120 * 8 / 10, "{} pixels", off.len());
        let (median, most) = (off[off.len() / 2], off[off.len() * 9 / 10]);
        assert!(median < 0.004 && most < 0.02, "{median} {most}");
        // Normals point towards the camera: against the ray.
        for (i, n) in cast.normals.data().iter().enumerate().filter(|(i, _)| seen(i)) {
            let ray = [((i % 160) as f32 - 79.5) / 140.0, ((i / 160) as f32 - 59.5) / 140.0, 1.0];
            assert!(ray[0] * n[0] + ray[1] * n[1] + ray[2] * n[2] < 0.2, "{i}: {n:?}");
        }
    }
}

/// Rays of a pinhole begin at the drawn triangles, those of a lens march from block to block: both end at the same surface, and
/// next to none that marches finds what was not drawn.
#[test]
fn a_lens_that_hardly_distorts_casts_what_a_pinhole_does() {
    let scene = Scene::room();
    let mut volume = volume(0.03, false);
    for pose in turn(16) {
        volume.integrate(&scene.frame(&camera(), &pose), None, &pose).expect("a pose");
    }
    let at = pose([0.1, 0.05, -0.1], [0.0, 0.4, 0.1]);
    let lens = Camera { distortion: Distortion::RadialTangential([1e-9, 0.0, 0.0, 0.0, 0.0]), ..camera() };
    let [drawn, marched] = [camera(), lens].map(|c| raycast(&volume, &c, &at, 5.0).expect("a pose"));
    let truth = scene.depth(&camera(), &at);
    let (mut both, mut one, mut off, mut turned) = (0, [0; 2], Vec::new(), 0);
    let mut wrong = [0; 2];
    let pixels = drawn.depth_m.data().iter().zip(marched.depth_m.data()).zip(truth.data());
    for (((&a, &b), &z), (m, n)) in pixels.zip(drawn.normals.data().iter().zip(marched.normals.data())) {
        if (a > 0.0) != (b > 0.0) {
            let which = usize::from(b > 0.0);
            one[which] += 1;
            wrong[which] += usize::from((a.max(b) - z).abs() > 0.03);
        }
        if a > 0.0 && b > 0.0 {
            both += 1;
            off.push((a - b).abs());
            turned += usize::from(m[0] * n[0] + m[1] * n[1] + m[2] * n[2] < 0.99);
        }
    }
    off.sort_by(f32::total_cmp);
    let (median, most) = (off[off.len() / 2], off[off.len() * 98 / 100]);
    println!(
        "{both} pixels in both, {one:?} in one alone, of these {wrong:?} wrong, {turned} normals differ, depths by {median} m, 98 % {most} m"
    );
    assert!(
        both > 160 * 120 * 8 / 10 && one[1] * 50 < both && wrong[0] * 50 < both && turned * 50 < both,
        "{both} {one:?} {turned}"
    );
    assert!(median < 1e-4 && most < 0.003, "{median} {most}");
    let near = raycast(&volume, &camera(), &at, 1.5).expect("a pose");
    assert!(near.depth_m.data().iter().any(|&z| z > 0.0) && near.depth_m.data().iter().all(|&z| z <= 1.5));
}

#[test]
fn a_ball_seen_from_all_sides_is_closed_across_blocks() {
    let scene = Scene { room: None, spheres: vec![(Vec3::zeros(), 0.5)] };
    let mut volume = volume(0.03, false);
    for i in 0..26 {
        // Towards the middle from the directions of a cube's faces, edges and corners.
        let n = if i < 13 { i } else { i + 1 };
        let out = Vec3::new(f64::from(n % 3 - 1), f64::from(n / 3 % 3 - 1), f64::from(n / 9 - 1)).normalize();
        let turn = nalgebra::UnitQuaternion::rotation_between(&Vec3::z(), &-out).unwrap_or_else(|| {
            nalgebra::UnitQuaternion::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI)
        });
        let pose = Se3::new(cairn_geometry::So3::from_quaternion(turn), out * 1.5);
        volume.integrate(&scene.frame(&camera(), &pose), None, &pose).expect("a pose");
    }
    let mesh = mesh(&volume);
    let mut sides: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *sides.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    assert!(mesh.triangles.len() > 3000, "{}", mesh.triangles.len());
    assert!(
        sides.values().all(|&s| s == 0),
        "{} sides are open",
        sides.values().filter(|&&s| s != 0).count()
    );
    // Block by block it is the same surface.
    let mut mesher = Mesher::new(MeshConfig::default());
    let all = Mesher::affected(volume.changed_since(0));
    let pieces: usize = all.into_iter().map(|key| mesher.block(&volume, key).triangles.len()).sum();
    assert_eq!(pieces, mesh.triangles.len());
    // All that changed at once, the same as one by one.
    for (key, piece) in Mesher::new(MeshConfig::default()).changed(&volume, 0) {
        assert_eq!(piece, mesher.block(&volume, key), "{key:?}");
    }
}

#[test]
fn what_has_no_depth_changes_nothing() {
    let scene = Scene::room();
    let at = pose([0.0; 3], [0.0; 3]);
    let mut image = scene.depth(&camera(), &at);
    for (i, bad) in [0.0, f32::NAN, f32::INFINITY, -1.0, 65.535].into_iter().enumerate() {
        for y in 20..100 {
            image.row_mut(y)[20 + 20 * i..40 + 20 * i].fill(bad);
        }
    }
    let mut preparer = DepthPreparer::new(DepthConfig::default(), camera(), 0.001).expect("a camera");
    let mut volume = volume(0.05, false);
    volume.integrate(preparer.prepare_metres(&image).expect("depth"), None, &at).expect("a pose");
    let columns = |x: f64| (x * 140.0 + 79.5, x);
    for (voxel, _) in voxels(&volume) {
        let p = Vec3::from(voxel.map(|v| (f64::from(v) + 0.5) * 0.05));
        let (u, v) = (columns(p.x / p.z).0, p.y / p.z * 140.0 + 59.5);
        assert!(
            !((21.0..118.0).contains(&u) && (21.0..98.0).contains(&v)),
            "{voxel:?} lies where nothing was measured"
        );
    }
    let raw = DepthImage::from_vec(160, 120, vec![u16::MAX; 160 * 120]).expect("all pixels");
    assert!(matches!(preparer.prepare(&raw), Err(DenseError::NoDepth { valid: 0, .. })));
}

#[test]
fn bad_input_is_refused_with_a_sentence() {
    let mut preparer = DepthPreparer::new(DepthConfig::default(), camera(), 0.001).expect("a camera");
    let said = |e: DenseError| e.to_string();
    let small = DepthImage::new(80, 60);
    assert!(said(preparer.prepare(&small).expect_err("another size")).contains("80x60"));
    let dark = DepthImage::new(160, 120);
    assert!(said(preparer.prepare(&dark).expect_err("all zero")).contains("covered"));
    // Metres interpreted as millimetres, and the other way round.
    let tiny = DepthImage::from_vec(160, 120, vec![2; 160 * 120]).expect("all pixels");
    assert!(said(preparer.prepare(&tiny).expect_err("2 mm")).contains("too small"));
    let huge = Image::from_vec(160, 120, vec![2000.0; 160 * 120]).expect("all pixels");
    assert!(said(preparer.prepare_metres(&huge).expect_err("2 km")).contains("too great"));
    let good = Scene::room().frame(&camera(), &Se3::identity());
    let mut volume = volume(0.02, true);
    let nowhere = pose([f64::NAN, 0.0, 0.0], [0.0; 3]);
    assert!(matches!(volume.integrate(&good, None, &nowhere), Err(DenseError::Pose(_))));
    let far = pose([1e9, 0.0, 0.0], [0.0; 3]);
    assert!(matches!(volume.integrate(&good, None, &far), Err(DenseError::Pose(_))));
    let colour = ColourImage::from_rgb(&Image::new(10, 10));
    assert!(matches!(volume.integrate(&good, Some(&colour), &Se3::identity()), Err(DenseError::Size { .. })));
    assert_eq!(volume.blocks(), 0);
    let config = TsdfConfig { voxel_m: 1e-4, ..TsdfConfig::default() };
    assert!(matches!(TsdfVolume::new(config), Err(DenseError::Config(_))));
    let lens = Camera { fx: -1.0, ..camera() };
    assert!(matches!(DepthPreparer::new(DepthConfig::default(), lens, 0.001), Err(DenseError::Camera(_))));
}

#[test]
fn depth_behind_a_lens_is_undistorted_first() {
    // As in the factory calibration of a RealSense, but stronger.
    let inverse = Distortion::InverseRadialTangential([-0.08, 0.05, 0.0008, -0.0006, -0.01]);
    for distortion in [inverse, Distortion::RadialTangential([-0.12, 0.03, 0.001, -0.0005, 0.0])] {
        let lens = Camera { distortion, ..camera() };
        let scene = Scene::room();
        let mut volume = volume(0.03, false);
        for pose in turn(12) {
            volume.integrate(&scene.frame(&lens, &pose), None, &pose).expect("a pose");
        }
        let mesh = mesh(&volume);
        let mut off: Vec<f64> =
            mesh.positions.iter().map(|p| scene.distance(Vec3::from(p.map(f64::from)))).collect();
        off.sort_by(f64::total_cmp);
        assert!(off[off.len() / 2] < 0.004, "{distortion:?}: median {}", off[off.len() / 2]);
        // Every pixel of the ideal image comes from where the lens projects its ray; unprojected, it is the same ray.
        for px in [[3.0, 4.0], [80.0, 60.0], [150.0, 110.0]] {
            let px = cairn_geometry::Vec2::from(px);
            let ray = lens.unproject(&px).expect("inside");
            assert!((lens.project(&ray).expect("in front") - px).norm() < 1e-6);
        }
    }
}
