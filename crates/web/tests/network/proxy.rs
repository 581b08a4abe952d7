//! A slow, lossy network between a page and the server: a TCP proxy on loopback whose rate, delay, losses and stalls
//! are set while it runs.
//!
//! Each direction is a link of one rate: bytes leave it in order, one after the other, and arrive the one-way delay
//! later. A lost segment holds up what follows until it is retransmitted, two round trips later (the probe of RFC
//! 8985; 100 ms at least), as TCP shows losses to the layers above. In a stall nothing leaves. Up to 96 KB wait in
//! front of the link, as in the queue of a router.

use cairn_random::Random;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;

/// Size of a segment, bytes.
const SEGMENT: usize = 1460;
/// Segments that may queue in front of a link.
const QUEUE: usize = 64;

/// A network.
#[derive(Clone, Copy, Debug)]
pub struct Net {
    /// Megabits per second, each way.
    pub mbit_s: f64,
    /// Round trip of a small message.
    pub round_trip: Duration,
    /// Share of segments that are lost once.
    pub loss: f64,
    /// End of a stall: nothing leaves until then.
    pub stalled_until: Option<Instant>,
}

impl Net {
    /// As good as no network in between.
    pub const FAST: Self =
        Self { mbit_s: 1000.0, round_trip: Duration::ZERO, loss: 0.0, stalled_until: None };
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
        let shared = net.clone();
        tokio::spawn(async move {
            let mut random = Random::new(seed);
            while let Ok((page, _)) = listener.accept().await {
                let Ok(server) = TcpStream::connect(server).await else { continue };
                for stream in [&page, &server] {
                    let _ = stream.set_nodelay(true);
                }
                let ((page_in, page_out), (server_in, server_out)) = (page.into_split(), server.into_split());
                link(page_in, server_out, shared.clone(), Random::new(random.bits()));
                link(server_in, page_out, shared.clone(), Random::new(random.bits()));
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

/// One direction of a connection.
fn link(
    mut from: impl AsyncRead + Unpin + Send + 'static,
    mut to: impl AsyncWrite + Unpin + Send + 'static,
    net: Arc<Mutex<Net>>,
    mut random: Random,
) {
    let (queue, mut waiting) = mpsc::channel::<(Instant, Vec<u8>)>(QUEUE);
    tokio::spawn(async move {
        let mut free = Instant::now();
        let mut buffer = [0; SEGMENT];
        while let Ok(n @ 1..) = from.read(&mut buffer).await {
            let now = Instant::now();
            let net = *net.lock().unwrap();
            free = free.max(now).max(net.stalled_until.unwrap_or(now));
            free += Duration::from_secs_f64(8e-6 * n as f64 / net.mbit_s);
            if random.unit() < net.loss {
                free += Duration::from_millis(100).max(2 * net.round_trip);
            }
            if queue.send((free + net.round_trip / 2, buffer[..n].to_vec())).await.is_err() {
                return;
            }
        }
    });
    tokio::spawn(async move {
        while let Some((at, bytes)) = waiting.recv().await {
            tokio::time::sleep_until(at.into()).await;
            if to.write_all(&bytes).await.is_err() {
                return;
            }
        }
        let _ = to.shutdown().await;
    });
}
