//! `inertial`: real IMUs on real motion, with ground-truth poses in place of a camera: drift of pure IMU prediction,
//! and initialisation at many times under several conditions.

pub mod data;
pub mod drift;
pub mod reference;
pub mod tries;

use crate::MeasureError;
use data::ImuRecording;
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
    /// Time offset between ground truth and IMU estimated on the whole recording, ms; `None` where it rotates too
    /// little.
    pub own_offset_ms: Option<f64>,
    /// Rotation between the ground truth's body frame and the sensor, degrees.
    pub own_rotation_deg: Option<f64>,
    /// Angle between gravity and the -z axis of the ground truth, degrees.
    pub gravity_tilt_deg: f64,
    /// Drift of pure IMU prediction.
    pub drift: Vec<Drift>,
    /// Initialisation.
    pub tries: Vec<Tried>,
}

/// Selection of what is measured.
#[derive(Clone, Copy, Debug)]
pub struct Chosen<'a> {
    /// Only recordings whose name contains this.
    pub recording: Option<&'a str>,
    /// Only conditions whose name contains this.
    pub condition: Option<&'a str>,
    /// Uses every n-th start.
    pub every: usize,
}

/// Measures; missing recordings are reported on stderr.
///
/// # Errors
/// When an existing recording cannot be read.
pub fn run(data: &Path, chosen: &Chosen) -> Result<Vec<Figures>, MeasureError> {
    let holds = |name: &str, part: Option<&str>| part.is_none_or(|p| name.contains(p));
    let mut out = Vec::new();
    for name in data::NAMES.into_iter().filter(|n| holds(n, chosen.recording)) {
        if !data.join("imu-truth").join(name).exists() {
            eprintln!("skipped: imu-truth/{name} is not in {}", data.display());
            continue;
        }
        let motion = ImuRecording::read(data, name)?;
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
        "| recording | truth to IMU ms | truth to IMU deg | gravity to -z deg |\n|---|---|---|---|\n",
    );
    let or = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.2}"));
    for f in figures {
        let (offset, rotation) = (or(f.own_offset_ms), or(f.own_rotation_deg));
        let _ = writeln!(t, "| {} | {offset} | {rotation} | {:.2} |", f.name, f.gravity_tilt_deg);
    }
    t += "\n| recording | duration s | starts | position m p50 / p95 | rotation deg p50 / p95 | position error / sigma |\n|---|---|---|---|---|---|\n";
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
    format!("{HEAD}\n{}\nMeasured on {}.\n", tables(figures), crate::build::measured_on())
}

const HEAD: &str = "# IMU drift and initialisation

Real sensors on real motion (EuRoC: an ADIS16448 on a quadrotor; TUM-VI: a handheld BMI160), without images: ground-truth
poses with added noise replace the camera. `cargo run --release -p bench -- inertial --write` prints and writes this page.

How it is measured. The reference values of gravity, biases and velocities are estimated from the exact poses at their true
scale, in windows of 20 s (`reference.rs`). The first table shows how well ground truth and sensor agree: the clocks of V1_02
drift by 2 ms within the recording. *Drift* starts from a reference state and predicts with IMU samples alone; its errors are
several times what the noise of the data sheets explains, which is why initialisation multiplies that noise by at least five, and
by a factor fitted to the residuals.

*Initialisation*: starting every two seconds, key frames at 4 Hz with white noise on each rotation (0.1 degrees per axis unless
stated otherwise) and position (0.5 % of the median step plus one millimetre), in a map with its own axes and unit of length.
Attempts continue with more and more key frames, from 1.5 s on, until every gate is passed or 15 s are over; starts with a gap in
the ground truth are left out. *Wrong* counts first estimates with a scale error above 5 %. Scale errors are given for the first
estimate, and again with 5 s and with 15 s of key frames where these are accepted. *Error / sigma* is the error of the first
scale divided by its own standard deviation. *Offset*: estimated from ten seconds of rotations at 20 Hz and compared with the
estimate from the same seconds without noise; where it is not estimated first, the IMU stamps are wrong by 20 ms. Bias steps: both
biases jump every ten seconds by 3 mrad/s and 0.05 m/s^2 per axis. Half the rate: the means of pairs, as from a sensor configured
to that rate, or every second sample unchanged. *Noise times*: the factor fitted to the residuals, for gyroscope and accelerometer.

Limitations: a quadrotor that moves slowly (V2_01) or hovers gives little information about scale, and first estimates from 2 to
5 s are accurate to a few percent only, slightly worse than their standard deviations claim; on V1_02 a scale error of about 1.2 %
remains after 15 s in all windows. Taking every second sample of a vibrating quadrotor aliases the vibration into the motion: thirty
times the noise of the data sheet, and no usable scale within 15 s; the sensor's own low-pass filter must prevent that. An unknown
offset of 20 ms is mostly rejected, because it looks like gyroscope noise; it must be estimated first.

What the scale is worth, from windows of 30 s of the true poses as they are (positions stated to 1 mm, rotations to 1 mrad, their noise not
fitted; constants of `initialise/map.rs` set by hand, so no command prints this): TUM-VI -0.1 to -0.4 %, V1_02 -0.8 to -1.4 +- 0.2 %, V2_01 +0.3 to -2.6 +- 0.7 %, MH_03 -0.3 to
-0.9 +- 0.5 % while it flies fast, -3.1 and -3.9 +- 1.1 % before. The bound is half a percent or better with a hand-held sensor, and for seconds 78 to 108 of MH_03 and
later; V2_01 does not reach it. On V1_02 readings and truth differ by more than the bound: neither the clocks' offset (estimated with
it) nor gravity's norm left free, which is a common scale factor of the accelerometer, changes its scale by more than 0.4 %, and it grows along the
recording. Where motion is small the scale hangs on how the residuals are shared between poses and readings: with the poses of MH_03 stated twice as noisy those
two become +0.1 and +0.8 %. Pose noise that is taken for noise of the readings makes the scale too small, as any error in a regressor does.

MH_01 (moved by hand for 14 s) is not within half a percent either. With one camera its map ends 1 % too large, and so say the readings by themselves: the double
differences of positions over 0.3 and 0.5 s, from the map of the stereo pair, whose scale is within 0.1 % of the truth, against the readings integrated twice, by least squares over
scale, gravity and bias (a script of its own, nothing of the solver here), make the readings 0.9 and 1.0 +- 0.35 % too large. Left free as well, gravity's norm, a delay of the accelerometer
(0.0 +- 0.9 ms) or the misalignment of its axes change that by 0.1 %, its place on the rig by 0.3 %; with the positions of the truth it is 0.3 +- 0.3 %. The whole
adjustment takes them at their word: run to convergence (tolerance 1e-9 instead of 1e-6) it ends at the same 0.92 % of its key frames, and with each adjustment before it converged
too at 0.77 %. The standard deviation that initialisation states for all of it, 0.12 %, is that of white noise alone and three times too small. The biases, (-0.01, 0.19, 0.09) m/s^2, are
those that the stereo map and the truth give, (-0.02, 0.20, 0.08) and (-0.02, 0.19, 0.11), each +- 0.03. Fitting the noise of the readings again with each whole adjustment, instead of
once when the map is aligned (5 and 5 times the data sheet instead of 9 and 9), gave 0.98 % and 0.0044 m instead of 1.06 % and 0.0047 m, with at least 2 times instead of 5 times 0.96 % and
0.0045 m; but a map of the rendered room of MH_03 (from second 18 on) was 10.8 instead of 7.1 % too large when its ten seconds were adjusted,
4.0 instead of 3.8 % after that, and 2.20 instead of 2.26 % at the end of 30 s, one of V2_01 0.99 instead of 0.86 %: no gain, not kept.

How many first estimates are more than 5 % off is what the draws decide: 2, 2 and 5 on MH_03, V1_02 and V2_01 with an earlier generator of random numbers, 4, 5 and 6 with this one, by the
same solver (commits 871472e and 8f29eba, between which only the draws of these trials changed what the rows show): 9 and 15 of 126 starts.

It is also what the gate allows: most are accepted at a sigma of 2.7 to 3 %, so that 5 % is 1.8 sigma, and error over
sigma is 0.8 to 1.5 in most rows. By these numbers a gate of 1.5 % would leave one or two in a hundred, and be passed seconds later (not tried).

The noise of the poses is fitted: it is halved as long as the evidence rises. But the evidence takes the vibration of a quadrotor for white noise and prefers poses that are too exact. With rotations as they are and 1 mm of noise on positions,
starts of 15 s: halving and a variance factor below one (as now) against neither: first estimates more than 5 % off 9 and 4 of 52 on MH_03, 13
and 5 of 42 on V2_01, 3 and 3 of 32 on V1_02; median scale error after 15 s 2.3 and 1.2, 3.3 and 1.2, 1.4 and 1.2 %; error over sigma of the first 1.5 and
1.1, 1.9 and 1.4, 1.3 and 1.3. With 0.1 degrees and 0.5 % nothing changes (2 and 3, 5 and 6, 2 and 2 wrong, with other draws of the noise than above), and without halving the
whole engine is 0.98 instead of 0.87 % off on MH_01. So it is left as it is until the whole motions have been measured both ways with the whole engine.
";
