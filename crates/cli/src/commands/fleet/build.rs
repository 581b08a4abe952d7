//! `cairn fleet build`: the build over Ray, which the Python package drives, or in this process, one task after the other.

use super::failed;
use crate::failure::Failure;
use crate::output::{Output, note};
use crate::progress::Progress;
use cairn_fleet::{Build, Job, Report};
use serde_json::Value;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Maps recorded walks, joins the maps that show the same places, and publishes the atlas in tiles.
///
/// The work is done by Ray (PyPI: ray), on this machine or a cluster, through Cairn's Python package; CAIRN_PYTHON names the interpreter
/// that has both. Whatever is done is in the store and is not done again: a build that was stopped, or lost workers, goes on where it was
/// when the same command is given again, and ends with the same atlas. docs/fleet.md tells how.
#[derive(clap::Args)]
pub struct Arguments {
    /// Where the recordings are: each folder, bag or video directly in this folder, or below s3://BUCKET/PREFIX, is one.
    #[arg(value_name = "FOLDER|s3://...")]
    recordings: String,
    /// The store to build into: a folder, or s3://BUCKET/PREFIX. It may hold what an earlier build made.
    #[arg(long, value_name = "FOLDER|s3://...")]
    out: String,
    /// Configuration entries that differ from the defaults; see cairn config.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Two maps become one only where they overlap over this many metres: more than a room, which may have a copy. With 0 all that
    /// agree do, as in cairn map merge.
    #[arg(long, default_value_t = 5.0, value_name = "M")]
    overlap: f64,
    /// Edge of the cubes into which the atlas is cut, metres.
    #[arg(long, default_value_t = 20.0, value_name = "M")]
    tile: f64,
    /// How far beyond its cube a tile has key frames, metres.
    #[arg(long, default_value_t = 4.0, value_name = "M")]
    margin: f64,
    /// Shards of the index of places; one for each few hundred recordings.
    #[arg(long, default_value_t = 1, value_name = "N")]
    shards: usize,
    /// Workers on this machine; by default one for each core.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    workers: Option<u32>,
    /// The address of a Ray cluster, such as auto or ray://HOST:10001; its machines must have the Python package, and reach recordings
    /// and store under these addresses.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "workers")]
    ray: Option<String>,
    /// Without Ray, in this process, one task after the other.
    #[arg(long, conflicts_with_all = ["workers", "ray"])]
    in_order: bool,
}

/// Builds.
///
/// # Errors
/// When recordings or store cannot be reached, or Ray is missing.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let config = match &a.config {
        None => String::new(),
        Some(path) => cairn_files::read_text(path, cairn_files::MIB).map_err(|e| {
            Failure::new(path.display().to_string(), e.to_string(), "cairn config prints all entries")
        })?,
    };
    let job = Job {
        config,
        overlap_m: a.overlap,
        tile_m: a.tile,
        margin_m: a.margin,
        shards: a.shards,
        ..Job::new(&a.recordings, &a.out)
    };
    // What is wrong with the command is told before Python is started.
    let build = Build::new(job.clone()).map_err(failed)?;
    cairn_fleet::open(&job.recordings).and(cairn_fleet::open(&job.store)).map_err(failed)?;
    let report = if a.in_order { value(&in_order(build, &job)?)? } else { over_ray(a, &job)? };
    output.result(&report, text)
}

fn value(report: &Report) -> Result<Value, Failure> {
    serde_json::to_value(report).map_err(|e| Failure::new("report", e.to_string(), "report this"))
}

fn in_order(mut build: Build, job: &Job) -> Result<Report, Failure> {
    let mut tasks = build.next(Vec::new()).map_err(failed)?;
    while let Some(first) = tasks.first() {
        note(&format!("{}: {} tasks", first.name(), tasks.len()));
        let progress = Progress::new(Some(tasks.len()));
        let mut outcomes = Vec::new();
        for (n, task) in tasks.iter().enumerate() {
            outcomes.push(cairn_fleet::run(job, task).map_err(failed)?);
            progress.step(n + 1);
        }
        drop(progress);
        tasks = build.next(outcomes).map_err(failed)?;
    }
    Ok(build.report().clone())
}

const INSTALL: &str = "pip install ray ./crates/python (in the sources of Cairn), name that Python in CAIRN_PYTHON, or build --in-order without Ray";

/// Starts the driver of the Python package; it tells on stderr what it does, and its report on stdout.
fn over_ray(a: &Arguments, job: &Job) -> Result<Value, Failure> {
    let python = std::env::var("CAIRN_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = Command::new(&python)
        .args(["-c", "import cairn.fleet, ray"])
        .stdin(Stdio::null())
        .output()
        .map_err(|e| Failure::new(&python, format!("it cannot be started ({e})"), INSTALL))?;
    if !has.status.success() {
        let said = String::from_utf8_lossy(&has.stderr);
        let last = said.lines().last().unwrap_or("it does not tell why").to_owned();
        return Err(Failure::new(
            &python,
            format!("Ray or Cairn's Python package is missing: {last}"),
            INSTALL,
        ));
    }
    let job = serde_json::to_string(job).map_err(|e| Failure::new("job", e.to_string(), "report this"))?;
    let mut command = Command::new(&python);
    command.args(["-m", "cairn.fleet", "--job", &job]);
    if let Some(workers) = a.workers {
        command.args(["--workers", &workers.to_string()]);
    }
    if let Some(address) = &a.ray {
        command.args(["--ray", address]);
    }
    let failed = |e: std::io::Error| Failure::new(&python, e.to_string(), INSTALL);
    let mut driver = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()
        .map_err(failed)?;
    // Closed by the system when this process ends, however it does: the driver then ends, too.
    let alive = driver.stdin.take();
    let done = driver.wait_with_output().map_err(failed)?;
    drop(alive);
    if !done.status.success() {
        let hint = "see above; give the command again to go on where it was";
        return Err(Failure::new("fleet build", format!("the driver ended with {}", done.status), hint));
    }
    // Ray may print lines of its own before and behind, such as that a worker died.
    let said = String::from_utf8_lossy(&done.stdout);
    let read = |line: &str| serde_json::from_str::<Value>(line).ok().filter(|v| v.get("costs").is_some());
    said.lines().rev().find_map(read).ok_or_else(|| {
        Failure::new("fleet build", "the driver gave no report", "is its package of this version?")
    })
}

fn text(r: &Value) -> String {
    let mut text = String::new();
    let number = |key: &str| r[key].as_u64().unwrap_or(0);
    let list = |key: &str| r[key].as_array().cloned().unwrap_or_default();
    let words = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "recordings {}, {:.0} s; {} maps of {} key frames",
        number("recordings"),
        r["recorded_s"].as_f64().unwrap_or(0.0),
        number("maps"),
        number("key_frames")
    );
    for unmapped in list("unmapped") {
        let _ = writeln!(text, "unmapped   {}: {}", words(&unmapped[0]), words(&unmapped[1]));
    }
    let _ = writeln!(
        text,
        "pairs      {}; {} alike by {} bits or more, {} verified by geometry",
        number("pairs"),
        number("candidates"),
        number("enough"),
        number("verified")
    );
    for line in list("apart") {
        let _ = writeln!(text, "apart      {}", words(&line));
    }
    for atlas in list("atlases") {
        let parts = atlas.as_array().cloned().unwrap_or_default();
        let names = |part: &Value| -> String {
            let names: Vec<String> = part.as_array().into_iter().flatten().map(words).collect();
            names.join(" + ")
        };
        let _ = writeln!(text, "atlas      {}", parts.iter().map(names).collect::<Vec<_>>().join(" | "));
    }
    let _ = writeln!(
        text,
        "tiles      {}, {:.1} MB, {} key frames; index {:.2} MB",
        number("tiles"),
        number("tile_bytes") as f64 / 1e6,
        number("tile_key_frames"),
        r["index"]["bytes"].as_f64().unwrap_or(0.0) / 1e6
    );
    for cost in list("costs") {
        let _ = writeln!(
            text,
            "{:<10} {} tasks, {} done before; {:.1} s together, {:.1} s the longest; {:.1} MB read, {:.1} MB written",
            words(&cost["step"]),
            cost["tasks"],
            cost["reused"],
            cost["seconds"].as_f64().unwrap_or(0.0),
            cost["longest_s"].as_f64().unwrap_or(0.0),
            cost["read_bytes"].as_f64().unwrap_or(0.0) / 1e6,
            cost["written_bytes"].as_f64().unwrap_or(0.0) / 1e6
        );
    }
    let digest = r["digest"].as_str().unwrap_or("nothing was published: there is no map");
    let _ = writeln!(text, "digest     {digest}");
    text
}
