//! BAL text: counts, observations, then nine numbers of each camera and three of each point.

use super::{Bal, BalCamera, BalObservation};
use crate::text::{TextError, number, shown, whole};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use std::fmt::Write;

/// Reads a BAL text, or one of Bundler, which begins with `# Bundle file`.
///
/// # Errors
/// With the line: counts that are not whole, indices beyond them, what is missing or too much, numbers that are not finite.
/// Memory grows with the text, whatever its counts say.
pub fn read(text: &str) -> Result<Bal, TextError> {
    let mut words = Words::new(text);
    if text.starts_with('#') {
        words.skip_line();
        if !text.starts_with("# Bundle file") {
            return Err(TextError::new(
                1,
                format!("begins with a comment, \"{}\"", shown(text.lines().next().unwrap_or_default())),
            ));
        }
        let bal = super::bundler::read(&mut words)?;
        return words.ended(bal);
    }
    let cameras = words.whole("the number of cameras", u32::MAX)?;
    let points = words.whole("the number of points", u32::MAX)?;
    let observations = words.whole("the number of observations", u32::MAX)?;
    let mut bal = Bal::default();
    for _ in 0..observations {
        let camera = words.whole("the camera of an observation", cameras)?;
        let point = words.whole("the point of an observation", points)?;
        let pixel = Vec2::new(words.number("x of a pixel")?, words.number("y of a pixel")?);
        bal.observations.push(BalObservation { camera, point, pixel });
    }
    for _ in 0..cameras {
        let rotation = words.vec3("the rotation of a camera")?;
        let translation = words.vec3("the translation of a camera")?;
        bal.cameras.push(BalCamera {
            camera_from_world: Se3::new(So3::exp(&rotation), translation),
            focal: words.number("a focal length")?,
            k1: words.number("k1 of a camera")?,
            k2: words.number("k2 of a camera")?,
        });
    }
    for _ in 0..points {
        bal.points.push(words.vec3("a point")?);
    }
    words.ended(bal)
}

/// The text of a problem; numbers keep every digit.
pub fn write(bal: &Bal) -> String {
    let mut text = format!("{} {} {}\n", bal.cameras.len(), bal.points.len(), bal.observations.len());
    // Writing to a string does not fail.
    for o in &bal.observations {
        let _ = writeln!(text, "{} {} {} {}", o.camera, o.point, o.pixel.x, o.pixel.y);
    }
    for c in &bal.cameras {
        let (w, t) = (c.camera_from_world.rotation.log(), &c.camera_from_world.translation);
        for v in [w.x, w.y, w.z, t.x, t.y, t.z, c.focal, c.k1, c.k2] {
            let _ = writeln!(text, "{v}");
        }
    }
    for v in bal.points.iter().flat_map(|p| p.iter()) {
        let _ = writeln!(text, "{v}");
    }
    text
}

/// The words of a text, and the line of the last one given.
pub(super) struct Words<'a> {
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
    fn new(text: &'a str) -> Self {
        Self { lines: text.lines().enumerate(), words: "".split_whitespace(), line: 1 }
    }

    /// Leaves out the rest of the first line.
    fn skip_line(&mut self) {
        self.lines.next();
    }

    /// The problem, when it has observations and nothing follows it.
    fn ended(&mut self, bal: Bal) -> Result<Bal, TextError> {
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
    pub(super) fn here(&self, error: TextError) -> TextError {
        TextError { line: self.line, ..error }
    }

    pub(super) fn number(&mut self, what: &str) -> Result<f64, TextError> {
        number(self, 0, what).map_err(|e| self.here(e))
    }

    pub(super) fn vec3(&mut self, what: &str) -> Result<Vec3, TextError> {
        Ok(Vec3::new(self.number(what)?, self.number(what)?, self.number(what)?))
    }

    /// A whole number below a bound.
    pub(super) fn whole(&mut self, what: &str, below: u32) -> Result<u32, TextError> {
        let n = whole(self, 0, what).map_err(|e| self.here(e))?;
        match u32::try_from(n) {
            Ok(n) if n < below => Ok(n),
            _ => Err(TextError::new(self.line, format!("{what} is {n}, which must be below {below}"))),
        }
    }
}
