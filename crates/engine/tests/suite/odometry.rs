//! A simulated walk round an office with one camera: loops are closed, maps are merged, the pose in the map jumps. The
//! odometry does not.

use cairn_engine::{
    Config, Engine, FramePose, Host, Joined, MotionSource, Odometry, Output, Runner, SensorMode,
};
use cairn_geometry::Se3;
use cairn_sensor::{Source, Stamp};
use cairn_sim::SimSource;
use std::collections::BTreeMap;

const OFFICE: &str = "sim:office?seed=1&sensor=mono&resolution=400x300&focal=260&rate=15&duration=60";

/// A frame: its segment, its pose as estimated and as it is, and whether its motion is known. While only the rotation is
/// tracked the position is held, and that is told.
type Frame = (u32, Se3, Se3, bool);

/// The error of each motion from frame to frame within a segment, in metres; the unit of a segment is the median one.
fn errors(frames: &[Frame]) -> Vec<f64> {
    let mut found = Vec::new();
    for segment in frames.chunk_by(|a, b| a.0 == b.0) {
        let motion =
            |w: &[Frame]| ((w[0].1.inverse() * w[1].1).translation, (w[0].2.inverse() * w[1].2).translation);
        let motions: Vec<_> = segment.windows(2).filter(|w| w[1].3).map(motion).collect();
        // The median of the ratios: jumps do not change it.
        let mut ratios: Vec<f64> = (motions.iter())
            .filter(|(estimate, _)| estimate.norm() > 0.0)
            .map(|(estimate, truth)| truth.norm() / estimate.norm())
            .collect();
        ratios.sort_by(f64::total_cmp);
        let Some(unit) = ratios.get(ratios.len() / 2) else { continue };
        found.extend(motions.iter().map(|(estimate, truth)| (estimate * *unit - truth).norm()));
    }
    found
}

#[test]
fn loops_and_merges_of_a_walk_make_no_step_in_odom() {
    let mut source = SimSource::open(OFFICE).unwrap();
    let rate_hz = source.info().rate_hz;
    let config = Config::default();
    let mut engine =
        Engine::new(source.rig(), SensorMode::Mono, rate_hz, Runner::Lockstep, &config, &Host::bare())
            .unwrap();
    let mut outputs: Vec<Output> = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        outputs.push(engine.on_packet(&packet).unwrap());
    }
    let truth: BTreeMap<Stamp, Se3> = engine.comparable(&source.info().truth).into_iter().collect();
    let frames = |pose: &dyn Fn(&Output) -> Option<Se3>| -> Vec<Frame> {
        let known = |d: Odometry| d.source != MotionSource::RotationOnly;
        let frame = |o: &Output| {
            let odometry = o.pose?.odometry;
            Some((odometry.segment, pose(o)?, *truth.get(&o.stamp)?, known(odometry)))
        };
        outputs.iter().filter_map(frame).collect()
    };
    let odom = errors(&frames(&|o| o.pose.map(|p| p.odometry.odom_from_body.se3)));
    let live = errors(&frames(&|o| o.pose.map(|p| p.world_from_body.se3)));
    let max = |errors: &[f64]| errors.iter().copied().fold(0.0, f64::max);
    let joined = outputs.iter().flat_map(Output::verdicts).filter_map(|v| v.result.ok());
    let loops = joined.filter(|a| a.joined == Joined::Loop).count();
    let segments = outputs.iter().filter_map(|o| o.pose).map(|p| p.odometry.segment).max();
    println!(
        "{} frames, {loops} loops, last segment {segments:?}: motions off by at most {:.4} m in odom, {:.4} m in the map",
        odom.len(),
        max(&odom),
        max(&live)
    );
    assert!(loops > 0 && max(&live) > 0.2, "{loops} loops, the pose in the map jumps by {} m", max(&live));
    // What tracking itself errs in its worst frame, which the pose in the map does too: `odom` never adds to it.
    assert!(max(&odom) < 0.038, "a step of {} m", max(&odom));
    let added = odom.iter().zip(&live).map(|(odom, live)| odom - live).fold(0.0, f64::max);
    assert!(added < 0.01, "{added} m that the pose in the map does not err");
    let jumps: Vec<f64> =
        odom.iter().zip(&live).filter(|(_, live)| **live > 0.1).map(|(odom, _)| *odom).collect();
    assert!(jumps.len() >= 3 && max(&jumps) < 0.021, "at jumps of the map: {jumps:?}");
    // A segment ends with a loss, or with a map in a unit of its own: not with a loop.
    assert!(segments.is_some_and(|last| last <= 3), "{segments:?}");
    let mut before = None;
    for o in &outputs {
        let off = |p: FramePose| {
            let again = p.odometry.world_from_odom.then(&p.odometry.odom_from_body).se3;
            (again.inverse() * p.world_from_body.se3).log().norm()
        };
        let off = o.pose.map(off);
        assert!(off.is_none_or(|off| off < 1e-9), "{}: {off:?}", o.stamp);
        let segment = o.pose.map(|p| p.odometry.segment);
        assert!(segment.is_none() || segment >= before, "segments count up");
        before = segment.or(before);
    }
    let told: usize = engine.odometry_segments().iter().map(Vec::len).sum();
    assert_eq!(told, outputs.iter().filter(|o| o.pose.is_some()).count());
}
