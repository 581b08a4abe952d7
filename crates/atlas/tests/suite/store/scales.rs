//! How well units of length are known and how an IMU is mounted: in the atlas, in files, in the journal and as robots send it.

use crate::store::history::{camera, file, same, with_readings};
use cairn_atlas::store::pieces::{self, Pieces};
use cairn_atlas::store::{MapFile, Table, decode_commit, encode_commit};
use cairn_atlas::{
    Atlas, Change, ChangeSet, DEPTH_SCALE_SIGMA, INERTIAL_SCALE_SIGMA, KeyFrame, MapId, MapScale, Snapshot,
};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_sensor::ImuNoise;
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

fn changed(snapshot: &Snapshot, changes: Vec<Change>) -> Snapshot {
    snapshot.apply(&ChangeSet { base: snapshot.version(), changes }).0
}

/// A file of several maps, each with a standard deviation of its own, of a camera on an IMU.
fn stated(seed: u64) -> MapFile {
    let mut saved = file(seed, 40, 12);
    let sigmas: Vec<Change> = saved
        .snapshot
        .maps()
        .zip(1..)
        .map(|((map, _), n)| Change::ScaleSigma(map, 0.001 * f64::from(n)))
        .collect();
    saved.snapshot = changed(&saved.snapshot, sigmas).with_imu_from_camera(mount());
    saved
}

fn mount() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.1, -1.2, 0.3)), Vec3::new(0.02, -0.01, 0.03))
}

fn sigmas(s: &Snapshot) -> Vec<Option<f64>> {
    s.maps().map(|(map, _)| s.stated_scale_sigma(map)).collect()
}

#[test]
fn files_and_pieces_keep_them() {
    let mut several = 0;
    for seed in 0..12 {
        let mut saved = stated(seed);
        let noise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-5, accel: 1e-2, accel_walk: 1e-4 };
        saved.snapshot = with_readings(&saved.snapshot, noise);
        let bytes = saved.write().unwrap();
        let back = MapFile::read(&bytes).unwrap();
        same(&back.snapshot, &saved.snapshot, "file");
        assert_eq!(
            (sigmas(&back.snapshot), back.snapshot.imu_from_camera()),
            (sigmas(&saved.snapshot), Some(&mount()))
        );
        assert_eq!(back.write().unwrap(), bytes);
        let mut sent = Pieces::default();
        sent.add(&saved).unwrap();
        // What is learnt later is sent by itself.
        let (map, _) = saved.snapshot.maps().last().unwrap();
        let later = changed(&saved.snapshot, vec![Change::ScaleSigma(map, 5e-4)]);
        sent.add(&MapFile { snapshot: later.clone(), ..saved.clone() }).unwrap();
        assert_eq!(sent.lengths().len(), 2);
        assert_eq!(sigmas(&pieces::read(sent.bytes()).unwrap().snapshot), sigmas(&later));
        several += usize::from(sigmas(&later).len() > 1);
    }
    assert!(several > 4, "{several} with several maps: too few");
}

/// A program that did not know them wrote files without these parts.
#[test]
fn a_file_that_says_nothing_means_what_its_sensors_are_known_to() {
    let saved = file(3, 20, 12);
    let bytes = saved.write().unwrap();
    let names: Vec<String> = Table::read(&bytes).unwrap().parts.iter().map(|p| p.name.clone()).collect();
    assert!(!names.iter().any(|name| name == "scales" || name == "imu"), "{names:?}");
    let back = MapFile::read(&bytes).unwrap().snapshot;
    assert!(sigmas(&back).iter().all(Option::is_none) && back.imu_from_camera().is_none());
    let mono = RectifiedCamera { baseline_fx: 0.0, ..camera() };
    for (map, prior) in back.maps() {
        assert_eq!(back.scale_of(map, &camera()), MapScale::Metric { sigma_log: DEPTH_SCALE_SIGMA });
        let expected = match (back.is_gravity_aligned(map), prior) {
            (true, _) => MapScale::Metric { sigma_log: INERTIAL_SCALE_SIGMA },
            (false, Some(prior)) => MapScale::Guessed { sigma_log: prior.sigma_log_scale },
            (false, None) => MapScale::Unknown,
        };
        assert_eq!(back.scale_of(map, &mono), expected);
    }
    let stated = stated(3).snapshot;
    let (map, _) = stated.maps().next().unwrap();
    assert_eq!(stated.scale_of(map, &camera()), MapScale::Metric { sigma_log: 0.001 });
}

#[test]
fn the_journal_tells_what_is_stated() {
    let before = stated(4).snapshot;
    let (map, _) = before.maps().next().unwrap();
    let mut atlas = Atlas::new(before.clone());
    let told = atlas.subscribe();
    atlas.commit(vec![Change::ScaleSigma(map, 0.0125)]);
    let published = told.changes.try_recv().unwrap();
    let read = decode_commit(&encode_commit(&published), &camera(), before.octaves()).unwrap();
    assert!(matches!(read.changes[..], [Change::ScaleSigma(of, sigma)] if of == map && sigma == 0.0125));
    assert_eq!(changed(&before, read.changes).stated_scale_sigma(map), Some(0.0125));
}

#[test]
fn they_follow_their_maps_and_nonsense_is_dropped() {
    let mut atlas = Atlas::new(Snapshot::new());
    let mut maps = Vec::new();
    for x in [0.0, 5.0] {
        let id = atlas.latest().next_key_frame_id();
        let at = Se3::new(So3::identity(), Vec3::x() * x);
        atlas.commit(vec![Change::AddKeyFrame(Box::new(KeyFrame::new(
            id,
            Arc::new(Frame::default()),
            at,
            None,
        )))]);
        maps.push(MapId(id));
    }
    let nonsense = [f64::NAN, 0.0, -0.01, f64::INFINITY].map(|sigma| Change::ScaleSigma(maps[0], sigma));
    assert_eq!(atlas.commit(nonsense.to_vec()).dropped, 4);
    atlas.commit(vec![Change::ScaleSigma(maps[0], 0.01), Change::ScaleSigma(maps[1], 0.02)]);
    let both = (**atlas.latest()).clone();
    let (twice, shift) = both.combined_with(&both).unwrap();
    assert_eq!(sigmas(&twice), [Some(0.01), Some(0.02), Some(0.01), Some(0.02)]);
    assert!(shift.key_frame(maps[0].root()).is_some());
    assert_eq!(sigmas(&both.without_maps(|map| map == maps[0])), [Some(0.02)]);
    assert_eq!(sigmas(&both.cut(&[maps[1].root()].into()).unwrap()), [Some(0.02)]);
    assert_eq!(sigmas(&both.part_of(0).unwrap()), sigmas(&both));
    let merge =
        Change::Merge { from: maps[1], into: maps[0], into_from: Sim3::identity(), parent: maps[0].root() };
    atlas.commit(vec![merge]);
    assert_eq!(sigmas(atlas.latest()), [Some(0.01)]);
    assert_eq!(atlas.latest().stated_scale_sigma(maps[1]), None);
}

/// Readings of an IMU that is mounted otherwise, or of which that is not known, say nothing beside those of another.
#[test]
fn of_two_mounts_the_first_stays_with_its_readings() {
    let noise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-5, accel: 1e-2, accel_walk: 1e-4 };
    let readings =
        |s: &Snapshot| s.key_frames().filter_map(|k| k.motion.as_ref()?.imu_factor.as_ref()).count();
    let [a, b] = [2, 7].map(|seed| with_readings(&file(seed, 20, 9).snapshot, noise));
    let (ours, theirs) = (readings(&a), readings(&b));
    assert!(ours > 0 && theirs > 0);
    let other = Se3::new(mount().rotation, mount().translation + Vec3::new(0.0, 0.0, 0.01));
    let near = Se3::new(mount().rotation, mount().translation + Vec3::new(0.0, 0.0, 1e-4));
    for (of_a, of_b, kept, left) in [
        (Some(mount()), Some(near), Some(mount()), ours + theirs),
        (Some(mount()), Some(other), Some(mount()), ours),
        (Some(mount()), None, Some(mount()), ours),
        (None, Some(other), Some(other), theirs),
        (None, None, None, ours + theirs),
    ] {
        let mounted = |s: &Snapshot, at: Option<Se3>| at.map_or(s.clone(), |at| s.with_imu_from_camera(at));
        let (both, _) = mounted(&a, of_a).combined_with(&mounted(&b, of_b)).unwrap();
        assert_eq!((both.imu_from_camera().copied(), readings(&both)), (kept, left), "{of_a:?} {of_b:?}");
    }
}
