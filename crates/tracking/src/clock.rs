//! Instants and frame periods that tracking counts.

use cairn_sensor::Stamp;

/// When things happened last, in the frames' time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameClock {
    rate_hz: f64,
    /// When the last frame was taken.
    stepped: Option<Stamp>,
    /// When the last map was created, or the first frame arrived.
    pub map_created: Option<Stamp>,
    /// When the last frame was located.
    pub located: Option<Stamp>,
    /// Frame periods since the last key frame request, at the nominal rate: frames that did not come count too.
    pub since_key_frame: usize,
    /// The same since the place was found again.
    pub since_recovery: usize,
}

impl FrameClock {
    /// At the nominal frame rate.
    pub fn new(rate_hz: f64) -> Self {
        Self {
            rate_hz,
            stepped: None,
            map_created: None,
            located: None,
            since_key_frame: 0,
            since_recovery: usize::MAX / 2,
        }
    }

    /// A frame has come. Returns the frame periods since the last one, at least one: where a machine is too slow for every
    /// picture, what is to happen after so many happens in time all the same.
    pub fn step(&mut self, stamp: Stamp) -> usize {
        self.map_created.get_or_insert(stamp);
        let since_s = self.stepped.replace(stamp).map_or(0.0, |last| stamp - last);
        ((since_s * self.rate_hz).round() as usize).max(1)
    }

    /// So many frame periods have passed in a map.
    pub fn advance(&mut self, periods: usize) {
        self.since_key_frame = self.since_key_frame.saturating_add(periods);
        self.since_recovery = self.since_recovery.saturating_add(periods);
    }

    /// A map begins with a key frame of this time.
    pub fn begin_map(&mut self, stamp: Stamp) {
        (self.located, self.map_created, self.since_key_frame) = (Some(stamp), Some(stamp), 0);
    }

    /// Whether so little time has passed since the last pose that constant velocity still holds.
    pub fn is_recent(&self, stamp: Stamp, seconds: f64) -> bool {
        self.located.is_none_or(|t| stamp - t < seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_counts_frames_that_did_not_come() {
        let mut clock = FrameClock::new(20.0);
        let mut periods = |at: f64| clock.step(Stamp::from_seconds(10.0 + 0.05 * at));
        assert_eq!([0.0, 1.0, 2.1, 6.0, 6.1].map(&mut periods), [1, 1, 1, 4, 1]);
    }

    #[test]
    fn is_recent_until_so_many_seconds_after_the_last_pose() {
        let mut clock = FrameClock::new(20.0);
        assert!(clock.is_recent(Stamp::from_seconds(100.0), 0.6), "there was no pose yet");
        clock.begin_map(Stamp::from_seconds(1.0));
        let after = |seconds: f64| Stamp::from_seconds(1.0 + seconds);
        assert!(clock.is_recent(after(0.55), 0.6) && !clock.is_recent(after(0.65), 0.6));
    }
}
