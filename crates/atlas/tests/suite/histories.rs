//! Any history of change sets, valid or not, keeps the invariants, leaves older snapshots unchanged, and
//! keeps the poses of what is anchored to removed key frames.

use cairn_atlas::{
    Atlas, Change, ChangeSet, KeyFrame, KeyFrameId, LandmarkId, MapId, MapPrior, Mirror, RelativePose,
    Snapshot,
};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_vision::Frame;
use proptest::prelude::*;
use std::sync::Arc;

const FEATURES: usize = 12;

/// A frame of a few features, each with its own descriptor.
fn frame(seed: u8) -> Arc<Frame> {
    let mut frame = Frame::default();
    for i in 0..FEATURES {
        frame.raw.push([10.0 * i as f32, 5.0]);
        frame.px.push([10.0 * i as f32, 5.0]);
        frame.octave.push((i % 8) as u8);
        frame.angle.push(0.0);
        frame.descriptors.push([seed.wrapping_mul(31).wrapping_add(i as u8); 32]);
        frame.right_x.push(f32::NAN);
        frame.depth.push(f32::NAN);
    }
    Arc::new(frame)
}

fn key_frame_id(i: u8) -> KeyFrameId {
    KeyFrameId::from_index(i as usize).unwrap()
}

fn landmark_id(i: u8) -> LandmarkId {
    LandmarkId::from_index(i as usize).unwrap()
}

fn pose(a: i8, b: i8) -> Se3 {
    let (a, b) = (a as f64 / 16.0, b as f64 / 16.0);
    Se3::new(So3::exp(&Vec3::new(0.1 * b, 0.2 * a, -0.1 * a)), Vec3::new(a, b, a - b))
}

fn point(a: i8, b: i8) -> Vec3 {
    Vec3::new(a as f64, b as f64, 3.0 + a as f64 / 8.0)
}

/// Key frames that changes may name: more than there will be, so that some do not exist.
const KEY_FRAMES: u8 = 16;
const LANDMARKS: u8 = 40;

/// A key frame or landmark is mostly added with the next free id (`None`), sometimes with a wrong one.
#[derive(Clone, Debug)]
enum Step {
    AddKeyFrame(Option<u8>, Option<u8>, i8, i8),
    AddLandmark(Option<u8>, i8, i8),
    Plain(Change),
}

fn step() -> impl Strategy<Value = Step> {
    let k = 0..KEY_FRAMES;
    let l = 0..LANDMARKS;
    let wrong = |w| prop_oneof![4 => Just(None), 1 => (0..w).prop_map(Some)];
    let poor = prop_oneof![9 => Just(false), 1 => Just(true)];
    prop_oneof![
        3 => (wrong(KEY_FRAMES), prop::option::weighted(0.8, k.clone()), any::<i8>(), any::<i8>())
            .prop_map(|(id, parent, a, b)| Step::AddKeyFrame(id, parent, a, b)),
        6 => (wrong(LANDMARKS), any::<i8>(), any::<i8>()).prop_map(|(id, a, b)| Step::AddLandmark(id, a, b)),
        12 => (l.clone(), k.clone(), 0..FEATURES as u16 + 2)
            .prop_map(|(l, k, f)| Step::Plain(Change::Observe(landmark_id(l), key_frame_id(k), f))),
        2 => (l.clone(), k.clone()).prop_map(|(l, k)| Step::Plain(Change::Forget(landmark_id(l), key_frame_id(k)))),
        3 => (l.clone(), l.clone()).prop_map(|(a, b)| Step::Plain(Change::Fuse(landmark_id(a), landmark_id(b)))),
        1 => l.clone().prop_map(|l| Step::Plain(Change::RemoveLandmark(landmark_id(l)))),
        1 => k.clone().prop_map(|k| Step::Plain(Change::RemoveKeyFrame(key_frame_id(k)))),
        2 => (k.clone(), prop::collection::btree_set(k.clone(), 0..4), any::<i8>(), prop_oneof![1 => Just(-1.0), 5 => 0.0..9.0])
            .prop_map(|(k, from, a, information)| {
                let of = |from| RelativePose {
                    from: key_frame_id(from),
                    from_from_here: pose(a, 3),
                    information: nalgebra::Matrix6::identity() * information,
                };
                Step::Plain(Change::RelativePoses(key_frame_id(k), from.into_iter().map(of).collect()))
            }),
        1 => (k.clone(), k.clone()).prop_map(|(a, b)| Step::Plain(Change::Link(key_frame_id(a), key_frame_id(b)))),
        1 => (k.clone(), prop_oneof![Just(0.0), Just(f64::NAN), 0.2..4.0])
            .prop_map(|(k, factor)| Step::Plain(Change::Scale(key_frame_id(k), factor))),
        1 => (k.clone(), k.clone(), any::<i8>(), any::<i8>()).prop_map(|(map, to, a, b)| {
            let to_from_root = pose(a, b);
            let prior = MapPrior { to: key_frame_id(to), to_from_root, sigma: 1.0, sigma_rad: 0.1, sigma_log_scale: 0.2 };
            Step::Plain(Change::MapPrior(MapId(key_frame_id(map)), prior))
        }),
        3 => (k.clone(), k.clone(), k.clone(), any::<i8>(), any::<i8>(), prop_oneof![1 => Just(-1.0), 5 => 0.3..3.0]).prop_map(
            |(from, into, parent, a, b, scale)| {
                let at = pose(a, b);
                Step::Plain(Change::Merge {
                    from: MapId(key_frame_id(from)),
                    into: MapId(key_frame_id(into)),
                    into_from: Sim3::new(at.rotation, at.translation, scale),
                    parent: key_frame_id(parent),
                })
            }
        ),
        1 => (k.clone(), any::<i8>(), any::<i8>(), prop_oneof![1 => Just(f64::NAN), 5 => 0.3..3.0]).prop_map(
            |(map, a, b, scale)| {
                let at = pose(a, b);
                let by = Sim3::new(at.rotation, at.translation, scale);
                Step::Plain(Change::AlignGravity(MapId(key_frame_id(map)), by))
            }
        ),
        1 => (k.clone(), prop_oneof![1 => Just(0.0), 1 => Just(f64::NAN), 4 => 0.3..3.0])
            .prop_map(|(map, factor)| Step::Plain(Change::Rescale(MapId(key_frame_id(map)), factor))),
        2 => (k, any::<i8>(), any::<i8>(), poor.clone()).prop_map(|(k, a, b, poor)| {
            let mut at = pose(a, b);
            if poor {
                at.translation.x = f64::NAN;
            }
            Step::Plain(Change::MoveKeyFrame(key_frame_id(k), at))
        }),
        2 => (l, any::<i8>(), any::<i8>(), poor).prop_map(|(l, a, b, poor)| {
            let at = if poor { Vec3::new(0.0, f64::INFINITY, 0.0) } else { point(a, b) };
            Step::Plain(Change::MoveLandmark(landmark_id(l), at))
        }),
    ]
}

/// The changes of one set, with the ids that follow from the snapshot and the set so far.
fn changes(snapshot: &Snapshot, steps: &[Step]) -> Vec<Change> {
    let (mut next_k, mut next_l) =
        (snapshot.next_key_frame_id().index(), snapshot.next_landmark_id().index());
    let mut resolve_ids = |step: &Step| match step {
        Step::AddKeyFrame(id, parent, a, b) => {
            let index = id.map_or(next_k, usize::from);
            next_k = next_k.max(index + 1);
            let id = KeyFrameId::from_index(index).unwrap();
            let parent = parent.map(key_frame_id);
            let k = KeyFrame::new(id, frame(index as u8), pose(*a, *b), parent);
            Change::AddKeyFrame(Box::new(k))
        }
        Step::AddLandmark(id, a, b) => {
            let index = id.map_or(next_l, usize::from);
            next_l = next_l.max(index + 1);
            Change::AddLandmark(LandmarkId::from_index(index).unwrap(), point(*a, *b))
        }
        Step::Plain(change) => change.clone(),
    };
    steps.iter().map(&mut resolve_ids).collect()
}

/// Everything visible of a snapshot, as text.
fn described(snapshot: &Snapshot) -> String {
    let key_frames: Vec<String> = snapshot
        .key_frames()
        .map(|k| {
            let relations = (k.map, k.parent, &k.links, &k.relative_poses);
            let content = (&k.landmarks, &k.covisible);
            format!("{:?} {:?} {:?} {relations:?} {content:?}", k.id, k.world_from_camera, k.unit)
        })
        .collect();
    let landmarks: Vec<String> = snapshot.landmarks().map(|l| format!("{l:?}")).collect();
    let maps: Vec<_> = snapshot.maps().collect();
    format!("{} {key_frames:?} {landmarks:?} {maps:?}", snapshot.version())
}

fn near(a: &Se3, b: &Se3) -> bool {
    (a.translation - b.translation).norm() < 1e-9 * (1.0 + a.translation.norm())
        && (a.rotation.inverse() * b.rotation).angle() < 1e-6
}

fn history() -> impl Strategy<Value = Vec<Vec<Step>>> {
    prop::collection::vec(prop::collection::vec(step(), 1..30), 1..14)
}

proptest! {
    #[test]
    fn any_history_keeps_invariants_and_old_snapshots(history in history()) {
        let mut snapshot = Snapshot::new();
        let mut past: Vec<(Snapshot, String)> = Vec::new();
        for steps in &history {
            past.push((snapshot.clone(), described(&snapshot)));
            let set = ChangeSet { base: snapshot.version(), changes: changes(&snapshot, steps) };
            let (next, applied) = snapshot.apply(&set);
            prop_assert_eq!(applied.done + applied.dropped, set.changes.len());
            prop_assert_eq!(next.version(), snapshot.version() + 1);
            prop_assert_eq!(next.check(), Ok(()));
            snapshot = next;
            prop_assert!(snapshot.key_frames().all(|k| k.world_from_camera.is_finite()));
            prop_assert!(snapshot.landmarks().all(|l| l.position.iter().chain(&l.normal).all(|v| v.is_finite())));
        }
        for (version, words) in &past {
            prop_assert_eq!(&described(version), words, "a snapshot that was held has changed");
        }
    }

    #[test]
    fn covisibility_follows_from_observations(history in history()) {
        let mut snapshot = Snapshot::new();
        for steps in &history {
            snapshot = snapshot.apply(&ChangeSet { base: snapshot.version(), changes: changes(&snapshot, steps) }).0;
            for k in snapshot.key_frames() {
                let mut votes = snapshot.votes(k.landmarks.iter().flatten());
                votes.retain(|(id, _)| *id != k.id);
                prop_assert_eq!(&k.covisible, &votes, "{:?}", k.id);
            }
        }
    }

    #[test]
    fn anchored_poses_follow_their_key_frames(history in history()) {
        let mut snapshot = Snapshot::new();
        // Anchored poses: the key frame and the relative pose. They are not updated by merges, loops or
        // removals.
        let mut anchored: Vec<(KeyFrameId, Se3)> = Vec::new();
        for steps in &history {
            let before: Vec<Option<Se3>> = anchored.iter().map(|(k, t)| snapshot.resolve(*k, t)).collect();
            let set = ChangeSet { base: snapshot.version(), changes: changes(&snapshot, steps) };
            let next = snapshot.apply(&set).0;
            for ((k, t), before) in anchored.iter().zip(&before) {
                let after = next.resolve(*k, t);
                prop_assert!(after.is_some(), "lost with {:?}", k);
                // A similarity keeps angles and the ratios of lengths: an anchored pose keeps its lengths in
                // the unit of its key frame.
                let (here, surviving_ancestor) = (next.world_from_here(*k).unwrap(), next.surviving_ancestor(*k).unwrap().0);
                let expected = next.key_frame(surviving_ancestor).unwrap().world_from_here() * next.surviving_ancestor(*k).unwrap().1;
                prop_assert!(near(&here.transform_pose(t), &expected.transform_pose(t)));
                let unmoved = snapshot.world_from_here(*k).is_some_and(|was| was == here);
                prop_assert!(!unmoved || near(&after.unwrap(), &before.unwrap()));
            }
            snapshot = next;
            for k in snapshot.key_frames().map(|k| k.id).collect::<Vec<_>>() {
                let at = pose(k.index() as i8, 7);
                let camera_from_it = snapshot.anchor(k, &at).unwrap();
                prop_assert!(near(&snapshot.resolve(k, &camera_from_it).unwrap(), &at), "does not resolve to the anchored pose");
                anchored.push((k, camera_from_it));
            }
        }
    }

    #[test]
    fn merge_transforms_a_map_rigidly(history in history(), a in any::<i8>(), b in any::<i8>(), scale in 0.3..3.0f64) {
        let mut snapshot = Snapshot::new();
        for steps in &history {
            snapshot = snapshot.apply(&ChangeSet { base: snapshot.version(), changes: changes(&snapshot, steps) }).0;
        }
        let maps: Vec<MapId> = snapshot.maps().map(|(id, _)| id).collect();
        let [into, .., from] = maps[..] else { return Ok(()) };
        let at = pose(a, b);
        let into_from = Sim3::new(at.rotation, at.translation, scale);
        let merge = Change::Merge { from, into, into_from, parent: into.root() };
        let (next, applied) = snapshot.apply(&ChangeSet { base: snapshot.version(), changes: vec![merge] });
        prop_assert_eq!(applied.done, 1);
        prop_assert_eq!(next.check(), Ok(()));
        prop_assert_eq!(next.maps().count(), maps.len() - 1);
        for k in snapshot.key_frames() {
            let moved = next.key_frame(k.id).unwrap();
            if k.map == from {
                prop_assert_eq!(moved.map, into);
                prop_assert!(near(&moved.world_from_camera, &into_from.transform_pose(&k.world_from_camera)));
                for l in k.landmarks.iter().flatten() {
                    let expected = into_from * snapshot.landmark(*l).unwrap().position;
                    let off = (next.landmark(*l).unwrap().position - expected).norm();
                    prop_assert!(off < 1e-9 * (1.0 + expected.norm()));
                }
            } else {
                prop_assert_eq!(moved.world_from_camera, k.world_from_camera);
            }
        }
    }

    #[test]
    fn changes_on_an_older_snapshot_are_rebased(
        history in history(),
        meanwhile in prop::collection::vec(step(), 0..20),
        late in prop::collection::vec(step(), 1..20),
        (a, b) in (any::<i8>(), any::<i8>()),
    ) {
        let mut base = Snapshot::new();
        for steps in &history {
            base = base.apply(&ChangeSet { base: base.version(), changes: changes(&base, steps) }).0;
        }
        // The late changes add nothing: the ids may be taken meanwhile. Nor do they gravity-align a map: the
        // writer does that at once.
        let adds = |c: &Change| {
            matches!(c, Change::AddKeyFrame(_) | Change::AddLandmark(..) | Change::AlignGravity(..) | Change::Rescale(..))
        };
        let mut late: Vec<Change> = changes(&base, &late).into_iter().filter(|c| !adds(c)).collect();
        // Everything is moved, as by a loop closure: each key frame differently.
        let moved = base.key_frames().map(|k| {
            Change::MoveKeyFrame(k.id, k.world_from_camera * pose(a, b.wrapping_add(k.id.index() as i8)))
        });
        late.extend(moved);
        let meant = base.apply(&ChangeSet { base: base.version(), changes: late.clone() }).0;
        let mut atlas = Atlas::new(base.clone());
        let mut now = changes(&base, &meanwhile);
        let id = now.iter().filter_map(|c| match c {
            Change::AddKeyFrame(k) => Some(k.id),
            _ => None,
        });
        let id = id.max().map_or(base.next_key_frame_id(), |k| KeyFrameId::from_index(k.index() + 1).unwrap());
        let parent = base.newest_key_frame().map(|k| k.id);
        now.push(Change::AddKeyFrame(Box::new(KeyFrame::new(id, frame(9), pose(b, a), parent))));
        atlas.commit(now);
        let before = atlas.latest().clone();
        let aligned = meanwhile.iter().any(|s| matches!(s, Step::Plain(Change::AlignGravity(..) | Change::Rescale(..))));
        atlas.commit_since(&base, late);
        let after = atlas.latest().clone();
        prop_assert_eq!(after.check(), Ok(()));
        if aligned && after.version() == before.version() {
            // The world frame of the changes no longer exists: they were dropped.
            return Ok(());
        }
        for k in after.key_frames() {
            let old = before.key_frame(k.id).unwrap();
            match (base.key_frame(k.id), meant.key_frame(k.id)) {
                // Not moved meanwhile: exactly where the late changes put it, in the map they left it in.
                (Some(was), Some(wanted)) if was.world_from_camera == old.world_from_camera && was.unit == old.unit => {
                    let same_maps = was.map == old.map && k.map == wanted.map;
                    prop_assert!(!same_maps || near(&k.world_from_camera, &wanted.world_from_camera), "{:?}", k.id);
                }
                // Added meanwhile: it keeps its pose relative to its parent.
                (None, _) => {
                    let Some(parent) = old.parent.filter(|p| k.parent == Some(*p)) else { continue };
                    let (Some(p), Some(q)) = (before.key_frame(parent), after.key_frame(parent)) else { continue };
                    let was = p.world_from_here().inverse().transform_pose(&old.world_from_camera);
                    let is = q.world_from_here().inverse().transform_pose(&k.world_from_camera);
                    prop_assert!(near(&was, &is), "{:?} has left its parent", k.id);
                }
                _ => {}
            }
        }
    }

    #[test]
    fn mirror_equals_the_snapshot(
        history in history(),
        meanwhile in prop::collection::vec(step(), 0..20),
        late in prop::collection::vec(step(), 0..20),
        subscribes_after in 0..14usize,
    ) {
        let mut atlas = Atlas::new(Snapshot::new());
        let from_the_start = atlas.subscribe();
        let gone_soon = atlas.subscribe();
        let mut subscribed_later = None;
        // Poses anchored to key frames, also to ones that will be removed, scaled and merged.
        let mut anchored: Vec<(KeyFrameId, Se3)> = Vec::new();
        for (nth, steps) in history.iter().enumerate() {
            if nth == subscribes_after {
                subscribed_later = Some(atlas.subscribe());
            }
            let set = changes(atlas.latest(), steps);
            atlas.commit(set);
            let snapshot = atlas.latest();
            anchored.extend(snapshot.key_frames().map(|k| (k.id, pose(k.id.index() as i8, nth as i8))));
        }
        drop(gone_soon);
        // Then changes that were made on an older snapshot and are rebased.
        let base = atlas.latest().clone();
        let adds = |c: &Change| {
            matches!(c, Change::AddKeyFrame(_) | Change::AddLandmark(..) | Change::AlignGravity(..) | Change::Rescale(..))
        };
        let now = changes(&base, &meanwhile);
        atlas.commit(now);
        atlas.commit_since(&base, changes(&base, &late).into_iter().filter(|c| !adds(c)).collect());
        let snapshot = atlas.latest().clone();
        for subscription in [Some(from_the_start), subscribed_later].into_iter().flatten() {
            let mut mirror = Mirror::of(&subscription.start);
            for published in subscription.changes.try_iter() {
                prop_assert_eq!(subscription.behind(mirror.version()), snapshot.version() - mirror.version());
                prop_assert_eq!(published.version, mirror.version() + 1, "out of order");
                mirror.take(&published);
            }
            prop_assert_eq!(subscription.behind(mirror.version()), 0);
            prop_assert_eq!(&mirror, &Mirror::of(&snapshot));
            for (k, camera_from_it) in &anchored {
                let (there, here) = (mirror.resolve(*k, camera_from_it), snapshot.resolve(*k, camera_from_it));
                prop_assert!(there.is_some() && there == here, "{:?} resolves to another pose", k);
            }
        }
    }

    #[test]
    fn removed_key_frame_follows_its_parent(history in history()) {
        let mut snapshot = Snapshot::new();
        // Removed key frames, with their parent and their pose there.
        let mut gone: Vec<(KeyFrameId, KeyFrameId, Se3)> = Vec::new();
        for change in history.iter().flatten() {
            let set = ChangeSet { base: snapshot.version(), changes: changes(&snapshot, std::slice::from_ref(change)) };
            let (next, applied) = snapshot.apply(&set);
            if let (Change::RemoveKeyFrame(id), 1) = (&set.changes[0], applied.done) {
                let before = snapshot.key_frame(*id).unwrap();
                let parent = before.parent.unwrap();
                let parent_from_it = snapshot.anchor(parent, &before.world_from_camera).unwrap();
                prop_assert!(near(&next.world_from_camera(*id).unwrap(), &before.world_from_camera), "it jumped");
                gone.push((*id, parent, parent_from_it));
            }
            snapshot = next;
            for (id, parent, parent_from_it) in &gone {
                prop_assert!(snapshot.key_frame(*id).is_none(), "it came back");
                let expected = snapshot.resolve(*parent, parent_from_it).unwrap();
                prop_assert!(near(&snapshot.world_from_camera(*id).unwrap(), &expected));
                let (surviving_ancestor, living_from_it) = snapshot.surviving_ancestor(*id).unwrap();
                let resolved = (snapshot.key_frame(surviving_ancestor).unwrap().world_from_here() * living_from_it).transform_pose(&Se3::identity());
                prop_assert!(near(&resolved, &expected));
            }
        }
    }
}

#[test]
fn full_neighbour_list_stays_exact_when_the_best_goes() {
    // Fifty key frames share a landmark each with the first, in pairs of which one shares two: more than are kept.
    let mut snapshot = Snapshot::new();
    let first = key_frame_id(0);
    let commit = |snapshot: &mut Snapshot, changes: Vec<Change>| {
        let (next, applied) = snapshot.apply(&ChangeSet { base: snapshot.version(), changes });
        assert_eq!(applied.dropped, 0);
        *snapshot = next;
    };
    commit(
        &mut snapshot,
        vec![
            Change::AddKeyFrame(Box::new(KeyFrame::new(first, frame(0), Se3::identity(), None))),
            Change::AddLandmark(landmark_id(0), point(0, 0)),
            Change::AddLandmark(landmark_id(1), point(1, 0)),
            Change::Observe(landmark_id(0), first, 0),
            Change::Observe(landmark_id(1), first, 1),
        ],
    );
    for i in 1..=50u8 {
        let id = key_frame_id(i);
        let k = KeyFrame::new(id, frame(i), pose(i as i8, 0), Some(first));
        let mut changes = vec![Change::AddKeyFrame(Box::new(k)), Change::Observe(landmark_id(0), id, 0)];
        if i % 2 == 0 {
            changes.push(Change::Observe(landmark_id(1), id, 1));
        }
        commit(&mut snapshot, changes);
    }
    commit(
        &mut snapshot,
        vec![Change::RemoveKeyFrame(key_frame_id(2)), Change::Forget(landmark_id(1), key_frame_id(4))],
    );
    let mut votes = snapshot.votes(snapshot.key_frame(first).unwrap().landmarks.iter().flatten());
    votes.retain(|(id, _)| *id != first);
    votes.truncate(40);
    assert_eq!(snapshot.key_frame(first).unwrap().covisible, votes);
}
