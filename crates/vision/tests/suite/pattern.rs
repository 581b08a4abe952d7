//! The committed descriptor pattern is exactly the output of the example that learns it.

#[path = "../../examples/learn_pattern/learn.rs"]
mod learn;
#[path = "../../examples/learn_pattern/patches.rs"]
mod patches;
#[path = "../../examples/learn_pattern/scene.rs"]
mod scene;

#[test]
fn learned_pattern_equals_the_committed_one() {
    let committed = include_str!("../../src/orb/pattern.rs");
    assert!(
        learn::regenerate() == committed,
        "src/orb/pattern.rs is not what the example learn_pattern prints"
    );
}
