//! The bytes of what is paged out: features and words of one key frame. Only this process reads them.

use cairn_sensor::Stamp;
use cairn_vision::Frame;
use cairn_vision::bow::{BagOfWords, WordId};

/// What can be paged out.
pub(crate) trait Record: Sized {
    /// Appends its bytes.
    fn encode(&self, to: &mut Vec<u8>);
    /// The value of these bytes; `None` where they are not all of its bytes.
    fn decode(bytes: &[u8]) -> Option<Self>;
    /// How many features it has.
    fn features(&self) -> usize;
    /// What stands in for a value that cannot be read: nothing is matched with it.
    fn placeholder(features: usize) -> Self;
}

impl Record for Frame {
    fn encode(&self, to: &mut Vec<u8>) {
        to.extend(self.stamp.0.to_le_bytes());
        // Without a lens, raw pixels are the rectified ones.
        let same = self.raw == self.px;
        to.push(u8::from(same));
        floats(to, &self.bounds());
        floats(to, self.px.as_flattened());
        floats(to, if same { &[] } else { self.raw.as_flattened() });
        [&self.angle, &self.right_x, &self.depth].into_iter().for_each(|column| floats(to, column));
        for bytes in [&self.octave[..], self.descriptors.as_flattened()] {
            length(to, bytes.len());
            to.extend(bytes);
        }
    }

    fn decode(bytes: &[u8]) -> Option<Self> {
        let mut from = Reader(bytes);
        let mut frame = Self::default();
        frame.stamp = Stamp(i64::from_le_bytes(from.array()?));
        let same = from.array::<1>()? == [1];
        let bounds = from.floats()?;
        frame.px = from.floats()?.as_chunks().0.to_vec();
        let raw = from.floats()?;
        frame.raw = if same { frame.px.clone() } else { raw.as_chunks().0.to_vec() };
        (frame.angle, frame.right_x, frame.depth) = (from.floats()?, from.floats()?, from.floats()?);
        frame.octave = from.bytes(1)?.to_vec();
        frame.descriptors = from.bytes(1)?.as_chunks().0.to_vec();
        if let Ok(bounds) = bounds.try_into() {
            frame.index_in(bounds);
        }
        from.0.is_empty().then_some(frame)
    }

    fn features(&self) -> usize {
        self.len()
    }

    fn placeholder(features: usize) -> Self {
        let mut frame = Self::default();
        frame.px = vec![[f32::NAN; 2]; features];
        frame.raw = frame.px.clone();
        for column in [&mut frame.angle, &mut frame.right_x, &mut frame.depth] {
            *column = vec![f32::NAN; features];
        }
        frame.octave = vec![0; features];
        frame.descriptors = vec![[0; 32]; features];
        frame
    }
}

impl Record for BagOfWords {
    fn encode(&self, to: &mut Vec<u8>) {
        length(to, self.words().len());
        self.words().iter().for_each(|(word, _)| to.extend(word.0.to_le_bytes()));
        self.words().iter().for_each(|(_, weight)| to.extend(weight.to_bits().to_le_bytes()));
        length(to, self.nodes().len());
        self.nodes().iter().for_each(|(node, _)| to.extend(node.to_le_bytes()));
        self.nodes().iter().for_each(|(_, feature)| to.extend(feature.to_le_bytes()));
    }

    fn decode(bytes: &[u8]) -> Option<Self> {
        let mut from = Reader(bytes);
        let n = from.length()?;
        let words = from.column(n)?.map(|v| WordId(u32::from_le_bytes(v)));
        let words = words.zip(from.column(n)?.map(f32::from_le_bytes)).collect();
        let n = from.length()?;
        let nodes = from.column(n)?.map(u32::from_le_bytes);
        let nodes = nodes.zip(from.column(n)?.map(u16::from_le_bytes)).collect();
        from.0.is_empty().then(|| Self::from_parts(words, nodes).ok())?
    }

    fn features(&self) -> usize {
        0
    }

    fn placeholder(_: usize) -> Self {
        Self::default()
    }
}

fn length(to: &mut Vec<u8>, n: usize) {
    to.extend((n as u32).to_le_bytes());
}

fn floats(to: &mut Vec<u8>, values: &[f32]) {
    length(to, values.len());
    to.extend(values.iter().flat_map(|v| v.to_bits().to_le_bytes()));
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (here, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(here)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn length(&mut self) -> Option<usize> {
        Some(u32::from_le_bytes(self.array()?) as usize)
    }

    /// A length, and so many values of some bytes each.
    fn bytes(&mut self, each: usize) -> Option<&'a [u8]> {
        let n = self.length()?;
        self.take(n.checked_mul(each)?)
    }

    fn column<const N: usize>(&mut self, n: usize) -> Option<impl Iterator<Item = [u8; N]> + use<'a, N>> {
        Some(self.take(n.checked_mul(N)?)?.as_chunks::<N>().0.iter().copied())
    }

    fn floats(&mut self) -> Option<Vec<f32>> {
        Some(self.bytes(4)?.as_chunks::<4>().0.iter().map(|v| f32::from_le_bytes(*v)).collect())
    }
}
