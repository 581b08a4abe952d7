//! A priority queue of cells with integer keys: a ring of buckets of equal width, with one bit for each bucket that is
//! not empty.
//!
//! Dial's queue (1969). Correct as long as no key is more than one whole ring above the least key in the queue.

/// A ring of buckets.
pub(crate) struct Buckets {
    buckets: Vec<Vec<u32>>,
    filled: Vec<u64>,
    shift: u32,
    mask: usize,
    /// Absolute (unwrapped) number of the bucket that is popped from.
    current: u64,
    len: usize,
}

impl Buckets {
    /// Buckets of `1 << shift` keys each, enough for keys up to `span` above the least.
    pub(crate) fn new(shift: u32, span: u64) -> Self {
        let count = ((span >> shift) as usize + 2).next_power_of_two().max(64);
        let buckets = std::iter::repeat_with(Vec::new).take(count).collect();
        Self { buckets, filled: vec![0; count / 64], shift, mask: count - 1, current: 0, len: 0 }
    }

    /// Empties the queue; no key may be below `least` from now on.
    pub(crate) fn clear(&mut self, least: u64) {
        self.buckets.iter_mut().for_each(Vec::clear);
        self.filled.fill(0);
        self.current = least >> self.shift;
        self.len = 0;
    }

    /// Adds a cell; a key below the current bucket goes into the current one.
    #[inline(always)]
    pub(crate) fn push(&mut self, key: u64, cell: u32) {
        let place = (key >> self.shift).max(self.current) as usize & self.mask;
        self.buckets[place].push(cell);
        self.filled[place / 64] |= 1 << (place % 64);
        self.len += 1;
    }

    /// Takes the cell last put into the lowest bucket; also returns the least key of that bucket.
    #[inline(always)]
    pub(crate) fn pop(&mut self) -> Option<(u64, u32)> {
        loop {
            let place = self.current as usize & self.mask;
            if let Some(cell) = self.buckets[place].pop() {
                self.len -= 1;
                return Some((self.current << self.shift, cell));
            }
            self.filled[place / 64] &= !(1 << (place % 64));
            if self.len == 0 {
                return None;
            }
            self.advance();
        }
    }

    /// Moves on to the next bucket that is not empty; there must be one.
    fn advance(&mut self) {
        loop {
            let place = self.current as usize & self.mask;
            let rest = self.filled[place / 64] >> (place % 64);
            if rest != 0 {
                self.current += u64::from(rest.trailing_zeros());
                return;
            }
            self.current += 64 - place as u64 % 64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comes_out_by_bucket() {
        let mut queue = Buckets::new(3, 1000);
        let mut random = cairn_random::Random::new(1);
        queue.clear(500);
        let (mut least, mut held) = (500u64, Vec::new());
        for round in 0..20_000u32 {
            if random.chance(0.5) || held.is_empty() {
                let key = least + random.below(1000) as u64;
                queue.push(key, round);
                held.push((key, round));
            } else {
                let (from, cell) = queue.pop().unwrap();
                let place = held.iter().position(|h| h.1 == cell).unwrap();
                let (key, _) = held.swap_remove(place);
                assert!(held.iter().all(|h| h.0 >> 3 >= from >> 3), "bucket {from} is not the least");
                assert_eq!(key >> 3, from >> 3);
                least = from;
            }
        }
        while queue.pop().is_some() {
            held.pop();
        }
        assert!(held.is_empty());
    }
}
