//! Where further connections of the pages come in (`beside.rs`): those who have the id and the secret of a page.

use axum::extract::ws::Message;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{Semaphore, broadcast, mpsc};

/// Where the further connections of the pages come in.
#[derive(Default)]
pub(crate) struct Doors(Mutex<HashMap<u64, Door>>);

/// Where those of one page come in.
pub(crate) struct Door {
    pub secret: String,
    pub came: mpsc::Sender<(u64, Message)>,
    pub copies: broadcast::WeakSender<Arc<str>>,
    pub places: Arc<Semaphore>,
}

impl Doors {
    /// With all of them locked, by the ids of their pages.
    pub fn all<T>(&self, what: impl FnOnce(&mut HashMap<u64, Door>) -> T) -> T {
        what(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
