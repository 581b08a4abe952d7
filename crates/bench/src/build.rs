//! Which build figures were measured with, and on what: written beside them, so that old figures can be told.

use std::process::Command;

/// The processor and the commit of this checkout, as in "AMD EPYC, at commit 1a2b3c4".
pub fn measured_on() -> String {
    let cpu = cairn_eval::process::cpu_model().unwrap_or_else(|| "an unknown processor".into());
    let commit = match (commit(), git(&["status", "--porcelain", "--", "*.rs"])) {
        (Some(commit), Some(changes)) if changes.is_empty() => format!("commit {commit}"),
        (Some(commit), _) => format!("commit {commit} with changes"),
        _ => "an unknown commit".into(),
    };
    format!("{cpu}, at {commit}")
}

/// The commit of this checkout.
pub fn commit() -> Option<String> {
    git(&["rev-parse", "--short", "HEAD"])
}

fn git(arguments: &[&str]) -> Option<String> {
    let out = Command::new("git").args(["-C", env!("CARGO_MANIFEST_DIR")]).args(arguments).output().ok()?;
    out.status.success().then(|| String::from_utf8_lossy(&out.stdout).trim().to_owned())
}
