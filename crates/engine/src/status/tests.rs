//! Each phase on packets made by hand.

use super::*;
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_geometry::Vec3;
use cairn_inertial::{Attempt, GateKind};
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

/// A picture at `t` that is tracked in world 0, of unknown scale.
fn tracked(t: f64, imu: &[ImuSample]) -> Seen<'_> {
    Seen {
        stamp: Stamp::from_seconds(t),
        imu,
        state: State::Tracking,
        map: Some((map(0), false)),
        metric: false,
        map_created: false,
        beside: false,
        points: 120,
        attempt: None,
        verdicts: &[],
        died: None,
        mapping: true,
    }
}

fn without_pose(t: f64, imu: &[ImuSample], state: State) -> Seen<'_> {
    Seen { state, map: None, points: 0, ..tracked(t, imu) }
}

fn mono(period_s: Option<f64>) -> Watch {
    Watch::new(false, period_s, &Snapshot::new())
}

fn after(watch: &mut Watch, seen: &Seen) -> Phase {
    watch.see(seen);
    watch.status().phase
}

#[test]
fn names_are_the_contracts() {
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
fn before_an_engine_and_before_a_picture() {
    assert_eq!(Status::default().phase, Phase::LoadingVocab);
    assert_eq!(Status::default().to_string(), "0.000 s LOADING_VOCAB");
    let watch = mono(Some(PERIOD_S));
    assert_eq!(watch.status().phase, Phase::WaitFrames);
    assert_eq!(watch.status().to_string(), "0.000 s WAIT_FRAMES; IMU 0 readings, none ever, 0 synthesised");
    assert_eq!(mono(None).status().words(), "Waiting for the first picture.");
}

#[test]
fn a_start_lacks_points_then_parallax() {
    let mut watch = mono(None);
    let few = State::Starting { have: 12, need: 50 };
    assert_eq!(after(&mut watch, &without_pose(0.0, &[], few)), Phase::Initializing);
    assert_eq!(watch.status().waits, [Wait::Points { have: 12, need: 50 }]);
    let alike = State::Starting { have: 90, need: 50 };
    assert_eq!(after(&mut watch, &without_pose(0.1, &[], alike)), Phase::WaitMotion);
    assert_eq!(watch.status().waits, [Wait::Parallax { matches: 90 }]);
    assert!(!watch.status().valid && !watch.status().initialised && watch.status().imu.is_none());
    // With depth one picture is enough: only points can lack.
    let mut watch = Watch::new(true, None, &Snapshot::new());
    assert_eq!(after(&mut watch, &without_pose(0.0, &[], few)), Phase::Initializing);
    assert!(watch.status().metric);
}

#[test]
fn eyes_alone_track_from_the_first_world_on() {
    let mut watch = mono(None);
    let begin = Seen { map_created: true, points: 0, ..tracked(3.0, &[]) };
    assert_eq!(after(&mut watch, &begin), Phase::Tracking);
    assert_eq!(watch.status().events, [StatusEvent::World { map: 0, beside: false }]);
    assert_eq!(after(&mut watch, &tracked(3.5, &[])), Phase::Tracking);
    let s = watch.status();
    assert_eq!((s.t_s, s.frames, s.sequence, s.valid), (0.5, 2, 2, true));
    assert_eq!((s.map, s.initialised, s.points, s.events.len()), (Some(0), true, 120, 0));
    assert_eq!(s.to_string(), "0.500 s TRACKING; pose 2 valid; map 0 initialised; 120 points");
}

#[test]
fn readings_that_do_not_come_are_waited_for_until_scale_is_known() {
    let mut watch = mono(Some(PERIOD_S));
    let alike = State::Starting { have: 90, need: 50 };
    assert_eq!(after(&mut watch, &without_pose(0.0, &[], alike)), Phase::WaitImu);
    assert_eq!(watch.status().waits, [Wait::Reading { silent_s: None }]);
    assert_eq!(after(&mut watch, &without_pose(0.1, &[reading(0.1)], alike)), Phase::WaitMotion);
    assert_eq!(after(&mut watch, &tracked(0.6, &[])), Phase::Initializing, "half a second may pass");
    assert_eq!(after(&mut watch, &tracked(0.7, &[])), Phase::WaitImu);
    assert!(watch.status().valid, "by eye it goes on");
    let level = Seen { map: Some((map(0), true)), metric: true, ..tracked(0.8, &[]) };
    assert_eq!(after(&mut watch, &level), Phase::Tracking);
    assert!(watch.status().initialised && watch.status().metric);
}

#[test]
fn what_the_last_try_lacked_is_waited_for() {
    let mut watch = mono(Some(PERIOD_S));
    let imu = [reading(0.0)];
    assert_eq!(after(&mut watch, &tracked(0.0, &imu)), Phase::Initializing);
    assert_eq!(watch.status().waits, [Wait::FirstTry]);
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
            after(&mut watch, &Seen { attempt: Some(&tried), ..tracked(0.1, &imu) }),
            phase,
            "{kind:?}"
        );
        assert_eq!(watch.status().waits, [Wait::Gate(tried.gates[1])]);
        assert_eq!(watch.status().gates, tried.gates);
        assert_eq!(after(&mut watch, &tracked(0.2, &imu)), phase, "until the next try");
    }
    assert!(watch.status().to_string().contains("waits for scale's sigma 0.5000"), "{}", watch.status());
    // In another world everything is to be found anew, and a map that may not change is only tracked in.
    let other = Seen { map: Some((map(9), false)), ..tracked(0.3, &imu) };
    assert_eq!(after(&mut watch, &other), Phase::Initializing);
    assert_eq!(watch.status().waits, [Wait::FirstTry]);
    assert_eq!(after(&mut watch, &Seen { mapping: false, ..other }), Phase::Tracking);
}

#[test]
fn coasting_lost_and_found() {
    let mut watch = mono(Some(PERIOD_S));
    let imu = [reading(0.0)];
    let level = |t| Seen { map: Some((map(0), true)), metric: true, ..tracked(t, &imu) };
    after(&mut watch, &level(0.0));
    let state = State::Coasting { since_s: 0.1, sigma: 0.02 };
    assert_eq!(after(&mut watch, &Seen { state, ..level(0.1) }), Phase::Coasting);
    assert!(watch.status().valid);
    assert_eq!(watch.status().words(), "Going by the motion sensor for 0.1 s, to 0.02 m.");
    let lost = State::Lost { inliers: 7, need: 15 };
    assert_eq!(after(&mut watch, &without_pose(0.2, &imu, lost)), Phase::Lost);
    assert_eq!(after(&mut watch, &without_pose(0.3, &imu, lost)), Phase::Lost);
    let s = watch.status();
    assert_eq!((s.valid, s.sequence, s.map), (false, 2, Some(0)), "the last pose is named still");
    assert_eq!(s.waits, [Wait::Place { have: 7, need: 15 }]);
    assert_eq!(after(&mut watch, &level(0.7)), Phase::Tracking);
    let [StatusEvent::Found { after_s }] = watch.status().events[..] else { panic!("{:?}", watch.status()) };
    assert!((after_s - 0.5).abs() < 1e-9);
}

#[test]
fn a_world_beside_others_is_told_once_and_is_no_finding() {
    let mut watch = Watch::new(true, None, &Snapshot::new());
    let metric = |t| Seen { metric: true, ..tracked(t, &[]) };
    after(&mut watch, &Seen { map_created: true, ..metric(0.0) });
    after(&mut watch, &without_pose(0.1, &[], State::Lost { inliers: 0, need: 25 }));
    let anew = Seen { map: Some((map(4), false)), map_created: true, beside: true, ..metric(0.7) };
    assert_eq!(after(&mut watch, &anew), Phase::Resetting);
    assert_eq!(watch.status().events, [StatusEvent::World { map: 4, beside: true }]);
    let merge = Accepted { joined: Joined::Merge { from: map(4), into: map(0) }, ..accepted() };
    let verdicts = [verdict(Ok(merge)), verdict(Ok(accepted()))];
    let next =
        Seen { map_created: false, beside: false, verdicts: &verdicts, map: Some((map(0), false)), ..anew };
    assert_eq!(after(&mut watch, &next), Phase::Tracking);
    let told = [StatusEvent::Merge { from: 4, into: 0 }, StatusEvent::Loop { key_frame: 6, again: 2 }];
    assert_eq!(watch.status().events, told);
    assert_eq!(after(&mut watch, &metric(0.9)), Phase::Tracking);
    assert!(watch.status().events.is_empty());
}

#[test]
fn errors_pass_or_stay() {
    let mut watch = mono(None);
    watch.refuse(Stamp(0), &[], "the image has another size".into());
    assert_eq!((watch.status().phase, watch.status().frames), (Phase::Error, 1));
    assert_eq!(watch.status().words(), "Something is wrong: the image has another size.");
    assert_eq!(after(&mut watch, &tracked(0.1, &[])), Phase::Tracking, "one picture was bad");
    assert_eq!(watch.status().error, None);
    let dead = Seen { died: Some("mapping died"), ..tracked(0.2, &[]) };
    assert_eq!(after(&mut watch, &dead), Phase::Error);
    assert!(watch.status().valid, "tracking goes on");
}

#[test]
fn readings_are_counted() {
    let mut watch = mono(Some(PERIOD_S));
    let held = |t: f64| ImuSample { noise_scale: 10.0, ..reading(t) };
    after(&mut watch, &tracked(0.0, &[reading(-0.005), reading(0.003)]));
    assert_eq!(watch.status().imu.unwrap().lag_ms.map(f64::round), Some(-3.0), "one at or after the picture");
    after(&mut watch, &tracked(0.05, &[reading(0.008), reading(0.048), held(0.05)]));
    let imu = watch.status().imu.unwrap();
    assert_eq!((imu.batch, imu.synthesised, imu.gaps), (3, 1, 1));
    assert!((imu.longest_gap_s - 0.04).abs() < 1e-9 && (imu.lag_ms.unwrap() - 2.0).abs() < 1e-6, "{imu:?}");
    after(&mut watch, &tracked(0.1, &[]));
    let imu = watch.status().imu.unwrap();
    assert_eq!((imu.batch, imu.synthesised, imu.gaps), (0, 1, 1));
    let json = serde_json::to_value(watch.status()).unwrap();
    assert_eq!((&json["phase"], &json["imu"]["synthesised"]), (&"INITIALIZING".into(), &1.into()));
    assert_eq!(json["waits"][0], "key frames to find scale and gravity with");
}

fn accepted() -> Accepted {
    Accepted { joined: Joined::Loop, inliers: 30, expected: 40, off: 0.1, off_rad: 0.01, scale: 1.0 }
}

fn verdict(result: Result<Accepted, cairn_mapping::Refusal>) -> Verdict {
    let id = |n| KeyFrameId::from_index(n).unwrap();
    Verdict { key_frame: id(6), candidate: id(2), result }
}
