//! The descriptor's tests are what the tool learns, bit for bit.

#[path = "../examples/learn_pattern/learn.rs"]
mod learn;
#[path = "../examples/learn_pattern/patches.rs"]
mod patches;
#[path = "../examples/learn_pattern/scene.rs"]
mod scene;

#[test]
fn the_tool_learns_the_committed_pattern_again() {
    let committed = include_str!("../src/orb/pattern.rs");
    assert!(
        learn::regenerate() == committed,
        "src/orb/pattern.rs is not what the example learn_pattern prints"
    );
}
