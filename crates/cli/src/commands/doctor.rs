//! `cairn doctor`: what this machine has and lacks, what was tried to find it, and what is affected by each missing item.

use super::cameras::{self, Cameras};
use crate::failure::Failure;
use crate::output::Output;
use serde::Serialize;
use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Checks this machine: processor, memory, optional programs, cameras and test recordings.
#[derive(clap::Args)]
pub struct Arguments {}

#[derive(Serialize)]
struct Report {
    version: &'static str,
    target: String,
    checked_build: bool,
    cores: Option<usize>,
    memory_mb: Option<u64>,
    memory_available_mb: Option<u64>,
    cpu_features: Vec<Feature>,
    programs: Vec<Program>,
    cameras: Cameras,
    data: Data,
}

/// An instruction set that some inner loop has a version for.
#[derive(Serialize)]
struct Feature {
    name: &'static str,
    present: bool,
}

/// An external program that Cairn may start; needed only for `used_for`.
#[derive(Serialize)]
struct Program {
    name: &'static str,
    used_for: &'static str,
    /// What to do to get it.
    install: &'static str,
    /// Where it was found.
    path: Option<PathBuf>,
    /// The folders of PATH that were searched, in order.
    searched: Vec<PathBuf>,
    /// What it prints about itself when it is started.
    version: Option<String>,
    /// Why it cannot be used although it is there, or how it was looked for in vain.
    problem: Option<String>,
}

/// Where tests look for recordings.
#[derive(Serialize)]
struct Data {
    path: PathBuf,
    present: bool,
    recordings: Vec<String>,
}

/// Inspects the machine and prints a table or JSON.
///
/// # Errors
/// When stdout cannot be written.
pub fn run(_: &Arguments, output: &Output) -> Result<(), Failure> {
    let (memory_mb, memory_available_mb) = memory();
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
        checked_build: cfg!(debug_assertions),
        cores: std::thread::available_parallelism().ok().map(usize::from),
        memory_mb,
        memory_available_mb,
        cpu_features: cpu_features(),
        programs: programs(std::env::var_os("PATH")),
        cameras: cameras::found(),
        data: data(std::env::var_os("CAIRN_DATA").map(PathBuf::from)),
    };
    output.result(&report, table)
}

fn table(report: &Report) -> String {
    let unknown = || "unknown".to_owned();
    let mut lines = vec![
        ("cairn".to_owned(), format!("{} on {}", report.version, report.target)),
        (
            "build".to_owned(),
            match report.checked_build {
                true => "debug: many times slower, build with --release".to_owned(),
                false => "release".to_owned(),
            },
        ),
        ("cores".to_owned(), report.cores.map_or_else(unknown, |n| n.to_string())),
    ];
    let memory = match (report.memory_mb, report.memory_available_mb) {
        (Some(all), Some(free)) => format!("{all} MB, {free} MB free"),
        (Some(all), None) => format!("{all} MB"),
        _ => unknown(),
    };
    lines.push(("memory".to_owned(), memory));
    for feature in &report.cpu_features {
        let state = if feature.present { "yes" } else { "no: slower code is used instead" };
        lines.push((format!("cpu {}", feature.name), state.to_owned()));
    }
    if report.cpu_features.is_empty() {
        lines.push((
            "cpu".to_owned(),
            "portable code: there is no SIMD version for this processor".to_owned(),
        ));
    }
    for program in &report.programs {
        let state = match &program.path {
            Some(path) => match &program.version {
                Some(version) => format!("{version}, {}", path.display()),
                None => path.display().to_string(),
            },
            None => "not found".to_owned(),
        };
        lines.push((program.name.to_owned(), state));
        if let Some(problem) = &program.problem {
            lines.push((String::new(), format!("{problem}; needed only for {}", program.used_for)));
            lines.push((String::new(), format!("cure: {}", program.install)));
        }
    }
    lines.extend(cameras::lines(&report.cameras));
    let data = &report.data;
    let recordings = match (data.present, data.recordings.is_empty()) {
        (false, _) => "not found: tests on recordings are skipped; set CAIRN_DATA".to_owned(),
        (true, true) => "the folder is empty".to_owned(),
        (true, false) => data.recordings.join(" "),
    };
    lines.push(("recordings".to_owned(), format!("{}: {recordings}", data.path.display())));
    let width = lines.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    lines.iter().map(|(name, state)| format!("{name:width$}  {state}\n")).collect()
}

/// The instruction sets that some loop has a version for; every loop also has a scalar one.
#[cfg(target_arch = "x86_64")]
fn cpu_features() -> Vec<Feature> {
    macro_rules! features {
        ($($name:tt),*) => { vec![$(Feature { name: $name, present: is_x86_feature_detected!($name) }),*] };
    }
    features!("popcnt", "avx2", "avx512vpopcntdq")
}

#[cfg(not(target_arch = "x86_64"))]
fn cpu_features() -> Vec<Feature> {
    Vec::new()
}

/// Total and available memory in megabytes, where `/proc/meminfo` exists.
fn memory() -> (Option<u64>, Option<u64>) {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    (meminfo(&text, "MemTotal:"), meminfo(&text, "MemAvailable:"))
}

/// One field of `/proc/meminfo`, which counts in kB, as megabytes.
fn meminfo(text: &str, field: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(field))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kb| kb / 1024)
}

/// The programs that may be started: name, argument that makes it tell its version, use, and how to get it.
const PROGRAMS: [(&str, &str, &str, &str); 7] = [
    (
        "ffmpeg",
        "-version",
        "video files, cameras, rtsp:// and rtmp:// streams",
        "apt install ffmpeg (Debian, Ubuntu), brew install ffmpeg (macOS), winget install ffmpeg (Windows)",
    ),
    (
        "espeak-ng",
        "--version",
        "--say speech and --say wav:FILE; the page of cairn serve speaks by itself",
        "apt install espeak-ng (Debian, Ubuntu), brew install espeak-ng (macOS), winget install espeak-ng (Windows)",
    ),
    ("aplay", "--version", "sounds beside --say speech", "apt install alsa-utils (Debian, Ubuntu)"),
    (
        "cairn-rerun",
        "--version",
        "cairn run --rerun",
        "cargo install --path crates/rerun --features sdk, in the sources of Cairn",
    ),
    (
        "cairn-view",
        "--version",
        "cairn view",
        "cargo install --path crates/view --features window, in the sources of Cairn",
    ),
    (
        "cairn-ros",
        "--version",
        "cairn ros",
        "cargo install --path crates/ros --features dds, in the sources of Cairn",
    ),
    (
        "ray",
        "--version",
        "cairn fleet build over several workers; --in-order does without",
        "pip install ray ./crates/python, in the sources of Cairn",
    ),
];

fn programs(search: Option<OsString>) -> Vec<Program> {
    let folders: Vec<PathBuf> = search.iter().flat_map(std::env::split_paths).collect();
    PROGRAMS
        .map(|(name, argument, used_for, install)| {
            let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
            let path = folders.iter().map(|folder| folder.join(&file)).find(|path| path.is_file());
            let (version, problem) = match &path {
                Some(path) => match version(path, argument) {
                    Ok(version) => (Some(version), None),
                    Err(why) => (None, Some(format!("tried {} {argument}: {why}", path.display()))),
                },
                None => (None, Some(searched(&file, &folders))),
            };
            Program { name, used_for, install, path, searched: folders.clone(), version, problem }
        })
        .into()
}

fn searched(file: &str, folders: &[PathBuf]) -> String {
    if folders.is_empty() {
        return format!("looked for {file}, but PATH names no folder");
    }
    let list: Vec<String> = folders.iter().map(|f| f.display().to_string()).collect();
    format!("looked for {file} in the folders of PATH: {}", list.join(", "))
}

/// How long a program may take to tell its version.
const PATIENCE: Duration = Duration::from_secs(3);

/// Why a program did not tell its version.
#[derive(Debug, thiserror::Error)]
enum ProgramError {
    #[error("it cannot be started ({0})")]
    Start(#[source] std::io::Error),
    #[error("it did not answer in {} s", PATIENCE.as_secs())]
    Silent,
    #[error("it ended with {0}")]
    Ended(ExitStatus),
}

/// Starts the program; returns the first line that it prints.
fn version(path: &Path, argument: &str) -> Result<String, ProgramError> {
    let mut child = Command::new(path)
        .arg(argument)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(ProgramError::Start)?;
    let output = child.stdout.take();
    // What it prints is short, and is read on a thread in case it prints without end.
    let reader = std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = output.map(|out| out.take(4096).read_to_end(&mut text));
        text
    });
    let began = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if began.elapsed() < PATIENCE => std::thread::sleep(Duration::from_millis(5)),
            _ => {
                // It may have ended already.
                let _ = child.kill();
                let _ = child.wait();
                return Err(ProgramError::Silent);
            }
        }
    };
    let text = reader.join().unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let line = text.lines().next().unwrap_or_default().trim();
    match (status.success(), line) {
        (false, _) => Err(ProgramError::Ended(status)),
        (true, "") => Ok("found".to_owned()),
        // What comes after the version is about its makers.
        (true, line) => Ok(line.split(" Copyright").next().unwrap_or(line).trim().to_owned()),
    }
}

fn data(named: Option<PathBuf>) -> Data {
    let path = named.unwrap_or_else(|| PathBuf::from("../shared/data"));
    let mut recordings = folders_of(&path);
    recordings.sort();
    Data { present: path.is_dir(), recordings, path }
}

fn folders_of(path: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten();
    entries.filter(|e| e.path().is_dir()).map(|e| e.file_name().to_string_lossy().into_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meminfo_is_converted_to_megabytes() {
        let text = "MemTotal:        8000000 kB\nMemFree: 1 kB\n";
        assert_eq!(meminfo(text, "MemTotal:"), Some(7812));
        assert_eq!(meminfo(text, "MemAvailable:"), None);
        assert_eq!(meminfo("MemTotal: many kB", "MemTotal:"), None);
    }

    #[cfg(unix)]
    #[test]
    fn programs_are_found_or_it_is_said_what_was_tried() {
        use std::os::unix::fs::PermissionsExt;
        let folder = std::env::temp_dir().join(format!("cairn-doctor-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let program = |name: &str, script: &str| {
            let path = folder.join(name);
            std::fs::write(&path, script).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        };
        program("ffmpeg", "#!/bin/sh\necho 'ffmpeg version 9.9 Copyright (c) its makers'\n");
        program("espeak-ng", "#!/bin/sh\nexit 3\n");
        let found = programs(Some(folder.clone().into_os_string()));
        let of = |name: &str| found.iter().find(|p| p.name == name).unwrap();
        assert_eq!(of("ffmpeg").version.as_deref(), Some("ffmpeg version 9.9"));
        assert!(of("ffmpeg").problem.is_none());
        let broken = of("espeak-ng").problem.clone().unwrap();
        assert!(broken.contains("--version: it ended with") && broken.contains("3"), "{broken}");
        let missing = of("aplay");
        assert!(
            missing.path.is_none() && missing.problem.as_ref().unwrap().contains(folder.to_str().unwrap())
        );
        assert!(
            programs(None).iter().all(|p| p.problem.as_ref().is_some_and(|why| why.contains("no folder")))
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
