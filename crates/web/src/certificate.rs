//! A certificate that the page's server signs itself: phones give camera and motion only to pages over HTTPS.

use rcgen::{CertificateParams, DistinguishedName, DnType, KeyPair, SanType};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};
use std::net::IpAddr;

/// A fresh key with its certificate.
pub struct Certificate {
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
}

impl Certificate {
    /// For these addresses and names, valid for a long time: it is made anew at every start.
    ///
    /// # Errors
    /// When the key or the certificate can not be made, in the words of the library.
    pub fn new(addresses: &[IpAddr], names: &[String]) -> Result<Self, String> {
        let text = |e: rcgen::Error| e.to_string();
        let mut params = CertificateParams::new(names.to_vec()).map_err(text)?;
        params.subject_alt_names.extend(addresses.iter().map(|a| SanType::IpAddress(*a)));
        let mut subject = DistinguishedName::new();
        subject.push(DnType::CommonName, "Cairn on this machine");
        params.distinguished_name = subject;
        let key = KeyPair::generate().map_err(text)?;
        let certificate = params.self_signed(&key).map_err(text)?;
        Ok(Self {
            chain: vec![certificate.der().clone()],
            key: PrivateKeyDer::Pkcs8(PrivatePkcs8KeyDer::from(key.serialize_der())),
        })
    }

    /// The certificate as it is sent, for clients that are told whom to trust.
    pub fn der(&self) -> CertificateDer<'static> {
        self.chain[0].clone()
    }

    /// What a TLS server goes by.
    pub(crate) fn into_server(self) -> Result<rustls::ServerConfig, String> {
        let provider = std::sync::Arc::new(rustls::crypto::ring::default_provider());
        let mut config = rustls::ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(|e| e.to_string())?
            .with_no_client_auth()
            .with_single_cert(self.chain, self.key)
            .map_err(|e| e.to_string())?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(config)
    }
}
