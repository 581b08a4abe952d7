//! YAML with the line of every value, and the near-YAML that OpenCV's FileStorage writes and people edit.
//!
//! What is no YAML is made it first, line by line: `%YAML:1.0` without `---`, `data:[` without a blank, tabs; and in lists
//! without commas each number is an item. Of several documents the keys are one mapping.

use granit_parser::{Event, Parser, ScalarStyle, Span, StrInput};
use std::collections::BTreeMap;

/// A value and the line it starts on.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Line in the file, from 1.
    pub line: usize,
    /// The value.
    pub value: Value,
}

/// The value of a node.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Nothing after the key.
    Null,
    /// A number or text, unquoted.
    Scalar(String),
    /// A sequence.
    List(Vec<Node>),
    /// A mapping, in the file's order.
    Map(Vec<(String, Node)>),
}

/// A line and what is wrong there.
pub type ParseError = (usize, String);

/// Largest nesting depth; no calibration has more.
const MAX_DEPTH: usize = 24;

/// Most values of a file, those of anchors counted each time they are named.
const MAX_NODES: usize = 1 << 20;

impl Node {
    /// The value of a key, if this is a mapping that has it.
    pub fn get(&self, key: &str) -> Option<&Node> {
        match &self.value {
            Value::Map(entries) => entries.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Text of a scalar.
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Scalar(s) => Some(s),
            _ => None,
        }
    }

    /// The items of a sequence.
    pub fn list(&self) -> Option<&[Node]> {
        match &self.value {
            Value::List(items) => Some(items),
            _ => None,
        }
    }
}

/// Parses a whole file.
///
/// # Errors
/// The line and what is wrong: it is no YAML, a key is given twice with different values, or it is nested too deeply.
pub fn parse(text: &str) -> Result<Node, ParseError> {
    let text = made_yaml(text);
    let mut reader = Reader { events: Parser::new_from_str(&text), anchors: BTreeMap::new(), nodes: 0 };
    loop {
        match reader.next()? {
            (Event::StreamEnd, _) => return Ok(Node { line: 1, value: Value::Null }),
            (Event::StreamStart | Event::DocumentStart(..) | Event::DocumentEnd, _) => {}
            (event, span) => {
                let node = reader.node(event, &span, 0)?;
                reader.end()?;
                return Ok(node);
            }
        }
    }
}

/// The text with what is no YAML made it; the lines stay the same.
fn made_yaml(text: &str) -> String {
    let mut made = String::with_capacity(text.len() + 64);
    let mut open = 0;
    for line in text.lines() {
        let whole = line.trim();
        if !(whole.starts_with('%') || whole.starts_with("---") || whole.starts_with("...")) {
            let line = line.replace('\t', " ").replace("]#", "] #").replace(",#", ", #");
            match (open, colon_of_key(&line)) {
                (0, Some(at)) => made.extend([&line[..=at], " ", &line[at + 1..]]),
                _ => made.push_str(&line),
            }
            open = brackets_open(&line, open);
        }
        made.push('\n');
    }
    made
}

/// Where a colon ends a key although no blank follows it.
fn colon_of_key(line: &str) -> Option<usize> {
    let at = line.find(':')?;
    let key = line[..at].trim();
    let named = key.starts_with(|c: char| c.is_alphabetic() || c == '_')
        && key.chars().all(|c| c.is_alphanumeric() || "_.-".contains(c));
    let next = line[at + 1..].chars().next()?;
    // R-VIO has a key with a colon in it: `Camera:nTimeOffset: 0`.
    let in_key = line[at + 1..]
        .split('#')
        .next()
        .is_some_and(|rest| rest.contains(": ") && !rest.starts_with(['"', '\'', '{', '[']));
    let joined = !next.is_whitespace() && !":/\\".contains(next);
    (named && joined && !in_key).then_some(at)
}

/// How many brackets are open after a line, outside of quotes and comments.
fn brackets_open(line: &str, mut open: usize) -> usize {
    let (mut quote, mut before) = (None, ' ');
    for c in line.chars() {
        match (quote, c) {
            (Some(q), _) if c == q => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') if !before.is_alphanumeric() => quote = Some(c),
            (None, '#') if before.is_whitespace() => break,
            (None, '[' | '{') => open += 1,
            (None, ']' | '}') => open = open.saturating_sub(1),
            _ => {}
        }
        before = c;
    }
    open
}

struct Reader<'a> {
    events: Parser<'a, StrInput<'a>>,
    /// What anchors name.
    anchors: BTreeMap<usize, Node>,
    nodes: usize,
}

impl<'a> Reader<'a> {
    fn next(&mut self) -> Result<(Event<'a>, Span), ParseError> {
        match self.events.next() {
            Some(Ok(event)) => Ok(event),
            Some(Err(e)) if e.info().is_empty() => Err((e.marker().line(), "is no YAML".to_owned())),
            Some(Err(e)) => Err((e.marker().line(), e.info().to_owned())),
            None => Err((0, "it ends in the middle".to_owned())),
        }
    }

    /// Nothing may follow the content.
    fn end(&mut self) -> Result<(), ParseError> {
        loop {
            match self.next()? {
                (Event::StreamEnd, _) => return Ok(()),
                (Event::DocumentEnd, _) => {}
                (_, span) => return Err((span.start.line(), "follows the end of the content".into())),
            }
        }
    }

    /// The value that begins with an event.
    fn node(&mut self, event: Event<'a>, span: &Span, depth: usize) -> Result<Node, ParseError> {
        let line = span.start.line();
        if depth > MAX_DEPTH {
            return Err((line, "is nested too deeply".into()));
        }
        let (anchor, value) = match event {
            Event::Scalar(text, ScalarStyle::Plain, anchor, _) if text.is_empty() => (anchor, Value::Null),
            Event::Scalar(text, _, anchor, _) => (anchor, Value::Scalar(text.into_owned())),
            Event::SequenceStart(_, anchor, _) => (anchor, Value::List(self.items(depth)?)),
            Event::MappingStart(_, anchor, _) => (anchor, Value::Map(self.entries(depth)?)),
            Event::Alias(anchor) => {
                let unknown = || (line, "names an anchor that is not there yet".to_owned());
                return self.counted(self.anchors.get(&anchor).cloned().ok_or_else(unknown)?);
            }
            _ => return Err((line, "is no value".into())),
        };
        let node = self.counted(Node { line, value })?;
        if anchor > 0 {
            self.anchors.insert(anchor, node.clone());
        }
        Ok(node)
    }

    /// Counts what a node adds: its own items, and the whole of one that is named again.
    fn counted(&mut self, node: Node) -> Result<Node, ParseError> {
        self.nodes += size(&node);
        if self.nodes > MAX_NODES { Err((node.line, "has too many values".into())) } else { Ok(node) }
    }

    fn items(&mut self, depth: usize) -> Result<Vec<Node>, ParseError> {
        let mut items = Vec::new();
        loop {
            match self.next()? {
                (Event::SequenceEnd, _) => return Ok(items),
                (event, span) => {
                    let item = self.node(event, &span, depth + 1)?;
                    match numbers_of(&item) {
                        Some(numbers) => items.extend(numbers),
                        None => items.push(item),
                    }
                }
            }
        }
    }

    fn entries(&mut self, depth: usize) -> Result<Vec<(String, Node)>, ParseError> {
        let mut entries: Vec<(String, Node)> = Vec::new();
        loop {
            let (event, span) = self.next()?;
            let at = span.start.line();
            let key = match event {
                Event::MappingEnd => return Ok(entries),
                Event::Scalar(key, ..) => key.into_owned(),
                _ => return Err((at, "is no key".into())),
            };
            let (event, span) = self.next()?;
            let mut node = self.node(event, &span, depth + 1)?;
            if node.value == Value::Null {
                node.line = at;
            }
            match entries.iter().find(|(k, _)| *k == key) {
                Some((_, first)) if first.value != node.value => {
                    return Err((at, format!("{key} is given twice, first on line {}", first.line)));
                }
                Some(_) => {}
                None => entries.push((key, node)),
            }
        }
    }
}

fn size(node: &Node) -> usize {
    match &node.value {
        // Those within were counted as they were read; of an alias they are counted as often as it stands there.
        Value::List(items) => 1 + items.iter().map(size).sum::<usize>(),
        Value::Map(entries) => 1 + entries.iter().map(|(_, node)| size(node)).sum::<usize>(),
        _ => 1,
    }
}

/// An item of numbers without commas between them, as its numbers.
fn numbers_of(item: &Node) -> Option<Vec<Node>> {
    let words: Vec<&str> = item.text()?.split_whitespace().collect();
    let numbers = words.len() > 1 && words.iter().all(|w| w.parse::<f64>().is_ok());
    let node = |w: &&str| Node { line: item.line, value: Value::Scalar((*w).to_owned()) };
    numbers.then(|| words.iter().map(node).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scalars(node: &Node) -> Vec<&str> {
        node.list().unwrap().iter().map(|n| n.text().unwrap()).collect()
    }

    #[test]
    fn parses_opencv_files() {
        let text = "%YAML:1.0\r\n# head\nFile.version: \"1.0\"\nCamera.fps: 20 # hertz\n\
            T: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: f\n   data:[1. 2.,\n      3, # why\n   4e-1]\nlast:5\n";
        let root = parse(text).unwrap();
        assert_eq!(root.get("File.version").unwrap().text(), Some("1.0"));
        assert_eq!(root.get("Camera.fps").unwrap().text(), Some("20"));
        let t = root.get("T").unwrap();
        assert_eq!(t.get("rows").unwrap().text(), Some("2"));
        assert_eq!(scalars(t.get("data").unwrap()), ["1.", "2.", "3", "4e-1"]);
        assert_eq!(t.get("data").unwrap().line, 9);
        assert_eq!(root.get("last").unwrap().text(), Some("5"));
        let separated = parse("%YAML:1.0\n---\na: 1\n---\nb: 2\n...\n").unwrap();
        assert_eq!(separated.get("b").unwrap().text(), Some("2"));
    }

    #[test]
    fn a_colon_in_a_key_stays_in_it() {
        let root = parse("Camera:nTimeOffset: 3\nT:{a: 1}\nlast:5 # why: so\n").unwrap();
        assert_eq!(root.get("Camera:nTimeOffset").unwrap().text(), Some("3"));
        assert_eq!(root.get("T").unwrap().get("a").unwrap().text(), Some("1"));
        assert_eq!(root.get("last").unwrap().text(), Some("5"));
    }

    #[test]
    fn parses_kalibr_files() {
        let text = "cam0:\n  T:\n  - [1.0, 0.0]\n  - [0.0, 1.0]\n  cam_overlaps: []\n  nested: [[1, 2], [3]]\n  \
            topic: /cam0/image_raw\nlist:\n-\n  a: 1\n- b\n";
        let root = parse(text).unwrap();
        let cam = root.get("cam0").unwrap();
        assert_eq!(scalars(&cam.get("T").unwrap().list().unwrap()[1]), ["0.0", "1.0"]);
        assert!(cam.get("cam_overlaps").unwrap().list().unwrap().is_empty());
        assert_eq!(scalars(&cam.get("nested").unwrap().list().unwrap()[0]), ["1", "2"]);
        assert_eq!(cam.get("topic").unwrap().text(), Some("/cam0/image_raw"));
        let list = root.get("list").unwrap().list().unwrap();
        assert_eq!(list[0].get("a").unwrap().text(), Some("1"));
        assert_eq!(list[1].text(), Some("b"));
    }

    #[test]
    fn parses_flow_mappings_anchors_and_lists_over_lines() {
        let text =
            "a: {x: 1, y: [2, 3]}\nb: &name\n  k: 7\nc: *name\nlong: [1,\n 2,\n3]\ntext: |\n  two\n  lines\n";
        let root = parse(text).unwrap();
        assert_eq!(root.get("a").unwrap().get("x").unwrap().text(), Some("1"));
        assert_eq!(scalars(root.get("a").unwrap().get("y").unwrap()), ["2", "3"]);
        assert_eq!(root.get("c").unwrap().get("k").unwrap().text(), Some("7"));
        assert_eq!(scalars(root.get("long").unwrap()), ["1", "2", "3"]);
        assert_eq!(root.get("text").unwrap().text(), Some("two\nlines\n"));
        let flow = parse("{image: map.pgm, url: a://b, origin: [0.0, 0.0, 0.0]}").unwrap();
        assert_eq!(flow.get("image").unwrap().text(), Some("map.pgm"));
        assert_eq!(parse("url: a://b:80\npath: C:\\x\n").unwrap().get("path").unwrap().text(), Some("C:\\x"));
    }

    #[test]
    fn errors_name_the_line() {
        for (text, line) in
            [("a: 1\nnonsense\n", 2), ("a: 1\nb: 2\na: 3\n", 3), ("a: 1\n   b: 2\n", 2), ("a: *none\n", 1)]
        {
            let at = parse(text).unwrap_err().0;
            assert!(at.abs_diff(line) <= 1, "{text}: line {at}");
        }
        assert!(parse("a: [1, 2\nb: 3\n").is_err());
        assert!(parse(&"[".repeat(100_000)).is_err());
        assert!(parse(&format!("a: {}{}", "[".repeat(1000), "]".repeat(1000))).is_err());
        assert_eq!(parse("").unwrap().value, Value::Null);
        // Nine anchors, each of nine of the one before: a billion values.
        let laughs: String = (1..10)
            .map(|k| format!("a{k}: &a{k} [{}]\n", vec![format!("*a{}", k - 1); 9].join(", ")))
            .collect();
        assert!(parse(&format!("a0: &a0 x\n{laughs}")).unwrap_err().1.contains("too many"));
    }

    proptest::proptest! {
        #[test]
        fn never_panics(text in "[-a:\\[\\]{}\"'#!&*, \n\t1.|>]{0,80}") {
            let _ = parse(&text);
        }
    }
}
