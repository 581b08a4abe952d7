//! Each phase, with hand-made packet results.

use super::*;
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_geometry::Vec3;
use cairn_inertial::{Attempt, Failed, GateKind};
use cairn_mapping::{Accepted, Joined, Verdict};
use cairn_sensor::{ImuSample, Stamp};
use cairn_tracking::State;

const PERIOD_S: f64 = 0.005;

fn map(n: usize) -> MapId {
    MapId(KeyFrameId::from_index(n).unwrap())
}

fn reading(t: f64) -> ImuSample {
    ImuSample::new(Stamp::from_seconds(t), Vec3::zeros(), Vec3::z())
}

fn attempt(gates: &[(GateKind, bool)]) -> Attempt {
    let gate =
        |(kind, passed): &(GateKind, bool)| Gate { kind: *kind, value: 0.5, bound: 1.0, passed: *passed };
    Attempt { gates: gates.iter().map(gate).collect(), found: None }
}

/// A frame at `t` that is tracked in map 0, of unknown scale.
fn tracked(t: f64, imu: &[ImuSample]) -> FrameResult<'_> {
    FrameResult {
        stamp: Stamp::from_seconds(t),
        imu,
        imu_fault: (None, 0),
        state: State::Tracking,
        map: Some((map(0), false)),
        metric: false,
        map_created: false,
        others: false,
        points: 120,
        attempt: None,
        scale_check: None,
        verdicts: &[],
        stage_failed: None,
        mapping: true,
    }
}

fn without_pose(t: f64, imu: &[ImuSample], state: State) -> FrameResult<'_> {
    FrameResult { state, map: None, points: 0, ..tracked(t, imu) }
}

fn mono(period_s: Option<f64>) -> StatusTracker {
    StatusTracker::new(false, period_s, &Snapshot::new())
}

fn after(tracker: &mut StatusTracker, result: &FrameResult) -> Phase {
    tracker.update(result);
    tracker.status().phase
}

#[test]
fn phase_names_match_the_contract() {
    let names = Phase::ALL.map(Phase::name);
    let contract =
        "LOADING_VOCAB WAIT_FRAMES WAIT_IMU WAIT_MOTION INITIALIZING TRACKING COASTING LOST RESETTING ERROR";
    assert_eq!(names.join(" "), contract);
    for phase in Phase::ALL {
        assert_eq!(serde_json::to_value(phase).unwrap(), phase.name());
        assert_eq!(phase.to_string(), phase.name());
    }
}

#[test]
fn before_engine_and_first_frame() {
    assert_eq!(Status::default().phase, Phase::LoadingVocab);
    assert_eq!(Status::default().to_string(), "0.000 s LOADING_VOCAB");
    let tracker = mono(Some(PERIOD_S));
    assert_eq!(tracker.status().phase, Phase::WaitFrames);
    assert_eq!(
        tracker.status().to_string(),
        "0.000 s WAIT_FRAMES; IMU 0 readings, none so far, 0 synthesised"
    );
    assert_eq!(mono(None).status().words(), "Waiting for the first camera image.");
}

#[test]
fn start_waits_for_points_then_parallax() {
    let mut tracker = mono(None);
    let few = State::Starting { have: 12, need: 50 };
    assert_eq!(after(&mut tracker, &without_pose(0.0, &[], few)), Phase::Initializing);
    assert_eq!(tracker.status().waits, [Wait::Points { have: 12, need: 50 }]);
    let no_parallax = State::Starting { have: 90, need: 50 };
    assert_eq!(after(&mut tracker, &without_pose(0.1, &[], no_parallax)), Phase::WaitMotion);
    assert_eq!(tracker.status().waits, [Wait::Parallax { matches: 90 }]);
    assert!(!tracker.status().valid && !tracker.status().initialised && tracker.status().imu.is_none());
    // With depth one frame is enough: only points can be lacking.
    let mut tracker = StatusTracker::new(true, None, &Snapshot::new());
    assert_eq!(after(&mut tracker, &without_pose(0.0, &[], few)), Phase::Initializing);
    assert!(tracker.status().metric);
}

#[test]
fn camera_only_tracks_from_the_first_map() {
    let mut tracker = mono(None);
    let begin = FrameResult { map_created: true, points: 0, ..tracked(3.0, &[]) };
    assert_eq!(after(&mut tracker, &begin), Phase::Tracking);
    assert_eq!(tracker.status().events, [StatusEvent::MapCreated { map: 0, others: false }]);
    assert_eq!(after(&mut tracker, &tracked(3.5, &[])), Phase::Tracking);
    let s = tracker.status();
    assert_eq!((s.t_s, s.frames, s.sequence, s.valid), (0.5, 2, 2, true));
    assert_eq!((s.map, s.initialised, s.points, s.events.len()), (Some(0), true, 120, 0));
    assert_eq!(s.to_string(), "0.500 s TRACKING; pose 2 valid; map 0 initialised; 120 points");
}

#[test]
fn missing_readings_are_waited_for_until_scale_is_known() {
    let mut tracker = mono(Some(PERIOD_S));
    let no_parallax = State::Starting { have: 90, need: 50 };
    assert_eq!(after(&mut tracker, &without_pose(0.0, &[], no_parallax)), Phase::WaitImu);
    assert_eq!(tracker.status().waits, [Wait::Reading { silent_s: None }]);
    assert_eq!(after(&mut tracker, &without_pose(0.1, &[reading(0.1)], no_parallax)), Phase::WaitMotion);
    assert_eq!(after(&mut tracker, &tracked(0.6, &[])), Phase::Initializing, "half a second may pass");
    assert_eq!(after(&mut tracker, &tracked(0.7, &[])), Phase::WaitImu);
    assert!(tracker.status().valid, "visual tracking goes on");
    let gravity_aligned = FrameResult { map: Some((map(0), true)), metric: true, ..tracked(0.8, &[]) };
    assert_eq!(after(&mut tracker, &gravity_aligned), Phase::Tracking);
    assert!(tracker.status().initialised && tracker.status().metric);
}

#[test]
fn failed_initialisation_gates_are_waited_for() {
    let mut tracker = mono(Some(PERIOD_S));
    let imu = [reading(0.0)];
    assert_eq!(after(&mut tracker, &tracked(0.0, &imu)), Phase::Initializing);
    assert_eq!(tracker.status().waits, [Wait::FirstTry]);
    for (kind, phase) in [
        (GateKind::Seconds, Phase::Initializing),
        (GateKind::Excitation, Phase::WaitMotion),
        (GateKind::Residual, Phase::Initializing),
        (GateKind::Baseline, Phase::WaitMotion),
        (GateKind::GravityNorm, Phase::Initializing),
        (GateKind::ScaleSigma, Phase::WaitMotion),
    ] {
        let tried = attempt(&[(GateKind::KeyFrames, true), (kind, false)]);
        assert_eq!(
            after(&mut tracker, &FrameResult { attempt: Some(&tried), ..tracked(0.1, &imu) }),
            phase,
            "{kind:?}"
        );
        assert_eq!(tracker.status().waits, [Wait::Gate(tried.gates[1])]);
        assert_eq!(tracker.status().gates, tried.gates);
        assert_eq!(after(&mut tracker, &tracked(0.2, &imu)), phase, "until the next try");
    }
    assert!(tracker.status().to_string().contains("waits for scale's sigma 0.5000"), "{}", tracker.status());
    // In another map everything has to be initialised again, and a map that may not change is only tracked
    // in.
    let other = FrameResult { map: Some((map(9), false)), ..tracked(0.3, &imu) };
    assert_eq!(after(&mut tracker, &other), Phase::Initializing);
    assert_eq!(tracker.status().waits, [Wait::FirstTry]);
    assert_eq!(after(&mut tracker, &FrameResult { mapping: false, ..other }), Phase::Tracking);
}

#[test]
fn coasting_lost_and_relocalised() {
    let mut tracker = mono(Some(PERIOD_S));
    let imu = [reading(0.0)];
    let gravity_aligned = |t| FrameResult { map: Some((map(0), true)), metric: true, ..tracked(t, &imu) };
    after(&mut tracker, &gravity_aligned(0.0));
    let state = State::Coasting { since_s: 0.1, sigma: 0.02 };
    assert_eq!(after(&mut tracker, &FrameResult { state, ..gravity_aligned(0.1) }), Phase::Coasting);
    assert!(tracker.status().valid);
    assert_eq!(tracker.status().words(), "I cannot see well, and follow by the other sensors.");
    let german = tracker.status().words_in(cairn_phrases::Language::German);
    assert_eq!(german, "Ich sehe nicht gut und folge den anderen Sensoren.");
    let lost = State::Lost { inliers: 7, need: 15 };
    assert_eq!(after(&mut tracker, &without_pose(0.2, &imu, lost)), Phase::Lost);
    assert_eq!(after(&mut tracker, &without_pose(0.3, &imu, lost)), Phase::Lost);
    let s = tracker.status();
    assert_eq!((s.valid, s.sequence, s.map), (false, 2, Some(0)), "the last pose is named still");
    assert_eq!(s.waits, [Wait::Place { have: 7, need: 15 }]);
    assert_eq!(after(&mut tracker, &gravity_aligned(0.7)), Phase::Tracking);
    let [StatusEvent::Relocalised { after_s }] = tracker.status().events[..] else {
        panic!("{:?}", tracker.status())
    };
    assert!((after_s - 0.5).abs() < 1e-9);
}

#[test]
fn further_map_is_reported_once_and_is_no_relocalisation() {
    let mut tracker = StatusTracker::new(true, None, &Snapshot::new());
    let metric = |t| FrameResult { metric: true, ..tracked(t, &[]) };
    after(&mut tracker, &FrameResult { map_created: true, ..metric(0.0) });
    after(&mut tracker, &without_pose(0.1, &[], State::Lost { inliers: 0, need: 25 }));
    let new_map = FrameResult { map: Some((map(4), false)), map_created: true, others: true, ..metric(0.7) };
    assert_eq!(after(&mut tracker, &new_map), Phase::Resetting);
    assert_eq!(tracker.status().events, [StatusEvent::MapCreated { map: 4, others: true }]);
    let merge = Accepted { joined: Joined::Merge { from: map(4), into: map(0) }, ..accepted() };
    let verdicts = [verdict(Ok(merge)), verdict(Ok(accepted()))];
    let next = FrameResult {
        map_created: false,
        others: false,
        verdicts: &verdicts,
        map: Some((map(0), false)),
        ..new_map
    };
    assert_eq!(after(&mut tracker, &next), Phase::Tracking);
    let events = [StatusEvent::Merge { from: 4, into: 0 }, StatusEvent::Loop { key_frame: 6, earlier: 2 }];
    assert_eq!(tracker.status().events, events);
    assert_eq!(after(&mut tracker, &metric(0.9)), Phase::Tracking);
    assert!(tracker.status().events.is_empty());
}

#[test]
fn errors_are_transient_or_permanent() {
    let mut tracker = mono(None);
    tracker.refuse(Stamp(0), &[], "the image has another size".into());
    assert_eq!((tracker.status().phase, tracker.status().frames), (Phase::Error, 1));
    assert_eq!(tracker.status().words(), "Something is wrong: the image has another size.");
    assert_eq!(after(&mut tracker, &tracked(0.1, &[])), Phase::Tracking, "only one image was bad");
    assert_eq!(tracker.status().error, None);
    let dead = FrameResult { stage_failed: Some("mapping died"), ..tracked(0.2, &[]) };
    assert_eq!(after(&mut tracker, &dead), Phase::Error);
    assert!(tracker.status().valid, "tracking goes on");
}

#[test]
fn readings_are_counted() {
    let mut tracker = mono(Some(PERIOD_S));
    let held = |t: f64| ImuSample { noise_scale: 10.0, ..reading(t) };
    after(&mut tracker, &tracked(0.0, &[reading(-0.005), reading(0.003)]));
    assert_eq!(
        tracker.status().imu.unwrap().lag_ms.map(f64::round),
        Some(-3.0),
        "one reading at or after the image"
    );
    after(&mut tracker, &tracked(0.05, &[reading(0.008), reading(0.048), held(0.05)]));
    let imu = tracker.status().imu.unwrap();
    assert_eq!((imu.batch, imu.synthesised, imu.gaps), (3, 1, 1));
    assert!((imu.longest_gap_s - 0.04).abs() < 1e-9 && (imu.lag_ms.unwrap() - 2.0).abs() < 1e-6, "{imu:?}");
    after(&mut tracker, &tracked(0.1, &[]));
    let imu = tracker.status().imu.unwrap();
    assert_eq!((imu.batch, imu.synthesised, imu.gaps), (0, 1, 1));
    let json = serde_json::to_value(tracker.status()).unwrap();
    assert_eq!((&json["phase"], &json["imu"]["synthesised"]), (&"INITIALIZING".into(), &1.into()));
    assert_eq!(json["waits"][0], "enough key frames to initialise scale and gravity");
}

#[test]
fn a_motion_sensor_that_fails_is_told_with_its_fault_and_its_end() {
    let mut tracker = mono(Some(PERIOD_S));
    after(&mut tracker, &tracked(0.0, &[reading(0.0)]));
    assert_eq!(tracker.status().imu.unwrap().fault, None);
    let fault = ImuFault::Stuck { seconds: 0.1 };
    let failed = Failed { fault, since: Stamp::from_seconds(0.1) };
    let failing = |t| FrameResult { imu_fault: (Some(failed), 2), ..tracked(t, &[]) };
    after(&mut tracker, &failing(0.2));
    assert!(tracker.status().events.contains(&StatusEvent::ImuFailed { fault }));
    after(&mut tracker, &failing(0.6));
    let imu = tracker.status().imu.unwrap();
    assert_eq!((imu.fault, imu.refused), (Some(fault), 2));
    assert!((imu.fault_s - 0.5).abs() < 1e-9 && tracker.status().events.is_empty(), "told once");
    assert!(tracker.status().to_string().contains("not used for 0.50 s (the readings repeat themselves"));
    after(&mut tracker, &tracked(0.7, &[]));
    let back =
        |e: &StatusEvent| matches!(e, StatusEvent::ImuBack { after_s } if (after_s - 0.5).abs() < 1e-9);
    assert!(tracker.status().events.iter().any(back), "{:?}", tracker.status().events);
    assert_eq!(tracker.status().imu.unwrap().fault, None);
}

fn accepted() -> Accepted {
    Accepted { joined: Joined::Loop, inliers: 30, expected: 40, off: 0.1, off_rad: 0.01, scale: 1.0 }
}

fn verdict(result: Result<Accepted, cairn_mapping::Refusal>) -> Verdict {
    let id = |n| KeyFrameId::from_index(n).unwrap();
    Verdict { key_frame: id(6), candidate: id(2), result }
}
