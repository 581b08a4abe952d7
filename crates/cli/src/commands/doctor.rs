//! `cairn doctor`: what this machine has and lacks, and what is affected by each missing item.

use crate::failure::Failure;
use crate::output::Output;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Checks this machine: processor, memory, optional programs and test recordings.
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
    path: Option<PathBuf>,
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
            Some(path) => path.display().to_string(),
            None => format!("not found: needed only for {}", program.used_for),
        };
        lines.push((program.name.to_owned(), state));
    }
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

fn programs(search: Option<std::ffi::OsString>) -> Vec<Program> {
    let folders: Vec<PathBuf> = search.iter().flat_map(std::env::split_paths).collect();
    let find = |name: &str| {
        let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
        folders.iter().map(|folder| folder.join(&file)).find(|path| path.is_file())
    };
    [
        ("ffmpeg", "video files and network cameras, which are not read yet"),
        ("espeak-ng", "speech, which is not spoken yet"),
    ]
    .map(|(name, used_for)| Program { name, used_for, path: find(name) })
    .into()
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

    #[test]
    fn programs_are_found_on_the_given_path() {
        let folder = std::env::temp_dir().join(format!("cairn-doctor-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(format!("ffmpeg{}", std::env::consts::EXE_SUFFIX)), "").unwrap();
        let found = programs(Some(folder.clone().into_os_string()));
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(found.iter().any(|p| p.name == "ffmpeg" && p.path.is_some()));
        assert!(found.iter().any(|p| p.name == "espeak-ng" && p.path.is_none()));
        assert!(programs(None).iter().all(|p| p.path.is_none()));
    }
}
