//! A map rebuilt from a saved base and the commits since is the map itself; damaged commits are errors.

use crate::store::history::{Dice, camera, file, same, step};
use cairn_atlas::store::{MapFile, decode_commit, encode_commit};
use cairn_atlas::{Atlas, Change, ChangeSet, Feed, Mirror, Published, Snapshot};
use std::sync::Arc;

/// A saved base, the bytes of the commits after it, and the map in the end.
fn journal(seed: u64, commits: usize) -> (Vec<u8>, Vec<Vec<u8>>, Arc<Snapshot>) {
    let base = file(seed, 4, 9);
    let mut atlas = Atlas::new(base.snapshot.clone());
    let stream = atlas.subscribe();
    let mut dice = Dice::new(seed + 1000);
    for _ in 0..commits {
        let changes = step(&mut dice, atlas.latest(), 9);
        atlas.commit(changes);
    }
    let bytes = stream.changes.try_iter().map(|commit| encode_commit(&commit)).collect();
    (base.write().unwrap(), bytes, atlas.latest().clone())
}

fn read(bytes: &[u8], base: &Snapshot) -> Published {
    decode_commit(bytes, &camera(), base.octaves()).unwrap()
}

#[test]
fn base_and_commits_give_the_map() {
    let mut merged = 0;
    for seed in 0..40 {
        let (base, commits, wanted) = journal(seed, 12);
        let mut rebuilt = MapFile::read(&base).unwrap().snapshot;
        for bytes in &commits {
            let commit = read(bytes, &rebuilt);
            merged += commit.changes.iter().filter(|c| matches!(c, Change::Merge { .. })).count();
            let (next, applied) =
                rebuilt.apply(&ChangeSet { base: rebuilt.version(), changes: commit.changes });
            assert_eq!((next.version(), applied.dropped), (commit.version, 0), "seed {seed}");
            rebuilt = next;
        }
        assert_eq!(rebuilt.check(), Ok(()));
        same(&rebuilt, &wanted, &format!("seed {seed}"));
    }
    assert!(merged > 5, "{merged} merges: too few");
}

#[test]
fn fed_mirror_follows_like_a_subscriber() {
    let (base, commits, wanted) = journal(7, 20);
    let start = Arc::new(MapFile::read(&base).unwrap().snapshot);
    let (feed, stream) = Feed::new(start.clone());
    let mut mirror = Mirror::of(&start);
    commits.iter().for_each(|bytes| assert!(feed.put(read(bytes, &start))));
    assert_eq!(stream.behind(start.version()), 20);
    stream.changes.try_iter().for_each(|commit| mirror.take(&commit));
    assert_eq!(mirror, Mirror::of(&wanted));
    drop(stream);
    assert!(!feed.put(read(&commits[0], &start)), "nobody reads");
}

#[test]
fn damaged_commits_are_errors_or_other_commits_and_never_a_panic() {
    let (base, commits, _) = journal(3, 2);
    let base = MapFile::read(&base).unwrap().snapshot;
    let (camera, whole) = (camera(), &commits[0]);
    for cut in 0..whole.len() {
        let cut = decode_commit(&whole[..cut], &camera, base.octaves());
        assert!(cut.unwrap_err().to_string().starts_with("part 'commit'"));
    }
    for at in 0..whole.len() {
        for bit in [0, 3, 7] {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << bit;
            if let Ok(commit) = decode_commit(&bytes, &camera, base.octaves()) {
                let (next, _) = base.apply(&ChangeSet { base: base.version(), changes: commit.changes });
                assert_eq!(next.check(), Ok(()), "byte {at}, bit {bit}");
            }
        }
    }
}
