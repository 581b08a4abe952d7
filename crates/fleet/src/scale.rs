//! The model: what a build of many walks costs, from the report of one that was done.
//!
//! Assumptions, all as the program works today:
//!
//! 1. Mapping costs in proportion to seconds recorded; a walk makes key frames at the measured rate.
//! 2. Keys of places are looked up in proportion to key frames. Shards have 256 maps; one task sorts all keys, in memory.
//! 3. Each walk shares places with `meets` others; of the pairs that look alike by words as many are right as in the report.
//! 4. An atlas is `together` walks; within one task each joins those before it, as a robot of a team joins maps
//!    ([`cairn::team_scale`]): each key frame is compared, the pose graph relaxed, and up to a certain size all adjusted as a whole.
//! 5. Tiles and their bytes grow with key frames: nothing is thinned where many walked.

use cairn::team_scale::Costs;
use serde::{Deserialize, Serialize};

/// Maps in a shard of the index of places.
const SHARD: f64 = 256.0;

/// What the model needs of the report of `cairn fleet build --json`.
#[derive(Clone, Debug, Deserialize)]
pub struct Built {
    maps: f64,
    key_frames: f64,
    recorded_s: f64,
    candidates: f64,
    verified: f64,
    tiles: f64,
    tile_bytes: f64,
    costs: Vec<StepCost>,
}

#[derive(Clone, Debug, Deserialize)]
struct StepCost {
    step: String,
    tasks: f64,
    reused: f64,
    seconds: f64,
    read_bytes: f64,
    written_bytes: f64,
}

/// A build to be estimated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct City {
    /// Walks.
    pub walks: f64,
    /// Seconds of each.
    pub walk_s: f64,
    /// Other walks that each shares places with.
    pub meets: f64,
    /// Walks that become one atlas.
    pub together: f64,
}

/// What a step costs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StepLoad {
    /// The step.
    pub step: &'static str,
    /// Tasks.
    pub tasks: f64,
    /// Seconds of one core, all tasks together.
    pub seconds: f64,
    /// Seconds of the longest task: more machines make no step shorter than that.
    pub longest_s: f64,
    /// Bytes read from the store.
    pub read_bytes: f64,
    /// Bytes written to it.
    pub written_bytes: f64,
    /// Memory that the largest task needs for maps; `None` where it is not known.
    pub memory_bytes: Option<f64>,
}

/// Why no costs can be taken from the report of a build.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReportError {
    /// There is nothing to join.
    #[error("it has fewer than two maps")]
    FewMaps,
    /// Nothing was joined.
    #[error("no two of its recordings share a place")]
    NoSharedPlace,
    /// It was resumed.
    #[error(
        "{reused} of {tasks} tasks of the step {step} had been done before, so that their costs are not in it"
    )]
    DoneBefore {
        /// The step.
        step: String,
        /// Tasks that had been done before.
        reused: f64,
        /// Of so many.
        tasks: f64,
    },
    /// A step is not in it.
    #[error("the step {0} is missing")]
    MissingStep(&'static str),
}

impl Built {
    /// Whether costs can be taken from it.
    ///
    /// # Errors
    /// With what is missing.
    pub fn check(&self) -> Result<(), ReportError> {
        if !(self.maps >= 2.0 && self.key_frames > 0.0 && self.recorded_s > 0.0) {
            return Err(ReportError::FewMaps);
        }
        if !(self.candidates > 0.0 && self.verified > 0.0 && self.tiles > 0.0) {
            return Err(ReportError::NoSharedPlace);
        }
        if let Some(cost) = self.costs.iter().find(|c| c.reused > 0.0) {
            let StepCost { step, reused, tasks, .. } = cost.clone();
            return Err(ReportError::DoneBefore { step, reused, tasks });
        }
        for step in ["map", "index", "pairs", "verify", "tiles", "publish"] {
            self.of(step).ok_or(ReportError::MissingStep(step))?;
        }
        Ok(())
    }

    fn of(&self, step: &str) -> Option<&StepCost> {
        self.costs.iter().find(|c| c.step == step)
    }
}

impl City {
    /// What each step costs, from a report that was checked and what joining costs; empty where the report lacks a step.
    pub fn load(&self, built: &Built, costs: &Costs) -> Vec<StepLoad> {
        self.steps(built, costs).unwrap_or_default()
    }

    fn steps(&self, built: &Built, costs: &Costs) -> Option<Vec<StepLoad>> {
        let [map, index, pairs, verify, tiles, publish] =
            ["map", "index", "pairs", "verify", "tiles", "publish"].map(|step| built.of(step));
        let (map, index, pairs, verify, tiles, publish) = (map?, index?, pairs?, verify?, tiles?, publish?);
        let own = built.key_frames / built.recorded_s * self.walk_s;
        let all = own * self.walks;
        // A walk beside those of the report.
        let longer = own / (built.key_frames / built.maps);
        let shards = (self.walks / SHARD).ceil();
        let atlases = (self.walks / self.together).ceil();
        let atlas = own * self.together;
        let candidates = 0.5 * self.walks * self.meets * built.candidates / built.verified;
        let map_bytes = map.written_bytes / built.key_frames;
        let words = index.written_bytes / built.key_frames;
        let memory = |key_frames: f64| costs.memory_bytes.map(|one| one * key_frames);
        let step = |step, tasks: f64, seconds: f64, longest_s, read_bytes, written_bytes, memory_bytes| {
            StepLoad { step, tasks, seconds, longest_s, read_bytes, written_bytes, memory_bytes }
        };
        let mapping = map.seconds / built.recorded_s * self.walk_s;
        let pairs_s = pairs.seconds / built.key_frames * all;
        let verify_s = verify.seconds / built.candidates * longer;
        let merge_s = costs.merge_s(self.together as usize, own);
        let merged = if self.together > 1.0 { atlases } else { 0.0 };
        let tile_s = tiles.seconds / built.key_frames;
        let tile_bytes = built.tile_bytes / built.key_frames;
        let publish_bytes = publish.read_bytes / built.key_frames;
        Some(vec![
            step("map", self.walks, mapping * self.walks, mapping, 0.0, map_bytes * all, memory(own)),
            step(
                "index",
                shards,
                index.seconds / built.key_frames * all,
                0.0,
                words * all,
                words * all,
                None,
            ),
            step("pairs", 1.0, pairs_s, pairs_s, words * all, 0.0, None),
            step(
                "verify",
                candidates,
                verify_s * candidates,
                verify_s,
                2.0 * candidates * own * map_bytes,
                0.0,
                memory(2.0 * own),
            ),
            step("merge", merged, merge_s * merged, merge_s, all * map_bytes, all * map_bytes, memory(atlas)),
            step(
                "tiles",
                atlases,
                tile_s * all,
                tile_s * atlas,
                all * map_bytes,
                all * tile_bytes,
                memory(atlas),
            ),
            step(
                "publish",
                1.0,
                publish.seconds / built.key_frames * all,
                publish.seconds / built.key_frames * all,
                publish_bytes * all,
                publish_bytes * all,
                None,
            ),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn::team_scale::{Power, Straight};

    fn built() -> Built {
        let step = |step: &str, tasks: f64, seconds: f64| StepCost {
            step: step.into(),
            tasks,
            reused: 0.0,
            seconds,
            read_bytes: 1e6,
            written_bytes: 3e6,
        };
        Built {
            maps: 10.0,
            key_frames: 200.0,
            recorded_s: 100.0,
            candidates: 6.0,
            verified: 5.0,
            tiles: 12.0,
            tile_bytes: 8e6,
            costs: ["map", "index", "pairs", "verify", "tiles", "publish"]
                .map(|name| step(name, 10.0, 9.0))
                .into(),
        }
    }

    fn costs() -> Costs {
        Costs {
            key_frames: 100,
            walked_s: 50.0,
            words: 500.0,
            words_bytes: 600.0,
            map_bytes: 30e3,
            sent_again: 1.2,
            memory_bytes: Some(100e3),
            have_bytes: Straight { at_zero: 0.0, each: 0.0 },
            query_s: Straight { at_zero: 0.0, each: 0.0 },
            compare_s: 1e-7,
            join_s: 1e-2,
            around_s: 5e-3,
            adjust_s: 1e-3,
            adjusted_as_a_whole: 1000,
            edges: 4.0,
            relax_s: Power { factor: 1e-5, exponent: 1.0 },
        }
    }

    fn of(load: &[StepLoad], step: &str) -> StepLoad {
        load.iter().find(|l| l.step == step).cloned().unwrap()
    }

    #[test]
    fn a_city_by_hand() {
        let city = City { walks: 1000.0, walk_s: 20.0, meets: 10.0, together: 2.0 };
        let load = city.load(&built(), &costs());
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        // 40 key frames a walk, twice as many as in the report.
        near(of(&load, "map").seconds, 9.0 / 100.0 * 20.0 * 1000.0);
        near(of(&load, "map").written_bytes, 3e6 / 200.0 * 40_000.0);
        near(of(&load, "pairs").seconds, 9.0 / 200.0 * 40_000.0);
        near(of(&load, "pairs").tasks, 1.0);
        near(of(&load, "verify").tasks, 6000.0);
        near(of(&load, "merge").longest_s, 40.0 * 1e-2 + 80.0 * 1e-5 + 80.0 * 1e-3);
        near(of(&load, "merge").memory_bytes.unwrap(), 80.0 * 100e3);
        near(of(&load, "tiles").written_bytes, 8e6 / 200.0 * 40_000.0);
    }

    /// With ten times as many walks, of which each meets as many others, nothing costs more than ten times as much.
    #[test]
    fn costs_grow_as_they_must() {
        let city = |walks| City { walks, walk_s: 10.0, meets: 4.0, together: 10.0 }.load(&built(), &costs());
        let (less, more) = (city(1e4), city(1e5));
        let times = |step: &str| of(&more, step).seconds / of(&less, step).seconds;
        assert!((times("map") - 10.0).abs() < 1e-9 && (times("verify") - 10.0).abs() < 1e-9);
        assert!((times("pairs") - 10.0).abs() < 1e-9);
        assert_eq!(of(&less, "merge").longest_s, of(&more, "merge").longest_s);
    }

    #[test]
    fn reports_without_costs_are_refused() {
        assert_eq!(built().check(), Ok(()));
        let mut again = built();
        again.costs[0].reused = 10.0;
        assert!(again.check().unwrap_err().to_string().contains("done before"));
        let mut short = built();
        short.costs.pop();
        assert!(short.check() == Err(ReportError::MissingStep("publish")));
        assert!(Built { verified: 0.0, ..built() }.check() == Err(ReportError::NoSharedPlace));
    }
}
