//! A run in several processes, when its last frame is done.

use super::super::arguments::Arguments;
use super::super::outcome::{DeathReport, Outcome, Processes, RelocalisedReport};
use super::super::poses::Poses;
use super::super::sink::Run;
use super::super::tally::Tally;
use crate::failure::Failure;
use cairn_atlas::store::MapFile;
use cairn_engine::PoseTime;
use cairn_eval::{Lost, RunReport};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_session::FileConfig;
use cairn_workers::message::Tracked;
use cairn_workers::{RunFolder, Supervised, dense};
use std::collections::BTreeMap;
use std::path::Path;

/// What its processes have left, with what its report says of it.
pub(super) struct Several<'a> {
    pub(super) a: &'a Arguments,
    pub(super) run: Supervised,
    pub(super) folder: RunFolder,
    pub(super) tally: Tally,
    pub(super) config: FileConfig,
    /// Where the first camera is on the body, if poses are asked for of it.
    pub(super) cam0: Option<Se3>,
    /// Ground truth of the source, where it has any.
    pub(super) truth: Vec<(Stamp, Se3)>,
}

impl Several<'_> {
    /// Memory and CPU time of the supervisor would say nothing of the run, and are left out.
    fn report(&mut self) -> RunReport {
        let (run, tally) = (&self.run, &mut self.tally);
        (tally.frames, tally.dropped) = (run.frames.len(), run.left_out.dropped);
        (tally.loops, tally.merges) = (run.finished.loops, run.finished.merges);
        tally.step_ms = run.frames.iter().map(|f| f.ms).collect();
        tally.lost = lost(&run.frames);
        let last = run.frames.last().filter(|f| f.pose.is_none());
        tally.last_state = last.map(|f| format!("{:?}", f.outcome));
        let tracked = run.frames.iter().filter(|f| f.pose.is_some()).count();
        let mut report = tally.report(&run.map.snapshot, tracked, &self.config, &run.left_out.skips());
        (report.source, report.sensor) = (run.opened.name.clone(), run.opened.sensor.clone());
        report.accuracy = self.poses(PoseTime::Corrected).accuracy(&self.truth);
        report
    }

    /// Whether there are surfaces, or none were asked for.
    pub(super) fn surfaces(&self) -> Result<(), Failure> {
        self.run.surfaces.clone().map_err(|e| Failure::new(e.what, e.why, e.cure))
    }

    fn processes(&self) -> Processes {
        let deaths = self.run.deaths.iter().map(|d| DeathReport {
            process: d.role.name(),
            why: d.how.clone(),
            at_frame: d.at_frame,
            t_s: d.t_s,
        });
        let relocalised = self.run.relocalised.iter();
        let relocalised =
            relocalised.map(|(frames, after_s)| RelocalisedReport { frames: *frames, after_s: *after_s });
        Processes { deaths: deaths.collect(), relocalised: relocalised.collect() }
    }
}

/// Where tracking was lost.
fn lost(frames: &[Tracked]) -> Vec<Lost> {
    let gaps = frames.windows(2).filter(|w| w[0].pose.is_some() && w[1].pose.is_none());
    gaps.map(|w| Lost { t: Stamp(w[1].stamp).seconds(), reason: format!("{:?}", w[1].outcome) }).collect()
}

impl Run for Several<'_> {
    fn poses(&self, time: PoseTime) -> Poses {
        Poses { of_camera: self.run.camera_poses(time), cam0: self.cam0, frames: self.run.frames.len() }
    }

    fn map(&mut self, attached: &BTreeMap<String, Vec<u8>>) -> Option<MapFile> {
        let MapFile { snapshot, about, attached: own } = &self.run.map;
        let mut all = own.clone();
        all.extend(attached.iter().map(|(name, bytes)| (name.clone(), bytes.clone())));
        (snapshot.key_frame_count() > 0).then(|| MapFile {
            snapshot: snapshot.clone(),
            about: about.clone(),
            attached: all,
        })
    }

    fn surface(&mut self, _: &Path) -> Result<Vec<u8>, Failure> {
        self.surfaces()?;
        let path = self.folder.path().join(dense::SURFACE);
        std::fs::read(&path)
            .map_err(|e| Failure::new("the surface", e.to_string(), "free some shared memory"))
    }

    fn close_recording(&mut self) -> Result<(), Failure> {
        let fail = |why: String, hint: &str| Err(Failure::new("recording", why, hint));
        match &self.run.recorded {
            Some(Err(why)) => fail(why.to_string(), "free some space on the disk"),
            None if self.a.record.is_some() => {
                fail("the process that records died too often".into(), "run without --isolated")
            }
            _ => Ok(()),
        }
    }

    fn outcome(&mut self) -> Outcome {
        let report = self.report();
        Outcome { processes: Some(self.processes()), ..self.tally.outcome(report) }
    }
}
