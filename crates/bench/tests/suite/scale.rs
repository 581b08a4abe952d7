//! One camera and a turn on the spot: the unit of length is not invented in silence.

use crate::run::{Chosen, run};
use cairn_engine::{ScaleStretch, SensorMode};
use cairn_eval::{Align, EvalOptions, evaluate};
use cairn_geometry::{Se3, Trajectory, Vec3};
use cairn_sensor::Stamp;

/// When the camera turns about in the recording, seconds from its first frame.
const TURN_S: [f64; 2] = [64.5, 67.5];

fn trajectory(poses: &[(Stamp, Se3)]) -> Trajectory {
    Trajectory::from_unsorted(poses.iter().map(|(t, pose)| (t.0, *pose)).collect()).unwrap()
}

/// What came of a part of the recording.
struct Turned {
    stretches: Vec<ScaleStretch>,
    /// Frames that said that their unit of length is not known.
    unknown: usize,
    /// By how much the unit after the turn differs from the one before it, as a logarithm.
    off: f64,
    /// The farthest that the live position moved from one frame to the next, metres by the unit before the turn.
    jump_m: f64,
}

/// Runs the recording from `left_out_s` on; `None` where it is missing.
fn after_the_turn(left_out_s: u32) -> Option<Turned> {
    let run = run(Chosen { recording: "atrium", mode: SensorMode::Mono, imu: false, left_out_s })?;
    let (frames, mut posed, mut unknown) = (run.outputs.len(), 0, 0);
    let (mut live, mut jump) = (None, 0.0_f64);
    for output in &run.outputs {
        posed += usize::from(output.pose.is_some());
        unknown += usize::from(output.pose.is_some_and(|p| !p.scale.is_known()));
        if let Some(pose) = output.world_from_body() {
            let at = pose.se3.translation;
            jump = live.replace(at).map_or(jump, |last: Vec3| jump.max((at - last).norm()));
        }
    }
    assert!(posed as f64 > 0.97 * frames as f64, "{posed} of {frames} frames have a pose");

    let truth: Vec<_> = run.truth.iter().map(|(t, pose)| (*t, *pose)).collect();
    let (reference, poses) = (trajectory(&truth), &run.trajectory);
    let metres_per_unit = |inside: &dyn Fn(f64) -> bool| {
        let own: Vec<_> = poses.iter().filter(|(t, _)| inside(*t - run.began)).copied().collect();
        let options = EvalOptions { align: Align::Sim3, ..EvalOptions::default() };
        evaluate(&reference, &trajectory(&own), &options).unwrap().scale
    };
    let (before, after) = (metres_per_unit(&|t| t < TURN_S[0]), metres_per_unit(&|t| t > TURN_S[1] + 1.5));
    println!("metres per unit {before:.4} before the turn, {after:.4} after it");
    let (off, jump_m) = ((after / before).ln(), jump * before);
    println!("the live position moves by at most {jump_m:.3} m from frame to frame");
    Some(Turned { stretches: run.stretches.clone(), unknown, off, jump_m })
}

/// What follows a turn without parallax is a map of its own, which says so, and how well its unit is known. Where one map goes
/// on, its unit does.
fn check(turned: &Turned) {
    let Turned { stretches, unknown, off, jump_m } = turned;
    // One that walks at 1.2 m/s moves 6 cm in a frame; the rest is the new map's unit being put right. 10 % above today's.
    assert!(*jump_m < 0.44, "{jump_m}");
    match stretches.as_slice() {
        [_] => assert!(off.abs() < 0.03, "the unit changed by {off} without a word"),
        [before, after] => {
            assert_eq!(before.scale.sigma_log, 0.0, "the first map is what others are compared with");
            assert!((0.05..0.3).contains(&after.scale.sigma_log), "{after:?}");
            assert!(
                *unknown >= after.poses,
                "{unknown} frames said so, {} are in a unit of their own",
                after.poses
            );
            assert!(off.abs() < after.scale.sigma_log, "the unit is off by more than it says: {off}");
        }
        more => panic!("{more:#?}"),
    }
}

#[test]
fn the_unit_after_a_turn_late_in_a_walk_is_reported_and_near() {
    after_the_turn(48).iter().for_each(check);
}

#[test]
fn the_unit_after_a_turn_and_a_lap_is_reported_and_near() {
    after_the_turn(0).iter().for_each(check);
}
