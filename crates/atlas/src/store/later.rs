//! Features of a saved map that stay in its file until somebody looks at a key frame.
//!
//! All parts of the file are compared with their checksums when it is opened, so that damage is told then; a part of features
//! is compared again when it is read. The file is held open: one that takes its name later is another file.

use super::container::Entry;
use super::decode::decode_features;
use super::error::StoreError;
use super::in_file::Places;
use super::layout::{CHUNK, FEATURES};
use crate::KeyFrame;
use crate::paged::{Faults, Paged, ReadBackError, Source};
use crate::record::Record;
use cairn_sensor::Stamp;
use cairn_vision::bow::{BagOfWords, Vocabulary};
use cairn_vision::{Frame, Octaves, RectifiedCamera};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Seek, SeekFrom};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Parts of features that stay unpacked: neighbours are looked at one after the other.
const UNPACKED: usize = 2;

/// The features in an open file.
#[derive(Debug)]
pub(super) struct LaterFeatures {
    file: Mutex<File>,
    /// The parts of features, each with where it begins.
    parts: Vec<(Entry, u64)>,
    rows: OnceLock<Rows>,
    unpacked: Mutex<VecDeque<(usize, Vec<Arc<Frame>>)>>,
    faults: Faults,
}

/// What is known of the key frames without their features.
#[derive(Debug)]
struct Rows {
    octaves: Octaves,
    features: Vec<u32>,
    stamps: Vec<Stamp>,
    bounds: Vec<[f32; 4]>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl LaterFeatures {
    /// Of a file with these parts.
    pub fn new(file: File, places: &Places) -> Self {
        let parts = places.entries.iter().filter(|(entry, _)| entry.name.starts_with(FEATURES));
        Self {
            file: Mutex::new(file),
            parts: parts.cloned().collect(),
            rows: OnceLock::new(),
            unpacked: Mutex::default(),
            faults: Faults::default(),
        }
    }

    /// Where faults are kept.
    pub fn faults(&self) -> Faults {
        self.faults.clone()
    }

    /// The bytes of a part, not yet checked.
    pub fn stored(&self, (entry, at): &(Entry, u64), into: &mut Vec<u8>) -> io::Result<()> {
        let mut file = locked(&self.file);
        file.seek(SeekFrom::Start(*at))?;
        entry.read(&mut *file, into)
    }

    /// Compares all features with their checksums.
    pub fn check(&self) -> Result<(), StoreError> {
        let mut stored = Vec::new();
        self.parts.iter().try_for_each(|part| {
            self.stored(part, &mut stored).map_err(reading)?;
            part.0.check(&stored)
        })
    }

    /// Gives key frames their features, which are read from here when somebody looks at them.
    pub fn give(
        self: &Arc<Self>,
        key_frames: &mut [KeyFrame],
        camera: &RectifiedCamera,
        octaves: Octaves,
        features: &[u32],
    ) -> Result<(), StoreError> {
        for i in 0..key_frames.len().div_ceil(CHUNK) {
            let name = format!("{FEATURES}{i}");
            if self.parts.get(i).is_none_or(|(entry, _)| entry.name != name) {
                return Err(StoreError::part(&name, "it is missing"));
            }
        }
        let rows = Rows {
            octaves,
            features: features.to_vec(),
            stamps: key_frames.iter().map(|k| k.stamp).collect(),
            bounds: key_frames.iter().map(|k| k.camera(camera).bounds.map(|b| b as f32)).collect(),
        };
        // A file is opened once.
        let _ = self.rows.set(rows);
        for (row, (k, features)) in key_frames.iter_mut().zip(features).enumerate() {
            k.landmarks = vec![None; *features as usize];
            k.frame = Paged::on_disk(Arc::new(Saved { of: self.clone(), row }));
        }
        Ok(())
    }

    /// The words of a key frame of [`LaterFeatures::give`], computed from its features when they are looked at.
    pub fn words(self: &Arc<Self>, row: usize) -> Paged<BagOfWords> {
        Paged::on_disk(Arc::new(Saved { of: self.clone(), row }))
    }

    fn frame(&self, row: usize) -> Result<Arc<Frame>, StoreError> {
        let (part, at) = (row / CHUNK, row % CHUNK);
        let mut unpacked = locked(&self.unpacked);
        let known = unpacked.iter().find(|(n, _)| *n == part).and_then(|(_, frames)| frames.get(at)).cloned();
        if let Some(frame) = known {
            return Ok(frame);
        }
        let frames = self.unpack(part)?;
        let frame = frames.get(at).cloned();
        if unpacked.len() == UNPACKED {
            unpacked.pop_front();
        }
        unpacked.push_back((part, frames));
        frame.ok_or_else(|| StoreError::part(FEATURES, "a key frame has none"))
    }

    fn unpack(&self, part: usize) -> Result<Vec<Arc<Frame>>, StoreError> {
        let (Some(at), Some(rows)) = (self.parts.get(part), self.rows.get()) else {
            return Err(StoreError::part(FEATURES, "they were not found"));
        };
        let (mut stored, mut plain) = (Vec::new(), Vec::new());
        self.stored(at, &mut stored).map_err(reading)?;
        at.0.unpack(&stored, &mut plain)?;
        let span = part * CHUNK..rows.features.len().min((part + 1) * CHUNK);
        let frames =
            decode_features(&at.0.name, &plain, rows.octaves, &rows.features[span.clone()], &mut Vec::new())?;
        let finished = frames.into_iter().zip(span).map(|(mut frame, row)| {
            frame.stamp = rows.stamps[row];
            frame.index_in(rows.bounds[row]);
            Arc::new(frame)
        });
        Ok(finished.collect())
    }
}

fn reading(source: io::Error) -> StoreError {
    StoreError::File { path: Default::default(), doing: "cannot read", source }
}

/// The features of one key frame in the file.
#[derive(Debug)]
struct Saved {
    of: Arc<LaterFeatures>,
    row: usize,
}

impl Source<Frame> for Saved {
    fn read(&self) -> Result<Arc<Frame>, ReadBackError> {
        Ok(self.of.frame(self.row)?)
    }

    fn placeholder(&self, fault: ReadBackError) -> Arc<Frame> {
        self.of.faults.keep(fault);
        let features = self.of.rows.get().and_then(|rows| rows.features.get(self.row));
        Arc::new(Frame::placeholder(features.map_or(0, |n| *n as usize)))
    }
}

impl Source<BagOfWords> for Saved {
    fn read(&self) -> Result<Arc<BagOfWords>, ReadBackError> {
        let frame = self.of.frame(self.row)?;
        Ok(Arc::new(Vocabulary::current().bag(&frame.descriptors)))
    }

    fn placeholder(&self, fault: ReadBackError) -> Arc<BagOfWords> {
        self.of.faults.keep(fault);
        Arc::default()
    }
}
