//! Connections of strangers: many that are held open, slow ones, and a machine without descriptors keep no phone out and end no
//! walk. All on loopback addresses.

use crate::client::tls;
use crate::plain::{Http, Plain, stream};
use crate::played::walk;
use cairn_session::SessionConfig;
use cairn_web::{ServeConfig, Server};
use std::net::SocketAddr;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio_rustls::TlsConnector;

/// Places of the servers here: 12 for strangers, 6 of them for one address.
const PLACES: usize = 24;

fn server(name: &str) -> Server {
    let folder = std::env::temp_dir().join(format!("cairn-strangers-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let session = SessionConfig { folder, ..SessionConfig::default() };
    Server::start(ServeConfig { session, connections: PLACES, ..ServeConfig::new(walk()) }).unwrap()
}

/// Connects from one of this machine's loopback addresses.
async fn connect(from: [u8; 4], to: SocketAddr) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind((from, 0).into()).unwrap();
    socket.connect(to).await.unwrap()
}

/// Reads to the end of a connection; `None` where that does not come in time.
async fn ends(stream: &mut (impl AsyncReadExt + Unpin), within: Duration) -> Option<Vec<u8>> {
    let mut all = Vec::new();
    // One that is cut off has ended too.
    tokio::time::timeout(within, stream.read_to_end(&mut all)).await.ok().map(|_| all)
}

#[tokio::test]
async fn a_page_with_the_token_comes_in_and_stays_beside_connections_that_are_held_open() {
    let server = server("held");
    let mut held = Vec::new();
    // Of some, nothing comes; some have shaken hands; from two addresses.
    for n in 0..3 * PLACES {
        let from = [127, 0, 0, 1 + (n % 2) as u8];
        held.push(connect(from, server.address()).await);
    }
    let mut shaken = Vec::new();
    for _ in 0..6 {
        shaken.push(stream(&server).await);
    }
    let began = Instant::now();
    let mut page = Plain::enter(&server, "secret", true).await;
    page.text("status").await;
    let took = began.elapsed();
    assert!(took < Duration::from_secs(5), "{took:?}");
    // It stays, whoever comes after it.
    for n in 0..3 * PLACES {
        held.push(connect([127, 0, 0, 1 + (n % 3) as u8], server.address()).await);
    }
    for _ in 0..20 {
        page.text("status").await;
    }
    assert_eq!(page.send(&[serde_json::json!({ "take": true })]).await, 204);
    // And the oldest had to make room.
    let ended = ends(&mut held[0], Duration::from_secs(2)).await;
    assert!(ended.is_some(), "it was closed");
    drop((held, shaken));
}

#[tokio::test]
async fn a_request_that_does_not_come_is_given_up_after_ten_seconds() {
    let server = server("slow");
    let mut page = Plain::enter(&server, "secret", true).await;
    let began = Instant::now();
    // One never begins, one never ends its head, one begins the next request and stops there.
    let mut silent = stream(&server).await;
    let mut slow = stream(&server).await;
    slow.write_all(b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: ").await.unwrap();
    let mut second = stream(&server).await;
    second.write_all(b"GET /icon.svg HTTP/1.1\r\nHost: x\r\n\r\nGET /").await.unwrap();
    let within = Duration::from_secs(14);
    let (a, b, c) =
        tokio::join!(ends(&mut silent, within), ends(&mut slow, within), ends(&mut second, within));
    assert!(a.is_some() && b.is_some(), "both are given up");
    let first = c.expect("it is given up after the first answer");
    assert!(first.starts_with(b"HTTP/1.1 200 OK"), "{}", String::from_utf8_lossy(&first));
    assert!(began.elapsed() > Duration::from_secs(8), "{:?}", began.elapsed());
    // The server goes on, and a page whose one request is answered all the time stays.
    for _ in 0..20 {
        page.text("status").await;
    }
    assert_eq!(Http::new(&server).await.ask("GET", "/icon.svg", b"").await.0, 200);
}

#[tokio::test]
async fn one_address_with_many_connections_does_not_send_off_another_that_is_coming_in() {
    let server = server("addresses");
    let mut held = Vec::new();
    // A phone that has begun its handshake.
    let phone = connect([127, 0, 0, 9], server.address()).await;
    for _ in 0..4 * PLACES {
        held.push(connect([127, 0, 0, 7], server.address()).await);
    }
    let connector = TlsConnector::from(tls(&server));
    let mut phone =
        connector.connect("localhost".try_into().unwrap(), phone).await.expect("its place is kept");
    phone.write_all(b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").await.unwrap();
    let page = ends(&mut phone, Duration::from_secs(5)).await.expect("an answer");
    assert!(page.starts_with(b"HTTP/1.1 200 OK"));
    drop(held);
}
