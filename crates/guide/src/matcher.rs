//! The walker's place on the route: the nearest point that is consistent with the last match.
//!
//! A route may cross itself, so the search covers only a window around the last match; when the walker has been far
//! from that window for a while, the whole route is searched and candidates near the last match are preferred.

use crate::ground::cross;
use crate::maneuvers::ManeuverPlan;
use cairn_geometry::Vec2;
use cairn_sensor::Stamp;
use cairn_settings::Settings;

/// The extent of the search.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct MatcherConfig {
    /// Metres searched behind the last match.
    #[setting(default = 4.0, range = 0.0..=100.0)]
    pub behind_m: f64,
    /// Metres searched ahead of it.
    #[setting(default = 4.0, range = 0.0..=100.0)]
    pub ahead_m: f64,
    /// Penalty in metres of distance for each metre along the route between a candidate and the last match.
    #[setting(default = 0.1, range = 0.0..=10.0)]
    pub along_weight: f64,
    /// When the walker is farther than this from the window for [`Self::lost_s`], the whole route is searched.
    #[setting(default = 6.0, range = 0.0..=100.0)]
    pub lost_m: f64,
    /// Seconds.
    #[setting(default = 5.0, range = 0.0..=600.0)]
    pub lost_s: f64,
}

/// Legs whose distances from the walker differ by less than this are equally near, metres.
const SAME_LEG_M: f64 = 0.7;
/// Points of neighbouring legs that are nearer to each other than this are of one passing, metres.
const JOINED_LEGS_M: f64 = 1.5;

/// A place on the route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Metres from the start of the route.
    pub along_m: f64,
    /// Metres to the left of the route (negative: right).
    pub cross_m: f64,
    /// The nearest point of the route.
    pub foot: Vec2,
    /// The heading of the route there, radians.
    pub heading: f64,
}

/// Matches one walker to one route.
#[derive(Clone, Debug)]
pub struct Matcher {
    config: MatcherConfig,
    along_m: f64,
    /// The walker was guided past this point and is not matched before it.
    passed_m: f64,
    far_since: Option<Stamp>,
    /// The next match may be anywhere on the route: in any case, or where the walker is far from the window.
    anywhere: bool,
    if_far: bool,
}

impl Matcher {
    /// Starts at the beginning of the route.
    pub fn new(config: MatcherConfig) -> Self {
        Self { config, along_m: 0.0, passed_m: 0.0, far_since: None, anywhere: false, if_far: false }
    }

    /// Sets the walker's place.
    pub fn place(&mut self, along_m: f64) {
        self.along_m = along_m;
        self.far_since = None;
    }

    /// A corrected route is longer by so many metres: the walker, and where he was guided past, are as far from its end as before.
    pub fn shift(&mut self, metres: f64, length_m: f64) {
        self.place((self.along_m + metres).clamp(0.0, length_m));
        self.passed_m = (self.passed_m + metres).clamp(0.0, length_m);
    }

    /// Records that the walker was guided round a hairpin here. Its two legs lie near each other, so position alone
    /// does not decide which of them the walker is on. Forgotten when the walker is lost from the window.
    pub fn pass(&mut self, along_m: f64) {
        self.passed_m = along_m;
    }

    /// The walker is not where the poses before had him: the whole route is searched for his place.
    pub fn search_anywhere(&mut self) {
        self.anywhere = true;
    }

    /// Nobody knows where the walker has gone meanwhile: where that is far from the window, it is not waited for.
    pub fn search_if_far(&mut self) {
        self.if_far = true;
    }

    /// Whether a walker who is matched before a corner stands nearer to the leg after it: he has cut it, or came round it while
    /// nobody saw him.
    pub fn is_past(&self, plan: &ManeuverPlan, position: &Vec2, at: &Match, corner_m: f64) -> bool {
        let ahead_m = self.config.ahead_m;
        let after = self.nearest(plan, position, corner_m, corner_m + ahead_m);
        corner_m - at.along_m <= ahead_m && (after.foot - position).norm() < (at.foot - position).norm()
    }

    /// Metres along at the last match.
    pub fn along_m(&self) -> f64 {
        self.along_m
    }

    /// The first match, anywhere on the route. A walker within `start_m` of the start is matched near it, although the
    /// route may end at the same place; elsewhere the nearest point counts, and where several legs are about as near, the
    /// earliest: then no part of the route is missed.
    pub fn join(&mut self, plan: &ManeuverPlan, position: &Vec2, start_m: f64) -> Match {
        let near_start = (plan.point_at(0.0) - position).norm() <= start_m;
        let found = match near_start {
            true => {
                self.along_m = 0.0;
                self.nearest(plan, position, 0.0, 2.0 * start_m)
            }
            false => self.earliest_near(plan, position),
        };
        self.place(found.along_m);
        self.passed_m = 0.0;
        found
    }

    /// The nearest point on the earliest leg that is as near as the nearest, give or take [`SAME_LEG_M`].
    fn earliest_near(&mut self, plan: &ManeuverPlan, position: &Vec2) -> Match {
        let along = plan.along();
        let mut legs: Vec<Match> = Vec::with_capacity(along.len());
        for leg in along.windows(2) {
            self.along_m = leg[0];
            legs.push(self.nearest(plan, position, leg[0], leg[1] - 1e-9));
        }
        let away = |m: &Match| (m.foot - position).norm();
        let least = legs.iter().map(away).fold(f64::INFINITY, f64::min);
        let Some(first) = legs.iter().position(|m| away(m) <= least + SAME_LEG_M) else {
            return self.nearest(plan, position, f64::NEG_INFINITY, f64::INFINITY);
        };
        // Along one passing, the nearest of its legs.
        let mut best = legs[first];
        for (near, next) in legs[first..].windows(2).map(|w| (&w[0], &w[1])) {
            if away(next) > least + SAME_LEG_M || next.along_m - near.along_m > 2.0 * JOINED_LEGS_M {
                break;
            }
            best = if away(next) < away(&best) { *next } else { best };
        }
        best
    }

    /// The match for a position on the ground plane.
    pub fn update(&mut self, plan: &ManeuverPlan, position: &Vec2, now: Stamp) -> Match {
        if std::mem::take(&mut self.anywhere) {
            (self.far_since, self.passed_m) = (None, 0.0);
            let found = self.nearest(plan, position, f64::NEG_INFINITY, f64::INFINITY);
            self.along_m = found.along_m;
            return found;
        }
        let from = (self.along_m - self.config.behind_m).max(self.passed_m);
        let to = self.along_m.max(self.passed_m) + self.config.ahead_m;
        let mut found = self.nearest(plan, position, from, to);
        let far = (found.foot - position).norm() > self.config.lost_m;
        let at_once = std::mem::take(&mut self.if_far);
        match (far, self.far_since) {
            (false, _) => self.far_since = None,
            (true, None) if !at_once => self.far_since = Some(now),
            (true, since) if at_once || since.is_some_and(|since| now - since >= self.config.lost_s) => {
                found = self.nearest(plan, position, f64::NEG_INFINITY, f64::INFINITY);
                self.far_since = None;
                self.passed_m = 0.0;
            }
            (true, _) => {}
        }
        self.along_m = found.along_m;
        found
    }

    fn nearest(&self, plan: &ManeuverPlan, p: &Vec2, from: f64, to: f64) -> Match {
        let (points, along) = (plan.points(), plan.along());
        let mut best: Option<(f64, Match)> = None;
        for k in 0..points.len() - 1 {
            if along[k + 1] <= from || along[k] > to {
                continue;
            }
            let d = points[k + 1] - points[k];
            let span = along[k + 1] - along[k];
            let (low, high) = ((from - along[k]).max(0.0) / span, (to - along[k]).min(span) / span);
            let t = ((p - points[k]).dot(&d) / d.norm_squared()).clamp(low, high);
            let foot = points[k] + d * t;
            let along_m = along[k] + span * t;
            let cost = (p - foot).norm() + self.config.along_weight * (along_m - self.along_m).abs();
            if best.as_ref().is_none_or(|(c, _)| cost < *c) {
                let cross_m = cross(&(d / d.norm()), &(p - foot));
                // At a corner the nearest point is the corner itself: the whole distance counts, with the sign of the
                // segment's side.
                let side = if cross_m < 0.0 { -1.0 } else { 1.0 };
                let cross_m = if t > 0.0 && t < 1.0 { cross_m } else { side * (p - foot).norm() };
                best = Some((cost, Match { along_m, cross_m, foot, heading: d.y.atan2(d.x) }));
            }
        }
        // The window always contains the segment of the last match, and a route has at least one segment.
        best.map_or_else(
            || {
                let foot = plan.point_at(self.along_m);
                let cross_m = (p - foot).norm();
                Match { along_m: self.along_m, cross_m, foot, heading: plan.heading_at(self.along_m) }
            },
            |(_, m)| m,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ground, ManeuverPlanConfig};
    use cairn_geometry::Vec3;

    fn plan(line: &[[f64; 2]]) -> ManeuverPlan {
        let line: Vec<Vec3> = line.iter().map(|p| Vec3::new(p[0], p[1], 0.0)).collect();
        ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap()
    }

    #[test]
    fn match_stays_on_its_leg_at_a_crossing() {
        // A figure that crosses itself at (10, 0), 10 m and 50 m along.
        let r = plan(&[[0., 0.], [20., 0.], [20., 10.], [10., 10.], [10., -10.]]);
        let mut matcher = Matcher::new(MatcherConfig::default());
        let mut t = 0;
        for truth in (0..=600).map(|k| k as f64 * 0.1).filter(|a| *a <= r.length()) {
            t += 100_000_000;
            // 0.4 m to the left all the way.
            let left = crate::ground::direction(r.heading_at(truth) + std::f64::consts::FRAC_PI_2) * 0.4;
            let m = matcher.update(&r, &(r.point_at(truth) + left), Stamp(t));
            assert!((m.along_m - truth).abs() < 0.9, "at {truth} matched {}", m.along_m);
            assert!(m.cross_m.abs() < 0.6);
        }
    }

    #[test]
    fn cross_track_sign_and_full_search_when_lost() {
        let r = plan(&[[0., 0.], [50., 0.], [50., 30.]]);
        let mut matcher = Matcher::new(MatcherConfig::default());
        assert_eq!(matcher.update(&r, &Vec2::new(2.0, 1.0), Stamp(0)).cross_m, 1.0);
        assert_eq!(matcher.update(&r, &Vec2::new(3.0, -1.0), Stamp(0)).cross_m, -1.0);
        let far = Vec2::new(50.5, 20.0);
        let near = matcher.update(&r, &far, Stamp::from_seconds(1.0));
        assert!(near.along_m < 10.0);
        let mut m = near;
        for k in 0..60 {
            m = matcher.update(&r, &far, Stamp::from_seconds(1.0 + 0.1 * k as f64));
        }
        assert!((m.along_m - 70.0).abs() < 1e-9 && (m.cross_m + 0.5).abs() < 1e-9);
    }

    #[test]
    fn walker_beside_a_corner_is_past_it_where_the_leg_after_it_is_nearer() {
        // A sharp turn to the left at 20 m.
        let r = plan(&[[0., 0.], [20., 0.], [10., 10.]]);
        let past = |x: f64, y: f64| {
            let position = Vec2::new(x, y);
            let mut matcher = Matcher::new(MatcherConfig::default());
            matcher.place(17.0);
            let at = matcher.nearest(&r, &position, 13.0, 20.0);
            matcher.is_past(&r, &position, &at, 20.0)
        };
        assert!(past(18.0, 1.6) && !past(18.0, 0.3) && !past(18.0, -1.0) && !past(12.0, 3.0));
    }

    #[test]
    fn walker_joins_anywhere_and_at_the_start_of_a_closed_route() {
        // A closed walk whose end lies beside its start, with a spur that is walked out and back.
        let r = plan(&[
            [0., 0.],
            [20., 0.],
            [20., 10.],
            [30., 10.],
            [20., 10.2],
            [20., 20.],
            [0., 20.],
            [0., 0.5],
        ]);
        let join = |x: f64, y: f64| Matcher::new(MatcherConfig::default()).join(&r, &Vec2::new(x, y), 3.0);
        assert!(join(0.2, 0.4).along_m < 0.5, "at the start, not at the end");
        for (x, y, along) in [(12.0, 0.8, 12.0), (20.4, 6.0, 26.0), (10.0, 19.5, 69.8)] {
            let m = join(x, y);
            assert!((m.along_m - along).abs() < 1.5, "({x}, {y}): {m:?}");
        }
        // Out and back on the same line: the way out counts, so that nothing is missed.
        assert!((join(26.0, 10.1).along_m - 36.0).abs() < 0.5, "{:?}", join(26.0, 10.1));
        // Later matches continue from there.
        let mut matcher = Matcher::new(MatcherConfig::default());
        matcher.join(&r, &Vec2::new(12.0, 0.8), 3.0);
        assert!((matcher.update(&r, &Vec2::new(12.5, 0.5), Stamp(0)).along_m - 12.5).abs() < 1e-9);
    }
}
