//! What tracking does around a start, on synthetic maps: frames that wait for a map, and a map that begins behind a blank view.

use crate::synthetic::{World, mono, off, pose, sideways, stereo};
use crate::tests::{STEP_S, now, step, tracker, tracker_at_end};
use crate::{KeyFrameRequest, State};
use cairn_atlas::{Atlas, Snapshot};
use cairn_geometry::{Se3, Sim3};
use cairn_vision::Frame;
use std::sync::Arc;

#[test]
fn frames_that_waited_for_a_map_get_their_poses_once_it_is_there() {
    let world = World::around(mono(), 41);
    let mut tracker = tracker(world.camera);
    let path: Vec<Se3> = (0..40).map(|n| pose(0.05 * f64::from(n), 0.0, 0.0)).collect();
    let views = world.walk(&path, 0.0, STEP_S);
    let mut at = None;
    for (n, view) in views.iter().enumerate() {
        let tracked = step(&mut tracker, &Snapshot::new(), view);
        assert!(tracked.earlier.is_empty() && tracked.pose.is_none(), "frame {n}");
        if let Some(KeyFrameRequest::Pair { first, second, .. }) = tracked.request {
            let of = |frame: &Arc<Frame>| views.iter().position(|v| Arc::ptr_eq(&v.frame, frame)).unwrap();
            at = Some((of(&first), of(&second)));
            break;
        }
    }
    let (first, second) = at.expect("a pair within two metres");
    assert!(second > first + 1, "frames lie between them");
    let mut atlas = Atlas::new(Snapshot::new());
    let (pair, poses) = ([first, second].map(|n| views[n].clone()), [path[first], path[second]]);
    let ids = world.map(&mut atlas, &pair, &poses, None, |_| Sim3::identity());
    tracker.map_created(atlas.latest(), ids[1]);
    let tracked = step(&mut tracker, atlas.latest(), &views[second + 1]);
    assert_eq!(tracked.state, State::Tracking);
    assert_eq!(tracked.earlier.len(), second - 1, "all but the pair");
    for (stamp, anchored) in &tracked.earlier {
        let n = views.iter().position(|v| v.frame.stamp == *stamp).unwrap();
        let (metres, radians) = off(&anchored.world_from_camera, &path[n]);
        assert!(
            n != first && n != second && metres < 5e-3 && radians < 2e-3,
            "frame {n}: {metres} m, {radians} rad"
        );
    }
    let next = step(&mut tracker, atlas.latest(), &views[second + 2]);
    assert!(next.earlier.is_empty(), "they are told once");
}

#[test]
fn behind_a_blank_view_a_map_begins_where_a_steady_motion_leads_and_says_how_uncertain_that_is() {
    let (world, behind) = (World::around(stereo(), 42), World::around(stereo(), 43));
    let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
    let truth = |k: f64| pose(1.0 - 0.03 * k, 0.0, 0.004 * k);
    for few in [100, usize::MAX] {
        let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
        // The view runs out of features while it is tracked.
        let mut sparse = World::around(stereo(), 42);
        for k in 1..=12 {
            let k = f64::from(k);
            let view = if k > 6.0 { &sparse } else { &world }.see(&truth(k), from_s + STEP_S * k);
            assert_eq!(step(&mut tracker, atlas.latest(), &view).state, State::Tracking, "frame {k}");
            if k == 6.0 && few < view.points.len() {
                sparse.keep(&view.points[..few]);
            }
        }
        // More than half a second later another world is in view: nothing relates it to what was seen before.
        let view = behind.see(&truth(29.0), from_s + STEP_S * 29.0);
        tracker.lose(&now(&view.frame, atlas.latest()), 0);
        let request = tracker.begin_new_map(&now(&view.frame, atlas.latest()));
        let Some(KeyFrameRequest::First { frame, relocation_prior: Some(prior), .. }) = request else {
            panic!("{request:?}")
        };
        assert!(Arc::ptr_eq(&frame, &view.frame));
        let led_to = if few == 100 { truth(29.0) } else { truth(12.0) };
        let (metres, radians) = off(&prior.anchored.world_from_camera, &led_to);
        assert!(metres < 0.02 && radians < 0.02, "{metres} m, {radians} rad from there after {few} features");
        // Somebody may have turned in the meantime.
        let blind_s = STEP_S * 17.0;
        assert!(prior.sigma_rad > 1.0 * blind_s && prior.sigma > 1.0 * blind_s, "{prior:?}");
    }
}
