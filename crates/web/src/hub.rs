//! Shared state of the pages and the session's thread: who is connected, who controls, what is to be sent.

use crate::wire::ToPage;
use cairn_session::{Command, Inbox};
use cairn_sources::PhonePort;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{broadcast, watch};

/// How many utterances, sounds and answers a slow page may be behind.
const BEHIND: usize = 256;

/// Bytes that are sent to several pages.
pub(crate) type Shared = Arc<[u8]>;

/// The hub.
pub(crate) struct Hub {
    /// The access token.
    pub token: String,
    /// Description of the session's camera, for people; empty when it is the page's own.
    pub camera: String,
    /// Receives the pictures of the page's camera.
    pub port: PhonePort,
    /// Receives the commands.
    pub inbox: Arc<Inbox>,
    /// The session has started and takes commands.
    pub running: AtomicBool,
    /// Someone has asked to end the server.
    pub shutting_down: AtomicBool,
    /// How many pages want pictures.
    pub pictures_wanted: AtomicU64,
    /// How many pages want the map.
    pub maps_wanted: AtomicU64,
    /// Messages that must all arrive, in order.
    pub messages: broadcast::Sender<Arc<str>>,
    /// The status, of which only the newest matters.
    pub status: watch::Sender<Arc<str>>,
    pub view: watch::Sender<Arc<str>>,
    pub picture: watch::Sender<Shared>,
    controller: Mutex<Option<u64>>,
    next: AtomicU64,
}

impl Hub {
    pub fn new(token: String, camera: String) -> Self {
        let empty: Arc<str> = "".into();
        Self {
            token,
            camera,
            port: PhonePort::default(),
            inbox: Inbox::new(),
            running: AtomicBool::new(false),
            shutting_down: AtomicBool::new(false),
            pictures_wanted: AtomicU64::new(0),
            maps_wanted: AtomicU64::new(0),
            messages: broadcast::Sender::new(BEHIND),
            status: watch::Sender::new(empty.clone()),
            view: watch::Sender::new(empty),
            picture: watch::Sender::new(Arc::from([].as_slice())),
            controller: Mutex::new(None),
            next: AtomicU64::new(1),
        }
    }

    /// A number for a page that has connected.
    pub fn number(&self) -> u64 {
        self.next.fetch_add(1, Ordering::Relaxed)
    }

    /// Ends the session, also one that still waits for its first picture.
    pub fn shut_down(&self) {
        self.shutting_down.store(true, Ordering::Relaxed);
        self.inbox.command(Command::Quit);
        self.port.close();
    }

    /// Sends a message to every page.
    pub fn broadcast(&self, message: &ToPage) {
        // No connected page is not a failure.
        let _ = self.messages.send(message.text().into());
    }

    /// Takes control, when no page has it.
    pub fn take(&self, id: u64) -> bool {
        let mut controller = self.controller.lock().unwrap_or_else(PoisonError::into_inner);
        let took = controller.is_none();
        if took {
            *controller = Some(id);
        }
        drop(controller);
        self.broadcast(&ToPage::Control { id: self.controller() });
        took
    }

    /// Gives control back, if this page had it.
    pub fn release(&self, id: u64) {
        let mut controller = self.controller.lock().unwrap_or_else(PoisonError::into_inner);
        if *controller == Some(id) {
            *controller = None;
            drop(controller);
            self.broadcast(&ToPage::Control { id: None });
        }
    }

    /// The page that controls.
    pub fn controller(&self) -> Option<u64> {
        *self.controller.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
