//! A page without a web socket, as `requests.js` is one: plain requests over TLS, HTTP/1.1 (RFC 9112).

use crate::client::tls;
use cairn_web::Server;
use serde_json::{Value, json};
use std::sync::Arc;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::sync::Mutex;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::task::JoinHandle;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;

/// A TLS connection to the server.
pub async fn stream(server: &Server) -> TlsStream<TcpStream> {
    let stream = TcpStream::connect(server.address()).await.unwrap();
    stream.set_nodelay(true).unwrap();
    TlsConnector::from(tls(server)).connect("localhost".try_into().unwrap(), stream).await.unwrap()
}

/// A connection that is kept for several requests.
pub struct Http(BufReader<TlsStream<TcpStream>>);

impl Http {
    pub async fn new(server: &Server) -> Self {
        Self(BufReader::new(stream(server).await))
    }

    /// Sends a request; returns the status and whether the body comes in chunks, else its length.
    async fn begin(&mut self, method: &str, path: &str, body: &[u8]) -> (u16, Option<usize>) {
        let head = format!("{method} {path} HTTP/1.1\r\nHost: x\r\nContent-Length: {}\r\n\r\n", body.len());
        self.0.write_all(&[head.as_bytes(), body].concat()).await.unwrap();
        self.0.flush().await.unwrap();
        let status = self.line().await.split(' ').nth(1).unwrap().parse().unwrap();
        let mut length = Some(0);
        loop {
            let line = self.line().await.to_lowercase();
            match line.split_once(": ") {
                None => return (status, length),
                Some(("content-length", n)) => length = Some(n.parse().unwrap()),
                Some(("transfer-encoding", _)) => length = None,
                Some(_) => {}
            }
        }
    }

    async fn line(&mut self) -> String {
        let mut line = String::new();
        self.0.read_line(&mut line).await.unwrap();
        line.trim_end().to_owned()
    }

    /// The status and the body of an answer.
    pub async fn ask(&mut self, method: &str, path: &str, body: &[u8]) -> (u16, String) {
        let (status, length) = self.begin(method, path, body).await;
        let mut bytes = vec![0; length.expect("a whole body")];
        self.0.read_exact(&mut bytes).await.unwrap();
        (status, String::from_utf8(bytes).unwrap())
    }

    /// The next chunk of an answer; `None` at its end.
    async fn chunk(&mut self) -> Option<Vec<u8>> {
        let length = usize::from_str_radix(&self.line().await, 16).ok()?;
        let mut bytes = vec![0; length];
        self.0.read_exact(&mut bytes).await.ok()?;
        self.line().await;
        (length > 0).then_some(bytes)
    }
}

/// A message of the stream.
#[derive(Debug)]
pub enum Came {
    Text(Value),
    Binary(Vec<u8>),
}

/// A page; it disconnects when dropped.
pub struct Plain {
    pub line: String,
    posts: Arc<Mutex<(Http, u64)>>,
    pictures: (Http, u64),
    from: UnboundedReceiver<Came>,
    task: JoinHandle<()>,
}

impl Drop for Plain {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Plain {
    /// A page that says hello and answers pings where `answers` says so.
    pub async fn enter(server: &Server, secret: &str, answers: bool) -> Self {
        let token = &server.invitation().token;
        let hello = json!({ "hello": { "token": token, "walk": true, "secret": secret, "origin": 1 } });
        let mut http = Http::new(server).await;
        let (status, line) = http.ask("POST", "/requests", hello.to_string().as_bytes()).await;
        assert_eq!(status, 200, "{line}");
        let mut down = Http::new(server).await;
        let (status, length) = down.begin("GET", &format!("/requests/{line}/down"), b"").await;
        assert_eq!((status, length), (200, None));
        let (heard, from) = unbounded_channel();
        let posts = Arc::new(Mutex::new((http, 0)));
        let (answering, at) = (posts.clone(), line.clone());
        let task = tokio::spawn(async move {
            let (mut kept, mut number) = (Vec::new(), 0);
            while let Some(chunk) = down.chunk().await {
                kept.extend(chunk);
                while let Some((kind, n, payload)) = frame(&mut kept) {
                    if kind == 0 {
                        continue;
                    }
                    assert_eq!(n, number, "a message is missing");
                    number += 1;
                    if kind == 2 {
                        let _ = heard.send(Came::Binary(payload));
                        continue;
                    }
                    let value: Value = serde_json::from_slice(&payload).unwrap();
                    if let (Some(ping), true) = (value.get("ping"), answers) {
                        let pong = json!({ "pong": { "n": ping["n"], "ms": 5000.0 } });
                        post(&answering, &at, &pong.to_string()).await;
                    }
                    let _ = heard.send(Came::Text(value));
                }
            }
        });
        Self { line, posts, pictures: (Http::new(server).await, 0), from, task }
    }

    /// Sends texts in one request, with its number.
    pub async fn send(&mut self, texts: &[Value]) -> u16 {
        let lines: Vec<String> = texts.iter().map(Value::to_string).collect();
        post(&self.posts, &self.line, &lines.join("\n")).await
    }

    pub async fn picture(&mut self, bytes: &[u8]) -> u16 {
        let (http, n) = &mut self.pictures;
        *n += 1;
        http.ask("POST", &format!("/requests/{}/picture/{}", self.line, *n - 1), bytes).await.0
    }

    /// The next message; `None` at the end.
    pub async fn next(&mut self) -> Option<Came> {
        self.from.recv().await
    }

    /// The first text of a kind.
    pub async fn text(&mut self, kind: &str) -> Value {
        while let Some(came) = self.next().await {
            if let Came::Text(mut value) = came
                && let Some(inner) = value.get_mut(kind)
            {
                return inner.take();
            }
        }
        panic!("closed before \"{kind}\" came")
    }
}

async fn post(posts: &Mutex<(Http, u64)>, line: &str, body: &str) -> u16 {
    let (http, n) = &mut *posts.lock().await;
    let path = format!("/requests/{line}/texts/{n}");
    *n += 1;
    http.ask("POST", &path, body.as_bytes()).await.0
}

/// The first whole frame: kind, number, payload.
fn frame(kept: &mut Vec<u8>) -> Option<(u8, u32, Vec<u8>)> {
    let number = |at: usize| Some(u32::from_le_bytes(kept.get(at..at + 4)?.try_into().ok()?));
    let (end, kind, n) = (9 + number(0)? as usize, *kept.get(4)?, number(5)?);
    let payload = kept.get(9..end)?.to_vec();
    kept.drain(..end);
    Some((kind, n, payload))
}
