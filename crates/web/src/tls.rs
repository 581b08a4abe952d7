//! TLS connections for the page's server; handshakes run concurrently, so that a slow one blocks no other.

use crate::trust::{self, File};
use axum::serve::Listener;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;

/// A handshake that takes longer is aborted.
const HANDSHAKE_WITHIN: Duration = Duration::from_secs(10);
/// No more is read of a request without TLS.
const LONGEST_REQUEST: usize = 4096;
/// How many finished connections may wait to be accepted.
const WAITING: usize = 32;

/// Returns connections whose handshake is done.
pub(crate) struct TlsListener {
    address: SocketAddr,
    ready: mpsc::Receiver<(TlsStream<TcpStream>, SocketAddr)>,
}

impl TlsListener {
    /// Accepts connections from a bound socket; the files are also given without TLS.
    pub fn new(listener: TcpListener, config: rustls::ServerConfig, files: Vec<File>) -> io::Result<Self> {
        let address = listener.local_addr()?;
        let acceptor = TlsAcceptor::from(Arc::new(config));
        let (tell, ready) = mpsc::channel(WAITING);
        tokio::spawn(accept(listener, acceptor, files.into(), tell));
        Ok(Self { address, ready })
    }
}

async fn accept(
    listener: TcpListener,
    acceptor: TlsAcceptor,
    files: Arc<[File]>,
    tell: mpsc::Sender<(TlsStream<TcpStream>, SocketAddr)>,
) {
    while !tell.is_closed() {
        let Ok((stream, peer)) = listener.accept().await else {
            // Out of file descriptors, or the other side has gone: wait briefly and continue.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        let (acceptor, files, tell) = (acceptor.clone(), files.clone(), tell.clone());
        tokio::spawn(async move {
            let _ = stream.set_nodelay(true);
            let handshake = async {
                let mut first = [0];
                match stream.peek(&mut first).await {
                    // A TLS handshake begins with 22 (RFC 8446, 5.1).
                    Ok(1) if first[0] == 22 => acceptor.accept(stream).await.ok(),
                    _ => {
                        plain(stream, &files).await;
                        None
                    }
                }
            };
            if let Ok(Some(stream)) = tokio::time::timeout(HANDSHAKE_WITHIN, handshake).await {
                let _ = tell.send((stream, peer)).await;
            }
        });
    }
}

/// Answers a client that connected without TLS.
async fn plain(mut stream: TcpStream, files: &[File]) {
    let mut request = [0; LONGEST_REQUEST];
    let mut length = 0;
    while let Ok(n @ 1..) = stream.read(&mut request[length..]).await {
        length += n;
        if request[..length].windows(4).any(|w| w == b"\r\n\r\n") {
            break;
        }
    }
    let _ = stream.write_all(&trust::answer(&request[..length], files)).await;
    let _ = stream.shutdown().await;
}

impl Listener for TlsListener {
    type Io = TlsStream<TcpStream>;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, Self::Addr) {
        match self.ready.recv().await {
            Some(connection) => connection,
            // The accepting task has ended with the runtime.
            None => std::future::pending().await,
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        Ok(self.address)
    }
}
