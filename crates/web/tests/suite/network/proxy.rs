//! A slow, lossy network between a page and the server: a TCP proxy on loopback whose rate, delay, losses and stalls
//! are set while it runs.
//!
//! Each direction is one link that all connections share: segments leave it in the order in which they came to it, at its
//! rate, and arrive the one-way delay later. In a stall nothing leaves. Up to 96 KB of a connection wait in front of the link, as in the
//! queue of a router.
//!
//! A lost segment holds up what follows on its connection, and on no other, until it has been sent again, as TCP shows losses to
//! the layers above (times as in Linux):
//! - The sender knows of it when three later segments of the connection were acknowledged, or a quarter of a round trip after one
//!   was (RACK, RFC 8985, 6.2): one round trip and a half after it left at the earliest it is there.
//! - Where nothing follows, it is sent again two round trips after it left (the probe of RFC 8985, 7), but at most one round trip and
//!   200 ms after, the timeout (RFC 6298, with the minimum of Linux), as where it was alone on its way.
//! - What was sent again is lost as often, and comes another timeout later.
//!
//! Not modelled: congestion windows, which losses make smaller, and the time on the link of what is sent again.

use cairn_random::Random;
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, Semaphore};

/// Size of a segment, bytes.
const SEGMENT: usize = 1460;
/// Segments of a connection that may be on their way.
const QUEUE: usize = 64;
/// The shortest timeout, beyond a round trip.
const TIMEOUT: Duration = Duration::from_millis(200);

/// A network.
#[derive(Clone, Copy, Debug)]
pub struct Net {
    /// Megabits per second, each way.
    pub mbit_s: f64,
    /// Round trip of a small message.
    pub round_trip: Duration,
    /// Share of segments that are lost, up and down.
    pub loss: [f64; 2],
    /// End of a stall: nothing leaves until then.
    pub stalled_until: Option<Instant>,
}

impl Net {
    /// As good as no network in between.
    pub const FAST: Self =
        Self { mbit_s: 1000.0, round_trip: Duration::ZERO, loss: [0.0; 2], stalled_until: None };
}

/// The proxy; it ends with its runtime.
pub struct Proxy {
    pub address: SocketAddr,
    net: Arc<Mutex<Net>>,
}

impl Proxy {
    pub async fn start(server: SocketAddr, seed: u64) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let net = Arc::new(Mutex::new(Net::FAST));
        let link = |n| Link {
            way: n,
            net: net.clone(),
            line: Arc::new(Mutex::new((Instant::now(), Random::stream(seed, n as u64)))),
        };
        let (up, down) = (link(0), link(1));
        tokio::spawn(async move {
            while let Ok((page, _)) = listener.accept().await {
                let Ok(server) = TcpStream::connect(server).await else { continue };
                for stream in [&page, &server] {
                    let _ = stream.set_nodelay(true);
                }
                let ((page_in, page_out), (server_in, server_out)) = (page.into_split(), server.into_split());
                connect(page_in, server_out, up.clone());
                connect(server_in, page_out, down.clone());
            }
        });
        Self { address, net }
    }

    pub fn set(&self, net: Net) {
        *self.net.lock().unwrap() = net;
    }

    pub fn stall(&self, length: Duration) {
        self.net.lock().unwrap().stalled_until = Some(Instant::now() + length);
    }
}

/// One direction of the network.
#[derive(Clone)]
struct Link {
    /// 0 up, 1 down.
    way: usize,
    net: Arc<Mutex<Net>>,
    /// When it is free, and what is lost.
    line: Arc<Mutex<(Instant, Random)>>,
}

impl Link {
    /// When so many bytes that come to it now have left it, the network, and how often they are lost.
    fn carry(&self, bytes: usize) -> (Instant, Net, u32) {
        let (now, net) = (Instant::now(), *self.net.lock().unwrap());
        let (free, random) = &mut *self.line.lock().unwrap();
        *free = (*free).max(now).max(net.stalled_until.unwrap_or(now));
        *free += Duration::from_secs_f64(8e-6 * bytes as f64 / net.mbit_s);
        let mut lost = 0;
        while random.unit() < net.loss[self.way] {
            lost += 1;
        }
        (*free, net, lost)
    }
}

/// A segment on its way.
struct Segment {
    bytes: Vec<u8>,
    arrives: Instant,
    /// Of a lost one: what further losses add, and how many later ones have arrived before it was known.
    lost: Option<(Duration, u32)>,
}

/// What a connection has on its way in one direction, in order; `None` at the end.
type OnWay = Arc<(Mutex<VecDeque<Option<Segment>>>, Notify, Semaphore)>;

/// Puts a segment on its way, which may show that earlier ones were lost.
fn put(queue: &mut VecDeque<Option<Segment>>, bytes: Vec<u8>, link: &Link) {
    let (left, net, times) = link.carry(bytes.len());
    let trip = net.round_trip;
    let there = left + trip / 2;
    if times == 0 {
        for earlier in queue.iter_mut().flatten() {
            let Some((further, later)) = &mut earlier.lost else { continue };
            *later += 1;
            let known = there + trip / 2 + if *later < 3 { trip / 4 } else { Duration::ZERO };
            earlier.arrives = earlier.arrives.min(known + trip / 2 + *further);
        }
    }
    let alone =
        queue.back().is_none_or(|last| last.as_ref().is_none_or(|last| last.arrives + trip / 2 < left));
    let timeout = trip + TIMEOUT;
    let probe = if alone { timeout } else { timeout.min(2 * trip) };
    let segment = match times {
        0 => Segment { bytes, arrives: there, lost: None },
        _ => {
            let further = timeout * (times - 1);
            Segment { bytes, arrives: there + probe + further, lost: Some((further, 0)) }
        }
    };
    queue.push_back(Some(segment));
}

/// One direction of a connection.
fn connect(
    mut from: impl AsyncRead + Unpin + Send + 'static,
    mut to: impl AsyncWrite + Unpin + Send + 'static,
    link: Link,
) {
    let on_way: OnWay = Arc::new((Mutex::default(), Notify::new(), Semaphore::new(QUEUE)));
    let waiting = on_way.clone();
    tokio::spawn(async move {
        let (queue, changed, room) = &*on_way;
        let mut buffer = [0; SEGMENT];
        while let Ok(place) = room.acquire().await {
            place.forget();
            let Ok(n @ 1..) = from.read(&mut buffer).await else { break };
            put(&mut queue.lock().unwrap(), buffer[..n].to_vec(), &link);
            changed.notify_one();
        }
        queue.lock().unwrap().push_back(None);
        changed.notify_one();
    });
    tokio::spawn(async move {
        let (queue, changed, room) = &*waiting;
        loop {
            let first = queue.lock().unwrap().front().map(|first| first.as_ref().map(|s| s.arrives));
            match first {
                Some(None) => break,
                Some(Some(at)) if at <= Instant::now() => {
                    let segment = queue.lock().unwrap().pop_front().flatten();
                    room.add_permits(1);
                    if let Some(segment) = segment
                        && to.write_all(&segment.bytes).await.is_err()
                    {
                        break;
                    }
                }
                Some(Some(at)) => tokio::select! {
                    () = tokio::time::sleep_until(at.into()) => {}
                    () = changed.notified() => {}
                },
                None => changed.notified().await,
            }
        }
        room.close();
        let _ = to.shutdown().await;
    });
}
