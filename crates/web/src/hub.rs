//! Shared state of the pages and the session's thread: who is connected, who holds the walk, what is to be sent.
//!
//! A walk is held by the page that began it. While that page is away the walk waits for it: the page comes back with
//! its secret, and another page gets the walk only by taking it over.

use crate::columns::Columns;
use crate::config::{Aloud, Tell};
use crate::doors::Doors;
use crate::line::Lines;
use crate::pairing::Pairing;
use crate::phones::Phones;
use crate::pulse::Pulse;
use crate::surface::Surface;
use crate::token::same;
use crate::wire::ToPage;
use cairn_session::{Command, Drawn, Inbox};
use cairn_sources::PhonePort;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{broadcast, watch};

/// How many utterances, sounds and answers a slow page may lag behind.
const BEHIND: usize = 256;

/// Bytes that are sent to several pages.
pub(crate) type Shared = Arc<[u8]>;

/// Who holds the walk.
struct Holder {
    /// The page's secret, by which it is recognised when it comes back.
    secret: String,
    /// Its connection; `None` while it is away.
    id: Option<u64>,
}

/// Who comes in, and who announces how.
pub(crate) struct Access {
    /// The access token.
    pub token: String,
    /// How a phone without it is given it.
    pub pairing: Pairing,
    /// The phones that were here.
    pub phones: Phones,
    /// The person at the terminal.
    pub tell: Tell,
    /// The voice of this machine.
    pub aloud: Aloud,
}

/// How many pages want what.
#[derive(Default)]
pub(crate) struct Wanted {
    pub pictures: AtomicU64,
    pub maps: AtomicU64,
    pub surfaces: AtomicU64,
    pub columns: AtomicU64,
}

/// The hub.
pub(crate) struct Hub {
    /// Who comes in.
    pub access: Access,
    /// Description of the session's camera, for people; empty when it is the page's own.
    pub camera: String,
    /// Connections of pages without a web socket.
    pub lines: Lines,
    /// Further connections of pages.
    pub doors: Doors,
    /// Receives the images of the page's camera.
    pub port: PhonePort,
    /// Receives the commands.
    pub inbox: Arc<Inbox>,
    /// The session has started and takes commands.
    pub running: AtomicBool,
    /// Steps that the session has taken.
    pub steps: AtomicU64,
    /// Turns that the threads of the pages have taken.
    pub pulse: Pulse,
    /// Someone has asked to end the server.
    pub shutting_down: AtomicBool,
    /// What pages want to be sent.
    pub wanted: Wanted,
    /// The columns, where depth is made into surfaces.
    pub columns: Mutex<Columns>,
    /// The surface of the depth, where that is made.
    pub surface: Mutex<Surface>,
    /// Messages that must all arrive, in order.
    pub messages: broadcast::Sender<Arc<str>>,
    /// The status, of which only the newest matters.
    pub status: watch::Sender<Arc<str>>,
    /// The time of the newest image that was tracked.
    pub frame: watch::Sender<Arc<str>>,
    /// Where the camera is in the map.
    pub view: watch::Sender<Arc<str>>,
    /// The map; nothing before the first.
    pub map: watch::Sender<Arc<Drawn>>,
    /// The kept routes.
    pub routes: watch::Sender<Arc<str>>,
    /// Seconds that the pages' local time is ahead of UTC.
    pub zone_s: AtomicI32,
    pub picture: watch::Sender<Shared>,
    holder: Mutex<Option<Holder>>,
    next: AtomicU64,
}

impl Hub {
    pub fn new(access: Access, camera: String) -> Self {
        let empty: Arc<str> = "".into();
        Self {
            access,
            camera,
            lines: Lines::default(),
            doors: Doors::default(),
            port: PhonePort::default(),
            inbox: Inbox::new(),
            running: AtomicBool::new(false),
            steps: AtomicU64::new(0),
            pulse: Pulse::default(),
            shutting_down: AtomicBool::new(false),
            wanted: Wanted::default(),
            columns: Mutex::default(),
            surface: Mutex::default(),
            messages: broadcast::Sender::new(BEHIND),
            status: watch::Sender::new(empty.clone()),
            frame: watch::Sender::new(empty.clone()),
            view: watch::Sender::new(empty.clone()),
            map: watch::Sender::default(),
            routes: watch::Sender::new(empty),
            zone_s: AtomicI32::new(0),
            picture: watch::Sender::new(Arc::from([].as_slice())),
            holder: Mutex::new(None),
            next: AtomicU64::new(1),
        }
    }

    /// Assigns an id to a page that has connected.
    pub fn number(&self) -> u64 {
        self.next.fetch_add(1, Ordering::Relaxed)
    }

    /// Ends the session, including one that still waits for its first image.
    pub fn shut_down(&self) {
        self.shutting_down.store(true, Ordering::Relaxed);
        self.inbox.command(Command::Quit);
        self.port.close();
    }

    /// Sends a message to every page.
    pub fn broadcast(&self, message: &ToPage) {
        // It is not an error that no page is connected.
        let _ = self.messages.send(message.text().into());
    }

    /// A page has connected; true when it holds the walk, also because it got it back.
    pub fn arrived(&self, id: u64, secret: &str) -> bool {
        let back = match self.holder().as_mut() {
            Some(holder) if !secret.is_empty() && same(&holder.secret, secret) => {
                holder.id = Some(id);
                true
            }
            _ => false,
        };
        self.tell_control();
        back
    }

    /// The walk waits for the page with this secret, which held it before this server began.
    pub fn held_by(&self, secret: String) {
        *self.holder() = Some(Holder { secret, id: None });
    }

    /// The secret of the page that holds the walk.
    pub fn held(&self) -> Option<String> {
        self.holder().as_ref().map(|h| h.secret.clone())
    }

    /// Takes the walk where no page holds it; `over` also takes it from another page. True when this page now holds
    /// it.
    pub fn take(&self, id: u64, secret: &str, over: bool) -> bool {
        let mut holder = self.holder();
        let held = match holder.as_ref() {
            None => false,
            Some(h) if h.id == Some(id) => return true,
            Some(_) => true,
        };
        if !held || over {
            *holder = Some(Holder { secret: secret.to_owned(), id: Some(id) });
        }
        drop(holder);
        self.tell_control();
        !held || over
    }

    /// A page is gone; if it held the walk, the walk waits for it.
    pub fn left(&self, id: u64) {
        let mut holder = self.holder();
        let Some(held) = holder.as_mut().filter(|h| h.id == Some(id)) else { return };
        held.id = None;
        drop(holder);
        self.tell_control();
    }

    /// The connection of the page that holds the walk.
    pub fn controller(&self) -> Option<u64> {
        self.holder().as_ref()?.id
    }

    fn tell_control(&self) {
        let (id, held) = self.holder().as_ref().map_or((None, false), |h| (h.id, true));
        self.broadcast(&ToPage::Control { id, held });
    }

    fn holder(&self) -> MutexGuard<'_, Option<Holder>> {
        self.holder.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walk_waits_for_the_page_that_began_it() {
        let access = Access {
            token: "token".into(),
            pairing: Pairing::default(),
            phones: Phones::of(None),
            tell: Arc::new(|_| ()),
            aloud: Arc::new(|_, _| ()),
        };
        let hub = Hub::new(access, String::new());
        assert!(!hub.arrived(1, "a") && hub.controller().is_none(), "being first takes nothing");
        assert!(hub.take(1, "a", false) && hub.controller() == Some(1));
        assert!(!hub.arrived(2, "b") && !hub.take(2, "b", false));
        hub.left(1);
        assert!(hub.controller().is_none() && !hub.take(2, "b", false), "it waits");
        assert!(!hub.arrived(3, "") && hub.arrived(4, "a") && hub.controller() == Some(4));
        // The old connection of the same page ends later: this changes nothing.
        hub.left(1);
        assert_eq!(hub.controller(), Some(4));
        assert!(hub.take(2, "b", true) && hub.controller() == Some(2));
        assert!(!hub.arrived(5, "a"), "it was taken over");
    }
}
