//! Settings as TOML, with the help as comments.

use crate::{Item, Settings};
use std::fmt::Write;

/// Longest line of a comment.
const WIDTH: usize = 110;

/// All settings with their values, each under its help and range; the entries outside every section come first.
pub fn to_toml(settings: &impl Settings) -> String {
    let mut items = Vec::new();
    settings.list("", &mut items);
    let mut text = String::new();
    entries(&items, "", &mut text);
    for section in items.iter().filter(|i| i.entry.is_none()) {
        let mut inside = String::new();
        entries(&items, &section.path, &mut inside);
        // A section of nothing but sections needs no header.
        if !inside.is_empty() {
            text.push('\n');
            comment(&mut text, &section.help);
            let _ = write!(text, "[{}]\n{inside}", section.path);
        }
    }
    text
}

/// The entries that stand directly in a section.
fn entries(items: &[Item], section: &str, text: &mut String) {
    for item in items {
        let (of, key) = item.path.rsplit_once('.').unwrap_or(("", &item.path));
        if let (Some(entry), true) = (&item.entry, of == section) {
            comment(text, &explained(&item.help, entry.range));
            let _ = writeln!(text, "{key} = {}", entry.value);
        }
    }
}

/// "Levels of the pyramid." becomes "Levels of the pyramid (1 to 16)."
fn explained(help: &str, range: Option<[f64; 2]>) -> String {
    match range {
        Some([low, high]) => format!("{} ({low} to {high}).", help.trim_end_matches('.')),
        None => help.to_owned(),
    }
}

fn comment(text: &mut String, words: &str) {
    let mut line = String::from("#");
    for word in words.split(' ') {
        if line.len() > 1 && line.chars().count() + 1 + word.chars().count() > WIDTH {
            let _ = writeln!(text, "{line}");
            line = String::from("#");
        }
        let _ = write!(line, " {word}");
    }
    let _ = writeln!(text, "{line}");
}
