//! The results of a run that are made at its end: the report as JSON and as a page, trajectories, the recorded route.

use super::arguments::Arguments;
use super::outcome::Outcome;
use super::sink::{Ended, Sink};
use super::sinks::Sinks;
use super::surface::Written;
use super::{page, text};
use crate::failure::Failure;
use crate::output::{Output, warn};
use crate::outputs::Outputs;
use cairn_engine::PoseTime;
use cairn_eval::to_tum;
use cairn_geometry::Trajectory;
use cairn_sources::is_live;

/// The report as JSON; of a run that failed before its first frame there is none.
pub struct Report<'a>(pub &'a Outputs);

impl Sink for Report<'_> {
    fn end(self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        let failed = ended.failed;
        let outcome = ended.outcome();
        if failed && outcome.report.frames == 0 {
            return Ok(());
        }
        self.0.write("--report", || {
            let text = serde_json::to_string_pretty(outcome)
                .map_err(|e| Failure::new("report", e.to_string(), "leave out --report"))?;
            Ok((text + "\n").into_bytes())
        })
    }
}

/// The report as a page, as [`Report`].
pub struct Page<'a>(pub &'a Outputs);

impl Sink for Page<'_> {
    fn end(self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        let failed = ended.failed;
        let (outcome, run) = ended.parts();
        let Some(here) = run.here().filter(|_| !failed || outcome.report.frames > 0) else { return Ok(()) };
        let engine = here.session.engine();
        self.0.write("--report-html", || {
            Ok(page::of(outcome, &engine.trajectory(), &engine.snapshot()).into_bytes())
        })
    }
}

/// The poses as they are known at the end, or as they were given, if there are any: each frame once and in order.
pub struct Poses<'a>(pub &'a Outputs, pub PoseTime);

impl Sink for Poses<'_> {
    fn end(self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        if ended.outcome().report.tracked == 0 {
            return Ok(());
        }
        let option = match self.1 {
            PoseTime::Corrected => "--trajectory",
            PoseTime::Live => "--live-trajectory",
        };
        self.0.write(option, || {
            let poses = ended.run.poses(self.1).into_iter();
            let poses = Trajectory::from_unsorted(poses.map(|(t, pose)| (t.0, pose)).collect())
                .map_err(|e| Failure::new("trajectory", e.to_string(), "report this with the recording"))?;
            Ok(to_tum(&poses).into_bytes())
        })
    }
}

/// The route that is recorded.
pub struct Recording;

impl Sink for Recording {
    fn end(self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        ended.run.close_recording()
    }
}

/// Appends all of them, and the surface.
pub fn add<'a>(sinks: &mut Sinks<'a>, a: &'a Arguments, outputs: &'a Outputs) {
    sinks.add(Some(Report(outputs)));
    sinks.add(Some(Page(outputs)));
    sinks.add(a.mesh.as_deref().map(|path| Written(outputs, path)));
    sinks.add(Some(Poses(outputs, PoseTime::Corrected)));
    sinks.add(Some(Poses(outputs, PoseTime::Live)));
}

const NO_POSE: &str = "check the calibration (cairn rig check), use a longer part of the recording, or show the camera more texture";

/// Prints what the run came to.
///
/// # Errors
/// The failures until here; also when no frame has a pose, or too few of a recording.
pub fn conclude(
    a: &Arguments,
    output: &Output,
    (mut failures, mut ended): (Vec<Failure>, Ended),
) -> Result<(), Failure> {
    let outcome = ended.outcome();
    let (r, live) = (&outcome.report, is_live(&a.source));
    if r.tracked == 0 && outcome.interrupted {
        warn("interrupted before the first pose: there is no trajectory to write");
    } else if r.tracked == 0 && failures.is_empty() {
        let why = outcome.last_state.as_deref().unwrap_or("it has no frames");
        failures.push(Failure::new(&a.source, format!("no frame got a pose: {why}"), NO_POSE));
    }
    let text = |outcome: &Outcome| text::of(outcome, a.realtime || live);
    // A live camera may well show nothing for long; a recording that is lost cannot be relied on. A try of a few frames ends
    // before one camera has seen enough to begin.
    let enough = r.frames >= 100 && !live && !outcome.interrupted;
    if failures.is_empty() && enough && 2 * r.tracked < r.frames {
        output.text(&text(outcome))?;
        let why = format!("only {} of {} frames got a pose", r.tracked, r.frames);
        failures.push(Failure::new(&a.source, why, NO_POSE));
    }
    Failure::all(failures)?;
    output.result(outcome, text)
}
