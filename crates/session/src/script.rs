//! A script: commands that are carried out in order, each when its condition holds.
//!
//! ```text
//! at 5 record                 # seconds since the first packet
//! near 1.0 0.2 7.5 0.5 stop   # the camera within 0.5 of x y z, in the map's units
//! tracked 100 record          # this many frames have a pose
//! arrived quit                # guidance has ended at the end of its route
//! ```

use crate::command::Command;
use crate::session::Session;
use crate::slam::Slam;
use cairn_geometry::Vec3;
use std::collections::VecDeque;

/// When a command is due.
#[derive(Clone, Debug, PartialEq)]
pub enum When {
    /// Seconds since the first packet.
    At(f64),
    /// The camera is within the distance of a point, in the map's units.
    Near(Vec3, f64),
    /// This many frames have a pose.
    Tracked(usize),
    /// The last guidance ended at the end of its route.
    Arrived,
}

/// What is wrong with a script.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {why}")]
pub struct ScriptError {
    /// Line number, counted from 1.
    pub line: usize,
    /// What is wrong.
    pub why: String,
}

/// Commands still to come.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    steps: VecDeque<(When, Command)>,
}

impl Script {
    /// Parses the text; `#` begins a comment.
    ///
    /// # Errors
    /// [`ScriptError`] with the first line that is wrong.
    pub fn parse(text: &str) -> Result<Self, ScriptError> {
        let mut steps = VecDeque::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            steps.push_back(step(line, number + 1)?);
        }
        Ok(Self { steps })
    }

    /// The commands that are due now, in order.
    pub fn due<S: Slam>(&mut self, session: &Session<S>) -> Vec<Command> {
        let mut due = Vec::new();
        while let Some((when, _)) = self.steps.front() {
            // A command that waits for arrival also waits for guidance that this same call has just started.
            let holds = match when {
                When::At(t) => session.elapsed_s() >= *t,
                When::Near(place, within) => session.place().is_some_and(|p| (p - place).norm() <= *within),
                When::Tracked(n) => session.tracked() >= *n,
                When::Arrived => session.has_arrived() && due.is_empty(),
            };
            match self.steps.pop_front() {
                Some((_, command)) if holds => due.push(command),
                Some(step) => {
                    self.steps.push_front(step);
                    break;
                }
                None => break,
            }
        }
        due
    }

    /// Whether all commands have been carried out.
    pub fn is_done(&self) -> bool {
        self.steps.is_empty()
    }
}

/// The step of a line that is not empty; `at` is its number.
fn step(line: &str, at: usize) -> Result<(When, Command), ScriptError> {
    let wrong = |why: String| ScriptError { line: at, why };
    let (word, mut rest) =
        line.split_once(char::is_whitespace).ok_or_else(|| wrong("a command is missing".into()))?;
    let mut number = || -> Result<f64, ScriptError> {
        let text = rest.trim_start();
        let (first, after) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        rest = after;
        match first.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(wrong(format!("\"{first}\" is not a number"))),
        }
    };
    let when = match word {
        "at" => When::At(number()?),
        "near" => {
            let place = Vec3::new(number()?, number()?, number()?);
            When::Near(place, number()?)
        }
        "tracked" => match number()? {
            n if n >= 0.0 && n.fract() == 0.0 => When::Tracked(n as usize),
            n => return Err(wrong(format!("{n} is not a number of frames"))),
        },
        "arrived" => When::Arrived,
        other => {
            return Err(wrong(format!("\"{other}\" is not a condition: write at, near, tracked or arrived")));
        }
    };
    Ok((when, Command::parse(rest).map_err(|e| wrong(e.to_string()))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_guide::Facing;

    #[test]
    fn parses_conditions_and_reports_errors_with_line() {
        let script =
            Script::parse("# walk\nat 5 record\n\nnear 1 -2 3.5 0.5 guide back # home\narrived quit\n");
        let steps: Vec<_> = script.unwrap().steps.into();
        assert_eq!(steps[0], (When::At(5.0), Command::Record));
        let guide = Command::Guide { facing: Some(Facing::Back), again: false };
        assert_eq!(steps[1], (When::Near(Vec3::new(1.0, -2.0, 3.5), 0.5), guide));
        assert_eq!(steps[2], (When::Arrived, Command::Quit));
        for (wrong, line) in [
            ("at 5", 1),
            ("\nat x record", 2),
            ("when 5 stop", 1),
            ("tracked 1.5 stop", 1),
            ("near 1 2 stop", 1),
            ("stop", 1),
        ] {
            assert_eq!(Script::parse(wrong).unwrap_err().line, line, "{wrong}");
        }
    }
}
