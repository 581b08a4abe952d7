//! What a phone downloads to trust the page's authority: its certificate, and the same as a profile of Apple's devices.
//! Also given without TLS, as a phone that does not trust the page yet may not open it otherwise; a person compares the
//! fingerprint with that on the terminal.

use crate::authority::Authority;
use cairn_phrases::{Arg, Language};

/// The paths of the two files.
pub(crate) const PROFILE: &str = "/authority.mobileconfig";
pub(crate) const CERTIFICATE: &str = "/authority.crt";

/// A file as it is sent: its path, its kind, its bytes.
pub(crate) type File = (&'static str, &'static str, Vec<u8>);

/// The files of an authority.
pub(crate) fn files(authority: &Authority) -> [File; 2] {
    [
        (PROFILE, "application/x-apple-aspen-config", authority.profile().into_bytes()),
        (CERTIFICATE, "application/x-x509-ca-cert", authority.der().to_vec()),
    ]
}

/// What to do on a phone, with the addresses of the two files and the fingerprint.
pub(crate) fn steps(
    authority: &Authority,
    [profile, certificate]: [String; 2],
    language: Language,
) -> String {
    let (name, fingerprint) = (authority.name(), authority.fingerprint());
    let says = |id: &str| {
        let args = [("name", Arg::Text(&name)), ("fingerprint", Arg::Text(&fingerprint))];
        format!("{}\n", language.say(id, &args))
    };
    let list = |title: &str, url: &str, steps: &[&str]| {
        let lines: String = (1..).zip(steps).map(|(n, id)| format!("  {n}. {}", says(id))).collect();
        format!("{}  {url}\n{lines}", says(title))
    };
    let ios = ["page-trust-ios-get", "page-trust-ios-install", "page-trust-ios-on", "page-trust-open"];
    let android = ["page-trust-android-get", "page-trust-android-install", "page-trust-open"];
    says("page-trust-why")
        + &list("page-trust-ios", &profile, &ios)
        + &list("page-trust-android", &certificate, &android)
        + &says("page-trust-compare")
}

/// The answer to a request without TLS; all but these files are given over HTTPS only.
pub(crate) fn answer(request: &[u8], files: &[File]) -> Vec<u8> {
    const ELSE: &[u8] = b"This page is given over HTTPS: write https:// before it.\n";
    let line = request.split(|b| *b == b'\r').next().unwrap_or_default();
    let asked = line.strip_prefix(b"GET ").and_then(|rest| rest.split(|b| *b == b' ').next());
    let found = files.iter().find(|(path, ..)| asked == Some(path.as_bytes()));
    let (status, kind, body) = match found {
        Some((_, kind, body)) => ("200 OK", *kind, body.as_slice()),
        None => ("400 Bad Request", "text/plain", ELSE),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nX-Content-Type-Options: nosniff\r\n\
         Cache-Control: no-store\r\nConnection: close\r\n\r\n",
        body.len()
    );
    [head.as_bytes(), body].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_name_the_files_the_authority_and_its_fingerprint() {
        let authority = Authority::new().unwrap();
        for language in Language::ALL {
            let text = steps(&authority, ["http://a".into(), "http://b".into()], language);
            assert!(text.contains("http://a\n  1. ") && text.contains("http://b\n  1. "), "{text}");
            assert!(text.contains(&authority.name()) && text.contains(&authority.fingerprint()), "{text}");
        }
    }

    #[test]
    fn only_the_files_are_given_without_tls() {
        let files = files(&Authority::new().unwrap());
        let text = |request: &[u8]| String::from_utf8_lossy(&answer(request, &files)).into_owned();
        let profile = text(b"GET /authority.mobileconfig HTTP/1.1\r\nHost: x\r\n\r\n");
        assert!(profile.starts_with("HTTP/1.1 200 OK\r\nContent-Type: application/x-apple-aspen-config\r\n"));
        assert!(profile.ends_with("</plist>\n"), "{profile}");
        assert!(text(b"GET /authority.crt HTTP/1.0\r\n\r\n").contains("application/x-x509-ca-cert"));
        for other in
            [&b"GET / HTTP/1.1\r\n\r\n"[..], b"GET /authority.crt/../ws HTTP/1.1\r\n", b"", b"\xff\r\n"]
        {
            let text = text(other);
            assert!(text.starts_with("HTTP/1.1 400") && text.contains("https://"), "{text}");
        }
    }
}
