//! A walker: from corners on the floor to the smooth motion of a body that carries the camera on the chest.
//!
//! First a plan of straight legs, stops and turns with time; then position and heading are averaged over a
//! window (which rounds corners and gives smooth starts); then the gait is added; a quintic spline through that
//! is the motion. Gait: vertical motion at the step rate, sway at half of it (Inman, "Human walking", 1981).

use super::ContinuousTrajectory;
use cairn_geometry::{Mat3, Se3, So3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// The pace and gait of a walker.
#[derive(Clone, Debug, PartialEq)]
pub struct Walker {
    /// Metres a second on straight legs.
    pub speed: f64,
    /// Height of the camera above the floor, metres.
    pub height: f64,
    /// Downward pitch of the camera in radians.
    pub pitch_down: f64,
    /// Size of the gait: 1 is a usual one (vertical motion of 2.6 cm from top to bottom), 0 glides.
    pub gait: f64,
    /// Angle in radians by which the camera looks to the left of the walking direction: pi looks back.
    pub look: f64,
    /// Turning rate in radians a second.
    pub turn_rate: f64,
    /// Corners sharper than this (radians) are turned on the spot.
    pub spot_turn: f64,
    /// Seconds of standing at the start and at the end.
    pub rest_s: f64,
    /// Seconds of standing at corners, and every how many corners (0: never).
    pub pause_s: f64,
    /// See `pause_s`.
    pub pause_every: usize,
}

impl Default for Walker {
    fn default() -> Self {
        Self {
            speed: 0.9,
            height: 1.3,
            pitch_down: 0.09,
            gait: 1.0,
            look: 0.0,
            turn_rate: 1.1,
            spot_turn: 1.9,
            rest_s: 0.6,
            pause_s: 0.0,
            pause_every: 0,
        }
    }
}

/// The plan: time, place, heading; linear in between.
struct Plan {
    nodes: Vec<(f64, Vec2, f64)>,
}

/// Samples a second of the plan and of the spline's control points.
const RATE_HZ: f64 = 50.0;
/// Seconds over which position is averaged, three times.
const SMOOTH_PLACE_S: f64 = 0.36;
/// Seconds over which heading is averaged, three times.
const SMOOTH_HEADING_S: f64 = 0.24;

impl Walker {
    /// The body's motion along a polyline from time 0; for empty and single-point routes it stands still for a second.
    pub fn motion(&self, points: &[Vec2]) -> ContinuousTrajectory {
        let plan = self.plan(points);
        let total = plan.nodes.last().map_or(1.0, |n| n.0);
        let n = (total * RATE_HZ).ceil() as usize + 1;
        let raw: Vec<(Vec2, f64)> = (0..n).map(|i| plan.at(i as f64 / RATE_HZ)).collect();
        let axis = |f: &dyn Fn(&(Vec2, f64)) -> f64, seconds: f64| -> Vec<f64> {
            let mut v: Vec<f64> = raw.iter().map(f).collect();
            for _ in 0..3 {
                v = box_average(&v, (seconds * RATE_HZ / 2.0).round() as usize);
            }
            v
        };
        let (x, y) = (axis(&|r| r.0.x, SMOOTH_PLACE_S), axis(&|r| r.0.y, SMOOTH_PLACE_S));
        let heading = axis(&|r| r.1, SMOOTH_HEADING_S);
        let mut phase = 0.0;
        let mut poses = Vec::with_capacity(n);
        for i in 0..n {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            let pace = (x[b] - x[a]).hypot(y[b] - y[a]) * RATE_HZ / (b - a).max(1) as f64;
            phase += Self::steps_per_s(pace) * TAU / RATE_HZ;
            poses.push(self.body(Vec2::new(x[i], y[i]), heading[i], phase, (pace / 0.8).clamp(0.0, 1.0)));
        }
        ContinuousTrajectory::sampled(0.0, 1.0 / RATE_HZ, &poses)
    }

    /// Steps a second at a pace in m/s: step lengths of 0.55 to 0.7 m, the rate grows with the square root of the pace.
    pub fn steps_per_s(pace: f64) -> f64 {
        1.75 * pace.max(0.0).sqrt()
    }

    /// The body (camera: x right, y down, z forward) at a place with its gait, for walkers whose route is not known
    /// in advance. `heading` is the walking direction, radians from x; `phase` is the angle of the steps, 2 pi for each
    /// (see [`Walker::steps_per_s`]); `strength` goes from 0 at rest to 1 at a usual pace.
    pub fn body(&self, at: Vec2, heading: f64, phase: f64, strength: f64) -> Se3 {
        let strength = self.gait * strength;
        let stride = phase / 2.0;
        let up = 0.013 * strength * phase.cos();
        let side = 0.014 * strength * stride.sin();
        let yaw = 0.014 * strength * (stride + 0.6).sin();
        let pitch = self.pitch_down + 0.009 * strength * (phase + 0.9).cos();
        let roll = 0.012 * strength * (stride + 0.3).cos();
        let right = Vec3::new(heading.sin(), -heading.cos(), 0.0);
        let place = Vec3::new(at.x, at.y, self.height + up) + right * side;
        let turn = So3::exp(&Vec3::new(-pitch, 0.0, 0.0)) * So3::exp(&Vec3::new(0.0, 0.0, roll));
        Se3::new(facing(heading + self.look + yaw) * turn, place)
    }

    /// Legs, turns and stops in time.
    fn plan(&self, points: &[Vec2]) -> Plan {
        let mut corners: Vec<Vec2> = Vec::new();
        for p in points {
            if corners.last().is_none_or(|l| (p - l).norm() > 1e-3) {
                corners.push(*p);
            }
        }
        let speed = self.speed.clamp(0.05, 5.0);
        let rate = self.turn_rate.clamp(0.1, 6.0);
        let first = corners.first().copied().unwrap_or_else(Vec2::zeros);
        if corners.len() < 2 {
            return Plan { nodes: vec![(0.0, first, 0.0), (1.0, first, 0.0)] };
        }
        let direction = |i: usize| (corners[i + 1] - corners[i]).y.atan2((corners[i + 1] - corners[i]).x);
        let mut heading = direction(0);
        let mut t = self.rest_s;
        let mut nodes = vec![(0.0, first, heading), (t, first, heading)];
        // The part of the leg that was already walked while turning at its start.
        let mut walked = 0.0;
        for i in 0..corners.len() - 1 {
            let (a, b) = (corners[i], corners[i + 1]);
            let length = (b - a).norm();
            let dir = (b - a) / length;
            let last = i + 2 == corners.len();
            let turn = if last { 0.0 } else { wrap(direction(i + 1) - direction(i)) };
            let on_spot = turn.abs() > self.spot_turn;
            let pause =
                if self.pause_every > 0 && (i + 1) % self.pause_every == 0 { self.pause_s } else { 0.0 };
            let turn_s = turn.abs() / rate;
            // A gentle corner is turned while walking: half the turn before it, half after.
            let next = if last { 0.0 } else { (corners[i + 2] - b).norm() };
            let reach = if on_spot || last {
                0.0
            } else {
                (0.5 * speed * turn_s).min(0.45 * length).min(0.45 * next)
            };
            let straight = (length - walked - reach).max(0.0);
            t += straight / speed;
            nodes.push((t, b - dir * reach, heading));
            if on_spot || pause > 0.0 {
                t += reach / speed + 0.3;
                nodes.push((t, b, heading));
                t += pause;
                nodes.push((t, b, heading));
                heading += turn;
                t += turn_s;
                nodes.push((t, b, heading));
                t += 0.3;
                nodes.push((t, b, heading));
                walked = 0.0;
            } else if !last {
                let after = (corners[i + 2] - b) / next.max(1e-9);
                let half = (reach / speed).max(0.5 * turn_s.min(0.8));
                t += half;
                nodes.push((t, b, heading + 0.5 * turn));
                heading += turn;
                t += half;
                nodes.push((t, b + after * reach, heading));
                walked = reach;
            }
        }
        let end = corners[corners.len() - 1];
        nodes.push((t + self.rest_s.max(0.05), end, heading));
        Plan { nodes }
    }
}

impl Plan {
    fn at(&self, t: f64) -> (Vec2, f64) {
        let i = self.nodes.partition_point(|n| n.0 <= t);
        if i == 0 || i == self.nodes.len() {
            let n = &self.nodes[i.saturating_sub(1).min(self.nodes.len() - 1)];
            return (n.1, n.2);
        }
        let (a, b) = (&self.nodes[i - 1], &self.nodes[i]);
        let k = (t - a.0) / (b.0 - a.0).max(1e-9);
        (a.1 + (b.1 - a.1) * k, a.2 + (b.2 - a.2) * k)
    }
}

/// The camera's rotation when it looks level along a heading.
pub(crate) fn facing(heading: f64) -> So3 {
    let (s, c) = heading.sin_cos();
    let (right, down, forward) = (Vec3::new(s, -c, 0.0), -Vec3::z(), Vec3::new(c, s, 0.0));
    So3::from_matrix(&Mat3::from_columns(&[right, down, forward]))
}

/// An angle brought into -pi..pi.
fn wrap(a: f64) -> f64 {
    let w = (a + PI).rem_euclid(TAU) - PI;
    // A turn around goes to the left.
    if w <= -PI + 1e-9 { PI } else { w }
}

/// The running mean over `2 half + 1` samples, ends repeated.
fn box_average(v: &[f64], half: usize) -> Vec<f64> {
    let n = v.len();
    let get = |i: isize| v[i.clamp(0, n as isize - 1) as usize];
    let half = half as isize;
    let scale = 1.0 / (2 * half + 1) as f64;
    let mut sum: f64 = (-half..=half).map(get).sum();
    let mut out = Vec::with_capacity(n);
    for i in 0..n as isize {
        out.push(sum * scale);
        sum += get(i + half + 1) - get(i - half);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_around_on_the_spot_and_bobs() {
        let route = [Vec2::new(0.0, 0.0), Vec2::new(6.0, 0.0), Vec2::new(0.0, 0.0)];
        let motion = Walker::default().motion(&route);
        let (mut turned, mut low, mut high, mut fastest) = (0.0, 9.0f64, 0.0f64, 0.0f64);
        let n = (motion.end() * 100.0) as usize;
        for i in 0..n {
            let s = motion.state(i as f64 / 100.0);
            let p = s.world_from_body.translation;
            // Down is the body's y: turning left is negative about it.
            turned -= s.rate.y / 100.0;
            if s.rate.norm() > 0.7 {
                assert!((p.x - 6.0).abs() < 0.12 && p.y.abs() < 0.05, "turns at {p:?}");
            }
            if (1.5..4.5).contains(&p.x) {
                (low, high) = (low.min(p.z), high.max(p.z));
            }
            fastest = fastest.max(s.velocity.norm());
        }
        assert!((turned - PI).abs() < 0.05, "turned by {turned}");
        assert!((0.02..0.03).contains(&(high - low)), "bobs by {}", high - low);
        assert!((0.85..1.0).contains(&fastest), "at most {fastest} m/s");
        let end = motion.pose(motion.end());
        assert!((end.translation.xy() - route[2]).norm() < 0.03);
    }

    #[test]
    fn camera_facing_back() {
        let route = [Vec2::new(0.0, 0.0), Vec2::new(3.0, 4.0)];
        let back = Walker { look: PI, ..Walker::default() }.motion(&route);
        let s = back.state(3.0);
        let forward = s.world_from_body.rotation * Vec3::z();
        assert!(forward.dot(&s.velocity.normalize()) < -0.95);
    }
}
