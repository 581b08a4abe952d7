//! The TLS of a page: what the tests of the page, of requests and of networks have in common.

use cairn_web::Server;
use std::sync::Arc;

/// A TLS client that trusts only this server.
pub fn tls(server: &Server) -> Arc<rustls::ClientConfig> {
    let mut roots = rustls::RootCertStore::empty();
    roots.add(server.certificate().clone()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = rustls::ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
    Arc::new(builder.unwrap().with_root_certificates(roots).with_no_client_auth())
}
