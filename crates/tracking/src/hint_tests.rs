//! Hints: a place counts where it is said to be and an image confirms it, and nowhere else.

use crate::synthetic::{World, pose, sideways, stereo};
use crate::tests::{STEP_S, assert_pose, step, tracker, tracker_at_end};
use crate::{HintOutcome, PlaceHint, State};
use cairn_atlas::{Atlas, MapId};
use cairn_geometry::{Se3, So3, Vec3};

fn hint(atlas: &Atlas, world_from_camera: Se3, radius: f64) -> PlaceHint {
    let map: MapId = atlas.latest().maps().next().unwrap().0;
    PlaceHint { map, world_from_camera, radius, free: None }
}

#[test]
fn what_an_image_shows_counts_only_near_the_hint() {
    let world = World::around(stereo(), 24);
    let (atlas, _) = world.exact_map(&sideways(6, 0.2));
    let truth = pose(0.5, 0.2, -0.15);
    let mut tracker = tracker(world.camera);
    // Said to be 3 m away, with key frames in reach: what the image shows is not believed, for a while.
    tracker.hint(hint(&atlas, pose(3.0, 0.2, 0.0), 1.0));
    let mut n = 0;
    let mut seconds = || {
        n += 1;
        100.0 + STEP_S * f64::from(n)
    };
    let refused = step(&mut tracker, atlas.latest(), &world.see(&truth, seconds()));
    assert!(matches!(refused.state, State::Lost { .. }) && refused.pose.is_none(), "{:?}", refused.state);
    assert_eq!(tracker.hint_outcome(), Some(HintOutcome::Searching));
    // Said to be near, on another floor: the image confirms it where the floor is not said, and the pose is that of the image.
    let near = hint(&atlas, Se3::new(So3::identity(), Vec3::new(1.0, 2.5, 0.0)), 1.0);
    tracker.hint(near);
    let refused = step(&mut tracker, atlas.latest(), &world.see(&truth, seconds()));
    assert!(refused.pose.is_none(), "{:?}", refused.state);
    tracker.hint(PlaceHint { free: Some(Vec3::y()), ..near });
    let found = step(&mut tracker, atlas.latest(), &world.see(&truth, seconds()));
    assert_pose(&found, &truth, 2e-3);
    assert_eq!(tracker.hint_outcome(), Some(HintOutcome::Recognised));
    // Said again: tracking agrees.
    tracker.hint(hint(&atlas, pose(1.0, 0.0, 0.0), 1.0));
    let again = step(&mut tracker, atlas.latest(), &world.see(&truth, seconds()));
    assert_eq!((again.state, tracker.hint_outcome()), (State::Tracking, Some(HintOutcome::Agrees)));
}

#[test]
fn a_hint_that_no_image_confirms_is_given_up_and_tracking_goes_on() {
    let world = World::around(stereo(), 26);
    let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    // Nothing is mapped there.
    tracker.hint(hint(&atlas, pose(50.0, 0.0, 0.0), 1.0));
    let truth = pose(0.95, 0.0, 0.0);
    let tracked = step(&mut tracker, atlas.latest(), &world.see(&truth, from_s + STEP_S));
    assert_pose(&tracked, &truth, 2e-3);
    let outcome = tracker.hint_outcome();
    assert!(matches!(outcome, Some(HintOutcome::NotRecognised { key_frames: 0, .. })), "{outcome:?}");
    // Something is, and the camera is not there: ten seconds later it is given up.
    tracker.hint(hint(&atlas, pose(-1.2, 0.0, 0.0), 1.0));
    for k in 2..400 {
        let tracked = step(&mut tracker, atlas.latest(), &world.see(&truth, from_s + STEP_S * f64::from(k)));
        assert_eq!(tracked.state, State::Tracking, "frame {k}");
        if tracker.hint_outcome() != Some(HintOutcome::Searching) {
            break;
        }
    }
    let outcome = tracker.hint_outcome();
    assert!(
        matches!(outcome, Some(HintOutcome::NotRecognised { key_frames, .. }) if key_frames > 0),
        "{outcome:?}"
    );
}
