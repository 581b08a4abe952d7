//! Lines of numbers: shared by the readers of text logs.

use super::LogError;

/// The numbers of a line, which must be exactly `N` and all finite.
pub fn numbers<const N: usize>(
    file: &str,
    line: usize,
    mut words: impl Iterator<Item = impl AsRef<str>>,
    names: [&str; N],
) -> Result<[f64; N], LogError> {
    let mut values = [0.0; N];
    for (value, name) in values.iter_mut().zip(names) {
        let word = words.next().ok_or_else(|| LogError::at(file, line, format!("{name} is missing")))?;
        *value = number(file, line, word.as_ref(), name)?;
    }
    match words.next() {
        None => Ok(values),
        Some(more) => Err(LogError::at(
            file,
            line,
            format!("{:?} is more than the {N} values expected", cut(more.as_ref())),
        )),
    }
}

/// One finite number.
pub fn number(file: &str, line: usize, word: &str, name: &str) -> Result<f64, LogError> {
    match word.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err(LogError::at(file, line, format!("{name} is {:?}, not a finite number", cut(word)))),
    }
}

/// A label: a whole number.
pub fn label(file: &str, line: usize, value: f64, name: &str) -> Result<u32, LogError> {
    if value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0 {
        Ok(value as u32)
    } else {
        Err(LogError::at(file, line, format!("{name} is {value}, not a whole number from 0 on")))
    }
}

/// Lines that are not empty, with their numbers from one; comments begin with `#`.
pub fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(k, line)| (k + 1, line.trim()));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// A word shortened so that a message stays on one line.
pub fn cut(word: &str) -> String {
    word.chars().take(40).collect()
}
