//! Depth that comes later or earlier than the picture of its time: depths at features are then those of what was there before.
//!
//! In: pictures and depth images, made small. By how much each has moved since the one before is found from its gradients (Lucas and
//! Kanade, "An iterative image registration technique", 1981, for the image as a whole). Both series are of one motion: the lag at which
//! they correlate best is by how many images depth is late. Neither size nor place of the depth in the picture matters to that.

use super::watch::Watch;
use cairn_sensor::{DepthImage, FramePacket, GrayImage, Stamp};
use nalgebra::{Matrix2, Vector2};
use std::collections::VecDeque;

/// Columns of the small images, and pixels along an edge of a block that are looked at: all of them would be a fourth of a run.
const COLUMNS: usize = 40;
const SAMPLES: usize = 4;
/// Images that one look correlates, and new ones before the next.
const WINDOW: usize = 60;
const NEW: usize = 30;
/// Lags that are looked at, in images.
const MOST_LAG: isize = 8;
/// A look that says a lag: how well both correlate there, and how much worse without it. 7-Scenes' kitchen as it is: 0.64 to 0.98 at
/// no lag; one to six images late: 0.64 to 0.98 at that lag, at no lag 0.1 to 0.6 less, but in each fourth look. Who moves evenly
/// tells no lag.
const LEAST: f64 = 0.6;
const LEAST_GAIN: f64 = 0.1;
/// Looks that say the same lag to one image, before it is told, and the last ones of which they are.
const LOOKS: usize = 3;
const LAST: usize = 10;
/// A motion counts as so many times the middle one at most: where something comes near, all of the image seems to jump.
const MOST_MOTION: f64 = 4.0;

/// An image made small: means of blocks, none where less than half of what was looked at is known.
#[derive(Clone, Debug, Default)]
struct Small {
    width: usize,
    blocks: Vec<Option<f64>>,
}

/// The motions of picture and depth since the images before, in blocks.
type Motions = [Vector2<f64>; 2];

/// Whether depth is of the time of its picture.
#[derive(Clone, Debug, Default)]
pub(super) struct DelayWatch {
    last: Option<[Small; 2]>,
    motions: VecDeque<(Stamp, Motions)>,
    new: usize,
    /// What the last looks said.
    lags: VecDeque<Option<isize>>,
    is_reported: bool,
}

impl Watch for DelayWatch {
    fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let both = packet.depth.as_ref().zip(packet.images.first());
        let (depth, picture) = both.filter(|_| !self.is_reported)?;
        let now = [of_picture(picture), of_depth(depth)];
        let before = self.last.replace(now.clone())?;
        let motion = |k: usize| motion(&before[k], &now[k]).unwrap_or_default();
        self.motions.push_back((packet.stamp, [motion(0), motion(1)]));
        self.new += 1;
        if self.motions.len() < WINDOW || self.new < NEW {
            return None;
        }
        self.new = 0;
        self.motions.drain(..self.motions.len() - WINDOW);
        let motions: Vec<Motions> = self.motions.iter().map(|(_, motions)| *motions).collect();
        let lag = lag(motions);
        self.lags.push_back(lag);
        self.lags.drain(..self.lags.len().saturating_sub(LAST));
        let is_same = |other: &&Option<isize>| other.zip(lag).is_some_and(|(a, b)| a.abs_diff(b) <= 1);
        self.is_reported = self.lags.iter().filter(is_same).count() >= LOOKS;
        lag.filter(|_| self.is_reported).map(|lag| self.words(lag))
    }
}

impl DelayWatch {
    fn words(&self, lag: isize) -> String {
        let seconds = match (self.motions.front(), self.motions.back()) {
            (Some((first, _)), Some((last, _))) => (*last - *first) / (WINDOW - 1) as f64,
            _ => 0.0,
        };
        let (images, order) = (lag.unsigned_abs(), if lag > 0 { "later" } else { "earlier" });
        format!(
            "depth moves {images} image{} ({:.2} s) {order} than the picture: it is not of one time with it, and depths at features are \
             those of other points while the camera turns; correct its stamps, or do not use depth",
            if images == 1 { "" } else { "s" },
            images as f64 * seconds
        )
    }
}

/// The lag of depth that explains its motions clearly better than none.
fn lag(mut motions: Vec<Motions>) -> Option<isize> {
    for k in [0, 1] {
        let mut sizes: Vec<f64> = motions.iter().map(|m| m[k].norm()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        let most = MOST_MOTION * sizes[sizes.len() / 2];
        motions.iter_mut().for_each(|m| m[k] = m[k].cap_magnitude(most));
    }
    let at = |lag: isize| correlation(&motions, lag);
    let best = (-MOST_LAG..=MOST_LAG).max_by(|a, b| at(*a).total_cmp(&at(*b)))?;
    (at(best) > LEAST && at(best) > at(0) + LEAST_GAIN).then_some(best)
}

/// How well the depth's motions correlate with those of the pictures so many images before.
fn correlation(motions: &[Motions], lag: isize) -> f64 {
    let shift = lag.unsigned_abs();
    let (early, late) = (&motions[..motions.len() - shift], &motions[shift..]);
    let (pictures, depths) = if lag < 0 { (late, early) } else { (early, late) };
    let centred = |all: &[Motions], k: usize| {
        let mean = all.iter().map(|m| m[k]).sum::<Vector2<f64>>() / all.len() as f64;
        all.iter().map(|m| m[k] - mean).collect::<Vec<_>>()
    };
    let (a, b) = (centred(pictures, 0), centred(depths, 1));
    let dot = |a: &[Vector2<f64>], b: &[Vector2<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt().max(f64::MIN_POSITIVE)
}

fn of_picture(image: &GrayImage) -> Small {
    small([image.width(), image.height()], |y| image.row(y).iter().map(|v| Some(f64::from(*v))))
}

/// Inverse depths: what is near moves as far as it is bright.
fn of_depth(image: &DepthImage) -> Small {
    let inverse = |units: &u16| (!matches!(*units, 0 | u16::MAX)).then(|| 1e3 / f64::from(*units));
    small([image.width(), image.height()], |y| image.row(y).iter().map(inverse))
}

fn small<R: Iterator<Item = Option<f64>>>([width, height]: [usize; 2], row: impl Fn(usize) -> R) -> Small {
    let side = width.div_ceil(COLUMNS).max(1);
    let apart = (side / SAMPLES).max(1);
    let (width, height) = (width / side, height / side);
    let mut sums = vec![(0.0, 0, 0); width * height];
    for y in (0..height * side).step_by(apart) {
        for (x, value) in row(y).take(width * side).enumerate().step_by(apart) {
            let (sum, known, all) = &mut sums[y / side * width + x / side];
            *sum += value.unwrap_or(0.0);
            *known += usize::from(value.is_some());
            *all += 1;
        }
    }
    let mean = |(sum, known, all): (f64, usize, usize)| (2 * known >= all).then(|| sum / known as f64);
    Small { width, blocks: sums.into_iter().map(mean).collect() }
}

/// By how much an image has moved since another, in blocks: one step from their gradients. `None` where they do not say.
fn motion(before: &Small, now: &Small) -> Option<Vector2<f64>> {
    let width = now.width;
    if before.width != width || before.blocks.len() != now.blocks.len() {
        return None;
    }
    let middle = |at: usize| Some(0.5 * (before.blocks[at]? + now.blocks[at]?));
    let (mut left, mut right) = (Matrix2::zeros(), Vector2::zeros());
    let inside = |at: &usize| (1..width - 1).contains(&(at % width));
    for at in (width..now.blocks.len().saturating_sub(width)).filter(inside) {
        let both = before.blocks[at].zip(now.blocks[at]);
        let slopes = [1, width].map(|step| Some(0.5 * (middle(at + step)? - middle(at - step)?)));
        if let (Some((before, now)), [Some(x), Some(y)]) = (both, slopes) {
            let slope = Vector2::new(x, y);
            left += slope * slope.transpose();
            right += slope * (before - now);
        }
    }
    left.cholesky().map(|factor| factor.solve(&right)).filter(|motion| motion.iter().all(|v| v.is_finite()))
}
