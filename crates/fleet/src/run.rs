//! Doing a task: looked up under its key first, done only where it was not, and its result written last.
//!
//! What a step writes is named after its content (`blobs/`), and its result after what it was made from (`steps/`), written once
//! all its blobs are there. So a result that exists is complete, whoever was killed; and a task that two workers do at once is
//! written twice with the same bytes.

use crate::recording::Recording;
use crate::shelf::Shelf;
use crate::task::{Outcome, Result as Found, Task};
use crate::{Digest, FleetError, Job, steps};
use cairn::Config;
use serde::Serialize;
use std::time::Instant;

/// Does a task of a build, or finds it done.
///
/// # Errors
/// When the store or the recordings cannot be reached, or an object is damaged. A recording of which no map can be made is no
/// error: [`Found::Unmapped`].
pub fn run(job: &Job, task: &Task) -> Result<Outcome, FleetError> {
    let config = job.checked()?;
    let began = Instant::now();
    let shelf = Shelf::open(&job.store)?;
    let mut fetched = 0;
    let (key, reused, result) = match task {
        Task::Map { recording } => {
            let recording = Recording::find(&job.recordings, recording)?;
            let found = once(&shelf, task, &(recording.digest()?, &job.config), |shelf| {
                let here = recording.here()?;
                fetched = here.fetched;
                steps::map(shelf, &here.path, &config)
            });
            found?
        }
        Task::Tiles { atlas } => {
            let depends = (atlas, job.tile_m.to_bits(), job.margin_m.to_bits());
            once(&shelf, task, &depends, |shelf| steps::tiles(shelf, *atlas, job.tile_m, job.margin_m))?
        }
        Task::Verify { a, b } => {
            let depends = (task, &job.config, job.overlap_m.to_bits());
            once(&shelf, task, &depends, |shelf| steps::verify(shelf, *a, *b, job.overlap_m, &config))?
        }
        _ => once(&shelf, task, &(task, &job.config), |shelf| other(shelf, task, &config))?,
    };
    if let Found::Published(published) = &result {
        // The one object that is replaced: where a reader begins.
        let bytes = shelf.blob(published.atlas.digest)?;
        shelf.store().put("atlas.json", &bytes)?;
    }
    Ok(Outcome {
        key,
        reused,
        seconds: began.elapsed().as_secs_f64(),
        read_bytes: shelf.read_bytes() + fetched,
        written_bytes: shelf.written_bytes(),
        result,
    })
}

fn other(shelf: &Shelf, task: &Task, config: &Config) -> Result<Found, FleetError> {
    match task {
        Task::Index { maps } => steps::index(shelf, maps),
        Task::Pairs { shards } => steps::pairs(shelf, shards),
        Task::Merge { maps, pairs } => steps::merge(shelf, maps, pairs, config),
        Task::Publish { atlases } => steps::publish(shelf, atlases),
        Task::Map { .. } | Task::Verify { .. } | Task::Tiles { .. } => {
            Err(FleetError::new("task", "it has a key of its own", "report this"))
        }
    }
}

/// The result that is there under the key of a step, or that of doing it.
fn once(
    shelf: &Shelf,
    task: &Task,
    depends_on: &impl Serialize,
    work: impl FnOnce(&Shelf) -> Result<Found, FleetError>,
) -> Result<(Option<Digest>, bool, Found), FleetError> {
    let key = Digest::key(task.name(), depends_on)?;
    if let Some(found) = shelf.done(key)? {
        return Ok((Some(key), true, found));
    }
    let found = work(shelf)?;
    if matches!(found, Found::Unmapped { .. }) {
        return Ok((None, false, found));
    }
    shelf.note(key, &found)?;
    Ok((Some(key), false, found))
}

impl Task {
    /// The name of its step.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Map { .. } => "map",
            Self::Index { .. } => "index",
            Self::Pairs { .. } => "pairs",
            Self::Verify { .. } => "verify",
            Self::Merge { .. } => "merge",
            Self::Tiles { .. } => "tiles",
            Self::Publish { .. } => "publish",
        }
    }
}
