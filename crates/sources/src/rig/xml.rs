//! OpenCV's FileStorage in XML (`<opencv_storage>`), as the YAML of the same storage is.

use super::document::Document;
use cairn_files::yaml::{Node, Value};
use cairn_sensor::SourceError;
use std::path::Path;

/// Deepest nesting.
const MAX_DEPTH: usize = 24;

/// True when a text is one.
pub fn is(text: &str) -> bool {
    text.trim_start().starts_with('<') && text.contains("<opencv_storage>")
}

/// The content of the storage.
pub fn document(path: &Path, text: &str) -> Result<Document, SourceError> {
    let mut reader = Reader { text, line: 1 };
    let found = std::iter::from_fn(|| reader.tag()).any(|(_, tag)| tag == "opencv_storage");
    let root = if found { reader.content("opencv_storage", 0) } else { None };
    let root = root.ok_or_else(|| {
        let place = crate::text::place(path, reader.line);
        SourceError::new(place, "is no XML of OpenCV: an element does not end", "correct the file")
    })?;
    Ok(Document { path: path.to_owned(), root })
}

struct Reader<'a> {
    /// What is left.
    text: &'a str,
    line: usize,
}

impl<'a> Reader<'a> {
    /// The text before the next tag, and what is between its brackets; comments are left out.
    fn tag(&mut self) -> Option<(&'a str, &'a str)> {
        let (before, rest) = self.text.split_once('<')?;
        let end = if rest.starts_with("!--") { "-->" } else { ">" };
        let (tag, after) = rest.split_once(end)?;
        self.line += before.matches('\n').count() + tag.matches('\n').count();
        self.text = after;
        Some((before, tag))
    }

    /// What is in an element, up to its end.
    fn content(&mut self, name: &str, depth: usize) -> Option<Node> {
        let (line, mut entries, mut text) = (self.line, Vec::new(), String::new());
        loop {
            let (before, tag) = self.tag()?;
            text.push_str(before);
            if tag.strip_prefix('/') == Some(name) {
                break;
            }
            let child = tag.split_whitespace().next()?;
            if !tag.starts_with(['!', '?']) && !tag.ends_with('/') {
                let below = if depth < MAX_DEPTH { self.content(child, depth + 1)? } else { return None };
                entries.push((child.to_owned(), below));
            }
        }
        let words = text.split_whitespace().map(|word| Node { line, value: Value::Scalar(word.to_owned()) });
        let mut words: Vec<Node> = words.collect();
        let value = match (entries.is_empty(), words.len()) {
            (false, _) => Value::Map(entries),
            (true, 1) if name != "data" => words.remove(0).value,
            (true, _) => Value::List(words),
        };
        Some(Node { line, value })
    }
}
