//! Photographs of a walk with a matrix of those that show the same place: precision and recall with words alone and
//! with geometric verification.
//!
//! The matrix is 84x84, its rows the later photograph: white where the earlier one of the column shows the same place
//! (two before to two after in the lap before). Temporal neighbours are not marked, so each photograph is compared with
//! those at least [`APART`] before it.

use super::{View, extractor};
use crate::MeasureError;
use crate::error::{file, of};
use cairn_geometry::Se3;
use cairn_sources::read_gray;
use cairn_vision::bow::{NodeMatchConfig, Vocabulary, match_through_nodes};
use cairn_vision::{RectifiedCamera, TwoViewConfig, consistent_rotation, verify_two_views};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

/// Photographs closer than this in the sequence are not compared: the closest pair in the matrix is 38 apart.
pub const APART: usize = 20;
/// Candidates by words that are verified geometrically.
pub const CANDIDATES: usize = 10;

/// Thresholds for accepting a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gate {
    /// Minimum number of inlier matches.
    pub inliers: usize,
    /// Minimum share of inliers among the matches.
    pub share: f64,
    /// Maximum logarithm of the expected number of false alarms.
    pub log10_false_alarms: f64,
}

impl Default for Gate {
    /// The number of inliers is tuned on these photographs: no pair outside the matrix has more than 52.
    fn default() -> Self {
        Self { inliers: 55, share: 0.3, log10_false_alarms: -12.0 }
    }
}

/// A geometrically verified pair of photographs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// The later photograph, counted from 0.
    pub query: usize,
    /// The earlier photograph.
    pub earlier: usize,
    /// Similarity of the bags of words.
    pub score: f64,
    /// Matches through the nodes of the vocabulary.
    pub matches: usize,
    /// Inlier matches.
    pub inliers: usize,
    /// Logarithm of the expected number of false alarms.
    pub log10_false_alarms: f64,
    /// Whether the pair is in the matrix.
    pub truth: bool,
}

impl Pair {
    /// Whether it passes the thresholds.
    pub fn accepted(&self, gate: &Gate) -> bool {
        self.inliers >= gate.inliers
            && self.inliers as f64 >= gate.share * self.matches as f64
            && self.log10_false_alarms <= gate.log10_false_alarms
    }
}

/// The photographs, the matrix, and the estimated camera.
pub struct Walk {
    /// The photographs, in order.
    pub views: Vec<View>,
    /// `truth[query][earlier]`.
    pub truth: Vec<Vec<bool>>,
    /// The assumed camera.
    pub camera: RectifiedCamera,
    /// Focal lengths tried, as fractions of the width, with the inlier matches of consecutive photographs.
    pub focals: Vec<(f64, usize)>,
}

/// Reads the folder `loops`; `None` if it is missing.
///
/// # Errors
/// When it exists and cannot be read.
pub fn read(data: &Path, vocabulary: &Vocabulary) -> Result<Option<Walk>, MeasureError> {
    let folder = data.join("loops");
    if !folder.exists() {
        return Ok(None);
    }
    let matrix = folder.join("samples_GT.bmp");
    let bytes = std::fs::read(&matrix).map_err(file(&matrix))?;
    let truth = gray_bmp(&bytes).map_err(|e| of(matrix.display(), e))?;
    let mut extractor = extractor();
    let mut views = Vec::new();
    let mut size = [0; 2];
    for i in 1..=truth.len() {
        let image = read_gray(&folder.join(format!("samples/{i}.jpg")))?;
        size = [image.width(), image.height()];
        views.push(View::of(&mut extractor, &image, vocabulary));
    }
    let focals: Vec<(f64, usize)> = [0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5]
        .map(|share| (share, neighbour_inliers(&views, &camera(size, share))))
        .to_vec();
    let best = focals.iter().fold((0.0, 0), |best, f| if f.1 > best.1 { *f } else { best });
    Ok(Some(Walk { views, truth, camera: camera(size, best.0), focals }))
}

/// A pinhole with its principal point at the image centre.
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

/// Inlier matches of consecutive photographs; the unknown focal length is chosen to maximise them.
fn neighbour_inliers(views: &[View], camera: &RectifiedCamera) -> usize {
    views.windows(2).map(|w| verify(&w[1], &w[0], camera, 0).1).sum()
}

/// The number of matches with consistent rotation, the number of inliers of one motion, and the logarithm of its
/// expected false alarms.
fn verify(a: &View, b: &View, camera: &RectifiedCamera, seed: u64) -> (usize, usize, f64) {
    let (fa, fb) = (&a.features, &b.features);
    let pairs = match_through_nodes(
        (&a.bag, &fa.descriptors),
        (&b.bag, &fb.descriptors),
        &NodeMatchConfig::default(),
        |_| true,
        |_| true,
    );
    let with_rotation = pairs.into_iter().map(|[i, j]| ([i, j], fb.angle[j] - fa.angle[i])).collect();
    let pairs = consistent_rotation(with_rotation);
    let first: Vec<[f32; 2]> = pairs.iter().map(|p| fa.raw[p[0]]).collect();
    let second: Vec<[f32; 2]> = pairs.iter().map(|p| fb.raw[p[1]]).collect();
    let config = TwoViewConfig { sigma_px: SIGMA_PX, ..TwoViewConfig::default() };
    let verified = verify_two_views(camera, &first, &second, &config, seed);
    let (inliers, alarms) = verified.map_or((0, f64::INFINITY), |v| (v.count(), v.log10_false_alarms));
    (pairs.len(), inliers, alarms)
}

/// Standard deviation of a keypoint, pixels: the lens is unknown and its distortion is not corrected.
const SIGMA_PX: f64 = 1.5;

impl Walk {
    /// Every compared pair: similarity, whether it is in the matrix, and its rank among those of its query.
    pub fn similarities(&self) -> Vec<(f64, bool, usize)> {
        let mut all = Vec::new();
        for query in APART..self.views.len() {
            let mut row: Vec<(f64, bool)> = (0..=query - APART)
                .map(|j| (self.views[query].bag.similarity(&self.views[j].bag), self.truth[query][j]))
                .collect();
            row.sort_by(|a, b| b.0.total_cmp(&a.0));
            all.extend(row.into_iter().enumerate().map(|(rank, (s, t))| (s, t, rank)));
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all
    }

    /// The best candidates of each photograph, verified geometrically.
    pub fn verified(&self, candidates: usize) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for query in APART..self.views.len() {
            let mut row: Vec<(f64, usize)> = (0..=query - APART)
                .map(|j| (self.views[query].bag.similarity(&self.views[j].bag), j))
                .filter(|(s, _)| *s > 0.0)
                .collect();
            row.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            for &(score, earlier) in row.iter().take(candidates) {
                let seed = (query * self.views.len() + earlier) as u64;
                let (matches, inliers, log10_false_alarms) =
                    verify(&self.views[query], &self.views[earlier], &self.camera, seed);
                let truth = self.truth[query][earlier];
                pairs.push(Pair { query, earlier, score, matches, inliers, log10_false_alarms, truth });
            }
        }
        pairs
    }

    /// Distance in the sequence from the earlier photograph of a pair to the nearest one marked for the query.
    pub fn steps_from_truth(&self, pair: &Pair) -> usize {
        let marked = self.truth[pair.query].iter().enumerate().filter(|(_, t)| **t);
        marked.map(|(j, _)| j.abs_diff(pair.earlier)).min().unwrap_or(self.views.len())
    }

    /// All pairs in the matrix, counted from 0.
    pub fn true_pairs(&self) -> BTreeSet<(usize, usize)> {
        let rows = self.truth.iter().enumerate();
        rows.flat_map(|(i, row)| row.iter().enumerate().filter(|(_, t)| **t).map(move |(j, _)| (i, j)))
            .collect()
    }
}

/// White pixels of an uncompressed bitmap with eight bits per pixel, top row first (the file stores the bottom row
/// first).
fn gray_bmp(bytes: &[u8]) -> Result<Vec<Vec<bool>>, MeasureError> {
    let word =
        |at: usize| -> Option<i32> { Some(i32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)) };
    let fields = (word(10), word(18), word(22), word(28), word(30));
    let (Some(start), Some(width), Some(height), Some(bits), Some(0)) = fields else {
        return Err("not an uncompressed bitmap".into());
    };
    if bits & 0xffff != 8 || !(1..=4096).contains(&width) || !(1..=4096).contains(&height) || start < 0 {
        return Err("not a bitmap with eight bits per pixel".into());
    }
    let (width, height, start) = (width as usize, height as usize, start as usize);
    let stride = width.next_multiple_of(4);
    let row = |y: usize| bytes.get(start + y * stride..start + y * stride + width);
    let rows = (0..height).rev().map(|y| row(y).map(|r| r.iter().map(|p| *p > 127).collect()));
    rows.collect::<Option<_>>().ok_or_else(|| "rows are missing".into())
}
