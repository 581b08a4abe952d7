//! Stereo depth on recordings against the ground-truth motion: points of one frame must reproject to their matches in a
//! later frame.

use crate::common;

use cairn_geometry::Se3;
use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_vision::{Frame, FrontEnd, FrontEndConfig, OrbConfig, SensorMode, hamming};
use common::recordings::{Shot, euroc_rig, euroc_shots, jpeg, kitti_rig, kitti_shots};

/// Of points matched by descriptor on the epipolar line of the true motion, the number that lie where their depth
/// predicts, within three pixels of their level: `[matched, correct]`. Points whose position does not depend on depth
/// are left out.
fn correct_reprojections(
    camera: &FrontEnd,
    a: &Frame,
    b: &Frame,
    b_from_a: &Se3,
    which: impl Fn(usize) -> bool,
) -> [usize; 2] {
    let (mut found, mut right) = (0, 0);
    for i in (0..a.len()).filter(|&i| a.has_depth(i) && which(i)) {
        let ray = camera.model().unproject(a.px[i], 1.0);
        let here = camera.model().project(&(*b_from_a * (ray * a.depth[i] as f64)));
        let (Some([u, v, _]), Some([fu, fv, _])) = (here, camera.model().project(&(b_from_a.rotation * ray)))
        else {
            continue;
        };
        let (mut best, mut second, mut at) = (256, 256, 0);
        b.near(u as f32, v as f32, 40.0, |j| {
            let d = hamming(&a.descriptors[i], &b.descriptors[j]);
            if d < best {
                (second, best, at) = (best, d, j);
            } else if d < second {
                second = d;
            }
        });
        let length = (u - fu).hypot(v - fv);
        let scale = camera.octaves().scale(a.octave[i].max(b.octave.get(at).copied().unwrap_or(0)));
        if best > 50 || best * 10 > second * 8 || length < 6.0 * scale {
            continue;
        }
        let along = [(u - fu) / length, (v - fv) / length];
        let off = [b.px[at][0] as f64 - u, b.px[at][1] as f64 - v];
        if (off[0] * along[1] - off[1] * along[0]).abs() > 1.5 * scale {
            continue;
        }
        found += 1;
        if (off[0] * along[0] + off[1] * along[1]).abs() < 3.0 * scale {
            right += 1;
        }
    }
    [found, right]
}

fn check(name: &str, rig: &Rig, shots: &[Shot], features: usize, step: usize) {
    let orb = OrbConfig { features, ..OrbConfig::default() };
    let on = FrontEndConfig { orb, ..FrontEndConfig::default() };
    let mut off = on;
    off.stereo.borrow_correlation = 2.0;
    let mut front_ends = [off, on].map(|s| FrontEnd::new(rig, SensorMode::Stereo, s).unwrap());
    let (mut own, mut from_neighbours) = ([0; 2], [0; 2]);
    let mut depths = [0; 2];
    for k in (0..shots.len() - step).step_by((shots.len() / 20).max(1)) {
        let mut frame = |e: usize, shot: &Shot| {
            let images = vec![jpeg(&shot.0), jpeg(&shot.1)];
            let packet = FramePacket { stamp: Stamp(0), images, depth: None, imu: vec![], decode_ms: 0.0 };
            front_ends[e].extract(&packet).unwrap()
        };
        let (a, a_all, b) = (frame(0, &shots[k]), frame(1, &shots[k]), frame(0, &shots[k + step]));
        let camera = &front_ends[1];
        let t = camera.model().body_from_camera;
        let b_from_a = t.inverse() * shots[k + step].2.inverse() * shots[k].2 * t;
        let add = |sum: &mut [usize; 2], n: [usize; 2]| (sum[0], sum[1]) = (sum[0] + n[0], sum[1] + n[1]);
        add(&mut own, correct_reprojections(camera, &a_all, &b, &b_from_a, |i| a.has_depth(i)));
        add(&mut from_neighbours, correct_reprojections(camera, &a_all, &b, &b_from_a, |i| !a.has_depth(i)));
        add(&mut depths, [&a, &a_all].map(|f| f.depth.iter().filter(|d| **d > 0.0).count()));
    }
    let share = |n: [usize; 2]| n[1] as f64 / n[0].max(1) as f64;
    println!(
        "{name}: correct reprojections: {:.4} of {} matched by descriptor, {:.4} of {} at a neighbour's disparity; \
         depths {} -> {}",
        share(own),
        own[0],
        share(from_neighbours),
        from_neighbours[0],
        depths[0],
        depths[1]
    );
    assert!(share(own) > 0.9 && share(from_neighbours) > 0.8);
}

#[test]
fn kitti_depth_is_consistent_with_motion() {
    let Some(shots) = kitti_shots() else { return };
    check("kitti-a", &kitti_rig(), &shots, 2000, 2);
}

#[test]
fn euroc_depth_is_consistent_with_motion() {
    let Some(shots) = euroc_shots() else { return };
    check("euroc-mh01", &euroc_rig(), &shots[..280.min(shots.len())], 1200, 8);
}
