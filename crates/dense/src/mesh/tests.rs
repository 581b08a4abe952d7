//! Meshes against marching cubes over single voxels.

use super::*;
use crate::tsdf::STEPS;
use crate::{DepthConfig, DepthPreparer, TsdfConfig};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Image};
use std::collections::BTreeSet;

/// A slanted wall with a box before it, waves and holes, seen from two places: near and far surfaces next to each other, and
/// voxels that only one image saw.
fn volume() -> TsdfVolume {
    let mut volume =
        TsdfVolume::new(TsdfConfig { voxel_m: 0.03, ..TsdfConfig::default() }).expect("in range");
    for k in 0..2 {
        let depth = |i: usize| {
            let (x, y) = ((i % 120) as f32, (i / 120) as f32);
            let is_box = (40.0..70.0).contains(&x) && (30.0..60.0).contains(&y);
            let wall = 1.6 + 0.004 * x + 0.02 * (0.3 * x).sin() * (0.2 * y).cos();
            let is_hole = (x - 95.0).hypot(y - 20.0) < 6.0;
            if is_hole { 0.0 } else { wall - if is_box { 0.22 } else { 0.0 } }
        };
        let k = f64::from(k);
        let pose = Se3::new(So3::exp(&(Vec3::new(0.05, 0.12, 0.02) * k)), Vec3::new(-0.3, 0.1, 0.05) * k);
        fuse(&mut volume, depth, &pose);
    }
    volume
}

/// Fuses an image of 120x90 pixels, of which the depths are given by their numbers.
fn fuse(volume: &mut TsdfVolume, depth: impl Fn(usize) -> f32, pose: &Se3) {
    let camera = Camera::pinhole(120, 90, 100.0, 100.0, 59.5, 44.5);
    let mut preparer = DepthPreparer::new(DepthConfig::default(), camera, 1.0).expect("a camera");
    let image = Image::from_vec(120, 90, (0..120 * 90).map(depth).collect()).expect("all pixels");
    volume.integrate(preparer.prepare_metres(&image).expect("depth"), None, pose).expect("a pose");
}

/// The corners of each triangle in tenths of a millimetre, as a set; how many triangles there are, and how many cells were torn.
fn by_voxels(volume: &TsdfVolume, config: MeshConfig) -> (BTreeSet<[[i32; 3]; 3]>, [usize; 2]) {
    let to_steps = f64::from(STEPS) / volume.band_m();
    let (mut out, mut count, mut torn) = (BTreeSet::new(), 0, 0);
    let keys: BTreeSet<BlockKey> = volume.changed_since(0).collect();
    for low in keys.iter().flat_map(|key| (0..512).map(move |i| (key, i))).map(|(key, i)| {
        let at = [i & 7, i >> 3 & 7, i >> 6];
        [0, 1, 2].map(|k| key.0[k] * 8 + at[k])
    }) {
        let corner = |i: usize| [0, 1, 2].map(|k| low[k] + corner_at(i)[k] as i32);
        let voxels: Vec<_> = (0..8).map_while(|i| volume.voxel(corner(i))).collect();
        if voxels.len() < 8 || voxels.iter().any(|v| v.1 < config.least_weight) {
            continue;
        }
        let case = (0..8).fold(0, |all, i| all | usize::from(voxels[i].0 < 0.0) << i);
        let ends = |e: table::Edge| {
            let (axis, from) = table::edge_start(e);
            (axis, from, voxels[from].0, voxels[from | 1 << axis].0)
        };
        let triangles = &table::TRIANGLES[case];
        let is_torn = |&e: &table::Edge| (ends(e).2 - ends(e).3).abs() * to_steps > 1.25 * f64::from(STEPS);
        if triangles.iter().flatten().any(is_torn) {
            torn += 1;
            continue;
        }
        count += triangles.len();
        out.extend(triangles.iter().map(|t| {
            let mut corners = t.map(|e| {
                let (axis, from, a, b) = ends(e);
                let mut p = corner(from).map(|v| f64::from(v) + 0.5);
                p[axis] += a / (a - b);
                p.map(|v| (v * volume.config().voxel_m * 1e4).round() as i32)
            });
            // Begins at the least corner: triangles that turn the other way are others.
            let first = (0..3).min_by_key(|&i| corners[i]).expect("three");
            corners.rotate_left(first);
            corners
        }));
    }
    (out, [count, torn])
}

#[test]
fn meshes_are_those_of_marching_cubes_over_single_voxels() {
    let volume = volume();
    for least_weight in [1, 4, 5, 14] {
        let config = MeshConfig { least_weight };
        let (expected, [count, torn]) = by_voxels(&volume, config);
        let enough_torn = least_weight > 1 || torn > 5;
        assert!(count > 800 && enough_torn, "{count} triangles, {torn} cells torn");
        let mut found: Vec<[[f32; 3]; 3]> = Vec::new();
        let mut mesher = Mesher::new(config);
        let whole = mesher.whole(&volume);
        assert_eq!(whole.normals.len(), whole.positions.len());
        for (_, piece) in mesher.changed(&volume, 0) {
            found.extend(piece.triangles.iter().map(|t| t.map(|i| piece.positions[i as usize])));
            let used: BTreeSet<u32> = piece.triangles.iter().flatten().copied().collect();
            assert_eq!(used.len(), piece.positions.len(), "each vertex is one of a triangle");
        }
        assert_eq!(found.len(), whole.triangles.len());
        let near = |triangle: &[[f32; 3]; 3]| {
            let corners = triangle.map(|p| p.map(|v| (f64::from(v) * 1e4).round() as i32));
            (0..3).any(|turn| {
                let mut corners = corners;
                corners.rotate_left(turn);
                // Rounding to whole tenths of a millimetre may differ by one.
                let low = corners[0].map(|v| v - 1);
                expected
                    .range([low, [i32::MIN; 3], [i32::MIN; 3]]..)
                    .take_while(|t| t[0][0] <= low[0] + 2)
                    .any(|t| {
                        t.iter().flatten().zip(corners.iter().flatten()).all(|(a, b)| a.abs_diff(*b) <= 1)
                    })
            })
        };
        let missed = found.iter().filter(|t| !near(t)).count();
        assert_eq!((found.len(), missed), (count, 0), "least weight {least_weight}");
    }
}

#[test]
fn meshes_are_the_same_with_all_instructions() {
    let volume = volume();
    for least_weight in [1, 4, 5, 14] {
        let of = |backend: Backend| {
            let mut mesher = Mesher::new(MeshConfig { least_weight }).with_backend(backend);
            let pieces: Vec<_> = mesher.changed(&volume, 0).collect();
            (mesher.whole(&volume), pieces)
        };
        let plain = of(Backend::Scalar);
        assert!(plain.1.iter().map(|(_, piece)| piece.triangles.len()).sum::<usize>() > 800);
        for backend in Backend::ALL.into_iter().filter(|b| b.available()) {
            assert!(of(backend) == plain, "{backend:?}, least weight {least_weight}");
        }
    }
}

#[test]
fn blocks_that_depend_on_a_change_are_those_whose_corners_it_has() {
    let mut volume = volume();
    let revision = volume.revision();
    // A piece of the wall alone.
    fuse(&mut volume, |i| if i % 120 < 30 && i / 120 < 30 { 1.7 } else { 0.0 }, &Se3::identity());
    let found = depending(&volume, revision);
    assert!(found > 5 && 2 * found < volume.blocks());
    assert_eq!(depending(&volume, volume.revision()), 0);
}

#[test]
fn blocks_too_far_apart_for_an_array_are_found() {
    let mut volume = volume();
    let near = volume.blocks();
    let far = Se3::new(So3::exp(&Vec3::zeros()), Vec3::new(500.0, 500.0, 500.0));
    fuse(&mut volume, |i| if i % 120 < 30 && i / 120 < 30 { 1.7 } else { 0.0 }, &far);
    assert!(depending(&volume, 0) == volume.blocks() && volume.blocks() > near);
}

/// How many blocks depend on what has changed; they are compared with those next to it, and their meshes with those made one by one.
fn depending(volume: &TsdfVolume, revision: u64) -> usize {
    let expected: BTreeSet<BlockKey> = Mesher::affected(volume.changed_since(revision))
        .into_iter()
        .filter(|&key| volume.slot(key).is_some())
        .collect();
    let mut mesher = Mesher::new(MeshConfig::default());
    let found: Vec<_> = mesher.changed(volume, revision).collect();
    assert_eq!(found.len(), expected.len());
    assert_eq!(found.iter().map(|(key, _)| *key).collect::<BTreeSet<_>>(), expected);
    for (key, piece) in &found {
        assert!(mesher.block(volume, *key) == *piece);
    }
    found.len()
}
