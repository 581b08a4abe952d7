//! A small certificate authority of this machine (RFC 5280), for phones that refuse web sockets to a server whose
//! certificate they do not trust. Once a phone trusts it, it trusts every certificate that the page gets from it.
//!
//! It is stored with its key in one PEM file, readable by its owner alone; the first line has its id. Whoever had the key
//! could not use it for other sites: the authority is constrained to the addresses of local networks and to this machine's
//! names. Its certificates are made at each start and not stored.

use crate::certificate::{Certificate, write_private};
use crate::error::WebError;
use crate::token::new_token;
use rcgen::{
    BasicConstraints, CertificateParams, CidrSubnet, DistinguishedName, DnType, ExtendedKeyUsagePurpose,
    GeneralSubtree, IsCa, Issuer, KeyPair, KeyUsagePurpose, NameConstraints, PublicKeyData, SanType,
};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use std::net::IpAddr;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The name of the file.
const FILE: &str = "authority.pem";
/// The beginning of the first line; the id and the second of its beginning follow.
const FIRST: &str = "authority ";
const DAY: Duration = Duration::from_secs(86_400);
/// How long a certificate of the page is valid, days: browsers accept no more than 398.
const LEAF_DAYS: u32 = 398;
/// How long the authority is valid, days, and after which another replaces it.
const AUTHORITY_DAYS: u32 = 3650;
const REPLACED_DAYS: u32 = AUTHORITY_DAYS - LEAF_DAYS - 2;
/// Networks that no other machine of the internet is in: RFC 1918, 6598, 3927, 1122, 4193, 4291.
const LOCAL: [(&str, u8); 9] = [
    ("10.0.0.0", 8),
    ("172.16.0.0", 12),
    ("192.168.0.0", 16),
    ("100.64.0.0", 10),
    ("169.254.0.0", 16),
    ("127.0.0.0", 8),
    ("fc00::", 7),
    ("fe80::", 10),
    ("::1", 128),
];
/// Names under which only this machine or one in the local network is found.
const NAMES: [&str; 2] = ["localhost", "local"];

/// The authority.
pub struct Authority {
    id: String,
    began: Duration,
    pem: String,
    der: CertificateDer<'static>,
    key: KeyPair,
}

/// The certificates by which a page that keeps its own in this folder can be known: that of the page, and that of the authority.
pub fn trusted(folder: &Path) -> Vec<CertificateDer<'static>> {
    let read = |file: &str| {
        let text = std::fs::read(folder.join(file)).ok()?;
        CertificateDer::from_pem_slice(&text).ok()
    };
    [crate::certificate::FILE, FILE].into_iter().filter_map(read).collect()
}

impl Authority {
    /// The authority stored in a folder, or a new one, which is stored there. Also returns why it could not be stored, if so.
    ///
    /// # Errors
    /// [`WebError::Machine`] with the library's message, when it cannot be made.
    pub fn kept(folder: &Path) -> Result<(Self, Option<String>), WebError> {
        let path = folder.join(FILE);
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let age = |kept: &Self| since_1970().checked_sub(kept.began);
        if let Some(kept) = Self::read(&text)
            && age(&kept).is_some_and(|age| age < REPLACED_DAYS * DAY)
        {
            return Ok((kept, None));
        }
        let new = Self::new()?;
        let (id, began) = (&new.id, new.began.as_secs());
        let text = format!("{FIRST}{id} {began}\n{}{}", new.pem, new.key.serialize_pem());
        let written = std::fs::create_dir_all(folder).and_then(|()| write_private(&path, &text));
        Ok((new, written.err().map(|e| format!("{}: {e}", path.display()))))
    }

    fn read(text: &str) -> Option<Self> {
        let (first, rest) = text.split_once('\n')?;
        let (id, began) = first.strip_prefix(FIRST)?.split_once(' ')?;
        let (pem, key) = rest.split_at(rest.find("-----BEGIN PRIVATE KEY")?);
        let key = KeyPair::from_pem(key).ok()?;
        let der = CertificateDer::from_pem_slice(pem.as_bytes()).ok()?;
        // A damaged file, or a certificate of another key, is detected here and not on the phone.
        let public = key.subject_public_key_info();
        let belongs = der.windows(public.len()).any(|part| part == public);
        let began = Duration::from_secs(began.parse().ok()?);
        let is_id = id.len() == 32 && id.bytes().all(|b| b.is_ascii_hexdigit());
        (belongs && is_id).then(|| Self { id: id.to_owned(), began, pem: pem.to_owned(), der, key })
    }

    /// A new authority.
    ///
    /// # Errors
    /// [`WebError::Machine`] with the library's message, when it cannot be made.
    pub fn new() -> Result<Self, WebError> {
        let (id, began) = (new_token()?, since_1970());
        let key = KeyPair::generate().map_err(WebError::machine)?;
        let certificate = params(&id, began)?.self_signed(&key).map_err(WebError::machine)?;
        Ok(Self { id, began, pem: certificate.pem(), der: certificate.der().clone(), key })
    }

    /// A certificate for these addresses and names, as far as they are local; phones reject one for others whole.
    ///
    /// # Errors
    /// [`WebError::Machine`] with the library's message, when it cannot be made.
    pub fn sign(&self, addresses: &[IpAddr], names: &[String]) -> Result<Certificate, WebError> {
        let local: Vec<IpAddr> = addresses.iter().copied().filter(|a| is_local(*a)).collect();
        self.signed(&local, names)
    }

    fn signed(&self, addresses: &[IpAddr], names: &[String]) -> Result<Certificate, WebError> {
        let text = WebError::machine::<rcgen::Error>;
        let mut leaf = CertificateParams::new(names.to_vec()).map_err(text)?;
        leaf.subject_alt_names.extend(addresses.iter().map(|a| SanType::IpAddress(*a)));
        leaf.distinguished_name = named("Cairn on this machine");
        // The clock of a phone may be behind by a day.
        set_validity(&mut leaf, since_1970().saturating_sub(DAY), LEAF_DAYS);
        leaf.is_ca = IsCa::ExplicitNoCa;
        leaf.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        leaf.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
        leaf.use_authority_key_identifier_extension = true;
        let key = KeyPair::generate().map_err(text)?;
        let own = params(&self.id, self.began)?;
        let signed = leaf.signed_by(&key, &Issuer::from_params(&own, &self.key)).map_err(text)?;
        Ok(Certificate::of(&signed, &key))
    }

    /// The name that the phone shows.
    pub fn name(&self) -> String {
        name_of(&self.id)
    }

    /// Its certificate, which phones are to trust.
    pub fn der(&self) -> &CertificateDer<'static> {
        &self.der
    }

    /// SHA-256 of the certificate, by which a person compares what the phone got with what the terminal shows.
    pub fn fingerprint(&self) -> String {
        let digest = ring::digest::digest(&ring::digest::SHA256, &self.der);
        digest.as_ref().iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(":")
    }

    /// The certificate as a configuration profile of Apple's devices.
    pub fn profile(&self) -> String {
        let base64: String = self.pem.lines().filter(|line| !line.starts_with("-----")).collect();
        let (id, name) = (&self.id, self.name());
        // Two names by RFC 9562 out of the id: the same profile replaces itself.
        let uuid = |last: &str| {
            let part = |from: usize, to: usize| id[from..to].to_uppercase();
            format!(
                "{}-{}-4{}-8{}-{}{last}",
                part(0, 8),
                part(8, 12),
                part(13, 16),
                part(17, 20),
                part(20, 31)
            )
        };
        let entry = |key: &str, value: &str| format!("<key>{key}</key><string>{value}</string>\n");
        let payload = |kind: &str, identifier: &str, uuid: &str| {
            entry("PayloadType", kind)
                + &entry("PayloadIdentifier", identifier)
                + &entry("PayloadUUID", uuid)
                + &entry("PayloadDisplayName", &name)
                + "<key>PayloadVersion</key><integer>1</integer>\n"
        };
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
             <!DOCTYPE plist PUBLIC \"-//Apple//DTD PLIST 1.0//EN\" \"http://www.apple.com/DTDs/PropertyList-1.0.dtd\">\n\
             <plist version=\"1.0\"><dict>\n{}<key>PayloadContent</key><array><dict>\n{}{}\
             <key>PayloadContent</key><data>{base64}</data>\n</dict></array>\n</dict></plist>\n",
            payload("Configuration", &format!("cairn.{id}"), &uuid("0")),
            payload("com.apple.security.root", &format!("cairn.{id}.certificate"), &uuid("1")),
            entry("PayloadCertificateFileName", "cairn.crt"),
        )
    }
}

/// What the authority's certificate says; the same each time for an id and a beginning.
fn params(id: &str, began: Duration) -> Result<CertificateParams, WebError> {
    let mut own = CertificateParams::new(Vec::new()).map_err(WebError::machine)?;
    own.distinguished_name = named(&name_of(id));
    set_validity(&mut own, began.saturating_sub(DAY), AUTHORITY_DAYS);
    // It signs certificates, none of which may sign others.
    own.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    own.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let networks = LOCAL.iter().filter_map(|(a, bits)| Some((a.parse().ok()?, *bits)));
    let networks = networks.map(|(a, bits)| GeneralSubtree::IpAddress(CidrSubnet::from_addr_prefix(a, bits)));
    let names = NAMES.map(|name| GeneralSubtree::DnsName(name.into()));
    let permitted_subtrees = names.into_iter().chain(networks).collect();
    own.name_constraints = Some(NameConstraints { permitted_subtrees, excluded_subtrees: Vec::new() });
    Ok(own)
}

/// Whether an address is one of a local network.
pub(crate) fn is_local(address: IpAddr) -> bool {
    let bits = |a: IpAddr| match a {
        IpAddr::V4(a) => (u128::from(a.to_bits()) << 96, true),
        IpAddr::V6(a) => (a.to_bits(), false),
    };
    let (wanted, is_v4) = bits(address);
    LOCAL.iter().filter_map(|(a, n)| Some((bits(a.parse().ok()?), u32::from(*n)))).any(
        |((network, v4), prefix)| {
            v4 == is_v4 && (network ^ wanted).checked_shr(128 - prefix).unwrap_or(0) == 0
        },
    )
}

fn name_of(id: &str) -> String {
    format!("Cairn {}", id.get(..8).unwrap_or(id))
}

fn named(name: &str) -> DistinguishedName {
    let mut subject = DistinguishedName::new();
    subject.push(DnType::CommonName, name);
    subject
}

fn since_1970() -> Duration {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Duration::from_secs(now.as_secs())
}

fn set_validity(params: &mut CertificateParams, since_1970: Duration, days: u32) {
    params.not_before = rcgen::date_time_ymd(1970, 1, 1) + since_1970;
    // The last second counts too.
    params.not_after = params.not_before + days * DAY - Duration::from_secs(1);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustls::client::WebPkiServerVerifier;
    use rustls::pki_types::{ServerName, UnixTime};
    use std::sync::Arc;

    /// What a phone that trusts the authority says of a certificate, this many days from now.
    fn judged(authority: &Authority, certificate: &Certificate, name: &str, days: u32) -> Result<(), String> {
        let mut roots = rustls::RootCertStore::empty();
        roots.add(authority.der().clone()).unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let verifier =
            WebPkiServerVerifier::builder_with_provider(Arc::new(roots), provider).build().unwrap();
        let verifier: &dyn rustls::client::danger::ServerCertVerifier = &*verifier;
        let name = ServerName::try_from(name.to_owned()).unwrap();
        let now = UnixTime::since_unix_epoch(since_1970() + days * DAY);
        let judged = verifier.verify_server_cert(&certificate.der(), &[], &name, &[], now);
        judged.map(drop).map_err(|e| e.to_string())
    }

    #[test]
    fn phone_that_trusts_the_authority_trusts_the_page_and_nothing_else_from_it() {
        let authority = Authority::new().unwrap();
        let names = ["localhost".to_owned()];
        let (home, v6): (IpAddr, IpAddr) = ([192, 168, 1, 7].into(), "fd00::7".parse().unwrap());
        let page = authority.sign(&[home, v6, [8, 8, 8, 8].into()], &names).unwrap();
        for name in ["192.168.1.7", "fd00::7", "localhost"] {
            assert_eq!(judged(&authority, &page, name, 0), Ok(()), "{name}");
        }
        assert_eq!(judged(&authority, &page, "localhost", LEAF_DAYS - 2), Ok(()));
        let later = judged(&authority, &page, "localhost", LEAF_DAYS).unwrap_err();
        assert!(later.contains("expired"), "{later}");
        assert!(judged(&authority, &page, "8.8.8.8", 0).is_err(), "it is not local, and not in it");
        assert!(judged(&Authority::new().unwrap(), &page, "localhost", 0).is_err(), "another authority");
        // With its key somebody makes a certificate for another site: the phone rejects it by the constraints.
        for (addresses, names, name) in [
            (vec![[8, 8, 8, 8].into()], vec![], "8.8.8.8"),
            (vec![], vec!["example.org".to_owned()], "example.org"),
        ] {
            let forged = authority.signed(&addresses, &names).unwrap();
            let why = judged(&authority, &forged, name, 0).unwrap_err();
            assert!(why.contains("NameConstraint"), "{name}: {why}");
        }
    }

    #[test]
    fn authority_is_kept_and_a_damaged_one_replaced() {
        let folder = std::env::temp_dir().join(format!("cairn-authority-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let (first, trouble) = Authority::kept(&folder).unwrap();
        assert_eq!(trouble, None);
        let again = Authority::kept(&folder).unwrap().0;
        assert_eq!((again.der(), again.fingerprint()), (first.der(), first.fingerprint()));
        // What it signs after it was read is trusted by whoever trusts it.
        let page = again.sign(&[], &["localhost".to_owned()]).unwrap();
        assert_eq!(judged(&first, &page, "localhost", 0), Ok(()));
        let path = folder.join(FILE);
        #[cfg(unix)]
        {
            let mode = std::fs::metadata(&path).unwrap();
            assert_eq!(std::os::unix::fs::PermissionsExt::mode(&mode.permissions()) & 0o077, 0);
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let other = Authority::new().unwrap();
        let (own, _) = text.split_once("-----BEGIN PRIVATE KEY").unwrap();
        let old = text.replacen(&first.began.as_secs().to_string(), "1000000000", 1);
        for wrong in [text[..text.len() / 2].to_owned(), own.to_owned() + &other.key.serialize_pem(), old] {
            std::fs::write(&path, wrong).unwrap();
            assert_ne!(Authority::kept(&folder).unwrap().0.der(), first.der());
        }
        std::fs::remove_dir_all(&folder).unwrap();
        std::fs::write(&folder, "a file, not a folder").unwrap();
        assert!(Authority::kept(&folder).unwrap().1.unwrap().contains(FILE));
        std::fs::remove_file(&folder).unwrap();
    }

    #[test]
    fn profile_has_the_certificate_and_lasting_names() {
        let authority = Authority::new().unwrap();
        let profile = authority.profile();
        let data = profile.split("<data>").nth(1).unwrap().split("</data>").next().unwrap();
        let pem = format!("-----BEGIN CERTIFICATE-----\n{data}\n-----END CERTIFICATE-----\n");
        assert_eq!(CertificateDer::from_pem_slice(pem.as_bytes()).unwrap(), *authority.der());
        assert!(profile.contains("com.apple.security.root") && profile == authority.profile());
        let uuids: Vec<&str> =
            profile.split("<key>PayloadUUID</key><string>").skip(1).map(|p| &p[..36]).collect();
        assert!(uuids.len() == 2 && uuids[0] != uuids[1], "{uuids:?}");
        for uuid in uuids {
            let lengths: Vec<usize> = uuid.split('-').map(str::len).collect();
            assert_eq!(lengths, [8, 4, 4, 4, 12], "{uuid}");
        }
    }

    #[test]
    fn local_addresses_are_told_from_others() {
        for local in ["10.1.2.3", "172.31.0.1", "192.168.1.7", "127.0.0.1", "100.64.0.1", "::1", "fe80::1"] {
            assert!(is_local(local.parse().unwrap()), "{local}");
        }
        for other in ["8.8.8.8", "172.32.0.1", "192.169.0.1", "2001:db8::1", "::2", "a00::1"] {
            assert!(!is_local(other.parse().unwrap()), "{other}");
        }
    }
}
