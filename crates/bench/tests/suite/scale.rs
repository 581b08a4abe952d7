//! One camera and a turn on the spot: the unit of length is not invented in silence.

use bench::recordings::data_folder;
use cairn_engine::{Config, Engine, Host, Runner, ScaleStretch, SensorMode};
use cairn_eval::{Align, EvalOptions, evaluate};
use cairn_geometry::{Se3, Trajectory, Vec3};
use cairn_sensor::Stamp;
use cairn_sources::{OpenOptions, open};

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
fn after_the_turn(left_out_s: f64) -> Option<Turned> {
    let folder = data_folder().join("atrium");
    if !folder.exists() {
        println!("skipped: {} is missing", folder.display());
        return None;
    }
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default()).unwrap();
    let (rig, rate_hz) = (source.rig().clone(), source.info().rate_hz);
    let truth = source.info().truth.clone();
    let mut engine =
        Engine::new(&rig, SensorMode::Mono, rate_hz, Runner::Lockstep, &Config::default(), &Host::bare())
            .unwrap();
    let (mut first, mut frames, mut posed, mut unknown) = (None, 0, 0, 0);
    let (mut live, mut jump) = (None, 0.0_f64);
    while let Some(packet) = source.next_packet().unwrap() {
        if packet.stamp - *first.get_or_insert(packet.stamp) < left_out_s {
            continue;
        }
        let output = engine.on_packet(&packet).unwrap();
        frames += 1;
        posed += usize::from(output.pose.is_some());
        unknown += usize::from(output.pose.is_some_and(|p| !p.scale.is_known()));
        if let Some(pose) = output.world_from_body() {
            let at = pose.se3.translation;
            jump = live.replace(at).map_or(jump, |last: Vec3| jump.max((at - last).norm()));
        }
    }
    engine.finish();
    assert!(posed as f64 > 0.97 * frames as f64, "{posed} of {frames} frames have a pose");

    let (reference, poses) = (trajectory(&engine.comparable(&truth)), engine.trajectory());
    let start = first.unwrap();
    let metres_per_unit = |inside: &dyn Fn(f64) -> bool| {
        let own: Vec<_> = poses.iter().filter(|(t, _)| inside(*t - start)).copied().collect();
        let options = EvalOptions { align: Align::Sim3, ..EvalOptions::default() };
        evaluate(&reference, &trajectory(&own), &options).unwrap().scale
    };
    let (before, after) = (metres_per_unit(&|t| t < TURN_S[0]), metres_per_unit(&|t| t > TURN_S[1] + 1.5));
    println!("metres per unit {before:.4} before the turn, {after:.4} after it");
    let (off, jump_m) = ((after / before).ln(), jump * before);
    println!("the live position moves by at most {jump_m:.3} m from frame to frame");
    Some(Turned { stretches: engine.scale_stretches(), unknown, off, jump_m })
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
    after_the_turn(48.0).iter().for_each(check);
}

#[test]
fn the_unit_after_a_turn_and_a_lap_is_reported_and_near() {
    after_the_turn(0.0).iter().for_each(check);
}
