//! `inertial`: real IMUs on real motion, with ground-truth poses in place of a camera: drift of pure IMU prediction,
//! and initialisation at many times under several conditions.

pub mod data;
pub mod drift;
mod exact;
pub mod reference;
pub mod tries;

pub use exact::exact_scale;

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
