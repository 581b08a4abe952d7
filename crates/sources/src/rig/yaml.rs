//! A tolerant parser for the YAML of calibration files.
//!
//! Supported: block mappings and sequences, flow sequences over several lines, scalars, comments, tags.
//! Beyond YAML, what OpenCV's FileStorage writes and people edit: `%YAML:1.0` without `---`, `data:[` without
//! a blank, numbers without commas between them, tabs. Not supported: anchors, block scalars, flow mappings
//! (kept as text).

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
pub fn parse(text: &str) -> Result<Node, ParseError> {
    let lines = logical_lines(text)?;
    let Some(first) = lines.first() else { return Ok(Node { line: 1, value: Value::Null }) };
    let mut reader = Reader { at: 0, lines: &lines };
    let node = reader.block(first.indent, 0)?;
    match lines.get(reader.at) {
        Some(rest) => Err((rest.line, "is indented unlike the lines before it".into())),
        None => Ok(node),
    }
}

/// A line without comment; lines with open brackets are joined to the lines that close them.
struct Line {
    line: usize,
    indent: usize,
    text: String,
}

fn logical_lines(text: &str) -> Result<Vec<Line>, ParseError> {
    let mut lines: Vec<Line> = Vec::new();
    let mut open = 0i32;
    for (i, raw) in text.lines().enumerate() {
        let raw = without_comment(raw.trim_start_matches('\u{feff}'));
        let text = raw.trim();
        if text.is_empty() || text.starts_with('%') || text == "---" || text == "..." {
            continue;
        }
        match lines.last_mut() {
            Some(last) if open > 0 => {
                last.text.push(' ');
                last.text.push_str(text);
            }
            _ => lines.push(Line {
                line: i + 1,
                indent: raw.len() - raw.trim_start().len(),
                text: text.into(),
            }),
        }
        open += brackets(text);
        if open < 0 {
            return Err((i + 1, "closes a bracket that was not opened".into()));
        }
    }
    match lines.last() {
        Some(last) if open > 0 => Err((last.line, "opens a bracket that is never closed".into())),
        _ => Ok(lines),
    }
}

fn without_comment(line: &str) -> &str {
    let mut quote = None;
    let mut before = ' ';
    for (i, c) in line.char_indices() {
        match quote {
            Some(q) if c == q => quote = None,
            None if (c == '"' || c == '\'') && !before.is_alphanumeric() => quote = Some(c),
            None if c == '#' && (before.is_whitespace() || before == ',' || before == ']') => {
                return &line[..i];
            }
            _ => {}
        }
        before = c;
    }
    line
}

/// Opened minus closed brackets outside of quotes.
fn brackets(text: &str) -> i32 {
    let mut quote = None;
    let mut open = 0;
    for c in text.chars() {
        match (quote, c) {
            (Some(q), _) if c == q => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => open += 1,
            (None, ']' | '}') => open -= 1,
            _ => {}
        }
    }
    open
}

struct Reader<'a> {
    at: usize,
    lines: &'a [Line],
}

impl Reader<'_> {
    /// The mapping or sequence of the lines at `indent`.
    fn block(&mut self, indent: usize, depth: usize) -> Result<Node, ParseError> {
        let line = self.lines[self.at].line;
        if depth > MAX_DEPTH {
            return Err((line, "is nested too deeply".into()));
        }
        let value = if dash(&self.lines[self.at].text).is_some() {
            Value::List(self.items(indent, depth)?)
        } else {
            Value::Map(self.entries(indent, depth)?)
        };
        Ok(Node { line, value })
    }

    fn items(&mut self, indent: usize, depth: usize) -> Result<Vec<Node>, ParseError> {
        let mut items = Vec::new();
        while let Some(l) = self.lines.get(self.at).filter(|l| l.indent == indent) {
            let Some(rest) = dash(&l.text) else { break };
            self.at += 1;
            items.push(self.value(rest, l.line, indent, depth, false)?);
        }
        Ok(items)
    }

    fn entries(&mut self, indent: usize, depth: usize) -> Result<Vec<(String, Node)>, ParseError> {
        let mut entries: Vec<(String, Node)> = Vec::new();
        while let Some(l) = self.lines.get(self.at).filter(|l| l.indent == indent) {
            let Some((key, rest)) = key_value(&l.text) else {
                return Err((l.line, format!("\"{}\" is not \"key: value\"", l.text)));
            };
            self.at += 1;
            let node = self.value(rest, l.line, indent, depth, true)?;
            match entries.iter().find(|(k, _)| k == key) {
                Some((_, first)) if first.value != node.value => {
                    return Err((l.line, format!("{key} is given twice, first on line {}", first.line)));
                }
                Some(_) => {}
                None => entries.push((key.into(), node)),
            }
        }
        Ok(entries)
    }

    /// The value after a key or a dash: on the same line, or as a block below.
    fn value(
        &mut self,
        rest: &str,
        line: usize,
        indent: usize,
        depth: usize,
        keyed: bool,
    ) -> Result<Node, ParseError> {
        let rest = without_tag(rest);
        if !rest.is_empty() {
            return inline(rest, line);
        }
        let below = self.lines.get(self.at).filter(|l| {
            // A sequence may follow its key without indentation.
            l.indent > indent || (keyed && l.indent == indent && dash(&l.text).is_some())
        });
        match below {
            Some(l) => self.block(l.indent, depth + 1),
            None => Ok(Node { line, value: Value::Null }),
        }
    }
}

fn dash(text: &str) -> Option<&str> {
    if text == "-" { Some("") } else { text.strip_prefix("- ").map(str::trim) }
}

/// Splits at the first colon that ends a key.
fn key_value(text: &str) -> Option<(&str, &str)> {
    let ends_key = |at: usize| {
        let rest = &text[at + 1..];
        rest.is_empty() || rest.starts_with([' ', '\t', '[', '"', '\'', '!'])
    };
    let colons = || text.match_indices(':').map(|(at, _)| at);
    let at = colons().find(|&at| ends_key(at)).or_else(|| colons().next())?;
    let key = text[..at].trim().trim_matches(['"', '\'']);
    (!key.is_empty()).then(|| (key, text[at + 1..].trim()))
}

fn without_tag(text: &str) -> &str {
    if text.starts_with('!') {
        return text.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim());
    }
    text
}

fn inline(text: &str, line: usize) -> Result<Node, ParseError> {
    if !text.starts_with('[') {
        return Ok(Node { line, value: Value::Scalar(unquoted(text)) });
    }
    let mut rest = &text[1..];
    let list = flow(&mut rest, line, 0)?;
    if rest.trim().is_empty() { Ok(list) } else { Err((line, format!("\"{}\" follows a list", rest.trim()))) }
}

/// The rest of a flow sequence whose opening bracket has been read.
fn flow(rest: &mut &str, line: usize, depth: usize) -> Result<Node, ParseError> {
    if depth > MAX_DEPTH {
        return Err((line, "is nested too deeply".into()));
    }
    let mut items = Vec::new();
    loop {
        *rest = rest.trim_start_matches(|c: char| c == ',' || c.is_whitespace());
        let Some(c) = rest.chars().next() else {
            return Err((line, "opens a list that is never closed".into()));
        };
        match c {
            ']' => {
                *rest = &rest[1..];
                return Ok(Node { line, value: Value::List(items) });
            }
            '[' => {
                *rest = &rest[1..];
                items.push(flow(rest, line, depth + 1)?);
            }
            '"' | '\'' => {
                let Some(end) = rest[1..].find(c) else {
                    return Err((line, "opens a quote that is never closed".into()));
                };
                items.push(Node { line, value: Value::Scalar(rest[1..=end].into()) });
                *rest = &rest[end + 2..];
            }
            _ => {
                let end = rest
                    .find(|c: char| c == ',' || c == ']' || c == '[' || c.is_whitespace())
                    .unwrap_or(rest.len());
                items.push(Node { line, value: Value::Scalar(rest[..end].into()) });
                *rest = &rest[end..];
            }
        }
    }
}

fn unquoted(text: &str) -> String {
    for quote in ['"', '\''] {
        if let Some(inner) = text.strip_prefix(quote).and_then(|t| t.strip_suffix(quote)) {
            return inner.into();
        }
    }
    text.into()
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
    fn errors_name_the_line() {
        assert_eq!(parse("a: 1\nnonsense\n").unwrap_err().0, 2);
        assert_eq!(parse("a: [1, 2\nb: 3\n").unwrap_err().0, 1);
        assert_eq!(parse("a: 1]\n").unwrap_err().0, 1);
        assert_eq!(parse("a: 1\nb: 2\na: 3\n").unwrap_err().0, 3);
        assert_eq!(parse("a: 1\n   b: 2\n").unwrap_err().0, 2);
        assert!(parse(&"[".repeat(100_000)).is_err());
        assert!(parse(&format!("a: {}{}", "[".repeat(1000), "]".repeat(1000))).is_err());
        assert_eq!(parse("").unwrap().value, Value::Null);
    }

    proptest::proptest! {
        #[test]
        fn never_panics(text in "[-a:\\[\\]{}\"'#!, \n\t1.]{0,80}") {
            let _ = parse(&text);
        }
    }
}
