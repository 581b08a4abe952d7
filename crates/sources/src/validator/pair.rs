//! Whether the pictures of a stereo pair lie where the calibration puts them: a second camera that is turned, or delivers the pictures of
//! another time.
//!
//! In: two pictures, once a second. Features are matched without regard to rows; a calibrated pair has them on one row after
//! rectification. A turn of the second camera by small angles, and a baseline in another direction, move them by a sum of five known
//! shapes (as in Hansen et al., "Online continuous stereo extrinsic parameter estimation", CVPR 2012): where such a sum explains rows
//! that the calibration does not, the calibration is not that of these two pictures. The disparity itself tells nothing here, so that
//! the length of the baseline stays open.

use cairn_random::Random;
use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_vision::{Features, OrbConfig, OrbExtractor, RectifiedPair, best_two_of, rectify_pair};
use nalgebra::{SMatrix, SVector};

/// Seconds between two looks.
const APART_S: f64 = 0.9;
/// Looks that find the pair to be another one, before it is told.
const LOOKS: usize = 3;
/// Features of each picture.
const FEATURES: usize = 600;
/// Descriptors of one point differ by so many bits at most, and by so much of the next best.
const MAX_HAMMING: u32 = 50;
const RATIO: f64 = 0.8;
/// Rows of one point differ by so much of the focal length at most: three degrees.
const MOST_OFF: f64 = 0.05;
/// Matches lie within so many pixels of where the sum of shapes puts them.
const INLIER_PX: f64 = 1.0;
/// Matches that a look needs.
const LEAST_MATCHES: usize = 60;
/// Rows by the calibration are off by more, in the median, pixels. Sound pairs: 0.25 (EuRoC MH_01), 0.2 (KITTI).
const OFF_PX: f64 = 0.9;
/// Samples of five matches, of which the best is taken.
const SAMPLES: usize = 200;
/// Angles of the second camera that differ by more from look to look are not those of a mount, radians.
const MOUNT_RAD: f64 = 0.006;

/// Turn about x, y and z, and direction of the baseline along y and z.
type Shapes = SVector<f64, 5>;

/// A look at a pair: how far rows are off.
#[derive(Clone, Copy, Debug)]
struct Look {
    /// By the calibration, and with the second camera turned: medians in pixels.
    off_px: [f64; 2],
    turn: Shapes,
}

/// Whether two cameras are the pair that was calibrated.
#[derive(Clone, Debug)]
pub(super) struct PairWatch {
    pair: RectifiedPair,
    names: [String; 2],
    extractors: [OrbExtractor; 2],
    features: [Features; 2],
    last: Option<Stamp>,
    bad: Vec<Look>,
}

impl PairWatch {
    /// For the first two cameras of a rig; `None` without them.
    pub fn new(rig: &Rig) -> Option<Self> {
        let [left, right, ..] = &rig.cameras[..] else { return None };
        let extractor =
            OrbExtractor::new(OrbConfig { features: FEATURES, levels: 4, ..OrbConfig::default() });
        Some(Self {
            pair: rectify_pair(left, right).ok()?,
            names: [left.name.clone(), right.name.clone()],
            extractors: [extractor.clone(), extractor],
            features: Default::default(),
            last: None,
            bad: Vec::new(),
        })
    }

    /// Takes a packet; the doubt, once.
    pub fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let is_due = self.last.is_none_or(|last| packet.stamp - last >= APART_S);
        let [left, right, ..] = &packet.images[..] else { return None };
        if !is_due || self.bad.len() >= LOOKS {
            return None;
        }
        self.last = Some(packet.stamp);
        let Self { extractors, features, .. } = self;
        for ((extractor, features), image) in extractors.iter_mut().zip(features).zip([left, right]) {
            extractor.extract(image, features);
        }
        let look = look(&self.matches(), self.pair.camera.fx)?;
        if look.off_px[0] > OFF_PX && look.off_px[0] > 2.0 * look.off_px[1] {
            self.bad.push(look);
        }
        (self.bad.len() >= LOOKS).then(|| self.words())
    }

    /// Matches in rectified coordinates of focal length one: left and right.
    fn matches(&self) -> Vec<[[f64; 2]; 2]> {
        let [left, right] = &self.features;
        let camera = &self.pair.camera;
        let of = |px: [f32; 2]| {
            [(f64::from(px[0]) - camera.cx) / camera.fx, (f64::from(px[1]) - camera.cy) / camera.fy]
        };
        let pairs = (0..left.len()).filter_map(|i| {
            let best = best_two_of(&left.descriptors[i], &right.descriptors);
            let is_sure =
                best.distance <= MAX_HAMMING && f64::from(best.distance) < RATIO * f64::from(best.second);
            let at_right = is_sure.then(|| right.raw[best.index as usize])?;
            let (a, b) = (of(self.pair.left.rectify(left.raw[i])?), of(self.pair.right.rectify(at_right)?));
            ((a[1] - b[1]).abs() < MOST_OFF).then_some([a, b])
        });
        pairs.collect()
    }

    fn words(&self) -> String {
        let middle = |of: &dyn Fn(&Look) -> f64| {
            let mut all: Vec<f64> = self.bad.iter().map(of).collect();
            all.sort_unstable_by(f64::total_cmp);
            (all[all.len() / 2], all[all.len() - 1] - all[0])
        };
        let turn = [0, 1, 2].map(|axis| middle(&|look: &Look| look.turn[axis]));
        let changes = turn.iter().any(|(_, range)| *range > MOUNT_RAD);
        let [x, y, z] = turn.map(|(angle, _)| angle.to_degrees());
        let why = match changes {
            true => "by other angles each time: the two cameras' pictures are not of one time".to_owned(),
            false => format!(
                "as with a camera that is turned by {x:.2}, {y:.2} and {z:.2} degrees about x, y and z against its calibration: that is not of \
                 this pair, or the pictures are not of one time"
            ),
        };
        let [off, fitted] = [0, 1].map(|k| middle(&|look: &Look| look.off_px[k]).0);
        format!(
            "the pictures of {} lie {off:.1} pixels off the rows of those of {} ({fitted:.1} would be left), {why}; do not rely on depth \
             by the pair: calibrate it, or use one camera",
            self.names[1], self.names[0]
        )
    }
}

/// By what the row of a match is moved by each of the shapes.
fn shapes([a, b]: &[[f64; 2]; 2]) -> Shapes {
    let (x, y, disparity) = (b[0], 0.5 * (a[1] + b[1]), a[0] - b[0]);
    Shapes::from([1.0 + y * y, -x * y, -x, disparity, disparity * y])
}

/// How far rows are off; `None` without enough matches.
fn look(matches: &[[[f64; 2]; 2]], focal: f64) -> Option<Look> {
    let rows: Vec<(Shapes, f64)> = matches.iter().map(|m| (shapes(m), m[1][1] - m[0][1])).collect();
    let inliers = |turn: &Shapes| {
        rows.iter()
            .filter(|(shapes, off)| (off - shapes.dot(turn)).abs() * focal < INLIER_PX)
            .collect::<Vec<_>>()
    };
    let mut best = inliers(&Shapes::zeros());
    let mut random = Random::new(rows.len() as u64);
    for _ in 0..SAMPLES {
        let sample = random.sample::<5>(rows.len())?;
        let turn = solve(sample.iter().map(|k| &rows[*k]));
        let found = turn.map(|turn| inliers(&turn)).unwrap_or_default();
        if found.len() > best.len() {
            best = found;
        }
    }
    if best.len() < LEAST_MATCHES {
        return None;
    }
    let turn = solve(best.iter().copied())?;
    let off = |turn: &Shapes| {
        let mut all: Vec<f64> =
            best.iter().map(|(shapes, off)| (off - shapes.dot(turn)).abs() * focal).collect();
        all.sort_unstable_by(f64::total_cmp);
        all[all.len() / 2]
    };
    Some(Look { off_px: [off(&Shapes::zeros()), off(&turn)], turn })
}

/// The weights of the shapes that explain the rows best.
fn solve<'a>(rows: impl Iterator<Item = &'a (Shapes, f64)>) -> Option<Shapes> {
    let (mut left, mut right) = (SMatrix::<f64, 5, 5>::identity() * 1e-9, Shapes::zeros());
    for (shapes, off) in rows {
        left += shapes * shapes.transpose();
        right += shapes * *off;
    }
    left.cholesky().map(|factor| factor.solve(&right))
}
