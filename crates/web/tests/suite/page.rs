//! The server as a browser uses it, but without a browser: TLS, the page's files, access, control, messages.

use crate::client;
use crate::played;

use cairn_sensor::GrayImage;
use cairn_session::SessionConfig;
use cairn_web::{CameraSource, ServeConfig, Server};
use client::tls;
use futures_util::{SinkExt, StreamExt};
use played::walk;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;
use tokio_rustls::TlsConnector;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

type Socket = WebSocketStream<tokio_rustls::client::TlsStream<tokio::net::TcpStream>>;

/// The folder of a test's server.
fn folder_of(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("cairn-page-{name}-{}", std::process::id()))
}

/// The same, emptied.
pub fn folder(name: &str) -> PathBuf {
    let folder = folder_of(name);
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn server(name: &str, camera: CameraSource) -> Server {
    let session = SessionConfig { folder: folder(name), ..SessionConfig::default() };
    Server::start(ServeConfig { session, ..ServeConfig::new(camera) }).unwrap()
}

pub async fn connect(server: &Server) -> Socket {
    let stream = tokio::net::TcpStream::connect(server.address()).await.unwrap();
    let name = "localhost".try_into().unwrap();
    let stream = TlsConnector::from(tls(server)).connect(name, stream).await.unwrap();
    let url = format!("wss://localhost:{}/ws", server.address().port());
    tokio_tungstenite::client_async(url, stream).await.unwrap().0
}

/// A page that answers pings, also while the test does something else; it disconnects when dropped.
pub struct Page {
    to: UnboundedSender<Message>,
    pub from: UnboundedReceiver<Message>,
    task: JoinHandle<()>,
}

impl Drop for Page {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Page {
    pub fn of(mut socket: Socket) -> Self {
        let (to, mut out) = unbounded_channel::<Message>();
        let (heard, from) = unbounded_channel();
        let task = tokio::spawn(async move {
            loop {
                let message = tokio::select! {
                    Some(message) = out.recv() => {
                        if socket.send(message).await.is_err() { return }
                        continue;
                    }
                    came = socket.next() => match came {
                        Some(Ok(message)) => message,
                        _ => return,
                    },
                };
                if let Message::Text(text) = &message
                    && let Some(ping) = serde_json::from_str::<Value>(text).unwrap().get("ping")
                {
                    let pong = json!({ "pong": { "n": ping["n"], "ms": page_ms() } });
                    if socket.send(Message::text(pong.to_string())).await.is_err() {
                        return;
                    }
                }
                if heard.send(message).is_err() {
                    return;
                }
            }
        });
        Self { to, from, task }
    }
}

pub async fn send(page: &mut Page, message: Value) {
    page.to.send(Message::text(message.to_string())).unwrap();
}

/// The page's time, milliseconds.
fn page_ms() -> f64 {
    static BEGAN: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    5000.0 + 1e3 * BEGAN.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}

/// The first message of a kind, within ten seconds.
pub async fn next(page: &mut Page, kind: &str) -> Value {
    let find = async {
        while let Some(message) = page.from.recv().await {
            if let Message::Text(text) = message {
                let mut value: Value = serde_json::from_str(&text).unwrap();
                if let Some(inner) = value.get_mut(kind) {
                    return inner.take();
                }
            }
        }
        panic!("closed before \"{kind}\" came")
    };
    tokio::time::timeout(Duration::from_secs(10), find).await.unwrap_or_else(|_| panic!("no \"{kind}\" came"))
}

/// The next binary message of a kind.
async fn binary(page: &mut Page, kind: u8) -> Vec<u8> {
    loop {
        if let Message::Binary(bytes) = page.from.recv().await.expect("it is open")
            && bytes[0] == kind
        {
            return bytes.to_vec();
        }
    }
}

pub fn greeting(server: &Server, secret: &str) -> Value {
    let token = &server.invitation().token;
    json!({ "hello": { "token": token, "walk": true, "secret": secret, "origin": 1 } })
}

async fn enter(server: &Server, secret: &str) -> Page {
    let mut page = Page::of(connect(server).await);
    send(&mut page, greeting(server, secret)).await;
    page
}

/// The next message about the walk that names this page as its holder, or no page.
async fn holder(page: &mut Page, id: &Value) -> Value {
    loop {
        let control = next(page, "control").await;
        if control["id"] == *id {
            return control;
        }
    }
}

/// The answer to a request without TLS.
fn without_tls(server: &Server, path: &str) -> String {
    let mut plain = TcpStream::connect(server.address()).unwrap();
    plain.write_all(format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).unwrap();
    let mut bytes = Vec::new();
    let _ = plain.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A phone downloads the authority's certificate without TLS, and then trusts the page; the authority stays the same at the
/// next start, the certificate of the page does not have to.
#[tokio::test]
async fn page_is_trusted_by_a_phone_that_trusts_its_authority() {
    let data = folder("authority-data");
    let start = || {
        let session = SessionConfig { folder: folder("authority"), ..SessionConfig::default() };
        Server::start(ServeConfig {
            authority: true,
            keep: Some(data.clone()),
            session,
            ..ServeConfig::new(CameraSource::Page { rig: None })
        })
        .unwrap()
    };
    let first = start();
    let profile = without_tls(&first, "/authority.mobileconfig");
    assert!(
        profile.contains("application/x-apple-aspen-config") && profile.contains("</plist>"),
        "{profile}"
    );
    assert!(without_tls(&first, "/").contains("400 Bad Request"));
    let certificate = first.certificate().clone();
    assert_eq!(first.authority().unwrap().der(), &certificate);
    let fingerprint = first.authority().unwrap().fingerprint();
    assert!(get(&first, "/words/en.json").contains(&fingerprint));
    assert!(get(&first, "/authority.crt").contains("application/x-x509-ca-cert"));
    drop(first);
    let second = start();
    assert_eq!(second.certificate(), &certificate, "the phone need not be asked again");
    // The handshake is made by a client that knows nothing but the authority.
    let mut page = enter(&second, "one").await;
    next(&mut page, "hello").await;
    drop(second);
    std::fs::remove_dir_all(data).unwrap();
}

/// The answer to a request over TLS.
fn get(server: &Server, path: &str) -> String {
    let mut connection = rustls::ClientConnection::new(tls(server), "localhost".try_into().unwrap()).unwrap();
    let mut stream = TcpStream::connect(server.address()).unwrap();
    let mut tls = rustls::Stream::new(&mut connection, &mut stream);
    write!(tls, "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut bytes = Vec::new();
    let _ = tls.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

#[tokio::test]
async fn page_is_served_over_tls_with_content_policy() {
    let server = server("files", CameraSource::Page { rig: None });
    let get = |path: &str| get(&server, path);
    for path in [
        "/",
        "/words.js",
        "/words/en.json",
        "/words/es.json",
        "/app.js",
        "/pace.js",
        "/pairing.js",
        "/phones.js",
        "/practice.js",
        "/reader.js",
        "/watch.js",
        "/camera.js",
        "/senses.js",
        "/routes.js",
        "/beside.js",
        "/buttons.js",
        "/view.js",
        "/map.js",
        "/model.js",
        "/orbit.js",
        "/scene.js",
        "/trust.js",
        "/link.js",
        "/kept.js",
        "/state.js",
        "/requests.js",
        "/coding.js",
        "/files.js",
        "/here.js",
        "/style.css",
        "/icon.svg",
    ] {
        let text = get(path);
        assert!(text.starts_with("HTTP/1.1 200"), "{path}: {text}");
        assert!(text.contains("content-security-policy: default-src 'none'"), "{path}");
        let body = text.split_once("\r\n\r\n").unwrap().1;
        let foreign = body.replace("http://www.w3.org/2000/svg", "");
        assert!(!foreign.contains("http://") && !foreign.contains("https://"), "{path} names another host");
    }
    assert!(get("/secret").starts_with("HTTP/1.1 404"));
    let german = get("/ HTTP/1.1\r\nAccept-Language: de-AT, en;q=0.5\r\nX-Rest:");
    assert!(german.contains("<html lang=\"de\">") && german.contains(">Aufnahme beenden</span>"), "{german}");
    // Without an authority there is nothing to trust.
    for text in [get("/authority.crt"), without_tls(&server, "/authority.crt")] {
        assert!(text.starts_with("HTTP/1.1 4"), "{text}");
    }
    // Without TLS the answer gives the right address.
    let text = without_tls(&server, "/");
    assert!(text.contains("https://"), "{text}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn token_is_required_and_one_page_controls() {
    let server = server("control", walk());
    let mut stranger = Page::of(connect(&server).await);
    send(&mut stranger, json!({ "hello": { "token": "0".repeat(32), "walk": true } })).await;
    assert_eq!(next(&mut stranger, "stranger").await, true);
    assert!(!matches!(stranger.from.recv().await, Some(Message::Text(_))));

    let mut walker = enter(&server, "one").await;
    let me = next(&mut walker, "hello").await["id"].clone();
    assert!(next(&mut walker, "control").await["id"].is_null(), "nobody holds the walk by being first");
    send(&mut walker, json!({ "take": true })).await;
    holder(&mut walker, &me).await;
    let mut watcher = enter(&server, "two").await;
    next(&mut watcher, "hello").await;
    assert_eq!(next(&mut watcher, "control").await["id"], me);
    send(&mut watcher, json!({ "command": "record" })).await;
    assert!(next(&mut watcher, "refused").await.as_str().unwrap().contains("Another device"));
    // Both receive the status.
    while next(&mut watcher, "status").await["tracked"].as_u64().unwrap() < 5 {}
    send(&mut watcher, json!({ "want": { "picture": true, "map": true } })).await;
    assert_eq!(binary(&mut watcher, 1).await[..5], [1, 64, 1, 240, 0]);
    assert!(next(&mut watcher, "view").await["camera"].is_array());
    // The first map is whole, with its points; the next has only what changed.
    let [first, second] = [binary(&mut watcher, 2).await, binary(&mut watcher, 2).await];
    let points = |map: &[u8]| u32::from_le_bytes(map[24..28].try_into().unwrap());
    assert!(first[1] == 1 && points(&first) > 50, "{:?}", &first[..28]);
    assert!(second.len() < first.len() || second[1] == 1, "{} bytes, then {}", first.len(), second.len());

    // The page that holds the walk decides how it is spoken to, and needs no answer to that; each page is refused in
    // its own language.
    let settings = |language: &str| json!({ "settings": { "language": language, "lines": [format!("set language {language}"), "set unit feet"] } });
    send(&mut watcher, settings("es")).await;
    send(&mut watcher, json!({ "command": "record" })).await;
    assert_eq!(next(&mut watcher, "refused").await, "Otro dispositivo tiene el control.");
    send(&mut walker, settings("de")).await;
    send(&mut walker, json!({ "command": "guide home" })).await;
    let refused = next(&mut walker, "did").await;
    assert_eq!(refused["text"], "Es gibt noch keine Route. Nehmen Sie erst eine auf, oder laden Sie eine.");
    assert_eq!(next(&mut walker, "said").await["language"], "de");
    while next(&mut watcher, "status").await["language"] != "de" {}
    send(
        &mut walker,
        json!({ "settings": { "language": "en", "lines": ["set language en", "set unit metres"] } }),
    )
    .await;
    send(&mut walker, json!({ "command": "guide home" })).await;
    let refused = next(&mut walker, "did").await;
    assert!(refused["ok"] == false && refused["text"].as_str().unwrap().contains("no route"), "{refused}");
    send(&mut walker, json!({ "command": "r" })).await;
    assert_eq!(next(&mut walker, "said").await["text"], "There is no route yet. Record or load one first.");
    assert_eq!(next(&mut watcher, "said").await["priority"], 1);
    while next(&mut walker, "status").await["recording"]["points"].as_u64().unwrap_or(0) < 20 {}
    send(&mut walker, json!({ "command": "stop" })).await;
    loop {
        if next(&mut walker, "did").await["text"].as_str().unwrap().starts_with("Recording has ended") {
            break;
        }
    }
    // A place is asked for by the number of its route, as the list of kept routes does.
    send(&mut walker, json!({ "command": "take me to the attic" })).await;
    let refused = next(&mut walker, "did").await;
    let names = "I do not know a place called the attic. I can take you to: the end of route 1, the start of route 1.";
    assert_eq!((&refused["ok"], &refused["text"]), (&json!(false), &json!(names)));
    // The walk goes on: sooner or later it is far enough from its start.
    let going = loop {
        send(&mut walker, json!({ "command": "take me to route 1 start" })).await;
        let did = next(&mut walker, "did").await;
        if did["ok"] == true {
            break did["text"].as_str().unwrap().to_owned();
        }
        let why = did["text"].as_str().unwrap();
        assert!(
            ["You are there already.", "I cannot guide you: the route is too short."].contains(&why),
            "{why}"
        );
        tokio::time::sleep(Duration::from_millis(300)).await;
    };
    assert!(going.starts_with("Going to the start of route 1, "), "{going}");
    send(&mut walker, json!({ "command": "load 1" })).await;
    assert!(next(&mut walker, "did").await["text"].as_str().unwrap().contains("Stop it first"));
    send(&mut walker, json!({ "command": "halt" })).await;
    assert_eq!(next(&mut walker, "did").await["ok"], true);
    send(&mut walker, json!({ "command": "load 1" })).await;
    assert_eq!(next(&mut walker, "did").await["ok"], true);
    send(&mut walker, json!({ "command": "guide back" })).await;
    // Then at once the first direction, with the route's length.
    let begins = next(&mut walker, "did").await["text"].as_str().unwrap().to_owned();
    assert_eq!(begins, "Guidance begins.");
    let words = loop {
        let said = next(&mut walker, "said").await["text"].as_str().unwrap().to_owned();
        if said.contains("The route is") {
            break said;
        }
    };
    assert!(words.contains("metre"), "{words}");
    // The walker's page closes: the walk waits for it, the recorded route is on disk, and another page does not get
    // the walk by being connected.
    drop(walker);
    let gone = loop {
        let control = next(&mut watcher, "control").await;
        if control["id"].is_null() {
            break control;
        }
    };
    assert_eq!(gone["held"], true);
    for refused in [json!({ "take": true }), json!({ "command": "halt" })] {
        send(&mut watcher, refused).await;
        assert!(next(&mut watcher, "refused").await.as_str().unwrap().contains("Otro dispositivo"));
    }
    // The page comes back by itself with its secret; then the other one takes over.
    let mut walker = enter(&server, "one").await;
    let me = next(&mut walker, "hello").await["id"].clone();
    holder(&mut watcher, &me).await;
    send(&mut watcher, json!({ "takeover": true })).await;
    while next(&mut walker, "control").await["id"] == me {}
    send(&mut watcher, json!({ "command": "halt" })).await;
    assert_eq!(next(&mut watcher, "did").await["ok"], true);
    let route = cairn_guide::Route::load(&folder_of("control").join("route-0001.route")).unwrap();
    assert!(route.points.len() >= 20 && !route.torn);
}

/// A page that falls silent without closing, as when its network fails, is detected within three seconds.
#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn silent_page_is_noticed_within_three_seconds() {
    let server = server("silent", walk());
    let mut walker = connect(&server).await;
    for message in [greeting(&server, "one"), json!({ "take": true })] {
        walker.send(Message::text(message.to_string())).await.unwrap();
    }
    let mut watcher = enter(&server, "two").await;
    while next(&mut watcher, "control").await["id"].is_null() {}
    // The walker's connection stays open, but nothing arrives from it.
    let silent = std::time::Instant::now();
    let control = holder(&mut watcher, &Value::Null).await;
    let after = silent.elapsed().as_secs_f64();
    assert!(control["held"] == true && (2.5..3.6).contains(&after), "after {after} s: {control}");
}

/// A page that takes the walk over hears of no image of the page before it: that time would be of another clock.
#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn page_that_takes_over_hears_of_its_own_images() {
    let server = server("over", CameraSource::Page { rig: None });
    let mut first = enter(&server, "one").await;
    let mut second = enter(&server, "two").await;
    let me = next(&mut second, "hello").await["id"].clone();
    send(&mut first, json!({ "take": true })).await;
    let pixels = (0..320 * 240).map(|k| (37 * (k % 320 / 9) + 91 * (k / 320 / 7)) as u8).collect();
    let jpeg = cairn_trial::encoded(&GrayImage::from_vec(320, 240, pixels).unwrap(), 75);
    // Until the time of one of its images is told to the page that sent it.
    let told = loop {
        let picture = [&page_ms().to_le_bytes()[..], &jpeg].concat();
        first.to.send(Message::binary(picture)).unwrap();
        let told = next(&mut first, "frame").await["ms"].clone();
        if !told.is_null() {
            break told;
        }
    };
    while next(&mut second, "control").await["id"].is_null() {}
    send(&mut second, json!({ "takeover": true })).await;
    let over = holder(&mut second, &me).await;
    let until = tokio::time::Instant::now() + Duration::from_millis(500);
    while let Ok(Some(message)) = tokio::time::timeout_at(until, second.from.recv()).await {
        let Message::Text(text) = message else { continue };
        assert!(!text.contains("\"frame\""), "{text} after {told} and {over}");
    }
}

/// A connection beside the first: let in by token, id and secret, for the same page; what goes on both is taken once.
#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn page_has_a_second_connection_and_strangers_have_none() {
    let server = server("beside", CameraSource::Page { rig: None });
    let mut page = enter(&server, "one").await;
    let id = next(&mut page, "hello").await["id"].clone();
    let token = &server.invitation().token;
    let beside = async |token: &str, id: &Value, secret: &str| {
        let mut beside = Page::of(connect(&server).await);
        send(&mut beside, json!({ "beside": { "token": token, "id": id, "secret": secret } })).await;
        beside
    };
    for mut stranger in [
        beside(&"0".repeat(32), &id, "one").await,
        beside(token, &id, "two").await,
        beside(token, &json!(99), "one").await,
    ] {
        let came = stranger.from.recv().await;
        assert!(!matches!(came, Some(Message::Text(_))), "{came:?}");
    }
    let mut second = beside(token, &id, "one").await;
    assert_eq!(next(&mut second, "beside").await, true);
    // A command that comes on both is carried out once, one that comes before the one before it waits.
    let copy = |number: u64, message: Value| json!({ "copy": [number, message] });
    send(&mut second, copy(1, json!({ "command": "record" }))).await;
    tokio::time::sleep(Duration::from_millis(50)).await;
    for page in [&mut second, &mut page] {
        send(page, copy(0, json!({ "take": true }))).await;
    }
    let refused = next(&mut page, "refused").await;
    assert!(refused.as_str().unwrap().contains("first picture"), "{refused}: the walk was taken first");
    // Both hear the same of what is said, with the same number.
    let _other = enter(&server, "three").await;
    let number = numbered(&mut page, &id).await;
    assert!(number.is_u64());
    while numbered(&mut second, &id).await != number {}
    // An image that came after a newer one on the other connection is confirmed and not used; its time is no fault.
    let picture = |ms: f64| Message::binary([&ms.to_le_bytes()[..], b"no jpeg"].concat());
    second.to.send(picture(page_ms())).unwrap();
    assert_eq!(next(&mut page, "got").await["overtaken"], false);
    page.to.send(picture(page_ms() - 1000.0)).unwrap();
    for page in [&mut page, &mut second] {
        while next(page, "got").await["overtaken"] != true {}
    }
    // A third and a fourth: there are two places, and one that ends makes room.
    let mut third = beside(token, &id, "one").await;
    assert_eq!(next(&mut third, "beside").await, true);
    assert!(!matches!(beside(token, &id, "one").await.from.recv().await, Some(Message::Text(_))));
    drop(second);
    drop(page);
    let ends = async { while third.from.recv().await.is_some() {} };
    tokio::time::timeout(Duration::from_secs(5), ends).await.expect("they end with the first");
}

/// The number of the next message that names this page as the walk's holder.
async fn numbered(page: &mut Page, id: &Value) -> Value {
    loop {
        let Some(Message::Text(text)) = page.from.recv().await else { panic!("closed") };
        let value: Value = serde_json::from_str(&text).unwrap();
        if value["control"]["id"] == *id {
            return value["no"].clone();
        }
    }
}
