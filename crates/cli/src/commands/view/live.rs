//! A map that grows in the window: this program is one more page of `cairn serve`, which only watches.

use super::Arguments;
use super::window::Window;
use crate::failure::Failure;
use crate::interrupt;
use crate::output::note;
use crate::socket::{self, ConnectError, Socket};
use cairn_view::{begin, walker};
use futures_util::{SinkExt, StreamExt};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;
use tokio_rustls::TlsConnector;
use tokio_tungstenite::tungstenite::Message;

/// Pause before the page is looked for again after the connection has ended; interval of the looks at the window.
const AGAIN: Duration = Duration::from_secs(1);
const LOOK: Duration = Duration::from_millis(200);

/// An address as `cairn serve` prints it.
#[derive(Debug, PartialEq)]
struct Address<'a> {
    host: &'a str,
    port: u16,
    token: &'a str,
}

impl<'a> Address<'a> {
    fn read(url: &'a str) -> Option<Self> {
        let (place, fragment) = url.strip_prefix("https://")?.split_once('#')?;
        let token = fragment.split('&').find_map(|part| part.strip_prefix("k="))?;
        let place = place.split('/').next()?;
        let (host, port) = place.rsplit_once(':')?;
        let host = host.strip_prefix('[').and_then(|h| h.strip_suffix(']')).unwrap_or(host);
        Some(Self { host, port: port.parse().ok()?, token })
    }
}

/// Shows what a page shows until the window is closed.
///
/// # Errors
/// When the address is none, the page cannot be reached at first or refuses, or the window cannot be opened.
pub fn show(a: &Arguments) -> Result<(), Failure> {
    let address = Address::read(&a.source).ok_or_else(|| {
        Failure::usage(
            &a.source,
            "this is no address of a page",
            "give all of what cairn serve prints: https://HOST:PORT/#k=...",
        )
    })?;
    let fail = |why: String| {
        let hint = "start cairn serve there; from another machine give its --certificate, see docs/view.md";
        Failure::new(format!("{}:{}", address.host, address.port), why, hint)
    };
    let tls = connector(a.certificate.as_deref()).map_err(|e| fail(e.to_string()))?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|e| fail(e.to_string()))?;
    runtime.block_on(async {
        let mut socket = connected(&tls, &address).await.map_err(|e| fail(e.to_string()))?;
        let mut window = Window::open(a)?;
        window.send(&begin(&format!("{}:{}", address.host, address.port), false));
        loop {
            match follow(&mut socket, &mut window, &address).await {
                Ended::Closed => return window.end(),
                Ended::Refused(why) => return Err(fail(why)),
                Ended::Broken => note("the page is away: it is looked for again"),
            }
            socket = loop {
                tokio::time::sleep(AGAIN).await;
                if !window.is_open() || interrupt::requested() {
                    return window.end();
                }
                if let Ok(socket) = connected(&tls, &address).await {
                    break socket;
                }
            };
        }
    })
}

/// Whom this machine trusts: the certificate that was given, else those that `cairn serve` keeps here.
fn connector(given: Option<&Path>) -> Result<TlsConnector, ConnectError> {
    socket::connector(match given {
        Some(path) => {
            let bytes = std::fs::read(path)
                .map_err(|source| ConnectError::File { path: path.display().to_string(), source })?;
            let pem = CertificateDer::from_pem_slice(&bytes);
            vec![pem.unwrap_or_else(|_| CertificateDer::from(bytes))]
        }
        None => crate::commands::serve::data_folder().as_deref().map(cairn_web::trusted).unwrap_or_default(),
    })
}

async fn connected(tls: &TlsConnector, address: &Address<'_>) -> Result<Socket, ConnectError> {
    let Address { host, port, token } = *address;
    let mut socket = socket::connect(tls, host, host, port).await?;
    let hello = json!({ "hello": { "token": token, "walk": false } });
    let want = json!({ "want": { "picture": false, "map": true, "surface": true, "columns": true } });
    for message in [hello, want] {
        socket.send(Message::text(message.to_string())).await?;
    }
    Ok(socket)
}

/// Why nothing more comes from a page.
enum Ended {
    /// The window was closed, or this program is to end.
    Closed,
    /// The page does not want this.
    Refused(String),
    /// The connection has ended.
    Broken,
}

/// Hands on what comes.
async fn follow(socket: &mut Socket, window: &mut Window, address: &Address<'_>) -> Ended {
    let began = std::time::Instant::now();
    let mut is_metric = false;
    loop {
        let message = tokio::time::timeout(LOOK, socket.next()).await;
        if !window.is_open() || interrupt::requested() {
            return Ended::Closed;
        }
        let bytes = match message {
            Err(_) => continue,
            Ok(None | Some(Err(_))) => return Ended::Broken,
            Ok(Some(Ok(Message::Binary(bytes)))) => bytes.to_vec(),
            Ok(Some(Ok(Message::Text(text)))) => {
                let Ok(told) = serde_json::from_str::<Value>(&text) else { continue };
                if let Some(ping) = told.get("ping") {
                    let pong =
                        json!({ "pong": { "n": ping["n"], "ms": began.elapsed().as_secs_f64() * 1e3 } });
                    if socket.send(Message::text(pong.to_string())).await.is_err() {
                        return Ended::Broken;
                    }
                    continue;
                }
                if told.get("stranger").is_some() {
                    return Ended::Refused(
                        "its key is not that of the address: copy it as it is printed there".into(),
                    );
                }
                if told.get("failed").is_some() {
                    return Ended::Refused(
                        "the walk has failed; the computer that serves it shows why".into(),
                    );
                }
                let metric = told.get("status").map(|status| status["metric"] == true);
                match (told.get("view"), metric.filter(|m| *m != is_metric)) {
                    (Some(view), _) => {
                        walker(serde_json::from_value(view["camera"].clone()).unwrap_or_default())
                    }
                    (_, Some(now)) => {
                        is_metric = now;
                        begin(&format!("{}:{}", address.host, address.port), is_metric)
                    }
                    _ => continue,
                }
            }
            Ok(Some(Ok(_))) => continue,
        };
        if !window.send(&bytes) {
            return Ended::Closed;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_as_they_are_printed() {
        let address = |host, token| Some(Address { host, port: 8443, token });
        assert_eq!(Address::read("https://192.168.1.7:8443/#k=abc"), address("192.168.1.7", "abc"));
        assert_eq!(Address::read("https://[fe80::1]:8443/#k=abc&watch"), address("fe80::1", "abc"));
        for wrong in
            ["https://localhost/#k=a", "http://localhost:1/#k=a", "https://localhost:8443/", "home.map"]
        {
            assert_eq!(Address::read(wrong), None, "{wrong}");
        }
    }
}
