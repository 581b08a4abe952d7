//! What a source left out, counted by kind and reason, so that damaged frames are never confused with damaged rows of
//! another sensor.

use crate::Stamp;

/// What was left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SkipKind {
    /// The images of one instant: a frame that counts against coverage.
    Frame,
    /// The images of one instant, which repeat those before: no frame of its own.
    Repeat,
    /// A depth image; its frame was delivered without depth.
    Depth,
    /// A reading of the IMU.
    Imu,
    /// A line of an index file that names nothing.
    Line,
    /// Anything else that a source reports.
    Other,
}

impl SkipKind {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Repeat => "repeated frame",
            Self::Depth => "depth image",
            Self::Imu => "IMU reading",
            Self::Line => "line",
            Self::Other => "other",
        }
    }
}

/// One thing that was left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Skipped {
    /// Its kind.
    pub kind: SkipKind,
    /// Why, the same words for all that are counted together.
    pub reason: String,
    /// For people: where, and exactly why.
    pub text: String,
    /// When, if that is known.
    pub stamp: Option<Stamp>,
}

impl Skipped {
    /// At no known time.
    pub fn new(kind: SkipKind, reason: impl Into<String>, text: impl Into<String>) -> Self {
        Self { kind, reason: reason.into(), text: text.into(), stamp: None }
    }

    /// At a time.
    pub fn at(self, stamp: Stamp) -> Self {
        Self { stamp: Some(stamp), ..self }
    }
}

/// How much was left out for one reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkipCount {
    /// What.
    pub kind: SkipKind,
    /// Why.
    pub reason: String,
    /// How many.
    pub count: usize,
    /// The first of them, for people.
    pub first: String,
}

/// Reasons that are told apart; what comes after is counted together.
const MAX_REASONS: usize = 50;

/// The counts of a source, in the order in which the reasons occurred.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Skips(Vec<SkipCount>);

impl Skips {
    /// Counts one.
    pub fn add(&mut self, skipped: &Skipped) {
        self.add_many(skipped.kind, &skipped.reason, 1, &skipped.text);
    }

    /// Counts several for one reason; `first` describes the first of them.
    pub fn add_many(&mut self, kind: SkipKind, reason: &str, count: usize, first: &str) {
        if count == 0 {
            return;
        }
        let full = self.0.len() >= MAX_REASONS;
        let reason = if full && !self.0.iter().any(|s| s.kind == kind && s.reason == reason) {
            "other reasons"
        } else {
            reason
        };
        match self.0.iter_mut().find(|s| s.kind == kind && s.reason == reason) {
            Some(same) => same.count += count,
            None => {
                let (reason, first) = (reason.to_owned(), first.to_owned());
                self.0.push(SkipCount { kind, reason, count, first });
            }
        }
    }

    /// How many of a kind.
    pub fn count(&self, kind: SkipKind) -> usize {
        self.0.iter().filter(|s| s.kind == kind).map(|s| s.count).sum()
    }

    /// How many of all kinds.
    pub fn total(&self) -> usize {
        self.0.iter().map(|s| s.count).sum()
    }

    /// Counts all of another source, or of another part of this one.
    pub fn add_all(&mut self, other: &Self) {
        other.0.iter().for_each(|s| self.add_many(s.kind, &s.reason, s.count, &s.first));
    }

    /// What came since an earlier state of the same counts.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        let before = |s: &SkipCount| {
            let same = earlier.0.iter().find(|e| e.kind == s.kind && e.reason == s.reason);
            same.map_or(0, |e| e.count)
        };
        let later =
            self.0.iter().map(|s| SkipCount { count: s.count.saturating_sub(before(s)), ..s.clone() });
        Self(later.filter(|s| s.count > 0).collect())
    }

    /// Each reason with its count.
    pub fn iter(&self) -> impl Iterator<Item = &SkipCount> {
        self.0.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_counted_apart_from_other_sensors() {
        let mut skips = Skips::default();
        for k in 0..3 {
            skips.add(&Skipped::new(SkipKind::Imu, "not a reading", format!("imu.csv, line {k}")));
        }
        skips.add(&Skipped::new(SkipKind::Frame, "cannot be decoded", "a.png: truncated").at(Stamp(5)));
        skips.add_many(SkipKind::Frame, "cannot be decoded", 2, "never shown");
        skips.add_many(SkipKind::Depth, "no reason", 0, "never shown");
        assert_eq!((skips.count(SkipKind::Frame), skips.count(SkipKind::Imu), skips.total()), (3, 3, 6));
        let all: Vec<_> = skips.iter().map(|s| (s.kind.name(), s.count, s.first.as_str())).collect();
        assert_eq!(all, [("IMU reading", 3, "imu.csv, line 0"), ("frame", 3, "a.png: truncated")]);
    }

    #[test]
    fn counts_are_taken_apart_and_put_together() {
        let mut skips = Skips::default();
        skips.add_many(SkipKind::Imu, "not a reading", 3, "line 1");
        let earlier = skips.clone();
        skips.add_many(SkipKind::Imu, "not a reading", 2, "never shown");
        skips.add_many(SkipKind::Frame, "cannot be decoded", 1, "a.png");
        let later = skips.since(&earlier);
        assert_eq!((later.count(SkipKind::Imu), later.count(SkipKind::Frame)), (2, 1));
        let mut all = earlier;
        all.add_all(&later);
        assert_eq!(all, skips);
        assert_eq!(skips.since(&skips), Skips::default());
    }

    #[test]
    fn reasons_without_end_are_counted_together() {
        let mut skips = Skips::default();
        (0..1000).for_each(|k| skips.add_many(SkipKind::Other, &format!("reason {k}"), 1, ""));
        assert_eq!((skips.iter().count(), skips.total()), (MAX_REASONS + 1, 1000));
    }
}
