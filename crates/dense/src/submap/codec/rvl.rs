//! Reads the packing of older saved maps: Wilson, "Fast lossless depth image compression" (ISS 2017). Runs without depth
//! alternate with runs of differences, as numbers of a variable count of three-bit groups.

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    /// Each byte holds two groups of three bits, each with a flag whether more follow.
    fn number(&mut self) -> Option<u32> {
        let (mut v, mut shift) = (0u32, 0);
        loop {
            let byte = *self.bytes.get(self.at / 2)?;
            let group = if self.at.is_multiple_of(2) { byte & 15 } else { byte >> 4 };
            self.at += 1;
            // Lengths and differences fit 30 bits.
            if shift > 27 {
                return None;
            }
            v |= u32::from(group & 7) << shift;
            shift += 3;
            if group & 8 == 0 {
                return Some(v);
            }
        }
    }
}

/// The pixels of an image of `count` pixels; `None` where the bytes are not one.
pub fn unpack(bytes: &[u8], count: usize) -> Option<Vec<u16>> {
    let mut data = Vec::with_capacity(count.min(1 << 26));
    let mut from = Reader { bytes, at: 0 };
    let mut before = 0i32;
    while data.len() < count {
        let empty = from.number()? as usize;
        let full = from.number()? as usize;
        if empty + full == 0 || empty + full > count - data.len() {
            return None;
        }
        data.resize(data.len() + empty, 0);
        for _ in 0..full {
            let v = from.number()?;
            before = before.wrapping_add((v >> 1) as i32 ^ -((v & 1) as i32));
            data.push(u16::try_from(before).ok()?);
        }
    }
    Some(data)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use proptest::prelude::*;

    fn number(groups: &mut Vec<u8>, mut v: u32) {
        loop {
            groups.push((v & 7) as u8 | if v > 7 { 8 } else { 0 });
            v >>= 3;
            if v == 0 {
                return;
            }
        }
    }

    /// The packing as it was written.
    pub fn pack(data: &[u16]) -> Vec<u8> {
        let mut groups = Vec::new();
        let (mut at, mut before) = (0, 0i32);
        while at < data.len() {
            let empty = data[at..].iter().take_while(|&&v| v == 0).count();
            number(&mut groups, empty as u32);
            at += empty;
            let full = data[at..].iter().take_while(|&&v| v != 0).count();
            number(&mut groups, full as u32);
            for &v in &data[at..at + full] {
                let step = i32::from(v) - before;
                number(&mut groups, ((step << 1) ^ (step >> 31)) as u32);
                before = i32::from(v);
            }
            at += full;
        }
        groups.chunks(2).map(|g| g[0] | g.get(1).unwrap_or(&0) << 4).collect()
    }

    proptest! {
        #[test]
        fn older_images_come_back(
            data in proptest::collection::vec(prop_oneof![Just(0u16), 500u16..520, any::<u16>()], 1..300)
        ) {
            prop_assert_eq!(unpack(&pack(&data), data.len()), Some(data));
        }
    }
}
