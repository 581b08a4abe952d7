//! The results of a run that are made at its end: the report as JSON and as a page, trajectories.

use super::arguments::Arguments;
use super::outcome::Outcome;
use super::sink::Ended;
use super::sinks::Sinks;
use super::{page, surface, text};
use crate::failure::Failure;
use crate::output::{Output, warn};
use crate::outputs::Outputs;
use cairn_engine::PoseTime;
use cairn_eval::to_tum_with;
use cairn_sources::is_live;

/// Appends them to the list, and the surface.
pub fn add<'a>(sinks: &mut Sinks<'a>, a: &'a Arguments, outputs: &'a Outputs) {
    sinks.at_end(move |ended| report(outputs, ended));
    sinks.at_end(move |ended| report_page(outputs, ended));
    if let Some(path) = &a.mesh {
        sinks.at_end(move |ended| surface::write(outputs, path, ended));
    }
    sinks.at_end(move |ended| poses(outputs, "--trajectory", PoseTime::Corrected, ended));
    sinks.at_end(move |ended| poses(outputs, "--live-trajectory", PoseTime::Live, ended));
}

/// The report as JSON; of a run that failed before its first frame there is none.
fn report(outputs: &Outputs, ended: &mut Ended) -> Result<(), Failure> {
    let failed = ended.failed;
    let outcome = ended.outcome();
    if failed && outcome.report.frames == 0 {
        return Ok(());
    }
    outputs.write("--report", || {
        let text = serde_json::to_string_pretty(outcome)
            .map_err(|e| Failure::new("report", e.to_string(), "leave out --report"))?;
        Ok((text + "\n").into_bytes())
    })
}

/// The report as a page, as [`report`].
fn report_page(outputs: &Outputs, ended: &mut Ended) -> Result<(), Failure> {
    let failed = ended.failed;
    let (outcome, run) = ended.parts();
    let Some(here) = run.here().filter(|_| !failed || outcome.report.frames > 0) else { return Ok(()) };
    let engine = here.session.engine();
    let page = || page::of(outcome, &engine.trajectory(), &engine.snapshot());
    outputs.write("--report-html", || Ok(page().into_bytes()))
}

/// The poses as they are known at the end, or as they were given, if there are any: each frame once and in order.
fn poses(outputs: &Outputs, option: &str, time: PoseTime, ended: &mut Ended) -> Result<(), Failure> {
    if ended.outcome().report.tracked == 0 {
        return Ok(());
    }
    outputs.write(option, || {
        let poses = ended.run.poses(time);
        let trajectory = poses
            .trajectory()
            .map_err(|e| Failure::new("trajectory", e.to_string(), "report this with the recording"))?;
        Ok(to_tum_with(&poses.header(), &trajectory).into_bytes())
    })
}

const NO_POSE: &str = "check the calibration (cairn rig check), use a longer part of the recording, or show the camera more texture";

const SKIPPED: &str = "mend what was skipped: the reasons are above";

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
        // What skipped them all, or most of them, explains it better than where tracking was left.
        let skipped = r.skips.iter().filter(|s| s.what == "frame").max_by_key(|s| s.count);
        let (why, cure) = match skipped.filter(|s| 2 * s.count > r.frames) {
            Some(s) => (format!("{} of {} were skipped, the first: {}", s.count, r.frames, s.first), SKIPPED),
            None => (outcome.last_state.clone().unwrap_or_else(|| "it has no frames".into()), NO_POSE),
        };
        failures.push(Failure::new(&a.source, format!("no frame got a pose: {why}"), cure));
    }
    let text = |outcome: &Outcome| text::of(outcome, a.realtime || live);
    // A live camera may well show nothing for long; a recording that is lost cannot be relied on, however short it is. Only a try
    // of a few frames (--frames) may end before one camera has seen enough to begin.
    let whole = (a.frames.is_none() || r.frames >= 100) && !live && !outcome.interrupted;
    if failures.is_empty() && whole && 2 * r.tracked < r.frames {
        output.text(&text(outcome))?;
        let why = format!("only {} of {} frames got a pose", r.tracked, r.frames);
        let cure = match 2 * (r.dropped + r.skipped) > r.frames - r.tracked {
            true if r.dropped > r.skipped => "leave out --realtime, or end what else runs here",
            true => SKIPPED,
            false => NO_POSE,
        };
        failures.push(Failure::new(&a.source, why, cure));
    }
    Failure::all(failures)?;
    output.result(outcome, text)
}
