//! Runs the `espeak-ng` program as a child process, one for each utterance: it can be interrupted, and is restarted
//! when it was killed. It is never linked (its licence is the GPL). Earcons go through `aplay` where that is
//! installed.

use crate::earcon::earcon;
use crate::{Voice, VoiceError};
use cairn_guide::{Earcon, RATES, WORDS_PER_MINUTE};
use cairn_phrases::Language;
use std::ffi::OsString;
use std::io::{ErrorKind, Read, Write};
use std::process::{Child, Command, Stdio};

/// Language, rate and volume of speech.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeechConfig {
    /// The language, which chooses the voice.
    pub language: Language,
    /// Of [`RATES`]; 1 is 180 words a minute.
    pub rate: f64,
    /// 0 to 1.
    pub volume: f64,
}

impl Default for SpeechConfig {
    fn default() -> Self {
        Self { language: Language::default(), rate: 1.0, volume: 1.0 }
    }
}

/// How to start the program.
#[derive(Clone, Debug)]
pub struct Espeak {
    program: OsString,
    config: SpeechConfig,
}

/// How often the same words are started again when their child process dies.
const AGAIN: usize = 2;
/// Sample rate of the earcons.
const RATE: u32 = 22_050;

impl Espeak {
    /// Checks whether the program is installed.
    ///
    /// # Errors
    /// When it is not, with what to install.
    pub fn find(config: SpeechConfig) -> Result<Self, VoiceError> {
        Self::named("espeak-ng", config)
    }

    /// With another program that takes the same arguments, for tests.
    ///
    /// # Errors
    /// As [`Espeak::find`].
    pub fn named(program: impl Into<OsString>, config: SpeechConfig) -> Result<Self, VoiceError> {
        let program = program.into();
        let tried = Command::new(&program)
            .arg("--version")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        match tried {
            Ok(_) => Ok(Self { program, config }),
            Err(e) if e.kind() == ErrorKind::NotFound => Err(VoiceError {
                why: format!("{} is not installed, and speaks for Cairn", program.to_string_lossy()),
                cure: "install it (Debian, Ubuntu: apt install espeak-ng), or choose --say text".into(),
            }),
            Err(e) => {
                Err(VoiceError { why: e.to_string(), cure: "check that espeak-ng can be started".into() })
            }
        }
    }

    /// Chooses the voice of a language.
    pub fn set_language(&mut self, language: Language) {
        self.config.language = language;
    }

    /// Starts the program with the words on its standard input; `extra` are its first arguments.
    fn start(&self, text: &str, extra: &[&str], out: Stdio) -> std::io::Result<Child> {
        let speed = (WORDS_PER_MINUTE * self.config.rate.clamp(RATES[0], RATES[1])).round().max(80.0);
        let loud = (100.0 * self.config.volume.clamp(0.0, 1.0)).round();
        let mut child = Command::new(&self.program)
            .args([
                "-v",
                self.config.language.code(),
                "-s",
                &format!("{speed}"),
                "-a",
                &format!("{loud}"),
                "--stdin",
            ])
            .args(extra)
            .stdin(Stdio::piped())
            .stdout(out)
            .stderr(Stdio::null())
            .spawn()?;
        if let Some(mut pipe) = child.stdin.take() {
            // A child process that died already is detected later.
            let _ = pipe.write_all(text.as_bytes());
        }
        Ok(child)
    }

    /// The words as samples in -1..1, and the sample rate.
    ///
    /// # Errors
    /// When the program fails or returns no sound.
    pub fn samples(&self, text: &str) -> Result<(Vec<f32>, u32), VoiceError> {
        let fail = |why: String| VoiceError { why, cure: "try espeak-ng by itself".into() };
        let mut child = self.start(text, &["--stdout"], Stdio::piped()).map_err(|e| fail(e.to_string()))?;
        let mut bytes = Vec::new();
        if let Some(mut out) = child.stdout.take() {
            out.read_to_end(&mut bytes).map_err(|e| fail(e.to_string()))?;
        }
        let _ = child.wait();
        read_wav(&bytes).ok_or_else(|| fail("espeak-ng returned no sound".into()))
    }
}

/// Samples of a streamed WAV file with one channel of 16 bits: the lengths in its header are not reliable.
fn read_wav(bytes: &[u8]) -> Option<(Vec<f32>, u32)> {
    let rate = u32::from_le_bytes(bytes.get(24..28)?.try_into().ok()?);
    let data = 8 + bytes.windows(4).take(4096).position(|w| w == b"data")?;
    let samples = bytes.get(data..)?.chunks_exact(2);
    let samples = samples.map(|b| f32::from(i16::from_le_bytes([b[0], b[1]])) / 32768.0).collect();
    ((4000..=192_000).contains(&rate) && bytes.starts_with(b"RIFF")).then_some((samples, rate))
}

/// Speaks aloud, immediately.
pub struct EspeakVoice {
    espeak: Espeak,
    /// The present utterance, its child process, and how often it was started.
    speaking: Option<(String, Child, usize)>,
    /// The utterance that comes next.
    waiting: Option<String>,
    sounds: Vec<Child>,
    can_play: bool,
    restarts: usize,
    failed: Option<String>,
}

impl EspeakVoice {
    /// A voice that has said nothing yet.
    pub fn new(espeak: Espeak) -> Self {
        let mut probe = Command::new("aplay");
        let probe = probe.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let can_play = probe.status().is_ok_and(|s| s.success());
        Self {
            espeak,
            speaking: None,
            waiting: None,
            sounds: Vec::new(),
            can_play,
            restarts: 0,
            failed: None,
        }
    }

    /// How often a child process that died was started again.
    pub fn restarts(&self) -> usize {
        self.restarts
    }

    /// The process id of the present utterance, if any.
    pub fn child_id(&self) -> Option<u32> {
        self.speaking.as_ref().map(|(_, child, _)| child.id())
    }

    fn begin(&mut self, text: String, times: usize) {
        match self.espeak.start(&text, &[], Stdio::null()) {
            Ok(child) => self.speaking = Some((text, child, times)),
            Err(e) => self.failed = Some(e.to_string()),
        }
    }

    fn stop(&mut self) {
        self.waiting = None;
        if let Some((_, mut child, _)) = self.speaking.take() {
            // It may have ended by itself.
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    /// Checks whether the child process has ended; one that was killed is started again.
    fn check_child(&mut self) {
        let Some((_, child, _)) = &mut self.speaking else { return };
        let Ok(Some(status)) = child.try_wait() else { return };
        let Some((text, _, times)) = self.speaking.take() else { return };
        if status.success() {
            if let Some(next) = self.waiting.take() {
                self.begin(next, 1);
            }
        } else if times <= AGAIN {
            self.restarts += 1;
            self.begin(text, times + 1);
        } else {
            self.failed = Some(format!("espeak-ng ended with {status}"));
            if let Some(next) = self.waiting.take() {
                self.begin(next, 1);
            }
        }
    }
}

impl Voice for EspeakVoice {
    fn set_language(&mut self, language: Language) {
        self.espeak.set_language(language);
    }

    fn say(&mut self, text: &str, _: f64, interrupts: bool) {
        self.check_child();
        if interrupts {
            self.stop();
        }
        match self.speaking {
            // The announcer's estimate was too short: the new text waits for the end of the present one.
            Some(_) => self.waiting = Some(text.to_owned()),
            None => self.begin(text.to_owned(), 1),
        }
    }

    fn sound(&mut self, sound: Earcon, bearing_rad: f64, _: f64) {
        self.sounds.retain_mut(|child| matches!(child.try_wait(), Ok(None)));
        if !self.can_play || self.sounds.len() > 3 {
            return;
        }
        let volume = self.espeak.config.volume.clamp(0.0, 1.0) as f32;
        let pcm: Vec<u8> = (earcon(sound, bearing_rad, RATE).iter().flatten())
            .flat_map(|v| ((v * volume * 32767.0) as i16).to_le_bytes())
            .collect();
        let player = Command::new("aplay")
            .args(["-q", "-t", "raw", "-f", "S16_LE", "-c", "2", "-r", &RATE.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        if let Ok(mut player) = player {
            // An earcon fits into the pipe, so this does not block.
            if let Some(mut pipe) = player.stdin.take() {
                let _ = pipe.write_all(&pcm);
            }
            self.sounds.push(player);
        }
    }

    fn pass(&mut self, _: f64) {
        self.check_child();
    }

    fn end(&mut self) -> Result<(), VoiceError> {
        while self.speaking.is_some() {
            self.check_child();
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        for child in &mut self.sounds {
            let _ = child.wait();
        }
        match self.failed.take() {
            Some(why) => Err(VoiceError { why, cure: "check the sound device, or choose --say text".into() }),
            None => Ok(()),
        }
    }
}

impl Drop for EspeakVoice {
    fn drop(&mut self) {
        self.stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;
    use std::time::{Duration, Instant};

    /// A program that takes espeak's arguments, writes down its input, and runs for some time.
    fn fake(name: &str, body: &str) -> (Espeak, PathBuf) {
        let folder = std::env::temp_dir().join(format!("cairn-voice-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        let (program, log) = (folder.join("speak"), folder.join("log"));
        let script = format!("#!/bin/sh\n[ \"$1\" = --version ] && exit 0\nLOG={}\n{body}\n", log.display());
        std::fs::write(&program, script).unwrap();
        assert!(Command::new("chmod").arg("+x").arg(&program).status().unwrap().success());
        (Espeak::named(&program, SpeechConfig::default()).unwrap(), log)
    }

    fn until(mut done: impl FnMut() -> bool) {
        let begin = Instant::now();
        while !done() {
            assert!(begin.elapsed() < Duration::from_secs(10), "took too long");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn lines(log: &PathBuf) -> Vec<String> {
        std::fs::read_to_string(log).unwrap_or_default().lines().map(str::to_owned).collect()
    }

    #[test]
    fn missing_program_error_names_package() {
        let error = Espeak::named("no-such-voice-of-cairn", SpeechConfig::default()).unwrap_err();
        assert!(error.to_string().contains("apt install espeak-ng"), "{error}");
    }

    #[test]
    fn urgent_words_interrupt_and_others_wait() {
        let (espeak, log) = fake("order", "printf '%s\\n' \"$(cat)\" >> $LOG; exec sleep 2");
        let mut voice = EspeakVoice::new(espeak);
        voice.say("one", 0.0, false);
        until(|| lines(&log) == ["one"]);
        voice.say("two", 0.1, false);
        let begin = Instant::now();
        voice.say("stop", 0.2, true);
        until(|| lines(&log) == ["one", "stop"]);
        assert!(begin.elapsed() < Duration::from_millis(1500), "{:?}", begin.elapsed());
        voice.say("three", 0.3, false);
        voice.end().unwrap();
        assert_eq!(lines(&log), ["one", "stop", "three"]);
        assert_eq!(voice.restarts(), 0);
    }

    #[test]
    fn the_language_chooses_the_voice() {
        let (espeak, log) = fake("language", "printf '%s\\n' \"$2 $4\" >> $LOG");
        let mut voice = EspeakVoice::new(espeak);
        for language in Language::ALL {
            voice.set_language(language);
            voice.say("1", 0.0, true);
            voice.end().unwrap();
        }
        assert_eq!(lines(&log), ["en 180", "es 180", "de 180"]);
    }

    #[test]
    fn killed_child_restarts_and_repeated_death_is_an_error() {
        let (espeak, log) = fake("killed", "printf '%s\\n' \"$(cat)\" >> $LOG; exec sleep 0.5");
        let mut voice = EspeakVoice::new(espeak);
        voice.say("turn left now", 0.0, false);
        until(|| lines(&log).len() == 1);
        let id = voice.child_id().unwrap().to_string();
        assert!(Command::new("kill").args(["-9", &id]).status().unwrap().success());
        until(|| {
            voice.pass(0.1);
            voice.restarts() == 1
        });
        voice.end().unwrap();
        assert_eq!(lines(&log), ["turn left now", "turn left now"]);

        let (espeak, log) = fake("dies", "printf '%s\\n' \"$(cat)\" >> $LOG; exit 3");
        let mut voice = EspeakVoice::new(espeak);
        voice.say("x", 0.0, false);
        assert!(voice.end().unwrap_err().to_string().contains('3'));
        assert_eq!(lines(&log).len(), 1 + AGAIN);
    }

    #[test]
    fn streamed_wav_header_lengths_are_ignored() {
        let mut bytes = b"RIFF\xff\xff\xff\x7fWAVEfmt \x10\0\0\0\x01\0\x01\0".to_vec();
        bytes.extend(22_050_u32.to_le_bytes());
        bytes.extend([0; 6]);
        bytes.extend([16, 0]);
        bytes.extend(b"data\xff\xff\xff\x7f");
        bytes.extend([0, 64, 0, 192]);
        assert_eq!(read_wav(&bytes), Some((vec![0.5, -0.5], 22_050)));
        assert_eq!(read_wav(&bytes[..30]), None);
        assert_eq!(read_wav(b"no sound"), None);
    }
}
