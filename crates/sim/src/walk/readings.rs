//! Reads IMU recordings: `timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]`, `#` starts a comment.

use cairn_geometry::Vec3;
use cairn_sensor::{ImuSample, SourceError, Stamp};
use std::path::Path;

/// The readings of a file in their order, in the body frame.
///
/// # Errors
/// Names the file and the line when it cannot be read, a line does not hold seven numbers, a time does not increase, or
/// there are fewer than ten readings.
pub fn read_readings(path: &Path) -> Result<Vec<ImuSample>, SourceError> {
    const CURE: &str = "write seven numbers a line: time in ns, gyro xyz in rad/s, accel xyz in m/s^2";
    let name = path.display().to_string();
    let text = cairn_files::read_text(path, 1024 * cairn_files::MIB)
        .map_err(|e| SourceError::new(&name, e.to_string(), CURE))?;
    let mut readings: Vec<ImuSample> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let bad = |why: String| SourceError::new(format!("{name}:{}", i + 1), why, CURE);
        let fields: Vec<&str> = line.split([' ', '\t', ',']).filter(|f| !f.is_empty()).collect();
        let [time, numbers @ ..] = fields.as_slice() else { continue };
        if numbers.len() != 6 {
            return Err(bad(format!("has {} fields", fields.len())));
        }
        let stamp = time.parse::<i64>().ok().filter(|ns| ns.unsigned_abs() < 1 << 61).map(Stamp);
        let stamp = stamp.ok_or_else(|| bad(format!("\"{time}\" is not a time in ns")))?;
        if readings.last().is_some_and(|last| stamp <= last.stamp) {
            return Err(bad("the time does not increase".into()));
        }
        let mut v = [0f64; 6];
        for (out, f) in v.iter_mut().zip(numbers) {
            *out = f.parse().map_err(|_| bad(format!("\"{f}\" is not a number")))?;
            if !out.is_finite() {
                return Err(bad(format!("\"{f}\" is not finite")));
            }
        }
        readings.push(ImuSample::new(stamp, Vec3::new(v[0], v[1], v[2]), Vec3::new(v[3], v[4], v[5])));
    }
    if readings.len() < 10 {
        return Err(SourceError::new(name, format!("holds {} readings", readings.len()), CURE));
    }
    Ok(readings)
}
