//! Vocabularies: training, damaged files, words, bags, matching through the direct index, and import of DBoW2 text.

use cairn_vision::bow::{
    BagOfWords, Dbow2Error, NodeMatchConfig, TrainConfig, TrainError, Vocabulary, VocabularyError, WordId,
    import_dbow2, match_through_nodes, train,
};
use cairn_vision::{Descriptor, hamming};
use proptest::prelude::*;
use std::fmt::Write;
use std::sync::OnceLock;

/// Images of descriptors clustered around a few hundred centres.
fn images(count: usize, features: usize) -> Vec<Vec<Descriptor>> {
    let mut random = cairn_random::Random::new(11);
    let mut next = move || random.below(1 << 32);
    let centres: Vec<Descriptor> = (0..300).map(|_| std::array::from_fn(|_| next() as u8)).collect();
    let mut feature = || {
        let mut d = centres[next() % centres.len()];
        for _ in 0..12 {
            let bit = next() % 256;
            d[bit / 8] ^= 1 << (bit % 8);
        }
        d
    };
    (0..count).map(|_| (0..features).map(|_| feature()).collect()).collect()
}

fn small() -> (Vocabulary, Vec<Vec<Descriptor>>) {
    static TRAINED: OnceLock<(Vocabulary, Vec<Vec<Descriptor>>)> = OnceLock::new();
    let trained = TRAINED.get_or_init(|| {
        let images = images(40, 60);
        let config = TrainConfig { branching: 6, depth: 3, index_level: Some(1), ..TrainConfig::default() };
        (train(&images, &config).unwrap().vocabulary, images)
    });
    trained.clone()
}

/// The arrays of a file, parsed independently of the library: centres, first children, weights.
fn parts(v: &Vocabulary) -> (Vec<Descriptor>, Vec<u32>, Vec<f32>) {
    let n = v.facts().nodes as usize;
    let b = v.bytes();
    let word = |at: usize| -> [u8; 4] { b[at..at + 4].try_into().unwrap() };
    let centres = (0..n).map(|i| b[64 + 32 * i..96 + 32 * i].try_into().unwrap()).collect();
    let first = (0..=n).map(|i| u32::from_le_bytes(word(64 + 32 * n + 4 * i))).collect();
    let weights = (0..n).map(|i| f32::from_le_bytes(word(68 + 36 * n + 4 * i))).collect();
    (centres, first, weights)
}

#[test]
fn embedded_vocabulary_is_valid_and_small() {
    let v = Vocabulary::embedded();
    let f = v.facts();
    assert!(f.words > 10_000 && f.words < f.nodes, "{f:?}");
    assert!(v.bytes().len() < 3_000_000, "{}", v.bytes().len());
    assert!(f.images > 1000 && f.descriptors > 1_000_000, "{f:?}");
}

#[test]
fn word_is_the_leaf_of_the_greedy_descent() {
    let (v, images) = small();
    let (centres, first, weights) = parts(&v);
    for d in images.iter().flatten() {
        let mut node = 0usize;
        while first[node] < first[node + 1] {
            let children = first[node] as usize..first[node + 1] as usize;
            node = children.min_by_key(|c| (hamming(&centres[*c], d), *c)).unwrap();
        }
        assert_eq!(v.word(d), WordId(node as u32));
        assert_eq!(v.weight(WordId(node as u32)), weights[node]);
    }
}

#[test]
fn training_recovers_clusters_and_idf() {
    let images = images(40, 60);
    let config = TrainConfig { branching: 8, depth: 3, ..TrainConfig::default() };
    let trained = train(&images, &config).unwrap();
    // Members of a centre differ from it in 12 bits, from each other in 24, from the rest in about 128.
    assert!(trained.mean_distance < 30.0, "{}", trained.mean_distance);
    let v = &trained.vocabulary;
    // The idf weights agree with an independent count of the images that contain each word.
    let mut images_with = std::collections::BTreeMap::<WordId, u32>::new();
    for image in &images {
        let mut words: Vec<WordId> = image.iter().map(|d| v.word(d)).collect();
        words.sort();
        words.dedup();
        words.into_iter().for_each(|w| *images_with.entry(w).or_default() += 1);
    }
    for (word, n) in images_with {
        assert!((v.weight(word) - (40.0 / n as f32).ln()).abs() < 1e-5);
    }
}

#[test]
fn training_is_deterministic() {
    let images = images(20, 50);
    let config = TrainConfig { branching: 5, depth: 3, ..TrainConfig::default() };
    let bytes = |s: &TrainConfig| train(&images, s).unwrap().vocabulary.bytes().to_vec();
    assert_eq!(bytes(&config), bytes(&config));
    assert_ne!(bytes(&config), bytes(&TrainConfig { seed: 2, ..config }));
}

#[test]
fn training_rejects_too_little_data_and_bad_config() {
    let config = TrainConfig::default();
    assert_eq!(train(&[], &config).unwrap_err(), TrainError::TooLittle);
    assert_eq!(train(&[vec![[7; 32]; 50]], &config).unwrap_err(), TrainError::TooLittle);
    for (branching, depth) in [(1, 3), (5000, 3), (10, 0), (10, 17)] {
        let wrong = TrainConfig { branching, depth, ..config };
        assert!(matches!(train(&images(2, 9), &wrong), Err(TrainError::Config(_))));
    }
    let two = train(&[vec![[0; 32], [255; 32]], vec![[0; 32]]], &config).unwrap().vocabulary;
    assert_eq!(two.facts().words, 2);
}

#[test]
fn similarity_is_the_l1_score() {
    let (v, images) = small();
    let bags: Vec<BagOfWords> = images.iter().map(|i| v.bag(i)).collect();
    for a in &bags {
        let sum: f64 = a.words().iter().map(|(_, w)| f64::from(*w)).sum();
        assert!((sum - 1.0).abs() < 1e-5);
        assert!((a.similarity(a) - 1.0).abs() < 1e-5);
        assert_eq!(a.similarity(&BagOfWords::default()), 0.0);
        for b in &bags {
            assert_eq!(a.similarity(b), b.similarity(a));
            // One minus half the L1 distance.
            let of = |bag: &BagOfWords, word| {
                bag.words().iter().find(|(w, _)| *w == word).map_or(0.0, |(_, x)| f64::from(*x))
            };
            let mut words: Vec<WordId> = a.words().iter().chain(b.words()).map(|(w, _)| *w).collect();
            words.sort();
            words.dedup();
            let distance: f64 = words.iter().map(|w| (of(a, *w) - of(b, *w)).abs()).sum();
            assert!((a.similarity(b) - (1.0 - distance / 2.0)).abs() < 1e-5);
        }
    }
    assert!(v.bag(&[]).is_empty());
    assert_eq!(BagOfWords::from_parts(bags[0].words().to_vec(), bags[0].nodes().to_vec()).unwrap(), bags[0]);
    let mut wrong = bags[0].words().to_vec();
    wrong.swap(0, 1);
    assert!(BagOfWords::from_parts(wrong, vec![]).is_err());
}

#[test]
fn direct_index_matches_the_same_features() {
    let (v, images) = small();
    let first = &images[0];
    // The same features in reverse order, each with two bits flipped, followed by unrelated ones.
    let mut second: Vec<Descriptor> = first.iter().rev().copied().collect();
    second.iter_mut().for_each(|d| d[3] ^= 0b1001_0000);
    second.extend(&images[1]);
    let (a, b) = (v.bag(first), v.bag(&second));
    let config = NodeMatchConfig::default();
    let pairs = match_through_nodes((&a, first), (&b, &second), &config, |_| true, |_| true);
    let right = pairs.iter().filter(|[i, j]| *j == first.len() - 1 - i).count();
    assert!(right * 10 >= first.len() * 8, "{right} of {}", first.len());
    assert!(pairs.windows(2).all(|p| p[0][0] < p[1][0]));
    let mut js: Vec<usize> = pairs.iter().map(|p| p[1]).collect();
    js.sort();
    js.dedup();
    assert_eq!(js.len(), pairs.len(), "a feature was matched twice");
    let some = match_through_nodes((&a, first), (&b, &second), &config, |i| i % 2 == 0, |j| j % 3 == 0);
    assert!(!some.is_empty() && some.iter().all(|[i, j]| i % 2 == 0 && j % 3 == 0));
    // Descriptors that do not belong to the bag: no panic.
    match_through_nodes((&a, &first[..3]), (&b, &second[..2]), &config, |_| true, |_| true);
}

/// A vocabulary in DBoW2's text format, with its nodes numbered depth first.
fn text(v: &Vocabulary) -> String {
    let (centres, first, weights) = parts(v);
    let mut out = format!("{} {} 0 0\n", v.facts().branching, v.facts().depth);
    let mut number = vec![0u32; centres.len()];
    let mut count = 0;
    let mut stack = vec![0usize];
    while let Some(node) = stack.pop() {
        let children = first[node] as usize..first[node + 1] as usize;
        for c in children.clone() {
            count += 1;
            number[c] = count;
            let leaf = first[c] == first[c + 1];
            write!(out, "{} {} ", number[node], u8::from(leaf)).unwrap();
            centres[c].iter().for_each(|b| write!(out, "{b} ").unwrap());
            writeln!(out, "{}", weights[c]).unwrap();
        }
        stack.extend(children.rev());
    }
    out
}

#[test]
fn dbow2_text_round_trips() {
    let (v, images) = small();
    let imported = import_dbow2(text(&v).as_bytes()).unwrap();
    assert_eq!(parts(&imported), parts(&v));
    for image in &images {
        assert_eq!(imported.bag(image).words(), v.bag(image).words());
    }
}

#[test]
fn invalid_text_names_the_line() {
    let (v, _) = small();
    let good = text(&v);
    let lines: Vec<&str> = good.lines().collect();
    let fails = |change: &dyn Fn(&mut Vec<String>)| {
        let mut lines: Vec<String> = lines.iter().map(|l| l.to_string()).collect();
        change(&mut lines);
        match import_dbow2(lines.join("\n").as_bytes()) {
            Err(Dbow2Error::Line(n, why)) => (n, why),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(fails(&|l| l.clear()).0, 1);
    assert_eq!(fails(&|l| l[0] = "10 6 0".into()), (1, "weighting is missing".into()));
    assert_eq!(fails(&|l| l[0] = "10 6 1 0".into()).0, 1);
    assert_eq!(fails(&|l| l[4] = l[4].replace(' ', " x ")).0, 5);
    assert_eq!(fails(&|l| l[2] = "999999 1 0".into()).0, 3);
    assert_eq!(
        fails(&|l| l[5] = l[5].rsplit_once(' ').unwrap().0.into()),
        (6, "the weight is missing".into())
    );
    assert_eq!(fails(&|l| l[5] += " 1").0, 6);
    assert_eq!(fails(&|l| l[3] = "9".repeat(5000)).0, 4);
    assert!(fails(&|l| l.truncate(3)).1.contains("cut off"));
    assert!(fails(&|l| l.truncate(1)).1.contains("no nodes"));
}

/// The bytes with their checksum recomputed.
fn with_checksum(mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.len() > 16 {
        let sum = crc32fast::hash(&bytes[16..]);
        bytes[12..16].copy_from_slice(&sum.to_le_bytes());
    }
    bytes
}

#[test]
fn damaged_file_gives_a_specific_error() {
    let (v, _) = small();
    let good = v.bytes().to_vec();
    assert_eq!(Vocabulary::open(vec![]).unwrap_err(), VocabularyError::NotAVocabulary);
    let mut newer = good.clone();
    newer[8] = 2;
    assert_eq!(Vocabulary::open(newer).unwrap_err(), VocabularyError::Version(2));
    let cut = good[..good.len() - 1].to_vec();
    assert!(matches!(Vocabulary::open(cut), Err(VocabularyError::Length { .. })));
    for at in (16..good.len()).step_by(97) {
        let mut flipped = good.clone();
        flipped[at] ^= 4;
        assert!(Vocabulary::open(flipped).is_err(), "byte {at}");
    }
    assert_eq!(with_checksum(good.clone()), good);
}

proptest! {
    /// Corrupted bytes with a valid checksum give an error or a usable vocabulary, never a panic.
    #[test]
    fn corrupt_bytes_never_panic(changes in prop::collection::vec((0usize..100_000, any::<u8>()), 0..6), keep in 0usize..100_000) {
        let (v, images) = small();
        let mut bytes = v.bytes().to_vec();
        let n = v.facts().nodes as usize;
        for (at, value) in changes {
            // Mostly in the header and the tree, where errors matter most.
            let at = if at % 3 == 0 { at % bytes.len() } else if at % 3 == 1 { 16 + at % 48 } else { 64 + 32 * n + at % (8 * n) };
            bytes[at] = value;
        }
        if keep % 10 == 0 {
            bytes.truncate(keep % bytes.len());
        }
        if let Ok(v) = Vocabulary::open(with_checksum(bytes)) {
            let bag = v.bag(&images[0]);
            prop_assert!(bag.words().windows(2).all(|w| w[0].0 < w[1].0));
        }
    }

    #[test]
    fn corrupt_text_never_panics(at in 0usize..20_000, with in "[0-9 \n.-]{0,12}", cut in any::<bool>()) {
        let (v, _) = small();
        let mut text = text(&v);
        let at = at % text.len();
        if cut { text.truncate(at) } else { text.replace_range(at..(at + with.len()).min(text.len()), &with) }
        let _ = import_dbow2(text.as_bytes());
    }
}
