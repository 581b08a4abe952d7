//! A status in words: a line for a terminal, a sentence for a walker.

use super::{ImuStatus, Phase, Status, StatusEvent, Wait};
use std::fmt;

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl fmt::Display for Wait {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Points { have, need } => write!(f, "points to begin with, {have} of {need}"),
            Self::Parallax { matches } => {
                write!(f, "the camera to move aside, {matches} matches tell no motion yet")
            }
            Self::Reading { silent_s: Some(s) } => write!(f, "an IMU reading, none for {s:.1} s"),
            Self::Reading { silent_s: None } => f.write_str("an IMU reading, none yet"),
            Self::FirstTry => f.write_str("key frames to find scale and gravity with"),
            Self::Gate(gate) => write!(f, "{gate}"),
            Self::Sight { since_s, sigma } => {
                write!(f, "enough to see, none for {since_s:.2} s, place known to {sigma:.3} m")
            }
            Self::Place { have, need } => write!(f, "a place that is known, {have} of {need} matches"),
        }
    }
}

impl fmt::Display for StatusEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::World { map, beside: false } => write!(f, "world {map} begins"),
            Self::World { map, beside: true } => write!(f, "world {map} begins beside the others"),
            Self::Merge { from, into } => write!(f, "world {from} is merged into {into}"),
            Self::Loop { key_frame, again } => {
                write!(f, "a loop is closed between key frames {again} and {key_frame}")
            }
            Self::AlignGravity { map, scale, sigma } => {
                write!(f, "world {map} is level, {scale:.4} m in a unit to {:.1} percent", 100.0 * sigma)
            }
            Self::Found { after_s } => write!(f, "found again after {after_s:.2} s"),
        }
    }
}

impl fmt::Display for ImuStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "IMU {} readings", self.batch)?;
        match self.lag_ms {
            Some(ms) => write!(f, ", lag {ms:.1} ms")?,
            None => f.write_str(", none ever")?,
        }
        write!(f, ", {} synthesised", self.synthesised)?;
        if self.gaps > 0 {
            write!(f, ", {} gaps to {:.3} s", self.gaps, self.longest_gap_s)?;
        }
        Ok(())
    }
}

/// One line; the order of its parts stays.
impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s {}", self.t_s, self.phase)?;
        if self.frames > 0 {
            let validity = if self.valid { "valid" } else { "not valid" };
            write!(f, "; pose {} {validity}", self.sequence)?;
            match self.map {
                Some(map) => write!(f, "; map {map}")?,
                None => f.write_str("; no map")?,
            }
            f.write_str(if self.initialised { " initialised" } else { " not initialised" })?;
            write!(f, "; {} points", self.points)?;
        }
        if let Some(imu) = &self.imu {
            write!(f, "; {imu}")?;
        }
        for (k, wait) in self.waits.iter().enumerate() {
            write!(f, "{} {wait}", if k == 0 { "; waits for" } else { "," })?;
        }
        for event in &self.events {
            write!(f, "; event: {event}")?;
        }
        match &self.error {
            Some(error) => write!(f, "; {error}"),
            None => Ok(()),
        }
    }
}

impl Status {
    /// The phase in a sentence or two, for whoever holds the camera.
    pub fn words(&self) -> String {
        match (self.phase, self.waits.first()) {
            (Phase::LoadingVocab, _) => "Getting ready.".into(),
            (Phase::WaitFrames, _) if self.frames == 0 => "Waiting for the first picture.".into(),
            (Phase::WaitFrames, _) => "No picture comes.".into(),
            (Phase::WaitImu, _) => "The motion sensor does not answer.".into(),
            (Phase::WaitMotion | Phase::Initializing, Some(Wait::Points { have, need })) => {
                format!("Looking for a start: {have} of {need} points. Move the camera sideways.")
            }
            (Phase::WaitMotion, Some(Wait::Parallax { .. })) => {
                "Looking for a start: the points are there. Move the camera sideways.".into()
            }
            (Phase::WaitMotion, _) => {
                "Tracking by sight. Lengths are not known yet: move the camera to and fro, and up and down."
                    .into()
            }
            (Phase::Initializing, _) => "Tracking by sight. Lengths are not known yet.".into(),
            (Phase::Tracking, _) => "Tracking.".into(),
            (Phase::Coasting, Some(Wait::Sight { since_s, sigma })) => {
                format!("Going by the motion sensor for {since_s:.1} s, to {sigma:.2} m.")
            }
            (Phase::Coasting, _) => "Going by the motion sensor.".into(),
            (Phase::Lost, Some(Wait::Place { have, need })) => {
                format!("Tracking is lost: {have} of {need} matches.")
            }
            (Phase::Lost, _) => "Tracking is lost.".into(),
            (Phase::Resetting, _) => "Tracking was lost and goes on in a new map beside the old one.".into(),
            (Phase::Error, _) => match &self.error {
                Some(error) => format!("Something is wrong: {error}."),
                None => "Something is wrong.".into(),
            },
        }
    }
}
