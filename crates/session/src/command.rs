//! The commands of a session, the same everywhere: keys on a terminal or the page, lines for screen readers and
//! scripts.

use crate::settings::{self, Setting, SettingError};
use cairn_guide::{Facing, Side};
use cairn_phrases::Language;
use std::path::PathBuf;

/// Which route.
#[derive(Clone, Debug, PartialEq)]
pub enum RouteChoice {
    /// The one recorded last.
    Latest,
    /// The one with this number in the folder of the routes.
    Number(u32),
    /// The one in this file.
    File(PathBuf),
}

/// What a walker can ask for.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Start recording the route.
    Record,
    /// End the recording; the route can be walked home from now on.
    Stop,
    /// Say which routes there are.
    Routes,
    /// Load a recorded route: it is the one at hand from then on.
    Load(RouteChoice),
    /// Give a route a name: this one, else the one at hand.
    Rename(Option<u32>, String),
    /// Delete a route after asking: this one, else the one at hand.
    Delete(Option<u32>),
    /// Answer the question that was asked.
    Answer(bool),
    /// Remember this place for the next note.
    Mark,
    /// Note what is here, in the route being recorded.
    Note {
        /// What is here; may be empty.
        text: String,
        /// On which side, as the camera looks.
        side: Option<Side>,
    },
    /// Start guidance along the route.
    Guide {
        /// How the camera is mounted relative to the walker; the session's default without it.
        facing: Option<Facing>,
        /// From start to end as it was recorded, instead of home.
        again: bool,
    },
    /// Guide over the recorded routes to this place; without one, say which places there are.
    TakeMe(String),
    /// Say nothing of the route any more until [`Command::Resume`].
    Pause,
    /// Go on with guidance that was paused, from here.
    Resume,
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

/// Why a line is not a command; the text is for the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CommandError {
    /// Nothing is written there.
    #[error("an empty line is not a command")]
    Empty,
    /// There is no such command.
    #[error("\"{0}\" is not a command; {help}", help = help(Language::English))]
    Unknown(String),
    /// Words follow that the command does not take.
    #[error("unexpected \"{word}\" after \"{after}\"")]
    Unexpected {
        /// The first of them.
        word: String,
        /// The command.
        after: String,
    },
    /// A route is to be named, and how is not written.
    #[error("a name is missing: write rename 3 to the kitchen")]
    NoName,
    /// Where a route's number must be.
    #[error("\"{0}\" is not the number of a route")]
    NotANumber(String),
    /// "take" without "me".
    #[error("write take me to the name of a place, or take me to hear which there are")]
    TakeMe,
    /// A way of guidance that does not exist.
    #[error("guide {0}: write guide home, back or backwards, and again")]
    Guide(String),
    /// A setting that does not exist, or its value.
    #[error(transparent)]
    Setting(#[from] SettingError),
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
pub const KEYS: [Key; 17] = [
    key('r', "record", "key-record"),
    key('s', "stop", "key-stop"),
    key('n', "note", "key-note"),
    key('o', "routes", "key-routes"),
    key('l', "load", "key-load"),
    key('d', "delete", "key-delete"),
    key('y', "yes", "key-yes"),
    key('x', "no", "key-no"),
    key('g', "guide", "key-guide"),
    key('t', "take me", "key-take-me"),
    key('b', "backwards", "key-backwards"),
    key('u', "pause", "key-pause"),
    key('c', "resume", "key-resume"),
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
    let lines = format!(
        "load NUMBER|FILE (1-9), rename [NUMBER] NAME, delete [NUMBER], mark, note [left|right] TEXT, guide \
         home|back|backwards [again], take me to PLACE, {}",
        settings::FORMS
    );
    format!("{}; {}", keys.join(", "), language.say("key-lines", &[("lines", (&lines).into())]))
}

impl Command {
    /// The command of a key, in either case.
    pub fn of_key(key: char) -> Option<Self> {
        let key = key.to_ascii_lowercase();
        if let Some(number) = key.to_digit(10).filter(|n| *n > 0) {
            return Some(Self::Load(RouteChoice::Number(number)));
        }
        KEYS.iter().find(|k| k.key == key).and_then(|k| Self::parse(k.line).ok())
    }

    /// Parses a line: one of those that [`help`] lists, or a single key.
    ///
    /// # Errors
    /// What is wrong with the line.
    pub fn parse(line: &str) -> Result<Self, CommandError> {
        let mut words = line.split_whitespace();
        let first = words.next().ok_or(CommandError::Empty)?.to_lowercase();
        let rest: Vec<&str> = words.collect();
        let command = match first.as_str() {
            "record" => Self::Record,
            "stop" => Self::Stop,
            "routes" | "list" => Self::Routes,
            "load" => return Ok(Self::Load(which(after(line)))),
            "rename" => return rename(after(line)),
            "note" => return Ok(note(after(line))),
            "delete" => return delete(&rest),
            "take" => return take_me(after(line)),
            "mark" => Self::Mark,
            "yes" => Self::Answer(true),
            "no" => Self::Answer(false),
            "guide" => return guide(&rest),
            "set" => return Ok(Self::Set(Setting::parse(&rest)?)),
            "pause" => Self::Pause,
            "resume" | "continue" => Self::Resume,
            "halt" => Self::Halt,
            "backwards" => Self::Guide { facing: Some(Facing::Backwards), again: false },
            "repeat" => Self::Repeat,
            "status" => Self::Status,
            "quit" | "exit" => Self::Quit,
            one => {
                let mut letters = one.chars();
                let key = letters.next().filter(|_| letters.next().is_none()).and_then(Self::of_key);
                key.ok_or_else(|| CommandError::Unknown(one.to_owned()))?
            }
        };
        match rest.first() {
            None => Ok(command),
            Some(word) => Err(unexpected(word, &first)),
        }
    }
}

fn unexpected(word: &str, after: &str) -> CommandError {
    CommandError::Unexpected { word: word.to_owned(), after: after.to_owned() }
}

/// What follows the first word of a line.
fn after(line: &str) -> &str {
    line.trim().split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim())
}

fn which(text: &str) -> RouteChoice {
    match (text.is_empty(), text.parse()) {
        (true, _) => RouteChoice::Latest,
        (_, Ok(number)) => RouteChoice::Number(number),
        _ => RouteChoice::File(text.into()),
    }
}

fn rename(text: &str) -> Result<Command, CommandError> {
    let numbered = text.split_once(char::is_whitespace).and_then(|(n, name)| Some((n.parse().ok()?, name)));
    let (number, name) = match numbered {
        Some((number, name)) => (Some(number), name.trim()),
        None => (None, text),
    };
    match name.is_empty() || number.is_none() && name.parse::<u32>().is_ok() {
        true => Err(CommandError::NoName),
        false => Ok(Command::Rename(number, name.to_owned())),
    }
}

fn delete(words: &[&str]) -> Result<Command, CommandError> {
    match words {
        [] => Ok(Command::Delete(None)),
        [number] => {
            let number = number.parse().map_err(|_| CommandError::NotANumber((*number).to_owned()))?;
            Ok(Command::Delete(Some(number)))
        }
        [_, more, ..] => Err(unexpected(more, "delete")),
    }
}

/// "take me to the kitchen" and "take me kitchen"; "take me" alone asks for the places.
fn take_me(text: &str) -> Result<Command, CommandError> {
    let (me, to) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    match me.eq_ignore_ascii_case("me") {
        true => Ok(Command::TakeMe(to.trim().to_owned())),
        false => Err(CommandError::TakeMe),
    }
}

/// "left door", "door on the left" and "door on my left" are the same note.
fn note(text: &str) -> Command {
    let lower = text.to_lowercase();
    for (side, word) in [(Side::Left, "left"), (Side::Right, "right")] {
        let begins = lower.strip_prefix(word).is_some_and(|rest| rest.starts_with(char::is_whitespace));
        if begins {
            return Command::Note { text: text[word.len()..].trim().to_owned(), side: Some(side) };
        }
        for lead in ["on the", "to the", "on my", "to my", "on your", "to your"] {
            let ending = format!(" {lead} {word}");
            // Lower-case letters may have another length: only where both agree the ending can be cut off.
            if lower.len() == text.len() && lower.trim_end_matches('.').ends_with(&ending) {
                let end = lower.trim_end_matches('.').len() - ending.len();
                return Command::Note { text: text[..end].trim().to_owned(), side: Some(side) };
            }
        }
    }
    Command::Note { text: text.to_owned(), side: None }
}

fn guide(words: &[&str]) -> Result<Command, CommandError> {
    let (mut facing, mut again) = (None, false);
    for word in words {
        match word.to_lowercase().as_str() {
            "home" => facing = Some(Facing::Home),
            "back" => facing = Some(Facing::Back),
            "backwards" => facing = Some(Facing::Backwards),
            "again" => again = true,
            other => return Err(CommandError::Guide(other.to_owned())),
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
            ('u', "pause"),
            ('c', "resume"),
            ('b', "backwards"),
            ('b', "guide backwards"),
            ('p', "repeat"),
            ('o', "routes"),
            ('d', "delete"),
            ('y', "yes"),
            ('x', "no"),
            ('n', "note"),
            ('3', "load 3"),
            ('t', "take me"),
            ('q', "quit"),
        ] {
            let command = Command::of_key(key).unwrap();
            assert_eq!(Command::parse(line).unwrap(), command);
            assert_eq!(Command::parse(&key.to_string()).unwrap(), command);
        }
        let load = |line: &str| match Command::parse(line).unwrap() {
            Command::Load(which) => which,
            other => panic!("{other:?}"),
        };
        assert_eq!(load("load my route.route"), RouteChoice::File("my route.route".into()));
        assert_eq!(
            (load("load"), load("load 12"), load("7")),
            (RouteChoice::Latest, RouteChoice::Number(12), RouteChoice::Number(7))
        );
        assert_eq!(
            Command::parse("rename 3 to the  kitchen"),
            Ok(Command::Rename(Some(3), "to the  kitchen".into()))
        );
        assert_eq!(Command::parse("rename home"), Ok(Command::Rename(None, "home".into())));
        assert_eq!(Command::parse("delete 4"), Ok(Command::Delete(Some(4))));
        assert_eq!(
            Command::parse("take me  to the kitchen start"),
            Ok(Command::TakeMe("to the kitchen start".into()))
        );
        assert!(Command::parse("take").is_err() && Command::parse("take it").is_err());
        let note = |line: &str| match Command::parse(line).unwrap() {
            Command::Note { text, side } => (text, side),
            other => panic!("{other:?}"),
        };
        let door = ("door".to_owned(), Some(Side::Left));
        assert_eq!((note("note left door"), note("note door on the left.")), (door.clone(), door.clone()));
        assert_eq!(note("note door on my LEFT"), door);
        assert_eq!(note("note rightmost door"), ("rightmost door".to_owned(), None));
        assert_eq!(note("note İ on the left").0, "İ on the left");
        assert_eq!(note("n"), (String::new(), None));
        assert_eq!(
            Command::parse("set language de").unwrap(),
            Command::Set(Setting::Language(Language::German))
        );
        let again = Command::Guide { facing: Some(Facing::Back), again: true };
        assert_eq!(Command::parse(" guide BACK again ").unwrap(), again);
        for wrong in [
            "",
            "set",
            "set language xx",
            "fly",
            "record now",
            "guide away",
            "z",
            "rename",
            "rename 3 ",
            "delete x",
            "delete 1 2",
            "yes please",
        ] {
            assert!(Command::parse(wrong).is_err(), "{wrong}");
        }
    }
}
