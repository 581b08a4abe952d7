//! The messages live, to whoever connects: a server of Foxglove's web socket protocol on a thread of its own.
//!
//! The run puts messages into queues and never waits. No library of Foxglove's is used: theirs needs 21 more, and a second
//! version of the web socket that is here already.

mod client;
mod hub;
mod protocol;

use super::topics::{Destination, Topic};
use crate::failure::Failure;
use crate::output::note;
use cairn_sensor::Stamp;
use hub::Hub;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;
use tokio::task::JoinSet;

/// Where Foxglove looks, on this machine only.
pub const DEFAULT_ADDRESS: &str = "127.0.0.1:8765";

/// Clients at a time.
const MOST_CLIENTS: usize = 16;
/// How long clients may take at the end for what still waits for them.
const LINGER: Duration = Duration::from_secs(1);
/// Pause where the system gives no connection.
const AGAIN: Duration = Duration::from_millis(100);

/// The server while the run goes on.
pub struct Live {
    hub: Arc<Hub>,
    ends: oneshot::Sender<()>,
    thread: JoinHandle<()>,
}

impl Live {
    /// Begins to listen.
    ///
    /// # Errors
    /// When the address cannot be had.
    pub fn begin(address: SocketAddr) -> Result<Self, Failure> {
        let fail = |e: io::Error| {
            let hint = match e.kind() {
                io::ErrorKind::AddrInUse => {
                    format!(
                        "end the program that listens there, or give another port: --foxglove {}:0 takes a free one",
                        address.ip()
                    )
                }
                _ => format!("give an address of this machine, such as {DEFAULT_ADDRESS}"),
            };
            Failure::new(format!("--foxglove {address}"), e.to_string(), hint)
        };
        let listener = TcpListener::bind(address).map_err(fail)?;
        listener.set_nonblocking(true).map_err(fail)?;
        let bound = listener.local_addr().map_err(fail)?;
        let runtime = Builder::new_current_thread().enable_all().build().map_err(fail)?;
        let (hub, (ends, ended)) = (Arc::new(Hub::default()), oneshot::channel());
        let of_thread = hub.clone();
        let thread = std::thread::Builder::new()
            .name("cairn-foxglove".into())
            .spawn(move || serve(runtime, listener, of_thread, ended))
            .map_err(fail)?;
        note(&format!("Foxglove: open ws://{bound}"));
        if !bound.ip().is_loopback() {
            note("note: everyone who reaches this address sees what the camera sees");
        }
        Ok(Self { hub, ends, thread })
    }
}

impl Destination for Live {
    fn wants(&self, topic: Topic) -> bool {
        self.hub.wants(topic)
    }

    fn put(&mut self, topic: Topic, stamp: Stamp, message: &[u8]) {
        self.hub.put(topic, stamp, message);
    }

    fn time(&mut self, stamp: Stamp) {
        self.hub.time(stamp);
    }

    fn end(self: Box<Self>) -> Result<(), Failure> {
        self.hub.end();
        // The thread listens for this as long as it is there.
        let _ = self.ends.send(());
        let ended = self.thread.join();
        let dropped = self.hub.dropped();
        if dropped > 0 {
            note(&format!("note: Foxglove: {dropped} messages were dropped for clients slower than the run"));
        }
        ended.map_err(|_| {
            Failure::new("--foxglove", "the server has failed", "report this with the command line")
        })
    }
}

/// Serves clients until the run ends, and those that are there then a moment longer.
fn serve(runtime: Runtime, listener: TcpListener, hub: Arc<Hub>, mut ended: oneshot::Receiver<()>) {
    runtime.block_on(async {
        let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
        let mut clients = JoinSet::new();
        loop {
            tokio::select! {
                accepted = listener.accept() => match accepted {
                    Ok((stream, _)) if clients.len() < MOST_CLIENTS => {
                        clients.spawn(client::serve(stream, hub.clone()));
                    }
                    Ok(_) => {}
                    Err(_) => tokio::time::sleep(AGAIN).await,
                },
                Some(_) = clients.join_next() => {}
                _ = &mut ended => break,
            }
        }
        // Who does not take the rest in time is left.
        let _ = tokio::time::timeout(LINGER, async { while clients.join_next().await.is_some() {} }).await;
    });
}
