//! Values that are in memory or on disk: features and words of key frames that nobody looks at.
//!
//! A [`Paged`] value is used as if it were in memory; where it is not, it is read back, the same to the last bit, and stays
//! until it is paged out again (`paging.rs`). Where it cannot be read, something that matches nothing stands in for it, and
//! the fault is kept for whoever asks ([`Faults`]); nothing is ever saved from what stands in.

use crate::store::StoreError;
use std::fmt::Debug;
use std::io;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// Why features or words of a key frame cannot be read back from the disk.
#[derive(Debug, thiserror::Error)]
pub enum ReadBackError {
    /// The file they were paged out to cannot be read.
    #[error("what was paged out cannot be read back: {0}")]
    Pages(#[source] io::Error),
    /// They are not what was written.
    #[error("what was paged out was altered on the disk")]
    Altered,
    /// The saved map they are in cannot be read.
    #[error(transparent)]
    Saved(#[from] StoreError),
}

/// Where a value is read back from.
pub(crate) trait Source<T>: Debug + Send + Sync {
    /// Reads it.
    fn read(&self) -> Result<Arc<T>, ReadBackError>;
    /// Keeps the fault, and gives what stands in for the value.
    fn placeholder(&self, fault: ReadBackError) -> Arc<T>;
}

/// The first fault of reading something back.
#[derive(Clone, Debug, Default)]
pub(crate) struct Faults(Arc<OnceLock<ReadBackError>>);

impl Faults {
    /// Keeps a fault, if it is the first.
    pub fn keep(&self, fault: ReadBackError) {
        // A later one is told by the first.
        let _ = self.0.set(fault);
    }

    /// The first fault.
    pub fn first(&self) -> Option<&ReadBackError> {
        self.0.get()
    }
}

/// A value in memory or on disk. Clones share it.
pub struct Paged<T>(Arc<Cell<T>>);

struct Cell<T> {
    value: OnceLock<Arc<T>>,
    /// Whether somebody has looked at it since that was last asked.
    used: AtomicBool,
    source: Option<Arc<dyn Source<T>>>,
}

impl<T> Paged<T> {
    /// One that is on disk.
    pub(crate) fn on_disk(source: Arc<dyn Source<T>>) -> Self {
        Self(Arc::new(Cell { value: OnceLock::new(), used: AtomicBool::new(false), source: Some(source) }))
    }

    /// Whether this is the same value, and in memory.
    pub fn is(&self, value: &Arc<T>) -> bool {
        self.in_memory().is_some_and(|here| Arc::ptr_eq(here, value))
    }

    /// The value, where it is in memory.
    pub fn in_memory(&self) -> Option<&Arc<T>> {
        self.0.value.get()
    }

    /// Where it is read back from, if it is on disk.
    pub(crate) fn source(&self) -> Option<&Arc<dyn Source<T>>> {
        self.0.source.as_ref()
    }

    /// Whether somebody has looked at it since this was last asked.
    pub(crate) fn was_used(&self) -> bool {
        self.0.used.swap(false, Ordering::Relaxed)
    }
}

impl<T: Default> Paged<T> {
    /// The value, read back where it is on disk; it stays in memory.
    pub fn shared(&self) -> Arc<T> {
        self.read_back().clone()
    }

    /// The value for a moment: read where it is on disk, but not kept in memory.
    pub(crate) fn glance(&self) -> Result<Arc<T>, ReadBackError> {
        match (self.in_memory(), self.source()) {
            (None, Some(source)) => source.read(),
            _ => Ok(self.shared()),
        }
    }

    fn read_back(&self) -> &Arc<T> {
        let cell = &*self.0;
        if !cell.used.load(Ordering::Relaxed) {
            cell.used.store(true, Ordering::Relaxed);
        }
        cell.value.get_or_init(|| match &cell.source {
            Some(source) => source.read().unwrap_or_else(|fault| source.placeholder(fault)),
            None => Arc::default(),
        })
    }
}

impl<T: Default + Clone> Paged<T> {
    /// Changes a copy of the value, which is in memory from now on.
    pub(crate) fn change(&mut self, by: impl FnOnce(&mut T)) {
        let mut own = self.shared();
        by(Arc::make_mut(&mut own));
        *self = own.into();
    }
}

impl<T> From<Arc<T>> for Paged<T> {
    fn from(value: Arc<T>) -> Self {
        Self(Arc::new(Cell { value: OnceLock::from(value), used: AtomicBool::new(true), source: None }))
    }
}

impl<T> Clone for Paged<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T: Default> Default for Paged<T> {
    fn default() -> Self {
        Self::from(Arc::default())
    }
}

impl<T: Default> Deref for Paged<T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.read_back()
    }
}

impl<T: Default + Debug> Debug for Paged<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (**self).fmt(f)
    }
}

impl<T: Default + PartialEq> PartialEq for Paged<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}
