//! The server: the page's files, and a web socket for each page.

use crate::authority::Authority;
use crate::certificate::Certificate;
use crate::config::{CameraSource, ServeConfig};
use crate::error::WebError;
use crate::hub::{Access, Hub};
use crate::invitation::{Invitation, lan_address};
use crate::local_name::local_name;
use crate::page::page;
use crate::pair_requests;
use crate::pairing::Pairing;
use crate::phones::Phones;
use crate::places::{Place, Places};
use crate::requests;
use crate::site;
use crate::survive;
use crate::tls::{Answers, accept};
use crate::token::{kept_token, new_token};
use crate::trust;
use crate::walk::walk;
use crate::words;
use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Extension, State};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use cairn_phrases::Language;
use cairn_sensor::SourceError;
use cairn_session::{Command, RoutesLock, SessionConfig};
use rustls::pki_types::CertificateDer;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio_rustls::TlsAcceptor;

/// The largest message of a page: an image.
const LARGEST: usize = 4 << 20;

/// A running server.
pub struct Server {
    invitation: Invitation,
    address: SocketAddr,
    certificate: CertificateDer<'static>,
    authority: Option<Authority>,
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
    /// When the port is in use, another program keeps its routes in the same folder, or the system provides no thread or random number.
    pub fn start(config: ServeConfig) -> Result<Self, WebError> {
        let host: IpAddr = if config.lan { Ipv4Addr::UNSPECIFIED.into() } else { Ipv4Addr::LOCALHOST.into() };
        let listener = std::net::TcpListener::bind((host, config.port))
            .and_then(|l| l.set_nonblocking(true).map(|()| l))
            .map_err(|source| WebError::Port { port: config.port, source })?;
        let routes = config.routes.as_deref().map(RoutesLock::take).transpose()?;
        let address = listener.local_addr().map_err(WebError::machine)?;
        let lan = if config.lan { lan_address() } else { None };
        let mut addresses: Vec<IpAddr> = lan.into_iter().collect();
        addresses.push(Ipv4Addr::LOCALHOST.into());
        let local = lan.and_then(local_name);
        let names: Vec<String> = local.iter().cloned().chain(["localhost".to_owned()]).collect();
        let (authority, certificate, not_kept) = match (config.authority, &config.keep) {
            (true, keep) => {
                let made =
                    keep.as_deref().map_or_else(|| Authority::new().map(|a| (a, None)), Authority::kept);
                let (authority, not_kept) = made?;
                let certificate = authority.sign(&addresses, &names)?;
                (Some(authority), certificate, not_kept)
            }
            (false, Some(folder)) => {
                let (certificate, not_kept) = Certificate::kept(folder, &addresses, &names)?;
                (None, certificate, not_kept)
            }
            (false, None) => (None, Certificate::new(&addresses, &names)?, None),
        };
        let der = authority.as_ref().map_or_else(|| certificate.der(), |a| a.der().clone());
        let files = authority.as_ref().map_or_else(Vec::new, |a| trust::files(a).into());
        let tls = certificate.into_server()?;
        let (token, lost_key) = match (&config.token, &config.keep) {
            (Some(token), _) => (token.clone(), None),
            (None, Some(folder)) => kept_token(folder, config.new_key)?,
            (None, None) => (new_token()?, None),
        };
        let not_kept = not_kept.or(lost_key);
        let invitation = Invitation::new(address, lan, local.as_deref(), &token);
        let camera = match &config.camera {
            CameraSource::Page { .. } => String::new(),
            CameraSource::Source { name, .. } => name.clone(),
        };
        let access = Access {
            token,
            pairing: Pairing::default(),
            phones: Phones::of(config.keep.as_deref()),
            tell: config.tell.clone(),
            aloud: config.aloud.clone(),
        };
        let hub = Arc::new(Hub::new(access, camera));
        if let Some(holder) = config.survives.as_deref().and_then(|path| survive::read(path).holder) {
            hub.held_by(holder);
        }
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_name("cairn-page")
            .enable_all()
            .build()
            .map_err(WebError::machine)?;
        hub.pulse.beat_on(runtime.handle());
        let (stop, stopped) = oneshot::channel();
        let router = router(hub.clone(), &config.session, authority.as_ref());
        let answers = Answers { tls: TlsAcceptor::from(Arc::new(tls)), files: files.into(), router };
        let (places, tell) = (Places::new(config.connections), config.tell.clone());
        let web = std::thread::Builder::new().name("cairn-web".into()).spawn(move || {
            let serve = async {
                match TcpListener::from_std(listener) {
                    Ok(listener) => accept(listener, places, answers, &*tell).await,
                    Err(e) => tell(&format!("the page is not served: {e}")),
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
        let web = web.map_err(WebError::machine)?;
        let shared = hub.clone();
        let work = move || walk(&shared, config, routes);
        let walk = std::thread::Builder::new().name("cairn-walk".into()).spawn(work);
        let walk = walk.map_err(WebError::machine)?;
        Ok(Self {
            invitation,
            address,
            certificate: der,
            authority,
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

    /// The trust anchor for clients: the authority's certificate, else the page's own.
    pub fn certificate(&self) -> &CertificateDer<'static> {
        &self.certificate
    }

    /// The authority that signed the page's certificate, where one was asked for.
    pub fn authority(&self) -> Option<&Authority> {
        self.authority.as_ref()
    }

    /// Why the certificate or the access token could not be stored, if that was requested.
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

    /// How many steps the session has taken; `None` while it does not run. One that runs takes twenty a second and more.
    pub fn steps(&self) -> Option<u64> {
        self.0.running.load(Ordering::Relaxed).then(|| self.0.steps.load(Ordering::Relaxed))
    }

    /// How many turns the threads that serve the pages have taken: ten a second, none while they hang.
    pub fn turns(&self) -> u64 {
        self.0.pulse.turns()
    }
}

fn router(hub: Arc<Hub>, session: &SessionConfig, authority: Option<&Authority>) -> Router {
    let documents = Language::ALL.map(|l| words::document(site::DOCUMENT, l));
    // A language that was chosen for the session, else the one that the browser prefers.
    let chosen = Some(session.phrases.language).filter(|l| *l != Language::default());
    let document = move |headers: HeaderMap| {
        let accepted = headers.get(header::ACCEPT_LANGUAGE).and_then(|v| v.to_str().ok()).unwrap_or_default();
        let language = chosen.unwrap_or_else(|| Language::preferred(accepted));
        std::future::ready(with_headers(site::HTML, documents[language as usize].clone()))
    };
    let mut router = Router::new();
    for language in Language::ALL {
        let catalogue = words::catalogue(language, session, authority);
        let answer = move || std::future::ready(with_headers(site::JSON, catalogue.clone()));
        router = router.route(&format!("/words/{language}.json"), get(answer));
    }
    for (path, kind, bytes) in authority.iter().flat_map(|a| trust::files(a)) {
        router = router.route(path, get(async move || with_headers(kind, bytes.clone())));
    }
    for (path, text) in site::FILES {
        router = router.route(&format!("/{path}"), get(async move || with_headers(site::kind(path), text)));
    }
    router
        .route("/", get(document))
        .route("/ws", get(socket))
        .merge(requests::routes(LARGEST))
        .merge(pair_requests::routes())
        .with_state(hub)
}

/// Nothing is loaded from other hosts, and no other page may frame this one.
fn with_headers(kind: &'static str, body: impl IntoResponse) -> Response {
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
    (headers, body).into_response()
}

async fn socket(
    State(hub): State<Arc<Hub>>,
    Extension(place): Extension<Arc<Place>>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let upgrade = upgrade.max_message_size(LARGEST).max_frame_size(LARGEST);
    upgrade.on_upgrade(move |socket| page(socket, hub, place))
}
