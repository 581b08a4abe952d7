//! Whether a depth image that is said to be registered to its picture shows what the picture shows, pixel by pixel.
//!
//! Where a near object ends, depth jumps and the picture has an edge, mostly. The steps of depth are laid over the picture at other
//! sizes and places: where its edges are stronger there than in place, the two are not registered, and depths looked up at features are
//! those of other points. Nothing is asked of poses, so that this is known from the first images on.

use cairn_sensor::{DepthImage, FramePacket, GrayImage, Rig, Stamp};

/// Depth steps of one image that are laid over the picture, and how many it needs.
const MOST_STEPS: usize = 600;
const LEAST_STEPS: usize = 150;
/// A step: what lies behind is farther by this share, two pixels on.
const JUMP: f64 = 0.1;
const APART: usize = 2;
/// Grey levels between two pixels left and right, beyond which an edge is no better.
const STRONG: u16 = 40;
/// Sizes that are tried: 0.84 to 1.16 of the depth's, in steps of 0.02.
const SIZES: usize = 17;
const SIZE_STEP: f64 = 0.02;
/// Places that are tried at each size, pixels: 24 to each side, 8 up and down, in steps of 4.
const COLUMNS: usize = 13;
const ROWS: usize = 5;
const PLACE_STEP: f64 = 4.0;
/// Seconds between two looks: eight take little more than a second.
const APART_S: f64 = 0.15;
/// Looks that are needed, and by how much edges have to be stronger elsewhere than in place, in the mean of the looks. 7-Scenes'
/// kitchen, whose picture is 0.90 times as large: 1.32 to 2.19 for eight images within 1.2 s, from nine starts. Five simulated worlds,
/// two seeds each: 1.00.
const LEAST_LOOKS: usize = 8;
const LEAST_GAIN: f64 = 1.25;
/// By how much the strongest edges stand out from the mean of all places.
const LEAST_PEAK: f64 = 1.3;

/// How a picture lies against its depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Misregistration {
    /// By how much larger the picture shows things: its focal length over that of the depth.
    pub size: f64,
    /// How far things are moved in the picture besides, pixels.
    pub shift: [f64; 2],
}

impl std::fmt::Display for Misregistration {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.shift;
        write!(
            f,
            "the picture shows things {:.2} times as large as the depth image does, {x:.0} {y:.0} pixels aside",
            self.size
        )
    }
}

/// Compares depth images with their pictures.
#[derive(Clone, Debug)]
pub struct RegistrationCheck {
    /// Strength of the edges at each size and place, against the mean of its image; the sum of all looks.
    strengths: Vec<f64>,
    looks: usize,
    last: Option<Stamp>,
}

impl Default for RegistrationCheck {
    fn default() -> Self {
        Self { strengths: vec![0.0; SIZES * COLUMNS * ROWS], looks: 0, last: None }
    }
}

/// Where depth jumps: place in the depth image from its middle, in widths of it, and whether it jumps along rows.
struct Step {
    at: [f64; 2],
    along_row: bool,
}

impl RegistrationCheck {
    /// For the depth sensor of a rig; `None` where it is not said to be registered.
    pub fn of(rig: &Rig) -> Option<Self> {
        rig.depth.as_ref().filter(|depth| depth.registered).map(|_| Self::default())
    }

    /// Takes the next packet, and looks at it where the last look is long enough ago. How the picture lies against the depth, once, with
    /// the packet that makes it certain.
    pub fn packet(&mut self, packet: &FramePacket) -> Option<Misregistration> {
        let is_due = self.last.is_none_or(|last| packet.stamp - last >= APART_S);
        let (depth, picture) = packet.depth.as_ref().zip(packet.images.first())?;
        if self.is_sure() || !is_due {
            return None;
        }
        self.last = Some(packet.stamp);
        self.look(depth, picture);
        self.found()
    }

    fn look(&mut self, depth: &DepthImage, picture: &GrayImage) {
        let steps = steps(depth);
        if steps.len() < LEAST_STEPS {
            return;
        }
        let edges = Edges::of(picture);
        let all = places().map(|place| edges.strength(&steps, &place)).collect::<Vec<f64>>();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        if mean > 0.0 {
            self.strengths.iter_mut().zip(all).for_each(|(sum, strength)| *sum += strength / mean);
            self.looks += 1;
        }
    }

    /// Whether enough was seen to judge.
    fn is_sure(&self) -> bool {
        self.looks >= LEAST_LOOKS
    }

    /// How the picture lies against the depth, where that is certainly not pixel by pixel.
    fn found(&self) -> Option<Misregistration> {
        let all = || places().zip(&self.strengths);
        let (best, strongest) = all().max_by(|a, b| a.1.total_cmp(b.1))?;
        let in_place = all().filter(|(place, _)| is_in_place(place)).map(|(_, s)| *s).fold(0.0, f64::max);
        let stands_out = *strongest > LEAST_PEAK * self.looks as f64;
        (self.is_sure() && stands_out && *strongest > LEAST_GAIN * in_place).then_some(best)
    }
}

/// All sizes and places.
fn places() -> impl Iterator<Item = Misregistration> {
    let around = |k: usize, count: usize, step: f64| (k as f64 - (count / 2) as f64) * step;
    (0..SIZES * COLUMNS * ROWS).map(move |k| Misregistration {
        size: 1.0 + around(k / (COLUMNS * ROWS), SIZES, SIZE_STEP),
        shift: [around(k / ROWS % COLUMNS, COLUMNS, PLACE_STEP), around(k % ROWS, ROWS, PLACE_STEP)],
    })
}

/// In place, but for the grid and the pixels by which an edge is off.
fn is_in_place(place: &Misregistration) -> bool {
    (place.size - 1.0).abs() < 1.5 * SIZE_STEP && place.shift.iter().all(|px| px.abs() < 1.5 * PLACE_STEP)
}

/// Where something near ends before something farther.
fn steps(depth: &DepthImage) -> Vec<Step> {
    let (width, height) = (depth.width(), depth.height());
    let middle = [width as f64 / 2.0 - 0.5, height as f64 / 2.0 - 0.5];
    let is_step =
        |near: u16, far: u16| far != u16::MAX && near != 0 && f64::from(far) > f64::from(near) * (1.0 + JUMP);
    let mut steps = Vec::new();
    for y in APART..height.saturating_sub(APART) {
        for x in APART..width.saturating_sub(APART) {
            let near = depth.at(x, y);
            let ends = [
                (depth.at(x + APART, y), [0.5, 0.0]),
                (depth.at(x - APART, y), [-0.5, 0.0]),
                (depth.at(x, y + APART), [0.0, 0.5]),
                (depth.at(x, y - APART), [0.0, -0.5]),
            ];
            for (_, [dx, dy]) in ends.into_iter().filter(|(far, _)| is_step(near, *far)) {
                let at = [x as f64 + dx - middle[0], y as f64 + dy - middle[1]];
                steps.push(Step { at: at.map(|px| px / width as f64), along_row: dy == 0.0 });
            }
        }
    }
    // Of all parts of the image, as they are in its order.
    let every = steps.len().div_ceil(MOST_STEPS).max(1);
    steps.into_iter().step_by(every).collect()
}

/// How strong edges are at each pixel of a picture, across rows and across columns.
struct Edges {
    width: usize,
    height: usize,
    strengths: Vec<[u16; 2]>,
}

impl Edges {
    fn of(picture: &GrayImage) -> Self {
        let (width, height) = (picture.width(), picture.height());
        let mut strengths = vec![[0; 2]; width * height];
        for y in APART..height.saturating_sub(APART) {
            for x in APART..width.saturating_sub(APART) {
                let three = |x: usize, y: usize, dx: usize, dy: usize| -> u16 {
                    let [a, b, c] =
                        [picture.at(x - dx, y - dy), picture.at(x, y), picture.at(x + dx, y + dy)];
                    u16::from(a) + u16::from(b) + u16::from(c)
                };
                let along = three(x + APART, y, 0, 1).abs_diff(three(x - APART, y, 0, 1)) / 3;
                let down = three(x, y + APART, 1, 0).abs_diff(three(x, y - APART, 1, 0)) / 3;
                strengths[y * width + x] = [along.min(STRONG), down.min(STRONG)];
            }
        }
        Self { width, height, strengths }
    }

    /// Mean strength where the steps come to lie; 0 where too few come to lie in the picture.
    fn strength(&self, steps: &[Step], place: &Misregistration) -> f64 {
        let middle = [self.width as f64 / 2.0 - 0.5, self.height as f64 / 2.0 - 0.5];
        let scale = self.width as f64 * place.size;
        let (mut sum, mut count) = (0, 0);
        for step in steps {
            let [x, y] = [0, 1].map(|k| (step.at[k] * scale + middle[k] + place.shift[k]).round());
            if x < 0.0 || y < 0.0 || x >= self.width as f64 || y >= self.height as f64 {
                continue;
            }
            let at = self.strengths[y as usize * self.width + x as usize];
            sum += u32::from(at[usize::from(!step.along_row)]);
            count += 1;
        }
        if 2 * count < steps.len() { 0.0 } else { f64::from(sum) / count as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Boxes before a wall, other ones in each look; the picture is `size` times as large, moved by `shift`.
    fn looks(count: u32, size: f64, shift: [f64; 2]) -> RegistrationCheck {
        let mut check = RegistrationCheck::default();
        for look in 0..count {
            let boxes: Vec<[f64; 4]> = (0..12)
                .map(|k| {
                    let at = |n: u32| f64::from((look * 131 + k * 71 + n * 37) % 97) / 97.0;
                    [at(0) * 280.0, at(1) * 200.0, 20.0 + 30.0 * at(2), 20.0 + 30.0 * at(3)]
                })
                .collect();
            let hit = |x: f64, y: f64| {
                boxes.iter().rposition(|[u, v, w, h]| (*u..u + w).contains(&x) && (*v..v + h).contains(&y))
            };
            let mut depth = DepthImage::new(320, 240);
            let mut picture = GrayImage::new(320, 240);
            for y in 0..240 {
                for x in 0..320 {
                    let at = y * 320 + x;
                    depth.data_mut()[at] = hit(x as f64, y as f64).map_or(4000, |k| 1500 + 100 * k as u16);
                    let from =
                        |px: usize, middle: f64, moved: f64| (px as f64 - middle - moved) / size + middle;
                    let seen = hit(from(x, 159.5, shift[0]), from(y, 119.5, shift[1]));
                    picture.data_mut()[at] = seen.map_or(40, |k| 90 + 12 * k as u8);
                }
            }
            check.look(&depth, &picture);
        }
        check
    }

    #[test]
    fn picture_of_another_size_or_place_is_found_and_one_in_place_is_not() {
        assert_eq!(looks(8, 1.0, [0.0, 0.0]).found(), None);
        assert_eq!(looks(8, 1.0, [2.0, -1.0]).found(), None, "edges are off by a pixel or two");
        let larger = looks(8, 1.1, [-8.0, 4.0]);
        assert_eq!(larger.found().map(|m| ((m.size * 100.0).round(), m.shift)), Some((110.0, [-8.0, 4.0])));
        let moved = looks(8, 1.0, [16.0, 0.0]).found().expect("16 pixels");
        assert!((moved.size - 1.0).abs() < 0.03 && moved.shift == [16.0, 0.0], "{moved:?}");
        assert_eq!(looks(7, 1.1, [0.0, 0.0]).found(), None, "too few looks");
    }

    #[test]
    fn images_without_steps_of_any_size_say_nothing() {
        let mut check = RegistrationCheck::default();
        for [width, height] in [[0, 0], [1, 1], [3, 2], [64, 48]] {
            for _ in 0..9 {
                check.look(&DepthImage::new(width, height), &GrayImage::new(64, 48));
                check.look(&DepthImage::new(64, 48), &GrayImage::new(width, height));
            }
        }
        assert!(!check.is_sure() && check.found().is_none());
    }
}
