//! The ring of shared frames: readers that are overtaken know it, no torn frame is ever given out, and files that are not
//! whole, of another release or too large are told apart.
#![cfg(unix)]

use cairn_random::Random;
use cairn_workers::ring::{Borrowed, Ring, RingError};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

struct File(PathBuf);

impl File {
    fn new(name: &str) -> Self {
        Self(std::env::temp_dir().join(format!("{name}-{}.ring", std::process::id())))
    }
}

impl Drop for File {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// The bytes of a frame: every one follows from its number, and so does the length.
fn frame(number: u64) -> Vec<u8> {
    let mut random = Random::new(number);
    let length = 40_000 + random.below(20_000);
    (0..length).map(|i| (number as usize * 31 + i * 7) as u8).collect()
}

#[test]
fn frames_are_whole_until_they_are_overtaken() {
    let file = File::new("whole");
    let ring = Ring::create(&file.0, 5, 60_000).unwrap();
    let other = Ring::open(&file.0).unwrap();
    assert_eq!((other.slots(), other.slot_bytes()), (5, 60_000));
    let mut bytes = Vec::new();
    for number in 0..23 {
        assert_eq!(other.read(number, &mut bytes).unwrap(), Borrowed::Unwritten);
        let whole = frame(number);
        let (a, b) = whole.split_at(17);
        ring.write(number, &[a, b, &[]]).unwrap();
        for back in 0..=number {
            let expected = match number - back {
                age if age < 5 => Borrowed::Whole(()),
                age => Borrowed::Overtaken { by: back + age / 5 * 5 },
            };
            assert_eq!(other.read(back, &mut bytes).unwrap(), expected, "frame {back} after {number}");
            assert!(expected != Borrowed::Whole(()) || bytes == frame(back));
        }
    }
}

/// A writer that never waits, three readers on threads of their own that follow at random distances.
#[test]
fn no_reader_is_given_a_torn_frame() {
    const FRAMES: u64 = 1500;
    let file = File::new("race");
    let ring = Ring::create(&file.0, 3, 60_000).unwrap();
    let written = AtomicU64::new(0);
    let (mut whole, mut overtaken) = (0, 0);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for number in 0..FRAMES {
                ring.write(number, &[&frame(number)]).unwrap();
                written.store(number + 1, Ordering::Release);
            }
        });
        let read = |seed| {
            let (ring, mut random) = (Ring::open(&file.0).unwrap(), Random::new(seed));
            let (mut bytes, mut whole, mut overtaken) = (Vec::new(), 0u32, 0u32);
            while written.load(Ordering::Acquire) < FRAMES {
                let newest = written.load(Ordering::Acquire);
                let number = newest.saturating_sub(random.below(4) as u64);
                match ring.read(number, &mut bytes).unwrap() {
                    Borrowed::Whole(()) => {
                        assert!(bytes == frame(number), "frame {number} is not what was written");
                        whole += 1;
                    }
                    Borrowed::Overtaken { by } => {
                        assert!(by > number && by % 3 == number % 3);
                        overtaken += 1;
                    }
                    Borrowed::Unwritten | Borrowed::Torn => {}
                }
            }
            (whole, overtaken)
        };
        let readers: Vec<_> = (0..3).map(|seed| scope.spawn(move || read(seed))).collect();
        for reader in readers {
            let (w, o) = reader.join().unwrap();
            (whole, overtaken) = (whole + w, overtaken + o);
        }
    });
    println!("{whole} read whole, {overtaken} overtaken");
    assert!(whole > 100 && overtaken > 10, "{whole} whole, {overtaken} overtaken: too few to tell");
}

/// What a writer leaves that was killed after any number of its bytes, and any damage, is seen.
#[test]
fn unfinished_and_damaged_frames_are_never_whole() {
    let file = File::new("torn");
    let ring = Ring::create(&file.0, 2, 500).unwrap();
    let (old, new) = (vec![1; 400], vec![2; 450]);
    ring.write(0, &[&old]).unwrap();
    let before = std::fs::read(&file.0).unwrap();
    ring.write(2, &[&new]).unwrap();
    let after = std::fs::read(&file.0).unwrap();
    let (slot, mut bytes) = (4096, Vec::new());
    // In order: the mark of the unfinished frame is what `Ring::write` leaves if it ends at once.
    for cut in 0..=450 {
        let mut torn = before.clone();
        torn[slot + 64..slot + 64 + cut].copy_from_slice(&after[slot + 64..slot + 64 + cut]);
        std::fs::write(&file.0, &torn).unwrap();
        let found = ring.read(0, &mut bytes).unwrap();
        assert!(
            found == Borrowed::Torn || (cut == 0 && found == Borrowed::Whole(())),
            "{cut} bytes: {found:?}"
        );
        assert_eq!(ring.read(2, &mut bytes).unwrap(), Borrowed::Unwritten);
    }
    for at in (slot..slot + 24).chain(slot + 64..slot + 64 + 450) {
        let mut damaged = after.clone();
        damaged[at] ^= 4;
        std::fs::write(&file.0, &damaged).unwrap();
        let found = ring.read(2, &mut bytes).unwrap();
        assert_eq!(found, Borrowed::Torn, "byte {}", at - slot);
    }
    // A ring that is cut off is an error, not a signal that ends the reader.
    std::fs::write(&file.0, &after[..slot + 100]).unwrap();
    assert!(matches!(ring.read(2, &mut bytes), Err(RingError::Io { .. })));
    // The next writer goes on in the same slot.
    std::fs::write(&file.0, &after).unwrap();
    ring.write(4, &[&old]).unwrap();
    assert_eq!(ring.read(4, &mut bytes).unwrap(), Borrowed::Whole(()));
    assert_eq!(ring.read(2, &mut bytes).unwrap(), Borrowed::Overtaken { by: 4 });
}

#[test]
fn other_files_are_told_apart() {
    let file = File::new("others");
    drop(Ring::create(&file.0, 3, 1000).unwrap());
    let whole = std::fs::read(&file.0).unwrap();
    let error = |bytes: &[u8]| {
        std::fs::write(&file.0, bytes).unwrap();
        Ring::open(&file.0).unwrap_err().to_string()
    };
    let changed = |at: usize, to: u8| {
        let mut bytes = whole.clone();
        bytes[at] = to;
        bytes
    };
    assert!(error(b"short").ends_with("these are no shared frames: it is too short"));
    assert!(error(&changed(0, b'x')).ends_with("it begins with other bytes"));
    let older = error(&changed(8, 0));
    assert!(
        older.contains("shared frames of version 0, this program has version 1: another release left them"),
        "{older}"
    );
    assert!(error(&changed(12, 200)).ends_with("the checksum of its header is wrong"));
    assert!(error(&whole[..5000]).contains("it has 5000 bytes, not those of 3 slots of 1000"));
    std::fs::remove_file(&file.0).unwrap();
    assert!(matches!(Ring::open(&file.0), Err(RingError::Io { doing: "open", .. })));
}

#[test]
fn too_little_room_and_too_large_frames_are_errors() {
    let file = File::new("room");
    let full = Ring::create(&file.0, 1 << 20, 1 << 40).unwrap_err().to_string();
    assert!(full.contains("MB are free, the shared frames need 1152921"), "{full}");
    assert!(!file.0.exists());
    let nowhere = Ring::create(&PathBuf::from("/nowhere/at/all.ring"), 2, 100).unwrap_err();
    assert!(matches!(nowhere, RingError::Io { .. }), "{nowhere}");
    let ring = Ring::create(&file.0, 2, 100).unwrap();
    let large = ring.write(0, &[&[0; 60], &[0; 41]]).unwrap_err().to_string();
    assert!(large.starts_with("a frame of 101 bytes does not fit a slot of 100"), "{large}");
    ring.write(0, &[&[0; 100]]).unwrap();
}

/// `cargo test --release -p cairn-workers --test suite ring:: -- --ignored --nocapture`: what a frame of 640x480 costs.
#[test]
#[ignore = "measures times"]
fn cost_of_a_frame() {
    let folder = std::path::Path::new("/dev/shm");
    let path = if folder.is_dir() { folder.to_owned() } else { std::env::temp_dir() };
    let file = File(path.join(format!("cost-{}.ring", std::process::id())));
    let ring = Ring::create(&file.0, 32, 640 * 480).unwrap();
    let (pixels, mut bytes) = (vec![77; 640 * 480], Vec::new());
    let (mut write_us, mut read_us) = (Vec::new(), Vec::new());
    for number in 0..2000 {
        let start = std::time::Instant::now();
        ring.write(number, &[&pixels]).unwrap();
        let written = start.elapsed();
        assert_eq!(ring.read(number, &mut bytes).unwrap(), Borrowed::Whole(()));
        write_us.push(written.as_secs_f64() * 1e6);
        read_us.push((start.elapsed() - written).as_secs_f64() * 1e6);
    }
    for (what, us) in [("write", &mut write_us), ("read", &mut read_us)] {
        us.sort_by(f64::total_cmp);
        println!("{what}: median {:.0} us, smallest {:.0}, p95 {:.0}", us[1000], us[0], us[1900]);
    }
}
