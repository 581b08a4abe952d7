//! Runs the engine over one source and computes the figures of the trials: metric accuracy, maps, time to the first
//! metric pose.

use super::carried::Carried;
use super::live_scale::LiveScale;
use crate::{MeasureError, RunOptions, run};
use cairn_atlas::MapId;
use cairn_engine::{Engine, Odometry, PoseTime, Runner, StageEvent, State};
use cairn_eval::{Align, Percentiles};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{Source, Stamp};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// The result of a run.
pub struct Ran {
    /// The stamps of all packets.
    pub stamps: Vec<Stamp>,
    /// Ground-truth poses of the same body as the poses below.
    pub truth: Vec<(Stamp, Se3)>,
    /// Final poses, with all corrections of the map.
    pub poses: Vec<(Stamp, Se3)>,
    /// Live poses; from the first metric one on, if there is one.
    pub live: Vec<(Stamp, Se3)>,
    /// Odometry of the metric poses.
    pub moved: Vec<(Stamp, Odometry)>,
    /// Stated standard deviations of the position, metres, of frames whose pose the motion sensors carried.
    pub sigmas: BTreeMap<Stamp, f64>,
    /// Those whose scale was said to be known.
    pub told: BTreeSet<Stamp>,
    /// When each map was created; the first is the start.
    pub map_created: Vec<Stamp>,
    /// Number of maps that contain final poses.
    pub pose_maps: usize,
    /// Time of the first metric pose.
    pub metric_at: Option<Stamp>,
    /// The standard deviation of the logarithm of scale that the first accepted initialisation stated.
    pub first_sigma: Option<f64>,
    /// Whether the map is metric at the end.
    pub metric: bool,
    /// Milliseconds from features to pose, per frame.
    pub track_ms: Vec<f64>,
    /// Milliseconds from decoded image to pose, per frame.
    pub step_ms: Vec<f64>,
    /// Seconds to add to an IMU stamp to get the image clock, as estimated by the engine (0 if it estimated none); `None`
    /// without IMU.
    pub offset_s: Option<f64>,
    /// Readout time of the camera's rows and its standard deviation (zero where it is not estimated).
    pub readout_s: [f64; 2],
}

/// The figures of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Name of the run, for the table.
    pub name: String,
    /// Sensors.
    pub sensors: String,
    /// Packets.
    pub frames: usize,
    /// Length of the true path, metres.
    pub path_m: f64,
    /// RMSE after SE3 alignment; `None` where the map is not metric.
    pub ate_m: Option<f64>,
    /// RMSE after Sim3 alignment.
    pub ate_sim3_m: Option<f64>,
    /// Deviation of that Sim3's scale from 1, percent; `None` where the map is not metric.
    pub scale_percent: Option<f64>,
    /// Share of the packets that have a pose at the end.
    pub coverage: f64,
    /// Seconds from the first frame to the first metric pose.
    pub metric_s: Option<f64>,
    /// Maps started after the first one.
    pub resets: usize,
    /// Number of maps that contain final poses.
    pub worlds: usize,
    /// Error of the time offset, ms (of an offset of zero where the engine estimated none); `None` without IMU.
    pub offset_ms: Option<f64>,
    /// Features to pose, milliseconds.
    pub track_ms: Percentiles,
    /// Decoded image to pose, milliseconds.
    pub step_ms: Percentiles,
}

/// Runs a source.
///
/// # Errors
/// When the source or the engine fails.
pub fn run(source: &mut dyn Source, options: &RunOptions) -> Result<Ran, MeasureError> {
    run_in(source, options, Runner::Lockstep)
}

/// Runs a source in a given runner.
///
/// # Errors
/// When the source or the engine fails.
pub fn run_in(source: &mut dyn Source, options: &RunOptions, runner: Runner) -> Result<Ran, MeasureError> {
    let rate_hz = source.info().rate_hz;
    let mut engine = run::engine(source.rig(), options.sensor, rate_hz, runner, &options.config)?;
    let (mut moved, mut told) = (Vec::new(), BTreeSet::new());
    let (mut stamps, mut track_ms, mut step_ms) = (Vec::new(), Vec::new(), Vec::new());
    let (mut known, mut map_created, mut metric_at) = (BTreeSet::<MapId>::new(), Vec::new(), None);
    let (mut first_sigma, mut sigmas) = (None, BTreeMap::new());
    while stamps.len() < options.frames {
        let Some((packet, out)) = run::step(source, &mut engine, stamps.len())? else { break };
        let attempt = out.events.iter().find_map(StageEvent::attempt);
        if options.verbose {
            eprintln!(
                "{:4} {:?} matched {} inliers {}{}",
                stamps.len(),
                out.state,
                out.evidence.matched,
                out.evidence.inliers,
                if out.is_metric() { "" } else { " not metric" }
            );
            if let Some(check) = out.events.iter().find_map(StageEvent::scale_check) {
                eprintln!("{check:?}");
            }
            if let Some(attempt) = attempt {
                let gates: Vec<String> = attempt.failed().map(|g| g.to_string()).collect();
                let found = attempt.found.as_ref().map(|f| {
                    (
                        f.scale,
                        f.scale_sigma,
                        f.residual,
                        f.noise_times,
                        f.offset_s,
                        f.offset_sigma_s,
                        f.position_sigma,
                    )
                });
                eprintln!(
                    "initialising: {} {found:?} clocks {:?}",
                    gates.join("; "),
                    engine.snapshot().imu_offset()
                );
            }
        }
        first_sigma = first_sigma.or(attempt.and_then(|a| Some(a.accepted()?.scale_sigma)));
        for (map, _) in engine.snapshot().maps() {
            if known.insert(map) {
                map_created.push(packet.stamp);
            }
        }
        if metric_at.is_none() && out.is_metric() {
            metric_at = Some(packet.stamp);
        }
        let metric = out.pose.filter(|pose| pose.scale.metric);
        moved.extend(metric.map(|pose| (packet.stamp, pose.odometry)));
        told.extend(metric.filter(|pose| pose.scale.is_known()).map(|_| packet.stamp));
        if let State::Coasting { sigma, .. } = out.state {
            sigmas.insert(packet.stamp, sigma);
        }
        stamps.push(packet.stamp);
        track_ms.push(out.timings.track_ms);
        step_ms.push(out.timings.step_ms());
    }
    engine.finish();
    engine.snapshot().check()?;
    let first = stamps.first().copied().unwrap_or_default();
    let last = stamps.last().copied().unwrap_or_default();
    let mut truth = engine.comparable(&source.info().truth);
    truth.retain(|(t, _)| *t >= first && *t <= last);
    Ok(Ran {
        truth,
        poses: engine.trajectory(),
        live: since_metric(&engine, metric_at),
        moved,
        sigmas,
        told,
        map_created,
        pose_maps: pose_maps(&engine),
        metric_at,
        first_sigma,
        metric: engine.is_metric(),
        track_ms,
        step_ms,
        offset_s: options.sensor.has_imu().then(|| engine.snapshot().imu_offset()),
        readout_s: [engine.readout().seconds, engine.readout().sigma_s],
        stamps,
    })
}

fn since_metric(engine: &Engine, metric_at: Option<Stamp>) -> Vec<(Stamp, Se3)> {
    let mut live = engine.camera_poses(PoseTime::Live);
    live.poses.retain(|(t, _, _)| metric_at.is_none_or(|at| *t >= at));
    live.of_mounted(&engine.camera_poses(PoseTime::Corrected).body_from_frame())
}

/// Number of maps that contain the poses of all frames.
fn pose_maps(engine: &Engine) -> usize {
    let map = engine.snapshot();
    let anchored = engine.log().frames().iter().filter_map(|f| f.anchored);
    let maps: BTreeSet<MapId> =
        anchored.filter_map(|p| Some(map.key_frame(map.surviving_ancestor(p.reference)?.0)?.map)).collect();
    maps.len()
}

impl Ran {
    /// The figures; `true_offset_s` is the true error of the IMU stamps.
    ///
    /// # Errors
    /// When the times of the ground truth do not increase.
    pub fn figures(
        &self,
        name: &str,
        options: &RunOptions,
        true_offset_s: f64,
    ) -> Result<Figures, MeasureError> {
        let (first, last) = (self.stamps.first().copied(), self.stamps.last().copied());
        let path: f64 = self.truth.windows(2).map(|w| (w[1].1.translation - w[0].1.translation).norm()).sum();
        let rigid = ate(&self.truth, &self.poses, Align::Se3)?.filter(|_| self.metric);
        let similar = ate(&self.truth, &self.poses, Align::Sim3)?;
        let inside = |t: &Stamp| first.is_some_and(|f| *t >= f) && last.is_some_and(|l| *t <= l);
        let tracked = self.poses.iter().filter(|(t, _)| inside(t)).count();
        Ok(Figures {
            name: name.into(),
            sensors: options.sensor.name().into(),
            frames: self.stamps.len(),
            path_m: path,
            ate_m: rigid.map(|r| r.0),
            ate_sim3_m: similar.map(|r| r.0),
            scale_percent: similar.filter(|_| self.metric).map(|r| 100.0 * (r.1 - 1.0).abs()),
            coverage: tracked as f64 / self.stamps.len().max(1) as f64,
            metric_s: self.metric_at.zip(first).map(|(at, first)| at - first),
            resets: self.map_created.len().saturating_sub(1),
            worlds: self.pose_maps,
            offset_ms: self.offset_s.map(|o| 1e3 * (o - true_offset_s).abs()),
            track_ms: Percentiles::of(&self.track_ms).unwrap_or_default(),
            step_ms: Percentiles::of(&self.step_ms).unwrap_or_default(),
        })
    }

    /// The live scale of metric poses against the truth while the body walks.
    pub fn live_scale(&self) -> LiveScale {
        let truth = self.truth.iter().copied().collect();
        LiveScale::of(self.stamps[0], &truth, &self.moved, &self.told)
    }

    /// The longest stretch of metric frames without a match, whose pose the motion sensors carried.
    pub fn carried(&self) -> Option<Carried> {
        let truth: BTreeMap<Stamp, Se3> = self.truth.iter().copied().collect();
        Carried::longest(*self.stamps.first()?, &self.moved, &self.sigmas, &truth)
    }

    /// RMSE of the live poses since the first metric one, after SE3 alignment.
    ///
    /// # Errors
    /// When the times of the ground truth do not increase.
    pub fn live_ate(&self) -> Result<Option<f64>, MeasureError> {
        Ok(ate(&self.truth, &self.live, Align::Se3)?.filter(|_| self.metric_at.is_some()).map(|r| r.0))
    }

    /// Largest movement between two instants, metres: of the live poses from the first of them; of the ground truth;
    /// and of one relative to the other, after aligning all live poses with the ground truth. `None` without a pose
    /// there.
    ///
    /// # Errors
    /// When the times of the ground truth do not increase.
    pub fn wanders(&self, from: Stamp, to: Stamp) -> Result<Option<[f64; 3]>, MeasureError> {
        let farthest = |places: &[Vec3]| {
            let first = *places.first()?;
            Some(places.iter().map(|p| (p - first).norm()).fold(0.0, f64::max))
        };
        let inside = |list: &[(Stamp, Se3)]| -> Vec<(Stamp, Vec3)> {
            list.iter().filter(|(t, _)| *t >= from && *t <= to).map(|(t, p)| (*t, p.translation)).collect()
        };
        let plain = |list: Vec<(Stamp, Vec3)>| list.into_iter().map(|p| p.1).collect::<Vec<_>>();
        let align = if self.metric { Align::Se3 } else { Align::Sim3 };
        let Some(found) = run::aligned(&self.truth, &self.live, align)? else { return Ok(None) };
        let truth = inside(&self.truth);
        let off: Vec<Vec3> = inside(&self.live)
            .iter()
            .filter_map(|(t, p)| {
                let near = truth.iter().min_by(|a, b| (a.0 - *t).abs().total_cmp(&(b.0 - *t).abs()))?;
                Some(found.reference_from_estimate * *p - near.1)
            })
            .collect();
        let all = [farthest(&plain(inside(&self.live))), farthest(&plain(truth)), farthest(&off)];
        Ok(match all {
            [Some(live), Some(truth), Some(relative)] => Some([live, truth, relative]),
            _ => None,
        })
    }

    /// Error of the last pose, metres, after aligning the poses up to an instant with the ground truth by SE3 (Sim3
    /// where the map is not metric).
    ///
    /// # Errors
    /// When the times of the ground truth do not increase.
    pub fn end_error(
        &self,
        aligned_until: Stamp,
        poses: &[(Stamp, Se3)],
    ) -> Result<Option<f64>, MeasureError> {
        let begin: Vec<(Stamp, Se3)> = poses.iter().filter(|(t, _)| *t <= aligned_until).copied().collect();
        let align = if self.metric { Align::Se3 } else { Align::Sim3 };
        let (Some((t, last)), Some(found)) = (poses.last(), run::aligned(&self.truth, &begin, align)?) else {
            return Ok(None);
        };
        let aligned = found.reference_from_estimate * last.translation;
        let truth = self.truth.iter().min_by(|a, b| (a.0 - *t).abs().total_cmp(&(b.0 - *t).abs()));
        Ok(truth.map(|(_, p)| (aligned - p.translation).norm()))
    }
}

/// RMSE and scale after alignment; `None` with too few poses.
fn ate(
    truth: &[(Stamp, Se3)],
    poses: &[(Stamp, Se3)],
    align: Align,
) -> Result<Option<(f64, f64)>, MeasureError> {
    Ok(run::aligned(truth, poses, align)?.map(|e| (e.ate_m.rmse, e.scale)))
}

/// Header of the table of [`row`]s.
pub const HEAD: &str = "| run | sensors | ATE m, SE3 without scale (after Sim3) | scale error % | coverage | first metric pose s | resets | maps | offset error ms | track p50 ms |\n|---|---|---|---|---|---|---|---|---|---|\n";

/// One row of the table.
pub fn row(f: &Figures) -> String {
    let or = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    format!(
        "| {} | {} | {} ({}) | {} | {:.3} | {} | {} | {} | {} | {:.1} |\n",
        f.name,
        f.sensors,
        or(f.ate_m, 4),
        or(f.ate_sim3_m, 4),
        or(f.scale_percent, 2),
        f.coverage,
        or(f.metric_s, 2),
        f.resets,
        f.worlds,
        or(f.offset_ms, 2),
        f.track_ms.p50
    )
}
