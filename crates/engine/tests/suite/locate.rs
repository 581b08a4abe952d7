//! A lost depth camera finds its place in the submaps that follow a map, by the shape of the room.

use cairn_atlas::{Atlas, Change, KeyFrame, Snapshot};
use cairn_dense::{SubmapConfig, Verdict};
use cairn_engine::DenseMapper;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{DepthImage, Stamp};
use cairn_vision::Frame;
use scene::{Scene, camera, turn};
use std::sync::Arc;

#[path = "../../../dense/tests/suite/scene/mod.rs"]
mod scene;

/// The depth sensor beside the camera of the key frames, and turned against it.
fn mounted() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.0, 0.05, 0.0)), Vec3::new(0.06, 0.0, 0.01))
}

/// A room full of things: balls of different sizes along its walls. One image of a bare room would fit in many places.
fn room() -> Scene {
    let mut room = Scene::room();
    let ball = |i: usize| {
        let t = i as f64;
        let around = std::f64::consts::TAU * (t + 0.3 * (2.3 * t).sin()) / 16.0;
        let at = Vec3::new(1.7 * around.sin(), 0.9 * (1.7 * t).sin(), 1.3 * around.cos());
        (at, 0.2 + 0.12 * (3.1 * t).cos())
    };
    room.spheres.extend((0..16).map(ball));
    room
}

/// Depth in millimetres from a pose of the key frames' camera.
fn depth(scene: &Scene, world_from_camera: &Se3) -> DepthImage {
    let metres = scene.depth(&camera(), &(*world_from_camera * mounted()));
    let data = metres.data().iter().map(|z| (z * 1000.0 + 0.5) as u16).collect();
    DepthImage::from_vec(metres.width(), metres.height(), data).expect("all pixels")
}

#[test]
fn a_lost_camera_finds_its_place_and_not_one_in_another_room() {
    let mut atlas = Atlas::new(Snapshot::new());
    let from = atlas.subscribe();
    let config = SubmapConfig::default();
    let mut mapper = DenseMapper::following(from, camera(), 0.001, mounted(), config).expect("a camera");
    let mut first = None;
    for pose in turn(24) {
        let id = atlas.latest().next_key_frame_id();
        let mut frame = Frame::default();
        frame.stamp = Stamp(id.index() as i64 + 1);
        mapper.offer(frame.stamp, Arc::new(depth(&room(), &pose)), None);
        let parent = first;
        first = first.or(Some(id));
        atlas.commit(vec![Change::AddKeyFrame(Box::new(KeyFrame::new(id, Arc::new(frame), pose, parent)))]);
        mapper.follow();
    }
    let map = mapper.largest_map().expect("a map");
    let truth = Se3::new(So3::exp(&Vec3::new(0.1, 0.4, 0.05)), Vec3::new(-0.1, 0.1, -0.5));
    for up in [None, Some(truth.rotation.inverse() * Vec3::z())] {
        let found = mapper.locate(map, &depth(&room(), &truth), up).expect("depth").expect("submaps");
        assert!(found.registration.accepted(), "{found:?}");
        let off = truth.inverse() * found.world_from_source;
        assert!(off.translation.norm() < 0.03 && off.rotation.angle() < 0.02, "{off:?} with up {up:?}");
    }
    let other = Scene {
        room: Some((Vec3::new(-3.5, -2.0, -3.0), Vec3::new(3.0, 1.7, 2.6))),
        spheres: vec![(Vec3::new(0.3, 0.2, 1.6), 0.7), (Vec3::new(-1.2, -0.6, 1.2), 0.3)],
    };
    let elsewhere = mapper.locate(map, &depth(&other, &truth), None).expect("depth").expect("submaps");
    assert!(elsewhere.registration.verdict != Verdict::Accepted, "{elsewhere:?}");
}
