//! Pairwise consistency of seams: two seams and the routes between their ends in both maps form a cycle; if both are
//! right, the transform around it is the identity within what was drifted (Mangelson, Dominic, Eustice, Vasudevan,
//! ICRA 2018, equations 5 to 8). Saved maps have no covariances; how far they may have drifted follows from the
//! distance travelled.

use super::seams::Found;
use crate::closing::Freedom;
use crate::triangulation::median_depth;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_geometry::Vec3;
use cairn_solve::{CHI2_95, maximum_clique};
use std::collections::BTreeMap;

/// Standard deviation of a recognised pose: of its position as a share of the median depth, of its orientation in
/// radians, of the logarithm of its scale.
const SEAM: [f64; 3] = [0.02, 0.01, 0.05];
/// Standard deviation of the orientation that is added between two key frames: radians for each key frame in between.
const TURN_RAD: f64 = 5e-4;
/// Standard deviation of the logarithm of scale that is added between two key frames, likewise.
const STRETCH: f64 = 2e-3;

/// Distances travelled along the key frames of each map, in order of creation.
struct Travelled(BTreeMap<KeyFrameId, (f64, usize)>);

impl Travelled {
    fn new(snapshot: &Snapshot, found: &[Found]) -> Self {
        let ends = found.iter().flat_map(|f| [f.seam.key_frame, f.seam.place]);
        let mut maps: Vec<_> = ends.filter_map(|id| Some(snapshot.key_frame(id)?.map)).collect();
        maps.sort_unstable();
        maps.dedup();
        let mut at = BTreeMap::new();
        for map in maps {
            let (mut way, mut last) = (0.0, None);
            for (n, k) in snapshot.key_frames_of(map).enumerate() {
                let here: Vec3 = k.world_from_camera.translation;
                way += last.map_or(0.0, |last: Vec3| (here - last).norm());
                last = Some(here);
                at.insert(k.id, (way, n));
            }
        }
        Self(at)
    }

    /// Distance and number of key frames between two of one map.
    fn between(&self, a: KeyFrameId, b: KeyFrameId) -> (f64, f64) {
        match (self.0.get(&a), self.0.get(&b)) {
            (Some(a), Some(b)) => ((a.0 - b.0).abs(), a.1.abs_diff(b.1) as f64),
            _ => (f64::INFINITY, f64::INFINITY),
        }
    }
}

/// What is needed to compare seams.
struct Pairs<'a> {
    snapshot: &'a Snapshot,
    found: &'a [Found],
    travelled: Travelled,
    /// Median depth at each seam in units of the older map.
    depths: Vec<f64>,
    /// Plausible drift of the position as a share of the distance travelled.
    drift: f64,
}

impl<'a> Pairs<'a> {
    fn new(snapshot: &'a Snapshot, found: &'a [Found], drift: f64) -> Self {
        let depth = |f: &Found| {
            let here = snapshot.key_frame(f.seam.key_frame)?;
            Some(median_depth(snapshot, here)? * f.seam.into_from.scale)
        };
        let depths = found.iter().map(|f| depth(f).unwrap_or(0.0)).collect();
        Self { snapshot, found, travelled: Travelled::new(snapshot, found), depths, drift }
    }

    /// Whether two seams can both be right. Two of one key frame are compared like any others.
    fn consistent(&self, a: usize, b: usize) -> bool {
        let (one, two) = (&self.found[a], &self.found[b]);
        let Some(here) = self.snapshot.key_frame(two.seam.key_frame) else { return false };
        // Where the first seam puts the key frame of the second, seen from where the second puts it.
        let expected = one.seam.into_from * cairn_geometry::Sim3::from(here.world_from_camera);
        let error = two.world_from_here.inverse() * expected;
        let (far, steps) = {
            let older = self.travelled.between(one.seam.place, two.seam.place);
            let younger = self.travelled.between(one.seam.key_frame, two.seam.key_frame);
            (older.0 + younger.0 * two.seam.into_from.scale, older.1 + younger.1)
        };
        // How far the key frames are from each other: an error of orientation at one shifts the other.
        let ends = [one, two].map(|f| f.world_from_here.translation);
        let lever = (ends[0] - ends[1]).norm();
        let square = |v: f64| v * v;
        let seams = square(SEAM[0] * self.depths[a]) + square(SEAM[0] * self.depths[b]);
        let turned = 2.0 * square(SEAM[1]) + square(TURN_RAD * steps);
        // What is plausible is three standard deviations.
        let position = seams + square(self.drift / 3.0 * far) + square(SEAM[1] * lever);
        let in_older = two.world_from_here.scale * error.translation.norm();
        let chi2 = square(in_older) / position + square(error.rotation.angle()) / turned;
        let (chi2, degrees) = match one.freedom {
            Freedom::AlignGravity => (chi2, 4),
            Freedom::Metric => (chi2, 6),
            Freedom::Similar => {
                let scale = 2.0 * square(SEAM[2]) + square(STRETCH * steps);
                (chi2 + square(error.scale.ln()) / scale, 7)
            }
        };
        chi2 < CHI2_95[degrees - 1]
    }
}

/// The largest set of seams that are pairwise consistent, in rising order.
pub(super) fn agreeing(snapshot: &Snapshot, found: &[Found], drift: f64) -> Vec<usize> {
    let pairs = Pairs::new(snapshot, found, drift);
    maximum_clique(found.len(), |a, b| pairs.consistent(a, b)).vertices
}

/// The largest pairwise consistent set of those seams that contradict most of the chosen ones.
pub(super) fn rivals(snapshot: &Snapshot, found: &[Found], chosen: &[usize], drift: f64) -> Vec<usize> {
    let pairs = Pairs::new(snapshot, found, drift);
    let agrees = |a: usize| chosen.iter().filter(|b| pairs.consistent(a, **b)).count();
    let other: Vec<usize> =
        (0..found.len()).filter(|a| !chosen.contains(a) && 2 * agrees(*a) < chosen.len()).collect();
    let clique = maximum_clique(other.len(), |a, b| pairs.consistent(other[a], other[b]));
    clique.vertices.into_iter().map(|k| other[k]).collect()
}
