//! Recall of the words alone by true poses: of the views asked for, how many find one of the same place among the best.
//!
//! A view is the same place when it stands within [`NEAR_M`] and looks within [`ALIKE_DEG`] of where the query does. Views
//! nearer in time than [`PARTED_S`] are not asked for, nor, where there are two walks, views of the query's own; a query
//! that then has nothing to find does not count.

use super::{Seen, extractor};
use cairn_geometry::Se3;
use cairn_sensor::{Source, Stamp};
use cairn_vision::bow::Vocabulary;
use serde::Serialize;

/// Metres between two views of one place, at most.
pub const NEAR_M: f64 = 1.0;
/// Degrees between two views of one place, at most.
pub const ALIKE_DEG: f64 = 20.0;
/// Seconds between two views that are compared, at least.
pub const PARTED_S: f64 = 5.0;

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Recall {
    /// The source.
    pub name: String,
    /// Views.
    pub views: usize,
    /// Views that have something to find.
    pub queries: usize,
    /// Of these, the share whose best candidate is the same place.
    pub at_1: f64,
    /// Of these, the share that has the same place among the best five.
    pub at_5: f64,
}

/// The views of a source, one each `every_s`, with where the camera truly stood.
pub struct Views {
    /// The source.
    pub name: String,
    features: Vec<cairn_vision::Features>,
    at: Vec<(Stamp, Se3)>,
    /// How many of them belong to the first walk.
    first: usize,
}

impl Views {
    /// Looks at a source to its end.
    ///
    /// # Errors
    /// When it fails.
    pub fn read(name: &str, source: &mut dyn Source, every_s: f64) -> Result<Self, String> {
        let truth = source.info().truth.clone();
        let body_from_camera =
            source.rig().cameras.first().map_or_else(Se3::identity, |c| c.body_from_camera);
        let mut extractor = extractor();
        let mut views = Self { name: name.into(), features: Vec::new(), at: Vec::new(), first: 0 };
        let mut next = i64::MIN;
        while let Some(packet) = source.next_packet().map_err(|e| e.to_string())? {
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

    /// Adds a second walk in the same world, in which the views of the first are looked for, and the other way round.
    pub fn with(mut self, other: Self) -> Self {
        self.features.extend(other.features);
        self.at.extend(other.at);
        self
    }

    /// Asks for every view.
    pub fn recall(&self, vocabulary: &Vocabulary) -> Recall {
        let seen: Vec<Seen> = self
            .features
            .iter()
            .map(|f| Seen { bag: vocabulary.bag(&f.descriptors), features: f.clone() })
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
        for i in 0..seen.len() {
            let mut row: Vec<(f64, usize)> = (0..seen.len())
                .filter(|j| apart(i, *j))
                .map(|j| (seen[i].bag.similarity(&seen[j].bag), j))
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
        Recall { name: self.name.clone(), views: seen.len(), queries, at_1: share(first), at_5: share(five) }
    }
}
