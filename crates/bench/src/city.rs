//! `city`: many generated walks along one street, each a saved map, given to the steps of `cairn fleet build` up to the verified pairs: what
//! they cost by the number of walks, and whether the pairs are those of walks that overlap.

use crate::MeasureError;
use crate::error::{file, of};
use crate::store::camera;
use crate::street::build::build;
use crate::street::world::Street;
use cairn_atlas::store::{About, MapFile};
use cairn_fleet::{Build, Job, Task, run};
use cairn_random::Random;
use cairn_vision::SensorMode;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Features of a frame, at most.
const FEATURES: usize = 1000;
/// What two walks must share before they are one place, metres: what `cairn fleet build` asks for by default.
const OVERLAP_M: f64 = 5.0;
/// What two walks that should be found share, metres: a key frame looks 25 m ahead, but what is near it is what it can be verified by.
const CLEAR_M: f64 = 10.0;

/// A city to be built.
#[derive(Clone, Debug)]
pub struct City {
    /// Generated walks.
    pub walks: usize,
    /// Length of each, metres.
    pub metres: f64,
    /// Other walks that each overlaps with, on average.
    pub meets: f64,
    /// Shards of the index of places.
    pub shards: usize,
    /// Real recordings that are no part of the street.
    pub among: Vec<PathBuf>,
    /// Stops before geometry verifies the pairs.
    pub words: bool,
}

/// What a city cost, and what was found.
#[derive(Clone, Debug)]
pub struct Row {
    walks: usize,
    key_frames: usize,
    /// Seconds by step.
    seconds: BTreeMap<&'static str, f64>,
    enough: u32,
    candidates: usize,
    /// Pairs of walks that share [`CLEAR_M`] or more, and how many of them came out at the end.
    clear: [usize; 2],
    /// What came out at the end, and how many of those share no metre that either sees.
    found: [usize; 2],
}

impl City {
    /// Generates the walks in a fresh folder below this one, and builds up to the pairs.
    ///
    /// # Errors
    /// When files cannot be written, or a step fails.
    pub fn build(&self, below: &Path) -> Result<Row, MeasureError> {
        if self.walks < 2 || self.walks > 9999 || self.metres < 2.0 * CLEAR_M || self.meets <= 0.0 {
            return Err("a city has 2 to 9999 walks of at least 20 m that meet others".into());
        }
        let root = below.join(format!("cairn-bench-city-{}", std::process::id()));
        let row = self.build_in(&root);
        let _ = std::fs::remove_dir_all(&root);
        row
    }

    fn build_in(&self, root: &Path) -> Result<Row, MeasureError> {
        let from = root.join("recordings");
        std::fs::create_dir_all(&from).map_err(file(&from))?;
        let starts = self.generate(&from)?;
        for path in &self.among {
            let name = path.file_name().ok_or_else(|| of(path.display(), "no recording"))?;
            let path = path.canonicalize().map_err(file(path))?;
            std::os::unix::fs::symlink(&path, from.join(name)).map_err(file(&path))?;
        }
        let address = |path: &Path| path.display().to_string();
        let job = Job {
            shards: self.shards,
            overlap_m: OVERLAP_M,
            ..Job::new(&address(&from), &address(&root.join("store")))
        };
        self.pairs(&job, &starts)
    }

    /// Writes the maps of the walks; where each begins.
    fn generate(&self, folder: &Path) -> Result<BTreeMap<String, f64>, MeasureError> {
        let place = 2.0 * self.metres * self.walks as f64 / self.meets;
        let length = 2 * (place + self.metres) as usize + 1000;
        let mut random = Random::new(self.walks as u64);
        let mut starts: Vec<f64> = (0..self.walks).map(|_| random.uniform(0.0, place)).collect();
        starts.sort_by(f64::total_cmp);
        let mut street = Street::new(length, FEATURES);
        let mut named = BTreeMap::new();
        for (n, start) in starts.into_iter().enumerate() {
            let built = build(&mut street, start, start + self.metres, 100 + n as u64);
            let about = About { program: "cairn bench".into(), sensor: SensorMode::Stereo, camera: camera() };
            let snapshot = (**built.atlas.latest()).clone();
            let name = format!("walk-{n:04}.map");
            MapFile { snapshot, about, attached: BTreeMap::new() }.save(&folder.join(&name))?;
            named.insert(name, start);
        }
        Ok(named)
    }

    fn pairs(&self, job: &Job, starts: &BTreeMap<String, f64>) -> Result<Row, MeasureError> {
        let fleet = |e: cairn_fleet::FleetError| of("fleet", e.to_string());
        let mut build = Build::new(job.clone()).map_err(fleet)?;
        let mut names = BTreeMap::new();
        let mut candidates = BTreeSet::new();
        let mut tasks = build.next(Vec::new()).map_err(fleet)?;
        while let Some(first) = tasks.first() {
            eprintln!("{}: {} tasks", first.name(), tasks.len());
            if matches!(first, Task::Merge { .. } | Task::Tiles { .. }) {
                break;
            }
            if let Task::Verify { .. } = first {
                let pair = |task: &Task| match task {
                    Task::Verify { a, b } => Some((*a, *b)),
                    _ => None,
                };
                candidates = tasks.iter().filter_map(pair).collect();
                if self.words {
                    break;
                }
            }
            let mut outcomes = Vec::new();
            for task in &tasks {
                let outcome = run(job, task).map_err(fleet)?;
                if let (Task::Map { recording }, cairn_fleet::StepResult::Mapped(mapped)) =
                    (task, &outcome.result)
                {
                    names.insert(mapped.map.digest, recording.clone());
                }
                outcomes.push(outcome);
            }
            tasks = build.next(outcomes).map_err(fleet)?;
        }
        let name = |digest| names.get(digest).cloned().unwrap_or_default();
        let report = build.report();
        let found: BTreeSet<(String, String)> = if self.words {
            candidates.iter().map(|(a, b)| (name(a), name(b))).collect()
        } else {
            report.joined.iter().cloned().collect()
        };
        let sorted = |(a, b): (String, String)| if a < b { (a, b) } else { (b, a) };
        let found: BTreeSet<_> = found.into_iter().map(sorted).collect();
        for (a, b) in found.iter().filter(|pair| self.is_false(starts, pair)) {
            eprintln!("no part of the street, or apart: {a}, {b}");
        }
        Ok(Row {
            walks: report.maps,
            key_frames: report.key_frames,
            seconds: report.costs.iter().map(|c| (c.step, c.seconds)).collect(),
            enough: report.enough,
            candidates: candidates.len(),
            clear: self.clear(starts, &found),
            found: [found.len(), found.iter().filter(|pair| self.is_false(starts, pair)).count()],
        })
    }

    fn clear(&self, starts: &BTreeMap<String, f64>, found: &BTreeSet<(String, String)>) -> [usize; 2] {
        let mut clear = [0, 0];
        for (a, at) in starts {
            let after =
                starts.iter().filter(|(b, there)| *b > a && (*there - at).abs() < self.metres - CLEAR_M);
            for (b, _) in after {
                clear[0] += 1;
                clear[1] += usize::from(found.contains(&(a.clone(), b.clone())));
            }
        }
        clear
    }

    /// Whether a pair is of walks that nowhere come as near as they see, or of a recording that is no part of the street.
    fn is_false(&self, starts: &BTreeMap<String, f64>, (a, b): &(String, String)) -> bool {
        starts.get(a).zip(starts.get(b)).is_none_or(|(a, b)| (a - b).abs() > self.metres + 25.0)
    }
}

/// The rows as a table; the exponent is that of the seconds of `index` and `pairs` between a row and the one before.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| walks | key frames | index and pairs, s | exponent | ms a walk | verify, s | bits asked for | candidates | clear pairs, found | found, false |\n|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let pairs =
        |r: &Row| r.seconds.iter().filter(|(s, _)| !["map", "verify"].contains(s)).map(|s| s.1).sum::<f64>();
    for (n, r) in rows.iter().enumerate() {
        let before = n.checked_sub(1).and_then(|k| rows.get(k));
        let exponent = before.map_or(String::new(), |b| {
            format!("{:.2}", (pairs(r) / pairs(b)).ln() / (r.walks as f64 / b.walks as f64).ln())
        });
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {:.2} | {exponent} | {:.1} | {:.1} | {} | {} | {}, {} | {}, {} |",
            r.walks,
            r.key_frames,
            pairs(r),
            1e3 * pairs(r) / r.walks as f64,
            r.seconds.get("verify").copied().unwrap_or(f64::NAN),
            r.enough,
            r.candidates,
            r.clear[0],
            r.clear[1],
            r.found[0],
            r.found[1]
        );
    }
    text
}
