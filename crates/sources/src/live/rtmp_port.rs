//! The port to which RTMP senders connect. Who shows the first bytes of RTMP is handed on to `ffmpeg`; who does not is refused, and
//! others are listened to meanwhile. `ffmpeg`'s own listener takes one connection, whoever it is, and closes its port until it is
//! started again: a sender that came just then was refused.
//!
//! RTMP begins with one byte of version, 3, and 1536 bytes of handshake (Adobe's RTMP 1.0, 5.2.2 and 5.2.3).

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

const VERSION: u8 = 3;
const HANDSHAKE: usize = 1 + 1536;
/// A sender shows its handshake at once; what is silent for so long is none.
const SILENT: Duration = Duration::from_secs(3);
/// How long a sender waits for `ffmpeg` to start, or to end with the sender before.
const WAIT: Duration = Duration::from_secs(5);
/// Connections that have shown nothing yet; beyond them the oldest goes.
const MOST_COMING: usize = 32;
/// Senders at a time; one is seen.
const MOST_SENDERS: usize = 8;
/// How often connections are looked at.
const LOOK: Duration = Duration::from_millis(10);

/// A bound port.
pub(super) struct RtmpPort {
    listener: TcpListener,
    /// Where `ffmpeg` listens, on this machine alone.
    inner: SocketAddr,
}

/// A connection that has not shown its handshake yet.
struct Coming {
    stream: TcpStream,
    bytes: Vec<u8>,
    since: Instant,
}

impl RtmpPort {
    /// Binds `HOST:PORT`.
    ///
    /// # Errors
    /// The system's error.
    pub fn bind(place: &str) -> io::Result<Self> {
        let listener = TcpListener::bind(place)?;
        listener.set_nonblocking(true)?;
        // Free now, and a moment later `ffmpeg`'s.
        let inner = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?;
        Ok(Self { listener, inner })
    }

    /// Where `ffmpeg` has to listen.
    pub fn inner(&self) -> SocketAddr {
        self.inner
    }

    /// Hands senders on until `is_closed`; `refused` is told why each other connection was refused.
    pub fn serve(self, is_closed: impl Fn() -> bool, refused: impl Fn(&str)) {
        let mut coming: Vec<Coming> = Vec::new();
        let senders = Arc::new(AtomicUsize::new(0));
        while !is_closed() {
            while let Ok((stream, _)) = self.listener.accept() {
                if coming.len() >= MOST_COMING {
                    coming.remove(0);
                    refused("too many connect and show nothing");
                }
                if stream.set_nonblocking(true).is_ok() {
                    coming.push(Coming { stream, bytes: Vec::new(), since: Instant::now() });
                }
            }
            for mut one in std::mem::take(&mut coming) {
                match one.look() {
                    Ok(true) => hand_on(one, self.inner, &senders),
                    Ok(false) => coming.push(one),
                    Err(why) => refused(why),
                }
            }
            std::thread::sleep(LOOK);
        }
    }
}

impl Coming {
    /// Reads what there is; whether the handshake is whole, or why this is no sender.
    fn look(&mut self) -> Result<bool, &'static str> {
        let mut buffer = [0; HANDSHAKE];
        let read = self.stream.read(&mut buffer[..HANDSHAKE - self.bytes.len()]);
        match read {
            Ok(0) => return Err("it went away"),
            Ok(n) => self.bytes.extend_from_slice(&buffer[..n]),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(_) => return Err("it went away"),
        }
        match self.bytes.first() {
            Some(first) if *first != VERSION => Err("it speaks something else"),
            _ if self.since.elapsed() > SILENT => Err("it was silent"),
            _ => Ok(self.bytes.len() == HANDSHAKE),
        }
    }
}

/// Connects a sender with `ffmpeg` as soon as that listens, on threads that end with either.
fn hand_on(sender: Coming, inner: SocketAddr, senders: &Arc<AtomicUsize>) {
    if senders.fetch_add(1, Ordering::Relaxed) >= MOST_SENDERS {
        senders.fetch_sub(1, Ordering::Relaxed);
        return;
    }
    let senders = senders.clone();
    let work = move || {
        // A connection that ends is no failure here: `ffmpeg` says what it lacks.
        let _ = connected(&sender, inner);
        senders.fetch_sub(1, Ordering::Relaxed);
    };
    // Without a thread the sender is let go, and comes again.
    let _ = std::thread::Builder::new().name("cairn-rtmp".into()).spawn(work);
}

fn connected(sender: &Coming, inner: SocketAddr) -> io::Result<()> {
    let began = Instant::now();
    let mut to = loop {
        match TcpStream::connect(inner) {
            Ok(stream) => break stream,
            Err(e) if began.elapsed() > WAIT => return Err(e),
            Err(_) => std::thread::sleep(LOOK),
        }
    };
    sender.stream.set_nonblocking(false)?;
    to.set_nodelay(true)?;
    sender.stream.set_nodelay(true)?;
    to.write_all(&sender.bytes)?;
    std::thread::scope(|scope| {
        scope.spawn(|| pump(&to, &sender.stream));
        pump(&sender.stream, &to);
    });
    Ok(())
}

/// Copies until either ends; both are closed then.
fn pump(mut from: &TcpStream, mut to: &TcpStream) {
    let _ = io::copy(&mut from, &mut to);
    // What is closed already stays so.
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn strays_are_refused_and_do_not_keep_a_sender_out() {
        let port = RtmpPort::bind("127.0.0.1:0").unwrap();
        let (at, inner) = (port.listener.local_addr().unwrap(), port.inner());
        let (closed, refusals) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::new())));
        let (is_closed, reasons) = (closed.clone(), refusals.clone());
        let serving = std::thread::spawn(move || {
            port.serve(
                || is_closed.load(Ordering::Relaxed),
                |why| reasons.lock().unwrap().push(why.to_owned()),
            );
        });
        let connect = || TcpStream::connect(at).unwrap();
        // One byte and away, a browser, TLS, random bytes, and forty that say nothing and stay.
        for bytes in [&b"x"[..], b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\x02\x00", &[0xa5; 3000]] {
            connect().write_all(bytes).unwrap();
        }
        // Each is looked at before there are too many of them.
        std::thread::sleep(Duration::from_millis(100));
        let held: Vec<TcpStream> = (0..40).map(|_| connect()).collect();
        let mut sender = connect();
        let mut shown = vec![VERSION];
        shown.extend([7; HANDSHAKE - 1]);
        let began = Instant::now();
        sender.write_all(&shown).unwrap();
        // ffmpeg begins to listen a moment later.
        std::thread::sleep(Duration::from_millis(200));
        let ffmpeg = TcpListener::bind(inner).unwrap();
        let (mut taken, _) = ffmpeg.accept().unwrap();
        let mut got = vec![0; HANDSHAKE];
        taken.read_exact(&mut got).unwrap();
        assert!(got == shown && began.elapsed() < Duration::from_secs(2), "{:?}", began.elapsed());
        taken.write_all(b"answer").unwrap();
        let mut answer = [0; 6];
        sender.read_exact(&mut answer).unwrap();
        assert_eq!(&answer, b"answer");
        // Either ends both.
        drop(taken);
        assert_eq!(sender.read(&mut answer).unwrap_or(0), 0);
        let reasons = refusals.lock().unwrap().clone();
        assert_eq!(reasons.iter().filter(|why| *why == "it speaks something else").count(), 4, "{reasons:?}");
        closed.store(true, Ordering::Relaxed);
        serving.join().unwrap();
        drop(held);
    }

    #[test]
    fn who_is_silent_for_three_seconds_is_let_go() {
        let port = RtmpPort::bind("127.0.0.1:0").unwrap();
        let at = port.listener.local_addr().unwrap();
        let closed = Arc::new(AtomicBool::new(false));
        let is_closed = closed.clone();
        let serving = std::thread::spawn(move || port.serve(|| is_closed.load(Ordering::Relaxed), |_| {}));
        let mut silent = TcpStream::connect(at).unwrap();
        silent.write_all(&[VERSION]).unwrap();
        silent.set_read_timeout(Some(Duration::from_secs(6))).unwrap();
        let began = Instant::now();
        assert_eq!(silent.read_to_end(&mut Vec::new()).unwrap_or(0), 0);
        assert!(began.elapsed() > Duration::from_secs(2) && began.elapsed() < Duration::from_secs(5));
        closed.store(true, Ordering::Relaxed);
        serving.join().unwrap();
        // Its port is taken while it serves, which is an error at once.
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        assert!(RtmpPort::bind(&taken.local_addr().unwrap().to_string()).is_err());
    }
}
