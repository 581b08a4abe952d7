//! Photographs of a walk with a matrix that says which of them show one place: precision and recall of the words alone,
//! and of what geometry confirms.
//!
//! The matrix is 84x84, its rows the later photograph: white where the earlier one of the column shows the same place
//! (two before to two after in the lap before). Next neighbours in time are not marked; so each photograph is asked for the
//! ones at least [`APART`] before it.

use super::{Seen, extractor};
use cairn_geometry::Se3;
use cairn_sources::read_gray;
use cairn_vision::bow::{NodeMatchConfig, Vocabulary, match_through_nodes};
use cairn_vision::{RectifiedCamera, TwoViewConfig, consistent_rotation, verify_two_views};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

/// Photographs nearer in time than this are not asked for: the nearest pair in the matrix is 38 apart.
pub const APART: usize = 20;
/// Candidates by words that geometry looks at.
pub const CANDIDATES: usize = 10;

/// What makes a pair accepted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gate {
    /// Matches that obey the motion, at least.
    pub inliers: usize,
    /// Of the matches, the share that does, at least.
    pub share: f64,
    /// Logarithm of the false alarms, at most.
    pub log10_false_alarms: f64,
}

impl Default for Gate {
    /// The count is set on these photographs: of pairs outside the matrix none has more than 52.
    fn default() -> Self {
        Self { inliers: 55, share: 0.3, log10_false_alarms: -12.0 }
    }
}

/// A pair of photographs that geometry looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// The later, from 0.
    pub query: usize,
    /// The earlier.
    pub earlier: usize,
    /// Likeness of the bags.
    pub score: f64,
    /// Matches through nodes.
    pub matches: usize,
    /// Matches that obey the motion.
    pub inliers: usize,
    /// Logarithm of the false alarms.
    pub log10_false_alarms: f64,
    /// Whether the matrix has it.
    pub truth: bool,
}

impl Pair {
    /// Whether it passes the gate.
    pub fn accepted(&self, gate: &Gate) -> bool {
        self.inliers >= gate.inliers
            && self.inliers as f64 >= gate.share * self.matches as f64
            && self.log10_false_alarms <= gate.log10_false_alarms
    }
}

/// The photographs, the matrix, and the focal length they were found to have.
pub struct Walk {
    /// In order.
    pub seen: Vec<Seen>,
    /// `truth[query][earlier]`.
    pub truth: Vec<Vec<bool>>,
    /// The camera assumed.
    pub camera: RectifiedCamera,
    /// Focal lengths tried, as shares of the width, with the matches of next neighbours that obey a motion.
    pub focals: Vec<(f64, usize)>,
}

/// Reads folder `loops`; `None` where it is missing.
///
/// # Errors
/// When it is there and can not be read.
pub fn read(data: &Path, vocabulary: &Vocabulary) -> Result<Option<Walk>, String> {
    let folder = data.join("loops");
    if !folder.exists() {
        return Ok(None);
    }
    let matrix = folder.join("samples_GT.bmp");
    let bytes = std::fs::read(&matrix).map_err(|e| format!("{}: {e}", matrix.display()))?;
    let truth = gray_bmp(&bytes).map_err(|e| format!("{}: {e}", matrix.display()))?;
    let mut extractor = extractor();
    let mut seen = Vec::new();
    let mut size = [0; 2];
    for i in 1..=truth.len() {
        let image = read_gray(&folder.join(format!("samples/{i}.jpg")))?;
        size = [image.width(), image.height()];
        seen.push(Seen::of(&mut extractor, &image, vocabulary));
    }
    let focals: Vec<(f64, usize)> = [0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5]
        .map(|share| (share, neighbours_that_agree(&seen, &camera(size, share))))
        .to_vec();
    let best = focals.iter().fold((0.0, 0), |best, f| if f.1 > best.1 { *f } else { best });
    Ok(Some(Walk { seen, truth, camera: camera(size, best.0), focals }))
}

/// A pinhole with its centre in the middle of the image.
fn camera([width, height]: [usize; 2], focal_share: f64) -> RectifiedCamera {
    let (w, h) = (width as f64, height as f64);
    RectifiedCamera {
        fx: focal_share * w,
        fy: focal_share * w,
        cx: (w - 1.0) / 2.0,
        cy: (h - 1.0) / 2.0,
        baseline_fx: 0.0,
        bounds: [0.0, 0.0, w, h],
        close_depth: 0.0,
        body_from_camera: Se3::identity(),
    }
}

/// The focal length is not known: the one under which photographs taken one after another agree best is taken.
fn neighbours_that_agree(seen: &[Seen], camera: &RectifiedCamera) -> usize {
    seen.windows(2).map(|w| verify(&w[1], &w[0], camera, 0).1).sum()
}

/// Matches through nodes that turned alike, how many of them obey one motion, and how likely that is by chance.
fn verify(a: &Seen, b: &Seen, camera: &RectifiedCamera, seed: u64) -> (usize, usize, f64) {
    let (fa, fb) = (&a.features, &b.features);
    let pairs = match_through_nodes(
        (&a.bag, &fa.descriptors),
        (&b.bag, &fb.descriptors),
        &NodeMatchConfig::default(),
        |_| true,
        |_| true,
    );
    let turned = pairs.into_iter().map(|[i, j]| ([i, j], fb.angle[j] - fa.angle[i])).collect();
    let pairs = consistent_rotation(turned);
    let first: Vec<[f32; 2]> = pairs.iter().map(|p| fa.raw[p[0]]).collect();
    let second: Vec<[f32; 2]> = pairs.iter().map(|p| fb.raw[p[1]]).collect();
    let config = TwoViewConfig { sigma_px: SIGMA_PX, ..TwoViewConfig::default() };
    let verified = verify_two_views(camera, &first, &second, &config, seed);
    let (inliers, alarms) = verified.map_or((0, f64::INFINITY), |v| (v.count(), v.log10_false_alarms));
    (pairs.len(), inliers, alarms)
}

/// Standard deviation of a keypoint, pixels: the lens is not known, and its distortion not taken out.
const SIGMA_PX: f64 = 1.5;

impl Walk {
    /// Every pair that is asked for, with its likeness, the matrix' word and the rank among those of its query.
    pub fn likenesses(&self) -> Vec<(f64, bool, usize)> {
        let mut all = Vec::new();
        for query in APART..self.seen.len() {
            let mut row: Vec<(f64, bool)> = (0..=query - APART)
                .map(|j| (self.seen[query].bag.similarity(&self.seen[j].bag), self.truth[query][j]))
                .collect();
            row.sort_by(|a, b| b.0.total_cmp(&a.0));
            all.extend(row.into_iter().enumerate().map(|(rank, (s, t))| (s, t, rank)));
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all
    }

    /// The best candidates of each photograph, looked at by geometry.
    pub fn verified(&self, candidates: usize) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for query in APART..self.seen.len() {
            let mut row: Vec<(f64, usize)> = (0..=query - APART)
                .map(|j| (self.seen[query].bag.similarity(&self.seen[j].bag), j))
                .filter(|(s, _)| *s > 0.0)
                .collect();
            row.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            for &(score, earlier) in row.iter().take(candidates) {
                let seed = (query * self.seen.len() + earlier) as u64;
                let (matches, inliers, log10_false_alarms) =
                    verify(&self.seen[query], &self.seen[earlier], &self.camera, seed);
                let truth = self.truth[query][earlier];
                pairs.push(Pair { query, earlier, score, matches, inliers, log10_false_alarms, truth });
            }
        }
        pairs
    }

    /// How many photographs the earlier one of a pair is away from the nearest that the matrix has for the query.
    pub fn steps_from_truth(&self, pair: &Pair) -> usize {
        let marked = self.truth[pair.query].iter().enumerate().filter(|(_, t)| **t);
        marked.map(|(j, _)| j.abs_diff(pair.earlier)).min().unwrap_or(self.seen.len())
    }

    /// All pairs of the matrix, counted from 0.
    pub fn true_pairs(&self) -> BTreeSet<(usize, usize)> {
        let rows = self.truth.iter().enumerate();
        rows.flat_map(|(i, row)| row.iter().enumerate().filter(|(_, t)| **t).map(move |(j, _)| (i, j)))
            .collect()
    }
}

/// White pixels of an uncompressed bitmap of eight bits a pixel, top row first (the file has them the other way round).
fn gray_bmp(bytes: &[u8]) -> Result<Vec<Vec<bool>>, String> {
    let word =
        |at: usize| -> Option<i32> { Some(i32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)) };
    let fields = (word(10), word(18), word(22), word(28), word(30));
    let (Some(start), Some(width), Some(height), Some(bits), Some(0)) = fields else {
        return Err("not an uncompressed bitmap".into());
    };
    if bits & 0xffff != 8 || !(1..=4096).contains(&width) || !(1..=4096).contains(&height) || start < 0 {
        return Err("not a bitmap of eight bits a pixel".into());
    }
    let (width, height, start) = (width as usize, height as usize, start as usize);
    let stride = width.next_multiple_of(4);
    let row = |y: usize| bytes.get(start + y * stride..start + y * stride + width);
    let rows = (0..height).rev().map(|y| row(y).map(|r| r.iter().map(|p| *p > 127).collect()));
    rows.collect::<Option<_>>().ok_or_else(|| "rows are missing".into())
}
