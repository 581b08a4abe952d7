//! Numbers out of lines of text, with errors that say where and what.

/// Why a text could not be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct TextError {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong there.
    pub reason: String,
}

impl TextError {
    pub(crate) fn new(line: usize, reason: impl Into<String>) -> Self {
        Self { line, reason: reason.into() }
    }
}

/// The word, cut short where a message would be swamped by it.
pub(crate) fn shown(word: &str) -> String {
    let mut text: String = word.chars().take(24).flat_map(char::escape_debug).collect();
    if word.chars().nth(24).is_some() {
        text.push_str("...");
    }
    text
}

/// The next word as a finite number; `what` names it in the error.
pub(crate) fn number<'a>(
    words: &mut impl Iterator<Item = &'a str>,
    line: usize,
    what: &str,
) -> Result<f64, TextError> {
    let word = words.next().ok_or_else(|| TextError::new(line, format!("{what} is missing")))?;
    match word.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        Ok(_) => Err(TextError::new(line, format!("{what} is not finite: {}", shown(word)))),
        Err(_) => Err(TextError::new(line, format!("{what} is not a number: {}", shown(word)))),
    }
}

/// The next word as a whole number from 0; `what` names it in the error.
pub(crate) fn whole<'a>(
    words: &mut impl Iterator<Item = &'a str>,
    line: usize,
    what: &str,
) -> Result<u64, TextError> {
    let word = words.next().ok_or_else(|| TextError::new(line, format!("{what} is missing")))?;
    word.parse().map_err(|_| TextError::new(line, format!("{what} is not a whole number: {}", shown(word))))
}

/// Nothing may follow.
pub(crate) fn end<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<(), TextError> {
    match words.next() {
        None => Ok(()),
        Some(word) => Err(TextError::new(line, format!("too many entries, from {}", shown(word)))),
    }
}
