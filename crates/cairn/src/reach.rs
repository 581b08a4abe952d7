//! Which robots of a team need each other's maps: those whose key frames look alike by their words.
//!
//! The words of all key frames go to every robot, a kilobyte each, and whose maps a robot needs is a function of them
//! alone. So robots that have the same words come to the same groups, fetch the same maps and make the same atlas.

use cairn_atlas::RobotId;
use cairn_atlas::store::MapFile;
use cairn_team::{KeyFrameWords, MAX_WORDS_BYTES, Refused};
use cairn_vision::bow::{BagOfWords, Vocabulary};
use std::collections::{BTreeMap, BTreeSet};

/// Key frames in a piece: numbers that differ only below this bit, so that pieces stay the same from save to save.
const RUN_BITS: u32 = 3;

/// Two key frames look alike when their similarity is at least this part of the similarity of each to its neighbour in
/// its own map (the normalised score of Galvez-Lopez and Tardos 2012, equation 3).
const LEAST_SCORE: f64 = 0.6;

/// So many key frames of either map must look like one of the other; maps are joined where seams at three positions agree.
///
/// Nine walks of three simulated houses and two of an office with rooms that look alike: of the nine pairs of walks of one
/// house the least has 35 and 33 such key frames, the two of the office have 10 and 8, and all others at most one.
const LEAST_KEY_FRAMES: usize = 3;

/// The words of a map's key frames, to be published: the bytes, and the lengths of the pieces that they are made of.
pub fn words_of_map(robot: RobotId, file: &MapFile) -> (Vec<u8>, Vec<usize>) {
    let vocabulary = Vocabulary::current();
    let (mut bytes, mut lengths, mut run) = (Vec::new(), Vec::new(), None);
    let named = file.snapshot.key_frames().map(|k| (file.snapshot.key_frame_name(k.id).seq, &k.bag));
    let sorted: BTreeMap<u32, _> = named.filter(|(_, bag)| !bag.is_empty()).collect();
    for (seq, bag) in sorted {
        let message = KeyFrameWords::new(robot, seq, bag, vocabulary).0.encode();
        let before = bytes.len();
        bytes.extend((message.len() as u16).to_le_bytes());
        bytes.extend(message);
        if run.replace(seq >> RUN_BITS) != Some(seq >> RUN_BITS) {
            lengths.push(0);
        }
        if let Some(last) = lengths.last_mut() {
            *last += bytes.len() - before;
        }
    }
    (bytes, lengths)
}

/// The words of a map's key frames.
#[derive(Clone, Debug, Default)]
pub struct MapWords {
    /// The numbers of the key frames, rising.
    seqs: Vec<u32>,
    bags: Vec<BagOfWords>,
    /// The similarity of each to the more similar one of its neighbours in time.
    own: Vec<f64>,
    /// For each word the key frames that show it, with its weight.
    lists: BTreeMap<u32, Vec<(usize, f32)>>,
}

/// Why the words of a map cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum WordsError {
    /// The bytes are not whole.
    #[error("its words end early")]
    Cut,
    /// Those of a key frame are damaged, of another robot, or of another vocabulary.
    #[error(transparent)]
    KeyFrame(#[from] Refused),
}

impl MapWords {
    /// Reads what [`words_of_map`] made.
    ///
    /// # Errors
    /// [`WordsError`]: it is damaged, of another robot, or made with another vocabulary.
    pub fn read(robot: RobotId, bytes: &[u8]) -> Result<Self, WordsError> {
        let (mut named, mut rest) = (Vec::new(), bytes);
        while !rest.is_empty() {
            let message = rest.split_first_chunk::<2>().and_then(|(length, rest)| {
                rest.split_at_checked(usize::from(u16::from_le_bytes(*length)).min(MAX_WORDS_BYTES))
            });
            let (message, after) = message.ok_or(WordsError::Cut)?;
            let words = KeyFrameWords::decode(robot, message)?;
            named.push((words.seq, words.bag(Vocabulary::current())?));
            rest = after;
        }
        Ok(Self::new(named))
    }

    /// Of key frames by their numbers, in rising order.
    pub(crate) fn new(named: Vec<(u32, BagOfWords)>) -> Self {
        let (seqs, bags): (Vec<u32>, Vec<BagOfWords>) = named.into_iter().unzip();
        let next: Vec<f64> = bags.windows(2).map(|pair| pair[0].similarity(&pair[1])).collect();
        let at = |k: Option<usize>| k.and_then(|k| next.get(k)).copied().unwrap_or(0.0);
        let own = (0..bags.len()).map(|k| at(Some(k)).max(at(k.checked_sub(1)))).collect();
        let mut lists: BTreeMap<u32, Vec<(usize, f32)>> = BTreeMap::new();
        for (k, bag) in bags.iter().enumerate() {
            bag.words().iter().for_each(|(word, w)| lists.entry(word.0).or_default().push((k, *w)));
        }
        Self { seqs, bags, own, lists }
    }

    /// Number of key frames.
    pub fn len(&self) -> usize {
        self.bags.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.bags.is_empty()
    }

    /// How many key frames of this map look like one of the other, and of the other like one of this; the same numbers
    /// whichever way round.
    pub fn similar(&self, other: &Self) -> (usize, usize) {
        let (here, there) = self.similar_up_to(other, usize::MAX);
        (here.len(), there.len())
    }

    /// How much a key frame of this map looks like one of another: their similarity as a part of the similarity of each to its
    /// neighbour in its own map. `None` where one of them has no words.
    pub fn likeness(&self, seq: u32, other: &Self, other_seq: u32) -> Option<f64> {
        let at = |words: &Self, seq| words.seqs.binary_search(&seq).ok();
        let (here, there) = (at(self, seq)?, at(other, other_seq)?);
        let own = self.own[here].min(other.own[there]).max(f64::MIN_POSITIVE);
        Some(self.bags[here].similarity(&other.bags[there]) / own)
    }

    /// The numbers of those key frames of this map that look like one of the other, rising.
    pub fn similar_key_frames(&self, other: &Self) -> Vec<u32> {
        self.similar_up_to(other, usize::MAX).0.into_iter().map(|k| self.seqs[k]).collect()
    }

    /// Those key frames of both, searched no further than until there are `enough` of either: of robots that walk in one place a few
    /// key frames tell that.
    fn similar_up_to(&self, other: &Self, enough: usize) -> (BTreeSet<usize>, BTreeSet<usize>) {
        let (mut here, mut there) = (BTreeSet::new(), BTreeSet::new());
        for (k, bag) in self.bags.iter().enumerate() {
            if here.len().min(there.len()) >= enough {
                break;
            }
            let mut scores = vec![0.0; other.bags.len()];
            for (word, w) in bag.words() {
                for (n, v) in other.lists.get(&word.0).into_iter().flatten() {
                    scores[*n] += f64::from(v.min(*w));
                }
            }
            let own = |n: usize| self.own[k].min(other.own[n]).max(f64::MIN_POSITIVE);
            for n in (0..scores.len()).filter(|n| scores[*n] >= LEAST_SCORE * own(*n)) {
                here.insert(k);
                there.insert(n);
            }
        }
        (here, there)
    }

    /// Whether the two maps may show the same places.
    pub fn overlaps(&self, other: &Self) -> bool {
        let (here, there) = self.similar_up_to(other, LEAST_KEY_FRAMES);
        here.len().min(there.len()) >= LEAST_KEY_FRAMES
    }
}

/// The robots whose maps this one needs: those that it meets, those that they meet, and so on, itself included.
pub fn in_reach(robot: RobotId, overlaps: &BTreeSet<(RobotId, RobotId)>) -> BTreeSet<RobotId> {
    let mut reached = BTreeSet::from([robot]);
    loop {
        let next = overlaps.iter().flat_map(|(a, b)| [(a, b), (b, a)]);
        let new: Vec<RobotId> =
            next.filter(|(a, b)| reached.contains(a) && !reached.contains(b)).map(|(_, b)| *b).collect();
        if new.is_empty() {
            return reached;
        }
        reached.extend(new);
    }
}
