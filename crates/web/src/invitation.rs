//! How to reach the page: addresses with the token, and a QR code for the phone's camera.

use crate::authority::{Authority, is_local};
use crate::trust;
use cairn_phrases::Language;
use qrcode::{EcLevel, QrCode};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};

/// The page's addresses and its access token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Invitation {
    /// Addresses with the token, the best one first.
    pub urls: Vec<String>,
    /// The token.
    pub token: String,
}

impl Invitation {
    /// `name` stays when the address changes: the one to keep.
    pub(crate) fn new(bound: SocketAddr, lan: Option<IpAddr>, name: Option<&str>, token: &str) -> Self {
        let port = bound.port();
        let own = if bound.ip().is_unspecified() { Ipv4Addr::LOCALHOST.into() } else { bound.ip() };
        let at = |host: IpAddr| SocketAddr::new(host, port).to_string();
        let hosts = lan.map(at).into_iter().chain(name.map(|name| format!("{name}:{port}"))).chain([at(own)]);
        Self {
            urls: hosts.map(|host| format!("https://{host}/#k={token}")).collect(),
            token: token.to_owned(),
        }
    }

    /// The first address as a QR code.
    pub fn qr(&self) -> String {
        self.urls.first().map_or_else(String::new, |url| qr(url))
    }

    /// Where the authority's certificate is downloaded, without TLS: as a profile, and as it is.
    pub fn authority_urls(&self) -> [String; 2] {
        let first = self.urls.first().and_then(|url| url.strip_prefix("https://")?.split('/').next());
        [trust::PROFILE, trust::CERTIFICATE].map(|path| format!("http://{}{path}", first.unwrap_or_default()))
    }

    /// What to do on a phone so that it trusts the authority, as text.
    pub fn trust_steps(&self, authority: &Authority, language: Language) -> String {
        let mut text = trust::steps(authority, self.authority_urls(), language);
        let place = |url: &String| url.strip_prefix("https://")?.split('/').next()?.parse().ok();
        if !self.urls.iter().filter_map(place).all(|place: SocketAddr| is_local(place.ip())) {
            text += &format!("{}\n", language.text("page-trust-not-local"));
        }
        text
    }
}

/// An address as a QR code of half blocks, two modules to a character. It sets its own background, so it can be read on
/// dark and on light terminals.
pub fn qr(url: &str) -> String {
    let Ok(code) = QrCode::with_error_correction_level(url, EcLevel::L) else { return String::new() };
    let width = code.width() as i64;
    let colors = code.to_colors();
    const QUIET: i64 = 2;
    let dark = |x: i64, y: i64| {
        let inside = (0..width).contains(&x) && (0..width).contains(&y);
        inside && colors[(y * width + x) as usize] == qrcode::Color::Dark
    };
    let mut out = String::new();
    for y in (-QUIET..width + QUIET).step_by(2) {
        out.push_str("\x1b[30;107m");
        for x in -QUIET..width + QUIET {
            out.push(match (dark(x, y), dark(x, y + 1)) {
                (true, true) => '\u{2588}',
                (true, false) => '\u{2580}',
                (false, true) => '\u{2584}',
                (false, false) => ' ',
            });
        }
        out.push_str("\x1b[0m\n");
    }
    out
}

/// This machine's address in the local network, if it has one. No data is sent to determine it.
pub fn lan_address() -> Option<IpAddr> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    // An address of the documentation range: the system only selects the route to it.
    socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9)).ok()?;
    let address = socket.local_addr().ok()?.ip();
    (!address.is_loopback() && !address.is_unspecified()).then_some(address)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_the_token_and_the_code_is_drawn() {
        let a = "7".repeat(32);
        let bound = "0.0.0.0:8443".parse().unwrap();
        let invitation = Invitation::new(bound, Some("192.168.1.7".parse().unwrap()), Some("den.local"), &a);
        assert_eq!(invitation.urls[0], format!("https://192.168.1.7:8443/#k={a}"));
        assert_eq!(invitation.urls[1], format!("https://den.local:8443/#k={a}"));
        assert!(invitation.urls[2].starts_with("https://127.0.0.1:8443/#k="));
        let profile = "http://192.168.1.7:8443/authority.mobileconfig";
        assert_eq!(invitation.authority_urls()[0], profile);
        let qr = invitation.qr();
        assert!(qr.lines().count() > 12 && qr.contains('\u{2588}'));
    }
}
