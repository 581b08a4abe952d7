//! One page's connection: from its hello until it disconnects or falls silent. Its messages go to the hub, news goes
//! to the page: words at once, bulk data as the [`Link`] allows.

use crate::beside::{Beside, beside};
use crate::connection::Connection;
use crate::depth::SentDepth;
use crate::hub::{Hub, Shared};
use crate::in_order::InOrder;
use crate::link::{ASK_EVERY, GONE_AFTER, Link};
use crate::places::Place;
use crate::token::same;
use crate::wire::{self, FromPage, ToPage};
use axum::extract::ws::{Message, WebSocket};
use cairn_phrases::Language;
use cairn_session::{Command, CommandError, Drawn, RouteChoice};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{broadcast, watch};

/// A page that does not send its hello within this time is disconnected.
const HELLO_WITHIN: Duration = Duration::from_secs(5);

/// Interval of pieces of the surface and the columns.
const DEPTH_EVERY: Duration = Duration::from_millis(125);
/// How long one that is due waits for status, map and images.
const DEPTH_WAITS: Duration = Duration::from_millis(250);

/// Why a command is not carried out; shown on the page.
#[derive(Debug, thiserror::Error)]
enum Refusal {
    /// It is no command.
    #[error(transparent)]
    Line(#[from] CommandError),
    /// A page cannot give it, or not now, in the words of the page's language.
    #[error("{0}")]
    Now(String),
}

/// What a page states about itself.
pub(crate) struct Guest {
    /// True: its commands take the walk when no page holds it. False: it has to ask for the walk.
    walk: bool,
    secret: String,
    /// Identifies this load of the page, which has a clock of its own.
    page: u64,
    /// In which the page is answered.
    language: Language,
    /// Identifies the phone, if the page says.
    phone: String,
}

/// The page at a web socket, from its hello until it disconnects.
pub(crate) async fn page(mut socket: WebSocket, hub: Arc<Hub>, place: Arc<Place>) {
    let first = async {
        match socket.recv().await {
            Some(Ok(Message::Text(text))) => Some(text),
            _ => None,
        }
    };
    let first = tokio::select! {
        first = tokio::time::timeout(HELLO_WITHIN, first) => first.ok().flatten().unwrap_or_default(),
        () = place.has_to_leave() => return,
    };
    if let Ok(FromPage::Beside { token, id, secret }) = serde_json::from_str(&first) {
        if same(&token, &hub.access.token) && place.keep() {
            beside(Connection::Socket(Box::new(socket)), hub, id, &secret).await;
        }
        return;
    }
    match guest(&first, &hub) {
        Ok(guest) if place.keep() => converse(Connection::Socket(Box::new(socket)), guest, hub).await,
        Ok(_) => {}
        Err(NoGuest) => {
            let _ = socket.send(Message::Text(ToPage::Stranger(true).text().into())).await;
        }
    }
}

/// A page that may come in, until it disconnects.
pub(crate) async fn converse(mut connection: Connection, guest: Guest, hub: Arc<Hub>) {
    let id = hub.number();
    let beside = Beside::new(&hub, id, &guest.secret);
    let guest = if guest.secret.is_empty() { Guest { page: id, ..guest } } else { guest };
    let mut client = Client {
        id,
        messages: hub.messages.subscribe(),
        frame: hub.frame.subscribe(),
        status: hub.status.subscribe(),
        view: hub.view.subscribe(),
        map: hub.map.subscribe(),
        has: None,
        routes: hub.routes.subscribe(),
        picture: hub.picture.subscribe(),
        depth: SentDepth::new(Instant::now()),
        depth_due: Instant::now(),
        wants: Wants { hub: hub.clone(), picture: false, map: false, surface: false, columns: false },
        link: Link::new(Instant::now()),
        beside,
        commands: InOrder::default(),
        newest: None,
        guest,
        hub: hub.clone(),
    };
    let hello = ToPage::Hello { id, version: env!("CARGO_PKG_VERSION"), camera: &hub.camera }.text();
    if !send(&mut connection, Message::Text(hello.into())).await {
        return;
    }
    if hub.arrived(id, &client.guest.secret) {
        client.opens_port();
    } else if client.guest.walk && hub.camera.is_empty() {
        let phones = hub.access.phones.offered(&client.guest.phone, hub.controller().is_some());
        if !phones.is_empty() {
            send(&mut connection, Message::Text(ToPage::Phones(phones).text().into())).await;
        }
    }
    client.status.mark_changed();
    client.routes.mark_changed();
    client.converse(&mut connection).await;
    hub.left(id);
}

/// A page without the access token.
pub(crate) struct NoGuest;

/// The page that sends this as its first message, if it has the right token.
pub(crate) fn guest(text: &str, hub: &Hub) -> Result<Guest, NoGuest> {
    match serde_json::from_str(text) {
        Ok(FromPage::Hello { token, walk, secret, origin, zone_min, language, phone }) => {
            let language = language.parse().unwrap_or_default();
            if !same(&token, &hub.access.token) {
                return Err(NoGuest);
            }
            // No place on Earth is farther from UTC than fourteen hours.
            hub.zone_s.store(60 * i32::from(zone_min).clamp(-14 * 60, 14 * 60), Ordering::Relaxed);
            let mut hasher = DefaultHasher::new();
            (&secret, origin.to_bits()).hash(&mut hasher);
            Ok(Guest { walk, secret, page: hasher.finish(), language, phone })
        }
        _ => Err(NoGuest),
    }
}

struct Client {
    id: u64,
    guest: Guest,
    hub: Arc<Hub>,
    link: Link,
    beside: Beside,
    /// Commands and the like, which come on several connections.
    commands: InOrder<FromPage>,
    /// The time of the newest image, and on which connection it came.
    newest: Option<(f64, u64)>,
    messages: broadcast::Receiver<Arc<str>>,
    frame: watch::Receiver<Arc<str>>,
    status: watch::Receiver<Arc<str>>,
    view: watch::Receiver<Arc<str>>,
    map: watch::Receiver<Arc<Drawn>>,
    /// The map that it was sent last.
    has: Option<Arc<Drawn>>,
    routes: watch::Receiver<Arc<str>>,
    picture: watch::Receiver<Shared>,
    /// What it was sent of the surface and the columns, and when the next of it may be.
    depth: SentDepth,
    depth_due: Instant,
    wants: Wants,
}

/// What a page wants to receive; counted as long as it is connected.
struct Wants {
    hub: Arc<Hub>,
    picture: bool,
    map: bool,
    surface: bool,
    columns: bool,
}

impl Wants {
    fn set(&mut self, picture: bool, map: bool, [surface, columns]: [bool; 2]) {
        let count = |counter: &AtomicU64, was: bool, is: bool| match (was, is) {
            (false, true) => drop(counter.fetch_add(1, Ordering::Relaxed)),
            (true, false) => drop(counter.fetch_sub(1, Ordering::Relaxed)),
            _ => {}
        };
        count(&self.hub.wanted.pictures, self.picture, picture);
        count(&self.hub.wanted.maps, self.map, map);
        count(&self.hub.wanted.surfaces, self.surface, surface);
        count(&self.hub.wanted.columns, self.columns, columns);
        (self.picture, self.map, self.surface, self.columns) = (picture, map, surface, columns);
    }
}

impl Drop for Wants {
    fn drop(&mut self) {
        self.set(false, false, [false; 2]);
    }
}

/// Sends a message; false when the page is gone or no longer accepts data.
async fn send(connection: &mut Connection, message: Message) -> bool {
    matches!(tokio::time::timeout(GONE_AFTER, connection.send(message)).await, Ok(true))
}

impl Client {
    /// Sends what is new and handles what arrives, until the page disconnects or is gone.
    async fn converse(&mut self, connection: &mut Connection) {
        let mut clock = tokio::time::interval(ASK_EVERY / 2);
        clock.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            let free = self.link.may_send(0);
            // On a slow link something newer is always there: surface and columns get their turn all the same.
            let wants_depth = self.wants.surface || self.wants.columns;
            let overdue = wants_depth && self.depth_due.elapsed() >= DEPTH_WAITS;
            let others = free && !overdue;
            let text = |t: &Arc<str>| Message::Text(t.as_ref().into());
            // Bulk data that is too large for the link is skipped: the next update comes soon.
            let (out, bulk) = tokio::select! {
                // Utterances before everything else.
                biased;
                told = self.messages.recv() => match told {
                    Ok(t) => (Some(Message::Text(self.beside.number(&t).into())), 0),
                    Err(broadcast::error::RecvError::Lagged(_)) => (None, 0),
                    Err(broadcast::error::RecvError::Closed) => return,
                },
                came = connection.recv() => match came {
                    Some(message) => {
                        self.link.heard(Instant::now());
                        (self.take(0, message).map(|t| Message::Text(t.into())), 0)
                    }
                    _ => return,
                },
                (on, message) = self.beside.recv() => (self.take(on, message).map(|t| Message::Text(t.into())), 0),
                // A few bytes, which need not wait for bulk data that is under way.
                Ok(()) = self.frame.changed(), if self.holds() => {
                    let frame = self.frame.borrow_and_update();
                    self.beside.copy(&frame);
                    (Some(text(&frame)), 0)
                }
                _ = clock.tick() => (None, 0),
                Ok(()) = self.status.changed(), if others => {
                    let status = self.status.borrow_and_update();
                    (Some(text(&status)), status.len())
                }
                Ok(()) = self.routes.changed(), if others => {
                    let routes = self.routes.borrow_and_update();
                    (Some(text(&routes)), routes.len())
                }
                Ok(()) = self.view.changed(), if others && self.wants.map => {
                    let view = self.view.borrow_and_update();
                    (Some(text(&view)), view.len())
                }
                Ok(()) = self.map.changed(), if others && self.wants.map => {
                    let map = self.map.borrow_and_update().clone();
                    let message = map.message(self.has.as_deref());
                    let length = message.len();
                    let may = self.link.may_send(length);
                    self.has = if may { Some(map) } else { self.has.take() };
                    (may.then(|| Message::Binary(message.into())), length)
                }
                Ok(()) = self.picture.changed(), if others && self.wants.picture => {
                    let bytes: Shared = self.picture.borrow_and_update().clone();
                    let length = bytes.len();
                    let may = self.link.may_send(length);
                    (may.then(|| Message::Binary(axum::body::Bytes::from_owner(bytes))), length)
                }
                () = tokio::time::sleep_until(self.depth_due.into()), if free && wants_depth => {
                    let now = Instant::now();
                    self.depth_due = now + DEPTH_EVERY;
                    let message = self.piece_of_depth(now);
                    let length = message.as_ref().map_or(0, Vec::len);
                    (message.map(|m| Message::Binary(m.into())), length)
                }
            };
            let empty = |m: &Message| matches!(m, Message::Text(t) if t.is_empty());
            let out = out.filter(|m| !empty(m));
            let bulk = if out.is_some() { bulk } else { 0 };
            if let Some(out) = out
                && !send(connection, out).await
            {
                return;
            }
            let now = Instant::now();
            if self.link.is_gone(now) {
                return;
            }
            if bulk > 0 || self.link.is_due(now) {
                let ping = ToPage::Ping { n: self.link.ask(now, bulk), trip_ms: self.link.trip_ms() }.text();
                if !send(connection, Message::Text(ping.into())).await {
                    return;
                }
            }
        }
    }

    /// The next piece of what is made of the depth.
    fn piece_of_depth(&mut self, now: Instant) -> Option<Vec<u8>> {
        let Self { hub, depth, wants, link, .. } = self;
        let surface = hub.surface.lock().unwrap_or_else(PoisonError::into_inner);
        let columns = hub.columns.lock().unwrap_or_else(PoisonError::into_inner);
        let surface = Some(&*surface).filter(|_| wants.surface);
        depth.message(surface, Some(&*columns).filter(|_| wants.columns), link.room(), now)
    }

    /// Whether this page holds the walk.
    fn holds(&self) -> bool {
        self.hub.controller() == Some(self.id)
    }

    /// Handles a message that came on this connection, 0 for the first; returns an answer for this page alone, if one is due.
    fn take(&mut self, on: u64, message: Message) -> Option<String> {
        match message {
            Message::Binary(bytes) if self.holds() => {
                let (ms, jpeg) = wire::picture(&bytes)?;
                // One that was held up by a loss, and that another connection has overtaken.
                let overtaken = self.newest.is_some_and(|(newest, by)| by != on && ms <= newest);
                if !overtaken {
                    self.newest = Some((ms, on));
                    self.hub.port.picture(ms, jpeg.to_vec());
                }
                let got = ToPage::Got { ms, overtaken }.text();
                self.beside.copy(&got);
                Some(got)
            }
            Message::Text(text) => match serde_json::from_str(&text).ok()? {
                FromPage::Copy(number, message) => {
                    let due = self.commands.take(number, *message);
                    due.into_iter().filter_map(|message| self.hear(message)).last()
                }
                message => self.hear(message),
            },
            _ => None,
        }
    }

    /// Handles a text.
    fn hear(&mut self, message: FromPage) -> Option<String> {
        let now = Instant::now();
        let controls = self.holds();
        match message {
            FromPage::Pong { n, ms } => {
                if let (Some(sent), true) = (self.link.answered(n, now), controls) {
                    self.hub.port.round_trip(sent, now, ms);
                }
                None
            }
            FromPage::Motion(samples) if controls => {
                self.hub.port.motion(samples.into_iter().map(wire::motion));
                None
            }
            FromPage::Late(late) if controls => {
                self.hub.port.late(late);
                None
            }
            // A page that gives a command while no page holds the walk holds it from then on.
            FromPage::Command(line) if controls || (self.guest.walk && self.begins(false)) => {
                self.command(&line).err().map(|why| refusal(&why.to_string()))
            }
            FromPage::Take(true) if self.begins(false) => None,
            FromPage::TakeOver(true) if self.begins(true) => None,
            FromPage::Command(_) | FromPage::Take(true) | FromPage::TakeOver(true) => {
                Some(refusal(&self.guest.language.text("page-other-holds")))
            }
            FromPage::Settings { language, lines } => {
                self.guest.language = language.parse().unwrap_or(self.guest.language);
                let wrong = lines.iter().filter(|_| controls).find_map(|line| self.setting(line).err());
                wrong.map(|why| refusal(&why.to_string()))
            }
            FromPage::Kept(settings) => {
                self.hub.access.phones.keep_settings(&self.guest.phone, settings);
                None
            }
            FromPage::Want { picture, map, surface, columns } => {
                self.wants.set(picture, map, [surface, columns]);
                self.view.mark_changed();
                self.map.mark_changed();
                None
            }
            _ => None,
        }
    }

    /// Takes the walk where that is possible; true when this page now holds it.
    fn begins(&mut self, over: bool) -> bool {
        let holds = self.hub.take(self.id, &self.guest.secret, over);
        if holds {
            self.opens_port();
            // The last one was in the clock of the page before it.
            self.frame.mark_unchanged();
        }
        holds
    }

    /// Images come from this page from now on.
    fn opens_port(&self) {
        self.hub.port.page(self.guest.page);
        self.hub.access.phones.set_current(&self.guest.phone);
    }

    /// Changes how the session speaks; also before its first picture.
    fn setting(&self, line: &str) -> Result<(), CommandError> {
        if let command @ Command::Set(_) = Command::parse(line)? {
            self.hub.inbox.command(command);
        }
        Ok(())
    }

    fn command(&self, line: &str) -> Result<(), Refusal> {
        let command = Command::parse(line)?;
        let because = |id: &str| Err(Refusal::Now(self.guest.language.text(id)));
        match command {
            // Other files are chosen on the terminal, and the server is stopped there.
            Command::Quit | Command::Load(RouteChoice::File(_)) => because("page-terminal-only"),
            _ if !self.hub.running.load(Ordering::Relaxed) => because("page-no-picture-yet"),
            _ => {
                self.hub.inbox.command(command);
                Ok(())
            }
        }
    }
}

fn refusal(text: &str) -> String {
    ToPage::Refused(text).text()
}
