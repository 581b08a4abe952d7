//! Estimates the noise of a robot's log from the innovations of its own run: the noise that makes them likeliest.
//!
//! In: a log whose sightings have labels, and a first guess. Out: the noise. Source: Mehra, "On the identification of variances and adaptive
//! Kalman filtering", IEEE TAC 15(2), 1970; by maximum likelihood as in Gupta and Mehra, IEEE TAC 19(6), 1974. The likelihood of a run is
//! the product of those of its innovations, so no survey and no true pose has part in it. Coordinate descent over the logarithms of the
//! deviations: a run of the filter is cheap, and derivatives of its innovations are not needed.
//!
//! It is for logs that say nothing of their noise. White noise is assumed: on MRCLAM, whose ranges are too short by 1 to 4 %, what is
//! likeliest believes them too much, and the map is 5 to 8 cm worse than with the noise of that data set.

use crate::ekf::{EkfConfig, EkfSlam, FilterError};
use crate::log::{Event, Noise, Reading, RobotLog, Step, Target};
use cairn_geometry::Se2;
use nalgebra::Matrix3;

/// Sweeps over all parts of the noise.
const SWEEPS: usize = 10;
/// First step of the logarithm of a deviation.
const FIRST_STEP: f64 = 0.5;
/// A deviation is changed by at most this factor: one that nothing depends on would drift.
const MOST_CHANGE: f64 = 30.0;
/// Fewer sightings than this for each part of the noise tell it too poorly, and the guess is kept.
const SIGHTINGS_PER_PART: usize = 20;

/// A part of the noise that is estimated.
type Part = fn(&mut Noise) -> &mut f64;

/// The noise of this log, beginning with `guess`; the guess itself where the log has too few sightings.
pub fn calibrated(recorded: &RobotLog, guess: &Noise, config: &EkfConfig) -> Noise {
    let parts = parts(recorded, guess);
    let seen = |e: &&crate::log::Entry| matches!(e.event, Event::Seen { target: Target::Landmark(_), .. });
    if recorded.entries.iter().filter(seen).count() < SIGHTINGS_PER_PART * parts.len() {
        return *guess;
    }
    let cost = |noise: &Noise| unlikely(recorded, noise, config).unwrap_or(f64::INFINITY);
    let (mut best, mut least) = (*guess, cost(guess));
    let mut steps = vec![FIRST_STEP; parts.len()];
    for _ in 0..SWEEPS {
        for (part, step) in parts.iter().zip(&mut steps) {
            let tried = [*step, -*step].into_iter().filter_map(|by| {
                let next = changed(&best, guess, *part, by)?;
                Some((next, cost(&next)))
            });
            let better = tried.into_iter().find(|(_, c)| *c < least);
            *step *= if better.is_some() { 1.5 } else { 0.7 };
            (best, least) = better.unwrap_or((best, least));
        }
    }
    best
}

/// This noise with one part multiplied by `exp(by)`; `None` beyond what a guess is changed by.
fn changed(noise: &Noise, guess: &Noise, part: Part, by: f64) -> Option<Noise> {
    let (mut next, mut guess) = (*noise, *guess);
    let value = part(&mut next);
    *value *= by.exp();
    let within = (value.ln() - part(&mut guess).ln()).abs() <= MOST_CHANGE.ln();
    within.then_some(next)
}

/// The parts that the events of this log depend on and that are not zero.
fn parts(recorded: &RobotLog, guess: &Noise) -> Vec<Part> {
    let has = |is: &dyn Fn(&Event) -> bool| recorded.entries.iter().any(|e| is(&e.event));
    let reads = |is: &dyn Fn(&Reading) -> bool| {
        has(&|e| matches!(e, Event::Seen { target: Target::Landmark(_), reading } if is(reading)))
    };
    let mut parts: Vec<Part> = Vec::new();
    // The sensor first: while its noise is far off, that of the wheels hardly matters.
    if reads(&|r| matches!(r, Reading::RangeBearing(..) | Reading::Range(_))) {
        parts.extend::<[Part; 2]>([|n| &mut n.range_m, |n| &mut n.range_by_range]);
    }
    if reads(&|r| matches!(r, Reading::RangeBearing(..) | Reading::Bearing(_))) {
        parts.push(|n| &mut n.bearing_rad);
    }
    if has(&|e| matches!(e, Event::Velocity { .. })) {
        parts.extend::<[Part; 6]>([
            |n| &mut n.velocity.speed,
            |n| &mut n.velocity.speed_by_speed,
            |n| &mut n.velocity.speed_by_turn,
            |n| &mut n.velocity.turn,
            |n| &mut n.velocity.turn_by_speed,
            |n| &mut n.velocity.turn_by_turn,
        ]);
    }
    if has(&|e| matches!(e, Event::Travel { .. })) {
        parts.extend::<[Part; 3]>([|n| &mut n.way, |n| &mut n.turn_by_way, |n| &mut n.turn]);
    }
    if has(&|e| matches!(e, Event::Relative { .. })) {
        parts.push(|n| &mut n.relative_scale);
    }
    let mut guess = *guess;
    parts.retain(|part| *part(&mut guess) > 0.0);
    parts
}

/// Minus twice the log likelihood of a sighting, up to a constant, in the mean of a labelled run; an outlier counts up to the gate.
fn unlikely(recorded: &RobotLog, noise: &Noise, config: &EkfConfig) -> Option<f64> {
    let steps = recorded.steps(noise, &[]).ok()?;
    let mut filter = EkfSlam::new(*config);
    let robot = filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)).ok()?;
    let (mut sum, mut count) = (0.0, 0.0);
    for step in &steps {
        let more = of_step(&mut filter, robot, step, config).ok()?;
        (sum, count) = (sum + more[0], count + more[1]);
    }
    Some(sum / f64::max(count, 1.0)).filter(|v| v.is_finite())
}

fn of_step(
    filter: &mut EkfSlam,
    robot: usize,
    step: &Step,
    config: &EkfConfig,
) -> Result<[f64; 2], FilterError> {
    filter.predict(robot, &step.motion)?;
    let mut sum = [0.0; 2];
    for sighting in &step.sightings {
        let Target::Landmark(label) = sighting.target else { continue };
        if let Some([nis, determinant]) = filter.innovation(robot, label, &sighting.measurement) {
            let gate = config.gate(sighting.measurement.kind().rows());
            sum = [sum[0] + nis.min(gate) + determinant, sum[1] + 1.0];
        }
        filter.observe(robot, std::slice::from_ref(sighting))?;
    }
    Ok(sum)
}
