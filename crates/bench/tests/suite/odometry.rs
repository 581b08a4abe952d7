//! The odometry on recordings: motions between its poses compared with the truth, beside those of the live poses in the map.

use crate::run::{Chosen, Run, run};
use cairn_engine::{Output, SensorMode};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use std::collections::BTreeMap;

/// Root mean square and greatest error of the motion over a number of frames, in the truth's unit.
#[derive(Clone, Copy, Debug)]
struct MotionError {
    rms_m: f64,
    max_m: f64,
}

impl Run {
    /// Pose, and the number of the stretch in which poses are comparable, of each frame that has both and a true pose. Frames
    /// that say that their scale rests on nothing (one camera, at the end of a turn on the spot) are left out, and end a
    /// stretch.
    fn poses(&self, pose: impl Fn(&Output) -> Option<(Se3, u32)>) -> Vec<(Stamp, Se3, Se3, u32)> {
        let mut breaks = 0;
        let mut of = |o: &Output| {
            if o.pose.is_some_and(|pose| !pose.scale.supported) {
                breaks += 1;
                return None;
            }
            let (pose, segment) = pose(o)?;
            Some((o.stamp, pose, interpolated(&self.truth, o.stamp)?, 10_000 * segment + breaks))
        };
        self.outputs.iter().filter_map(&mut of).collect()
    }

    /// Errors of the motion over so many frames. The unit of each segment is that which fits the truth best.
    fn errors(&self, poses: &[(Stamp, Se3, Se3, u32)], frames: usize, metric: bool) -> MotionError {
        let (mut sum, mut count, mut max_m) = (0.0, 0, 0.0_f64);
        for segment in poses.chunk_by(|a, b| a.3 == b.3) {
            let motion = |w: &[(Stamp, Se3, Se3, u32)]| {
                let (a, b) = (w[0], w[w.len() - 1]);
                ((a.1.inverse() * b.1).translation, (a.2.inverse() * b.2).translation)
            };
            let motions: Vec<_> = segment.windows(frames + 1).map(motion).collect();
            let dot: f64 = motions.iter().map(|(e, t)| e.dot(t)).sum();
            let square: f64 = motions.iter().map(|(e, _)| e.norm_squared()).sum();
            let unit = if metric || square == 0.0 { 1.0 } else { dot / square };
            for (estimate, truth) in motions {
                let off = (estimate * unit - truth).norm();
                sum += off * off;
                count += 1;
                max_m = max_m.max(off);
            }
        }
        MotionError { rms_m: (sum / f64::from(count.max(1))).sqrt(), max_m }
    }

    /// Errors of the odometry and of the live poses over so many frames.
    fn compare(&self, name: &str, frames: usize, metric: bool) -> [MotionError; 2] {
        let odom = self.poses(|o| o.pose.map(|p| (p.odometry.odom_from_body.se3, p.odometry.segment)));
        let live = self.poses(|o| o.pose.map(|p| (p.world_from_body.se3, p.odometry.segment)));
        let errors = [&odom, &live].map(|p| self.errors(p, frames, metric));
        println!(
            "{name:12} over {frames:3} frames: odometry rms {:.4} max {:.4} m, live rms {:.4} max {:.4} m",
            errors[0].rms_m, errors[0].max_m, errors[1].rms_m, errors[1].max_m
        );
        errors
    }

    fn summary(&self, name: &str) {
        let mut sources: BTreeMap<String, usize> = BTreeMap::new();
        for o in &self.outputs {
            let source = o.pose.map_or("no pose".into(), |p| format!("{:?}", p.odometry.source));
            *sources.entry(source).or_default() += 1;
        }
        println!("{name}: {sources:?}");
    }
}

fn interpolated(truth: &BTreeMap<Stamp, Se3>, stamp: Stamp) -> Option<Se3> {
    let (a, from) = truth.range(..=stamp).next_back()?;
    let (b, to) = truth.range(stamp..).next()?;
    if a == b {
        return Some(*from);
    }
    (*b - *a < 0.1).then(|| from.interpolate(to, (stamp - *a) / (*b - *a)))
}

/// On recordings in which the pose in the map jumps, motions in `odom` are as good as those of the live poses over a frame,
/// a second and five seconds, and none is off by more than tracking is.
#[test]
fn odometry_is_as_accurate_as_the_live_poses_and_does_not_jump() {
    // The greatest error over one frame is 10 % above what it is today.
    for (name, recording, mode, imu, max_m) in [
        ("MH_01 stereo", "euroc-mh01", SensorMode::Stereo, false, 0.0059),
        ("MH_01 mono", "euroc-mh01", SensorMode::Mono, false, 0.0059),
        ("MH_01 mono+IMU", "euroc-mh01", SensorMode::Mono, true, 0.007),
        ("atrium mono", "atrium", SensorMode::Mono, false, 0.0157),
    ] {
        let Some(run) = run(Chosen { recording, mode, imu, left_out_s: 0 }) else { continue };
        let metric = mode != SensorMode::Mono;
        for frames in [1, 20, 100] {
            let [odometry, live] = run.compare(name, frames, metric);
            assert!(
                odometry.rms_m <= 1.1 * live.rms_m,
                "{name} over {frames} frames: {odometry:?}, {live:?}"
            );
            assert!(frames > 1 || odometry.max_m < max_m, "{name}: {odometry:?}");
        }
        run.summary(name);
        let unsupported = run.outputs.iter().filter(|o| o.pose.is_some_and(|p| !p.scale.supported)).count();
        assert!(20 * unsupported < run.outputs.len(), "{name}: {unsupported} frames have no scale");
        // A pose in the map has one in `odom`, and both are one pose.
        for o in &run.outputs {
            let off = o.pose.map(|p| {
                let again = p.odometry.world_from_odom.then(&p.odometry.odom_from_body).se3;
                (again.inverse() * p.world_from_body.se3).log().norm()
            });
            assert!(off.is_none_or(|off| off < 1e-9), "{}: {off:?}", o.stamp);
        }
    }
}
