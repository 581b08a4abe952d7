//! TCP links to other robots: dialled again and again, or accepted; a thread to read and one to write each.
//!
//! All queues are bounded. A message that finds a full queue is dropped, as by a bad network.

use crate::link;
use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// Greatest number of links at a time.
const MAX_LINKS: usize = 64;
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

    fn has_ended(&self) -> bool {
        self.ends.load(Ordering::SeqCst)
    }
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    for stream in listener.incoming() {
        if shared.has_ended() {
            return;
        }
        match stream {
            Ok(stream) if shared.links().len() < MAX_LINKS => {
                let shared = shared.clone();
                // Without a thread the link is not made; the other side dials again.
                let _ = thread::Builder::new().name("wire-read".into()).spawn(move || carry(stream, &shared));
            }
            // Too many links: this one is closed.
            Ok(_) => {}
            // No more files, for example: the next one may work.
            Err(_) => thread::sleep(REDIAL),
        }
    }
}

fn dial_on(to: &str, shared: &Arc<Shared>) {
    while !shared.has_ended() {
        let address = to.to_socket_addrs().ok().and_then(|mut all| all.next());
        if let Some(stream) = address.and_then(|a| TcpStream::connect_timeout(&a, DIAL).ok()) {
            carry(stream, shared);
        }
        thread::sleep(REDIAL);
    }
}

/// Reads from a link until it ends.
fn carry(stream: TcpStream, shared: &Arc<Shared>) {
    let Ok((id, address, mut reading)) = begin(stream, shared) else { return };
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

fn begin(stream: TcpStream, shared: &Arc<Shared>) -> io::Result<(LinkId, SocketAddr, TcpStream)> {
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
    shared.links().insert(id, Link { out, stream });
    Ok((id, address, reading))
}
