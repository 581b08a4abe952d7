//! Settings from TOML: entries that a text leaves out keep their defaults; every error names the entry and its line.

use crate::{Item, Settings};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

/// Why a text is no valid settings file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{why}", line.map(|l| format!("line {l}: ")).unwrap_or_default())]
pub struct SettingsError {
    /// Line, counted from one, where there is a text.
    pub line: Option<usize>,
    /// What is wrong.
    pub why: String,
}

/// An entry of the text.
struct Given {
    path: Vec<String>,
    line: usize,
    value: Value,
}

/// Reads settings from TOML.
///
/// # Errors
/// [`SettingsError`] for text that is not TOML, unknown names, values of another kind and numbers out of range.
pub fn from_toml<T: Settings + Default + Serialize + DeserializeOwned>(
    text: &str,
) -> Result<T, SettingsError> {
    let line_of = |at: usize| 1 + text[..at.min(text.len())].matches('\n').count();
    let parsed = DeTable::parse(text).map_err(|e| SettingsError {
        line: e.span().map(|s| line_of(s.start)),
        why: e.message().to_owned(),
    })?;
    let mut given = Vec::new();
    collect(parsed.get_ref(), &mut Vec::new(), &line_of, &mut given);
    let mut known = Vec::new();
    T::default().list("", &mut known);
    let written = |why: String| SettingsError { line: None, why };
    let mut table = Table::try_from(T::default()).map_err(|e| written(e.to_string()))?;
    let mut settings = T::default();
    for entry in given {
        let at = |why: String| SettingsError { line: Some(entry.line), why };
        let path = entry.path.join(".");
        if let Some(why) = unknown(&path, &entry.value, &known) {
            return Err(at(why));
        }
        put(&mut table, &entry.path, entry.value);
        let read: Result<T, _> = Value::Table(table.clone()).try_into();
        settings = read.map_err(|e: toml::de::Error| at(format!("{path}: {}", e.message())))?;
        check(&settings).map_err(|e| at(e.why))?;
    }
    Ok(settings)
}

/// Checks that every number lies in its range; not a number is outside every range.
///
/// # Errors
/// [`SettingsError`] naming the first entry out of range, and the range.
pub fn check(settings: &impl Settings) -> Result<(), SettingsError> {
    let mut items = Vec::new();
    settings.list("", &mut items);
    for item in &items {
        let Some((entry, [low, high])) = item.entry.as_ref().and_then(|e| Some((e, e.range?))) else {
            continue;
        };
        if let Some(value) = numbers(&entry.value).into_iter().find(|v| !(low..=high).contains(v)) {
            let why = format!("{} is {value}, it must lie between {low} and {high}", item.path);
            return Err(SettingsError { line: None, why });
        }
    }
    Ok(())
}

/// The entries of a parsed text with their lines; empty sections are entries too, so that an unknown one is told.
fn collect(
    table: &DeTable<'_>,
    path: &mut Vec<String>,
    line_of: &impl Fn(usize) -> usize,
    out: &mut Vec<Given>,
) {
    for (key, value) in table {
        path.push(key.get_ref().to_string());
        match value.get_ref() {
            DeValue::Table(inner) if !inner.is_empty() => collect(inner, path, line_of, out),
            _ => {
                // What was parsed can be converted.
                let value: Value =
                    serde::Deserialize::deserialize(toml::de::ValueDeserializer::from(value.clone()))
                        .unwrap_or(Value::Boolean(false));
                out.push(Given { path: path.clone(), line: line_of(key.span().start), value });
            }
        }
        path.pop();
    }
}

/// What is wrong with a path that is no entry.
fn unknown(path: &str, value: &Value, known: &[Item]) -> Option<String> {
    let found = known.iter().find(|item| item.path == path);
    match (found.map(|item| &item.entry), value) {
        (Some(Some(_)), _) | (Some(None), Value::Table(_)) => None,
        (Some(None), _) => Some(format!("{path} is a section: write [{path}]")),
        (None, _) => {
            let name = |p: &str| p.rsplit('.').next().map(str::to_owned);
            let like = known.iter().find(|item| name(&item.path) == name(path));
            let hint = like.map_or_else(String::new, |item| format!("; there is {}", item.path));
            Some(format!("unknown entry {path}{hint}"))
        }
    }
}

/// Puts a value at its place in the table, where every section exists already.
fn put(table: &mut Table, path: &[String], value: Value) {
    match path {
        [] => {}
        [key] if !value.is_table() => drop(table.insert(key.clone(), value)),
        [_] => {}
        [section, rest @ ..] => {
            if let Some(Value::Table(inner)) = table.get_mut(section) {
                put(inner, rest, value);
            }
        }
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Integer(v) => vec![*v as f64],
        Value::Float(v) => vec![*v],
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        _ => Vec::new(),
    }
}
