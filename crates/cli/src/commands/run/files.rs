//! The files that a run reads and writes.

use super::arguments::Arguments;
use super::say::Say;
use crate::failure::Failure;
use crate::outputs::Outputs;
use cairn_rerun::viewer;
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
