//! The web socket of a page, as a browser opens it: TCP, TLS, and the request for a socket.

use rustls::pki_types::{InvalidDnsNameError, ServerName};
use std::io;
use std::sync::Arc;
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite;

/// The socket of a page.
pub type Socket = WebSocketStream<TlsStream<TcpStream>>;

/// Why a page cannot be reached.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The file with the certificate cannot be read.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: String,
        /// The system's error.
        source: io::Error,
    },
    /// A certificate is none.
    #[error("the certificate: {0}")]
    Certificate(rustls::Error),
    /// TLS cannot be set up.
    #[error(transparent)]
    Tls(#[from] rustls::Error),
    /// The host's name is none.
    #[error(transparent)]
    Name(#[from] InvalidDnsNameError),
    /// There is no connection.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The page gives no socket, or it failed at once.
    #[error("{0}")]
    Socket(Box<tungstenite::Error>),
}

impl From<tungstenite::Error> for ConnectError {
    fn from(e: tungstenite::Error) -> Self {
        Self::Socket(Box::new(e))
    }
}

/// TLS that trusts these certificates and no others.
///
/// # Errors
/// When one of them is none.
pub fn connector<'a>(
    trusted: impl IntoIterator<Item = rustls::pki_types::CertificateDer<'a>>,
) -> Result<TlsConnector, ConnectError> {
    let mut roots = rustls::RootCertStore::empty();
    for certificate in trusted {
        roots.add(certificate.into_owned()).map_err(ConnectError::Certificate)?;
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config =
        rustls::ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions()?;
    Ok(TlsConnector::from(Arc::new(config.with_root_certificates(roots).with_no_client_auth())))
}

/// Opens the socket of the page at a host and port; the certificate has to be of `name`.
///
/// # Errors
/// When there is no way to it.
pub async fn connect(tls: &TlsConnector, name: &str, host: &str, port: u16) -> Result<Socket, ConnectError> {
    let name = ServerName::try_from(name.to_owned())?;
    let stream = TcpStream::connect((host, port)).await?;
    stream.set_nodelay(true)?;
    let stream = tls.connect(name, stream).await?;
    Ok(tokio_tungstenite::client_async(format!("wss://localhost:{port}/ws"), stream).await?.0)
}
