//! The figures of a run that is over.

use super::accuracy::{ate, end_error, gaps, hash, movements, path_between, turn_begins};
use super::carried::Carried;
use super::costs::Times;
use super::figures::{Figures, ImuFigures, MapFigures, Still, Turn};
use super::live_scale::LiveScale;
use super::options::RunOptions;
use super::pace;
use super::record::{Record, stated_sigma};
use crate::MeasureError;
use cairn_atlas::MapId;
use cairn_engine::{Engine, PoseTime};
use cairn_eval::Align;
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use std::collections::{BTreeMap, BTreeSet};

impl Record {
    /// The figures of a run that is over.
    pub(super) fn figures(
        self,
        engine: &Engine,
        body_truth: &[(Stamp, Se3)],
        options: &RunOptions,
    ) -> Result<Figures, MeasureError> {
        let truth: Vec<(Stamp, Se3)> = engine.comparable(body_truth);
        let (poses, metric) = (engine.trajectory(), engine.is_metric());
        let align = if metric { Align::Se3 } else { Align::Sim3 };
        let live = engine.camera_poses(PoseTime::Live);
        let similar = ate(&truth, &poses, Align::Sim3)?;
        let ate_m = ate(&truth, &poses, align)?.map(|a| a.0);
        let path_m = path_between(body_truth, &self.stamps);
        let (started, lost) = gaps(&self.stamps, &poses);
        let (first, last) = (self.stamps.first().copied(), self.stamps.last().copied());
        let inside = |t: &Stamp| first.is_some_and(|f| *t >= f) && last.is_some_and(|l| *t <= l);
        let tracked = poses.iter().filter(|(t, _)| inside(t)).count();
        let scale = similar.map_or(1.0, |s| s.1);
        let since_metric = since_metric(engine, self.metric_at.map(|(at, _)| at));
        Ok(Figures {
            frames: self.stamps.len(),
            tracked,
            coverage: tracked as f64 / self.stamps.len().max(1) as f64,
            lost,
            started,
            path_m,
            found_m: pace::length_m(&poses),
            pace_ratio: pace::ratio(&poses),
            metric,
            alignment: if metric { "SE3" } else { "Sim3" }.into(),
            ate_m,
            drift_percent: ate_m.map(|ate| 100.0 * ate / path_m),
            live_ate_m: ate(&live.comparable(body_truth), &live.trajectory(), align)?.map(|a| a.0),
            ate_se3_m: ate_m.filter(|_| metric),
            ate_sim3_m: similar.map(|s| s.0),
            scale,
            too_large_percent: 100.0 * (scale.recip() - 1.0),
            scale_percent: metric.then_some(100.0 * (scale - 1.0).abs()),
            still: self.still(&truth, &since_metric, align, options)?,
            turn: self.turn(&truth, &poses, &since_metric, align, options)?,
            imu: self.imu(engine, &truth, &since_metric)?,
            map: self.map(engine),
            times: Times::of(&self.times),
            parts: self.parts,
            peak_mb: cairn_eval::process::peak_rss_mb(),
            hash: hash(&poses),
        })
    }

    fn imu(
        &self,
        engine: &Engine,
        truth: &[(Stamp, Se3)],
        since_metric: &[(Stamp, Se3)],
    ) -> Result<ImuFigures, MeasureError> {
        let by_time: BTreeMap<Stamp, Se3> = truth.iter().copied().collect();
        let first = self.stamps.first().copied().unwrap_or_default();
        let readout = engine.readout();
        let live_ate = ate(truth, since_metric, Align::Se3)?.filter(|_| self.metric_at.is_some());
        Ok(ImuFigures {
            metric_s: self.metric_at.map(|(at, _)| at - first),
            sigma: [self.metric_at.and_then(|(_, sigma)| sigma), stated_sigma(engine)],
            first_sigma_percent: self.first_sigma.map(|s| 100.0 * s),
            offset_ms: 1e3 * engine.snapshot().imu_offset(),
            readout_ms: [1e3 * readout.seconds, 1e3 * readout.sigma_s],
            live_ate_m: live_ate.map(|a| a.0),
            live: LiveScale::of(first, &by_time, &self.moved, &self.scale_known),
            carried: Carried::longest(first, &self.moved, &self.sigmas, &by_time),
            reported_s: self.reports.first().map(|(at_s, _)| *at_s),
            reports: self.reports.clone(),
            stopped_s: self.stopped_s,
        })
    }

    fn map(&self, engine: &Engine) -> MapFigures {
        let map = engine.snapshot();
        let anchored = engine.log().frames().iter().filter_map(|f| f.anchored);
        let maps: BTreeSet<MapId> = anchored
            .filter_map(|p| Some(map.key_frame(map.surviving_ancestor(p.reference)?.0)?.map))
            .collect();
        MapFigures {
            maps: map.maps().count(),
            with_poses: maps.len(),
            resets: self.known_maps.len().saturating_sub(1),
            key_frames: map.key_frame_count(),
            landmarks: map.landmark_count(),
            loops: self.joins.loops,
            merges: self.joins.merges,
            joined_s: self.joins.joined_s.clone(),
            refused: self.joins.refused,
            false_joins: self.joins.false_m.clone(),
            focal_px: engine.front_end().model().fx,
        }
    }

    fn still(
        &self,
        truth: &[(Stamp, Se3)],
        live: &[(Stamp, Se3)],
        align: Align,
        options: &RunOptions,
    ) -> Result<Option<Still>, MeasureError> {
        let (Some(seconds), Some(last)) = (options.still_s, self.stamps.last()) else { return Ok(None) };
        let from = last.plus_seconds(-seconds);
        let all = self.stamps.iter().filter(|t| **t >= from).count();
        let posed = live.iter().filter(|(t, _)| *t >= from).count();
        let coverage = posed as f64 / all.max(1) as f64;
        Ok(Some(Still { moves_m: movements(truth, live, align, [from, *last])?, coverage }))
    }

    fn turn(
        &self,
        truth: &[(Stamp, Se3)],
        poses: &[(Stamp, Se3)],
        live: &[(Stamp, Se3)],
        align: Align,
        options: &RunOptions,
    ) -> Result<Option<Turn>, MeasureError> {
        if !options.turns {
            return Ok(None);
        }
        let begins = turn_begins(truth).ok_or("the walker never turns")?;
        let posed = live.iter().filter(|(t, _)| *t >= begins).count();
        let all = self.stamps.iter().filter(|t| **t >= begins).count();
        let end_m = [end_error(truth, poses, align, begins)?, end_error(truth, live, align, begins)?];
        Ok(Some(Turn { end_m, blind: all - posed.min(all) }))
    }
}

/// Live poses; from the first metric one on, if there is one.
fn since_metric(engine: &Engine, metric_at: Option<Stamp>) -> Vec<(Stamp, Se3)> {
    let mut live = engine.camera_poses(PoseTime::Live);
    live.poses.retain(|(t, _, _)| metric_at.is_none_or(|at| *t >= at));
    live.of_mounted(&engine.camera_poses(PoseTime::Corrected).body_from_frame())
}
