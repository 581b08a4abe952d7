//! How fast a walker walks: now, and when he has been told to set out.

use cairn_geometry::Vec2;
use cairn_sensor::Stamp;
use std::collections::VecDeque;

/// Speed is measured over this time, seconds.
const SPEED_S: f64 = 0.4;
/// Pace of somebody who was not seen to walk yet, m/s.
const PACE_M_S: f64 = 1.2;
/// Who has set out has his pace after this time, seconds.
const SETS_OUT_S: f64 = 0.8;
/// A slower pace is believed over this time, seconds.
const SLOWER_S: f64 = 1.0;

/// The walker's motion.
pub(super) struct Pace {
    /// Positions of the last moments.
    track: VecDeque<(Stamp, Vec2)>,
    /// Since when he walks, and since when he stands.
    walking: Option<Stamp>,
    standing: Option<Stamp>,
    /// Whether they stand now.
    stands: bool,
    speed: f64,
    pace: f64,
    last: Option<Stamp>,
}

impl Pace {
    pub fn new() -> Self {
        let (track, pace) = (VecDeque::new(), PACE_M_S);
        Self { track, walking: None, standing: None, stands: true, speed: 0.0, pace, last: None }
    }

    /// The frame of the positions has changed.
    pub fn clear(&mut self) {
        self.track.clear();
        self.last = None;
    }

    /// Takes a position, in metres, of one who stands where they are no faster than `standing_m_s`.
    pub fn push(&mut self, at: Vec2, now: Stamp, standing_m_s: f64) {
        if self.track.back().is_none_or(|(t, _)| *t < now) {
            self.track.push_back((now, at));
        }
        while self.track.len() > 2 && self.track.get(1).is_some_and(|(t, _)| now - *t > SPEED_S) {
            self.track.pop_front();
        }
        self.speed = match (self.track.front(), self.track.back()) {
            (Some((t0, a)), Some((t1, b))) if *t1 - *t0 > 0.05 => (b - a).norm() / (*t1 - *t0),
            _ => 0.0,
        };
        let dt = self.last.replace(now).map_or(0.0, |last| (now - last).clamp(0.0, 1.0));
        self.stands = self.speed <= standing_m_s;
        if self.stands {
            self.walking = None;
            self.standing.get_or_insert(now);
            return;
        }
        self.standing = None;
        let since = *self.walking.get_or_insert(now);
        if self.speed > self.pace {
            self.pace = self.speed;
        } else if now - since > SETS_OUT_S {
            self.pace += (self.speed - self.pace) * (dt / SLOWER_S).min(1.0);
        }
    }

    /// Speed now, m/s.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// The speed that he has soon after he has set out, m/s.
    pub fn pace(&self) -> f64 {
        self.pace
    }

    /// Whether he stands.
    pub fn stands(&self) -> bool {
        self.stands
    }

    /// Whether he has stood for so many seconds.
    pub fn has_stood(&self, seconds: f64, now: Stamp) -> bool {
        self.standing.is_some_and(|since| now - since >= seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sensor::MotionProfile;

    /// Walks along x at speeds (m/s) for some seconds each.
    fn walk(pace: &mut Pace, legs: &[(f64, f64)]) -> Stamp {
        let (mut x, mut now) = (0.0, pace.last.unwrap_or(Stamp(0)));
        for (speed, seconds) in legs {
            for _ in 0..(seconds * 20.0) as usize {
                x += speed * 0.05;
                now = now.plus_seconds(0.05);
                pace.push(Vec2::new(x, 0.0), now, MotionProfile::default().standing_m_s);
            }
        }
        now
    }

    #[test]
    fn who_stands_is_expected_to_walk_at_his_pace() {
        let mut pace = Pace::new();
        let now = walk(&mut pace, &[(0.0, 3.0)]);
        assert!(pace.stands() && pace.has_stood(2.5, now) && !pace.has_stood(3.5, now));
        assert_eq!(pace.pace(), PACE_M_S);
        pace.clear();
        walk(&mut pace, &[(0.5, 6.0), (0.0, 2.0)]);
        // While he comes to a stand his pace is taken for up to a tenth slower than it is.
        assert!(pace.stands() && (0.445..0.505).contains(&pace.pace()), "{}", pace.pace());
        // A faster one is believed at once.
        pace.clear();
        let now = walk(&mut pace, &[(1.4, 0.5)]);
        assert!((pace.speed() - 1.4).abs() < 1e-6 && (pace.pace() - 1.4).abs() < 1e-6);
        assert!(!pace.has_stood(0.0, now));
    }
}
