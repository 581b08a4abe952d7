//! What is run: recordings, their sensors, repeats.

use crate::failure::Failure;
use cairn_engine::SensorMode;
use cairn_engine::Sensors;
use cairn_sensor::Rig;
use cairn_sources::{OpenOptions, open};
use std::collections::BTreeSet;
use std::path::Path;

/// One run.
#[derive(Clone, Debug)]
pub struct Task {
    /// The name of the recording, unique among those of this table.
    pub sequence: String,
    /// The recording as `cairn run` takes it.
    pub source: String,
    pub sensor: Sensors,
    /// From 1.
    pub repeat: u16,
    /// How often it is run.
    pub repeats: u16,
}

impl Task {
    /// The name of its folder.
    pub fn folder(&self) -> String {
        let once = format!("{}.{}", self.sequence, self.sensor.name());
        if self.repeats > 1 { format!("{once}.{}", self.repeat) } else { once }
    }
}

/// All runs in order, and what is no recording.
///
/// # Errors
/// When a source cannot be opened and is no folder of recordings, or no recording has any of the sensors.
pub fn tasks(
    sources: &[String],
    only: &[Sensors],
    repeats: u16,
) -> Result<(Vec<Task>, Vec<String>), Failure> {
    let (mut tasks, mut left_out, mut names) = (Vec::new(), Vec::new(), BTreeSet::new());
    for source in sources {
        for (path, rig) in recordings(source, &mut left_out)? {
            let sequence = unique(&path, &mut names);
            let wanted = sensors(&rig).into_iter().filter(|s| only.is_empty() || only.contains(s));
            for sensor in wanted {
                tasks.extend((1..=repeats).map(|repeat| Task {
                    sequence: sequence.clone(),
                    source: path.clone(),
                    sensor,
                    repeat,
                    repeats,
                }));
            }
        }
    }
    if tasks.is_empty() {
        let names: Vec<&str> = only.iter().map(|s| s.name()).collect();
        let why = if names.is_empty() {
            "no recording".into()
        } else {
            format!("no recording with {}", names.join(" or "))
        };
        return Err(Failure::new(
            sources.join(", "),
            format!("holds {why}"),
            "cairn run --help lists the kinds of recordings",
        ));
    }
    Ok((tasks, left_out))
}

/// The recording itself, or those directly in the folder.
fn recordings(source: &str, left_out: &mut Vec<String>) -> Result<Vec<(String, Rig)>, Failure> {
    let rig_of = |source: &str| open(source, OpenOptions::default()).map(|s| s.rig().clone());
    let error = match rig_of(source) {
        Ok(rig) => return Ok(vec![(source.to_owned(), rig)]),
        Err(error) => error,
    };
    let Ok(entries) = Path::new(source).read_dir() else { return Err(error.into()) };
    let mut paths: Vec<_> =
        entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| is_recording_like(p)).collect();
    paths.sort();
    let mut found = Vec::new();
    for path in paths {
        let name = path.display().to_string();
        match rig_of(&name) {
            Ok(rig) => found.push((name, rig)),
            Err(e) => left_out.push(e.to_string()),
        }
    }
    if found.is_empty() { Err(error.into()) } else { Ok(found) }
}

/// Folders, and files that are recordings by their ending.
fn is_recording_like(path: &Path) -> bool {
    const ENDINGS: [&str; 7] = ["bag", "db3", "mcap", "mp4", "mkv", "mov", "avi"];
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    path.is_dir() || ending.is_some_and(|e| ENDINGS.contains(&e.as_str()))
}

/// What a rig can be used as, without the IMU first.
fn sensors(rig: &Rig) -> Vec<Sensors> {
    let modes = [
        (SensorMode::Mono, true),
        (SensorMode::Stereo, rig.cameras.len() > 1),
        (SensorMode::Rgbd, rig.depth.is_some()),
    ];
    let modes: Vec<SensorMode> = modes.into_iter().filter_map(|(mode, has)| has.then_some(mode)).collect();
    let imu = [false, true].into_iter().filter(|with| !with || rig.imu.is_some());
    imu.flat_map(|with| modes.iter().map(move |mode| Sensors::with(*mode, with))).collect()
}

/// The last part of the path in letters that every file system takes, with a number where another has the same name.
fn unique(path: &str, names: &mut BTreeSet<String>) -> String {
    let last = path.trim_end_matches('/').rsplit('/').next().unwrap_or(path);
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    let base: String = last.chars().map(plain).collect();
    let mut name = base.clone();
    let mut k = 2;
    while !names.insert(name.clone()) {
        name = format!("{base}-{k}");
        k += 1;
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_plain() {
        let mut names = BTreeSet::new();
        let all = ["/a/mh01/", "/b/mh01", "sim:house?seed=1&rate=5"].map(|p| unique(p, &mut names));
        assert_eq!(all, ["mh01", "mh01-2", "sim-house-seed-1-rate-5"]);
    }
}
