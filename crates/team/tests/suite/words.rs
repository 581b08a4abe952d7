//! The visual words of a keyframe: they survive encoding, fit a kilobyte, and invalid messages are refused.

use cairn_random::Random;
use cairn_team::{KeyFrameWords, MAX_WORDS_BYTES, Refused, VERSION};
use cairn_vision::Descriptor;
use cairn_vision::bow::{BagOfWords, Vocabulary};
use proptest::prelude::*;

/// Random descriptors: a part specific to the image (seed `own`), and one of the place (seed `shared`).
fn descriptors(own: u64, shared: u64, count: usize, part: f64) -> Vec<Descriptor> {
    let (mut state, mut place) = (Random::new(own), Random::new(shared));
    let many = (count as f64 * part) as usize;
    (0..count)
        .map(|k| {
            let mut bytes = [0u8; 32];
            let from = if k < many { &mut place } else { &mut state };
            for chunk in bytes.chunks_exact_mut(8) {
                chunk.copy_from_slice(&from.bits().to_le_bytes());
            }
            bytes
        })
        .collect()
}

fn bag(own: u64, shared: u64, count: usize) -> BagOfWords {
    Vocabulary::embedded().bag(&descriptors(own, shared, count, 0.4))
}

#[test]
fn words_go_round_within_a_kilobyte_and_scores_stay() {
    let vocabulary = Vocabulary::embedded();
    for count in [1, 50, 300, 800, 1000, 2000] {
        let (one, two) = (bag(1, 7, count), bag(2, 7, count));
        let (words, left_out) = KeyFrameWords::new(3, 9, &one, vocabulary);
        let bytes = words.encode();
        let read = KeyFrameWords::decode(3, &bytes).unwrap();
        let back = read.bag(vocabulary).unwrap();
        let (before, after) = (one.similarity(&two), back.similarity(&two));
        println!(
            "{count} features: {} words in {} bytes, {left_out} left out; score {before:.4} then {after:.4}",
            one.words().len(),
            bytes.len()
        );
        assert!(bytes.len() <= MAX_WORDS_BYTES && (read.robot, read.seq) == (3, 9));
        if left_out == 0 {
            assert_eq!(back.words().len(), one.words().len());
            assert!((before - after).abs() < 1e-6);
            assert!(
                back.words().iter().zip(one.words()).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-6)
            );
        } else {
            // Words that are left out cannot be matched: the score falls about in proportion, and never rises.
            assert!(after < before && after > 0.5 * before, "{before} {after}");
        }
        assert!(count > 800 || left_out == 0, "{left_out} of {count} left out");
    }
}

#[test]
fn other_vocabularies_versions_kinds_and_senders_are_refused() {
    let vocabulary = Vocabulary::embedded();
    let (words, _) = KeyFrameWords::new(3, 9, &bag(1, 7, 100), vocabulary);
    let bytes = words.encode();
    assert_eq!(KeyFrameWords::decode(4, &bytes), Err(Refused::WrongSender { from: 4, claimed: 3 }));
    let mut other = bytes.clone();
    other[0] = VERSION + 1;
    assert_eq!(KeyFrameWords::decode(3, &other), Err(Refused::Version(VERSION + 1)));
    other = bytes.clone();
    other[1] = 9;
    assert_eq!(KeyFrameWords::decode(3, &other), Err(Refused::Kind(9)));
    other = bytes.clone();
    other[20] ^= 1;
    assert_eq!(KeyFrameWords::decode(3, &other), Err(Refused::Checksum));
    assert!(KeyFrameWords::decode(3, &bytes[..bytes.len() - 1]).is_err());
    let long = vec![VERSION; MAX_WORDS_BYTES + 1];
    assert_eq!(KeyFrameWords::decode(3, &long), Err(Refused::TooLong(MAX_WORDS_BYTES + 1)));
}

proptest! {
    #[test]
    fn garbage_never_harms(body in proptest::collection::vec(any::<u8>(), 0..200)) {
        let mut bytes = vec![VERSION, 2];
        bytes.extend(crc32fast::hash(&body).to_le_bytes());
        bytes.extend(body);
        if let Ok(words) = KeyFrameWords::decode(0, &bytes) {
            let _ = words.bag(Vocabulary::embedded());
        }
    }
}
