//! The page's side of the web socket: what the phone's browser says and hears.

use super::error::PhoneError;
use crate::socket::{ConnectError, Socket, connect, connector};
use cairn_phrases::Language;
use cairn_trial::{Lateness, Pace, PageClock, STALE_MS};
use cairn_web::Server;
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::time::{Duration, Instant};
use tokio_rustls::TlsConnector;
use tokio_tungstenite::tungstenite::Message;

/// Connections that may end before the page gives up, and the pause before the next, seconds; as the page.
const MOST_CONNECTIONS: usize = 30;
const AGAIN_S: f64 = 1.0;

/// The page.
pub struct Page {
    socket: Socket,
    tls: TlsConnector,
    address: SocketAddr,
    token: String,
    /// Tells the clock of this page from that of one before.
    origin: u64,
    /// Connections that have ended so far.
    pub broken: usize,
    /// The phone's clock.
    pub clock: PageClock,
    /// Decides about images.
    pub pace: Pace,
    language: Language,
    me: Option<u64>,
    /// Whether this page holds the walk.
    pub controls: bool,
    /// The last status.
    pub status: Value,
    /// The phone's time of the newest image that was tracked, milliseconds.
    pub frame_ms: Option<f64>,
    /// The camera's position in the map when the last view came.
    pub camera: Option<[f64; 3]>,
    /// Whether the sound of arrival was played: guidance has ended at the goal.
    pub arrived: bool,
    /// Words that wait for the walker.
    pub heard: Vec<String>,
    /// Answers to commands: whether they were carried out, and the text.
    pub answers: Vec<(bool, String)>,
    /// What was doubted or refused, for people.
    pub troubles: Vec<String>,
    /// The lens that the server has found: focal length as a share of the longer side, and distortion.
    pub lens: Option<[f64; 2]>,
    /// Directions that were held back because they were too old.
    pub withheld: usize,
    lateness: Lateness,
}

async fn connected(tls: &TlsConnector, address: SocketAddr) -> Result<Socket, ConnectError> {
    connect(tls, "localhost", &address.ip().to_string(), address.port()).await
}

impl Page {
    /// Opens the page of a server and takes the walk; `origin` is another for each page, as its clock is.
    ///
    /// # Errors
    /// What failed on the way.
    pub async fn open(
        server: &Server,
        language: Language,
        clock: PageClock,
        origin: u64,
    ) -> Result<Self, PhoneError> {
        let (tls, address) = (connector([server.certificate().clone()])?, server.address());
        let mut page = Self {
            socket: connected(&tls, address).await?,
            tls,
            address,
            token: server.invitation().token.clone(),
            origin,
            broken: 0,
            clock,
            pace: Pace::default(),
            language,
            me: None,
            controls: false,
            status: Value::Null,
            frame_ms: None,
            camera: None,
            arrived: false,
            heard: Vec::new(),
            answers: Vec::new(),
            troubles: Vec::new(),
            lens: None,
            withheld: 0,
            lateness: Lateness::default(),
        };
        page.hello().await?;
        page.send(json!({ "take": true })).await?;
        Ok(page)
    }

    async fn hello(&mut self) -> Result<(), PhoneError> {
        let hello = json!({ "token": self.token, "walk": true, "secret": "demo", "origin": self.origin, "phone": "demo" });
        self.send(json!({ "hello": hello })).await?;
        self.send(json!({ "want": { "picture": false, "map": true } })).await
    }

    /// Connects again after the connection has ended for the reason `why`; the walk has waited for this page.
    ///
    /// # Errors
    /// The reason, where that was tried too often.
    pub async fn reconnect(&mut self, why: PhoneError) -> Result<(), PhoneError> {
        (self.me, self.controls) = (None, false);
        loop {
            self.broken += 1;
            if self.broken > MOST_CONNECTIONS {
                return Err(why);
            }
            if let Ok(socket) = connected(&self.tls, self.address).await {
                self.socket = socket;
                self.pace.reset(1);
                if self.hello().await.is_ok() {
                    return Ok(());
                }
            }
            tokio::time::sleep(Duration::from_secs_f64(AGAIN_S)).await;
        }
    }

    /// Sends a message.
    ///
    /// # Errors
    /// When the connection has failed.
    pub async fn send(&mut self, message: Value) -> Result<(), PhoneError> {
        Ok(self.socket.send(Message::text(message.to_string())).await?)
    }

    /// Sends an image with the phone's time.
    ///
    /// # Errors
    /// When the connection has failed.
    pub async fn picture(&mut self, ms: f64, jpeg: &[u8]) -> Result<(), PhoneError> {
        let mut bytes = ms.to_le_bytes().to_vec();
        bytes.extend_from_slice(jpeg);
        let _ = self.pace.sent(Instant::now(), ms, bytes.len());
        Ok(self.socket.send(Message::binary(bytes)).await?)
    }

    /// The next message of the server.
    ///
    /// # Errors
    /// When the connection has ended.
    pub async fn next(&mut self) -> Result<Message, PhoneError> {
        match self.socket.next().await {
            Some(message) => Ok(message?),
            None => Err(PhoneError::Closed),
        }
    }

    /// Takes a message of the server as the page does.
    ///
    /// # Errors
    /// When the connection has failed, or the server says that the walk has.
    pub async fn take(&mut self, message: Message) -> Result<(), PhoneError> {
        let Message::Text(text) = message else { return Ok(()) };
        let value: Value = serde_json::from_str(&text)?;
        let text_of = |v: &Value| v.as_str().unwrap_or_default().to_owned();
        if let Some(ping) = value.get("ping") {
            let ms = self.clock.ms();
            self.send(json!({ "pong": { "n": ping["n"], "ms": ms } })).await?;
            self.pace.trip_ms = ping["trip_ms"].as_f64().unwrap_or(self.pace.trip_ms);
        } else if let Some(got) = value.get("got") {
            self.pace.got(Instant::now(), got["ms"].as_f64().ok_or(PhoneError::Unnamed)?);
        } else if let Some(hello) = value.get("hello") {
            self.me = hello["id"].as_u64();
        } else if let Some(control) = value.get("control") {
            self.controls = self.me.is_some() && control["id"].as_u64() == self.me;
        } else if let Some(frame) = value.get("frame") {
            self.frame_ms = frame["ms"].as_f64();
        } else if let Some(status) = value.get("status") {
            self.status = status.clone();
            self.watch().await?;
        } else if let Some(view) = value.get("view") {
            let number = |k: usize| view["camera"][0][k].as_f64();
            self.camera = number(0).zip(number(1)).zip(number(2)).map(|((x, y), z)| [x, y, z]);
        } else if let Some(said) = value.get("said") {
            self.said(said).await?;
        } else if let Some(sound) = value.get("sound") {
            self.arrived |= sound["name"] == "arrival";
        } else if let Some(did) = value.get("did") {
            self.answers.push((did["ok"] == true, text_of(&did["text"])));
        } else if let Some(lens) = value.get("lens") {
            self.lens = lens["focal"].as_f64().zip(lens["radial"].as_f64()).map(|(f, r)| [f, r]);
        } else if value.get("failed").is_some() {
            self.troubles.push("the walk has failed".into());
        } else if let Some(why) = value.get("refused").or(value.get("doubt")) {
            self.troubles.push(text_of(why));
        }
        Ok(())
    }

    /// Words: a direction is given only while its picture is fresh.
    async fn said(&mut self, said: &Value) -> Result<(), PhoneError> {
        let text = said["text"].as_str().unwrap_or_default().to_owned();
        if let Some(pose_ms) = said["pose_ms"].as_f64() {
            let old = self.clock.ms() - pose_ms > STALE_MS;
            if old || self.lateness.is_late() {
                self.withheld += 1;
                return if old { self.became_late().await } else { Ok(()) };
            }
        }
        self.heard.push(text);
        Ok(())
    }

    async fn became_late(&mut self) -> Result<(), PhoneError> {
        if !self.lateness.begin() {
            return Ok(());
        }
        // The page says this by itself.
        self.heard.push(self.language.text("page-pictures-late"));
        self.send(json!({ "late": true })).await
    }

    /// The end of being late: the pictures were fresh for a while.
    async fn watch(&mut self) -> Result<(), PhoneError> {
        let age_ms = self.frame_ms.map(|ms| self.clock.ms() - ms);
        match self.lateness.ends(age_ms, Instant::now()) {
            true => self.send(json!({ "late": false })).await,
            false => Ok(()),
        }
    }
}
