//! The Kinect rig assumed for 7-Scenes: steps in depth must fall on steps in colour.

mod common;

use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{FramePacket, Rig};
use cairn_sources::{OpenOptions, open};
use common::data;

/// Mean brightness step across depth steps, seen from the near side, with the colour camera somewhere.
fn agreement(packets: &[FramePacket], rig: &Rig, colour_from_depth: &Se3) -> f64 {
    let (depth_camera, colour_camera) = (&rig.depth.as_ref().unwrap().camera, &rig.cameras[0].camera);
    let (mut sum, mut count) = (0.0, 0);
    for packet in packets {
        let (depth, image) = (packet.depth.as_ref().unwrap(), &packet.images[0]);
        for (y, x) in (3..477).flat_map(|y| (3..637).map(move |x| (y, x))) {
            let d = f64::from(depth.at(x, y));
            if !(400.0..4000.0).contains(&d) {
                continue;
            }
            let farther = |x, y| f64::from(depth.at(x, y)) > 1.12 * d;
            let across = [
                (1, 0, farther(x + 1, y) || farther(x - 1, y)),
                (0, 1, farther(x, y + 1) || farther(x, y - 1)),
            ];
            for (dx, dy, _) in across.into_iter().filter(|(_, _, step)| *step) {
                let ray = depth_camera.unproject(&Vec2::new(x as f64, y as f64)).unwrap();
                let point: Vec3 = ray * (0.001 * d / ray.z);
                let Some(px) = colour_camera.project(&(*colour_from_depth * point)) else { continue };
                let (u, v) = (px.x.round(), px.y.round());
                if !(2.0..637.0).contains(&u) || !(2.0..477.0).contains(&v) {
                    continue;
                }
                let (u, v) = (u as usize, v as usize);
                let step = f64::from(image.at(u + dx, v + dy)) - f64::from(image.at(u - dx, v - dy));
                sum += (0.5 * step.abs()).min(20.0);
                count += 1;
            }
        }
    }
    assert!(count > 10_000, "only {count} depth steps");
    sum / f64::from(count)
}

#[test]
fn depth_steps_fall_on_colour_steps() {
    let Some(path) = data("7scenes-kitchen") else { return };
    let mut source = open(path.to_str().unwrap(), OpenOptions::default()).unwrap();
    let mut packets = Vec::new();
    let mut at = 0;
    while let Some(packet) = source.next_packet().unwrap() {
        if at % 25 == 0 {
            packets.push(packet);
        }
        at += 1;
    }
    let rig = source.rig();
    let ours = rig.cameras[0].body_from_camera.inverse();
    let with_rig = agreement(&packets, rig, &ours);
    let [one_place, inverse] = [Se3::identity(), ours.inverse()].map(|t| agreement(&packets, rig, &t));
    println!("mean step: this rig {with_rig:.2}, one place {one_place:.2}, inverse {inverse:.2}");
    assert!(with_rig > 1.3 * one_place && with_rig > 1.3 * inverse);
    // Half a centimetre to either side is worse.
    for x in [-0.006, 0.006] {
        let moved = Se3::new(ours.rotation, ours.translation + Vec3::new(x, 0.0, 0.0));
        assert!(agreement(&packets, rig, &moved) < with_rig);
    }
}
