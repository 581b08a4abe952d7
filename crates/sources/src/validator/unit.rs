//! Depth that changes its unit between two images: all depths are many times what they were, and the scene is the same.

use super::watch::Watch;
use cairn_sensor::{DepthImage, FramePacket, Stamp};
use std::sync::Arc;

/// Every so many pixels along both axes are compared.
const STEP: usize = 8;
/// Images that are further apart are of two scenes, seconds.
const MOST_APART_S: f64 = 0.5;
/// The part of the compared pixels that has to have depth in both.
const LEAST_PART: f64 = 0.1;
/// Factors nearer to one may be those of motion; no image of 7-Scenes' kitchen is doubted (300 of a Kinect in the hand).
const LEAST_FACTOR: f64 = 1.25;
/// How far the depths of an image are spread at least, in logarithms between their quartiles: before a wall anything that covers the
/// camera looks like another unit.
const LEAST_SPREAD: f64 = 0.1;
/// How far the factors of the pixels may be spread, as a part of that: a hand before the camera changes each pixel by another one.
const MOST_SPREAD: f64 = 0.4;

/// Whether depth keeps its unit.
#[derive(Clone, Debug, Default)]
pub(super) struct UnitWatch {
    first: Option<Stamp>,
    last: Option<(Stamp, Arc<DepthImage>)>,
    is_reported: bool,
}

impl Watch for UnitWatch {
    fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let depth = packet.depth.as_ref().filter(|_| !self.is_reported)?;
        let first = *self.first.get_or_insert(packet.stamp);
        let (before, last) = self.last.replace((packet.stamp, depth.clone()))?;
        let factor = factor(&last, depth).filter(|_| packet.stamp - before < MOST_APART_S)?;
        self.is_reported = true;
        Some(format!(
            "from {:.2} s on depth is {factor:.3} times what it was, everywhere in the image: it has changed its unit, and lengths \
             are no longer the metres of before",
            packet.stamp - first
        ))
    }
}

/// By what the depths of an image are another unit's than those of the image before; `None` where they are of one unit.
fn factor(before: &DepthImage, now: &DepthImage) -> Option<f64> {
    if (before.width(), before.height()) != (now.width(), now.height()) {
        return None;
    }
    let (mut factors, mut depths, mut all) = (Vec::new(), Vec::new(), 0);
    for y in (0..now.height()).step_by(STEP) {
        for (a, b) in before.row(y).iter().zip(now.row(y)).step_by(STEP) {
            all += 1;
            if [a, b].iter().all(|units| !matches!(**units, 0 | u16::MAX)) {
                factors.push((f64::from(*b) / f64::from(*a)).ln());
                depths.push(f64::from(*a.max(b)).ln());
            }
        }
    }
    if (factors.len() as f64) < LEAST_PART * f64::from(all) {
        return None;
    }
    let (factor, spread) = middle_and_spread(&mut factors)?;
    let (_, of_scene) = middle_and_spread(&mut depths)?;
    let is_of_unit =
        factor.abs() > LEAST_FACTOR.ln() && of_scene > LEAST_SPREAD && spread < MOST_SPREAD * of_scene;
    is_of_unit.then(|| factor.exp())
}

/// The median, and the distance between the quartiles.
fn middle_and_spread(values: &mut [f64]) -> Option<(f64, f64)> {
    values.sort_unstable_by(f64::total_cmp);
    let at = |part: usize| values.get(part * values.len() / 4).copied();
    Some((at(2)?, at(3)? - at(1)?))
}
