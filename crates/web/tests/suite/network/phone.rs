//! A phone on a simulated walk that behaves like the page: a clock of its own, JPEGs stamped with it, one image on
//! its way, no old direction given, stop when messages arrive too late, another connection after three silent seconds.
//! Its walker obeys: stands still on "stop", goes on with a direction.

use crate::walked::RATE_HZ;
use cairn_sensor::GrayImage;
use cairn_trial::{LEVELS, Lateness, Pace, PageClock, STALE_MS, encoded, smaller};
use cairn_web::InOrder;
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;
use tokio_rustls::TlsConnector;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

pub type Socket = WebSocketStream<tokio_rustls::client::TlsStream<tokio::net::TcpStream>>;

/// As in the page.
const BACK: Duration = Duration::from_millis(1000);
const GONE: Duration = Duration::from_secs(3);
const OPEN: Duration = Duration::from_secs(10);
/// Connections beside the first, and the pause before one that has failed is opened again.
const BESIDE: usize = 2;
const REOPEN: Duration = Duration::from_secs(2);
/// Time from the exposure to the encoded image.
const ENCODING: Duration = Duration::from_millis(30);

type Jpeg = Arc<Vec<u8>>;

/// The images of a walk as JPEGs of every level, encoded on first use.
pub struct Album {
    pictures: Vec<GrayImage>,
    /// By image and level.
    coded: Mutex<HashMap<(usize, usize), Jpeg>>,
}

impl Album {
    pub fn new(pictures: Vec<GrayImage>) -> Self {
        Self { pictures, coded: Mutex::default() }
    }

    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    fn jpeg(&self, k: usize, level: usize) -> Jpeg {
        if let Some(known) = self.coded.lock().unwrap().get(&(k, level)) {
            return known.clone();
        }
        let (side, quality, _) = LEVELS[level];
        let picture = &self.pictures[k];
        let scale = f64::from(side) / picture.width().max(picture.height()) as f64;
        let bytes = Arc::new(if scale < 1.0 {
            encoded(&smaller(picture, scale), quality)
        } else {
            encoded(picture, quality)
        });
        self.coded.lock().unwrap().insert((k, level), bytes.clone());
        bytes
    }
}

/// What happened on a leg of a walk.
#[derive(Clone, Copy, Debug, Default)]
pub struct Leg {
    /// Seconds of the leg, seconds after the answer to the command, and of these the seconds in which the walker was
    /// guided.
    pub took_s: f64,
    pub total_s: f64,
    pub guided_s: f64,
    /// Images that were sent.
    pub pictures: usize,
    /// Directions that were given, and those that arrived too late and were not given.
    pub given: usize,
    pub withheld: usize,
    /// The age of the oldest pose that a given direction was based on, milliseconds, by the phone's clock.
    pub oldest_ms: f64,
    pub stops: usize,
    pub connections: usize,
    /// Share of the way that was walked.
    pub walked: f64,
}

/// The phone.
pub struct Phone {
    pub clock: PageClock,
    pub album: Arc<Album>,
    pub at: f64,
    tls: Arc<rustls::ClientConfig>,
    address: SocketAddr,
    token: String,
    socket: Option<Socket>,
    beside: Vec<Beside>,
    came: UnboundedReceiver<Came>,
    tell: UnboundedSender<Came>,
    /// Counts the times that connections were opened.
    nth: usize,
    /// Words, which come on all connections, and the number of the next command.
    words: InOrder<Value>,
    commands: u64,
    /// When something came on the first connection, and on any.
    heard: Instant,
    heard_any: Instant,
    me: Option<u64>,
    controls: bool,
    pace: Pace,
    status: Value,
    /// The phone's time of the newest image that was tracked.
    frame_ms: Option<f64>,
    lateness: Lateness,
    goes: bool,
    arrived: bool,
    pub leg: Leg,
    pub heard_texts: Vec<String>,
    /// When the walker was told to stop.
    pub stopped: Vec<Instant>,
    /// When a direction was given.
    pub directed: Vec<Instant>,
}

/// What the phone does on a leg.
pub enum Walk {
    /// Walks by itself towards the last image while recording.
    Out,
    /// Is guided towards an image.
    To(usize),
}

impl Phone {
    pub fn new(
        clock: PageClock,
        album: Arc<Album>,
        tls: Arc<rustls::ClientConfig>,
        address: SocketAddr,
        token: String,
    ) -> Self {
        let (tell, came) = unbounded_channel();
        Self {
            clock,
            album,
            at: 0.0,
            tls,
            address,
            token,
            socket: None,
            beside: Vec::new(),
            came,
            tell,
            nth: 0,
            words: InOrder::default(),
            commands: 0,
            heard: Instant::now(),
            heard_any: Instant::now(),
            me: None,
            controls: false,
            pace: Pace::default(),
            status: Value::Null,
            frame_ms: None,
            lateness: Lateness::default(),
            goes: false,
            arrived: false,
            leg: Leg::default(),
            heard_texts: Vec::new(),
            stopped: Vec::new(),
            directed: Vec::new(),
        }
    }

    pub async fn connect(&mut self) {
        (self.me, self.controls, self.socket) = (None, false, None);
        self.pace.reset(1);
        self.beside.clear();
        self.nth += 1;
        (self.words, self.commands) = (InOrder::default(), 0);
        self.lateness = Lateness::default();
        self.leg.connections += 1;
        let opening = opened(self.address, self.tls.clone());
        self.socket = tokio::time::timeout(OPEN, opening).await.ok().flatten();
        self.heard = Instant::now();
        let hello =
            json!({ "hello": { "token": self.token, "walk": true, "secret": "the phone", "origin": 1 } });
        self.send(Message::text(hello.to_string())).await;
        self.send_copies(json!({ "take": true })).await;
    }

    /// Opens connections beside the first where the link has room for them, and closes them where it no longer has.
    fn widen(&mut self) {
        let has_room = self.pace.has_room();
        match self.me {
            Some(id) if has_room && self.beside.is_empty() => self.open_beside(id),
            _ if !has_room && !self.beside.is_empty() => {
                self.beside.clear();
                self.nth += 1;
                self.count_connections();
            }
            _ => {}
        }
    }

    fn open_beside(&mut self, id: u64) {
        let hello = json!({ "beside": { "token": self.token, "id": id, "secret": "the phone" } }).to_string();
        let wanted = std::env::var("CAIRN_CONNECTIONS").ok().and_then(|n| n.parse::<usize>().ok());
        for k in 0..wanted.map_or(BESIDE, |n| n - 1) {
            let (to, out) = unbounded_channel();
            let at = (self.nth, k);
            let run = run_beside(at, self.address, self.tls.clone(), hello.clone(), out, self.tell.clone());
            self.beside.push(Beside { to, open: false, task: tokio::spawn(run) });
        }
    }

    /// What has come on a connection beside the first, or that it has ended.
    async fn take_beside(&mut self, Came { at: (nth, k), message }: Came) {
        if nth != self.nth {
            return;
        }
        let Some(message) = message else {
            self.beside[k].open = false;
            self.count_connections();
            return;
        };
        if matches!(&message, Message::Text(text) if text.starts_with("{\"beside\"")) {
            self.beside[k].open = true;
            self.count_connections();
            return;
        }
        // Whether the first has fallen silent is another matter.
        let heard = self.heard;
        self.take(message).await;
        self.heard = heard;
    }

    fn count_connections(&mut self) {
        self.pace.reset(1 + self.beside.iter().filter(|b| b.open).count());
    }

    /// Sends a message on all connections.
    async fn send_copies(&mut self, message: Value) {
        let copy = json!({ "copy": [self.commands, message] }).to_string();
        self.commands += 1;
        for beside in self.beside.iter().filter(|b| b.open) {
            let _ = beside.to.send(Message::text(copy.clone()));
        }
        self.send(Message::text(copy)).await;
    }

    async fn send(&mut self, message: Message) {
        if let Some(socket) = &mut self.socket {
            // A link that accepts no data is detected by its silence.
            let _ = tokio::time::timeout(GONE, socket.send(message)).await;
        }
    }

    /// Whether it is connected and holds the walk.
    #[allow(dead_code, reason = "for the tests of other crates")]
    pub fn holds(&self) -> bool {
        self.socket.is_some() && self.controls
    }

    pub async fn command(&mut self, line: &str) {
        self.send_copies(json!({ "command": line })).await;
    }

    /// Walks until the end of the way, or for this long.
    pub async fn walk(&mut self, walk: Walk, limit: Duration) -> Leg {
        let (began, from) = (Instant::now(), self.at);
        let goal = match walk {
            Walk::Out => self.album.len() - 1,
            Walk::To(goal) => goal,
        } as f64;
        let free = matches!(walk, Walk::Out);
        self.leg = Leg::default();
        (self.goes, self.arrived) = (free, false);
        let mut before = Instant::now();
        let mut exposed: Option<(Instant, f64, Jpeg)> = None;
        let mut clock = tokio::time::interval(Duration::from_millis(5));
        clock.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        while began.elapsed() < limit && !(self.arrived || free && self.at == goal) {
            tokio::select! {
                message = next(&mut self.socket) => match message {
                    Some(message) => self.take(message).await,
                    None => self.connect().await,
                },
                Some(came) = self.came.recv() => self.take_beside(came).await,
                _ = clock.tick() => {}
            }
            let passed = before.elapsed().as_secs_f64();
            before = Instant::now();
            if self.goes {
                // A moving walker advances by as many images a second as the walk was made for.
                let step = RATE_HZ * passed;
                self.at =
                    if goal > self.at { (self.at + step).min(goal) } else { (self.at - step).max(goal) };
            }
            let silence = match (&self.socket, self.me) {
                (None, _) => BACK,
                (_, None) => OPEN,
                _ => GONE,
            };
            if self.heard.elapsed() > silence {
                self.goes = free;
                self.connect().await;
            }
            self.watch().await;
            let guided = self.me.is_some() && !self.lateness.is_late() && self.is_guided();
            self.leg.guided_s += if guided { passed } else { 0.0 };
            // The answer to the command is said before the first direction.
            let waits = self.status["guiding"].is_null() || self.status["guiding"]["state"] == "waiting";
            self.leg.total_s += if waits { 0.0 } else { passed };
            let now = Instant::now();
            if exposed.is_none() && self.controls && self.pace.may_shoot(now) {
                exposed =
                    Some((now, self.clock.ms(), self.album.jpeg(self.at.round() as usize, self.pace.level)));
            }
            if let Some((_, ms, jpeg)) = exposed.take_if(|(at, ..)| at.elapsed() >= ENCODING) {
                let mut bytes = ms.to_le_bytes().to_vec();
                bytes.extend_from_slice(&jpeg);
                let on = self.pace.sent(Instant::now(), ms, bytes.len());
                self.leg.pictures += 1;
                match on.checked_sub(1) {
                    None => self.send(Message::binary(bytes)).await,
                    Some(k) => {
                        let beside = self.beside.iter().filter(|b| b.open).nth(k);
                        let _ = beside.map(|b| b.to.send(Message::binary(bytes)));
                    }
                }
            }
        }
        self.leg.took_s = began.elapsed().as_secs_f64();
        self.leg.walked = if goal == from { 1.0 } else { (self.at - from) / (goal - from) };
        self.leg
    }

    fn is_guided(&self) -> bool {
        let state = &self.status["guiding"]["state"];
        state.is_string()
            && state != "stopped"
            && state != "waiting"
            && self.heard_any.elapsed() < Duration::from_millis(600)
    }

    fn age_ms(&self) -> Option<f64> {
        Some(self.clock.ms() - self.frame_ms?)
    }

    /// As the page's timer: too late, or fresh again.
    async fn watch(&mut self) {
        let Some(age) = self.age_ms() else { return };
        if self.me.is_some() && self.status["guiding"].is_object() && age > STALE_MS {
            self.became_late().await;
        } else if self.lateness.ends(Some(age), Instant::now()) {
            self.send_copies(json!({ "late": false })).await;
        }
    }

    async fn became_late(&mut self) {
        if self.lateness.begin() {
            (self.goes, self.leg.stops) = (false, self.leg.stops + 1);
            self.send_copies(json!({ "late": true })).await;
        }
    }

    async fn take(&mut self, message: Message) {
        (self.heard, self.heard_any) = (Instant::now(), Instant::now());
        let Message::Text(text) = message else { return };
        let value: Value = serde_json::from_str(&text).unwrap();
        let due = match value["no"].as_u64() {
            Some(number) => self.words.take(number, value),
            None => vec![value],
        };
        for value in due {
            self.take_value(&value).await;
        }
    }

    async fn take_value(&mut self, value: &Value) {
        if let Some(ping) = value.get("ping") {
            let pong = json!({ "pong": { "n": ping["n"], "ms": self.clock.ms() } });
            self.send(Message::text(pong.to_string())).await;
            self.pace.trip_ms = ping["trip_ms"].as_f64().unwrap_or(self.pace.trip_ms);
        } else if let Some(got) = value.get("got") {
            self.pace.got(Instant::now(), got["ms"].as_f64().unwrap());
            self.widen();
        } else if let Some(hello) = value.get("hello") {
            self.me = hello["id"].as_u64();
        } else if let Some(control) = value.get("control") {
            self.controls = self.me.is_some() && control["id"].as_u64() == self.me;
        } else if let Some(frame) = value.get("frame") {
            // On another connection a newer one may have come before.
            let ms = frame["ms"].as_f64();
            self.frame_ms = ms.filter(|ms| self.frame_ms.is_none_or(|known| *ms > known)).or(self.frame_ms);
        } else if let Some(status) = value.get("status") {
            self.status = status.clone();
        } else if let Some(said) = value.get("said") {
            self.said(said).await;
        }
    }

    async fn said(&mut self, said: &Value) {
        let text = said["text"].as_str().unwrap_or_default();
        if let Some(pose_ms) = said["pose_ms"].as_f64() {
            let age = self.clock.ms() - pose_ms;
            if age > STALE_MS || self.lateness.is_late() {
                self.leg.withheld += 1;
                if age > STALE_MS {
                    self.became_late().await;
                }
                return;
            }
            (self.leg.given, self.leg.oldest_ms) = (self.leg.given + 1, self.leg.oldest_ms.max(age));
            self.directed.push(Instant::now());
            self.goes = true;
        } else if said["priority"] == 0 {
            self.stopped.push(Instant::now());
            (self.goes, self.leg.stops) = (false, self.leg.stops + 1);
        }
        self.heard_texts.push(text.to_owned());
        self.arrived |= text.starts_with("Stop. You have arrived");
    }
}

/// The next message; waits forever without a connection; `None` at its end.
async fn next(socket: &mut Option<Socket>) -> Option<Message> {
    match socket {
        Some(socket) => socket.next().await.and_then(Result::ok),
        None => {
            tokio::time::sleep(Duration::from_millis(300)).await;
            None
        }
    }
}

/// A connection beside the first.
struct Beside {
    to: UnboundedSender<Message>,
    open: bool,
    task: JoinHandle<()>,
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// What came on one, told by the number of the first connection and its own; no message at its end.
struct Came {
    at: (usize, usize),
    message: Option<Message>,
}

async fn opened(address: SocketAddr, tls: Arc<rustls::ClientConfig>) -> Option<Socket> {
    let stream = tokio::net::TcpStream::connect(address).await.ok()?;
    let _ = stream.set_nodelay(true);
    let name = "localhost".try_into().ok()?;
    let stream = TlsConnector::from(tls).connect(name, stream).await.ok()?;
    Some(tokio_tungstenite::client_async("wss://localhost/ws", stream).await.ok()?.0)
}

/// Opens it, and again when it ends.
async fn run_beside(
    at: (usize, usize),
    address: SocketAddr,
    tls: Arc<rustls::ClientConfig>,
    hello: String,
    mut out: UnboundedReceiver<Message>,
    tell: UnboundedSender<Came>,
) {
    loop {
        if let Some(mut socket) = opened(address, tls.clone()).await {
            while out.try_recv().is_ok() {}
            let mut good = socket.send(Message::text(hello.clone())).await.is_ok();
            while good {
                good = tokio::select! {
                    message = out.recv() => match message {
                        Some(message) => socket.send(message).await.is_ok(),
                        None => return,
                    },
                    came = socket.next() => match came {
                        Some(Ok(message)) => tell.send(Came { at, message: Some(message) }).is_ok(),
                        _ => false,
                    },
                };
            }
        }
        let _ = tell.send(Came { at, message: None });
        tokio::time::sleep(REOPEN).await;
    }
}
