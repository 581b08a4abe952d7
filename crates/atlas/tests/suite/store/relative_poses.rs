//! Poses of key frames relative to others, as depth measured them: in the atlas, in files, in the journal and as robots send them.

use crate::store::history::{camera, file, same};
use cairn_atlas::store::pieces::{self, Pieces};
use cairn_atlas::store::{MapFile, Table, decode_commit, encode_commit};
use cairn_atlas::{
    Atlas, Change, ChangeSet, DEPTH_SCALE_SIGMA, KeyFrame, KeyFrameId, MapId, RELATED_SCALE_SIGMA,
    RelativePose, Snapshot,
};
use cairn_geometry::{LieGroup, Manifold, Se3, Sim3, So3, Vec3};
use cairn_vision::Frame;
use nalgebra::{Matrix6, Vector6};
use std::sync::Arc;

fn changed(snapshot: &Snapshot, changes: Vec<Change>) -> Snapshot {
    snapshot.apply(&ChangeSet { base: snapshot.version(), changes }).0
}

/// As an alignment tells it: exact to two millimetres, of some directions nothing.
fn information(n: usize) -> Matrix6<f64> {
    let axes = Matrix6::from_fn(|i, j| ((n + 2) as f64 * (1.3 * i as f64 + 2.1 * j as f64)).sin()).qr().q();
    let mut values = Vector6::new(2.4e5, 8e4, 1e3, 2.5e5, 3e4, 2e5);
    values.iter_mut().take(n % 4).for_each(|v| *v = 0.0);
    let all = axes * Matrix6::from_diagonal(&values) * axes.transpose();
    // A file has it in single precision.
    (all + all.transpose()).map(|v| f64::from((0.5 * v) as f32))
}

/// Of each key frame relative to up to three before it in its map, as they lie, but for a centimetre.
fn related(snapshot: &Snapshot) -> Vec<Change> {
    let of = |k: &KeyFrame| {
        let before: Vec<&KeyFrame> = snapshot.key_frames_of(k.map).filter(|b| b.id < k.id).collect();
        let z = |(n, b): (usize, &&KeyFrame)| {
            let off = Vector6::repeat(0.004);
            let from_from_here = b.here_from(k).retract(&off);
            RelativePose { from: b.id, from_from_here, information: information(k.id.index() + n) }
        };
        let all = before.iter().rev().take(3).rev().enumerate().map(z).collect();
        Change::RelativePoses(k.id, all)
    };
    snapshot.key_frames().map(of).collect()
}

fn with_related(seed: u64) -> MapFile {
    let mut saved = file(seed, 40, 12);
    saved.snapshot = changed(&saved.snapshot, related(&saved.snapshot));
    saved.snapshot.check().unwrap();
    assert!(count(&saved.snapshot) > 20, "{}", count(&saved.snapshot));
    saved
}

fn count(snapshot: &Snapshot) -> usize {
    snapshot.key_frames().map(|k| k.relative_poses.len()).sum()
}

/// What came back says the same, to a tenth of what it says, and of what nothing is known it says nothing.
fn is_near(now: &Snapshot, then: &Snapshot) {
    assert_eq!(now.check(), Ok(()));
    assert_eq!(count(now), count(then));
    for (k, was) in now.key_frames().zip(then.key_frames()) {
        for (z, was) in k.relative_poses.iter().zip(&was.relative_poses) {
            assert_eq!(z.from, was.from);
            let off = (z.from_from_here.inverse() * was.from_from_here).coordinates();
            assert!(off.dot(&(was.information * off)) < 0.11 && off.norm() < 1e-3, "{off}");
            let (is, before) = (z.information, was.information);
            assert!((is - before).norm() < 0.02 * before.norm(), "{is}{before}");
            let free = before.symmetric_eigen();
            for (value, axis) in free.eigenvalues.iter().zip(free.eigenvectors.column_iter()) {
                if *value < 1.0 {
                    assert!(
                        axis.dot(&(is * axis)) < 0.04,
                        "a direction that is free is known to less than 5 m"
                    );
                }
            }
        }
    }
}

#[test]
fn files_keep_them() {
    for seed in 0..12 {
        let saved = with_related(seed);
        let bytes = saved.write().unwrap();
        let back = MapFile::read(&bytes).unwrap();
        same(&back.snapshot, &saved.snapshot, "file");
        is_near(&back.snapshot, &saved.snapshot);
        assert_eq!(back.write().unwrap(), bytes);
    }
    let bare = file(3, 40, 12).write().unwrap();
    let names: Vec<String> = Table::read(&bare).unwrap().parts.iter().map(|p| p.name.clone()).collect();
    assert!(!names.iter().any(|name| name.starts_with("relative")), "{names:?}");
}

#[test]
fn robots_send_them_once() {
    for seed in 0..12 {
        let saved = with_related(seed);
        let mut sent = Pieces::default();
        sent.add(&saved).unwrap();
        is_near(&pieces::read(sent.bytes()).unwrap().snapshot, &saved.snapshot);
        let each = sent.parts().unwrap().relative_poses / count(&saved.snapshot);
        assert!(each < 90, "{each} bytes each");
        // What hardly changed is not sent again, and what changed is sent by itself.
        let k = saved.snapshot.key_frames().filter(|k| !k.relative_poses.is_empty()).last().unwrap();
        for (by, pieces_then) in [(1e-4, 1), (1e-2, 2)] {
            let mut sent = sent.clone();
            let mut moved = k.relative_poses.clone();
            moved.iter_mut().for_each(|z| z.from_from_here = z.from_from_here.retract(&Vector6::repeat(by)));
            let later = changed(&saved.snapshot, vec![Change::RelativePoses(k.id, moved)]);
            sent.add(&MapFile { snapshot: later.clone(), ..saved.clone() }).unwrap();
            assert_eq!(sent.lengths().len(), pieces_then, "{by}");
            is_near(&pieces::read(sent.bytes()).unwrap().snapshot, &later);
        }
        // They go with their key frames.
        let gone = saved.snapshot.key_frames().find(|k| k.parent.is_some()).unwrap().id;
        let later = changed(&saved.snapshot, vec![Change::RemoveKeyFrame(gone)]);
        sent.add(&MapFile { snapshot: later.clone(), ..saved.clone() }).unwrap();
        is_near(&pieces::read(sent.bytes()).unwrap().snapshot, &later);
    }
}

#[test]
fn the_journal_tells_them() {
    let before = file(4, 40, 12).snapshot;
    let mut atlas = Atlas::new(before.clone());
    let told = atlas.subscribe();
    atlas.commit(related(&before));
    let published = told.changes.try_recv().unwrap();
    let read = decode_commit(&encode_commit(&published), &camera(), before.octaves()).unwrap();
    let rebuilt = changed(&before, read.changes);
    for (k, wanted) in rebuilt.key_frames().zip(atlas.latest().key_frames()) {
        assert_eq!(k.relative_poses, wanted.relative_poses);
    }
}

#[test]
fn what_is_damaged_is_refused_or_left_out() {
    let saved = with_related(5);
    let mut sent = Pieces::default();
    sent.add(&saved).unwrap();
    let bytes = sent.bytes();
    for at in (0..bytes.len()).step_by(3) {
        let mut damaged = bytes.to_vec();
        damaged[at] ^= 1 << (at % 8);
        if let Ok(map) = pieces::read(&damaged) {
            map.snapshot.check().unwrap();
        }
    }
    let bytes = saved.write().unwrap();
    let parts = Table::read(&bytes).unwrap().parts;
    let total: u64 = parts.iter().map(|p| p.stored_bytes).sum();
    let before =
        parts.iter().take_while(|p| p.name != "relative poses 0").map(|p| p.stored_bytes).sum::<u64>();
    let mut damaged = bytes.clone();
    damaged[bytes.len() - (total - before) as usize + 7] ^= 0x55;
    let why = MapFile::read(&damaged).unwrap_err().to_string();
    assert!(why.contains("relative poses 0"), "{why}");
    let (rest, lost) = MapFile::salvage(&damaged).unwrap();
    assert!(lost.len() == 1 && lost[0].contains("relative poses 0"), "{lost:?}");
    assert_eq!((count(&rest.snapshot), rest.snapshot.check()), (0, Ok(())));
    assert_eq!(rest.snapshot.key_frame_count(), saved.snapshot.key_frame_count());
}

/// Two maps of three key frames each, each related to the one before.
fn two_maps() -> (Atlas, Vec<KeyFrameId>) {
    let mut atlas = Atlas::new(Snapshot::new());
    let mut ids: Vec<KeyFrameId> = Vec::new();
    for n in 0..6 {
        let id = atlas.latest().next_key_frame_id();
        let at = Se3::new(So3::exp(&(Vec3::y() * 0.1 * f64::from(n))), Vec3::x() * 0.3 * f64::from(n));
        let parent = (n % 3 > 0).then(|| ids[n as usize - 1]);
        atlas.commit(vec![Change::AddKeyFrame(Box::new(KeyFrame::new(
            id,
            Arc::<Frame>::default(),
            at,
            parent,
        )))]);
        ids.push(id);
    }
    let related = related(atlas.latest());
    assert_eq!(atlas.commit(related).dropped, 0);
    (atlas, ids)
}

#[test]
fn they_follow_their_maps() {
    let (mut atlas, ids) = two_maps();
    let froms = |s: &Snapshot, id: KeyFrameId| {
        s.key_frame(id).unwrap().relative_poses.iter().map(|z| z.from).collect::<Vec<_>>()
    };
    let both = (**atlas.latest()).clone();
    assert_eq!(froms(&both, ids[5]), [ids[3], ids[4]]);
    let (twice, shift) = both.combined_with(&both).unwrap();
    let shifted = |id| shift.key_frame(id).unwrap();
    assert_eq!(froms(&twice, shifted(ids[5])), [ids[3], ids[4]].map(shifted));
    assert_eq!(froms(&both.cut(&[ids[3], ids[5]].into()).unwrap(), ids[5]), [ids[3]]);
    assert_eq!(count(&both.without_maps(|map| map.root() == ids[0])), 3);
    assert_eq!(count(&both.part_of(0).unwrap()), 6);
    // Joined at another scale they say what they said: in the map's unit.
    let [into, from] = [0, 3].map(|n| MapId(ids[n]));
    let into_from = Sim3::new(So3::exp(&Vec3::z()), Vec3::y(), 1.5);
    atlas.commit(vec![Change::Merge { from, into, into_from, parent: ids[2] }]);
    let merged = atlas.latest().clone();
    assert_eq!((count(&merged), merged.check()), (6, Ok(())));
    for s in [&both, &merged] {
        let (from, here) = (s.key_frame(ids[4]).unwrap(), s.key_frame(ids[5]).unwrap());
        let z = here.relative_poses[1];
        let off = z.chi2(&Se3::identity(), &from.here_from(here));
        let in_map = z.in_map(from.unit).chi2(&from.world_from_camera, &here.world_from_camera);
        assert!(off > 1.0 && (in_map / off - 1.0).abs() < 1e-6, "{off} {in_map}");
    }
    // Who goes takes those relative to it along.
    atlas.commit(vec![Change::RemoveKeyFrame(ids[4])]);
    assert_eq!((froms(atlas.latest(), ids[5]), count(atlas.latest())), (vec![ids[3]], 4));
    assert_eq!(atlas.latest().check(), Ok(()));
}

#[test]
fn nonsense_is_dropped_and_what_is_gone_left_out() {
    let (mut atlas, ids) = two_maps();
    let z = atlas.latest().key_frame(ids[2]).unwrap().relative_poses[0];
    let mut nonsense = Vec::new();
    for (n, v) in [f64::NAN, -1.0, 1e300].into_iter().enumerate() {
        let mut bad = z;
        bad.information[(n, n)] = v;
        nonsense.push(Change::RelativePoses(ids[2], vec![bad]));
    }
    nonsense.push(Change::RelativePoses(ids[2], vec![z, z]));
    nonsense.push(Change::RelativePoses(ids[0], vec![z]));
    nonsense.push(Change::RelativePoses(KeyFrameId::from_index(99).unwrap(), vec![z]));
    let n = nonsense.len();
    assert_eq!(atlas.commit(nonsense).dropped, n);
    // Measured on an older snapshot, or across maps that are not joined.
    let of = |from| RelativePose { from, ..z };
    atlas.commit(vec![Change::RemoveKeyFrame(ids[1])]);
    assert_eq!(atlas.commit(vec![Change::RelativePoses(ids[2], vec![of(ids[0]), of(ids[1])])]).dropped, 0);
    assert_eq!(atlas.commit(vec![Change::RelativePoses(ids[5], vec![of(ids[0]), of(ids[3])])]).dropped, 0);
    assert_eq!((count(atlas.latest()), atlas.latest().check()), (2 + 1, Ok(())));
}

#[test]
fn lengths_are_those_of_depth_where_it_relates_most_key_frames() {
    let (mut atlas, ids) = two_maps();
    let sigma = |atlas: &Atlas| atlas.latest().scale_of(MapId(ids[0]), &camera()).metric_sigma();
    assert_eq!(sigma(&atlas), Some(RELATED_SCALE_SIGMA), "two of three");
    atlas.commit(vec![Change::RelativePoses(ids[2], Vec::new())]);
    assert_eq!(sigma(&atlas), Some(DEPTH_SCALE_SIGMA), "one of three");
}
