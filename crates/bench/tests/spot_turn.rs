//! A phone's walker who turns on the spot to what the map does not show, and sets out: he is where he is said to be.

use bench::visual_inertial::spot::{Walk, walk};
use cairn_engine::{Config, State};

/// Judged by the truth, relative to the way out as the map has it.
#[test]
fn nobody_is_moved_by_a_turn_on_the_spot_and_the_first_steps_after_it() {
    for seed in [1, 2, 4] {
        let steps = walk(&Walk { seed, metres: [20.0, 4.0], delays: None }, &Config::default()).unwrap();
        let carried = steps.iter().filter(|s| matches!(s.state, State::Coasting { .. })).count();
        assert!(2 * carried > steps.len(), "seed {seed}: the map does not show what he turns to");
        let most = steps.iter().filter_map(|s| s.off).map(|off| off.norm()).fold(0.0, f64::max);
        let step = |w: &[bench::visual_inertial::spot::Step]| Some((w[1].off? - w[0].off?).norm());
        let jump = steps.windows(2).filter_map(step).fold(0.0, f64::max);
        println!("seed {seed}: at most {most:.3} m off, {jump:.3} m at once");
        assert!(most < 0.8 && jump < 0.3, "seed {seed}: {most} m off, {jump} m at once");
    }
}
