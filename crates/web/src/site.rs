//! The files of the page: for the server, and as a site of files with the engine in them, which needs no server.

use crate::words;
use cairn_phrases::Language;
use cairn_session::SessionConfig;
use ring::digest::{Context, SHA256};
use serde_json::json;

pub(crate) const HTML: &str = "text/html; charset=utf-8";
pub(crate) const JSON: &str = "application/json";

/// The document, whose texts the catalogue of a language fills in.
pub(crate) const DOCUMENT: &str = include_str!("page/index.html");

macro_rules! files {
    ($($name:literal),* $(,)?) => { [$(($name, include_str!(concat!("page/", $name)))),*] };
}

/// What the document loads, wherever the engine runs.
pub(crate) const FILES: [(&str, &str); 34] = files![
    "app.js",
    "before.js",
    "beside.js",
    "buttons.js",
    "camera.js",
    "coding.js",
    "columns.js",
    "demo.js",
    "files.js",
    "here.js",
    "icon.svg",
    "kept.js",
    "link.js",
    "map.js",
    "model.js",
    "orbit.js",
    "pace.js",
    "pairing.js",
    "phones.js",
    "practice.js",
    "reader.js",
    "requests.js",
    "routes.js",
    "scene.js",
    "senses.js",
    "shaded.js",
    "state.js",
    "style.css",
    "surface.js",
    "trust.js",
    "view.js",
    "voices.js",
    "watch.js",
    "words.js",
];

/// What an engine in the page needs beside its module.
const HERE: [(&str, &str); 7] = [
    ("worker.js", include_str!("page/worker.js")),
    ("walker.js", include_str!("page/walker.js")),
    ("store.js", include_str!("page/store.js")),
    ("tar.js", include_str!("page/tar.js")),
    ("manifest.webmanifest", include_str!("page/manifest.webmanifest")),
    ("engine.mjs", include_str!("../../phone/js/engine.mjs")),
    ("wasi.mjs", include_str!("../../phone/js/wasi.mjs")),
];

/// Fetches the site at the first visit; the names of the files and their sum are filled in.
const SERVICE: &str = include_str!("page/service.js");
const SERVICE_SITE: &str = "{ version: '', files: [] }";

/// As strict as the server's headers; what a module of WebAssembly needs comes in addition.
const POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; \
                      img-src 'self'; connect-src 'self'; manifest-src 'self'; media-src 'self' blob: mediastream:; \
                      base-uri 'none'; form-action 'none'";

/// How WebAssembly begins, and the names by which a page calls the engine and the walker of the demo.
const MAGIC: &[u8] = b"\0asm";
const CALLS: [&[u8]; 2] = [b"cairn_apply", b"walk_begin"];

/// What a file is, by its name.
pub(crate) fn kind(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        _ => "text/javascript; charset=utf-8",
    }
}

/// The bytes are no module of this engine, or of its demo.
#[derive(Debug, thiserror::Error)]
#[error("is no WebAssembly module of Cairn")]
pub struct NoModule;

/// The page with the engine in it, as names and contents of files for any server; with the demo where its walker is given.
///
/// # Errors
/// [`NoModule`].
pub fn site(module: Vec<u8>, walker: Option<Vec<u8>>) -> Result<Vec<(String, Vec<u8>)>, NoModule> {
    for (module, call) in std::iter::once(&module).chain(&walker).zip(CALLS) {
        if !module.starts_with(MAGIC) || !module.windows(call.len()).any(|w| w == call) {
            return Err(NoModule);
        }
    }
    let document = document(walker.is_some()).into_bytes();
    let mut files = vec![("index.html".to_owned(), document), ("cairn.wasm".to_owned(), module)];
    files
        .extend(FILES.iter().chain(&HERE).map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())));
    for language in Language::ALL {
        let catalogue = words::catalogue(language, &SessionConfig::default(), None);
        files.push((format!("words/{language}.json"), catalogue.into_bytes()));
    }
    files.push(("service.js".into(), service(&files).into_bytes()));
    // Fetched when the demo is watched: who walks does not need it.
    files.extend(walker.map(|walker| ("walker.wasm".to_owned(), walker)));
    Ok(files)
}

/// The document, which says where the engine runs, and whether there is a demo.
fn document(has_demo: bool) -> String {
    let head = format!(
        "<meta charset=\"utf-8\">\n<meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <link rel=\"manifest\" href=\"manifest.webmanifest\">\n<link rel=\"apple-touch-icon\" href=\"icon.svg\">"
    );
    let html = words::document(DOCUMENT, Language::default());
    let here = if has_demo { "<html data-engine=\"here\" data-demo " } else { "<html data-engine=\"here\" " };
    html.replacen("<html ", here, 1).replacen("<meta charset=\"utf-8\">", &head, 1)
}

/// The script that keeps these files; it changes with any of them.
fn service(files: &[(String, Vec<u8>)]) -> String {
    let mut sum = Context::new(&SHA256);
    files.iter().for_each(|(name, bytes)| [name.as_bytes(), bytes].iter().for_each(|part| sum.update(part)));
    let version: String = sum.finish().as_ref().iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let names: Vec<&str> = std::iter::once("./").chain(files.iter().map(|(name, _)| name.as_str())).collect();
    SERVICE.replacen(SERVICE_SITE, &json!({ "version": version, "files": names }).to_string(), 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn module(more: u8) -> Vec<u8> {
        [b"\0asm\x01\0\0\0", CALLS[0], &[more]].concat()
    }

    #[test]
    fn site_has_all_that_its_scripts_name() {
        let files = site(module(0), None).unwrap();
        let text = |name: &str| {
            let (_, bytes) = files.iter().find(|(n, _)| n == name).unwrap();
            String::from_utf8_lossy(bytes).into_owned()
        };
        let html = text("index.html");
        assert!(
            html.starts_with("<!doctype html>\n<html data-engine=\"here\" lang=\"en\">"),
            "{}",
            &html[..80]
        );
        assert!(html.contains("'wasm-unsafe-eval'") && !html.contains("unsafe-inline"));
        let mut checked = 0;
        for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with("js")) {
            let script = String::from_utf8_lossy(bytes);
            for line in script.lines().filter(|line| line.starts_with("import ")) {
                let other = line.trim_end_matches("\";").trim_end_matches("';").rsplit("./").next().unwrap();
                assert!(files.iter().any(|(n, _)| n == other), "{name}: {line}");
                checked += 1;
            }
        }
        assert!(checked > 20, "{checked}");
        let service = text("service.js");
        files.iter().filter(|(name, _)| name != "service.js").for_each(|(name, _)| {
            assert!(service.contains(&format!("\"{name}\"")), "{name} is not kept");
        });
    }

    #[test]
    fn another_module_is_another_version_and_other_bytes_are_none() {
        let service = |more| site(module(more), None).unwrap().pop().unwrap();
        assert_eq!(service(0), service(0));
        assert_ne!(service(0).1, service(1).1);
        let wrong = |module: &[u8]| site(module.to_vec(), None).is_err();
        assert!(wrong(b"\0asm\x01\0\0\0") && wrong(CALLS[0]));
    }

    #[test]
    fn demo_is_there_where_its_walker_is_and_is_not_fetched_by_who_walks() {
        let walker = [MAGIC, CALLS[1]].concat();
        let files = site(module(0), Some(walker.clone())).unwrap();
        assert_eq!(files.last(), Some(&("walker.wasm".to_owned(), walker)));
        let text = |nth: usize| String::from_utf8_lossy(&files[nth].1).into_owned();
        assert!(text(0).contains(" data-demo ") && !text(files.len() - 2).contains("walker.wasm"));
        assert!(site(module(0), Some(module(1))).is_err(), "the engine is no walker");
    }
}
