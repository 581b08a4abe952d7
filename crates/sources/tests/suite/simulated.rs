//! Simulated worlds as sources, and recordings written from them read back.

use crate::common;

use cairn_sensor::{FramePacket, Source};
use cairn_sources::{OpenOptions, open};
use common::Folder;

fn part(frames: usize) -> OpenOptions {
    OpenOptions { frames: Some(frames), ..Default::default() }
}

fn all(source: &mut dyn Source) -> Vec<FramePacket> {
    std::iter::from_fn(|| source.next_packet().unwrap()).collect()
}

#[test]
fn simulated_world_is_a_source() {
    let options = OpenOptions { start_s: 1.0, frames: Some(3), ..Default::default() };
    let mut source = open("sim:corridor?resolution=160x120", options).unwrap();
    assert_eq!(source.info().frames, Some(3));
    let packets = all(source.as_mut());
    assert_eq!((packets.len(), packets[0].images.len(), packets[0].images[0].width()), (3, 2, 160));
    assert!(!packets[1].imu.is_empty() && source.info().truth.len() == 3);
}

#[test]
fn invalid_worlds_are_refused() {
    let text = |source: &str, options| open(source, options).err().unwrap().to_string();
    assert!(text("sim:atlantis", part(1)).contains("atlantis"));
    assert!(text("sim:corridor?colour=red", part(1)).contains("unknown key"));
    let options = OpenOptions { rig: Some(common::rgbd_rig()), ..Default::default() };
    assert!(text("sim:corridor", options).contains("a rig of its own"));
    assert!(text("sim:corridor", part(0)).contains("0 frames"));
}

/// Asserts that images, stamps, ground truth and rig of a written recording equal those of the source.
fn same(name: &str, written: &str, first_body: bool) {
    let (mut a, mut b) = (open(name, part(4)).unwrap(), open(written, OpenOptions::default()).unwrap());
    let (pa, pb) = (all(a.as_mut()), all(b.as_mut()));
    assert_eq!((pa.len(), pb.len(), b.skipped().len()), (4, 4, 0));
    for (p, q) in pa.iter().zip(&pb) {
        assert_eq!((p.stamp, &p.images), (q.stamp, &q.images));
        assert_eq!(p.depth.is_some(), q.depth.is_some());
    }
    assert_eq!(a.rig().cameras[0].camera.fx, b.rig().cameras[0].camera.fx);
    let to_body = if first_body { a.rig().cameras[0].body_from_camera } else { Default::default() };
    assert_eq!((a.info().truth.len(), b.info().truth.len()), (4, 4));
    for ((s, p), (t, q)) in a.info().truth.iter().zip(&b.info().truth) {
        let off = (*p * to_body).inverse() * *q;
        assert!(s == t && off.translation.norm() < 1e-9 && off.rotation.angle() < 1e-7, "{off:?}");
    }
    if let (Some(d), Some(e)) = (&pa[2].depth, &pb[2].depth) {
        let unit = |s: &dyn Source| s.rig().depth.as_ref().unwrap().metres_per_unit;
        let (u, v) = (unit(a.as_ref()), unit(b.as_ref()));
        assert!(
            d.data()
                .iter()
                .zip(e.data())
                .all(|(x, y)| *y == 0 || (f64::from(*x) * u - f64::from(*y) * v).abs() < u)
        );
        assert!(e.data().iter().filter(|y| **y > 0).count() * 2 > e.data().len());
    }
    let samples = |p: &[FramePacket]| p.iter().flat_map(|p| p.imu.clone()).collect::<Vec<_>>();
    if b.rig().imu.is_some() {
        assert_eq!(samples(&pa), samples(&pb));
    }
}

#[test]
fn written_recordings_round_trip() {
    let folder = Folder::new();
    let name = "sim:corridor?resolution=160x120&sensor=stereo-imu";
    let euroc = folder.path().join("euroc");
    cairn_sim::write_euroc(&euroc, open(name, part(4)).unwrap().as_mut()).unwrap();
    same(name, euroc.to_str().unwrap(), false);
    let name = "sim:corridor?resolution=160x120&sensor=rgbd";
    let tum = folder.path().join("tum");
    cairn_sim::write_tum(&tum, open(name, part(4)).unwrap().as_mut()).unwrap();
    same(name, tum.to_str().unwrap(), true);
}
