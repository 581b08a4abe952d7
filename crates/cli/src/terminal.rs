//! Commands from standard input: single keys on a terminal, or lines (for screen readers and pipes).

use cairn_phrases::Language;
use cairn_session::{Command, CommandError, help};
use std::io::{BufRead, IsTerminal, Read};
use std::sync::mpsc::{Receiver, Sender, channel};

/// A line or key that is no command; the text is for the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Mistake {
    /// A line.
    #[error(transparent)]
    Line(#[from] CommandError),
    /// A key: what there are for keys, in the language.
    #[error("{}", help(*.0))]
    Key(Language),
}

/// The source of commands; dropping it restores the terminal's former mode.
pub struct Terminal {
    commands: Option<Receiver<Result<Command, Mistake>>>,
    _raw: Option<raw::Raw>,
}

impl Terminal {
    /// Reads lines if `lines`; else single keys if `keys` and stdin is a terminal; else nothing. Help on the keys is in the
    /// language.
    pub fn new(lines: bool, keys: bool, language: Language) -> Self {
        let (sender, commands) = channel();
        if lines {
            spawn(move || read_lines(std::io::stdin().lock(), &sender));
            return Self { commands: Some(commands), _raw: None };
        }
        let raw = if keys && std::io::stdin().is_terminal() { raw::Raw::begin() } else { None };
        match raw {
            Some(raw) => {
                eprintln!("{}", help(language));
                spawn(move || read_keys(std::io::stdin().lock(), &sender, language));
                Self { commands: Some(commands), _raw: Some(raw) }
            }
            None => Self { commands: None, _raw: None },
        }
    }

    /// The commands received since the last call, and what was none.
    pub fn asked(&self) -> (Vec<Command>, Vec<Mistake>) {
        let (mut commands, mut mistakes) = (Vec::new(), Vec::new());
        for answer in self.commands.iter().flat_map(Receiver::try_iter) {
            match answer {
                Ok(command) => commands.push(command),
                Err(why) => mistakes.push(why),
            }
        }
        (commands, mistakes)
    }

    /// Passes every command to `to` from now on; invalid ones are reported on stderr.
    pub fn forward(&mut self, mut to: impl FnMut(Command) + Send + 'static) {
        let Some(commands) = self.commands.take() else { return };
        spawn(move || {
            for answer in commands {
                match answer {
                    Ok(command) => to(command),
                    Err(why) => eprintln!("{why}"),
                }
            }
        });
    }
}

/// The mode of the terminal, if standard input is one.
#[cfg(unix)]
pub struct Mode(Option<rustix::termios::Termios>);

#[cfg(unix)]
impl Mode {
    /// As it is now.
    pub fn now() -> Self {
        Self(rustix::termios::tcgetattr(rustix::stdio::stdin()).ok())
    }

    /// Sets it again: a process that was killed left the terminal as it used it.
    pub fn restore(&self) {
        if let Some(mode) = &self.0 {
            // There is nobody left to report an error to.
            let now = rustix::termios::OptionalActions::Now;
            let _ = rustix::termios::tcsetattr(rustix::stdio::stdin(), now, mode);
        }
    }
}

/// A thread that ends with the process: it may wait for input forever.
fn spawn(work: impl FnOnce() + Send + 'static) {
    // If the thread cannot be started, the run continues without commands.
    let _ = std::thread::Builder::new().name("cairn-terminal".into()).spawn(work);
}

fn read_lines(input: impl BufRead, sender: &Sender<Result<Command, Mistake>>) {
    for line in input.lines().map_while(Result::ok).filter(|l| !l.trim().is_empty()) {
        if sender.send(Command::parse(&line).map_err(Mistake::from)).is_err() {
            return;
        }
    }
}

fn read_keys(mut input: impl Read, sender: &Sender<Result<Command, Mistake>>, language: Language) {
    let mut key = [0];
    while input.read_exact(&mut key).is_ok() {
        let answer = match key[0] {
            // Control-C and Control-D: a raw terminal sends no signal.
            3 | 4 => Ok(Command::Quit),
            b'\r' | b'\n' | b' ' => continue,
            key => Command::of_key(char::from(key)).ok_or(Mistake::Key(language)),
        };
        if sender.send(answer).is_err() {
            return;
        }
    }
}

#[cfg(unix)]
mod raw {
    use rustix::termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcsetattr};

    /// A terminal in raw mode: single keys without echo.
    pub struct Raw(Termios);

    impl Raw {
        /// `None` if standard input is not a terminal.
        pub fn begin() -> Option<Self> {
            let input = rustix::stdio::stdin();
            let before = tcgetattr(input).ok()?;
            let mut keys = before.clone();
            keys.local_modes -= LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG;
            tcsetattr(input, OptionalActions::Now, &keys).ok()?;
            let former = before.clone();
            crate::interrupt::before_exit(move || {
                let _ = tcsetattr(rustix::stdio::stdin(), OptionalActions::Now, &former);
            });
            Some(Self(before))
        }
    }

    impl Drop for Raw {
        fn drop(&mut self) {
            // There is nobody left to report an error to.
            let _ = tcsetattr(rustix::stdio::stdin(), OptionalActions::Now, &self.0);
        }
    }
}

#[cfg(not(unix))]
mod raw {
    /// Single keys are not supported on this system; lines are.
    pub struct Raw;

    impl Raw {
        pub fn begin() -> Option<Self> {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_keys_parse_to_the_same_commands() {
        let (sender, answers) = channel();
        read_lines("record\n\nstop\nfly\nquit\n".as_bytes(), &sender);
        read_keys("R s\nz\u{3}".as_bytes(), &sender, Language::English);
        drop(sender);
        let all: Vec<_> = answers.iter().collect();
        assert_eq!(all[0], Ok(Command::Record));
        assert_eq!(all[1], Ok(Command::Stop));
        assert!(all[2].is_err() && all[6].is_err());
        assert_eq!(all[3], Ok(Command::Quit));
        assert_eq!(all[4..6], [Ok(Command::Record), Ok(Command::Stop)]);
        assert_eq!(all[7], Ok(Command::Quit));
    }
}
