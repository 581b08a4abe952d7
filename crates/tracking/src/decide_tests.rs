//! When a key frame is requested.

use crate::decide::{Situation, wants_key_frame};
use crate::match_last::Matches;
use crate::synthetic::{RATE_HZ, World, mono, pose, sideways, stereo};
use cairn_atlas::{Change, MapId, Readout};
use cairn_geometry::Sim3;
use cairn_vision::RectifiedCamera;

/// A situation in front of the last key frame of a map, in which no key frame is due.
fn with_situation(change: impl FnOnce(&mut Situation)) -> bool {
    with_situation_of(stereo(), false, change)
}

/// The same of a camera, in a gravity-aligned map of a rolling shutter or not.
fn with_situation_of(camera: RectifiedCamera, aligned: bool, change: impl FnOnce(&mut Situation)) -> bool {
    let world = World::around(camera, 27);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.1));
    if aligned {
        let rolling = Readout { seconds: 0.02, sigma_s: 0.002 };
        let level = Change::AlignGravity(MapId(ids[0]), Sim3::identity());
        assert_eq!(atlas.commit(vec![level, Change::Readout(rolling)]).dropped, 0);
    }
    let snapshot = atlas.latest();
    let view = world.see(&pose(0.3, 0.0, 0.0), 2.0);
    let matches = Matches { landmarks: world.matches(snapshot, &view), extra: Vec::new() };
    let inliers = matches.count();
    let mut situation = Situation {
        snapshot,
        camera: &world.camera,
        frame: &view.frame,
        matches: &matches,
        inliers,
        need: 25,
        reference: ids[3],
        rotated_rad: 0.0,
        since: 5,
        since_s: None,
        stationary: false,
        idle: true,
    };
    change(&mut situation);
    wants_key_frame(&situation, RATE_HZ)
}

#[test]
fn wants_key_frame_when_the_view_has_changed_and_mapping_can_take_it() {
    assert!(!with_situation(|_| ()), "nothing has changed");
    assert!(with_situation(|s| s.inliers /= 2), "half of what the reference shows is gone");
    assert!(!with_situation(|s| (s.inliers, s.idle) = (s.inliers / 2, false)), "mapping is busy");
    assert!(with_situation(|s| (s.inliers, s.idle, s.since) = (s.inliers / 2, false, 20)), "overdue");
    assert!(with_situation(|s| (s.inliers, s.idle) = (s.inliers / 8, false)), "too weak to wait");
    assert!(!with_situation(|s| (s.inliers, s.since) = (s.inliers / 2, 0)), "the last one was just now");
    assert!(!with_situation(|s| s.inliers = 5), "too few to hold a key frame");
}

#[test]
fn wants_key_frame_of_one_camera_before_the_view_is_gone_though_mapping_is_busy() {
    let wants = |left: f64| {
        with_situation_of(mono(), false, |s| {
            (s.inliers, s.idle) = ((left * s.inliers as f64) as usize, false);
        })
    };
    assert!(!wants(0.8), "mapping is busy");
    assert!(wants(0.4), "too weak to wait");
}

#[test]
fn wants_fewer_key_frames_of_one_camera_straight_on_in_a_metric_map() {
    let wants = |camera, aligned, since, rotated_rad| {
        with_situation_of(camera, aligned, |s| {
            (s.inliers, s.since, s.rotated_rad) = (s.inliers / 2, since, rotated_rad);
        })
    };
    let [soon, later] = [1, 3];
    assert!(!wants(mono(), true, soon, 0.02), "straight on");
    assert!(wants(mono(), true, later, 0.02));
    assert!(wants(mono(), true, soon, 0.1), "a turn needs each");
    assert!(wants(mono(), false, soon, 0.02), "so does a map without metres");
    assert!(wants(stereo(), true, soon, 0.02), "depth");
}

#[test]
fn wants_key_frame_after_a_rotation_and_without_a_reference() {
    assert!(with_situation(|s| s.rotated_rad = 0.4), "a fifth of the field of view");
    assert!(!with_situation(|s| s.rotated_rad = 0.1));
    assert!(with_situation(|s| s.reference = s.snapshot.next_key_frame_id()));
}

#[test]
fn wants_key_frame_to_keep_imu_factors_short() {
    assert!(with_situation(|s| s.since_s = Some(0.3)));
    assert!(!with_situation(|s| s.since_s = Some(0.2)));
    assert!(!with_situation(|s| (s.since_s, s.idle) = (Some(0.3), false)));
}
