//! Maps in pieces: the same bytes come back, little of them changes from save to save, damage is refused.

use crate::history::file;
use cairn_atlas::store::pieces::{Pieces, cut, is_in_pieces, whole};
use cairn_atlas::{Change, ChangeSet};
use std::collections::BTreeSet;

#[test]
fn any_map_comes_back_byte_for_byte() {
    for (seed, key_frames) in (0..40).map(|seed| (seed, 3 + seed as usize % 20)).chain([(1, 150)]) {
        let map = file(seed, key_frames, 12).write().unwrap();
        let pieces = cut(&map).unwrap();
        assert_eq!(pieces.lengths.iter().sum::<usize>(), pieces.bytes.len());
        assert!(is_in_pieces(&pieces.bytes) && !is_in_pieces(&map));
        assert!(whole(&pieces.bytes).unwrap() == map, "seed {seed}: other bytes");
    }
}

fn each(pieces: &Pieces) -> Vec<&[u8]> {
    let mut rest = &pieces.bytes[..];
    let mut next = |n: &usize| {
        let (piece, after) = rest.split_at(*n);
        rest = after;
        piece
    };
    pieces.lengths.iter().map(&mut next).collect()
}

#[test]
fn a_key_frame_that_moves_changes_few_pieces() {
    let saved = file(3, 60, 12);
    let before = cut(&saved.write().unwrap()).unwrap();
    let moved = saved.snapshot.key_frames().last().unwrap().id;
    let changes = vec![Change::MoveKeyFrame(moved, Default::default())];
    let mut later = saved.clone();
    later.snapshot = saved.snapshot.apply(&ChangeSet { base: saved.snapshot.version(), changes }).0;
    let after = cut(&later.write().unwrap()).unwrap();
    let known: BTreeSet<&[u8]> = each(&before).into_iter().collect();
    // The index, how the map was made (with its version), and the run of key frames.
    let new: Vec<usize> = each(&after).iter().filter(|p| !known.contains(*p)).map(|p| p.len()).collect();
    assert!((2..=3).contains(&new.len()), "{new:?} of {}", after.lengths.len());
}

#[test]
fn what_is_damaged_is_refused() {
    let pieces = cut(&file(2, 8, 12).write().unwrap()).unwrap();
    assert!(cut(b"no map").is_err() && whole(b"no map").is_err());
    for length in 0..pieces.bytes.len() {
        assert!(whole(&pieces.bytes[..length]).is_err(), "cut off after {length}");
    }
    let longer = [&pieces.bytes[..], b"x"].concat();
    assert!(whole(&longer).is_err());
    // Changed bytes are refused, or give a file whose own checks decide; never a panic.
    for at in 0..pieces.bytes.len() {
        let mut changed = pieces.bytes.clone();
        changed[at] ^= 1 << (at % 8);
        if let Ok(map) = whole(&changed) {
            let _ = cairn_atlas::store::MapFile::read(&map);
        }
    }
}
