//! Further connections of a page beside its first: a segment that is lost on one of them holds up nothing on the others.
//!
//! A page opens them once it has been greeted and the link is known to have room for them, with its id and secret. They belong
//! to its task: what comes on them is handled as if it came on the first, and what must not wait goes to the page on all. Words
//! and commands are numbered, so that each is taken once and in order (`InOrder`); of images and their times the newest
//! counts. They end with the first connection, and a page whose further connections fail goes on without.

use crate::connection::Connection;
use crate::doors::Door;
use crate::hub::Hub;
use crate::link::GONE_AFTER;
use crate::token::same;
use crate::wire::{self, ToPage};
use axum::extract::ws::Message;
use std::sync::Arc;
use tokio::sync::{Semaphore, broadcast, mpsc};

/// Further connections that a page may have.
const MOST: usize = 2;
/// Messages that may wait for the page's task, and for a connection that hangs.
const WAITING: usize = 16;
const BEHIND: usize = 64;

/// The further connections of one page, as its task sees them.
pub(crate) struct Beside {
    id: u64,
    hub: Arc<Hub>,
    came: mpsc::Receiver<(u64, Message)>,
    copies: broadcast::Sender<Arc<str>>,
    numbered: u64,
}

impl Beside {
    /// Those of a page that has this id; none come in where it has no secret by which they are recognised.
    pub fn new(hub: &Arc<Hub>, id: u64, secret: &str) -> Self {
        let ((tell, came), copies) = (mpsc::channel(WAITING), broadcast::Sender::new(BEHIND));
        if !secret.is_empty() {
            let places = Arc::new(Semaphore::new(MOST));
            let door = Door { secret: secret.to_owned(), came: tell, copies: copies.downgrade(), places };
            hub.doors.all(|doors| doors.insert(id, door));
        }
        Self { id, hub: hub.clone(), came, copies, numbered: 0 }
    }

    /// The next message, and the number of the connection on which it came, which is not 0.
    pub async fn recv(&mut self) -> (u64, Message) {
        match self.came.recv().await {
            Some(message) => message,
            None => std::future::pending().await,
        }
    }

    /// Sends on all of them what also goes on the first.
    pub fn copy(&self, text: &str) {
        // It is not an error that there are none.
        let _ = self.copies.send(text.into());
    }

    /// The message with the next number, which is sent on all of them.
    pub fn number(&mut self, text: &str) -> String {
        let open = text.strip_suffix('}').unwrap_or(text);
        let text = format!("{open},\"no\":{}}}", self.numbered);
        self.numbered += 1;
        self.copy(&text);
        text
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.hub.doors.all(|doors| doors.remove(&self.id));
    }
}

/// A further connection of the page with this id and secret, until it or the first ends.
pub(crate) async fn beside(mut connection: Connection, hub: Arc<Hub>, id: u64, secret: &str) {
    let known = hub.doors.all(|doors| {
        let door = doors.get(&id).filter(|door| same(&door.secret, secret))?;
        let place = door.places.clone().try_acquire_owned().ok()?;
        Some((place, door.came.clone(), door.copies.upgrade()?.subscribe()))
    });
    let Some((_place, came, mut copies)) = known else { return };
    let on = hub.number();
    let mut out = Some(Arc::from(ToPage::Beside(true).text()));
    loop {
        if let Some(text) = out {
            let message = Message::Text(<Arc<str>>::as_ref(&text).into());
            if !matches!(tokio::time::timeout(GONE_AFTER, connection.send(message)).await, Ok(true)) {
                return;
            }
        }
        out = tokio::select! {
            copy = copies.recv() => match copy {
                Ok(text) => Some(text),
                // What is missing comes on the first connection.
                Err(broadcast::error::RecvError::Lagged(_)) => None,
                Err(broadcast::error::RecvError::Closed) => return,
            },
            message = connection.recv() => match message {
                Some(message) => match came.try_send((on, message)) {
                    // The page must not wait for an image that there was no room for; texts come on the first connection too.
                    Err(mpsc::error::TrySendError::Full((_, Message::Binary(bytes)))) => {
                        let ms = wire::picture(&bytes).map(|(ms, _)| ms);
                        ms.map(|ms| ToPage::Got { ms, overtaken: true }.text().into())
                    }
                    Err(mpsc::error::TrySendError::Closed(_)) => return,
                    _ => None,
                },
                None => return,
            },
        };
    }
}
