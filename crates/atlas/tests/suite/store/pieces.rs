//! Maps in pieces: what joining needs comes back, a save adds what is new, damage is refused.

use crate::store::history::{Dice, file, step};
use cairn_atlas::store::pieces::{Pieces, is_in_pieces, read};
use cairn_atlas::store::{MapFile, sensor_name};
use cairn_atlas::{Change, ChangeSet, KeyFrame, LandmarkId, Snapshot};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use std::collections::BTreeMap;

fn in_pieces(file: &MapFile) -> Pieces {
    let mut pieces = Pieces::default();
    pieces.add(file).unwrap();
    pieces
}

fn changed(file: &MapFile, changes: Vec<Change>) -> MapFile {
    let snapshot = file.snapshot.apply(&ChangeSet { base: file.snapshot.version(), changes }).0;
    MapFile { snapshot, ..file.clone() }
}

/// What of a map has to be the same, as text: names, maps, loops, and which landmark is seen in which pixel.
fn described(s: &Snapshot) -> String {
    let features = |k: &KeyFrame| -> BTreeMap<LandmarkId, [i32; 3]> {
        let seen = |(i, l): (usize, &Option<LandmarkId>)| {
            let [x, y] = k.frame.px[i].map(|v| (16.0 * v).round() as i32);
            Some(((*l)?, [x, y, i32::from(k.frame.octave[i])]))
        };
        k.landmarks.iter().enumerate().filter_map(seen).collect()
    };
    let of = |k: &KeyFrame| {
        let name = s.key_frame_name(k.id);
        format!("{name:?} {:?} {:?} {:?} {:?} {:?}", k.stamp, k.map, k.parent, k.links, k.unit)
    };
    let key_frames: Vec<String> = s.key_frames().map(|k| format!("{} {:?}", of(k), features(k))).collect();
    let landmarks: Vec<_> = s.landmarks().map(|l| (s.landmark_name(l.id), l.observations.len())).collect();
    let maps: Vec<_> = s.maps().map(|(id, prior)| (id, prior, s.is_gravity_aligned(id))).collect();
    let removed: Vec<_> = (0..s.next_key_frame_id().index())
        .map(|i| s.surviving_ancestor(cairn_atlas::KeyFrameId::from_index(i).unwrap()).map(|(id, _)| id))
        .collect();
    let all = (s.version(), s.octaves(), s.right_offset(), s.next_landmark_id(), maps, removed, landmarks);
    format!("{all:?}\n{}", key_frames.join("\n"))
}

/// Poses, positions, pixels and depths differ by rounding only; a landmark's position by 1/32 pixel and 1/4096 of its depth.
fn is_near(now: &MapFile, then: &MapFile, moved: f64) {
    let (a, b) = (&now.snapshot, &then.snapshot);
    for (x, y) in a.key_frames().zip(b.key_frames()) {
        let off = x.world_from_camera.inverse() * y.world_from_camera;
        assert!(off.translation.norm() < 1e-5 + moved && off.rotation.angle() < 1e-5 + moved, "{off:?}");
        let was: BTreeMap<LandmarkId, usize> =
            y.landmarks.iter().enumerate().filter_map(|(i, l)| Some(((*l)?, i))).collect();
        for (i, l) in x.landmarks.iter().enumerate() {
            let (f, g) = (&x.frame, &y.frame);
            let j = was[&l.expect("only features that show landmarks come")];
            let off = (0..2).map(|axis| (f.px[i][axis] - g.px[j][axis]).abs()).fold(0.0, f32::max);
            let turned = (f.angle[i] - g.angle[j] + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU);
            assert!(off <= 0.0313 && (turned - std::f32::consts::PI).abs() <= 0.0124, "{off} px, {turned}");
            assert_eq!(f.right_x[i].is_finite(), g.right_x[j].is_finite());
            let disparity = |f: &cairn_vision::Frame, i: usize| f.px[i][0] - f.right_x[i];
            if f.right_x[i].is_finite() {
                assert!((disparity(f, i) - disparity(g, j)).abs() < 0.0079);
                assert!((45.0 / f.depth[i] - disparity(f, i)).abs() < 1e-3 || f.depth[i].is_nan());
            }
            assert_eq!(f.descriptors[i], a.landmark(l.unwrap()).unwrap().descriptor);
        }
    }
    for (l, was) in a.landmarks().zip(b.landmarks()) {
        // It is told from a key frame that sees it, in front.
        let there = was.observations.iter().map(|o| {
            let k = b.key_frame(o.key_frame).unwrap();
            k.world_from_camera.inverse() * was.position
        });
        let most =
            there.map(|p| (p.norm() + 1.0) * (1.0 + 1.0 / p.z.abs())).fold(0.0, f64::max) * (1e-3 + moved);
        assert!(
            (l.position - was.position).norm() < most,
            "{} of {most}",
            (l.position - was.position).norm()
        );
    }
}

#[test]
fn what_joining_needs_of_any_map_comes_back() {
    for (seed, key_frames) in (0..40).map(|seed| (seed, 3 + seed as usize % 20)).chain([(1, 150)]) {
        let map = file(seed, key_frames, 12);
        let pieces = in_pieces(&map);
        assert_eq!(pieces.lengths(), [pieces.bytes().len()]);
        assert!(is_in_pieces(pieces.bytes()) && !is_in_pieces(&map.write().unwrap()));
        let back = read(pieces.bytes()).unwrap();
        back.snapshot.check().unwrap();
        assert_eq!(described(&back.snapshot), described(&map.snapshot), "seed {seed}");
        assert_eq!((&back.about, &back.attached), (&map.about, &map.attached));
        assert_eq!(sensor_name(back.about.sensor), "stereo");
        is_near(&back, &map, 0.0);
        // What was rounded once stays as it is.
        assert!(in_pieces(&back).bytes().len() <= pieces.bytes().len() + 64);
        let again = read(in_pieces(&back).bytes()).unwrap();
        assert_eq!(described(&again.snapshot), described(&back.snapshot), "seed {seed}, rounded twice");
    }
}

/// However a map grows, merges, forgets and comes back: the pieces of all its saves say what it is, and each save leaves those
/// before it as they are, unless all is said anew.
#[test]
fn the_pieces_of_many_saves_are_the_last_map() {
    for seed in 0..12 {
        let mut dice = Dice::new(100 + seed);
        let mut map = file(seed, 4, 9);
        let (mut pieces, mut before) = (Pieces::default(), Vec::new());
        for save in 0..25 {
            for _ in 0..dice.roll(3) {
                map = changed(&map, step(&mut dice, &map.snapshot, 9));
            }
            if save == 12 {
                map.attached.insert("way/back".into(), vec![save; 5]);
                map.attached.remove("way/home");
            }
            pieces.add(&map).unwrap();
            assert!(pieces.bytes().starts_with(&before), "seed {seed}, save {save}");
            before = pieces.bytes().to_vec();
            assert_eq!(pieces.lengths().iter().sum::<usize>(), before.len());
            if dice.roll(6) == 0 {
                pieces = Pieces::open(&before).unwrap();
            }
            let back = read(&before).unwrap();
            let version = |s: &Snapshot| described(s).split_once(' ').unwrap().1.to_owned();
            assert_eq!(version(&back.snapshot), version(&map.snapshot), "seed {seed}, save {save}");
            is_near(&back, &map, 0.01);
        }
    }
}

/// A map that is another one under the same ids, as after its file was removed: nothing of the first is left.
#[test]
fn another_map_takes_the_place_of_the_first() {
    let (first, second) = (file(3, 20, 12), file(4, 12, 12));
    let mut pieces = in_pieces(&first);
    pieces.add(&second).unwrap();
    assert_eq!(described(&read(pieces.bytes()).unwrap().snapshot), described(&second.snapshot));
}

#[test]
fn what_moves_by_less_than_matters_is_not_sent_again() {
    let saved = file(3, 60, 12);
    let mut pieces = in_pieces(&saved);
    pieces.add(&saved).unwrap();
    assert_eq!(pieces.lengths().len(), 1, "nothing is new");
    let last = saved.snapshot.key_frames().last().unwrap();
    let by = |m: f64| {
        let to = Se3::new(
            last.world_from_camera.rotation,
            last.world_from_camera.translation + Vec3::new(m, 0.0, 0.0),
        );
        changed(&saved, vec![Change::MoveKeyFrame(last.id, to)])
    };
    let all = |m: f64| {
        let s = &saved.snapshot;
        let aside = Vec3::new(m, 0.0, 0.0);
        let to = |at: &Se3| Se3::new(at.rotation, at.translation + aside);
        let key_frames = s.key_frames().map(|k| Change::MoveKeyFrame(k.id, to(&k.world_from_camera)));
        let landmarks = s.landmarks().map(|l| Change::MoveLandmark(l.id, l.position + aside));
        changed(&saved, key_frames.chain(landmarks).collect())
    };
    pieces.add(&all(4e-4)).unwrap();
    assert_eq!(pieces.lengths().len(), 1, "less than half a millimetre");
    let mut farther = pieces.clone();
    farther.add(&all(6e-4)).unwrap();
    assert_eq!(farther.lengths().len(), 2, "more than that");
    pieces.add(&by(1e-2)).unwrap();
    let new = pieces.lengths()[1];
    // Its pose, and the landmarks that it saw first.
    assert!(pieces.lengths().len() == 2 && new < 400, "{new} of {} bytes", pieces.bytes().len());
    let back = read(pieces.bytes()).unwrap();
    let moved = back.snapshot.key_frame(last.id).unwrap().world_from_camera.translation
        - last.world_from_camera.translation;
    assert!((moved.x - 1e-2).abs() < 1e-5, "{moved}");
}

/// Landmarks go along with the key frame that they are told from: where a whole map turns, poses are sent.
#[test]
fn a_map_that_moves_as_a_whole_costs_its_poses() {
    let saved = file(3, 60, 24);
    let mut pieces = in_pieces(&saved);
    let turn = Sim3::new(So3::exp(&Vec3::new(0.3, -0.2, 0.1)), Vec3::new(3.0, -2.0, 1.0), 1.0);
    let maps: Vec<_> = saved.snapshot.maps().map(|(id, _)| Change::AlignGravity(id, turn)).collect();
    let turned = changed(&saved, maps);
    pieces.add(&turned).unwrap();
    is_near(&read(pieces.bytes()).unwrap(), &turned, 0.01);
    let [first, second] = pieces.lengths() else { panic!("{:?}", pieces.lengths()) };
    assert!(second * 4 < *first, "{second} of {first} bytes");
}

/// Whoever says the same thing again and again is shortened.
#[test]
fn pieces_that_say_much_again_are_replaced_by_one() {
    let mut map = file(3, 10, 12);
    let mut pieces = Pieces::default();
    let mut most = 0;
    for save in 0..60u8 {
        map.attached.insert(
            "way/home".into(),
            (0..60_000u32).map(|n| (n.wrapping_mul(n + u32::from(save)) >> 7) as u8).collect(),
        );
        pieces.add(&map).unwrap();
        most = most.max(pieces.bytes().len());
    }
    assert!(most < 2_500_000, "{most} of 3.6 MB");
    assert_eq!(read(pieces.bytes()).unwrap().attached, map.attached);
}

#[test]
fn what_is_damaged_is_refused() {
    let mut pieces = in_pieces(&file(2, 5, 12));
    pieces.add(&file(2, 8, 12)).unwrap();
    let bytes = pieces.bytes();
    assert!(read(b"no map").is_err());
    // Up to the end of a piece it is the map of an earlier save.
    for length in (0..bytes.len()).filter(|length| *length != pieces.lengths()[0]) {
        assert!(read(&bytes[..length]).is_err(), "cut off after {length}");
    }
    assert!(read(&[bytes, b"x"].concat()).is_err());
    let mut older = bytes.to_vec();
    older[7] = b'3';
    let why = read(&older).unwrap_err().to_string();
    assert_eq!(why, "part 'pieces': they are of format '3', this program reads '5'");
    // Changed bytes are refused or give a map that keeps its invariants; never a panic.
    for at in 0..bytes.len() {
        let mut changed = bytes.to_vec();
        changed[at] ^= 1 << (at % 8);
        if let Ok(map) = read(&changed) {
            map.snapshot.check().unwrap();
        }
    }
}
