//! The commands of a session, the same everywhere: keys on a terminal or the page, lines for screen readers and
//! scripts.

use cairn_guide::Facing;
use std::path::PathBuf;

/// What a walker can ask for.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Start recording the route.
    Record,
    /// End the recording; the route can be walked home from now on.
    Stop,
    /// Load a recorded route: this file, else the latest one.
    Load(Option<PathBuf>),
    /// Start guidance along the route.
    Guide {
        /// How the camera is mounted relative to the walker; the session's default without it.
        facing: Option<Facing>,
        /// From start to end as it was recorded, instead of home.
        again: bool,
    },
    /// End guidance.
    Halt,
    /// Say the last words again.
    Repeat,
    /// Say the present state.
    Status,
    /// End the session.
    Quit,
}

/// All commands with their keys, for people.
pub const HELP: &str = "r record, s stop recording, l load the latest route, g guide home, b guide backwards, h halt, \
                        p repeat, i status, q quit; with lines also: load FILE, guide home|back|backwards [again]";

impl Command {
    /// The command of a key, in either case.
    pub fn of_key(key: char) -> Option<Self> {
        Some(match key.to_ascii_lowercase() {
            'r' => Self::Record,
            's' => Self::Stop,
            'l' => Self::Load(None),
            'g' => Self::Guide { facing: None, again: false },
            'b' => Self::Guide { facing: Some(Facing::Backwards), again: false },
            'h' => Self::Halt,
            'p' => Self::Repeat,
            'i' => Self::Status,
            'q' => Self::Quit,
            _ => return None,
        })
    }

    /// Parses a line: a word of [`HELP`], or a single key.
    ///
    /// # Errors
    /// What is wrong with the line, for the user.
    pub fn parse(line: &str) -> Result<Self, String> {
        let mut words = line.split_whitespace();
        let first = words.next().ok_or("an empty line is not a command")?.to_lowercase();
        let rest: Vec<&str> = words.collect();
        let command = match first.as_str() {
            "record" => Self::Record,
            "stop" => Self::Stop,
            "load" => {
                let (_, path) = line.trim().split_at(4);
                let path = path.trim();
                return Ok(Self::Load((!path.is_empty()).then(|| PathBuf::from(path))));
            }
            "guide" => return guide(&rest),
            "halt" => Self::Halt,
            "backwards" => Self::Guide { facing: Some(Facing::Backwards), again: false },
            "repeat" => Self::Repeat,
            "status" => Self::Status,
            "quit" | "exit" => Self::Quit,
            one => {
                let mut letters = one.chars();
                let key = letters.next().filter(|_| letters.next().is_none()).and_then(Self::of_key);
                key.ok_or_else(|| format!("\"{one}\" is not a command; {HELP}"))?
            }
        };
        match rest.first() {
            None => Ok(command),
            Some(word) => Err(format!("unexpected \"{word}\" after \"{first}\"")),
        }
    }
}

fn guide(words: &[&str]) -> Result<Command, String> {
    let (mut facing, mut again) = (None, false);
    for word in words {
        match word.to_lowercase().as_str() {
            "home" => facing = Some(Facing::Home),
            "back" => facing = Some(Facing::Back),
            "backwards" => facing = Some(Facing::Backwards),
            "again" => again = true,
            other => return Err(format!("guide {other}: write guide home, back or backwards, and again")),
        }
    }
    Ok(Command::Guide { facing, again })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_and_lines_are_equivalent() {
        for (key, line) in [
            ('R', "record"),
            ('s', "stop"),
            ('L', "load"),
            ('g', "guide"),
            ('H', "halt"),
            ('b', "backwards"),
            ('b', "guide backwards"),
            ('p', "repeat"),
            ('q', "quit"),
        ] {
            let command = Command::of_key(key).unwrap();
            assert_eq!(Command::parse(line).unwrap(), command);
            assert_eq!(Command::parse(&key.to_string()).unwrap(), command);
        }
        assert_eq!(
            Command::parse("load my route.route").unwrap(),
            Command::Load(Some("my route.route".into()))
        );
        let again = Command::Guide { facing: Some(Facing::Back), again: true };
        assert_eq!(Command::parse(" guide BACK again ").unwrap(), again);
        for wrong in ["", "fly", "record now", "guide away", "x"] {
            assert!(Command::parse(wrong).is_err(), "{wrong}");
        }
    }
}
