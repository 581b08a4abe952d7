//! The files of a run: which there are, and writing reports and trajectories at its end.

use super::arguments::{Arguments, TrajectoryFrame};
use super::outcome::Outcome;
use super::page;
use super::say::Say;
use super::tally::Tally;
use crate::failure::Failure;
use crate::outputs::Outputs;
use cairn_engine::{CameraPoses, Engine, PoseTime};
use cairn_eval::{TrajectoryHeader, to_tum_with};
use cairn_geometry::{Se3, Trajectory};
use cairn_rerun::viewer;
use cairn_sensor::Rig;
use std::fs::File;
use std::path::Path;

/// Checks before the run that every result can be written.
///
/// # Errors
/// Wrong usage where an output is an input or another output; a failure where one exists or cannot be written.
pub fn checked(a: &Arguments) -> Result<Outputs, Failure> {
    let wav = match &a.say {
        Some(Say::Wav(path)) => Some(path.as_path()),
        _ => None,
    };
    let outputs = Outputs::new(a.overwrite)
        .input("the source", Some(Path::new(&a.source)))
        .input("--rig", a.rig.as_deref())
        .input("--config", a.config.as_deref())
        .input("--vocabulary", a.vocabulary.as_deref())
        .input("--script", a.script.as_deref())
        .input("--guide", a.guide.as_deref())
        .input("--replay", a.replay.as_deref())
        .input("--map-in", a.map_in.as_deref())
        .output("--trajectory", a.trajectory.as_deref())
        .output("--live-trajectory", a.live_trajectory.as_deref())
        .output("--report", a.report.as_deref())
        .output("--report-html", a.report_html.as_deref())
        .output("--events", a.events.as_deref())
        .output("--mcap", a.mcap.as_deref())
        .output("--rerun", a.rerun.as_deref().filter(|to| viewer(to).is_none()))
        .output("--mesh", a.mesh.as_deref())
        .output("--journal", a.journal.as_deref())
        .output("--say wav:", wav)
        .output_map("--team-map", a.team_map.as_deref())
        .output_map_over("--map-out", a.map_out.as_deref(), "--map-in")
        .output_kept("--record", a.record.as_deref())
        .checked()?;
    // An existing route is continued if it was recorded in the opened map.
    let new = |route: &&Path| a.map_in.is_none() || !route.exists();
    let Some(route) = outputs.file("--record").filter(new) else { return Ok(outputs) };
    // Created and removed again, to detect a folder that is not writable.
    let created =
        File::options().write(true).create_new(true).open(route).and_then(|_| std::fs::remove_file(route));
    created.map_err(|e| {
        let hint = match e.kind() {
            std::io::ErrorKind::AlreadyExists => "a recorded route is never overwritten: give another name",
            _ => "check that its folder is writable and the disk has room",
        };
        Failure::new(route.display().to_string(), e.to_string(), hint)
    })?;
    Ok(outputs)
}

/// Writes the reports.
pub fn write_reports(outputs: &Outputs, engine: &Engine, ended: &Outcome, tally: &Tally) -> Vec<Failure> {
    let json = || {
        let text = serde_json::to_string_pretty(ended)
            .map_err(|e| Failure::new("report", e.to_string(), "leave out --report"))?;
        Ok((text + "\n").into_bytes())
    };
    let html = || Ok(page::of(ended, tally, &engine.trajectory(), &engine.snapshot()).into_bytes());
    [outputs.write("--report", json), outputs.write("--report-html", html)]
        .into_iter()
        .filter_map(Result::err)
        .collect()
}

/// Where the first camera is on the body, if trajectories are asked for of it.
pub fn body_from_cam0(whose: TrajectoryFrame, rig: &Rig) -> Option<Se3> {
    let camera = rig.cameras.first().map(|c| c.body_from_camera);
    camera.filter(|_| matches!(whose, TrajectoryFrame::Cam0))
}

/// Writes the trajectories.
pub fn write_trajectories(outputs: &Outputs, body_from_cam0: Option<Se3>, engine: &Engine) -> Vec<Failure> {
    write_poses(outputs, body_from_cam0, engine.log().frames().len(), &|time| engine.camera_poses(time))
}

/// Writes trajectories of these poses: each frame once and in order, of the body or of the first camera (`body_from_cam0`).
pub fn write_poses(
    outputs: &Outputs,
    body_from_cam0: Option<Se3>,
    frames: usize,
    poses: &dyn Fn(PoseTime) -> CameraPoses,
) -> Vec<Failure> {
    let poses = |time: PoseTime| {
        let poses = poses(time);
        let body_from_frame = body_from_cam0.unwrap_or(poses.body_from_frame());
        let is_body = body_from_cam0.is_none() && poses.is_metric();
        let header = TrajectoryHeader {
            frame: if is_body { "body" } else { "cam0" }.into(),
            body_from_frame,
            metric: poses.is_metric(),
            frames: Some(frames),
        };
        let list = poses.of_mounted(&body_from_frame).into_iter();
        let trajectory = Trajectory::from_unsorted(list.map(|(t, pose)| (t.0, pose)).collect())
            .map_err(|e| Failure::new("trajectory", e.to_string(), "report this with the recording"))?;
        Ok(to_tum_with(&header, &trajectory).into_bytes())
    };
    [
        outputs.write("--trajectory", || poses(PoseTime::Corrected)),
        outputs.write("--live-trajectory", || poses(PoseTime::Live)),
    ]
    .into_iter()
    .filter_map(Result::err)
    .collect()
}
