//! The server: the page's files, and a web socket for each page.

use crate::certificate::Certificate;
use crate::hub::{Hub, Shared};
use crate::invitation::{Invitation, lan_address, new_token, same};
use crate::tls::TlsListener;
use crate::walk::walk;
use crate::wire::{self, FromPage, ToPage};
use axum::Router;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use cairn_engine::{Config, SensorMode};
use cairn_sensor::{Rig, Source, SourceError};
use cairn_session::{Command, SessionConfig};
use rustls::pki_types::CertificateDer;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{broadcast, oneshot, watch};

/// A page that does not send its hello within this time is disconnected.
const HELLO_WITHIN: Duration = Duration::from_secs(5);
/// The largest message of a page: a picture.
const LARGEST: usize = 4 << 20;

/// Opens a source that is not the page's camera; returns it with its camera mode and whether its IMU is used.
pub type OpenSource = Box<dyn FnOnce() -> Result<(Box<dyn Source>, SensorMode, bool), SourceError> + Send>;

/// The session's camera.
pub enum CameraSource {
    /// The camera of the page that controls.
    Page {
        /// The calibration; an estimate without it.
        rig: Option<Box<Rig>>,
    },
    /// Another source.
    Source {
        /// Its name, for people.
        name: String,
        /// Opens it; called on the session's thread, may block.
        open: OpenSource,
    },
}

/// Config of a server.
pub struct ServeConfig {
    /// Reachable from the local network, not only from this machine.
    pub lan: bool,
    /// The port; 0 takes a free one.
    pub port: u16,
    /// The folder of the certificate, so that a phone asks only once whether to trust it; without one it is new at each
    /// start.
    pub keep: Option<PathBuf>,
    /// The session's camera.
    pub camera: CameraSource,
    /// The engine's config.
    pub config: Config,
    /// The session's config.
    pub session: SessionConfig,
}

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// The port cannot be bound.
    #[error("port {port}: {source}")]
    Port {
        /// The port.
        port: u16,
        /// The system's error.
        source: std::io::Error,
    },
    /// Another failure of the machine, such as no thread or no random numbers.
    #[error("{0}")]
    Machine(String),
}

/// A running server.
pub struct Server {
    invitation: Invitation,
    address: SocketAddr,
    certificate: CertificateDer<'static>,
    not_kept: Option<String>,
    hub: Arc<Hub>,
    stop: Option<oneshot::Sender<()>>,
    web: Option<JoinHandle<()>>,
    walk: Option<JoinHandle<Result<(), SourceError>>>,
}

impl Server {
    /// Binds the port, makes a token, loads or makes a certificate, and starts.
    ///
    /// # Errors
    /// When the port is taken, or the machine provides no thread or random number.
    pub fn start(config: ServeConfig) -> Result<Self, WebError> {
        let machine = |why: String| WebError::Machine(why);
        let host: IpAddr = if config.lan { Ipv4Addr::UNSPECIFIED.into() } else { Ipv4Addr::LOCALHOST.into() };
        let listener = std::net::TcpListener::bind((host, config.port))
            .and_then(|l| l.set_nonblocking(true).map(|()| l))
            .map_err(|source| WebError::Port { port: config.port, source })?;
        let address = listener.local_addr().map_err(|e| machine(e.to_string()))?;
        let lan = if config.lan { lan_address() } else { None };
        let mut addresses: Vec<IpAddr> = lan.into_iter().collect();
        addresses.push(Ipv4Addr::LOCALHOST.into());
        let names = ["localhost".to_owned()];
        let (certificate, not_kept) = match &config.keep {
            Some(folder) => Certificate::kept(folder, &addresses, &names).map_err(machine)?,
            None => (Certificate::new(&addresses, &names).map_err(machine)?, None),
        };
        let der = certificate.der();
        let tls = certificate.into_server().map_err(machine)?;
        let token = new_token().map_err(machine)?;
        let invitation = Invitation::new(address, lan, &token);
        let camera = match &config.camera {
            CameraSource::Page { .. } => String::new(),
            CameraSource::Source { name, .. } => name.clone(),
        };
        let hub = Arc::new(Hub::new(token, camera));
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_name("cairn-page")
            .enable_all()
            .build()
            .map_err(|e| machine(e.to_string()))?;
        let (stop, stopped) = oneshot::channel();
        let router = router(hub.clone());
        let web = std::thread::Builder::new().name("cairn-web".into()).spawn(move || {
            let serve = async {
                let listener = TcpListener::from_std(listener).and_then(|l| TlsListener::new(l, tls));
                if let Ok(listener) = listener {
                    let _ = axum::serve(listener, router).await;
                }
            };
            runtime.block_on(async {
                tokio::select! {
                    () = serve => {}
                    _ = stopped => {}
                }
            });
            runtime.shutdown_timeout(Duration::from_millis(500));
        });
        let web = web.map_err(|e| machine(e.to_string()))?;
        let shared = hub.clone();
        let work = move || walk(&shared, config);
        let walk = std::thread::Builder::new().name("cairn-walk".into()).spawn(work);
        let walk = walk.map_err(|e| machine(e.to_string()))?;
        Ok(Self {
            invitation,
            address,
            certificate: der,
            not_kept,
            hub,
            stop: Some(stop),
            web: Some(web),
            walk: Some(walk),
        })
    }

    /// How to reach the page.
    pub fn invitation(&self) -> &Invitation {
        &self.invitation
    }

    /// The address it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The certificate, for clients that need a trust anchor.
    pub fn certificate(&self) -> &CertificateDer<'static> {
        &self.certificate
    }

    /// Why the certificate could not be kept, if it was to be.
    pub fn not_kept(&self) -> Option<&str> {
        self.not_kept.as_deref()
    }

    /// A handle that gives commands from outside the pages, such as from the terminal.
    pub fn remote(&self) -> Remote {
        Remote(self.hub.clone())
    }

    /// Waits until the session ends, by its source or by [`Command::Quit`], then stops serving.
    ///
    /// # Errors
    /// Why the source failed.
    pub fn wait(mut self) -> Result<(), SourceError> {
        let result = match self.walk.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            _ => Err(SourceError::new("the walk", "stopped by a program error", "start again")),
        };
        self.end();
        result
    }

    fn end(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ = stop.send(());
        }
        if let Some(web) = self.web.take() {
            let _ = web.join();
        }
    }
}

impl Drop for Server {
    /// Ends the session and the pages.
    fn drop(&mut self) {
        self.hub.shut_down();
        if let Some(walk) = self.walk.take() {
            let _ = walk.join();
        }
        self.end();
    }
}

/// Gives commands from outside the pages.
#[derive(Clone)]
pub struct Remote(Arc<Hub>);

impl Remote {
    /// Gives a command; [`Command::Quit`] ends the server.
    pub fn command(&self, command: Command) {
        match command {
            Command::Quit => self.0.shut_down(),
            command => self.0.inbox.command(command),
        }
    }
}

fn router(hub: Arc<Hub>) -> Router {
    const HTML: &str = "text/html; charset=utf-8";
    const SCRIPT: &str = "text/javascript; charset=utf-8";
    let file = |kind: &'static str, text: &'static str| get(async move || with_headers(kind, text));
    Router::new()
        .route("/", file(HTML, include_str!("page/index.html")))
        .route("/style.css", file("text/css; charset=utf-8", include_str!("page/style.css")))
        .route("/app.js", file(SCRIPT, include_str!("page/app.js")))
        .route("/camera.js", file(SCRIPT, include_str!("page/camera.js")))
        .route("/senses.js", file(SCRIPT, include_str!("page/senses.js")))
        .route("/view.js", file(SCRIPT, include_str!("page/view.js")))
        .route("/icon.svg", file("image/svg+xml", include_str!("page/icon.svg")))
        .route("/ws", get(socket))
        .with_state(hub)
}

/// Nothing is loaded from elsewhere, and no other page may frame this one.
fn with_headers(kind: &'static str, text: &'static str) -> Response {
    const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; \
                          connect-src 'self'; media-src 'self' blob: mediastream:; base-uri 'none'; \
                          form-action 'none'; frame-ancestors 'none'";
    let headers = [
        (header::CONTENT_TYPE, kind),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    (headers, text).into_response()
}

async fn socket(State(hub): State<Arc<Hub>>, upgrade: WebSocketUpgrade) -> Response {
    upgrade.max_message_size(LARGEST).max_frame_size(LARGEST).on_upgrade(move |socket| page(socket, hub))
}

/// One page, from its hello until it disconnects.
async fn page(mut socket: WebSocket, hub: Arc<Hub>) {
    let Ok(Some(walk)) = tokio::time::timeout(HELLO_WITHIN, hello(&mut socket, &hub)).await else {
        let text = ToPage::Trouble("The key is wrong. Open the page with the code on the terminal.").text();
        let _ = socket.send(Message::Text(text.into())).await;
        return;
    };
    let id = hub.number();
    let mut client = Client {
        id,
        messages: hub.messages.subscribe(),
        status: hub.status.subscribe(),
        view: hub.view.subscribe(),
        picture: hub.picture.subscribe(),
        wants: Wants { hub: hub.clone(), picture: false, map: false },
        hub: hub.clone(),
    };
    let hello = ToPage::Hello { id, version: env!("CARGO_PKG_VERSION"), camera: &hub.camera }.text();
    if socket.send(Message::Text(hello.into())).await.is_err() {
        return;
    }
    if walk {
        hub.take(id);
    } else {
        hub.broadcast(&ToPage::Control { id: hub.controller() });
    }
    client.status.mark_changed();
    client.converse(&mut socket).await;
    hub.release(id);
}

/// The first message; with the right token it says whether the page wants to control.
async fn hello(socket: &mut WebSocket, hub: &Hub) -> Option<bool> {
    let Some(Ok(Message::Text(text))) = socket.recv().await else { return None };
    match serde_json::from_str(&text) {
        Ok(FromPage::Hello { token, walk }) if same(&token, &hub.token) => Some(walk),
        _ => None,
    }
}

struct Client {
    id: u64,
    hub: Arc<Hub>,
    messages: broadcast::Receiver<Arc<str>>,
    status: watch::Receiver<Arc<str>>,
    view: watch::Receiver<Arc<str>>,
    picture: watch::Receiver<Shared>,
    wants: Wants,
}

/// What a page wants; counted as long as it is connected.
struct Wants {
    hub: Arc<Hub>,
    picture: bool,
    map: bool,
}

impl Wants {
    fn set(&mut self, picture: bool, map: bool) {
        let count = |counter: &AtomicU64, was: bool, is: bool| match (was, is) {
            (false, true) => drop(counter.fetch_add(1, Ordering::Relaxed)),
            (true, false) => drop(counter.fetch_sub(1, Ordering::Relaxed)),
            _ => {}
        };
        count(&self.hub.pictures_wanted, self.picture, picture);
        count(&self.hub.maps_wanted, self.map, map);
        (self.picture, self.map) = (picture, map);
    }
}

impl Drop for Wants {
    fn drop(&mut self) {
        self.set(false, false);
    }
}

impl Client {
    /// Sends what is new and handles what arrives, until the page disconnects.
    async fn converse(&mut self, socket: &mut WebSocket) {
        loop {
            let text = |t: &Arc<str>| Message::Text(t.as_ref().into());
            let out = tokio::select! {
                // Utterances before everything else.
                biased;
                told = self.messages.recv() => match told {
                    Ok(t) => Some(text(&t)),
                    Err(broadcast::error::RecvError::Lagged(_)) => None,
                    Err(broadcast::error::RecvError::Closed) => return,
                },
                came = socket.recv() => match came {
                    Some(Ok(message)) => self.take(message).map(|t| Message::Text(t.into())),
                    _ => return,
                },
                Ok(()) = self.status.changed() => Some(text(&self.status.borrow_and_update())),
                Ok(()) = self.view.changed(), if self.wants.map => Some(text(&self.view.borrow_and_update())),
                Ok(()) = self.picture.changed(), if self.wants.picture => {
                    let bytes: Shared = self.picture.borrow_and_update().clone();
                    Some(Message::Binary(axum::body::Bytes::from_owner(bytes)))
                }
            };
            let empty = |m: &Message| matches!(m, Message::Text(t) if t.is_empty());
            if let Some(out) = out.filter(|m| !empty(m))
                && socket.send(out).await.is_err()
            {
                return;
            }
        }
    }

    /// Handles a message; returns an answer for this page alone, if one is due.
    fn take(&mut self, message: Message) -> Option<String> {
        let controls = self.hub.controller() == Some(self.id);
        match message {
            Message::Binary(bytes) if controls => {
                if let Some((ms, jpeg)) = wire::picture(&bytes) {
                    self.hub.port.picture(ms, jpeg.to_vec());
                }
                None
            }
            Message::Text(text) => match serde_json::from_str(&text) {
                Ok(FromPage::Motion(samples)) if controls => {
                    self.hub.port.motion(samples.into_iter().map(wire::motion));
                    None
                }
                Ok(FromPage::Command(line)) if controls => self.command(&line).err().map(refusal),
                Ok(FromPage::Command(_)) => Some(refusal("Someone else controls this walk.".into())),
                Ok(FromPage::Want { picture, map }) => {
                    self.wants.set(picture, map);
                    self.view.mark_changed();
                    None
                }
                Ok(FromPage::Take(true)) => match self.hub.take(self.id) {
                    true => None,
                    false => Some(refusal("Someone else controls this walk.".into())),
                },
                _ => None,
            },
            _ => None,
        }
    }

    fn command(&self, line: &str) -> Result<(), String> {
        let command = Command::parse(line)?;
        match command {
            // Files are chosen at the terminal, and the server is ended there.
            Command::Quit | Command::Load(Some(_)) => Err("That can only be done at the terminal.".into()),
            _ if !self.hub.running.load(Ordering::Relaxed) => Err("There is no picture yet.".into()),
            _ => {
                self.hub.inbox.command(command);
                Ok(())
            }
        }
    }
}

fn refusal(text: String) -> String {
    ToPage::Did { ok: false, text: &text }.text()
}
