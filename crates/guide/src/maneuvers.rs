//! The maneuver plan: the cleaned route as a polyline on the ground plane, with the places where directions are given.

use crate::clean::CleanedRoute;
use crate::ground::{Ground, heading_of, wrap};
use cairn_geometry::{Vec2, Vec3};
use cairn_settings::Settings;

/// The direction in which a route is walked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Travel {
    /// From its end to its start: home.
    Home,
    /// From its start to its end, another day.
    Again,
}

/// How maneuvers are derived from a polyline.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct ManeuverPlanConfig {
    /// A bend below this angle is not a turn, degrees.
    #[setting(default = 20.0, range = 0.0..=180.0)]
    pub straight_deg: f64,
    /// Bends to the same side within this distance of each other are one corner, metres.
    #[setting(default = 2.0, range = 0.0..=100.0)]
    pub corner_m: f64,
    /// Turns nearer to each other than this are announced together, metres (as NavCog).
    #[setting(default = 4.0, range = 0.0..=100.0)]
    pub compound_m: f64,
    /// Stairs rise at least this, metres.
    #[setting(default = 1.0, range = 0.0..=100.0)]
    pub stairs_rise_m: f64,
    /// Stairs are at least this steep: rise over run.
    #[setting(default = 0.3, range = 0.0..=10.0)]
    pub stairs_slope: f64,
}

/// A flight of stairs, in walking direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stairs {
    /// Going up.
    Up,
    /// Going down.
    Down,
}

/// A place where the walker has something to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Maneuver {
    /// Metres along the route where it begins.
    pub at_m: f64,
    /// Metres along the route where it ends (a corner cut in two bends has some length).
    pub end_m: f64,
    /// How much the route turns, radians, positive to the left; 0 where only stairs begin.
    pub turn_rad: f64,
    /// The heading of the route after it.
    pub exit_heading: f64,
    /// Stairs that begin here.
    pub stairs: Option<Stairs>,
    /// True when it is so near the maneuver before that both are announced together.
    pub joined: bool,
}

/// A plan along a polyline, from its first point to its last.
#[derive(Clone, Debug, PartialEq)]
pub struct ManeuverPlan {
    points: Vec<Vec2>,
    heights: Vec<f64>,
    along: Vec<f64>,
    maneuvers: Vec<Maneuver>,
}

/// Why a polyline is not a usable route.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ManeuverPlanError {
    /// Fewer than two different points.
    #[error("the route has {0} different points, at least 2 are needed")]
    TooShort(usize),
    /// A coordinate is not a number.
    #[error("point {0} of the route is not finite")]
    NotFinite(usize),
}

impl ManeuverPlan {
    /// The plan along a cleaned route.
    ///
    /// # Errors
    /// As [`ManeuverPlan::new`].
    pub fn from_route(
        route: &CleanedRoute,
        travel: Travel,
        ground: &Ground,
        config: &ManeuverPlanConfig,
    ) -> Result<Self, ManeuverPlanError> {
        let mut points = route.points.clone();
        if travel == Travel::Home {
            points.reverse();
        }
        Self::new(&points, ground, config)
    }

    /// The plan along points in metres; the ground plane and heights are those of `ground`.
    ///
    /// # Errors
    /// [`ManeuverPlanError`] for fewer than two different points or coordinates that are not finite.
    pub fn new(
        line: &[Vec3],
        ground: &Ground,
        config: &ManeuverPlanConfig,
    ) -> Result<Self, ManeuverPlanError> {
        if let Some(bad) = line.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(ManeuverPlanError::NotFinite(bad));
        }
        let (mut points, mut heights, mut along) = (Vec::<Vec2>::new(), Vec::new(), Vec::new());
        for p in line {
            let q = ground.plane(p);
            let step = points.last().map(|l| (q - l).norm());
            if step.is_some_and(|s| s < 0.05) {
                continue;
            }
            along.push(along.last().copied().unwrap_or(0.0) + step.unwrap_or(0.0));
            points.push(q);
            heights.push(ground.height(p));
        }
        if points.len() < 2 {
            return Err(ManeuverPlanError::TooShort(points.len()));
        }
        let mut plan = Self { points, heights, along, maneuvers: Vec::new() };
        plan.maneuvers = plan.find_maneuvers(config);
        Ok(plan)
    }

    /// The corners on the ground plane, in metres.
    pub fn points(&self) -> &[Vec2] {
        &self.points
    }

    /// Metres from the start to each corner.
    pub fn along(&self) -> &[f64] {
        &self.along
    }

    /// The maneuvers in walking order.
    pub fn maneuvers(&self) -> &[Maneuver] {
        &self.maneuvers
    }

    /// Length over ground in metres.
    pub fn length(&self) -> f64 {
        self.along.last().copied().unwrap_or(0.0)
    }

    /// The last point on the ground plane.
    pub fn end(&self) -> Vec2 {
        self.points.last().copied().unwrap_or_default()
    }

    /// True where the route has stairs.
    pub fn has_stairs(&self) -> bool {
        self.maneuvers.iter().any(|m| m.stairs.is_some())
    }

    /// The index of the segment that contains this distance along the route.
    pub(crate) fn segment_at(&self, along: f64) -> usize {
        let after = self.along.partition_point(|a| *a <= along);
        after.saturating_sub(1).min(self.points.len() - 2)
    }

    /// The point this far along, in metres.
    pub fn point_at(&self, along: f64) -> Vec2 {
        let k = self.segment_at(along);
        let span = self.along[k + 1] - self.along[k];
        let t = ((along - self.along[k]) / span).clamp(0.0, 1.0);
        self.points[k] + (self.points[k + 1] - self.points[k]) * t
    }

    /// The height this far along, in metres.
    pub fn height_at(&self, along: f64) -> f64 {
        let k = self.segment_at(along);
        let t = ((along - self.along[k]) / (self.along[k + 1] - self.along[k])).clamp(0.0, 1.0);
        self.heights[k] + (self.heights[k + 1] - self.heights[k]) * t
    }

    /// The heading of the segment that holds this distance along.
    pub fn heading_at(&self, along: f64) -> f64 {
        self.heading(self.segment_at(along))
    }

    fn heading(&self, segment: usize) -> f64 {
        heading_of(&(self.points[segment + 1] - self.points[segment]))
    }

    fn find_maneuvers(&self, config: &ManeuverPlanConfig) -> Vec<Maneuver> {
        let mut found = self.corners(config);
        for (at_m, stairs) in self.flights(config) {
            match found.iter_mut().find(|m| (m.end_m - at_m).abs() < 1.0) {
                Some(m) => m.stairs = Some(stairs),
                None => found.push(Maneuver {
                    at_m,
                    end_m: at_m,
                    turn_rad: 0.0,
                    exit_heading: self.heading_at(at_m),
                    stairs: Some(stairs),
                    joined: false,
                }),
            }
        }
        found.sort_by(|a, b| a.at_m.total_cmp(&b.at_m));
        for k in 1..found.len() {
            found[k].joined = found[k].at_m - found[k - 1].end_m < config.compound_m;
        }
        found
    }

    /// Bends to the same side within a corner's length are one turn; a sum below the limit is none.
    fn corners(&self, config: &ManeuverPlanConfig) -> Vec<Maneuver> {
        let bend = |k: usize| wrap(self.heading(k) - self.heading(k - 1));
        let (mut out, mut k) = (Vec::new(), 1);
        while k + 1 < self.points.len() {
            let (first, mut turn) = (k, bend(k));
            while k + 2 < self.points.len()
                && self.along[k + 1] - self.along[first] <= config.corner_m
                && bend(k + 1) * turn > 0.0
                && (turn + bend(k + 1)).abs() < std::f64::consts::PI
            {
                k += 1;
                turn += bend(k);
            }
            if turn.abs().to_degrees() >= config.straight_deg {
                out.push(Maneuver {
                    at_m: self.along[first],
                    end_m: self.along[k],
                    turn_rad: turn,
                    exit_heading: self.heading(k),
                    stairs: None,
                    joined: false,
                });
            }
            k += 1;
        }
        out
    }

    /// Where stairs begin.
    fn flights(&self, config: &ManeuverPlanConfig) -> Vec<(f64, Stairs)> {
        let (mut out, mut k) = (Vec::new(), 0);
        let last = self.points.len() - 1;
        let steep = |k: usize| {
            let rise = self.heights[k + 1] - self.heights[k];
            let slope = rise / (self.along[k + 1] - self.along[k]);
            if slope.abs() > config.stairs_slope { slope.signum() } else { 0.0 }
        };
        while k < last {
            let (first, sign) = (k, steep(k));
            while k < last && steep(k) == sign {
                k += 1;
            }
            let rise = self.heights[k] - self.heights[first];
            if sign != 0.0 && rise.abs() > config.stairs_rise_m {
                out.push((self.along[first], if sign > 0.0 { Stairs::Up } else { Stairs::Down }));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(line: &[[f64; 3]]) -> ManeuverPlan {
        let line: Vec<Vec3> = line.iter().map(|p| Vec3::from(*p)).collect();
        ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap()
    }

    #[test]
    fn left_turns_are_positive_and_slight_bends_are_no_turns() {
        let r = plan(&[[0., 0., 0.], [10., 0., 0.], [10., 10., 0.], [20., 11., 0.], [30., 10., 0.]]);
        let turns: Vec<f64> = r.maneuvers().iter().map(|m| m.turn_rad.to_degrees().round()).collect();
        assert_eq!(turns, [90.0, -84.0]);
        assert_eq!(r.maneuvers()[0].at_m, 10.0);
        assert!((r.point_at(15.0) - Vec2::new(10.0, 5.0)).norm() < 1e-12);
    }

    #[test]
    fn bends_of_a_corner_merge_and_near_turns_join() {
        let r =
            plan(&[[0., 0., 0.], [10., 0., 0.], [11., 1., 0.], [11., 5., 0.], [20., 5., 0.], [20., 20., 0.]]);
        let m = r.maneuvers();
        assert_eq!(m.len(), 3);
        assert!((m[0].turn_rad.to_degrees() - 90.0).abs() < 1e-9 && m[0].end_m > m[0].at_m);
        assert!(!m[0].joined && !m[1].joined && !m[2].joined);
        let r = plan(&[[0., 0., 0.], [10., 0., 0.], [10., 3., 0.], [20., 3., 0.]]);
        assert!(r.maneuvers()[1].joined);
    }

    #[test]
    fn stairs_are_found_in_both_directions() {
        let up = [[0., 0., 0.], [6., 0., 0.], [10., 0., 2.5], [16., 0., 2.5]];
        let m = plan(&up).maneuvers().to_vec();
        assert_eq!((m.len(), m[0].stairs, m[0].at_m), (1, Some(Stairs::Up), 6.0));
        let mut down = up;
        down.reverse();
        assert_eq!(plan(&down).maneuvers()[0].stairs, Some(Stairs::Down));
        // A ramp and a kerb are not stairs.
        assert!(!plan(&[[0., 0., 0.], [20., 0., 3.0]]).has_stairs());
        assert!(!plan(&[[0., 0., 0.], [5., 0., 0.], [5.3, 0., 0.2], [9., 0., 0.2]]).has_stairs());
    }

    #[test]
    fn unusable_polylines_are_errors() {
        let new = |l: &[Vec3]| ManeuverPlan::new(l, &Ground::z_up(), &ManeuverPlanConfig::default());
        assert_eq!(new(&[]), Err(ManeuverPlanError::TooShort(0)));
        assert_eq!(new(&[Vec3::x(), Vec3::x()]), Err(ManeuverPlanError::TooShort(1)));
        assert_eq!(new(&[Vec3::x(), Vec3::new(0.0, f64::NAN, 0.0)]), Err(ManeuverPlanError::NotFinite(1)));
    }
}
