//! Whether the pictures of a stereo pair lie where the calibration puts them: a second camera that is turned, or delivers the pictures of
//! another time.
//!
//! In: two pictures, once a second. Features are matched without regard to rows; a calibrated pair has them on one row after
//! rectification. A turn of the second camera by small angles, and a baseline in another direction, move them by a sum of five known
//! shapes (as in Hansen et al., "Online continuous stereo extrinsic parameter estimation", CVPR 2012): where such a sum explains rows
//! that the calibration does not, the calibration is not that of these two pictures. The disparity itself tells nothing here, so that
//! the length of the baseline stays open; only its sign tells, with rows that fit, that the two pictures are exchanged.

use super::matched::matched;
use super::watch::Watch;
use cairn_random::Random;
use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_vision::{Features, OrbConfig, OrbExtractor, RectifiedPair, rectify_pair};
use nalgebra::{SMatrix, SVector};

/// Seconds between two looks.
const APART_S: f64 = 0.9;
/// Looks that find the pair to be another one, before it is told.
const LOOKS: usize = 3;
/// Features of each picture.
const FEATURES: usize = 600;
/// Rows of one point differ by so much of the focal length at most: three degrees.
const MOST_OFF: f64 = 0.05;
/// Matches lie within so many pixels of where the sum of shapes puts them.
const INLIER_PX: f64 = 1.0;
/// Matches that a look needs.
const LEAST_MATCHES: usize = 60;
/// Rows by the calibration are off by more, in the median, pixels. Sound pairs: at most 0.31 (EuRoC MH_01), 0.47 (KITTI); EuRoC with a
/// yaw of 2 degrees: 1.6 to 2.2, with a pitch of 0.5: 4.3 to 4.7.
const OFF_PX: f64 = 0.9;
/// Of pictures that are exchanged so many points have a disparity of more than a pixel with the cameras exchanged. Sound pairs: none
/// (EuRoC MH_01, KITTI).
const EXCHANGED: f64 = 0.9;
/// Samples of five matches, of which the best is taken.
const SAMPLES: usize = 200;
/// One turn for all looks leaves this part of what rows are off, at most, where it is a mount's and not one of time.
const LEFT: f64 = 0.5;

/// Turn about x, y and z, and direction of the baseline along y and z.
type Shapes = SVector<f64, 5>;

/// A match: by what the row is moved by each of the shapes, and by what it is off, in focal lengths.
type Row = (Shapes, f64);

/// Whether two cameras are the pair that was calibrated.
#[derive(Clone, Debug)]
pub(super) struct PairWatch {
    pair: RectifiedPair,
    names: [String; 2],
    extractors: [OrbExtractor; 2],
    features: [Features; 2],
    last: Option<Stamp>,
    /// Matches of the looks that found another pair.
    bad: Vec<Vec<Row>>,
    /// Looks that found the pictures exchanged.
    exchanged: usize,
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
            exchanged: 0,
        })
    }

    /// Matches in rectified coordinates of focal length one: left and right; or as if the pictures were exchanged.
    fn matches(&self, exchanged: bool) -> Vec<[[f64; 2]; 2]> {
        let [first, second] = &self.features;
        let (left, right) = if exchanged { (second, first) } else { (first, second) };
        let camera = &self.pair.camera;
        let of = |px: [f32; 2]| {
            [(f64::from(px[0]) - camera.cx) / camera.fx, (f64::from(px[1]) - camera.cy) / camera.fy]
        };
        let pairs = matched(left, right).filter_map(|[at_left, at_right]| {
            let (a, b) = (of(self.pair.left.rectify(at_left)?), of(self.pair.right.rectify(at_right)?));
            ((a[1] - b[1]).abs() < MOST_OFF).then_some([a, b])
        });
        pairs.collect()
    }

    /// Whether the pictures fit the calibration exchanged: on one row, and in front of the cameras.
    fn is_exchanged(&self) -> bool {
        let focal = self.pair.camera.fx;
        let found: Vec<[[f64; 2]; 2]> = self.matches(true);
        let rows: Vec<Row> = found.iter().map(|m| (shapes(m), m[1][1] - m[0][1])).collect();
        let in_front = found.iter().filter(|[a, b]| (a[0] - b[0]) * focal > 1.0).count();
        found.len() >= LEAST_MATCHES
            && in_front as f64 > EXCHANGED * found.len() as f64
            && off_px(&rows, &Shapes::zeros(), focal) < OFF_PX
    }

    fn words(&self) -> Option<String> {
        let focal = self.pair.camera.fx;
        let all = self.bad.concat();
        let turn = solve(&all)?;
        let [off, left] = [Shapes::zeros(), turn].map(|turn| off_px(&all, &turn, focal));
        let [x, y, z] = [0, 1, 2].map(|axis| turn[axis].to_degrees());
        let why = match left > LEFT * off {
            true => "by other angles each time: the two cameras' pictures are not of one time".to_owned(),
            false => format!(
                "as with a camera that is turned by {x:.2}, {y:.2} and {z:.2} degrees about x, y and z against its calibration: that is not of \
                 this pair, or the pictures are not of one time"
            ),
        };
        Some(format!(
            "the pictures of {} lie {off:.1} pixels off the rows of those of {}, {why}; do not rely on depth by the pair: calibrate it, or \
             use one camera",
            self.names[1], self.names[0]
        ))
    }
}

impl Watch for PairWatch {
    fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let is_due = self.last.is_none_or(|last| packet.stamp - last >= APART_S);
        let [left, right, ..] = &packet.images[..] else { return None };
        if !is_due || self.bad.len() >= LOOKS || self.exchanged >= LOOKS {
            return None;
        }
        self.last = Some(packet.stamp);
        let Self { extractors, features, .. } = self;
        for ((extractor, features), image) in extractors.iter_mut().zip(features).zip([left, right]) {
            extractor.extract(image, features);
        }
        if self.is_exchanged() {
            self.exchanged += 1;
            let [first, second] = &self.names;
            return (self.exchanged == LOOKS).then(|| {
                format!(
                    "the pictures of {first} and {second} are exchanged: each lies where the calibration puts the other's; exchange the \
                     folders, topics or halves of the pictures"
                )
            });
        }
        let focal = self.pair.camera.fx;
        let found = look(&self.matches(false), focal)?;
        let off = off_px(&found, &Shapes::zeros(), focal);
        if off > OFF_PX && off > 2.0 * off_px(&found, &solve(&found)?, focal) {
            self.bad.push(found);
        }
        if self.bad.len() < LOOKS { None } else { self.words() }
    }
}

/// By what the row of a match is moved by each of the shapes.
fn shapes([a, b]: &[[f64; 2]; 2]) -> Shapes {
    let (x, y, disparity) = (b[0], 0.5 * (a[1] + b[1]), a[0] - b[0]);
    Shapes::from([1.0 + y * y, -x * y, -x, disparity, disparity * y])
}

/// The most matches that one sum of shapes explains; `None` where they are few.
fn look(matches: &[[[f64; 2]; 2]], focal: f64) -> Option<Vec<Row>> {
    let rows: Vec<Row> = matches.iter().map(|m| (shapes(m), m[1][1] - m[0][1])).collect();
    let inliers = |turn: &Shapes| {
        let fits = |(shapes, off): &&Row| (off - shapes.dot(turn)).abs() * focal < INLIER_PX;
        rows.iter().filter(fits).copied().collect::<Vec<_>>()
    };
    let mut best = inliers(&Shapes::zeros());
    let mut random = Random::new(rows.len() as u64);
    for _ in 0..SAMPLES {
        let sample = random.sample::<5>(rows.len())?.map(|k| rows[k]);
        let found = solve(&sample).map(|turn| inliers(&turn)).unwrap_or_default();
        if found.len() > best.len() {
            best = found;
        }
    }
    (best.len() >= LEAST_MATCHES).then_some(best)
}

/// How far rows are off from where a sum of shapes puts them: the median in pixels.
fn off_px(rows: &[Row], turn: &Shapes, focal: f64) -> f64 {
    let mut all: Vec<f64> = rows.iter().map(|(shapes, off)| (off - shapes.dot(turn)).abs() * focal).collect();
    all.sort_unstable_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0)
}

/// The weights of the shapes that explain the rows best.
fn solve(rows: &[Row]) -> Option<Shapes> {
    let (mut left, mut right) = (SMatrix::<f64, 5, 5>::identity() * 1e-9, Shapes::zeros());
    for (shapes, off) in rows {
        left += shapes * shapes.transpose();
        right += shapes * *off;
    }
    left.cholesky().map(|factor| factor.solve(&right))
}
