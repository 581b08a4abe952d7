//! Where pages and the walk meet: who is there, who controls, what is to be sent.

use crate::wire::ToPage;
use cairn_session::{Command, Inbox};
use cairn_sources::PhonePort;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{broadcast, watch};

/// Words, sounds and answers that a slow page may be behind by.
const BEHIND: usize = 256;

/// Bytes that many pages are sent.
pub(crate) type Shared = Arc<[u8]>;

/// The hub.
pub(crate) struct Hub {
    /// Who may in.
    pub token: String,
    /// What the walk sees with, for people; empty while the page's camera does.
    pub camera: String,
    /// Pictures of the page's camera go here.
    pub port: PhonePort,
    /// Commands go here.
    pub inbox: Arc<Inbox>,
    /// The walk has begun: there is someone to take commands.
    pub walking: AtomicBool,
    /// Someone has asked to end all.
    pub leaving: AtomicBool,
    /// Someone wants pictures.
    pub pictures_wanted: AtomicU64,
    /// Someone wants the map.
    pub maps_wanted: AtomicU64,
    /// Everything that must arrive, in order.
    pub told: broadcast::Sender<Arc<str>>,
    /// What only counts when it is new.
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
            walking: AtomicBool::new(false),
            leaving: AtomicBool::new(false),
            pictures_wanted: AtomicU64::new(0),
            maps_wanted: AtomicU64::new(0),
            told: broadcast::Sender::new(BEHIND),
            status: watch::Sender::new(empty.clone()),
            view: watch::Sender::new(empty),
            picture: watch::Sender::new(Arc::from([].as_slice())),
            controller: Mutex::new(None),
            next: AtomicU64::new(1),
        }
    }

    /// A number for a page that has come.
    pub fn number(&self) -> u64 {
        self.next.fetch_add(1, Ordering::Relaxed)
    }

    /// Ends the walk, also one that still waits for its first picture.
    pub fn leave_all(&self) {
        self.leaving.store(true, Ordering::Relaxed);
        self.inbox.command(Command::Quit);
        self.port.close();
    }

    /// Tells every page.
    pub fn tell(&self, message: &ToPage) {
        // Nobody there is no failure.
        let _ = self.told.send(message.text().into());
    }

    /// Takes control, when nobody has it.
    pub fn take(&self, id: u64) -> bool {
        let mut controller = self.controller.lock().unwrap_or_else(PoisonError::into_inner);
        let took = controller.is_none();
        if took {
            *controller = Some(id);
        }
        drop(controller);
        self.tell(&ToPage::Control { id: self.controller() });
        took
    }

    /// Gives control back, if this page had it.
    pub fn leave(&self, id: u64) {
        let mut controller = self.controller.lock().unwrap_or_else(PoisonError::into_inner);
        if *controller == Some(id) {
            *controller = None;
            drop(controller);
            self.tell(&ToPage::Control { id: None });
        }
    }

    /// Who controls.
    pub fn controller(&self) -> Option<u64> {
        *self.controller.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
