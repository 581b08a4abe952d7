//! Joining two complete maps, such as those of two recordings: places of one are recognised in the other, and all that
//! agree with each other decide together, before anything is changed.
//!
//! In: a snapshot and two of its maps. Out: the changes that make them one, with the seams, or why they stay apart. A
//! loop that is closed while walking is bounded by drift; how two recordings lie to each other is unknown, so that a
//! single place, or many views of one, prove nothing where rooms look alike.

mod consistency;
mod seams;
mod stitch;
#[cfg(test)]
mod tests;

use super::Closer;
use super::scales::{FusedScales, ScaleConflict, ScaleMatch, fuse_scales};
use super::visits::metre_in_map_units;
use cairn_adjust::Recognised;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Sim3, Vec3};
use consistency::{agreeing, rivals};
use seams::Found;
pub use seams::Seam;
use std::fmt;

/// Places far enough from each other to be independent that must agree.
const NEED: usize = 3;
/// Two seams are independent when their key frames are this far apart, metres (or a fourth of the median depth for
/// each, where lengths are not metres), or turned by this much against each other.
pub const INDEPENDENT_M: f64 = 1.0;
/// See [`INDEPENDENT_M`].
pub const INDEPENDENT_RAD: f64 = 0.6;
/// Two key frames of two maps that lie as seams say stand at one place and look the same way within this distance, metres, and with a
/// greater cosine between their optical axes.
pub const SAME_PLACE_M: f64 = 1.0;
/// See [`SAME_PLACE_M`].
pub const SAME_WAY_COS: f64 = 0.94;
/// Places that agree on something else make a decision doubtful from this share on.
const RIVAL: f64 = 0.5;
/// Of the key frames that stand where the other map was mapped and look the same way, the share that must show it
/// (measured in simulated houses: all of them in right merges, 0.61 to 0.73 where rooms look alike), and at least [`NEED`] of
/// them: rooms that look alike, seen from different sides, have many places that agree and none that could contradict.
const SUPPORT: f64 = 0.85;

/// Two maps that are one now.
#[derive(Clone, Debug)]
pub struct Junction {
    /// The seams that agree, in the order of their key frames.
    pub seams: Vec<Seam>,
    /// Recognised places that do not agree with them, and were left out.
    pub left_out: usize,
    /// How many key frames of the younger map show the older one where they stand in it.
    pub support: Support,
    /// From the younger map to the older one, as agreed.
    pub into_from: Sim3,
    /// By what the lengths of the older map (`there`) and of the younger (`here`) were multiplied, and how well the joined map's are known.
    pub scales: FusedScales,
    /// Root mean square distance between where each seam puts its key frame and where `into_from` does, in units of
    /// the older map: what both maps have drifted between the seams.
    pub rms: f64,
    /// The same once the maps were relaxed, and adjusted where that was wanted: between where each seam puts its key frame and where it is.
    pub rms_after: f64,
    /// Mean and greatest distance by which the key frames of the younger map were moved beyond `into_from`.
    pub moved: [f64; 2],
    /// Mean and greatest distance by which those of the older map were moved.
    pub older_moved: [f64; 2],
    /// Landmarks of one map that turned out to be landmarks of the other.
    pub fused: usize,
}

/// Why two maps stay apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Apart {
    /// No place was recognised.
    NoPlace,
    /// Too few places that are independent of each other agree.
    Few {
        /// Recognised places.
        recognised: usize,
        /// Places that agree with each other.
        agree: usize,
        /// As many of them are far enough from each other.
        independent: usize,
        /// Needed.
        need: usize,
    },
    /// Two groups of places contradict each other: parts of the maps look alike.
    Ambiguous {
        /// Places that agree with each other.
        agree: usize,
        /// Places that agree on something else.
        rival: usize,
    },
    /// Both maps have metres, and by the places that agree these differ by more than what is known of both allows.
    MetricScale(ScaleConflict),
    /// Key frames that would stand in the other map, by the places that agree, do not show it.
    Unsupported(Support),
}

impl fmt::Display for Apart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPlace => write!(f, "no place of one was recognised in the other"),
            Self::Few { recognised, agree, independent, need } => write!(
                f,
                "of {recognised} recognised places {agree} agree, at {independent} positions, where {need} are needed"
            ),
            Self::Ambiguous { agree, rival } => {
                write!(
                    f,
                    "{agree} recognised places agree, but {rival} agree on something else: parts look alike"
                )
            }
            Self::MetricScale(why) => why.fmt(f),
            Self::Unsupported(Support { shown, expected }) => write!(
                f,
                "of {expected} key frames that would stand in the other map only {shown} show it: parts look alike"
            ),
        }
    }
}

/// The attempt to join two maps.
#[derive(Clone, Debug)]
pub struct MapJoin {
    /// The younger map.
    pub from: MapId,
    /// The older map.
    pub into: MapId,
    /// Key frames of the younger map that were compared with the older one.
    pub compared: usize,
    /// How they were joined, or why not.
    pub result: Result<Junction, Apart>,
    /// The changes to commit on the given snapshot; none where the maps stay apart.
    pub changes: Vec<Change>,
    /// The snapshot with these changes; `None` where there are none.
    pub joined: Option<Snapshot>,
}

/// When a map that two became is adjusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adjust {
    /// At once: as a whole up to [`super::CloserConfig::whole_key_frames`], larger ones around the seams.
    Now,
    /// Not yet, since more maps follow: [`Closer::adjust_joined`] when all are joined.
    Later,
}

/// What two maps say of each other before anything is changed.
#[derive(Clone, Debug)]
pub struct MapComparison {
    /// The younger map.
    pub from: MapId,
    /// The older map.
    pub into: MapId,
    /// Key frames of the younger map that were compared with the older one.
    pub compared: usize,
    /// What agrees, or why that is not enough.
    pub result: Result<Agreement, Apart>,
}

/// Evidence that two maps show the same places.
#[derive(Clone, Debug)]
pub struct Agreement {
    /// Seams that agree.
    pub seams: usize,
    /// Recognised places that do not agree with them.
    pub left_out: usize,
    /// How many key frames of the younger map show the older one where they stand in it.
    pub support: Support,
    /// From the younger map to the older one, by the seam in the middle.
    pub into_from: Sim3,
    /// The key frames of the younger map that should show the older one by these seams, and whether each does.
    pub expected: Vec<(KeyFrameId, bool)>,
    /// The seams that agree: key frames of the younger map, and the place of the older one that was recognised in each.
    pub recognised: Vec<(KeyFrameId, Recognised)>,
}

/// What was decided of two maps.
struct Decided {
    /// The seams that are believed, as indices.
    chosen: Vec<usize>,
    /// The key frames that should show the older map, and whether they do.
    expected: Vec<(KeyFrameId, bool)>,
    /// How the scales of both maps fit.
    scales: FusedScales,
}

impl Closer {
    /// Compares two maps of a snapshot as [`Closer::join_maps`] does, and stops before joining them.
    pub fn compare_maps(&self, snapshot: &Snapshot, a: MapId, b: MapId) -> MapComparison {
        let (into, from) = (a.min(b), a.max(b));
        let (compared, mut found) = self.seams(snapshot, from, into);
        let result =
            self.decide(snapshot, from, into, &mut found).map(|Decided { chosen, expected, .. }| {
                let agreeing: Vec<&Found> = chosen.iter().map(|k| &found[*k]).collect();
                Agreement {
                    seams: chosen.len(),
                    left_out: found.len() - chosen.len(),
                    support: Support::of(&expected),
                    expected,
                    into_from: stitch::middle(snapshot, &agreeing).seam.into_from,
                    recognised: agreeing.iter().map(|f| (f.seam.key_frame, f.place.clone())).collect(),
                }
            });
        MapComparison { from, into, compared, result }
    }

    /// Joins two maps of a snapshot if they show the same places. Every key frame of the younger is compared with the
    /// places of the older map most similar by words, with the geometry of loop closing; the largest set of seams that
    /// are pairwise consistent decides (Mangelson, Dominic, Eustice, Vasudevan, "Pairwise consistent measurement set
    /// maximization for robust multi-robot map merging", ICRA 2018). Then one similarity moves the younger map, the pose
    /// graph is relaxed under all seams, landmarks are fused, and the map is adjusted, if that is wanted now.
    pub fn join_maps(&self, snapshot: &Snapshot, a: MapId, b: MapId, adjust: Adjust) -> MapJoin {
        let (into, from) = (a.min(b), a.max(b));
        let (compared, mut found) = self.seams(snapshot, from, into);
        match self.decide(snapshot, from, into, &mut found) {
            Ok(Decided { chosen, expected, scales }) => {
                let (mut junction, draft) =
                    self.stitch(snapshot, [from, into], &found, &chosen, scales, adjust);
                junction.support = Support::of(&expected);
                let (joined, changes) = draft.into_parts();
                MapJoin { from, into, compared, result: Ok(junction), changes, joined: Some(joined) }
            }
            Err(apart) => {
                MapJoin { from, into, compared, result: Err(apart), changes: Vec::new(), joined: None }
            }
        }
    }

    /// Which seams are believed; all then have the scale between both maps.
    fn decide(
        &self,
        snapshot: &Snapshot,
        from: MapId,
        into: MapId,
        found: &mut [Found],
    ) -> Result<Decided, Apart> {
        if found.is_empty() {
            return Err(Apart::NoPlace);
        }
        let chosen = agreeing(snapshot, found, self.config.drift[0]);
        let independent = self.independent(snapshot, found, &chosen);
        if independent < NEED {
            let (recognised, agree) = (found.len(), chosen.len());
            return Err(Apart::Few { recognised, agree, independent, need: NEED });
        }
        let rival = rivals(snapshot, found, &chosen, self.config.drift[0]);
        if self.independent(snapshot, found, &rival) as f64 >= RIVAL * independent as f64 {
            return Err(Apart::Ambiguous { agree: chosen.len(), rival: rival.len() });
        }
        let expected = self.expected(snapshot, from, into, found, &chosen);
        let support = Support::of(&expected);
        if support.shown < NEED || (support.shown as f64) < SUPPORT * support.expected as f64 {
            return Err(Apart::Unsupported(support));
        }
        let scales = self.fused_scales(snapshot, [into, from], found, &chosen).map_err(Apart::MetricScale)?;
        found.iter_mut().for_each(|f| f.scale(snapshot, scales.ratio()));
        Ok(Decided { chosen, expected, scales })
    }

    /// The scales of two maps (the older one first), weighed by the seams chosen.
    fn fused_scales(
        &self,
        snapshot: &Snapshot,
        maps: [MapId; 2],
        found: &[Found],
        chosen: &[usize],
    ) -> Result<FusedScales, ScaleConflict> {
        let known = maps.map(|map| snapshot.scale_of(map, &self.camera));
        let told = chosen.iter().copied().filter(|k| found[*k].depth_ratio.points >= self.config.need / 4);
        let told: Vec<usize> = told.collect();
        let logs = told.iter().map(|k| found[*k].depth_ratio.log).collect();
        fuse_scales(known, ScaleMatch::of_places(logs, self.independent(snapshot, found, &told)))
    }

    /// How many of these seams are far enough from each other, at least: counted from the first on.
    fn independent(&self, snapshot: &Snapshot, found: &[Found], some: &[usize]) -> usize {
        let mut counted: Vec<usize> = Vec::new();
        for k in some {
            let Some(here) = snapshot.key_frame(found[*k].seam.key_frame) else { continue };
            let near = INDEPENDENT_M * metre_in_map_units(snapshot, here, found[*k].freedom);
            let apart = |other: &usize| {
                snapshot.key_frame(found[*other].seam.key_frame).is_some_and(|other| {
                    let (a, b) = (&here.world_from_camera, &other.world_from_camera);
                    (a.translation - b.translation).norm() > near
                        || (a.rotation.inverse() * b.rotation).angle() > INDEPENDENT_RAD
                })
            };
            if counted.iter().all(apart) {
                counted.push(*k);
            }
        }
        counted.len()
    }

    /// The key frames of the younger map that stand, by the seams chosen, within a metre of a key frame of the older
    /// one and look the same way, and whether each shows the place. Where words did not find the place
    /// it is looked for directly.
    fn expected(
        &self,
        snapshot: &Snapshot,
        from: MapId,
        into: MapId,
        found: &[Found],
        chosen: &[usize],
    ) -> Vec<(KeyFrameId, bool)> {
        let mut expected = Vec::new();
        for here in snapshot.key_frames_of(from).filter(|k| !k.landmarks.iter().all(Option::is_none)) {
            // By the seam next to it in time: what both maps have drifted since does not count.
            let between = |k: &&usize| found[**k].seam.key_frame.index().abs_diff(here.id.index());
            let Some(next) = chosen.iter().min_by_key(between).map(|k| &found[*k]) else { break };
            let there = next.seam.into_from.transform_pose(&here.world_from_camera);
            let axis = there.rotation * Vec3::z();
            let metre = metre_in_map_units(snapshot, here, next.freedom) * next.seam.into_from.scale;
            let near = SAME_PLACE_M * metre;
            let far = |k: &KeyFrame| (k.world_from_camera.translation - there.translation).norm();
            let covering = snapshot
                .key_frames_of(into)
                .filter(|k| {
                    far(k) < near && (k.world_from_camera.rotation * Vec3::z()).dot(&axis) > SAME_WAY_COS
                })
                .min_by(|a, b| far(a).total_cmp(&far(b)));
            let Some(place) = covering else { continue };
            let agrees = |f: Found| {
                let off = (f.world_from_here.translation - there.translation).norm();
                off < 0.5 * metre && (f.world_from_here.rotation.inverse() * there.rotation).angle() < 0.2
            };
            let by_words = || chosen.iter().any(|k| found[*k].seam.key_frame == here.id);
            let shows = by_words() || self.seam(snapshot, here, place.id).is_some_and(agrees);
            expected.push((here.id, shows));
        }
        expected
    }
}

/// How many key frames show the other map where they stand in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Support {
    /// Key frames that show it.
    pub shown: usize,
    /// Key frames that should.
    pub expected: usize,
}

impl Support {
    fn of(expected: &[(KeyFrameId, bool)]) -> Self {
        Self { shown: expected.iter().filter(|(_, shows)| *shows).count(), expected: expected.len() }
    }
}
