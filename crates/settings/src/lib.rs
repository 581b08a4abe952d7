#![doc = include_str!("../README.md")]

mod read;
mod write;

pub use cairn_settings_derive::Settings;
pub use read::{SettingsError, check, from_toml};
pub use write::to_toml;

use toml::Value;

/// A struct of settings, each with a default, a help text and, where it is a number, mostly a range. Derive it.
pub trait Settings {
    /// Lists the entries with their values, then the sections; `path` is that of the section this struct fills, empty for
    /// the whole.
    fn list(&self, path: &str, out: &mut Vec<Item>);
}

/// A line of a settings file: a section begins, or an entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// Names from the outermost section on, joined by dots.
    pub path: String,
    /// What it means, in one line.
    pub help: String,
    /// The entry; `None` where a section begins.
    pub entry: Option<Entry>,
}

/// The value of an entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The value, as TOML has it.
    pub value: Value,
    /// Smallest and largest number; of a list, those of each of its numbers.
    pub range: Option<[f64; 2]>,
}

/// For derived code: lists one entry.
///
/// # Panics
/// For a field that TOML cannot hold, such as an `Option` that is `None`: the struct is wrong, and its test of defaults says so.
#[doc(hidden)]
pub fn list_entry<T: serde::Serialize>(
    field: &T,
    path: &str,
    key: &str,
    help: &str,
    range: Option<[f64; 2]>,
    out: &mut Vec<Item>,
) {
    let value = match Value::try_from(field) {
        Ok(value) => shortest(value),
        Err(e) => panic!("the setting {key} cannot be written: {e}"),
    };
    out.push(Item { path: joined(path, key), help: plain(help), entry: Some(Entry { value, range }) });
}

/// For derived code: lists a section.
#[doc(hidden)]
pub fn list_section(field: &impl Settings, path: &str, key: &str, help: &str, out: &mut Vec<Item>) {
    let path = joined(path, key);
    out.push(Item { path: path.clone(), help: plain(help), entry: None });
    field.list(&path, out);
}

fn joined(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Doc comments link other settings as [`Self::name`]; people who read a file want the name.
fn plain(help: &str) -> String {
    help.replace("[`", "").replace("`]", "").replace("Self::", "").replace('`', "")
}

/// Numbers of single precision become those their shortest decimal says: 0.8, not 0.800000011920929.
fn shortest(value: Value) -> Value {
    match value {
        Value::Float(v) if f64::from(v as f32) == v => {
            Value::Float((v as f32).to_string().parse().unwrap_or(v))
        }
        Value::Array(list) => Value::Array(list.into_iter().map(shortest).collect()),
        other => other,
    }
}
