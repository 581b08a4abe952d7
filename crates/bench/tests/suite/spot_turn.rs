//! A phone's walker who turns on the spot to what the map does not show, and sets out: he is where he is said to be.

use bench::spot::{Step, Walk, walk};
use cairn_engine::{Config, State};

/// Judged by the truth, relative to the way out as the map has it.
#[test]
fn nobody_is_moved_by_a_turn_on_the_spot_and_the_first_steps_after_it() {
    for seed in [1, 2, 4] {
        let out_and_back = Walk {
            seed,
            metres: [20.0, 4.0],
            backwards_after_s: None,
            every: 1,
            delays: None,
            guessed_lens: false,
        };
        let steps = walk(&out_and_back, &Config::default(), false).unwrap().steps;
        let carried = steps.iter().filter(|s| matches!(s.state, State::Coasting { .. })).count();
        assert!(2 * carried > steps.len(), "seed {seed}: the map does not show what he turns to");
        let most = steps.iter().filter_map(|s| s.off).map(|off| off.norm()).fold(0.0, f64::max);
        let step = |w: &[Step]| Some((w[1].off? - w[0].off?).norm());
        let jump = steps.windows(2).filter_map(step).fold(0.0, f64::max);
        println!("seed {seed}: at most {most:.3} m off, {jump:.3} m at once");
        assert!(most < 0.8 && jump < 0.3, "seed {seed}: {most} m off, {jump} m at once");
    }
}

/// The way out ends with a turn towards a wall that the map does not show. While he stands nothing can be triangulated, and he is not
/// lost for that: the motion sensors carry the pose, and his first steps back show landmarks.
#[test]
fn one_who_stands_where_the_map_shows_nothing_walks_home_backwards() {
    let stands = Walk {
        seed: 1,
        metres: [20.0, 4.0],
        backwards_after_s: Some(18.0),
        every: 1,
        delays: None,
        guessed_lens: false,
    };
    let steps = walk(&stands, &Config::default(), false).unwrap().steps;
    let standing: Vec<_> = steps.iter().filter(|s| s.t_s < 0.0).collect();
    let seen = standing.iter().filter(|s| s.inliers > 0).count();
    println!("{seen} of {} frames show landmarks", standing.len());
    assert!(2 * seen < standing.len(), "{seen} of {}: the map shows the wall", standing.len());
    let lost = steps.iter().filter(|s| s.off.is_none()).count();
    let most = steps.iter().filter_map(|s| s.off).map(|off| off.norm()).fold(0.0, f64::max);
    let last = steps.last().map(|s| (s.state, s.inliers));
    println!("{} frames without landmarks, {lost} without a pose, at most {most:.3} m off", standing.len());
    assert!(lost == 0 && most < 0.25, "{lost} lost, {most} m off");
    assert!(matches!(last, Some((State::Tracking, 100..))), "{last:?}");
}

/// The gyroscope tells within seconds that a guess is a sixth too short: the walk goes on with a better one, and its lengths are about
/// right. A guess that is nearly right stays.
#[test]
fn a_guessed_lens_that_the_gyroscope_contradicts_is_replaced_before_lengths_are_told() {
    for (seed, is_wrong) in [(6, true), (2, false)] {
        let out = Walk {
            seed,
            metres: [20.0, 2.0],
            backwards_after_s: None,
            every: 1,
            guessed_lens: true,
            delays: None,
        };
        let walked = walk(&out, &Config::default(), false).unwrap();
        println!("seed {seed}: focal length off {:?}, {:?}", walked.focal, walked.live);
        assert_eq!(walked.focal.len(), 1 + usize::from(is_wrong), "seed {seed}: {:?}", walked.focal);
        if let [_, [off, from_s]] = walked.focal[..] {
            assert!(off.abs() < 5.0 && Some(from_s) < walked.metric_s, "{off} % after {from_s} s");
        }
        assert!(walked.live.worst_percent < 20.0, "seed {seed}: {:?}", walked.live);
    }
}
