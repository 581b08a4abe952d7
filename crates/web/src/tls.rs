//! The connections of the page's server: TLS, then HTTP/1.1. Each has a task of its own, so that a slow one holds up no other,
//! and a place ([`Places`]), which it loses when it does not show the token in time.

use crate::places::{Place, Places};
use crate::trust::{self, File};
use axum::Router;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsAcceptor;

/// A handshake that takes longer is aborted, and a request whose head takes longer, also the next one on a connection.
const HANDSHAKE_WITHIN: Duration = Duration::from_secs(10);
const HEAD_WITHIN: Duration = Duration::from_secs(10);
/// No more is read of a request without TLS.
const LONGEST_REQUEST: usize = 4096;
/// How long to wait when the system gives no connection, and how often that is said.
const PAUSE: Duration = Duration::from_millis(50);
const SAID_EVERY: Duration = Duration::from_secs(60);

/// What answers on a connection.
#[derive(Clone)]
pub(crate) struct Answers {
    pub tls: TlsAcceptor,
    /// Given without TLS as well.
    pub files: Arc<[File]>,
    pub router: Router,
}

/// Accepts connections for ever; `tell` is told where the system gives none.
pub(crate) async fn accept(
    listener: TcpListener,
    places: Places,
    answers: Answers,
    tell: impl Fn(&str) + Send,
) {
    let mut said: Option<Instant> = None;
    loop {
        match listener.accept().await {
            Ok((stream, peer)) => {
                let place = Arc::new(places.take(peer.ip()));
                tokio::spawn(converse(stream, place, answers.clone()));
            }
            Err(why) => {
                if said.is_none_or(|at| at.elapsed() > SAID_EVERY) {
                    said = Some(Instant::now());
                    tell(&refused(&why));
                }
                places.make_room();
                tokio::time::sleep(PAUSE).await;
            }
        }
    }
}

/// Why no connection is taken, and what helps.
fn refused(why: &io::Error) -> String {
    // EMFILE and ENFILE (accept(2)).
    let cure = match why.raw_os_error() {
        Some(23 | 24) => "; close other programs, or raise the limit of open files (ulimit -n)",
        _ => "",
    };
    format!("a connection to the page could not be taken: {why}{cure}; the walk goes on")
}

/// A connection until it ends, or has to.
async fn converse(stream: TcpStream, place: Arc<Place>, answers: Answers) {
    let _ = stream.set_nodelay(true);
    let Answers { tls, files, router } = answers;
    let handshake = async {
        let mut first = [0];
        match stream.peek(&mut first).await {
            // A TLS handshake begins with 22 (RFC 8446, 5.1).
            Ok(1) if first[0] == 22 => tls.accept(stream).await.ok(),
            _ => {
                plain(stream, &files).await;
                None
            }
        }
    };
    let (router, named) = (TowerToHyperService::new(router), place.clone());
    let service = service_fn(move |mut request: hyper::Request<hyper::body::Incoming>| {
        request.extensions_mut().insert(named.clone());
        router.call(request)
    });
    let talk = async {
        if let Ok(Some(stream)) = tokio::time::timeout(HANDSHAKE_WITHIN, handshake).await {
            let mut http = hyper::server::conn::http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(HEAD_WITHIN);
            // How a connection ends changes nothing here.
            let _ = http.serve_connection(TokioIo::new(stream), service).with_upgrades().await;
        }
    };
    tokio::select! {
        () = talk => {}
        () = place.has_to_leave() => {}
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_without_descriptors_is_told_from_a_full_disk() {
        let text = refused(&io::Error::from_raw_os_error(24));
        assert!(text.contains("ulimit -n") && !text.contains("disk"), "{text}");
        assert!(!refused(&io::Error::from_raw_os_error(103)).contains("ulimit"));
    }
}
