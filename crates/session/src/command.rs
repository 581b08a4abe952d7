//! The commands of a session, the same everywhere: keys on a terminal or the page, lines for screen readers and
//! scripts.

use crate::settings::{self, Setting};
use cairn_guide::Facing;
use cairn_phrases::Language;
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
    /// Change how Cairn speaks.
    Set(Setting),
    /// End the session.
    Quit,
}

/// A key that gives a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// The key, in lower case.
    pub key: char,
    /// The command as a line.
    pub line: &'static str,
    /// The id of what it does, in the catalogue.
    pub does: &'static str,
}

const fn key(key: char, line: &'static str, does: &'static str) -> Key {
    Key { key, line, does }
}

/// The keys of the terminal, the page and the help.
pub const KEYS: [Key; 9] = [
    key('r', "record", "key-record"),
    key('s', "stop", "key-stop"),
    key('l', "load", "key-load"),
    key('g', "guide", "key-guide"),
    key('b', "backwards", "key-backwards"),
    key('h', "halt", "key-halt"),
    key('p', "repeat", "key-repeat"),
    key('i', "status", "key-status"),
    key('q', "quit", "key-quit"),
];

/// The key of a command given as a line, if it has one.
pub fn key_of(line: &str) -> Option<char> {
    KEYS.iter().find(|k| k.line == line).map(|k| k.key)
}

/// All commands with their keys, for people.
pub fn help(language: Language) -> String {
    let keys: Vec<String> = KEYS.iter().map(|k| format!("{} {}", k.key, language.text(k.does))).collect();
    let lines = format!("load FILE, guide home|back|backwards [again], {}", settings::FORMS);
    format!("{}; {}", keys.join(", "), language.say("key-lines", &[("lines", (&lines).into())]))
}

impl Command {
    /// The command of a key, in either case.
    pub fn of_key(key: char) -> Option<Self> {
        let key = key.to_ascii_lowercase();
        KEYS.iter().find(|k| k.key == key).and_then(|k| Self::parse(k.line).ok())
    }

    /// Parses a line: one of those that [`help`] lists, or a single key.
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
            "set" => return Ok(Self::Set(Setting::parse(&rest)?)),
            "halt" => Self::Halt,
            "backwards" => Self::Guide { facing: Some(Facing::Backwards), again: false },
            "repeat" => Self::Repeat,
            "status" => Self::Status,
            "quit" | "exit" => Self::Quit,
            one => {
                let mut letters = one.chars();
                let key = letters.next().filter(|_| letters.next().is_none()).and_then(Self::of_key);
                key.ok_or_else(|| format!("\"{one}\" is not a command; {}", help(Language::English)))?
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
    fn every_key_is_a_command_that_the_help_names() {
        for language in Language::ALL {
            let help = help(language);
            for k in KEYS {
                assert!(Command::of_key(k.key).is_some(), "{k:?}");
                assert!(help.contains(&format!("{} {}", k.key, language.text(k.does))), "{help}");
            }
        }
        let mut keys = KEYS.map(|k| k.key);
        keys.sort_unstable();
        assert!(keys.windows(2).all(|w| w[0] != w[1]), "one key for two commands: {keys:?}");
    }

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
        assert_eq!(
            Command::parse("set language de").unwrap(),
            Command::Set(Setting::Language(Language::German))
        );
        let again = Command::Guide { facing: Some(Facing::Back), again: true };
        assert_eq!(Command::parse(" guide BACK again ").unwrap(), again);
        for wrong in ["", "set", "set language xx", "fly", "record now", "guide away", "x"] {
            assert!(Command::parse(wrong).is_err(), "{wrong}");
        }
    }
}
