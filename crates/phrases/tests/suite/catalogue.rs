//! The catalogue is complete: every language has every id with the same values, every id is used, and every id that
//! the code names exists. Plurals, cases and numbers are right.

use cairn_phrases::{Arg, Language, page_messages};
use fluent_syntax::ast::{Entry, Expression, InlineExpression, Pattern, PatternElement};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Values that a language may leave out: they only select a grammatical form that not every language has.
const GRAMMAR: [&str; 1] = ["kind"];
/// The beginnings of the ids that code names.
const FAMILIES: [&str; 8] = ["guide-", "stop-", "ready-", "walk-", "phase-", "wait-", "key-", "page-"];
/// Where ids are named: sources whose quoted texts with such a beginning are ids.
const USERS: [&str; 5] = ["guide/src", "engine/src/status", "session/src", "view/src", "web/src"];

/// What a message consists of.
#[derive(Default)]
struct Content {
    values: BTreeSet<String>,
    messages: BTreeSet<String>,
    functions: BTreeSet<String>,
}

fn read(pattern: &Pattern<&str>, content: &mut Content) {
    for element in &pattern.elements {
        if let PatternElement::Placeable { expression } = element {
            read_expression(expression, content);
        }
    }
}

fn read_expression(expression: &Expression<&str>, content: &mut Content) {
    let inline = match expression {
        Expression::Inline(inline) => inline,
        Expression::Select { selector, variants } => {
            variants.iter().for_each(|v| read(&v.value, content));
            selector
        }
    };
    match inline {
        InlineExpression::VariableReference { id } => drop(content.values.insert(id.name.into())),
        InlineExpression::MessageReference { id, .. } => drop(content.messages.insert(id.name.into())),
        InlineExpression::FunctionReference { id, arguments } => {
            content.functions.insert(id.name.into());
            for value in &arguments.positional {
                if let InlineExpression::VariableReference { id } = value {
                    content.values.insert(id.name.into());
                }
            }
        }
        InlineExpression::Placeable { expression } => read_expression(expression, content),
        _ => {}
    }
}

fn path(language: Language) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("languages/{}.ftl", language.code()))
}

fn messages(language: Language) -> BTreeMap<String, Content> {
    let text = std::fs::read_to_string(path(language)).unwrap();
    let file = fluent_syntax::parser::parse(text.as_str())
        .unwrap_or_else(|(_, errors)| panic!("{language}.ftl is not Fluent: {errors:?}"));
    let mut found = BTreeMap::new();
    for entry in &file.body {
        if let Entry::Message(message) = entry {
            let mut content = Content::default();
            read(message.value.as_ref().expect("a message has a value"), &mut content);
            message.attributes.iter().for_each(|a| read(&a.value, &mut content));
            let twice = found.insert(message.id.name.to_owned(), content);
            assert!(twice.is_none(), "{language}.ftl has {} twice", message.id.name);
        }
    }
    found
}

/// The values of a message, those of the messages in it included.
fn values(of: &BTreeMap<String, Content>, id: &str) -> BTreeSet<String> {
    let content = of.get(id).unwrap_or_else(|| panic!("there is no {id}"));
    let inner = content.messages.iter().flat_map(|m| values(of, m));
    content.values.iter().cloned().chain(inner).filter(|v| !GRAMMAR.contains(&v.as_str())).collect()
}

/// Texts in quotes that begin like an id, in all sources that name ids.
fn named_in_code() -> BTreeSet<String> {
    fn files(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in
            std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())).flatten()
        {
            let path = entry.path();
            let kind = path.extension().and_then(|e| e.to_str());
            match kind {
                _ if path.is_dir() => files(&path, found),
                Some("rs" | "js" | "html") => found.push(path),
                _ => {}
            }
        }
    }
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut sources = Vec::new();
    USERS.iter().for_each(|folder| files(&crates.join(folder), &mut sources));
    let mut named = BTreeSet::new();
    for source in sources {
        let text = std::fs::read_to_string(source).unwrap();
        for quote in ['"', '\''] {
            let texts = text.split(quote).filter(|t| FAMILIES.iter().any(|f| t.starts_with(f)));
            let plain = |t: &&str| !t.ends_with('-') && t.chars().all(|c| c.is_ascii_lowercase() || c == '-');
            named.extend(texts.filter(plain).map(str::to_owned));
        }
    }
    named
}

#[test]
fn every_language_has_every_id_with_the_same_values() {
    let english = messages(Language::English);
    assert!(english.len() > 200, "{} ids", english.len());
    for language in Language::ALL {
        let translated = messages(language);
        let ids = |of: &BTreeMap<String, Content>| of.keys().cloned().collect::<BTreeSet<_>>();
        let differ: Vec<_> = ids(&english).symmetric_difference(&ids(&translated)).cloned().collect();
        assert!(differ.is_empty(), "{language}.ftl and en.ftl differ in {differ:?}");
        for id in english.keys() {
            assert_eq!(values(&translated, id), values(&english, id), "values of {id} in {language}.ftl");
            let content = &translated[id];
            assert!(content.functions.iter().all(|f| f == "CAPITAL"), "{id} in {language}.ftl");
            let page = id.starts_with("page-");
            let simple =
                content.functions.is_empty() && content.messages.iter().all(|m| m.starts_with("page-"));
            assert!(!page || simple, "{id}: the page knows neither functions nor other messages");
        }
    }
}

#[test]
fn every_id_is_used_and_every_id_in_the_code_exists() {
    let english = messages(Language::English);
    let named = named_in_code();
    let missing: Vec<_> = named.iter().filter(|id| !english.contains_key(*id)).collect();
    assert!(missing.is_empty(), "named in the code, but in no language: {missing:?}");
    let inside: BTreeSet<_> = english.values().flat_map(|c| &c.messages).collect();
    let unused: Vec<_> = (english.keys())
        .filter(|id| *id != "distance" && !named.contains(*id) && !inside.contains(id))
        .collect();
    assert!(unused.is_empty(), "used nowhere: {unused:?}");
}

/// Not everybody walks: no sentence in English does.
#[test]
fn nobody_is_told_to_walk() {
    let text = std::fs::read_to_string(path(Language::English)).unwrap();
    let sentences = text.lines().filter(|line| !line.starts_with('#'));
    let said = sentences.map(|line| line.split_once(" = ").map_or(line, |(_, said)| said));
    // Ids of other messages and names of variants are no words.
    let words = |said: &str| said.split(['{', '}', '[', ']']).step_by(2).collect::<String>().to_lowercase();
    let walks: Vec<_> = said.filter(|said| words(said).contains("walk")).collect();
    assert!(walks.is_empty(), "{walks:#?}");
}

#[test]
fn plurals_cases_and_decimals_follow_the_language() {
    let distance = |language: Language, n: f64, unit: &str| {
        language.say("distance", &[("distance", Arg::Number(n, 0)), ("unit", unit.into())])
    };
    for (language, unit, one, many) in [
        (Language::English, "metres", "1 metre", "3 metres"),
        (Language::English, "feet", "1 foot", "3 feet"),
        (Language::Spanish, "steps", "1 paso", "3 pasos"),
        (Language::Spanish, "feet", "1 pie", "3 pies"),
        (Language::German, "metres", "1 Meter", "3 Meter"),
        (Language::German, "steps", "1 Schritt", "3 Schritte"),
    ] {
        assert_eq!([distance(language, 1.0, unit), distance(language, 3.0, unit)], [one, many]);
    }
    let approach = |n: f64, unit: &'static str| {
        let args =
            [("distance", Arg::Number(n, 0)), ("unit", unit.into()), ("next", "rechts abbiegen".into())];
        Language::German.say("guide-approach", &[args.as_slice(), &[("after", "".into())]].concat())
    };
    assert_eq!(approach(6.0, "metres"), "In 6 Metern rechts abbiegen.");
    assert_eq!(approach(1.0, "steps"), "In 1 Schritt rechts abbiegen.");
    assert_eq!(approach(8.0, "steps"), "In 8 Schritten rechts abbiegen.");
    let age = |language: Language| language.say("walk-age", &[("seconds", Arg::Number(2.5, 1))]);
    assert_eq!(age(Language::English), "The picture is 2.5 seconds old.");
    assert_eq!(age(Language::Spanish), "La imagen es de hace 2,5 segundos.");
    assert_eq!(age(Language::German), "Das Bild ist 2,5 Sekunden alt.");
    let whole = Language::German.say("walk-age", &[("seconds", Arg::Number(-0.01, 1))]);
    assert_eq!(whole, "Das Bild ist 0,0 Sekunden alt.");
    let hour = |n| Language::Spanish.say("guide-turn-clock", &[("hour", Arg::Number(n, 0))]);
    assert_eq!([hour(1.0), hour(2.0)], ["gire a la 1", "gire a las 2"]);
}

#[test]
fn sentences_of_the_page_are_data_without_functions() {
    fn check(value: &serde_json::Value, id: &str) {
        match value {
            serde_json::Value::Null => panic!("{id} has a part that the page does not know"),
            serde_json::Value::Array(parts) => parts.iter().for_each(|part| check(part, id)),
            serde_json::Value::Object(part) => part.values().for_each(|part| check(part, id)),
            _ => {}
        }
    }
    for language in Language::ALL {
        let page = page_messages(language);
        let page = page.as_object().unwrap();
        assert!(page.len() > 80, "{} sentences", page.len());
        page.iter().for_each(|(id, parts)| check(parts, id));
        assert_eq!(page["page-no"][0], language.text("page-no"));
    }
    let english = page_messages(Language::English);
    assert_eq!(english["page-map-walker"][0]["value"], "percent");
    assert_eq!(english["page-routes-count"][0]["of"]["one"][0]["value"], "count");
}

/// The first sentence parses the language's file. Printed; the bound leaves room for a busy machine.
#[test]
fn a_language_is_parsed_within_milliseconds() {
    for language in Language::ALL {
        let started = Instant::now();
        let first = language.text("guide-stop");
        let parsed_ms = 1e3 * started.elapsed().as_secs_f64();
        let started = Instant::now();
        let args = [("distance", Arg::Number(6.0, 0)), ("unit", "metres".into())];
        (0..1000).for_each(|_| drop(language.say("guide-start", &args)));
        println!(
            "{first} {language}.ftl: {parsed_ms:.2} ms to parse, {:.1} us a sentence",
            1e3 * started.elapsed().as_secs_f64()
        );
        assert!(parsed_ms < 50.0, "{parsed_ms} ms");
    }
}
