//! Recall of words alone by ground-truth poses: the share of queries with a view of the same place among the best
//! candidates.
//!
//! Two views show the same place if they are within [`NEAR_M`] and [`ALIKE_DEG`] of each other. Views closer in time
//! than [`PARTED_S`] are not candidates, nor, if there are two walks, views of the query's own walk; queries without
//! any view of the same place do not count.

use super::{View, extractor};
use crate::MeasureError;
use cairn_geometry::Se3;
use cairn_sensor::{Source, Stamp};
use cairn_vision::bow::Vocabulary;
use serde::Serialize;

/// Largest distance between two views of the same place, metres.
pub const NEAR_M: f64 = 1.0;
/// Largest angle between two views of the same place, degrees.
pub const ALIKE_DEG: f64 = 20.0;
/// Smallest time between two compared views, seconds.
pub const PARTED_S: f64 = 5.0;

/// Recall on one source.
#[derive(Clone, Debug, Serialize)]
pub struct Recall {
    /// The source.
    pub name: String,
    /// Number of views.
    pub views: usize,
    /// Number of views with another view of the same place.
    pub queries: usize,
    /// Share of queries whose best candidate is the same place.
    pub at_1: f64,
    /// Share of queries with the same place among the best five.
    pub at_5: f64,
}

/// The views of a source, one every `every_s`, with their true poses.
pub struct Views {
    /// The source.
    pub name: String,
    features: Vec<cairn_vision::Features>,
    at: Vec<(Stamp, Se3)>,
    /// Number of views of the first walk.
    first: usize,
}

impl Views {
    /// Reads a source to its end.
    ///
    /// # Errors
    /// When the source fails.
    pub fn read(name: &str, source: &mut dyn Source, every_s: f64) -> Result<Self, MeasureError> {
        let truth = source.info().truth.clone();
        let body_from_camera =
            source.rig().cameras.first().map_or_else(Se3::identity, |c| c.body_from_camera);
        let mut extractor = extractor();
        let mut views = Self { name: name.into(), features: Vec::new(), at: Vec::new(), first: 0 };
        let mut next = i64::MIN;
        while let Some(packet) = source.next_packet()? {
            let after = truth.partition_point(|(t, _)| *t < packet.stamp);
            let around =
                [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|i| truth.get(i));
            let nearest = around.min_by_key(|(t, _)| (t.0 - packet.stamp.0).abs());
            let (Some(image), Some((t, pose))) = (packet.images.first(), nearest) else { continue };
            if packet.stamp.0 < next || (t.0 - packet.stamp.0).abs() > 20_000_000 {
                continue;
            }
            next = packet.stamp.0 + (every_s * 1e9) as i64;
            let mut features = cairn_vision::Features::default();
            extractor.extract(image, &mut features);
            views.features.push(features);
            views.at.push((packet.stamp, *pose * body_from_camera));
        }
        views.first = views.at.len();
        Ok(views)
    }

    /// Adds a second walk in the same world; views of one walk are then compared with those of the other.
    pub fn with(mut self, other: Self) -> Self {
        self.features.extend(other.features);
        self.at.extend(other.at);
        self
    }

    /// Queries every view.
    pub fn recall(&self, vocabulary: &Vocabulary) -> Recall {
        let views: Vec<View> = self
            .features
            .iter()
            .map(|f| View { bag: vocabulary.bag(&f.descriptors), features: f.clone() })
            .collect();
        let walk = |i: usize| i < self.first;
        let apart = |i: usize, j: usize| {
            let one = self.first == self.at.len();
            walk(i) != walk(j) || one && (self.at[i].0.0 - self.at[j].0.0).abs() as f64 >= PARTED_S * 1e9
        };
        let same = |i: usize, j: usize| {
            let between = self.at[i].1.inverse() * self.at[j].1;
            between.translation.norm() <= NEAR_M && between.rotation.angle() <= ALIKE_DEG.to_radians()
        };
        let (mut queries, mut first, mut five) = (0, 0, 0);
        for i in 0..views.len() {
            let mut row: Vec<(f64, usize)> = (0..views.len())
                .filter(|j| apart(i, *j))
                .map(|j| (views[i].bag.similarity(&views[j].bag), j))
                .collect();
            if !row.iter().any(|(_, j)| same(i, *j)) {
                continue;
            }
            row.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            queries += 1;
            first += usize::from(row.first().is_some_and(|(_, j)| same(i, *j)));
            five += usize::from(row.iter().take(5).any(|(_, j)| same(i, *j)));
        }
        let share = |n: usize| n as f64 / f64::from((queries as u32).max(1));
        Recall { name: self.name.clone(), views: views.len(), queries, at_1: share(first), at_5: share(five) }
    }
}
