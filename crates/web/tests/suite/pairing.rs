//! A phone without the key is given it for six digits, and is known again on another day from another address.

use crate::client::tls;
use crate::page::{Page, connect, folder, next, send};
use crate::played::walk;
use cairn_session::SessionConfig;
use cairn_web::{CameraSource, ServeConfig, Server};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// What the machine has said aloud.
type Aloud = Arc<Mutex<Vec<String>>>;

fn serve(data: &Path, camera: CameraSource, new_key: bool) -> (Server, Aloud) {
    let said = Aloud::default();
    let heard = said.clone();
    let session = SessionConfig { folder: data.join("routes"), ..SessionConfig::default() };
    let config = ServeConfig {
        keep: Some(data.to_owned()),
        routes: Some(data.join("routes")),
        new_key,
        aloud: Arc::new(move |_, text| heard.lock().unwrap().push(text.to_owned())),
        session,
        ..ServeConfig::new(camera)
    };
    (Server::start(config).unwrap(), said)
}

/// The answer to a request of the page that pairs.
fn pair(server: &Server, question: Value) -> Value {
    let mut connection = rustls::ClientConnection::new(tls(server), "localhost".try_into().unwrap()).unwrap();
    let mut stream = TcpStream::connect(server.address()).unwrap();
    let (mut tls, body) = (rustls::Stream::new(&mut connection, &mut stream), question.to_string());
    let head = "POST /pair HTTP/1.1\r\nHost: localhost\r\nConnection: close";
    write!(tls, "{head}\r\nContent-Length: {}\r\n\r\n{body}", body.len()).unwrap();
    let mut bytes = Vec::new();
    let _ = tls.read_to_end(&mut bytes);
    let text = String::from_utf8_lossy(&bytes).into_owned();
    serde_json::from_str(text.split_once("\r\n\r\n").unwrap().1).unwrap_or(Value::Null)
}

#[test]
fn six_digits_said_aloud_give_the_key_and_three_wrong_ones_do_not() {
    let data = folder("pairing");
    let (server, said) = serve(&data, CameraSource::Page { rig: None }, false);
    let token = server.invitation().token.clone();
    assert_eq!(pair(&server, json!({ "digits": "000000" })), json!({ "wrong": 0 }), "nobody has asked");
    assert_eq!(pair(&server, json!({ "language": "de" })), json!({ "said": true }));
    let text = said.lock().unwrap()[0].clone();
    assert!(text.starts_with("Der Code für das Telefon: "), "{text}");
    let digits: String = text.chars().filter(char::is_ascii_digit).collect();
    let wrong = if digits == "111111" { "222222" } else { "111111" };
    assert_eq!(pair(&server, json!({ "digits": wrong })), json!({ "wrong": 2 }));
    assert_eq!(pair(&server, json!({ "digits": digits })), json!({ "key": token }));
    // It opens once, and after three wrong tries there is no other for a while.
    assert_eq!(pair(&server, json!({ "digits": digits })), json!({ "wrong": 0 }));
    pair(&server, json!({}));
    let left: Vec<Value> = (0..3).map(|_| pair(&server, json!({ "digits": "x" }))["wrong"].clone()).collect();
    assert_eq!(left, [2, 1, 0]);
    assert!(pair(&server, json!({}))["wait"].as_u64().unwrap() <= 31);
    assert_eq!(said.lock().unwrap().len(), 2, "two codes, each said once");
    assert!(pair(&server, json!({ "fly": 1 })).is_null());
    drop(server);
    // The key is that of the folder, until another is asked for.
    let again = serve(&data, CameraSource::Page { rig: None }, false).0;
    assert_eq!(again.invitation().token, token);
    drop(again);
    assert_ne!(serve(&data, CameraSource::Page { rig: None }, true).0.invitation().token, token);
    std::fs::remove_dir_all(data).unwrap();
}

async fn enter(server: &Server, phone: &str) -> Page {
    let mut page = Page::of(connect(server).await);
    let token = &server.invitation().token;
    let hello =
        json!({ "hello": { "token": token, "walk": true, "secret": phone, "origin": 1, "phone": phone } });
    send(&mut page, hello).await;
    next(&mut page, "hello").await;
    page
}

/// The walk in a browser (`browser::walk`) shows that a phone that records is put on the list.
#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn a_phone_that_has_recorded_is_known_again_from_another_address() {
    let data = folder("known");
    std::fs::create_dir_all(&data).unwrap();
    let file = data.join("phones.json");
    let known =
        |settings: Value| json!([{ "phone": "first", "route": [1, "to the library"], "settings": settings }]);
    std::fs::write(&file, known(json!({ "speed": "240" })).to_string()).unwrap();
    let (server, _) = serve(&data, CameraSource::Page { rig: None }, false);
    let mut stranger = enter(&server, "second").await;
    assert_eq!(next(&mut stranger, "phones").await, known(json!({ "speed": "240" })));
    // Under its token it is not asked: the question would be the first after the greeting.
    let mut phone = enter(&server, "first").await;
    let came = phone.from.recv().await.unwrap().into_text().unwrap();
    assert!(!came.contains("phones"), "{came}");
    // Its settings follow it; who holds the walk is nobody else.
    send(&mut phone, json!({ "kept": { "speed": "300" } })).await;
    send(&mut phone, json!({ "take": true })).await;
    while next(&mut phone, "control").await["held"] != true {}
    let kept: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    assert_eq!(kept, known(json!({ "speed": "300" })));
    let mut third = enter(&server, "third").await;
    let came = third.from.recv().await.unwrap().into_text().unwrap();
    assert!(!came.contains("phones"), "{came}");
    // Another camera than the page's makes no page a phone.
    drop((stranger, phone, third, server));
    let (server, _) = serve(&data, walk(), false);
    let came = enter(&server, "second").await.from.recv().await.unwrap().into_text().unwrap();
    assert!(!came.contains("phones"), "{came}");
    drop(server);
    std::fs::remove_dir_all(data).unwrap();
}
