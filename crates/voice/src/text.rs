//! Utterances as lines of text, for a screen reader on a terminal.

use crate::{Voice, VoiceError};
use cairn_guide::Earcon;
use std::io::Write;

/// One line for each utterance, with its time.
pub struct TextVoice<W> {
    out: W,
    failed: Option<String>,
}

impl<W: Write> TextVoice<W> {
    /// Writes to `out`.
    pub fn new(out: W) -> Self {
        Self { out, failed: None }
    }
}

impl<W: Write + Send> Voice for TextVoice<W> {
    fn say(&mut self, text: &str, t_s: f64, _: bool) {
        // Rounded to tenths first, so that no minute has 60 seconds.
        let tenths = (t_s.max(0.0) * 10.0).round() as u64;
        let (minutes, seconds) = (tenths / 600, (tenths % 600) as f64 / 10.0);
        let line = writeln!(self.out, "{minutes}:{seconds:04.1}  {text}").and_then(|()| self.out.flush());
        if let Err(e) = line {
            self.failed = Some(e.to_string());
        }
    }

    fn sound(&mut self, _: Earcon, _: f64, _: f64) {}

    fn pass(&mut self, _: f64) {}

    fn end(&mut self) -> Result<(), VoiceError> {
        match self.failed.take() {
            // A reader that has closed the pipe is not an error.
            Some(why) if !why.contains("roken pipe") => {
                Err(VoiceError { why, cure: "check where the output is sent".into() })
            }
            _ => Ok(()),
        }
    }
}

/// A voice that says nothing.
pub struct NoVoice;

impl Voice for NoVoice {
    fn say(&mut self, _: &str, _: f64, _: bool) {}
    fn sound(&mut self, _: Earcon, _: f64, _: f64) {}
    fn pass(&mut self, _: f64) {}
    fn end(&mut self) -> Result<(), VoiceError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_formatted_as_a_clock() {
        let mut out = Vec::new();
        let mut voice = TextVoice::new(&mut out);
        for t in [0.0, 59.97, 61.04, 600.0, -3.0] {
            voice.say("x", t, false);
        }
        assert_eq!(
            String::from_utf8(out).unwrap(),
            "0:00.0  x\n1:00.0  x\n1:01.0  x\n10:00.0  x\n0:00.0  x\n"
        );
    }
}
