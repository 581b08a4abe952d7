//! Imports vocabularies in the DBoW2 text format: a line `k L scoring weighting`, then one line per node,
//! `parent is_leaf d0 .. d31 weight`; nodes are numbered from 1 in the order of their lines, 0 is the root.
//!
//! Only the variant that this crate can use is accepted: 32-byte binary descriptors, L1 scoring (0), tf-idf weighting
//! (0).

use super::build::{Header, Tree};
use super::format::{MAX_BRANCHING, MAX_DEPTH, MAX_NODES};
use super::{Vocabulary, VocabularyError};
use crate::Descriptor;
use std::fmt;
use std::io::{BufRead, Read};
use std::str::{FromStr, SplitAsciiWhitespace};

/// Longest accepted line in bytes.
const MAX_LINE: u64 = 4096;

/// Why a text is not a valid DBoW2 vocabulary.
#[derive(Debug)]
pub enum Dbow2Error {
    /// Reading the text failed.
    Read(std::io::Error),
    /// A line (numbered from 1) is invalid.
    Line(usize, String),
    /// Every line is valid, but the resulting tree is not.
    Whole(VocabularyError),
}

impl fmt::Display for Dbow2Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(e) => write!(f, "{e}"),
            Self::Line(n, why) => write!(f, "line {n}: {why}"),
            Self::Whole(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for Dbow2Error {}

/// One node as parsed from its line.
struct Line {
    parent: u32,
    leaf: bool,
    descriptor: Descriptor,
    weight: f32,
}

/// Parses a DBoW2 text and converts it to a vocabulary in this crate's own file format.
///
/// # Errors
/// When the text cannot be read or is invalid; the error names the line and what is wrong with it.
pub fn import_dbow2(mut text: impl BufRead) -> Result<Vocabulary, Dbow2Error> {
    let mut buffer = Vec::new();
    let mut number = 0;
    let mut next = |buffer: &mut Vec<u8>| -> Result<Option<usize>, Dbow2Error> {
        buffer.clear();
        number += 1;
        let n = (&mut text).take(MAX_LINE).read_until(b'\n', buffer).map_err(Dbow2Error::Read)?;
        if n as u64 == MAX_LINE {
            return Err(Dbow2Error::Line(number, format!("longer than {MAX_LINE} bytes")));
        }
        Ok((n > 0).then_some(number))
    };
    if next(&mut buffer)?.is_none() {
        return Err(Dbow2Error::Line(1, "the file is empty".into()));
    }
    let [branching, depth] = header(&buffer)?;
    let mut lines: Vec<Line> = Vec::new();
    // Depth below the root and number of children of each node, starting with the root.
    let (mut level, mut children) = (vec![0u8], vec![0u32]);
    while let Some(number) = next(&mut buffer)? {
        if buffer.trim_ascii().is_empty() {
            continue;
        }
        let fail = |why: String| Dbow2Error::Line(number, why);
        let line = node(&buffer, number)?;
        let parent = line.parent as usize;
        if parent > lines.len() {
            return Err(fail(format!("the parent {parent} is not defined before this line")));
        }
        if parent > 0 && lines[parent - 1].leaf {
            return Err(fail(format!("the parent {parent} is a leaf")));
        }
        children[parent] += 1;
        if children[parent] > branching {
            return Err(fail(format!("more than {branching} children of {parent}")));
        }
        let node_level = level[parent] + 1;
        if u32::from(node_level) > depth {
            return Err(fail(format!("deeper than {depth} levels")));
        }
        if lines.len() + 2 > MAX_NODES as usize {
            return Err(fail(format!("more than {MAX_NODES} nodes")));
        }
        level.push(node_level);
        children.push(0);
        lines.push(line);
    }
    if let Some(i) = (0..lines.len()).find(|i| !lines[*i].leaf && children[i + 1] == 0) {
        let why = format!("node {} is not a leaf but has no children: the file is cut off", i + 1);
        return Err(Dbow2Error::Line(number, why));
    }
    let file_header = Header { branching, ..Header::default() };
    let bytes = tree(&lines, &children).to_bytes(&file_header);
    let bytes = bytes.ok_or_else(|| Dbow2Error::Line(2, "there are no nodes".into()))?;
    Vocabulary::open(bytes).map_err(Dbow2Error::Whole)
}

/// Parses the first line: branching and depth.
fn header(line: &[u8]) -> Result<[u32; 2], Dbow2Error> {
    let fail = |why: String| Dbow2Error::Line(1, why);
    let mut words = Words::of(line, 1)?;
    let branching = words.number::<u32>("branching")?;
    let depth = words.number::<u32>("depth")?;
    let scoring = words.number::<u32>("scoring")?;
    let weighting = words.number::<u32>("weighting")?;
    if words.rest.next().is_some() {
        return Err(fail("expected \"k L scoring weighting\"".into()));
    }
    if !(1..=MAX_BRANCHING).contains(&branching) || !(1..=MAX_DEPTH).contains(&depth) {
        return Err(fail(format!("branching {branching} and depth {depth} are out of range")));
    }
    if (scoring, weighting) != (0, 0) {
        return Err(fail(format!(
            "scoring {scoring} and weighting {weighting}; only 0 (L1) and 0 (tf-idf) are supported"
        )));
    }
    Ok([branching, depth])
}

/// Parses the line of a node; `at` is its number.
fn node(line: &[u8], at: usize) -> Result<Line, Dbow2Error> {
    let fail = |why: String| Dbow2Error::Line(at, why);
    let mut words = Words::of(line, at)?;
    let parent = words.number("the parent")?;
    let leaf = match words.number::<u8>("the leaf flag")? {
        0 => false,
        1 => true,
        other => return Err(fail(format!("the leaf flag is {other}, not 0 or 1"))),
    };
    let mut descriptor = [0; 32];
    for byte in &mut descriptor {
        *byte = words.number("a byte of the descriptor")?;
    }
    let weight: f32 = words.number("the weight")?;
    if words.rest.next().is_some() {
        return Err(fail("unexpected text after parent, leaf flag, 32 bytes and weight".into()));
    }
    if !(weight >= 0.0 && weight.is_finite()) {
        return Err(fail(format!("the weight {weight} is negative or not finite")));
    }
    Ok(Line { parent, leaf, descriptor, weight })
}

/// The words of a line.
struct Words<'a> {
    rest: SplitAsciiWhitespace<'a>,
    /// Number of the line.
    at: usize,
}

impl<'a> Words<'a> {
    fn of(line: &'a [u8], at: usize) -> Result<Self, Dbow2Error> {
        let text = std::str::from_utf8(line).map_err(|_| Dbow2Error::Line(at, "not text".into()))?;
        Ok(Self { rest: text.split_ascii_whitespace(), at })
    }

    /// Parses the next word.
    fn number<T: FromStr>(&mut self, what: &str) -> Result<T, Dbow2Error> {
        let fail = |why: String| Dbow2Error::Line(self.at, why);
        let word = self.rest.next().ok_or_else(|| fail(format!("{what} is missing")))?;
        word.parse().map_err(|_| fail(format!("{what}: \"{word}\" is not a number in range")))
    }
}

/// Reorders the nodes level by level (breadth first).
fn tree(lines: &[Line], children: &[u32]) -> Tree {
    // Groups the children of each node, in the order of their lines.
    let mut starts: Vec<usize> = Vec::with_capacity(children.len() + 1);
    let mut sum = 0;
    for n in children {
        starts.push(sum);
        sum += *n as usize;
    }
    starts.push(sum);
    let mut next_slot = starts.clone();
    let mut of_parent = vec![0usize; lines.len()];
    for (i, line) in lines.iter().enumerate() {
        let at = &mut next_slot[line.parent as usize];
        of_parent[*at] = i + 1;
        *at += 1;
    }
    let mut order = vec![0usize];
    let mut tree = Tree::default();
    let mut at = 0;
    while let Some(&node) = order.get(at) {
        tree.first.push(order.len() as u32);
        let line = node.checked_sub(1).map(|i| &lines[i]);
        tree.centres.push(line.map_or([0; 32], |l| l.descriptor));
        tree.weights.push(line.filter(|l| l.leaf).map_or(0.0, |l| l.weight));
        order.extend(&of_parent[starts[node]..starts[node + 1]]);
        at += 1;
    }
    tree.first.push(order.len() as u32);
    tree
}
