//! Runs the engine in lockstep over one source: accuracy, speed, size, and a hash of all bits of the result.

use crate::{MeasureError, run};
use cairn_atlas::KeyFrameId;
use cairn_engine::{Config, Engine, Joined, PoseTime, Runner, Sensors, StageEvent};
use cairn_eval::{Align, Percentiles};
use cairn_geometry::Se3;
use cairn_sensor::{Source, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Options of a run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Sensors to use.
    pub sensor: Sensors,
    /// Largest number of packets.
    pub frames: usize,
    /// Prints every frame on stderr.
    pub verbose: bool,
    /// Configuration of the engine.
    pub config: Config,
}

impl RunOptions {
    /// Options for a whole source with these sensors.
    pub fn new(sensor: Sensors) -> Self {
        Self { sensor, frames: usize::MAX, verbose: false, config: Config::default() }
    }
}

/// Result of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measured {
    /// Sensors used.
    pub sensor: Sensors,
    /// Number of packets.
    pub frames: usize,
    /// Packets with a pose in the final trajectory.
    pub tracked: usize,
    /// Stretches of frames without a pose after the first pose: first and last frame.
    pub lost: Vec<[usize; 2]>,
    /// The first frame with a pose.
    pub started: Option<usize>,
    /// RMSE of the final trajectory against the ground truth after alignment, metres.
    pub ate_m: Option<f64>,
    /// The same of the live poses.
    pub live_ate_m: Option<f64>,
    /// Whether the map is metric; then scale is not aligned.
    pub metric: bool,
    /// Scale by Sim3 alignment, also where the map is metric.
    pub scale: f64,
    /// Time of the first metric pose, seconds after the first frame.
    pub metric_s: Option<f64>,
    /// Estimated time offset to add to the IMU stamps, milliseconds.
    pub imu_offset_ms: f64,
    /// Length of the true path, metres.
    pub path_m: f64,
    /// Decoded image to pose, milliseconds.
    pub step_ms: Percentiles,
    /// The part from features to pose.
    pub track_ms: Percentiles,
    /// Mapping of a key frame, milliseconds.
    pub map_ms: Percentiles,
    /// Number of maps at the end.
    pub worlds: usize,
    /// Loops closed.
    pub loops: usize,
    /// Maps merged.
    pub merges: usize,
    /// Times of loops and merges, seconds after the first frame.
    pub joined_s: Vec<f64>,
    /// Candidates rejected.
    pub refused: usize,
    /// Errors of false loops and merges (more than 0.5 m), metres.
    pub false_joins: Vec<f64>,
    /// Key frames in the map at the end.
    pub key_frames: usize,
    /// Landmarks in the map at the end.
    pub landmarks: usize,
    /// Peak resident memory of this process, megabytes.
    pub peak_mb: Option<f64>,
    /// Hash of all bits of the final trajectory.
    pub hash: u64,
}

impl Measured {
    /// Share of the packets that have a pose.
    pub fn coverage(&self) -> f64 {
        self.tracked as f64 / self.frames.max(1) as f64
    }

    /// ATE as a share of the path length.
    pub fn drift(&self) -> Option<f64> {
        self.ate_m.map(|ate| ate / self.path_m)
    }
}

/// Runs a source to its end.
///
/// # Errors
/// When the source fails, the rig does not have the sensors, a packet does not fit the rig, or the final map is
/// inconsistent.
pub fn measure(source: &mut dyn Source, options: &RunOptions) -> Result<Measured, MeasureError> {
    let rate_hz = source.info().rate_hz;
    let mut engine = run::engine(source.rig(), options.sensor, rate_hz, Runner::Lockstep, &options.config)?;
    let (mut step_ms, mut track_ms, mut map_ms) = (Vec::new(), Vec::new(), Vec::new());
    let mut stamps = Vec::new();
    let (mut loops, mut merges, mut refused) = (0, 0, 0);
    let (mut joined_s, mut false_joins) = (Vec::new(), Vec::new());
    let truth: BTreeMap<Stamp, Se3> = engine.comparable(&source.info().truth).into_iter().collect();
    let mut before: Option<(Stamp, Se3)> = None;
    let mut metric_s = None;
    while stamps.len() < options.frames {
        let Some((packet, out)) = run::step(source, &mut engine, stamps.len())? else { break };
        if options.verbose {
            eprintln!(
                "{:4} {:?} features {} expected {} matched {} inliers {} key frames {}{} step error {:.3} m",
                stamps.len(),
                out.state,
                out.evidence.features,
                out.evidence.expected,
                out.evidence.matched,
                out.evidence.inliers,
                engine.snapshot().key_frame_count(),
                if out.timings.map_ms.is_empty() { "" } else { " +" },
                step_error(&truth, &mut before, packet.stamp, out.world_from_body().map(|p| p.se3)),
            );
        }
        if out.is_metric() && metric_s.is_none() {
            metric_s = Some(packet.stamp - *stamps.first().unwrap_or(&packet.stamp));
        }
        if let Some(attempt) = out.events.iter().find_map(StageEvent::attempt).filter(|_| options.verbose) {
            let gates: Vec<String> = attempt.failed().map(|g| g.to_string()).collect();
            let found = attempt.found.as_ref().map(|f| (f.scale, f.scale_sigma, f.bias, f.noise_times));
            eprintln!(
                "initialising: {} {found:?}",
                if gates.is_empty() { "done".into() } else { gates.join("; ") }
            );
        }
        for v in out.verdicts() {
            match v.result {
                Ok(a) => {
                    loops += usize::from(a.joined == Joined::Loop);
                    merges += usize::from(a.joined != Joined::Loop);
                    let truth = &source.info().truth;
                    let metres = match engine.is_metric() {
                        true => 1.0,
                        false => ate(&engine.comparable(truth), &engine.trajectory(), Align::Sim3)?.1,
                    };
                    let off = join_error(&engine, truth, metres, v.key_frame, v.candidate);
                    joined_s.push(packet.stamp - *stamps.first().unwrap_or(&packet.stamp));
                    false_joins.extend(off.filter(|off| *off > 0.5));
                }
                Err(_) => refused += 1,
            }
            if options.verbose {
                match v.result {
                    Ok(a) => eprintln!("closed {:?} with {:?}: {a:?}", v.key_frame, v.candidate),
                    Err(why) => eprintln!("rejected {:?} with {:?}: {why}", v.key_frame, v.candidate),
                }
            }
        }
        stamps.push(packet.stamp);
        step_ms.push(out.timings.step_ms());
        track_ms.push(out.timings.track_ms);
        map_ms.extend(out.timings.map_ms);
    }
    map_ms.extend(engine.finish().timings.map_ms);
    let map = engine.snapshot();
    map.check()?;
    let poses = engine.trajectory();
    let align = if engine.is_metric() { Align::Se3 } else { Align::Sim3 };
    let truth = engine.comparable(&source.info().truth);
    let (ate_m, _) = ate(&truth, &poses, align)?;
    let (_, scale) = ate(&truth, &poses, Align::Sim3)?;
    let live = engine.camera_poses(PoseTime::Live);
    let (live_ate_m, _) = ate(&live.comparable(&source.info().truth), &live.trajectory(), align)?;
    let (started, lost) = gaps(&stamps, &poses);
    Ok(Measured {
        sensor: options.sensor,
        frames: stamps.len(),
        tracked: poses.len(),
        lost,
        started,
        ate_m,
        live_ate_m,
        metric: engine.is_metric(),
        scale,
        metric_s,
        imu_offset_ms: 1e3 * map.imu_offset(),
        path_m: path_between(&source.info().truth, &stamps),
        step_ms: Percentiles::of(&step_ms).unwrap_or_default(),
        track_ms: Percentiles::of(&track_ms).unwrap_or_default(),
        map_ms: Percentiles::of(&map_ms).unwrap_or_default(),
        worlds: map.maps().count(),
        loops,
        merges,
        joined_s,
        refused,
        false_joins,
        key_frames: map.key_frame_count(),
        landmarks: map.landmark_count(),
        peak_mb: cairn_eval::process::peak_rss_mb(),
        hash: hash(&poses),
    })
}

/// Error of the motion since the previous frame, metres; NaN where it is unknown.
fn step_error(
    truth: &BTreeMap<Stamp, Se3>,
    before: &mut Option<(Stamp, Se3)>,
    stamp: Stamp,
    pose: Option<Se3>,
) -> f64 {
    let last = std::mem::replace(before, pose.map(|p| (stamp, p)));
    let step = || {
        let ((t, from), to) = (last?, pose?);
        let truly = truth.get(&t)?.inverse() * *truth.get(&stamp)?;
        Some(((from.inverse() * to).translation - truly.translation).norm())
    };
    step().unwrap_or(f64::NAN)
}

/// Error of the position of one key frame in the camera frame of another, metres; `metres` is the length of the map's
/// unit.
fn join_error(
    engine: &Engine,
    truth: &[(Stamp, Se3)],
    metres: f64,
    a: KeyFrameId,
    b: KeyFrameId,
) -> Option<f64> {
    let map = engine.snapshot();
    let (a, b) = (map.key_frame(a)?, map.key_frame(b)?);
    let body_from_camera = engine.front_end().model().body_from_camera;
    let truly = |t: Stamp| {
        let i = truth.binary_search_by_key(&t, |p| p.0).ok()?;
        Some(truth[i].1 * body_from_camera)
    };
    let true_a_from_b = truly(a.frame.stamp)?.inverse() * truly(b.frame.stamp)?;
    let a_from_b = a.world_from_camera.inverse() * b.world_from_camera;
    Some((true_a_from_b.translation - a_from_b.translation * metres).norm())
}

/// RMSE and scale; no RMSE when there are too few poses for an alignment.
fn ate(
    truth: &[(Stamp, Se3)],
    poses: &[(Stamp, Se3)],
    align: Align,
) -> Result<(Option<f64>, f64), MeasureError> {
    Ok(run::aligned(truth, poses, align)?.map_or((None, 1.0), |e| (Some(e.ate_m.rmse), e.scale)))
}

/// The first frame with a pose, and the stretches without one after it.
fn gaps(stamps: &[Stamp], poses: &[(Stamp, Se3)]) -> (Option<usize>, Vec<[usize; 2]>) {
    let have = |t: &Stamp| poses.binary_search_by_key(t, |p| p.0).is_ok();
    let started = stamps.iter().position(have);
    let mut lost: Vec<[usize; 2]> = Vec::new();
    for i in started.unwrap_or(stamps.len())..stamps.len() {
        if have(&stamps[i]) {
            continue;
        }
        match lost.last_mut() {
            Some([_, last]) if *last + 1 == i => *last = i,
            _ => lost.push([i, i]),
        }
    }
    (started, lost)
}

/// Length of the true path between the first and the last of these times.
fn path_between(truth: &[(Stamp, Se3)], stamps: &[Stamp]) -> f64 {
    let (Some(first), Some(last)) = (stamps.first(), stamps.last()) else { return 0.0 };
    let inside: Vec<&Se3> = truth.iter().filter(|(t, _)| t >= first && t <= last).map(|(_, p)| p).collect();
    inside.windows(2).map(|w| (w[1].translation - w[0].translation).norm()).sum()
}

/// FNV-1a over the bits of times and poses (Fowler, Noll, Vo).
fn hash(poses: &[(Stamp, Se3)]) -> u64 {
    let mut h = 0xcbf2_9ce4_8422_2325_u64;
    let mut take = |bits: u64| {
        for byte in bits.to_le_bytes() {
            h = (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for (t, p) in poses {
        take(t.0 as u64);
        p.translation.iter().for_each(|v| take(v.to_bits()));
        p.rotation.matrix().iter().for_each(|v| take(v.to_bits()));
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    fn pose(x: f64) -> Se3 {
        Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0))
    }

    #[test]
    fn gaps_are_found() {
        let stamps: Vec<Stamp> = (0..8).map(Stamp).collect();
        let poses: Vec<(Stamp, Se3)> = [1, 2, 5, 7].map(|t| (Stamp(t), pose(0.0))).to_vec();
        assert_eq!(gaps(&stamps, &poses), (Some(1), vec![[3, 4], [6, 6]]));
        assert_eq!(gaps(&stamps, &[]), (None, vec![]));
    }

    #[test]
    fn hash_depends_on_the_last_bit() {
        let one = [(Stamp(1), pose(1.0))];
        let other = [(Stamp(1), pose(1.0 + f64::EPSILON))];
        assert_eq!(hash(&one), hash(&one));
        assert_ne!(hash(&one), hash(&other));
    }
}
