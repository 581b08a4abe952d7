//! A status in words: a line for a terminal, a sentence for the person holding the camera.

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
            Self::Points { have, need } => write!(f, "points to start a map ({have} of {need})"),
            Self::Parallax { matches } => {
                write!(f, "sideways camera motion ({matches} matches, too little parallax yet)")
            }
            Self::Reading { silent_s: Some(s) } => write!(f, "an IMU reading (none for {s:.1} s)"),
            Self::Reading { silent_s: None } => f.write_str("an IMU reading (none so far)"),
            Self::FirstTry => f.write_str("enough key frames to initialise scale and gravity"),
            Self::Gate(gate) => write!(f, "{gate}"),
            Self::Sight { since_s, sigma } => {
                write!(f, "visual matches (none for {since_s:.2} s, position known to {sigma:.3} m)")
            }
            Self::Translation { since_s } => {
                write!(f, "translation of the camera (only rotation is tracked for {since_s:.2} s)")
            }
            Self::Place { have, need } => write!(f, "relocalisation ({have} of {need} matches)"),
        }
    }
}

impl fmt::Display for StatusEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MapCreated { map, others: false } => write!(f, "map {map} is created"),
            Self::MapCreated { map, others: true } => {
                write!(f, "map {map} is created, earlier maps are kept")
            }
            Self::Merge { from, into } => write!(f, "map {from} is merged into map {into}"),
            Self::Loop { key_frame, earlier } => {
                write!(f, "a loop is closed between key frames {earlier} and {key_frame}")
            }
            Self::GravityAligned { map, scale, sigma } => {
                write!(
                    f,
                    "map {map} is gravity-aligned, {scale:.4} m per unit to {:.1} percent",
                    100.0 * sigma
                )
            }
            Self::ScaleContradicted { map, scale, corrected } => {
                let then = if *corrected { "put right" } else { "not put right yet" };
                write!(
                    f,
                    "the motion sensor contradicts the scale of map {map} by a factor of {scale:.3}: {then}"
                )
            }
            Self::Relocalised { after_s } => write!(f, "relocalised after {after_s:.2} s"),
        }
    }
}

impl fmt::Display for ImuStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "IMU {} readings", self.batch)?;
        match self.lag_ms {
            Some(ms) => write!(f, ", lag {ms:.1} ms")?,
            None => f.write_str(", none so far")?,
        }
        write!(f, ", {} synthesised", self.synthesised)?;
        if self.gaps > 0 {
            write!(f, ", {} gaps to {:.3} s", self.gaps, self.longest_gap_s)?;
        }
        Ok(())
    }
}

/// One line; the order of its parts is fixed.
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
    /// The phase in a sentence or two, for the person holding the camera.
    pub fn words(&self) -> String {
        match (self.phase, self.waits.first()) {
            (Phase::LoadingVocab, _) => "Getting ready.".into(),
            (Phase::WaitFrames, _) if self.frames == 0 => "Waiting for the first camera image.".into(),
            (Phase::WaitFrames, _) => "No image from the camera.".into(),
            (Phase::WaitImu, _) => "The motion sensor is not responding.".into(),
            (Phase::WaitMotion | Phase::Initializing, Some(Wait::Points { have, need })) => {
                format!("Starting up: {have} of {need} points found. Move the camera sideways.")
            }
            (Phase::WaitMotion, Some(Wait::Parallax { .. })) => {
                "Starting up: enough points found. Move the camera sideways.".into()
            }
            (Phase::WaitMotion, _) => {
                "Tracking by camera. Distances are not known yet: move the camera back and forth, and up and down."
                    .into()
            }
            (Phase::Initializing, _) => "Tracking by camera. Distances are not known yet.".into(),
            (Phase::Tracking, _) => "Tracking.".into(),
            (Phase::Coasting, Some(Wait::Sight { since_s, sigma })) => {
                format!("Tracking by motion sensor for {since_s:.1} s, accurate to {sigma:.2} m.")
            }
            (Phase::Coasting, Some(Wait::Translation { since_s })) => {
                format!("Tracking rotation only for {since_s:.1} s. The position is not known until the camera moves on.")
            }
            (Phase::Coasting, _) => "Tracking by motion sensor.".into(),
            (Phase::Lost, Some(Wait::Place { have, need })) => {
                format!("Tracking is lost: {have} of {need} matches.")
            }
            (Phase::Lost, _) => "Tracking is lost.".into(),
            (Phase::Resetting, _) => "Tracking was lost. A new map has been started, and the old one is kept.".into(),
            (Phase::Error, _) => match &self.error {
                Some(error) => format!("Something is wrong: {error}."),
                None => "Something is wrong.".into(),
            },
        }
    }
}
