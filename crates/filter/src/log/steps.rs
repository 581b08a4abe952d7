//! Converts a log to the input of filters and smoothers: one motion between two instants with sightings, then the
//! sightings.

use super::{Entry, Event, Reading, RobotLog};
use crate::measure::{Measurement, MeasurementError};
use crate::motion::{Motion, VelocityModel, along_arc};
use nalgebra::{Matrix2, Matrix3};

/// The target of a sighting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Target {
    /// A landmark with a readable label (a barcode, the number of a radio).
    Landmark(u32),
    /// Another robot, by its index in the list.
    Robot(usize),
    /// A landmark without a label.
    Unlabelled,
}

/// One thing seen at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// The target.
    pub target: Target,
    /// The measurement.
    pub measurement: Measurement,
}

/// A motion, and the sightings at its end.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Seconds from the start of the log, at the end of the motion.
    pub time_s: f64,
    /// Motion since the previous step.
    pub motion: Motion,
    /// Sightings at that time; may be empty.
    pub sightings: Vec<Sighting>,
}

/// Noise of a robot's odometry and of its sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Noise of velocities.
    pub velocity: VelocityModel,
    /// Standard deviation of a travelled distance for each square root of a metre, in sqrt(m).
    pub way: f64,
    /// Standard deviation of a turn for each square root of a metre travelled, in rad/sqrt(m).
    pub turn_by_way: f64,
    /// Standard deviation of a turn for each square root of a radian turned, in sqrt(rad).
    pub turn: f64,
    /// Standard deviation of a range: constant part, in metres.
    pub range_m: f64,
    /// Standard deviation of a range: part for each metre of range.
    pub range_by_range: f64,
    /// Standard deviation of a bearing in radians.
    pub bearing_rad: f64,
    /// Covariances that a log gives for its relative motions are multiplied by this.
    pub relative_scale: f64,
    /// Delay of the time stamps of sightings, in seconds: they are this much too late.
    pub sighting_delay_s: f64,
}

impl Noise {
    /// For the robots of MRCLAM: tuned on data set 1, by the landmark error over robots 1 to 3 together, so figures on
    /// that data set are figures of a tuned filter. The delay is the one that maximises the likelihood of the
    /// innovations.
    pub fn mrclam() -> Self {
        Self {
            velocity: VelocityModel {
                speed: 0.0035,
                speed_by_speed: 0.07,
                speed_by_turn: 0.02,
                turn: 0.005,
                turn_by_speed: 0.03,
                turn_by_turn: 0.1,
            },
            range_m: 0.1,
            range_by_range: 0.08,
            bearing_rad: 0.015,
            sighting_delay_s: 0.2,
            ..Self::plaza()
        }
    }

    /// For the robots of MRCLAM where labels are not used: the mean over robots 1 to 3 of the noise that makes the innovations of the labelled
    /// run likeliest (`figures noise`); no error of a map or a position has part in it. Errors of successive ranges are correlated (0.95), so that with
    /// labels a larger noise maps better ([`Noise::mrclam`]); associations need what a single sighting scatters by.
    pub fn mrclam_unlabelled() -> Self {
        Self {
            velocity: VelocityModel {
                speed: 0.024,
                speed_by_speed: 0.067,
                speed_by_turn: 0.195,
                turn: 0.007,
                turn_by_speed: 0.085,
                turn_by_turn: 0.221,
            },
            range_m: 0.018,
            range_by_range: 0.030,
            bearing_rad: 0.0045,
            ..Self::mrclam()
        }
    }

    /// For the robots of MRCLAM, with robust smoothing.
    pub fn mrclam_smoothing() -> Self {
        Self {
            velocity: VelocityModel {
                speed: 0.001,
                speed_by_speed: 0.14,
                speed_by_turn: 0.064,
                turn: 0.0001,
                turn_by_speed: 0.0285,
                turn_by_turn: 0.087,
            },
            range_m: 0.325,
            range_by_range: 0.18,
            bearing_rad: 0.005,
            ..Self::mrclam()
        }
    }

    /// For the mower of Plaza 1.
    pub fn plaza() -> Self {
        Self {
            velocity: VelocityModel {
                speed: 0.05,
                speed_by_speed: 0.05,
                speed_by_turn: 0.0,
                turn: 0.02,
                turn_by_speed: 0.0,
                turn_by_turn: 0.05,
            },
            way: 0.05,
            turn_by_way: 0.005,
            turn: 0.02,
            range_m: 0.6,
            range_by_range: 0.0,
            bearing_rad: 0.05,
            relative_scale: 1.0,
            sighting_delay_s: 0.0,
        }
    }

    /// A measurement: the reading with its noise.
    ///
    /// # Errors
    /// When the reading or the noise is invalid.
    pub fn measurement(&self, reading: &Reading) -> Result<Measurement, MeasurementError> {
        let range_deviation = |range: f64| self.range_m + self.range_by_range * range;
        match *reading {
            Reading::RangeBearing(range, bearing) => {
                Measurement::range_bearing(range, bearing, range_deviation(range), self.bearing_rad)
            }
            Reading::Range(range) => Measurement::range(range, range_deviation(range)),
            Reading::Bearing(bearing) => Measurement::bearing(bearing, self.bearing_rad),
            Reading::Position(p, covariance) => Measurement::position(p.x, p.y, &covariance),
        }
    }

    fn travel(&self, way_m: f64, turn_rad: f64) -> Motion {
        let way = self.way * self.way * way_m.abs();
        let turn = self.turn_by_way * self.turn_by_way * way_m.abs() + self.turn * self.turn * turn_rad.abs();
        along_arc(way_m, turn_rad, &Matrix2::new(way, 0.0, 0.0, turn))
    }
}

impl RobotLog {
    /// The steps of this robot: one for each instant with sightings and for each of `cuts` (rising times in seconds),
    /// and one at the end.
    ///
    /// # Errors
    /// When a reading with this noise is not a valid measurement.
    pub fn steps(&self, noise: &Noise, cuts: &[f64]) -> Result<Vec<Step>, MeasurementError> {
        let (steps, motion) = (Vec::new(), Motion::identity());
        let mut builder = Builder {
            noise,
            belief: self.belief(),
            steps,
            motion,
            velocity: None,
            heard: f64::NEG_INFINITY,
            now: None,
            accounted: 0.0,
        };
        // Three streams in order of time: controls, sightings (moved back by their delay), cuts.
        let (mut controls, mut seen): (Vec<&Entry>, Vec<&Entry>) = (Vec::new(), Vec::new());
        for entry in &self.entries {
            if matches!(entry.event, Event::Seen { .. }) { seen.push(entry) } else { controls.push(entry) }
        }
        let (mut controls, mut seen, mut cuts) =
            (controls.into_iter().peekable(), seen.into_iter().peekable(), cuts.iter().copied().peekable());
        loop {
            let control = controls.peek().map_or(f64::INFINITY, |e| e.time_s);
            let sighting = seen.peek().map_or(f64::INFINITY, |e| e.time_s - noise.sighting_delay_s);
            let cut = cuts.peek().copied().unwrap_or(f64::INFINITY);
            let time_s = control.min(sighting).min(cut);
            if time_s == f64::INFINITY {
                break;
            }
            builder.advance(time_s);
            // A control that ends at this time comes before the sightings of this time.
            if control == time_s {
                controls.next().into_iter().for_each(|e| builder.control(&e.event));
            } else if cut == time_s {
                cuts.next();
                builder.step(time_s);
            } else if let Some(Entry { event: Event::Seen { target, reading }, .. }) = seen.next() {
                let measurement = noise.measurement(reading)?;
                builder.step(time_s).sightings.push(Sighting { target: *target, measurement });
            }
        }
        if let Some(time_s) = builder.now {
            builder.step(time_s);
        }
        Ok(builder.steps)
    }
}

/// For how long a velocity is believed after it was given, and how fast the robot may be afterwards.
#[derive(Clone, Copy)]
struct Belief {
    for_s: f64,
    speed_m_s: f64,
    turn_rad_s: f64,
}

/// Fewer velocities than these do not tell how often they are given.
const FEW_VELOCITIES: usize = 20;

impl Belief {
    /// A motion of which only the greatest speed is known.
    fn unknown(&self, elapsed_s: f64) -> Motion {
        let [way, turn] = [self.speed_m_s, self.turn_rad_s].map(|speed| (speed * elapsed_s).powi(2));
        Motion { covariance: Matrix3::from_diagonal(&[way, way, turn].into()), ..Motion::identity() }
    }
}

impl RobotLog {
    /// A velocity is believed ten times as long as nineteen of twenty of the log's last, and at least a second.
    fn belief(&self) -> Belief {
        let given = |e: &Entry| match e.event {
            Event::Velocity { speed_m_s, turn_rad_s } => Some((e.time_s, speed_m_s.abs(), turn_rad_s.abs())),
            _ => None,
        };
        let given: Vec<(f64, f64, f64)> = self.entries.iter().filter_map(given).collect();
        let mut lasts: Vec<f64> = given.windows(2).map(|w| w[1].0 - w[0].0).collect();
        lasts.sort_by(f64::total_cmp);
        let usual = lasts.get(lasts.len() * 19 / 20).filter(|_| given.len() >= FEW_VELOCITIES);
        Belief {
            for_s: usual.map_or(f64::INFINITY, |s| (10.0 * s).max(1.0)),
            speed_m_s: given.iter().map(|g| g.1).fold(0.0, f64::max),
            // A robot that never turned while it told its velocity may do so afterwards.
            turn_rad_s: given.iter().map(|g| g.2).fold(0.1, f64::max),
        }
    }

    /// Spans without odometry, from and to in seconds: the last velocity is too old to be believed, while events go on. The
    /// robot may then have moved at up to the log's greatest speed.
    pub fn without_odometry(&self) -> Vec<(f64, f64)> {
        let belief = self.belief();
        let (mut spans, mut heard) = (Vec::new(), None);
        let last = self.entries.last().map(|e| e.time_s);
        let velocities = self.entries.iter().filter(|e| matches!(e.event, Event::Velocity { .. }));
        for time_s in velocities.map(|e| e.time_s).chain(last) {
            let since = heard.replace(time_s).map_or(f64::INFINITY, |at: f64| at + belief.for_s);
            if time_s > since {
                spans.push((since, time_s));
            }
        }
        spans
    }
}

struct Builder<'a> {
    noise: &'a Noise,
    belief: Belief,
    steps: Vec<Step>,
    /// Motion since the last step, up to `accounted`.
    motion: Motion,
    velocity: Option<(f64, f64)>,
    /// When the velocity was given last.
    heard: f64,
    now: Option<f64>,
    accounted: f64,
}

impl Builder<'_> {
    fn advance(&mut self, time_s: f64) {
        if self.now.is_none() {
            self.accounted = time_s;
        }
        self.now = Some(time_s);
    }

    /// Adds the motion at the last commanded velocity. An arc is exact for any duration, so this is done only when the
    /// velocity changes or a step is due: drivers repeat the same command many times a second.
    fn account(&mut self) {
        let now = self.now.unwrap_or(self.accounted);
        let believed = (self.heard + self.belief.for_s).min(now) - self.accounted;
        if let Some((speed, turn)) = self.velocity.filter(|_| believed > 0.0) {
            self.motion = self.motion.then(&self.noise.velocity.motion(speed, turn, believed));
        }
        let unknown = now - self.accounted - believed.max(0.0);
        if self.velocity.is_some() && unknown > 0.0 {
            self.motion = self.motion.then(&self.belief.unknown(unknown));
        }
        self.accounted = now;
    }

    fn control(&mut self, event: &Event) {
        match event {
            Event::Velocity { speed_m_s, turn_rad_s } => {
                let given = Some((*speed_m_s, *turn_rad_s));
                let now = self.now.unwrap_or(self.heard);
                if given != self.velocity || now > self.heard + self.belief.for_s {
                    self.account();
                    self.velocity = given;
                }
                self.heard = now;
            }
            Event::Travel { way_m, turn_rad } => {
                self.account();
                self.motion = self.motion.then(&self.noise.travel(*way_m, *turn_rad));
            }
            Event::Relative { before_from_after, covariance } => {
                self.account();
                let next = Motion {
                    before_from_after: *before_from_after,
                    covariance: covariance * self.noise.relative_scale,
                };
                self.motion = self.motion.then(&next);
            }
            Event::Seen { .. } => {}
        }
    }

    /// The step at this instant; a new one if there is none yet.
    fn step(&mut self, time_s: f64) -> &mut Step {
        if self.steps.last().is_none_or(|s| s.time_s < time_s) {
            self.account();
            let motion = std::mem::replace(&mut self.motion, Motion::identity());
            self.steps.push(Step { time_s, motion, sightings: Vec::new() });
        }
        let last = self.steps.len() - 1;
        &mut self.steps[last]
    }
}
