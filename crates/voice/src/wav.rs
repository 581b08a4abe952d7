//! Utterances and earcons as a stereo WAV file, each at its time: what a walker would have heard.
//!
//! The file is complete up to the present at every moment: samples are appended as time passes, and the lengths in its
//! header (RIFF WAVE, 16-bit PCM) are updated once a second.

use crate::earcon::earcon;
use crate::espeak::Espeak;
use crate::{Voice, VoiceError};
use cairn_guide::Earcon;
use cairn_phrases::Language;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

/// Sample rate of the file: that of espeak-ng.
const RATE: u32 = 22_050;
const HEAD: u64 = 44;

/// Writes a WAV file.
pub struct WavVoice {
    out: File,
    espeak: Espeak,
    /// Number of samples written.
    done: u64,
    /// Samples that follow: words, which can be interrupted, and earcons, which are short.
    words: VecDeque<f32>,
    sounds: VecDeque<[f32; 2]>,
    headed: u64,
    failed: Option<String>,
}

impl WavVoice {
    /// Creates a file; an existing one is overwritten.
    ///
    /// # Errors
    /// When it cannot be created.
    pub fn create(path: &Path, espeak: Espeak) -> Result<Self, VoiceError> {
        let fail = |e: io::Error| VoiceError {
            why: format!("{}: {e}", path.display()),
            cure: "check that its folder exists and is writable".into(),
        };
        let mut out = File::create(path).map_err(fail)?;
        out.write_all(&head(0)).map_err(fail)?;
        Ok(Self {
            out,
            espeak,
            done: 0,
            words: VecDeque::new(),
            sounds: VecDeque::new(),
            headed: 0,
            failed: None,
        })
    }

    /// Writes up to a time.
    fn write_until(&mut self, t_s: f64) {
        let until = (t_s.max(0.0) * f64::from(RATE)) as u64;
        if until <= self.done {
            return;
        }
        let count = (until - self.done) as usize;
        let mut bytes = Vec::with_capacity(4 * count);
        for _ in 0..count {
            let word = self.words.pop_front().unwrap_or(0.0);
            let sound = self.sounds.pop_front().unwrap_or([0.0; 2]);
            for s in sound {
                let v = (0.8 * word + s).clamp(-1.0, 1.0);
                bytes.extend(((v * 32767.0) as i16).to_le_bytes());
            }
        }
        self.done = until;
        let mut wrote = self.out.write_all(&bytes);
        if wrote.is_ok() && self.done - self.headed >= u64::from(RATE) {
            wrote = self.set_head();
        }
        if let Err(e) = wrote {
            self.failed = Some(e.to_string());
        }
    }

    fn set_head(&mut self) -> io::Result<()> {
        self.headed = self.done;
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(&head(self.done))?;
        self.out.seek(SeekFrom::Start(HEAD + 4 * self.done)).map(|_| ())
    }
}

/// The header of a file with this many stereo samples.
fn head(samples: u64) -> [u8; HEAD as usize] {
    // More than four hours exceed the length field of the format.
    let data = u32::try_from(4 * samples).unwrap_or(u32::MAX - 36);
    let mut head = [0; HEAD as usize];
    head[..4].copy_from_slice(b"RIFF");
    head[4..8].copy_from_slice(&(data + 36).to_le_bytes());
    head[8..16].copy_from_slice(b"WAVEfmt ");
    head[16..20].copy_from_slice(&16_u32.to_le_bytes());
    head[20..22].copy_from_slice(&1_u16.to_le_bytes());
    head[22..24].copy_from_slice(&2_u16.to_le_bytes());
    head[24..28].copy_from_slice(&RATE.to_le_bytes());
    head[28..32].copy_from_slice(&(4 * RATE).to_le_bytes());
    head[32..34].copy_from_slice(&4_u16.to_le_bytes());
    head[34..36].copy_from_slice(&16_u16.to_le_bytes());
    head[36..40].copy_from_slice(b"data");
    head[40..].copy_from_slice(&data.to_le_bytes());
    head
}

/// The samples resampled to another rate, by linear interpolation.
fn at_rate(samples: &[f32], from: u32) -> Vec<f32> {
    if from == RATE || samples.len() < 2 {
        return samples.to_vec();
    }
    let step = f64::from(from) / f64::from(RATE);
    let count = ((samples.len() - 1) as f64 / step) as usize;
    (0..count)
        .map(|k| {
            let at = k as f64 * step;
            let (i, part) = (at as usize, at.fract() as f32);
            samples[i] * (1.0 - part) + samples[i + 1] * part
        })
        .collect()
}

impl Voice for WavVoice {
    fn set_language(&mut self, language: Language) {
        self.espeak.set_language(language);
    }

    fn say(&mut self, text: &str, t_s: f64, interrupts: bool) {
        self.write_until(t_s);
        if interrupts {
            self.words.clear();
        }
        match self.espeak.samples(text) {
            Ok((samples, rate)) => self.words.extend(at_rate(&samples, rate)),
            Err(e) => self.failed = Some(e.to_string()),
        }
    }

    fn sound(&mut self, sound: Earcon, bearing_rad: f64, t_s: f64) {
        self.write_until(t_s);
        let new = earcon(sound, bearing_rad, RATE);
        if self.sounds.len() < new.len() {
            self.sounds.resize(new.len(), [0.0; 2]);
        }
        for (s, n) in self.sounds.iter_mut().zip(new) {
            *s = [s[0] + n[0], s[1] + n[1]];
        }
    }

    fn pass(&mut self, t_s: f64) {
        self.write_until(t_s);
    }

    fn end(&mut self) -> Result<(), VoiceError> {
        let left = self.words.len().max(self.sounds.len()) as f64;
        self.write_until((self.done as f64 + left) / f64::from(RATE) + 0.2);
        if let Err(e) = self.set_head().and_then(|()| self.out.sync_all()) {
            self.failed = Some(e.to_string());
        }
        match self.failed.take() {
            Some(why) => {
                Err(VoiceError { why, cure: "make room on the disk, and try espeak-ng by itself".into() })
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::espeak::SpeechConfig;

    fn samples(path: &Path) -> Vec<[i16; 2]> {
        let bytes = std::fs::read(path).unwrap();
        assert_eq!(&bytes[..4], b"RIFF");
        let stated = u32::from_le_bytes(bytes[40..44].try_into().unwrap()) as usize;
        assert!(stated <= bytes.len() - 44, "the header states {stated} of {}", bytes.len() - 44);
        let four = bytes[44..44 + stated].chunks_exact(4);
        four.map(|b| [i16::from_le_bytes([b[0], b[1]]), i16::from_le_bytes([b[2], b[3]])]).collect()
    }

    fn loudest(samples: &[[i16; 2]], from_s: f64, to_s: f64) -> i16 {
        let at = |s: f64| ((s * f64::from(RATE)) as usize).min(samples.len());
        samples[at(from_s)..at(to_s)].iter().flatten().map(|v| v.saturating_abs()).max().unwrap_or(0)
    }

    #[test]
    fn wav_timing_and_interruption() {
        let Ok(espeak) = Espeak::find(SpeechConfig::default()) else {
            println!("skipped: espeak-ng is not installed");
            return;
        };
        let path = std::env::temp_dir().join(format!("cairn-voice-{}.wav", std::process::id()));
        let mut voice = WavVoice::create(&path, espeak).unwrap();
        voice.pass(0.5);
        voice.say("The route is forty metres. Continue ten metres, then turn left.", 1.0, false);
        voice.sound(Earcon::Stop, 1.5, 2.0);
        voice.say("Stop.", 2.0, true);
        voice.pass(5.0);
        // The file is complete at every moment, as after a crash.
        assert!(samples(&path).len() >= 4 * RATE as usize);
        voice.end().unwrap();
        let all = samples(&path);
        assert!((all.len() as f64 / f64::from(RATE) - 5.2).abs() < 0.01);
        assert_eq!(loudest(&all, 0.0, 0.99), 0);
        assert!(loudest(&all, 1.0, 2.0) > 2000 && loudest(&all, 2.0, 2.4) > 2000);
        assert_eq!(loudest(&all, 3.5, 5.0), 0, "the long sentence was not cut off");
        let _ = std::fs::remove_file(path);
    }
}
