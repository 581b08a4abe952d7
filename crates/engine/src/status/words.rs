//! A status in words: a line in English for a terminal and for tools, and sentences of the catalogue for the person
//! holding the camera.

use super::{ImuStatus, Phase, Status, StatusEvent, Wait};
use cairn_inertial::GateKind;
use cairn_phrases::Language;
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
            Self::VisualMatches { since_s, sigma } => {
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
            Self::ImuFailed { fault } => write!(f, "the motion sensor is not used any more: {fault}"),
            Self::ImuBack { after_s } => write!(f, "the motion sensor is used again after {after_s:.2} s"),
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
        if self.refused > 0 {
            write!(f, ", {} refused", self.refused)?;
        }
        if let Some(fault) = &self.fault {
            write!(f, ", not used for {:.2} s ({fault})", self.fault_s)?;
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
    /// The phase in a sentence or two, for the person holding the camera, in English.
    pub fn words(&self) -> String {
        self.words_in(Language::English)
    }

    /// The phase in a sentence or two, for the person holding the camera.
    pub fn words_in(&self, language: Language) -> String {
        let text = |id: &str| language.text(id);
        match (self.phase, self.waits.first()) {
            (Phase::LoadingVocab, _) => text("phase-loading"),
            (Phase::WaitFrames, _) if self.frames == 0 => text("phase-first-image"),
            (Phase::WaitFrames, _) => text("phase-no-image"),
            (Phase::WaitImu, _) => text("phase-no-imu"),
            (Phase::WaitMotion | Phase::Initializing, Some(Wait::Points { .. }))
            | (Phase::WaitMotion, Some(Wait::Parallax { .. })) => text("phase-points"),
            (Phase::WaitMotion, _) => text("phase-unmeasured-move"),
            (Phase::Initializing, _) => text("phase-unmeasured"),
            (Phase::Tracking, _) => text("phase-tracking"),
            (Phase::Coasting, Some(Wait::Translation { .. })) => text("phase-rotation"),
            (Phase::Coasting, _) => text("phase-coasting"),
            (Phase::Lost, _) => text("phase-lost"),
            (Phase::Resetting, _) => text("phase-new-map"),
            (Phase::Error, _) => match &self.error {
                Some(error) => language.say("phase-error-why", &[("why", error.into())]),
                None => text("phase-error"),
            },
        }
    }
}

impl Wait {
    /// What is waited for, for the person holding the camera: a part of a sentence.
    pub fn words_in(&self, language: Language) -> String {
        language.text(match self {
            Self::Points { .. } => "wait-points",
            Self::Parallax { .. } => "wait-parallax",
            Self::Reading { .. } => "wait-imu",
            Self::FirstTry => "wait-first-try",
            Self::Gate(gate) => match gate.kind {
                GateKind::KeyFrames | GateKind::Seconds => "wait-time",
                GateKind::Excitation => "wait-excitation",
                GateKind::Baseline => "wait-baseline",
                _ => "wait-precision",
            },
            Self::VisualMatches { .. } => "wait-matches",
            Self::Translation { .. } => "wait-translation",
            Self::Place { .. } => "wait-place",
        })
    }
}
