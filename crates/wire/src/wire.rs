//! TCP links to other robots: dialled again and again, or accepted; a thread to read and one to write each.
//!
//! All queues are bounded. A message that finds a full queue is dropped, as by a bad network. So are places: a link that came in
//! is a stranger's until a message on it was believed ([`Wire::know`]). One address has few strangers, and the oldest makes room.

use crate::link;
use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};
use std::net::{IpAddr, Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// Greatest number of links at a time.
const MAX_LINKS: usize = 64;
/// Greatest number of those of one address on which nothing was believed yet; a robot says what it has at once.
const MAX_STRANGERS: usize = 8;
/// Messages that wait to be written on a link, and messages that wait to be taken from the wire.
const OUT_QUEUE: usize = 64;
const IN_QUEUE: usize = 256;
/// A link on which nothing came for so long is closed; peers say what they have every second.
const SILENT: Duration = Duration::from_secs(20);
const DIAL: Duration = Duration::from_secs(2);
const REDIAL: Duration = Duration::from_millis(500);

/// A link, as long as it is open; numbers are not used again.
pub type LinkId = u64;

/// What happens on the wire.
#[derive(Debug)]
pub enum Event {
    /// A link to this address is open.
    Opened(LinkId, SocketAddr),
    /// A message came.
    Message(LinkId, Vec<u8>),
    /// A link ended, and why if not by the other side.
    Closed(LinkId, Option<String>),
}

struct Link {
    out: SyncSender<Arc<Vec<u8>>>,
    stream: TcpStream,
    from: IpAddr,
    /// It was dialled, or a message on it was believed.
    is_known: bool,
}

struct Shared {
    links: Mutex<BTreeMap<LinkId, Link>>,
    next: AtomicU64,
    ends: AtomicBool,
    events: SyncSender<Event>,
}

/// Links to other robots.
pub struct Wire {
    shared: Arc<Shared>,
    events: Receiver<Event>,
    address: SocketAddr,
}

impl Wire {
    /// Listens on an address (port 0: a free one) and dials others, until dropped.
    ///
    /// # Errors
    /// When the address cannot be listened on or no thread can be started.
    pub fn open(listen: impl ToSocketAddrs, dial: &[String]) -> io::Result<Self> {
        let listener = TcpListener::bind(listen)?;
        let address = listener.local_addr()?;
        let (sender, events) = sync_channel(IN_QUEUE);
        let shared = Arc::new(Shared {
            links: Mutex::default(),
            next: AtomicU64::new(0),
            ends: AtomicBool::new(false),
            events: sender,
        });
        let accepting = shared.clone();
        thread::Builder::new().name("wire-accept".into()).spawn(move || accept(&listener, &accepting))?;
        for to in dial {
            let (shared, to) = (shared.clone(), to.clone());
            thread::Builder::new().name("wire-dial".into()).spawn(move || dial_on(&to, &shared))?;
        }
        Ok(Self { shared, events, address })
    }

    /// The address that is listened on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The next event, or `None` when there is none for this long.
    pub fn next(&self, timeout: Duration) -> Option<Event> {
        self.events.recv_timeout(timeout).ok()
    }

    /// Sends a message on a link; false when it is closed or its queue is full.
    pub fn send(&self, link: LinkId, bytes: &Arc<Vec<u8>>) -> bool {
        self.shared.links().get(&link).is_some_and(|l| l.out.try_send(bytes.clone()).is_ok())
    }

    /// A message on this link was believed: it keeps its place.
    pub fn know(&self, link: LinkId) {
        if let Some(link) = self.shared.links().get_mut(&link) {
            link.is_known = true;
        }
    }

    /// The open links.
    pub fn links(&self) -> Vec<LinkId> {
        self.shared.links().keys().copied().collect()
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::SeqCst);
        for link in std::mem::take(&mut *self.shared.links()).into_values() {
            // Already closed is as good.
            let _ = link.stream.shutdown(Shutdown::Both);
        }
        // Wakes the thread that accepts.
        let _ = TcpStream::connect_timeout(&self.address, DIAL);
    }
}

impl Shared {
    fn links(&self) -> MutexGuard<'_, BTreeMap<LinkId, Link>> {
        self.links.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes room for a link from this address; false where all places are those of robots.
    fn make_room(&self, from: IpAddr) -> bool {
        let mut links = self.links();
        let strangers = |links: &BTreeMap<LinkId, Link>, of: IpAddr| -> Vec<LinkId> {
            links.iter().filter(|(_, link)| !link.is_known && link.from == of).map(|(id, _)| *id).collect()
        };
        let (own, is_full) = (strangers(&links, from), links.len() >= MAX_LINKS);
        let oldest = if own.len() >= MAX_STRANGERS {
            own.first().copied()
        } else if is_full {
            let addresses = links.values().filter(|link| !link.is_known).map(|link| link.from);
            let busiest = addresses.max_by_key(|of| strangers(&links, *of).len());
            busiest.and_then(|of| strangers(&links, of).first().copied())
        } else {
            return true;
        };
        let Some(link) = oldest.and_then(|id| links.remove(&id)) else { return false };
        // Its reader ends.
        let _ = link.stream.shutdown(Shutdown::Both);
        true
    }

    fn has_ended(&self) -> bool {
        self.ends.load(Ordering::SeqCst)
    }
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    for stream in listener.incoming() {
        if shared.has_ended() {
            return;
        }
        match stream.and_then(|stream| Ok((stream.peer_addr()?, stream))) {
            Ok((peer, stream)) if shared.make_room(peer.ip()) => {
                let Ok(begun) = begin(stream, shared, false) else { continue };
                let (id, shared) = (begun.0, shared.clone());
                let reading = shared.clone();
                let read = move || carry(begun, &reading);
                // Without a thread the link is not made; the other side dials again.
                if thread::Builder::new().name("wire-read".into()).spawn(read).is_err() {
                    shared.links().remove(&id);
                }
            }
            // All places are those of robots: this one is closed.
            Ok(_) => {}
            // No more files, for example: the next one may work.
            Err(_) => thread::sleep(REDIAL),
        }
    }
}

fn dial_on(to: &str, shared: &Arc<Shared>) {
    while !shared.has_ended() {
        let address = to.to_socket_addrs().ok().and_then(|mut all| all.next());
        let stream = address.and_then(|a| TcpStream::connect_timeout(&a, DIAL).ok());
        if let Some(begun) = stream.and_then(|stream| begin(stream, shared, true).ok()) {
            carry(begun, shared);
        }
        thread::sleep(REDIAL);
    }
}

/// A link that has begun: its number, its address, and the stream to read from.
type Begun = (LinkId, SocketAddr, TcpStream);

/// Reads from a link until it ends.
fn carry((id, address, mut reading): Begun, shared: &Arc<Shared>) {
    if shared.events.send(Event::Opened(id, address)).is_err() {
        return;
    }
    let why = loop {
        match link::read(&mut reading) {
            Ok(Some(bytes)) => {
                if shared.events.send(Event::Message(id, bytes)).is_err() {
                    return;
                }
            }
            Ok(None) => break None,
            Err(_) if shared.has_ended() => return,
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                break Some(format!("{address}: nothing came for {} s", SILENT.as_secs()));
            }
            Err(e) => break Some(format!("{address}: {e}")),
        }
    };
    if let Some(link) = shared.links().remove(&id) {
        let _ = link.stream.shutdown(Shutdown::Both);
    }
    // Nobody listens any more when the wire was dropped.
    let _ = shared.events.send(Event::Closed(id, why));
}

fn begin(stream: TcpStream, shared: &Arc<Shared>, is_known: bool) -> io::Result<Begun> {
    let address = stream.peer_addr()?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(SILENT))?;
    stream.set_write_timeout(Some(SILENT))?;
    let (reading, mut writing) = (stream.try_clone()?, BufWriter::new(stream.try_clone()?));
    let (out, queue) = sync_channel::<Arc<Vec<u8>>>(OUT_QUEUE);
    thread::Builder::new().name("wire-write".into()).spawn(move || {
        // Ends when the link is taken out of the list, or cannot be written to; the reader notices the latter.
        for bytes in queue {
            if link::write(&mut writing, &bytes).and_then(|()| writing.flush()).is_err() {
                let _ = writing.get_ref().shutdown(Shutdown::Both);
                return;
            }
        }
    })?;
    let id = shared.next.fetch_add(1, Ordering::SeqCst);
    shared.links().insert(id, Link { out, stream, from: address.ip(), is_known });
    Ok((id, address, reading))
}
