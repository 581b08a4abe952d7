//! The words of a text of counts and numbers, with the line of each for errors.

use super::Bal;
use crate::text::{TextError, number, shown, whole};
use cairn_geometry::Vec3;

/// The words of a text, and the line of the last one given.
pub struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    words: std::str::SplitWhitespace<'a>,
    line: usize,
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        loop {
            if let Some(word) = self.words.next() {
                return Some(word);
            }
            let (k, content) = self.lines.next()?;
            (self.line, self.words) = (k + 1, content.split_whitespace());
        }
    }
}

impl<'a> Words<'a> {
    pub fn new(text: &'a str) -> Self {
        Self { lines: text.lines().enumerate(), words: "".split_whitespace(), line: 1 }
    }

    /// Leaves out the rest of the first line.
    pub fn skip_line(&mut self) {
        self.lines.next();
    }

    /// The problem, when it has observations and nothing follows it.
    pub fn ended(&mut self, bal: Bal) -> Result<Bal, TextError> {
        match self.next() {
            None if bal.observations.is_empty() => Err(TextError::new(self.line, "there is no observation")),
            None => Ok(bal),
            Some(word) => {
                let why = format!("more numbers than the counts say, from {}", shown(word));
                Err(TextError::new(self.line, why))
            }
        }
    }

    /// The error with the line that was reached.
    pub fn here(&self, error: TextError) -> TextError {
        TextError { line: self.line, ..error }
    }

    pub fn number(&mut self, what: &str) -> Result<f64, TextError> {
        number(self, 0, what).map_err(|e| self.here(e))
    }

    pub fn vec3(&mut self, what: &str) -> Result<Vec3, TextError> {
        Ok(Vec3::new(self.number(what)?, self.number(what)?, self.number(what)?))
    }

    /// A whole number below a bound.
    pub fn whole(&mut self, what: &str, below: u32) -> Result<u32, TextError> {
        let n = whole(self, 0, what).map_err(|e| self.here(e))?;
        match u32::try_from(n) {
            Ok(n) if n < below => Ok(n),
            _ => Err(TextError::new(self.line, format!("{what} is {n}, which must be below {below}"))),
        }
    }
}
