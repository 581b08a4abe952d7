//! The commands of a session, each of which is answered in words.

use super::Session;
use crate::command::Command;
use crate::refused::Refused;
use crate::slam::Slam;
use cairn_guide::Priority;
use std::path::Path;

impl<S: Slam> Session<S> {
    /// Carries out a command; returns the result in words, which are also said.
    ///
    /// # Errors
    /// Why the command could not be carried out; its words are also said.
    pub fn command(&mut self, command: &Command) -> Result<String, Refused> {
        // Whatever else is asked for, the question is no longer open.
        if !matches!(command, Command::Answer(_) | Command::Repeat | Command::Status) {
            self.asked = None;
        }
        let done = match command {
            Command::Record => self.begin_recording(None),
            Command::Stop => self.end_recording(),
            Command::Routes => Ok(self.list_words()),
            Command::Load(which) => self.load(which),
            Command::Rename(number, name) => self.rename(*number, name),
            Command::Delete(number) => self.ask_delete(*number),
            Command::Answer(yes) => self.take_answer(*yes),
            Command::Mark => self.mark(),
            Command::Note { text, side } => self.note(text, *side),
            Command::Guide { facing, again } => {
                self.begin_guiding(facing.unwrap_or(self.config.facing), *again)
            }
            Command::TakeMe(to) => self.take_me(to),
            Command::Pause => self.pause(),
            Command::Resume => self.resume(),
            Command::Halt => match self.guiding.take() {
                Some(_) => {
                    self.speech.drop_waiting();
                    Ok(self.speech.text("walk-guidance-ended"))
                }
                None => Err(self.speech.refuse("walk-not-guiding")),
            },
            Command::Repeat => {
                self.speech.repeat(self.now);
                self.speak();
                match self.speech.last_words() {
                    "" => Ok(self.speech.text("walk-nothing-to-repeat")),
                    words => return Ok(words.to_owned()),
                }
            }
            Command::Status => Ok(self.status_words()),
            Command::Quit => Ok(self.speech.text("walk-goodbye")),
            Command::Set(setting) => {
                // Not said: the page sets what it keeps at every connection.
                self.speech.set(*setting);
                return Ok(self.speech.text("walk-set"));
            }
        };
        self.answer(done)
    }

    /// Starts recording into this new file, otherwise as [`Command::Record`].
    ///
    /// # Errors
    /// As [`Session::command`].
    pub fn record_to(&mut self, path: &Path) -> Result<String, Refused> {
        let done = self.begin_recording(Some(path.to_owned()));
        self.answer(done)
    }

    /// Says the result of a command.
    pub(super) fn answer(&mut self, done: Result<String, Refused>) -> Result<String, Refused> {
        let words = done.as_ref().unwrap_or_else(|why| &why.words).clone();
        self.say(&words, Priority::High);
        self.speak();
        done
    }
}
