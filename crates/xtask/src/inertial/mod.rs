//! `inertial`: what real inertial sensors give on real motion, with the true poses in place of an eye: drift without one,
//! and initialisation at many times under several conditions.

pub mod data;
pub mod drift;
pub mod reference;
pub mod tries;

use data::Motion;
use drift::Drift;
use reference::Reference;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use tries::{CONDITIONS, Tried};

/// All figures of one recording.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Recording.
    pub name: &'static str,
    /// Offset between truth and readings as found on the whole recording, ms; none where it turns too little.
    pub own_offset_ms: Option<f64>,
    /// Rotation between the truth's body and the sensor, degrees.
    pub own_rotation_deg: Option<f64>,
    /// Angle between gravity and the truth's -z, degrees.
    pub gravity_tilt_deg: f64,
    /// Drift without an eye.
    pub drift: Vec<Drift>,
    /// Initialisation.
    pub tries: Vec<Tried>,
}

/// What is measured.
#[derive(Clone, Copy, Debug)]
pub struct Chosen<'a> {
    /// Only recordings whose name holds this.
    pub recording: Option<&'a str>,
    /// Only conditions whose name holds this.
    pub condition: Option<&'a str>,
    /// Every so-many-th start.
    pub every: usize,
}

/// Measures; what is missing is told on stderr.
///
/// # Errors
/// When a recording that is there can not be read.
pub fn run(data: &Path, chosen: &Chosen) -> Result<Vec<Figures>, String> {
    let holds = |name: &str, part: Option<&str>| part.is_none_or(|p| name.contains(p));
    let mut out = Vec::new();
    for name in data::NAMES.into_iter().filter(|n| holds(n, chosen.recording)) {
        if !data.join("imu-truth").join(name).exists() {
            eprintln!("skipped: imu-truth/{name} is not in {}", data.display());
            continue;
        }
        let motion = Motion::read(data, name)?;
        let reference = Reference::of(&motion);
        let mut tries = Vec::new();
        for condition in CONDITIONS.iter().filter(|c| holds(c.name, chosen.condition)) {
            tries.push(tries::measure(&motion, &reference, condition, chosen.every));
            eprintln!("{name}: {} done", condition.name);
        }
        out.push(Figures {
            name,
            own_offset_ms: reference.clock.map(|c| c.offset_s * 1e3),
            own_rotation_deg: reference.clock.map(|c| c.misaligned.to_degrees()),
            gravity_tilt_deg: reference.gravity.angle(&-cairn_geometry::Vec3::z()).to_degrees(),
            drift: drift::measure(&motion, &reference),
            tries,
        });
    }
    Ok(out)
}

/// The figures as tables in Markdown.
pub fn tables(figures: &[Figures]) -> String {
    let mut t = String::from(
        "| recording | truth to IMU ms | truth to IMU deg | gravity off -z deg |\n|---|---|---|---|\n",
    );
    let or = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.2}"));
    for f in figures {
        let (offset, rotation) = (or(f.own_offset_ms), or(f.own_rotation_deg));
        let _ = writeln!(t, "| {} | {offset} | {rotation} | {:.2} |", f.name, f.gravity_tilt_deg);
    }
    t += "\n| recording | over s | starts | place m p50 / p95 | turn deg p50 / p95 | place error / sigma |\n|---|---|---|---|---|---|\n";
    for d in figures.iter().flat_map(|f| &f.drift) {
        let _ = writeln!(
            t,
            "| {} | {:.0} | {} | {:.3} / {:.3} | {:.3} / {:.3} | {:.1} |",
            d.name,
            d.seconds,
            d.tries,
            d.place_m[0],
            d.place_m[1],
            d.turn_deg[0],
            d.turn_deg[1],
            d.place_over_sigma
        );
    }
    t += "\n| recording | condition | accepted | wrong | first s p50 / p95 | scale % first p50 / p95 | at 5 s | at 15 s | error / sigma | gravity deg | gyro bias mrad/s | accel bias m/s^2 | noise times gyro / accel | offset ms p50 / max (found) |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    for r in figures.iter().flat_map(|f| &f.tries) {
        let pair = |v: [f64; 2]| format!("{:.2} / {:.2}", v[0], v[1]);
        let offset = match r.offsets {
            0 => "-".to_owned(),
            n => format!("{} ({n})", pair(r.offset_ms)),
        };
        let _ = writeln!(
            t,
            "| {} | {} | {}/{} | {} | {:.1} / {:.1} | {} | {} | {} | {:.1} | {} | {} | {} | {} | {offset} |",
            r.name,
            r.condition,
            r.accepted,
            r.starts,
            r.wrong,
            r.first_s[0],
            r.first_s[1],
            pair(r.scale_percent[0]),
            pair(r.scale_percent[1]),
            pair(r.scale_percent[2]),
            r.scale_over_sigma,
            pair(r.gravity_deg),
            pair(r.gyro_bias.map(|v| v * 1e3)),
            pair(r.accel_bias),
            pair(r.noise_times),
        );
    }
    t
}

/// The page `docs/inertial.md`.
pub fn page(figures: &[Figures]) -> String {
    format!("{HEAD}\n{}", tables(figures))
}

const HEAD: &str = "# What the inertial sensors give

Real sensors on real motion (EuRoC: a quadrotor's ADIS16448; TUM-VI: a hand's BMI160), without images: the true poses, made
worse, stand in place of an eye. `cargo run --release -p xtask -- inertial --write` prints and writes this page.

How it is measured. Gravity, biases and velocities that count as true come from the exact poses at their true scale, in windows
of 20 s (`reference.rs`). The first table says how well truth and sensor agree by themselves: the clocks of V1_02 drift by
2 ms within the recording. *Drift* starts from a true state and predicts by the readings alone; its errors are some times what
the data sheets' noise explains, which is why initialisation multiplies that noise by five at least, and by what is left over.

*Tries*: from every other second on, key frames at 4 Hz with white noise on each rotation (0.1 degrees an axis where nothing
else is said) and place (0.5 % of the median step and a millimetre), in a map with axes and a unit of its own. Tries go on with
ever more key frames, from 1.5 s on, until every gate is passed or 15 s have gone; a start within which the truth has a hole is
left out. *Wrong* counts first estimates with a scale off by more than 5 %. Scale errors are told at the first estimate, and
again with 5 s and with 15 s of key frames, where they are accepted then. *Error / sigma* is the first scale's error over what
it says of itself. *Offset*: found from ten seconds of rotations at 20 Hz, against what the same seconds without noise give;
and where it is not found first, the readings stand 20 ms off. Bias steps: both biases jump every ten seconds by 3 mrad/s and
0.05 m/s^2 an axis. Half the rate: the means of pairs, as a sensor gives them that is set to that rate, or every second sample
as it is. *Noise times*: what is left over, laid to the gyroscope and to the accelerometer.

What is weak: a quadrotor that moves slowly (V2_01) or stands gives little to find scale from, and first estimates of 2 to
5 s are good to a few percent only, a little worse than they say; on V1_02 some 1.2 % of scale remains after 15 s in all
windows alike. Every second sample of a trembling quadrotor folds the tremble into the motion: thirty times the data sheet's
noise, and no scale worth the name within 15 s; the sensor's own filter must see to that. An unknown offset of 20 ms is
mostly refused, by the gyroscope's noise that it looks like; it is to be found first.
";
