//! The page without a web socket, against the real server: the same protocol and the same rules over plain requests.

use crate::plain;
use crate::played;

use cairn_engine::SensorMode;
use cairn_sensor::Source;
use cairn_session::SessionConfig;
use cairn_sources::Paced;
use cairn_web::{CameraSource, ServeConfig, Server};
use futures_util::{SinkExt, StreamExt};
use plain::{Came, Http, Plain, stream};
use played::walk;
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use tokio_tungstenite::tungstenite::Message;

fn server(name: &str, camera: CameraSource) -> Server {
    let folder = std::env::temp_dir().join(format!("cairn-requests-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let session = SessionConfig { folder, ..SessionConfig::default() };
    Server::start(ServeConfig { session, ..ServeConfig::new(camera) }).unwrap()
}

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(Duration::from_secs(10), what).await.expect("nothing came within ten seconds")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn page_without_a_web_socket_walks_and_strangers_do_not() {
    let server = server("walk", walk());
    let mut http = Http::new(&server).await;
    // A stranger gets no line, with a wrong token or with none, and no other's line by guessing.
    let wrong = json!({ "hello": { "token": "0".repeat(32), "walk": true, "language": "de" } });
    let (status, trouble) = soon(http.ask("POST", "/requests", wrong.to_string().as_bytes())).await;
    assert_eq!((status, &trouble[..]), (403, r#"{"stranger":true}"#));
    assert_eq!(soon(http.ask("POST", "/requests", b"{}")).await.0, 403);
    for (method, path) in [("GET", "down"), ("POST", "texts/0"), ("POST", "picture/0")] {
        let path = format!("/requests/{}/{path}", "0".repeat(32));
        assert_eq!(soon(http.ask(method, &path, b"{\"take\":true}")).await.0, 410, "{path}");
    }
    let (status, _) = soon(Http::new(&server).await.ask("POST", "/requests", &[b'x'; 5000])).await;
    assert_eq!(status, 413, "too large for a hello");

    let mut walker = Plain::enter(&server, "one", true).await;
    let path = format!("/requests/{}/down", walker.line);
    assert_eq!(soon(http.ask("GET", &path, b"")).await.0, 409, "the stream is given once");
    let me = soon(walker.text("hello")).await["id"].clone();
    assert!(soon(walker.text("control")).await["id"].is_null());
    walker.send(&[json!({ "take": true }), json!({ "want": { "picture": true, "map": true } })]).await;
    while soon(walker.text("control")).await["id"] != me {}
    while soon(walker.text("status")).await["tracked"].as_u64().unwrap() < 5 {}
    for kind in [1, 2] {
        soon(async {
            loop {
                if let Some(Came::Binary(bytes)) = walker.next().await
                    && bytes[0] == kind
                {
                    return;
                }
            }
        })
        .await;
    }
    // Another page watches: it is refused, and notices when the walker's page is gone.
    let mut watcher = Plain::enter(&server, "two", true).await;
    soon(watcher.text("hello")).await;
    watcher.send(&[json!({ "command": "record" })]).await;
    assert!(soon(watcher.text("refused")).await.as_str().unwrap().contains("Another device"));
    walker.send(&[json!({ "command": "guide home" })]).await;
    assert_eq!(soon(walker.text("did")).await["ok"], false);
    drop(walker);
    loop {
        let control = soon(watcher.text("control")).await;
        if control["id"].is_null() && control["held"] == true {
            break;
        }
    }
    // It comes back with its secret; its old line is gone.
    let mut walker = Plain::enter(&server, "one", true).await;
    let me = soon(walker.text("hello")).await["id"].clone();
    while soon(watcher.text("control")).await["id"] != me {}
    // On a new connection: one without a request for ten seconds is closed.
    let mut http = Http::new(&server).await;
    assert_eq!(soon(http.ask("POST", &path.replace("down", "texts/0"), b"")).await.0, 410);
}

/// What comes again or too early is taken once and in order.
#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn commands_that_come_again_or_in_another_order_are_given_once_and_in_order() {
    let server = server("order", walk());
    let mut page = Plain::enter(&server, "one", true).await;
    page.send(&[json!({ "take": true })]).await;
    while soon(page.text("control")).await["id"].is_null() {}
    while soon(page.text("status")).await["tracked"].as_u64().unwrap() < 5 {}
    // Of a page that answers no ping, to number its requests here.
    let mut silent = Plain::enter(&server, "two", false).await;
    soon(silent.text("hello")).await;
    let mut http = Http::new(&server).await;
    let line = silent.line.clone();
    let mut give = async |n: u64, text: &str| {
        let path = format!("/requests/{line}/texts/{n}");
        soon(http.ask("POST", &path, text.as_bytes())).await.0
    };
    let over = r#"{"takeover":true}"#;
    assert_eq!(give(2, r#"{"command":"set unit steps 9"}"#).await, 204, "it waits");
    assert_eq!(give(1, r#"{"command":"delete"}"#).await, 204, "it waits too");
    assert_eq!(give(0, over).await, 204);
    assert_eq!(give(0, over).await, 204, "it came again");
    assert_eq!(give(1, r#"{"command":"delete"}"#).await, 204);
    assert_eq!(give(99, over).await, 429, "too far ahead");
    let mut answers = Vec::new();
    let until = Instant::now() + Duration::from_millis(800);
    while let Ok(came) = tokio::time::timeout_at(until.into(), silent.next()).await {
        let Some(Came::Text(value)) = came else { continue };
        if value.get("did").is_some() || value.get("refused").is_some() || value.get("control").is_some() {
            answers.push(value);
        }
    }
    // Who was told first that it holds the walk, then the two commands, each once.
    let kinds: Vec<&str> =
        answers.iter().map(|v| v.as_object().unwrap().keys().next().unwrap().as_str()).collect();
    let from = kinds.iter().rposition(|k| *k == "control").unwrap();
    assert_eq!(kinds[from..].len(), 3, "{answers:?}");
    assert!(answers[from]["control"]["id"].is_u64(), "{answers:?}");
}

/// A page that falls silent without closing is noticed within three seconds, as on a web socket.
#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn silent_page_is_noticed_within_three_seconds() {
    let server = server("silent", walk());
    let mut watcher = Plain::enter(&server, "two", true).await;
    let mut walker = Plain::enter(&server, "one", false).await;
    walker.send(&[json!({ "take": true })]).await;
    let silent = Instant::now();
    while soon(watcher.text("control")).await["id"].is_null() {}
    while !soon(watcher.text("control")).await["id"].is_null() {}
    let after = silent.elapsed().as_secs_f64();
    assert!((2.5..3.6).contains(&after), "after {after} s");
    // Its stream has ended.
    soon(async { while walker.next().await.is_some() {} }).await;
}

/// How long a picture takes until the page knows that it has arrived, over a web socket and over requests, in turn.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "prints figures of docs/figures/live.md"]
async fn picture_takes_as_long_by_requests() {
    let server = server("latency", CameraSource::Page { rig: None });
    let token = &server.invitation().token;
    let hello = json!({ "hello": { "token": token, "walk": true, "secret": "socket", "origin": 2 } });
    let url = format!("wss://localhost:{}/ws", server.address().port());
    let (mut socket, _) = tokio_tungstenite::client_async(url, stream(&server).await).await.unwrap();
    socket.send(Message::text(hello.to_string())).await.unwrap();
    let mut page = Plain::enter(&server, "plain", true).await;
    // Eight bytes of time; the rest is no picture, and none is decoded in time to matter.
    let mut picture = vec![7; 40_000];
    let mut took: [Vec<f64>; 2] = Default::default();
    for k in 0..400 {
        let ms = 1000.0 + f64::from(k);
        picture[..8].copy_from_slice(&ms.to_le_bytes());
        let over = json!({ "takeover": true });
        if k % 2 == 0 {
            socket.send(Message::text(over.to_string())).await.unwrap();
            let began = Instant::now();
            socket.send(Message::binary(picture.clone())).await.unwrap();
            while let Some(Ok(message)) = soon(socket.next()).await {
                let Message::Text(text) = message else { continue };
                let value: Value = serde_json::from_str(&text).unwrap();
                if let Some(ping) = value.get("ping") {
                    let pong = json!({ "pong": { "n": ping["n"], "ms": 5000.0 } });
                    socket.send(Message::text(pong.to_string())).await.unwrap();
                }
                if value["got"]["ms"] == ms {
                    break;
                }
            }
            took[0].push(1e3 * began.elapsed().as_secs_f64());
        } else {
            page.send(&[over]).await;
            // Texts and pictures come over connections of their own: the walk must be held first.
            tokio::time::sleep(Duration::from_millis(5)).await;
            let began = Instant::now();
            assert_eq!(page.picture(&picture).await, 204);
            while soon(page.text("got")).await["ms"] != ms {}
            took[1].push(1e3 * began.elapsed().as_secs_f64());
        }
    }
    for (name, mut ms) in ["web socket", "requests"].into_iter().zip(took) {
        ms.sort_by(f64::total_cmp);
        println!("{name}: least {:.2}, median {:.2}, p95 {:.2} ms of {}", ms[0], ms[100], ms[190], ms.len());
    }
}

/// A page that draws the surface of a recording of a depth camera, or of a walk, as it grows.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "prints figures of docs/figures/live.md"]
async fn surface_keeps_to_its_bytes() {
    let kitchen = std::env::var("CAIRN_DATA").map(|data| format!("{data}/7scenes-kitchen"));
    let walk = "sim:apartment?sensor=rgbd&rate=15".to_owned();
    for address in kitchen.into_iter().chain([walk]) {
        let name = address.clone();
        let open = move || {
            let source = cairn_sources::open(&name, cairn_sources::OpenOptions::default())?;
            let source: Box<dyn Source> = Box::new(Paced::new(source));
            Ok((source, SensorMode::Rgbd, false))
        };
        let camera = CameraSource::Source { name: address.clone(), open: Box::new(open) };
        let folder = std::env::temp_dir().join(format!("cairn-requests-surface-{}", std::process::id()));
        let session = SessionConfig { folder, ..SessionConfig::default() };
        let server = Server::start(ServeConfig { session, dense: true, ..ServeConfig::new(camera) }).unwrap();
        let mut page = Plain::enter(&server, "one", true).await;
        page.send(&[json!({ "want": { "picture": false, "map": true, "surface": true } })]).await;
        let mut sizes: Vec<(f64, usize)> = Vec::new();
        let mut began = None;
        loop {
            match soon(page.next()).await {
                Some(Came::Binary(bytes)) if bytes[0] == 3 => {
                    let began = *began.get_or_insert_with(Instant::now);
                    sizes.push((began.elapsed().as_secs_f64(), bytes.len()));
                }
                Some(Came::Text(value)) if value.get("ended").is_some() => break,
                Some(_) if began.is_some_and(|b: Instant| b.elapsed() > Duration::from_secs(60)) => break,
                Some(_) => {}
                None => break,
            }
        }
        let second = |from: f64| sizes.iter().filter(move |(t, _)| (from..from + 1.0).contains(t));
        let most = sizes.iter().map(|(t, _)| second(*t).map(|(_, n)| n).sum::<usize>()).max().unwrap();
        let sum: usize = sizes.iter().map(|(_, n)| n).sum();
        let (last, largest) = (sizes[sizes.len() - 1].0, sizes.iter().map(|(_, n)| n).max().unwrap());
        println!(
            "{address}: {:.0} kB in {last:.0} s, {:.0} kB/s, in the fullest second {:.0} kB, largest message {:.0} kB",
            1e-3 * sum as f64,
            1e-3 * sum as f64 / last,
            1e-3 * most as f64,
            1e-3 * *largest as f64
        );
        assert!(most <= 200_000, "{most} bytes in a second");
    }
}

/// Bytes a second of the map, on a walk and when it stands still at its end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "prints figures of docs/figures/live.md"]
async fn map_costs_few_bytes() {
    let server = server("bytes", walk());
    let mut page = Plain::enter(&server, "one", true).await;
    page.send(&[json!({ "want": { "picture": false, "map": true } })]).await;
    while soon(page.text("status")).await["tracked"].as_u64().unwrap() < 5 {}
    let began = Instant::now();
    let mut sizes: Vec<usize> = Vec::new();
    while began.elapsed() < Duration::from_secs(40) {
        sizes.push(match soon(page.next()).await {
            Some(Came::Binary(bytes)) if bytes[0] == 2 => bytes.len(),
            Some(Came::Text(value)) if value.get("view").is_some() => value.to_string().len(),
            Some(_) => continue,
            None => break,
        });
    }
    let sum: usize = sizes.iter().sum();
    println!("{:.1} kB/s in {} messages; bytes of each: {sizes:?}", 1e-3 * sum as f64 / 40.0, sizes.len());
}
