//! A self-signed certificate for the page's server: phones give camera and motion only to pages over HTTPS.
//!
//! It is stored with its key in one PEM file, readable by its owner alone, so that a phone asks only once. The first
//! line lists the addresses and names it covers; when another is needed, a new certificate replaces it.

use crate::error::WebError;
use rcgen::{CertificateParams, DistinguishedName, DnType, KeyPair, SanType};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};
use std::io::Write;
use std::net::IpAddr;
use std::path::Path;

/// The name of the file.
pub(crate) const FILE: &str = "page.pem";
/// The beginning of the first line.
const COVERS: &str = "for ";
/// How many addresses of earlier starts stay covered.
const EARLIER: usize = 12;

/// A key with its certificate.
pub struct Certificate {
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
}

impl Certificate {
    /// The certificate stored in a folder, when it covers all of these addresses and names; else a new one, which is
    /// stored there. Also returns why it could not be stored, if so.
    ///
    /// # Errors
    /// [`WebError::Machine`] with the library's message, when the key or the certificate cannot be made.
    pub fn kept(
        folder: &Path,
        addresses: &[IpAddr],
        names: &[String],
    ) -> Result<(Self, Option<String>), WebError> {
        let path = folder.join(FILE);
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let listed = text.lines().next().and_then(|line| line.strip_prefix(COVERS)).unwrap_or_default();
        let before: Vec<&str> = listed.split_whitespace().collect();
        let stands_for = |name: &String| before.contains(&name.as_str());
        if addresses.iter().map(IpAddr::to_string).all(|a| stands_for(&a))
            && names.iter().all(stands_for)
            && let Some(kept) = Self::read(&text)
        {
            return Ok((kept, None));
        }
        // A phone may come back to an earlier network.
        let earlier = before.iter().filter_map(|a| a.parse().ok()).filter(|a| !addresses.contains(a));
        let all: Vec<IpAddr> = addresses.iter().copied().chain(earlier.take(EARLIER)).collect();
        let (new, pem) = Self::made(&all, names)?;
        let listed: Vec<String> = all.iter().map(IpAddr::to_string).chain(names.iter().cloned()).collect();
        let text = format!("{COVERS}{}\n{pem}", listed.join(" "));
        let written = std::fs::create_dir_all(folder).and_then(|()| write_private(&path, &text));
        Ok((new, written.err().map(|e| format!("{}: {e}", path.display()))))
    }

    fn read(text: &str) -> Option<Self> {
        let certificate = CertificateDer::from_pem_slice(text.as_bytes()).ok()?;
        let key = PrivateKeyDer::from_pem_slice(text.as_bytes()).ok()?;
        let whole = Self { chain: vec![certificate], key };
        // A key that does not match the certificate is detected here and not on the phone.
        let copy = Self { chain: whole.chain.clone(), key: whole.key.clone_key() };
        copy.into_server().is_ok().then_some(whole)
    }

    /// A new certificate for these addresses and names, valid for a long time.
    ///
    /// # Errors
    /// [`WebError::Machine`] with the library's message, when the key or the certificate cannot be made.
    pub fn new(addresses: &[IpAddr], names: &[String]) -> Result<Self, WebError> {
        Self::made(addresses, names).map(|(new, _)| new)
    }

    /// Likewise, with its PEM text.
    fn made(addresses: &[IpAddr], names: &[String]) -> Result<(Self, String), WebError> {
        let text = WebError::machine::<rcgen::Error>;
        let mut params = CertificateParams::new(names.to_vec()).map_err(text)?;
        params.subject_alt_names.extend(addresses.iter().map(|a| SanType::IpAddress(*a)));
        let mut subject = DistinguishedName::new();
        subject.push(DnType::CommonName, "Cairn on this machine");
        params.distinguished_name = subject;
        let key = KeyPair::generate().map_err(text)?;
        let certificate = params.self_signed(&key).map_err(text)?;
        let pem = certificate.pem() + &key.serialize_pem();
        Ok((Self::of(&certificate, &key), pem))
    }

    /// A certificate that an authority has made, with its key.
    pub(crate) fn of(certificate: &rcgen::Certificate, key: &KeyPair) -> Self {
        Self {
            chain: vec![certificate.der().clone()],
            key: PrivateKeyDer::Pkcs8(PrivatePkcs8KeyDer::from(key.serialize_der())),
        }
    }

    /// The certificate as it is sent, for clients that need a trust anchor.
    pub fn der(&self) -> CertificateDer<'static> {
        self.chain[0].clone()
    }

    /// The config of a TLS server.
    pub(crate) fn into_server(self) -> Result<rustls::ServerConfig, WebError> {
        let provider = std::sync::Arc::new(rustls::crypto::ring::default_provider());
        let mut config = rustls::ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(WebError::machine)?
            .with_no_client_auth()
            .with_single_cert(self.chain, self.key)
            .map_err(WebError::machine)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(config)
    }
}

/// Writes a file completely or not at all, readable by its owner alone.
pub(crate) fn write_private(path: &Path, text: &str) -> std::io::Result<()> {
    let part = path.with_extension(format!("part-{}", std::process::id()));
    let mut options = std::fs::File::options();
    options.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let written = options.open(&part).and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()
    });
    written.and_then(|()| std::fs::rename(&part, path)).inspect_err(|_| {
        let _ = std::fs::remove_file(&part);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn certificate_is_kept_until_a_new_address_needs_another() {
        let folder = std::env::temp_dir().join(format!("cairn-certificate-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let (home, hall): (IpAddr, IpAddr) = ([192, 168, 1, 7].into(), [10, 0, 0, 3].into());
        let names = ["localhost".to_owned()];
        let kept = |addresses: &[IpAddr]| Certificate::kept(&folder, addresses, &names).unwrap();
        let (first, trouble) = kept(&[home]);
        assert_eq!(trouble, None);
        assert_eq!(kept(&[home]).0.der(), first.der());
        let both = kept(&[hall]).0.der();
        assert_ne!(both, first.der());
        assert_eq!(kept(&[home]).0.der(), both, "back in the earlier network");
        #[cfg(unix)]
        {
            let mode = std::fs::metadata(folder.join(FILE)).unwrap();
            assert_eq!(std::os::unix::fs::PermissionsExt::mode(&mode.permissions()) & 0o077, 0);
        }
        // A damaged file, or one with another key, is replaced.
        let text = std::fs::read_to_string(folder.join(FILE)).unwrap();
        std::fs::write(folder.join(FILE), &text[..text.len() / 2]).unwrap();
        let third = kept(&[home]).0.der();
        assert_ne!(third, both);
        let own = std::fs::read_to_string(folder.join(FILE)).unwrap();
        let (before, _) = own.split_once("-----BEGIN PRIVATE KEY").unwrap();
        let (_, other) = text.split_once("-----BEGIN PRIVATE KEY").unwrap();
        std::fs::write(folder.join(FILE), format!("{before}-----BEGIN PRIVATE KEY{other}")).unwrap();
        assert_ne!(kept(&[home]).0.der(), third);
        std::fs::remove_dir_all(&folder).unwrap();
        // Where it cannot be stored, a certificate is returned all the same, with the reason.
        std::fs::write(&folder, "a file, not a folder").unwrap();
        assert!(kept(&[home]).1.unwrap().contains("page.pem"));
        std::fs::remove_file(&folder).unwrap();
    }
}
