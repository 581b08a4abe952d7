//! The model: what a robot of a team pays, from what a single one does.
//!
//! Assumptions, all as the program works today:
//!
//! 1. Robots walk all the time where nobody was, so that each makes key frames at the measured rate, and all have as many.
//! 2. A team falls into groups of equal size; within one all share places, between two none do. Words go to all, maps to all
//!    of the group, each to each (no broadcast), what local mapping moved again; each robot sends as much as any other.
//! 3. A robot keeps the maps of its group in memory twice: in pieces, with what they said before, to be passed on, and as the shared
//!    atlas; and the words of all robots.
//! 4. Words of all are compared anew, and the shared atlas is made anew from all maps, as often as maps come. Between robots that
//!    share places a few key frames settle it; between others all are compared.
//! 5. Making it joins one map after the other with what there is: each key frame is compared and the pose graph relaxed. Up
//!    to a certain size all is adjusted as a whole whenever it has grown by half and at the end, beyond it at each join around the seams.
//! 6. Key frames look as much alike as those of one house; what is longer than what was measured grows like it.

use super::budget::{Budgets, Resource};
use super::costs::Costs;
use serde::Serialize;

/// Bytes of a word in memory: its number and weight, and an entry of the list of its key frames.
const WORD_BYTES: f64 = 24.0;

/// A team.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Team {
    /// Robots.
    pub robots: usize,
    /// Key frames of all together.
    pub key_frames: f64,
    /// Robots that share places with each other, itself included.
    pub group: usize,
}

/// What a robot of a team pays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Load {
    /// Bytes sent in a second.
    pub bandwidth: f64,
    /// Of which maps,
    pub bandwidth_maps: f64,
    /// words,
    pub bandwidth_words: f64,
    /// and what it says it has.
    pub bandwidth_have: f64,
    /// Bytes of memory; `None` where a key frame's are not known.
    pub memory: Option<f64>,
    /// Bytes of maps that a peer holds.
    pub held: f64,
    /// Seconds of a query.
    pub query_s: f64,
    /// Seconds to compare all words.
    pub compare_s: f64,
    /// Seconds to make the shared atlas.
    pub atlas_s: f64,
    /// Seconds to relax its pose graph.
    pub relax_s: f64,
}

impl Team {
    /// Robots that share places with one, itself included.
    fn near(&self) -> f64 {
        self.group.clamp(1, self.robots.max(1)) as f64
    }

    /// Key frames of the maps that a robot has.
    fn near_key_frames(&self) -> f64 {
        self.key_frames * self.near() / self.robots.max(1) as f64
    }

    /// What each robot pays.
    pub fn load(&self, costs: &Costs) -> Load {
        let (robots, near, n) = (self.robots.max(1) as f64, self.near(), self.near_key_frames());
        let rate = costs.key_frames_per_s();
        let maps = rate * (near - 1.0) * costs.map_bytes * costs.sent_again;
        let words = rate * (robots - 1.0) * costs.words_bytes;
        let have = (robots - 1.0) * costs.have_bytes.at(robots);
        let held = n * costs.map_bytes * costs.sent_again;
        let all_words = self.key_frames * (costs.words_bytes + costs.words * WORD_BYTES);
        let own = self.key_frames / robots;
        Load {
            bandwidth: maps + words + have,
            bandwidth_maps: maps,
            bandwidth_words: words,
            bandwidth_have: have,
            memory: costs.memory_bytes.map(|each| n * each + held + all_words),
            held,
            query_s: costs.query_s.at(n),
            compare_s: self.key_frames * (self.key_frames - n) * costs.compare_s,
            atlas_s: costs.merge_s(near as usize, own),
            relax_s: costs.relax_s.at(n),
        }
    }

    /// The largest number of key frames, of all robots together, with which a budget is kept; infinite where it does not depend on
    /// them, zero where it is broken without any.
    pub fn most_key_frames(&self, costs: &Costs, budgets: &Budgets, resource: Resource) -> f64 {
        let broken = |key_frames: f64| {
            Self { key_frames, ..*self }
                .load(costs)
                .of(resource)
                .is_some_and(|load| load > budgets.of(resource))
        };
        if broken(0.0) {
            return 0.0;
        }
        let (mut kept, mut over) = (0.0, 1.0);
        while !broken(over) {
            (kept, over) = (over, over * 2.0);
            if over > 1e15 {
                return f64::INFINITY;
            }
        }
        while over - kept > 1e-3 * over {
            let middle = 0.5 * (kept + over);
            *(if broken(middle) { &mut over } else { &mut kept }) = middle;
        }
        kept
    }
}

impl Load {
    /// That of a resource; `None` where it is not known.
    pub fn of(&self, resource: Resource) -> Option<f64> {
        Some(match resource {
            Resource::Bandwidth => self.bandwidth,
            Resource::Memory => self.memory?,
            Resource::Held => self.held,
            Resource::Query => self.query_s,
            Resource::Compare => self.compare_s,
            Resource::Atlas => self.atlas_s,
            Resource::Relax => self.relax_s,
        })
    }

    /// What is over its budget, with how many times, worst first.
    pub fn broken(&self, budgets: &Budgets) -> Vec<(Resource, f64)> {
        let times = |r: Resource| Some((r, self.of(r)? / budgets.of(r)));
        let mut broken: Vec<_> =
            Resource::ALL.into_iter().filter_map(times).filter(|(_, t)| *t > 1.0).collect();
        broken.sort_by(|a, b| b.1.total_cmp(&a.1));
        broken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::team_scale::costs::{Power, Straight};

    /// Round costs.
    fn costs() -> Costs {
        Costs {
            key_frames: 100,
            walked_s: 50.0,
            words: 500.0,
            words_bytes: 600.0,
            map_bytes: 30e3,
            sent_again: 1.2,
            memory_bytes: Some(60e3),
            have_bytes: Straight { at_zero: 50.0, each: 20.0 },
            query_s: Straight { at_zero: 1e-4, each: 2e-7 },
            compare_s: 1e-7,
            join_s: 4e-3,
            around_s: 5e-3,
            adjust_s: 2e-3,
            adjusted_as_a_whole: 1000,
            edges: 4.0,
            relax_s: Power { factor: 1e-5, exponent: 1.3 },
        }
    }

    const BUDGETS: Budgets =
        Budgets { bandwidth: 100e3, memory: 8e9, held: 512e6, query_s: 0.1, renew_s: 8.0, relax_s: 5.0 };

    /// Two robots with 50 key frames each, by hand.
    #[test]
    fn a_small_team_by_hand() {
        let load = Team { robots: 2, key_frames: 100.0, group: 2 }.load(&costs());
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        near(load.bandwidth, 2.0 * (30e3 * 1.2 + 600.0) + 90.0);
        near(load.memory.unwrap(), 100.0 * (60e3 + 30e3 * 1.2 + 600.0 + 12e3));
        near(load.query_s, 1.2e-4);
        assert_eq!(load.compare_s, 0.0);
        let apart = Team { robots: 2, key_frames: 100.0, group: 1 }.load(&costs());
        near(apart.compare_s, 100.0 * 50.0 * 1e-7);
        near(load.atlas_s, 50.0 * 4e-3 + 100.0 * 2e-3 + 1e-5 * 100f64.powf(1.3));
        assert_eq!(load.broken(&BUDGETS), []);
    }

    /// Four robots with 50 key frames each, by hand: two maps are twice one, three half as many again, four are all.
    #[test]
    fn many_maps_are_adjusted_when_they_have_grown_by_half_and_at_the_end() {
        let atlas_s = |robots, key_frames| {
            let load = Team { robots, key_frames, group: robots }.load(&costs());
            let relaxed = (2..=robots).map(|k| 1e-5 * (key_frames * k as f64 / robots as f64).powf(1.3));
            load.atlas_s - relaxed.sum::<f64>()
        };
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        near(atlas_s(4, 200.0), 150.0 * 4e-3 + (100.0 + 150.0 + 200.0) * 2e-3);
        // Five: not four, which are less than half more than three.
        near(atlas_s(5, 250.0), 200.0 * 4e-3 + (100.0 + 150.0 + 250.0) * 2e-3);
        // Larger than what is adjusted as a whole: around each place, at once.
        near(atlas_s(2, 2000.0), 1000.0 * (4e-3 + 5e-3));
    }

    /// Robots in groups of their own pay for maps what their group costs, and for words what the team costs.
    #[test]
    fn groups_that_share_no_place_cost_each_other_words_only() {
        let alone = Team { robots: 4, key_frames: 4e3, group: 4 }.load(&costs());
        let apart = Team { robots: 40, key_frames: 4e4, group: 4 }.load(&costs());
        assert_eq!(alone.bandwidth_maps, apart.bandwidth_maps);
        assert_eq!((alone.held, alone.query_s, alone.atlas_s), (apart.held, apart.query_s, apart.atlas_s));
        assert!((apart.bandwidth_words / alone.bandwidth_words - 13.0).abs() < 1e-9);
        assert!(apart.memory > alone.memory);
        // A group cannot be larger than the team.
        let larger = Team { robots: 4, key_frames: 4e3, group: 9 };
        assert_eq!(larger.load(&costs()), alone);
    }

    #[test]
    fn the_most_key_frames_are_those_that_just_keep_the_budget() {
        let team = Team { robots: 8, key_frames: 0.0, group: 6 };
        for resource in Resource::ALL.into_iter().filter(|r| *r != Resource::Bandwidth) {
            let most = team.most_key_frames(&costs(), &BUDGETS, resource);
            let at = |key_frames| Team { key_frames, ..team }.load(&costs()).of(resource).unwrap();
            let budget = BUDGETS.of(resource);
            assert!(at(most) <= budget && at(1.01 * most) > budget, "{resource}: {most}");
        }
        // Bandwidth depends on robots, not on key frames: six that meet are too many here, two are not.
        assert_eq!(team.most_key_frames(&costs(), &BUDGETS, Resource::Bandwidth), 0.0);
        let two = Team { robots: 2, ..team };
        assert_eq!(two.most_key_frames(&costs(), &BUDGETS, Resource::Bandwidth), f64::INFINITY);
        let unknown = Costs { memory_bytes: None, ..costs() };
        assert_eq!(two.most_key_frames(&unknown, &BUDGETS, Resource::Memory), f64::INFINITY);
    }
}
