//! No rule is broken on any walk, and a seed is the same walk every time.

use cairn_faults::{Scenario, walk, walks, watched};

#[test]
fn a_seed_is_the_same_walk_every_time() {
    for seed in 0..20 {
        let scenario = Scenario::of(seed);
        let first = walk(&scenario);
        assert_eq!(first, walk(&scenario), "{scenario}");
        assert_eq!(first.digest, watched(&scenario).0.digest, "watching {scenario} changes it");
    }
}

#[test]
fn no_rule_is_broken_on_walks_with_fixed_seeds() {
    let tally = walks(0..1000, 2, false);
    assert!(tally.broken.is_empty(), "{:?}", tally.broken);
}
