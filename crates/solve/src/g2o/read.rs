//! g2o text to a graph.

use super::content::{G2o, Graph};
use super::lines::Lines;
use super::toro::{Form, as_g2o};
use crate::text::{TextError, shown, whole};
use cairn_geometry::{Se2, Se3};
use std::collections::BTreeMap;

/// Different unknown tags that are listed by name.
const TAGS: usize = 32;

/// Reads a text of g2o, TORO or iSAM.
///
/// # Errors
/// With the line: a wrong count of numbers, numbers that are not finite, quaternions far from norm one, information
/// matrices that are not positive semi-definite, an id twice, edges to what there is not or from a vertex to itself, the
/// plane and space mixed; and when there is no edge at all.
pub fn read(text: &str) -> Result<G2o, TextError> {
    let file = read_nearest(text)?;
    match file.replaced {
        None => Ok(file),
        Some(r) => Err(TextError::new(r.first_line, "the information matrix is not positive semi-definite")),
    }
}

/// Reads a text of g2o, TORO or iSAM, and replaces information matrices that are not positive semi-definite by the nearest that are;
/// how many is in [`G2o::replaced`].
///
/// # Errors
/// As [`read`], but for those information matrices.
pub fn read_nearest(text: &str) -> Result<G2o, TextError> {
    let (text, form) = as_g2o(text)?;
    let mut rows: Rows = Rows::default();
    let mut unknown: BTreeMap<String, usize> = BTreeMap::new();
    for (k, content) in text.lines().enumerate() {
        let line = k + 1;
        let mut words = content.split('#').next().unwrap_or_default().split_whitespace();
        let Some(tag) = words.next() else { continue };
        if tag == "FIX" {
            rows.fix(line, words)?;
        } else {
            let taken = match rows.plane.take(tag, line, &mut words)? {
                None => rows.space.take(tag, line, &mut words)?,
                taken => taken,
            };
            if taken.is_none() {
                let name = shown(tag);
                let known = unknown.len() < TAGS || unknown.contains_key(&name);
                *unknown.entry(if known { name } else { "...".into() }).or_default() += 1;
            }
            if taken != Some(false) {
                rows.kept.push(content.to_owned());
            }
        }
        if let (Some(a), Some(b)) = (rows.plane.first, rows.space.first) {
            let reason =
                format!("poses in the plane and in space are mixed (the others begin at line {})", a.min(b));
            return Err(TextError::new(a.max(b), reason));
        }
    }
    rows.finish(unknown, text.lines().count(), form)
}

#[derive(Default)]
struct Rows {
    plane: Lines<Se2, 3>,
    space: Lines<Se3, 6>,
    fixes: Vec<(usize, u64)>,
    kept: Vec<String>,
}

impl Rows {
    fn fix<'a>(&mut self, line: usize, words: impl Iterator<Item = &'a str>) -> Result<(), TextError> {
        let mut words = words.peekable();
        loop {
            self.fixes.push((line, whole(&mut words, line, "the id")?));
            if words.peek().is_none() {
                return Ok(());
            }
        }
    }

    fn finish(self, unknown: BTreeMap<String, usize>, lines: usize, form: Form) -> Result<G2o, TextError> {
        if !self.plane.is_measured() && !self.space.is_measured() {
            let found = match tags_text(&unknown) {
                tags if tags.is_empty() => String::new(),
                tags => format!("; what is in it is not known: {tags}"),
            };
            let reason = format!("the text ends without an edge of a pose graph{found}");
            return Err(TextError::new(lines.max(1), reason));
        }
        let replaced = self.plane.replaced.or(self.space.replaced);
        let (graph, has_values) = if self.plane.first.is_some() {
            let has_values = !self.plane.vertices.is_empty();
            (Graph::Plane(self.plane.build(&self.fixes)?), has_values)
        } else {
            let has_values = !self.space.vertices.is_empty();
            (Graph::Space(self.space.build(&self.fixes)?), has_values)
        };
        Ok(G2o { graph, has_values, unknown, replaced, kept: self.kept, form })
    }
}

/// Tags and how often each was found, in words.
pub fn tags_text(tags: &BTreeMap<String, usize>) -> String {
    let each: Vec<String> = tags.iter().map(|(tag, n)| format!("{tag} ({n} lines)")).collect();
    each.join(", ")
}
