//! Which tasks a build consists of: those of one step at a time, each from what came of the steps before. Whoever drives it runs the
//! tasks of a step in any order, anywhere, and gives back what came of them in the order of the tasks.

use crate::task::{Atlas, Blob, Mapped, Merged, Outcome, Pair, Result as Found, Source, Task};
use crate::{Digest, FleetError, Job, places, recording};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Of each map so many pairs for each of its stretches are verified, the most alike first.
const PARTNERS: usize = 4;

/// A build under way.
pub struct Build {
    job: Job,
    /// The tasks that were given out and have not come back.
    out: Vec<Task>,
    /// The step after those.
    step: Step,
    /// The maps by digest, each with the recordings that gave it.
    maps: BTreeMap<Digest, (Mapped, Vec<String>)>,
    shards: Vec<Digest>,
    pairs: Vec<Pair>,
    /// Pairs that geometry verified, each with the roots of the maps of both files.
    joined: Vec<((Digest, usize), (Digest, usize))>,
    /// What is connected, each with its map file.
    parts: Vec<(Vec<Digest>, Option<Merged>)>,
    tiles: Vec<Blob>,
    report: Report,
}

#[derive(Clone, Copy, PartialEq)]
enum Step {
    Map,
    Index,
    Pairs,
    Verify,
    Merge,
    Tiles,
    Publish,
    Done,
}

/// What came of a build.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Recordings found.
    pub recordings: usize,
    /// Those of which there is no map, with the reason.
    pub unmapped: Vec<(String, String)>,
    /// Different maps.
    pub maps: usize,
    /// Key frames of all maps.
    pub key_frames: usize,
    /// Seconds recorded.
    pub recorded_s: f64,
    /// Pairs of maps that there are.
    pub pairs: u64,
    /// By how many bits two stretches must be more alike than by chance before geometry verifies whether their maps share places:
    pub enough: u32,
    /// so many pairs have and are verified,
    pub candidates: usize,
    /// and so many do by geometry.
    pub verified: usize,
    /// Pairs of recordings that do.
    pub joined: Vec<(String, String)>,
    /// Candidates that geometry keeps apart, with the reason.
    pub apart: Vec<String>,
    /// For each atlas its recordings; of one that is several maps after all, those of each.
    pub atlases: Vec<Vec<Vec<String>>>,
    /// Tiles of all atlases, their bytes, and their key frames (those of margins counted again).
    pub tiles: usize,
    /// Bytes of the tiles.
    pub tile_bytes: u64,
    /// Key frames of the tiles.
    pub tile_key_frames: usize,
    /// The index of tiles.
    pub index: Option<Blob>,
    /// The digest of the whole: that of `atlas.json`.
    pub digest: Option<Digest>,
    /// What each step cost, in the order of the steps.
    pub costs: Vec<Cost>,
}

/// What a step cost.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Cost {
    /// The step.
    pub step: &'static str,
    /// Its tasks.
    pub tasks: usize,
    /// Those that had been done before.
    pub reused: usize,
    /// Seconds of all tasks together, and of the longest.
    pub seconds: f64,
    /// Seconds of the longest.
    pub longest_s: f64,
    /// Bytes read from stores.
    pub read_bytes: u64,
    /// Bytes written.
    pub written_bytes: u64,
}

impl Build {
    /// A build of these recordings.
    ///
    /// # Errors
    /// When a number of the job or its configuration is wrong.
    pub fn new(job: Job) -> Result<Self, FleetError> {
        job.checked()?;
        Ok(Self {
            job,
            out: Vec::new(),
            step: Step::Map,
            maps: BTreeMap::new(),
            shards: Vec::new(),
            pairs: Vec::new(),
            joined: Vec::new(),
            parts: Vec::new(),
            tiles: Vec::new(),
            report: Report::default(),
        })
    }

    /// What came so far.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Takes what came of the tasks given out last, in their order (nothing at first), and gives the tasks of the next step; none when
    /// all is done.
    ///
    /// # Errors
    /// When the recordings cannot be listed, or the outcomes are not those of the tasks.
    pub fn next(&mut self, outcomes: Vec<Outcome>) -> Result<Vec<Task>, FleetError> {
        let tasks = std::mem::take(&mut self.out);
        if tasks.len() != outcomes.len() {
            let why = format!("{} outcomes for {} tasks", outcomes.len(), tasks.len());
            return Err(FleetError::new("build", why, "give back one outcome for each task, in their order"));
        }
        self.count(&tasks, &outcomes);
        for (task, outcome) in tasks.into_iter().zip(outcomes) {
            self.take(task, outcome.result)?;
        }
        while self.out.is_empty() && self.step != Step::Done {
            self.out = self.tasks()?;
        }
        Ok(self.out.clone())
    }

    fn count(&mut self, tasks: &[Task], outcomes: &[Outcome]) {
        let Some(first) = tasks.first() else { return };
        let seconds = outcomes.iter().map(|o| o.seconds);
        self.report.costs.push(Cost {
            step: first.name(),
            tasks: tasks.len(),
            reused: outcomes.iter().filter(|o| o.reused).count(),
            seconds: seconds.clone().sum(),
            longest_s: seconds.fold(0.0, f64::max),
            read_bytes: outcomes.iter().map(|o| o.read_bytes).sum(),
            written_bytes: outcomes.iter().map(|o| o.written_bytes).sum(),
        });
    }

    fn take(&mut self, task: Task, result: Found) -> Result<(), FleetError> {
        match (task, result) {
            (Task::Map { recording }, Found::Mapped(mapped)) => {
                let of = self.maps.entry(mapped.map.digest).or_insert((mapped, Vec::new()));
                of.1.push(recording);
            }
            (Task::Map { recording }, Found::Unmapped { why }) => self.report.unmapped.push((recording, why)),
            (Task::Index { .. }, Found::Indexed { shard }) => self.shards.push(shard.digest),
            (Task::Pairs { .. }, Found::Paired(found)) => {
                self.report.enough = found.enough;
                self.pairs = found.pairs;
            }
            (Task::Verify { a, b }, Found::Verified(found)) => {
                if found.joined.is_empty() {
                    self.report.apart.push(format!(
                        "{} and {}: {}",
                        self.name(a),
                        self.name(b),
                        found.apart.join("; ")
                    ));
                } else {
                    self.report.joined.push((self.name(a), self.name(b)));
                }
                self.joined.extend(found.joined.iter().map(|j| ((a, j.roots[0]), (b, j.roots[1]))));
            }
            (Task::Merge { maps, .. }, Found::Merged(merged)) => {
                for line in &merged.apart {
                    let named = maps
                        .iter()
                        .fold(line.clone(), |line, map| line.replace(&map.to_string(), &self.name(*map)));
                    self.report.apart.push(named);
                }
                if let Some(part) = self.parts.iter_mut().find(|(of, _)| *of == maps) {
                    part.1 = Some(merged);
                }
            }
            (Task::Tiles { .. }, Found::Tiled(tiled)) => {
                self.report.tiles += tiled.tiles;
                self.report.tile_bytes += tiled.bytes;
                self.report.tile_key_frames += tiled.key_frames;
                self.tiles.push(tiled.list);
            }
            (Task::Publish { .. }, Found::Published(published)) => {
                self.report.index = Some(published.index);
                self.report.digest = Some(published.atlas.digest);
            }
            (task, _) => {
                let why = format!("the outcome of a task of the step {} is of another step", task.name());
                return Err(FleetError::new(
                    "build",
                    why,
                    "give the outcomes back in the order of the tasks",
                ));
            }
        }
        Ok(())
    }

    /// The tasks of the step that is next; there may be none.
    fn tasks(&mut self) -> Result<Vec<Task>, FleetError> {
        let (tasks, next) = match self.step {
            Step::Map => {
                let names = recording::names(&self.job.recordings)?;
                self.report.recordings = names.len();
                (names.into_iter().map(|recording| Task::Map { recording }).collect(), Step::Index)
            }
            Step::Index => (self.index(), Step::Pairs),
            Step::Pairs => {
                let task = (!self.shards.is_empty()).then(|| Task::Pairs { shards: self.shards.clone() });
                (task.into_iter().collect(), Step::Verify)
            }
            Step::Verify => (self.verify(), Step::Merge),
            Step::Merge => (self.merge(), Step::Tiles),
            Step::Tiles => {
                let atlas = |part: &(Vec<Digest>, Option<Merged>)| Task::Tiles { atlas: self.atlas_of(part) };
                (self.parts.iter().map(atlas).collect(), Step::Publish)
            }
            Step::Publish => (self.publish(), Step::Done),
            Step::Done => (Vec::new(), Step::Done),
        };
        self.step = next;
        Ok(tasks)
    }

    fn index(&mut self) -> Vec<Task> {
        self.report.maps = self.maps.len();
        self.report.pairs = (self.maps.len() * self.maps.len().saturating_sub(1) / 2) as u64;
        self.report.key_frames = self.maps.values().map(|(mapped, _)| mapped.key_frames).sum();
        self.report.recorded_s = self.maps.values().map(|(mapped, _)| mapped.recorded_s).sum();
        let mut shards: BTreeMap<u64, Vec<(Digest, Digest)>> = BTreeMap::new();
        for (map, (mapped, _)) in &self.maps {
            // By the content alone, so that a map that is added changes one shard.
            let start = map.0.iter().take(4).fold(0, |n, b| n << 8 | u64::from(*b));
            shards.entry(start % self.job.shards as u64).or_default().push((*map, mapped.places.digest));
        }
        shards.into_values().map(|maps| Task::Index { maps }).collect()
    }

    /// Of each map the pairs that are most alike, some for each of its stretches.
    fn verify(&mut self) -> Vec<Task> {
        let mut of_map: BTreeMap<Digest, Vec<(u32, Digest, Digest)>> = BTreeMap::new();
        for Pair { a, b, bits } in std::mem::take(&mut self.pairs) {
            for map in [a, b] {
                of_map.entry(map).or_default().push((bits, a, b));
            }
        }
        let mut chosen = BTreeSet::new();
        for (map, mut pairs) in of_map {
            let stretches = self.maps.get(&map).map_or(0, |(m, _)| m.key_frames.div_ceil(places::STRETCH));
            pairs.sort_by(|x, y| y.cmp(x));
            chosen.extend(pairs.into_iter().take(PARTNERS * stretches).map(|(_, a, b)| (a, b)));
        }
        self.report.candidates = chosen.len();
        chosen.into_iter().map(|(a, b)| Task::Verify { a, b }).collect()
    }

    fn merge(&mut self) -> Vec<Task> {
        self.report.verified = self.report.joined.len();
        self.joined.sort();
        let maps: Vec<Digest> = self.maps.keys().copied().collect();
        let place: BTreeMap<Digest, usize> = maps.iter().enumerate().map(|(n, map)| (*map, n)).collect();
        let mut group: Vec<usize> = (0..maps.len()).collect();
        for ((a, _), (b, _)) in &self.joined {
            let (a, b) = (root(&mut group, place[a]), root(&mut group, place[b]));
            group[a.max(b)] = a.min(b);
        }
        let mut parts: BTreeMap<usize, Vec<Digest>> = BTreeMap::new();
        for (n, map) in maps.iter().enumerate() {
            parts.entry(root(&mut group, n)).or_default().push(*map);
        }
        self.parts = parts.into_values().map(|of| (of, None)).collect();
        let several = self.parts.iter().filter(|(of, _)| of.len() > 1);
        let task = several.map(|(of, _)| {
            let pairs = self.joined.iter().filter_map(|((a, x), (b, y))| {
                Some([(of.binary_search(a).ok()?, *x), (of.binary_search(b).ok()?, *y)])
            });
            Task::Merge { maps: of.clone(), pairs: pairs.collect() }
        });
        task.collect()
    }

    fn publish(&mut self) -> Vec<Task> {
        let atlases: Vec<Atlas> = (self.parts.iter().zip(&self.tiles))
            .map(|((of, merged), tiles)| {
                let sources = of.iter().enumerate().map(|(n, map)| Source {
                    recordings: self.maps.get(map).map(|(_, names)| names.clone()).unwrap_or_default(),
                    map: *map,
                    robots: merged
                        .as_ref()
                        .and_then(|m| m.robots.get(n))
                        .cloned()
                        .unwrap_or_else(|| vec![(0, 0)]),
                });
                let own =
                    || Blob { digest: of[0], bytes: self.maps.get(&of[0]).map_or(0, |(m, _)| m.map.bytes) };
                let map = merged.as_ref().map_or_else(own, |merged| merged.map.clone());
                Atlas { map, sources: sources.collect(), tiles: tiles.clone() }
            })
            .collect();
        self.report.atlases = (self.parts.iter())
            .map(|(of, merged)| match merged {
                None => vec![vec![self.name(of[0])]],
                Some(merged) => {
                    merged.parts.iter().map(|part| part.iter().map(|n| self.name(of[*n])).collect()).collect()
                }
            })
            .collect();
        if atlases.is_empty() { Vec::new() } else { vec![Task::Publish { atlases }] }
    }

    fn atlas_of(&self, (of, merged): &(Vec<Digest>, Option<Merged>)) -> Digest {
        merged.as_ref().map_or(of[0], |merged| merged.map.digest)
    }

    /// The first recording that gave a map.
    fn name(&self, map: Digest) -> String {
        let names = self.maps.get(&map).map(|(_, names)| names.as_slice()).unwrap_or_default();
        names.first().cloned().unwrap_or_else(|| map.to_string())
    }
}

/// The first of a group, with the ways to it made shorter (union-find).
fn root(group: &mut [usize], mut n: usize) -> usize {
    while group[n] != n {
        group[n] = group[group[n]];
        n = group[n];
    }
    n
}
