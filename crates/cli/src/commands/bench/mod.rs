//! `cairn bench`: many recordings, sensors and repeats in one table.
//!
//! Every run is a process of its own (`cairn run`), so that a crash ends one row and not the table, and peak memory is
//! that of the run.

mod page;
mod plan;
mod row;
mod table;

use super::run::sensors;
use crate::failure::Failure;
use crate::output::{Output, note};
use crate::{interrupt, style};
use cairn_engine::Sensors;
use cairn_eval::{load_trajectory, process, to_euroc, to_kitti, write_whole};
use plan::Task;
use row::Row;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Runs SLAM on many recordings and writes one table: ATE, RPE, coverage, scale, live ATE, times, memory.
///
/// FOLDER is a recording, or a folder of recordings. Each runs with every sensor that it has, or with those of --sensor.
/// Into --out go index.html with figures, table.md, runs.csv, and for each run a folder with its report and its
/// trajectory in the formats of TUM, EuRoC and KITTI.
#[derive(clap::Args)]
pub struct Arguments {
    /// Recordings, folders of recordings, or simulated worlds (sim:...).
    #[arg(required = true, value_name = "FOLDER")]
    sources: Vec<String>,
    /// The folder to write; it must be new or empty.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Only these sensors, separated by commas.
    #[arg(long, value_parser = sensors(), value_delimiter = ',', value_name = "WHICH")]
    sensor: Vec<Sensors>,
    /// How often each is run. Without --realtime the poses are the same every time; times and memory are not.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000), value_name = "N")]
    repeats: u16,
    /// Plays the recordings at the speed of their cameras, on threads, as a live run.
    #[arg(long)]
    realtime: bool,
    /// Stops each run after N frames.
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Configuration entries that differ from the defaults; see cairn config.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

/// All runs.
#[derive(Serialize)]
struct Results {
    version: &'static str,
    /// The processor, if the system tells.
    processor: Option<String>,
    cores: usize,
    realtime: bool,
    runs: Vec<Row>,
    /// What was found in the folders and is no recording.
    left_out: Vec<String>,
}

/// Runs everything, one after the other, and writes the tables.
///
/// # Errors
/// When nothing can be run, the folder cannot be written, or a run failed.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let (tasks, left_out) = plan::tasks(&arguments.sources, &arguments.sensor, arguments.repeats)?;
    let fresh = arguments.out.read_dir().map_or(true, |mut entries| entries.next().is_none());
    let name = arguments.out.display().to_string();
    if !fresh {
        return Err(Failure::usage(name, "is not empty", "give a new folder with --out"));
    }
    let cannot =
        |e: std::io::Error| Failure::new(&name, e.to_string(), "choose a folder that can be written");
    std::fs::create_dir_all(arguments.out.join("runs")).map_err(cannot)?;
    for what in &left_out {
        note(&format!("left out: {what}"));
    }
    interrupt::in_order();
    let mut runs = Vec::new();
    for (k, task) in tasks.iter().enumerate() {
        if interrupt::requested() {
            break;
        }
        let Some(row) = measured(arguments, task)? else { break };
        note(&format!("[{}/{}] {}", k + 1, tasks.len(), row.line()));
        runs.push(row);
    }
    let results = Results {
        version: env!("CARGO_PKG_VERSION"),
        processor: process::cpu_model(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        realtime: arguments.realtime,
        runs,
        left_out,
    };
    let write = |file: &str, text: String| {
        write_whole(&arguments.out.join(file), &text)
            .map_err(|e| Failure::new(e.file, e.reason, "choose a folder that can be written"))
    };
    write("runs.csv", table::csv(&results.runs))?;
    write("table.md", table::markdown(&results))?;
    write("index.html", page::of(&results))?;
    output.result(&results, |r| {
        format!("{}\n{}", table::markdown(r), arguments.out.join("index.html").display())
    })?;
    match results.runs.iter().filter(|r| r.failed.is_some()).count() {
        0 => Ok(()),
        n => Err(Failure::new(
            "bench",
            format!("{n} of {} runs failed", results.runs.len()),
            "read their lines above",
        )),
    }
}

/// One run in a process of its own; a run that fails is a row too, one that a signal cuts short is none.
fn measured(arguments: &Arguments, task: &Task) -> Result<Option<Row>, Failure> {
    let folder = arguments.out.join("runs").join(task.folder());
    let cannot = |e: std::io::Error| {
        Failure::new(folder.display().to_string(), e.to_string(), "check that the disk has room")
    };
    std::fs::create_dir_all(&folder).map_err(cannot)?;
    let me = std::env::current_exe().map_err(|e| {
        Failure::new("bench", format!("this program does not find itself: {e}"), "it needs /proc; mount it")
    })?;
    let mut command = Command::new(me);
    command.args(["run", &task.source, "--sensor", task.sensor.name()]);
    for (option, file) in [
        ("--report", "report.json"),
        ("--report-html", "report.html"),
        ("--trajectory", "trajectory.tum"),
        ("--live-trajectory", "live.tum"),
    ] {
        command.arg(option).arg(folder.join(file));
    }
    if arguments.realtime {
        command.arg("--realtime");
    }
    if let Some(frames) = arguments.frames {
        command.args(["--frames", &frames.to_string()]);
    }
    if let Some(config) = &arguments.config {
        command.arg("--config").arg(config);
    }
    let log = folder.join("log.txt");
    let said = std::fs::File::create(&log).map_err(cannot)?;
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(said).spawn().map_err(cannot)?;
    let status = loop {
        if interrupt::requested() {
            // Nothing is written of a run that is cut short: its figures would look like those of a whole one.
            let _ = child.kill().and_then(|()| child.wait());
            return Ok(None);
        }
        match child.try_wait().map_err(cannot)? {
            Some(status) => break status,
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    let row = if status.success() {
        Row::read(task, &std::fs::read_to_string(folder.join("report.json")).map_err(cannot)?)
    } else {
        // The last line says what failed, why and what to do.
        let said = std::fs::read_to_string(&log).unwrap_or_default();
        let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
        Row::failed(task, format!("{last} ({status})"))
    };
    convert(&folder);
    Ok(Some(row))
}

/// Writes the trajectory also in the formats of EuRoC and KITTI. Without a pose there is none, and nothing to convert.
fn convert(folder: &Path) {
    let Ok(file) = load_trajectory(&folder.join("trajectory.tum")) else { return };
    for (name, text) in
        [("trajectory.csv", to_euroc(&file.trajectory)), ("trajectory.kitti", to_kitti(&file.trajectory))]
    {
        if let Err(e) = write_whole(&folder.join(name), &text) {
            note(&format!("{} {}: {}", style::on_stderr(style::Paint::Wrong, "error:"), e.file, e.reason));
        }
    }
}
