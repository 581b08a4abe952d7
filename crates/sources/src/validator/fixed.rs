//! Parts of the picture that stay the same while the rest moves: a logo, a time of day that is written in, the hood of a car. Features
//! there say that the camera rests.
//!
//! In: the pictures of the first camera, twice a second. Blocks are compared with what they showed at first, without their mean, so that
//! exposure does not matter.

use super::watch::Watch;
use cairn_sensor::{FramePacket, GrayImage, Stamp};
use std::sync::Arc;

/// Side of a block in pixels.
const SIDE: usize = 16;
/// Seconds between two looks, and looks at one first picture: four seconds.
const APART_S: f64 = 0.5;
const LOOKS: usize = 8;
/// Standard deviation of a block that shows something, grey levels: well above the noise of a sensor, by which two pictures differ.
const LEAST_CONTRAST: f64 = 15.0;
/// A block is the same while it differs by less, and another from more on, in standard deviations of what it showed at first.
const SAME: f64 = 0.3;
const OTHER: f64 = 0.6;
/// The part of the blocks that show something which has to be other ones in the middle of the looks, and the part that has to stay the
/// same for a doubt.
const MOVING: f64 = 0.5;
const FIXED: f64 = 0.02;

/// Whether a part of the picture never changes.
#[derive(Clone, Debug, Default)]
pub(super) struct FixedWatch {
    name: String,
    first: Option<(Stamp, Arc<GrayImage>)>,
    last: Option<Stamp>,
    /// For each block that shows something: where it is, and its mean and contrast at first; whether it is the same so far.
    blocks: Vec<Block>,
    looks: usize,
    is_reported: bool,
}

#[derive(Clone, Copy, Debug)]
struct Block {
    at: [usize; 2],
    mean: f64,
    contrast: f64,
    is_same: bool,
    /// Looks at which it showed something else.
    others: usize,
}

impl FixedWatch {
    pub fn new(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }
}

impl Watch for FixedWatch {
    fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let is_due = self.last.is_none_or(|last| packet.stamp - last >= APART_S);
        let image = packet.images.first().filter(|_| is_due && !self.is_reported)?;
        self.last = Some(packet.stamp);
        let first = self.first.as_ref().filter(|(_, first)| {
            self.looks < LOOKS && (first.width(), first.height()) == (image.width(), image.height())
        });
        let Some((since, first)) = first else {
            (self.first, self.looks) = (Some((packet.stamp, image.clone())), 0);
            self.blocks = blocks(image);
            return None;
        };
        self.looks += 1;
        for block in &mut self.blocks {
            let differs = difference(first, image, block);
            block.is_same &= differs < SAME;
            block.others += usize::from(differs > OTHER);
        }
        let part = |of: fn(&Block) -> bool| {
            self.blocks.iter().filter(|b| of(b)).count() as f64 / self.blocks.len().max(1) as f64
        };
        let (fixed, moving) = (part(|b| b.is_same), part(|b| 2 * b.others > LOOKS));
        if self.looks < LOOKS || fixed < FIXED || moving < MOVING {
            return None;
        }
        self.is_reported = true;
        let all: Vec<[usize; 2]> = self.blocks.iter().filter(|b| b.is_same).map(|b| b.at).collect();
        let middle = [0, 1].map(|axis| all.iter().map(|at| at[axis]).sum::<usize>() / all.len() + SIDE / 2);
        Some(format!(
            "{} parts of {SIDE}x{SIDE} pixels of the picture of {}, around {} {}, stay the same for {:.1} s while the rest moves: what is \
             fixed there, as a logo or a part of the vehicle, makes poses rest; cut it off or cover it",
            all.len(),
            self.name,
            middle[0],
            middle[1],
            packet.stamp - *since
        ))
    }
}

/// The blocks that show something.
fn blocks(image: &GrayImage) -> Vec<Block> {
    let grid = |length: usize| (0..length / SIDE).map(|k| k * SIDE);
    let all = grid(image.height()).flat_map(|y| grid(image.width()).map(move |x| [x, y]));
    let measured = all.map(|at| {
        let mean = mean(image, at);
        let variance = pixels(image, at).map(|v| (v - mean).powi(2)).sum::<f64>() / (SIDE * SIDE) as f64;
        Block { at, mean, contrast: variance.sqrt(), is_same: true, others: 0 }
    });
    measured.filter(|block| block.contrast > LEAST_CONTRAST).collect()
}

fn pixels(image: &GrayImage, [x, y]: [usize; 2]) -> impl Iterator<Item = f64> {
    (y..y + SIDE).flat_map(move |row| image.row(row)[x..x + SIDE].iter().map(|v| f64::from(*v)))
}

fn mean(image: &GrayImage, at: [usize; 2]) -> f64 {
    pixels(image, at).sum::<f64>() / (SIDE * SIDE) as f64
}

/// By how much a block differs from what it showed at first, in standard deviations of that.
fn difference(first: &GrayImage, now: &GrayImage, block: &Block) -> f64 {
    let offset = mean(now, block.at) - block.mean;
    let pairs = pixels(first, block.at).zip(pixels(now, block.at));
    let squares: f64 = pairs.map(|(a, b)| (b - a - offset).powi(2)).sum();
    (squares / (SIDE * SIDE) as f64).sqrt() / block.contrast
}
