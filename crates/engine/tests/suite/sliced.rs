//! Mapping and closing in slices between frames: with all slices before the next frame the same bits as in lockstep, with few of them
//! a map that lags and is joined all the same.

use super::journal::{engine, walk};
use cairn_engine::{Config, Engine, Output, Runner};
use cairn_sim::SimSensor;

/// The walk with at most so many slices between two frames; and the most that there were to do at once.
fn run(runner: Runner, most: usize) -> (Engine, Vec<Output>, usize) {
    let mut engine = engine(SimSensor::Rgbd, runner, &Config::default());
    let mut longest = 0;
    let outputs = walk().iter().map(|packet| {
        let output = engine.on_packet(packet).unwrap();
        longest = longest.max((0..most).take_while(|_| engine.work()).count());
        output
    });
    let outputs: Vec<Output> = outputs.collect();
    engine.finish();
    engine.snapshot().check().unwrap();
    (engine, outputs, longest)
}

fn tracked(outputs: &[Output]) -> usize {
    outputs.iter().filter(|output| output.pose.is_some()).count()
}

#[test]
fn all_slices_before_the_next_frame_give_the_bits_of_lockstep() {
    let (lockstep, _, none) = run(Runner::Lockstep, usize::MAX);
    let (sliced, outputs, longest) = run(Runner::Sliced, usize::MAX);
    assert_eq!(none, 0, "lockstep has none");
    assert!(longest > 100, "a key frame has {longest} slices");
    assert_eq!(sliced.digest(), lockstep.digest());
    assert_eq!(sliced.trajectory(), lockstep.trajectory());
    assert_eq!(sliced.snapshot().maps().count(), 1, "the maps are joined");
    assert!(outputs.iter().all(|output| output.stage_failed().is_none()));
}

#[test]
fn few_slices_between_frames_lag_and_lose_nothing() {
    let (lockstep, all, _) = run(Runner::Lockstep, 0);
    let (engine, outputs, longest) = run(Runner::Sliced, 40);
    assert_eq!(longest, 40, "there is more to do than is done");
    assert!(tracked(&outputs) + 3 >= tracked(&all), "{} of {}", tracked(&outputs), tracked(&all));
    assert_eq!(engine.snapshot().maps().count(), lockstep.snapshot().maps().count());
    assert_eq!(engine.digest(), run(Runner::Sliced, 40).0.digest(), "the same slices give the same bits");
}

#[test]
fn what_nobody_works_on_is_done_at_the_end() {
    let (engine, ..) = run(Runner::Sliced, 0);
    assert!(engine.snapshot().key_frame_count() >= 2, "{}", engine.snapshot().key_frame_count());
}
