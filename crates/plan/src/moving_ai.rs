//! Maps and scenarios of the Moving AI benchmarks (Sturtevant, "Benchmarks for Grid-Based Pathfinding", 2012).
//!
//! A `.map` is text: `type octile`, `height`, `width`, `map`, then rows, the first row being y = 0. `.` and `G` are
//! ground, `S` is swamp, `W` water, `T` trees, `@` and `O` are out of bounds. `.`, `G` and `S` are passable; diagonal
//! steps cut no corner. A `.scen` gives start, goal and the optimal length, with 1 for a straight step and the square
//! root of 2 for a diagonal one.

use crate::grid::{Cell, Grid, GridError, GridFrame};

/// A map or scenario that could not be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct MovingAiError {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong.
    pub reason: String,
}

fn fail<T>(line: usize, reason: impl Into<String>) -> Result<T, MovingAiError> {
    Err(MovingAiError { line, reason: reason.into() })
}

/// Reads a map: true where a cell is passable.
///
/// # Errors
/// When a header line is missing, a row is short or missing, or a letter is unknown.
pub fn read_map(text: &str) -> Result<Grid<bool>, MovingAiError> {
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l.trim_end()));
    let (mut width, mut height) = (None, None);
    loop {
        let Some((line, text)) = lines.next() else { return fail(1, "no line `map`: not a Moving AI map") };
        let mut words = text.split_whitespace();
        match (words.next(), words.next()) {
            (Some("type"), Some(_)) | (None, _) => {}
            (Some("height"), Some(v)) => height = Some(number(line, v)?),
            (Some("width"), Some(v)) => width = Some(number(line, v)?),
            (Some("map"), None) => break,
            _ => return fail(line, "expected `type`, `height`, `width` or `map`"),
        }
    }
    let (Some(width), Some(height)) = (width, height) else {
        return fail(1, "`width` or `height` is missing");
    };
    let frame = GridFrame::unit(width, height).or_else(|e: GridError| fail(1, e.to_string()))?;
    let mut values = Vec::with_capacity(frame.len());
    for row in 0..height {
        let Some((line, text)) = lines.next() else {
            return fail(row, format!("the map ends after {row} of {height} rows"));
        };
        if text.len() != width {
            return fail(line, format!("{} cells in a row of {width}", text.len()));
        }
        for letter in text.bytes() {
            values.push(match letter {
                b'.' | b'G' | b'S' => true,
                b'@' | b'O' | b'T' | b'W' => false,
                _ => return fail(line, format!("unknown cell {:?}", char::from(letter))),
            });
        }
    }
    Grid::from_values(frame, values).or_else(|e| fail(1, e.to_string()))
}

/// One task: start, goal, and the length of the shortest path.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Name of the map.
    pub map: String,
    /// Size of the map that the coordinates refer to.
    pub size: (usize, usize),
    /// Start cell.
    pub start: Cell,
    /// Goal cell.
    pub goal: Cell,
    /// Length of the shortest path, in cells.
    pub optimal_length: f64,
}

/// Reads scenarios.
///
/// # Errors
/// When the first line is not `version`, or a line does not have nine fields with numbers where they are expected.
pub fn read_scenarios(text: &str) -> Result<Vec<Scenario>, MovingAiError> {
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l));
    match lines.next() {
        Some((_, first)) if first.trim_start().starts_with("version") => {}
        _ => return fail(1, "expected `version`: not a Moving AI scenario file"),
    }
    let mut scenarios = Vec::new();
    for (line, text) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let fields: Vec<&str> = text.split_whitespace().collect();
        let &[_, map, width, height, x0, y0, x1, y1, length] = fields.as_slice() else {
            return fail(line, format!("{} fields instead of 9", fields.len()));
        };
        let cell = |x, y| Ok(Cell::new(number(line, x)? as u32, number(line, y)? as u32));
        let optimal_length: f64 = length
            .parse()
            .ok()
            .filter(|l: &f64| l.is_finite() && *l >= 0.0)
            .map_or_else(|| fail(line, format!("the length {length:?} is not a number")), Ok)?;
        scenarios.push(Scenario {
            map: map.to_owned(),
            size: (number(line, width)?, number(line, height)?),
            start: cell(x0, y0)?,
            goal: cell(x1, y1)?,
            optimal_length,
        });
    }
    Ok(scenarios)
}

fn number(line: usize, text: &str) -> Result<usize, MovingAiError> {
    text.parse::<u32>().map(|v| v as usize).or_else(|_| fail(line, format!("{text:?} is not a whole number")))
}
