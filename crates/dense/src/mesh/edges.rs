//! The edges of a block's cells that the surface crosses: one vertex each.

use super::rows::{List, MOST, PLACES};

/// Edges that the surface crosses: those along x first, then y, then z.
#[derive(Clone)]
pub struct Edges {
    /// Where each is in `numbers`; anything behind the last.
    pub places: Box<List>,
    /// Where the surface crosses each, from 0 to 1 between the two corners.
    pub parts: Box<[f32; MOST]>,
    /// Room for the differences of the distances at both ends, with AVX2 and AVX-512.
    #[cfg_attr(not(target_arch = "x86_64"), expect(dead_code))]
    pub jumps: Box<[f32; MOST]>,
    /// How many there are.
    pub count: usize,
    /// Which of them is at each place; anything where none is.
    pub numbers: Box<[u16; PLACES]>,
}

impl Default for Edges {
    fn default() -> Self {
        Self {
            places: Box::new([0; MOST]),
            parts: Box::new([0.0; MOST]),
            jumps: Box::new([0.0; MOST]),
            count: 0,
            numbers: Box::new([0; PLACES]),
        }
    }
}

impl Edges {
    /// Which of them is at a place.
    #[inline(always)]
    pub fn number(&self, place: usize) -> u16 {
        self.numbers[place % PLACES]
    }

    /// Each by its place, with the position on it.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        let (places, parts) = (&self.places[..self.count], &self.parts[..self.count]);
        places.iter().zip(parts).map(|(&place, &part)| (place as usize, part))
    }
}
