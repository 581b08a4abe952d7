//! The visual words of a keyframe, encoded in at most a kilobyte.
//!
//! The weight of a word is its count times its inverse document frequency, which is stored in the vocabulary that both
//! sides have. So only counts are sent: the sorted ids of all words, each repeated as often as it was seen, as
//! differences in Rice codes (Rice, "Some practical universal noiseless coding techniques", 1979). The decoded weights
//! are the same, up to rounding. If the code is longer than a kilobyte, the words of least weight are left out.

use crate::RobotId;
use crate::envelope::Refused;
use crate::envelope::{Kind, open, seal};
use cairn_vision::bow::{BagOfWords, Vocabulary, WordId};
use serde::{Deserialize, Serialize};

/// Greatest length of a message with the words of a keyframe, in bytes.
pub const MAX_WORDS_BYTES: usize = 1024;
/// Greatest number of words in a message.
const MAX_WORDS: usize = 4096;

/// The words of one keyframe of a robot.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyFrameWords {
    /// The robot that owns the keyframe.
    pub robot: RobotId,
    /// Number of the keyframe.
    pub seq: u32,
    /// Checksum of the vocabulary.
    vocabulary: u32,
    /// Number of words, each counted as often as it was seen.
    count: u16,
    /// Number of low bits of a difference that are written unencoded.
    rice: u8,
    bits: Vec<u8>,
}

impl KeyFrameWords {
    /// From the bag of words of a keyframe. Also returns how many of its words were left out to fit the limit.
    pub fn new(robot: RobotId, seq: u32, bag: &BagOfWords, vocabulary: &Vocabulary) -> (Self, usize) {
        let mut counted = counts(bag, vocabulary);
        // The words of greatest weight first.
        counted.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
        let all = counted.len();
        let pack = |n: usize| {
            let mut ids: Vec<u32> = counted[..n]
                .iter()
                .flat_map(|(id, c, _)| std::iter::repeat_n(*id, usize::from(*c)))
                .collect();
            ids.sort_unstable();
            let (rice, bits) = packed(&ids);
            let checksum = vocabulary.facts().checksum;
            let count = ids.len();
            (Self { robot, seq, vocabulary: checksum, count: count as u16, rice, bits }, count)
        };
        let fits = |n: usize| {
            let (words, count) = pack(n);
            count <= MAX_WORDS && words.encode().len() <= MAX_WORDS_BYTES
        };
        let kept = if fits(all) { all } else { largest(all, fits) };
        (pack(kept).0, all - kept)
    }

    /// The bytes to send.
    pub fn encode(&self) -> Vec<u8> {
        seal(Kind::Words, &postcard::to_stdvec(self).unwrap_or_default())
    }

    /// Decodes the words. `from` is the sender according to the network, which must authenticate it.
    ///
    /// # Errors
    /// When the message is not valid; see [`Refused`].
    pub fn decode(from: RobotId, bytes: &[u8]) -> Result<Self, Refused> {
        if bytes.len() > MAX_WORDS_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let body = open(Kind::Words, bytes)?;
        let (words, rest) = postcard::take_from_bytes::<Self>(body).map_err(|_| Refused::Encoding)?;
        if !rest.is_empty() || usize::from(words.count) > MAX_WORDS {
            return Err(Refused::Encoding);
        }
        if words.robot != from {
            return Err(Refused::WrongSender { from, claimed: words.robot });
        }
        words.ids()?;
        Ok(words)
    }

    /// The bag of words, without the direct index (the features are not sent).
    ///
    /// # Errors
    /// When the words are of another vocabulary, or one of them is not in this one.
    pub fn bag(&self, vocabulary: &Vocabulary) -> Result<BagOfWords, Refused> {
        if self.vocabulary != vocabulary.facts().checksum {
            return Err(Refused::Inconsistent("its words are of another vocabulary"));
        }
        let ids = self.ids()?;
        let weighted: Vec<(WordId, f64)> = ids
            .chunk_by(|a, b| a == b)
            .map(|same| {
                let word = WordId(same[0]);
                (word, same.len() as f64 * f64::from(vocabulary.weight(word)))
            })
            .collect();
        let sum: f64 = weighted.iter().map(|(_, w)| w).sum();
        let words = weighted.into_iter().map(|(word, w)| (word, (w / sum) as f32)).collect();
        BagOfWords::from_parts(words, Vec::new()).map_err(|_| Refused::Inconsistent("a word has no weight"))
    }

    /// Word ids in rising order, each repeated as often as it was seen.
    fn ids(&self) -> Result<Vec<u32>, Refused> {
        let mut reader = BitReader { bytes: &self.bits, at: 0 };
        let mut last = 0u32;
        let mut ids = Vec::with_capacity(usize::from(self.count));
        for _ in 0..self.count {
            let step = reader.rice(u32::from(self.rice)).ok_or(Refused::Encoding)?;
            last = last.checked_add(step).ok_or(Refused::Encoding)?;
            ids.push(last);
        }
        Ok(ids)
    }
}

/// Words with counts and weights. A count is the weight divided by the inverse document frequency, as a multiple of the
/// smallest.
fn counts(bag: &BagOfWords, vocabulary: &Vocabulary) -> Vec<(u32, u16, f32)> {
    let ratio = |(word, weight): &(WordId, f32)| weight / vocabulary.weight(*word);
    let ratios: Vec<f32> = bag.words().iter().map(ratio).collect();
    let least = ratios.iter().copied().filter(|r| r.is_finite()).fold(f32::INFINITY, f32::min);
    let words = bag.words().iter().zip(&ratios).filter(|(_, r)| r.is_finite());
    words.map(|((word, w), r)| (word.0, (r / least).round().clamp(1.0, 255.0) as u16, *w)).collect()
}

/// The largest number below `n` for which `fits` is true, by bisection; it must be true for all smaller ones.
fn largest(n: usize, fits: impl Fn(usize) -> bool) -> usize {
    let (mut good, mut bad) = (0, n);
    while bad - good > 1 {
        let middle = (good + bad) / 2;
        if fits(middle) { good = middle } else { bad = middle }
    }
    good
}

/// The shortest Rice code of sorted numbers, and its parameter.
fn packed(ids: &[u32]) -> (u8, Vec<u8>) {
    let code = |rice: u8| {
        let mut writer = BitWriter::default();
        let mut last = 0;
        for id in ids {
            writer.rice(id - last, u32::from(rice));
            last = *id;
        }
        (rice, writer.bytes)
    };
    let bits = |rice: u8| -> u64 {
        let steps = ids.iter().scan(0, |last, id| Some(id - std::mem::replace(last, *id)));
        steps.map(|step| u64::from(step >> rice) + 1 + u64::from(rice)).sum()
    };
    code((0..32).min_by_key(|rice| bits(*rice)).unwrap_or(0))
}

#[derive(Default)]
struct BitWriter {
    bytes: Vec<u8>,
    used: u32,
}

impl BitWriter {
    fn bit(&mut self, bit: bool) {
        if self.used.is_multiple_of(8) {
            self.bytes.push(0);
        }
        if let Some(last) = self.bytes.last_mut() {
            *last |= u8::from(bit) << (self.used % 8);
        }
        self.used += 1;
    }

    /// The high part in unary (ones and a zero), the low bits unencoded.
    fn rice(&mut self, number: u32, low: u32) {
        (0..number >> low).for_each(|_| self.bit(true));
        self.bit(false);
        (0..low).for_each(|k| self.bit(number >> k & 1 == 1));
    }
}

struct BitReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl BitReader<'_> {
    fn bit(&mut self) -> Option<bool> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (self.at % 8) & 1 == 1;
        self.at += 1;
        Some(bit)
    }

    fn rice(&mut self, low: u32) -> Option<u32> {
        let mut high = 0u32;
        while self.bit()? {
            high += 1;
        }
        let mut number = high.checked_shl(low).filter(|n| low < 32 && n >> low == high)?;
        for k in 0..low {
            number |= u32::from(self.bit()?) << k;
        }
        Some(number)
    }
}
