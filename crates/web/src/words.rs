//! The page's sentences: the document with its texts filled in, and the catalogue of a language for its script.

use crate::authority::Authority;
use cairn_guide::{DirectionStyle, PhraseConfig, Unit, WORDS_PER_MINUTE};
use cairn_phrases::{Language, page_messages};
use cairn_session::{KEYS, STEP_M, SessionConfig};
use cairn_view::{Act, KEYS as VIEW_KEYS};
use serde_json::{Map, Value, json};

/// Keys that are commands of the terminal only.
const NOT_ON_THE_PAGE: [&str; 4] = ["quit", "delete", "yes", "no"];

/// The document in a language. Elements name their text by `data-text` and their label by `data-label`.
pub(crate) fn document(html: &str, language: Language) -> String {
    let html = html.replacen("lang=\"en\"", &format!("lang=\"{language}\""), 1);
    let mut out = String::with_capacity(2 * html.len());
    for tag in html.split_inclusive('>') {
        let named = |attribute: &str| {
            let (_, rest) = tag.split_once(&format!("{attribute}=\""))?;
            rest.split('"').next().map(|id| escaped(&language.text(id)))
        };
        let (mut tag_with_label, text) = (tag.to_owned(), named("data-text").unwrap_or_default());
        if let Some(label) = named("data-label") {
            let end = tag_with_label.len() - 1;
            tag_with_label.insert_str(end, &format!(" aria-label=\"{label}\""));
        }
        out += &tag_with_label;
        out += &text;
    }
    out
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// What the script needs of a language: its sentences, the keys with their commands, all languages, and how the session
/// speaks until the page says otherwise; and the authority that phones are asked to trust.
pub(crate) fn catalogue(
    language: Language,
    session: &SessionConfig,
    authority: Option<&Authority>,
) -> String {
    let keys = KEYS.iter().filter(|k| !NOT_ON_THE_PAGE.contains(&k.line));
    let keys: Map<String, Value> = keys.map(|k| (k.key.to_string(), k.line.into())).collect();
    let languages = Language::ALL.map(|l| [l.code(), l.name()]);
    json!({
        "language": language,
        "languages": languages,
        "keys": keys,
        "viewKeys": view_keys(),
        "speaking": speaking(&session.phrases, session.announcer.rate),
        "authority": authority.map(|a| json!({ "name": a.name(), "fingerprint": a.fingerprint() })),
        "messages": page_messages(language),
    })
    .to_string()
}

/// What the keys of the view do: angles to turn by, steps to walk by, a factor, or to show all.
fn view_keys() -> Map<String, Value> {
    let act = |act: Act| match act {
        Act::Turn(by) => json!({ "turn": by }),
        Act::Walk(by) => json!({ "walk": by }),
        Act::Grow(by) => json!({ "grow": by }),
        Act::All => json!({ "all": true }),
    };
    VIEW_KEYS.iter().map(|k| (k.key.to_owned(), act(k.act))).collect()
}

fn speaking(phrases: &PhraseConfig, rate: f64) -> Value {
    let (unit, step_m) = match phrases.unit {
        Unit::Metres => ("metres", STEP_M),
        Unit::Feet => ("feet", STEP_M),
        Unit::Steps(step_m) => ("steps", step_m),
    };
    let directions = match phrases.directions {
        DirectionStyle::Words => "words",
        DirectionStyle::Clock => "clock",
        DirectionStyle::Degrees => "degrees",
    };
    let speed = (rate * WORDS_PER_MINUTE).round();
    json!({ "unit": unit, "step": (100.0 * step_m).round(), "directions": directions, "speed": speed })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HTML: &str = include_str!("page/index.html");

    #[test]
    fn every_text_of_the_document_is_filled_in() {
        for language in Language::ALL {
            let html = document(HTML, language);
            assert!(
                html.starts_with(&format!("<!doctype html>\n<html lang=\"{language}\">")),
                "{}",
                &html[..60]
            );
            for id in ["page-record", "page-map-help", "page-dark-title"] {
                assert!(html.contains(&format!(">{}</", escaped(&language.text(id)))), "{language}: {id}");
            }
            assert!(html.contains(&format!("aria-label=\"{}\"", language.text("page-picture-label"))));
            assert!(!html.contains(">page-") && !html.contains("\"page-picture-label\" aria-label=\"page-"));
        }
    }

    #[test]
    fn no_text_of_the_document_is_outside_of_the_catalogue() {
        let body = HTML.split_once("<body>").unwrap().1;
        let texts = body.split('<').filter_map(|part| part.split_once('>')).map(|(_, text)| text.trim());
        let words: Vec<&str> = texts.filter(|t| t.chars().any(char::is_alphabetic)).collect();
        assert_eq!(words, ["Cairn", "WAIT_FRAMES"], "a name and a code, the same in all languages");
        assert!(!body.contains("aria-label=\"") && !body.contains("title=\""));
    }

    #[test]
    fn catalogue_has_the_keys_of_the_terminal() {
        let text = catalogue(Language::German, &SessionConfig::default(), None);
        let catalogue: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(catalogue["keys"]["g"], "guide");
        assert_eq!(catalogue["keys"].as_object().unwrap().len(), KEYS.len() - NOT_ON_THE_PAGE.len());
        assert_eq!(catalogue["viewKeys"].as_object().unwrap().len(), VIEW_KEYS.len());
        assert_eq!(catalogue["viewKeys"]["w"], json!({ "walk": [0.0, 0.0, 1.0] }));
        assert_eq!(catalogue["languages"][2], json!(["de", "Deutsch"]));
        assert_eq!(
            catalogue["speaking"],
            json!({"unit": "metres", "step": 65.0, "directions": "words", "speed": 180.0})
        );
        assert_eq!(catalogue["messages"]["page-no"], json!(["nein"]));
        // Every button gives a command that exists.
        for button in HTML.split("data-command=\"").skip(1) {
            let line = button.split('"').next().unwrap();
            assert!(cairn_session::Command::parse(line).is_ok(), "{line}");
        }
    }
}
