//! Reads a trajectory in TUM format: `t x y z qx qy qz qw`, seconds and metres, `#` starts a comment.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{SourceError, Stamp};
use std::path::Path;

/// The poses of a file in their order.
///
/// # Errors
/// Names the file and the line when it cannot be read, a line does not hold eight numbers, or there is no pose.
pub fn read_tum(path: &Path) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    let name = path.display().to_string();
    let text = cairn_files::read_text(path, 1024 * cairn_files::MIB).map_err(|e| {
        SourceError::new(&name, e.to_string(), "give a readable file of lines \"t x y z qx qy qz qw\"")
    })?;
    let mut poses = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let bad = |why: String| {
            SourceError::new(format!("{name}:{}", i + 1), why, "write eight numbers: t x y z qx qy qz qw")
        };
        let fields: Vec<&str> = line.split([' ', '\t', ',']).filter(|f| !f.is_empty()).collect();
        if fields.len() != 8 {
            return Err(bad(format!("has {} fields", fields.len())));
        }
        let mut v = [0f64; 7];
        for (out, f) in v.iter_mut().zip(&fields[1..]) {
            *out = f.parse().map_err(|_| bad(format!("\"{f}\" is not a number")))?;
            if !out.is_finite() {
                return Err(bad(format!("\"{f}\" is not finite")));
            }
        }
        let stamp = stamp(fields[0]).ok_or_else(|| bad(format!("\"{}\" is not a time", fields[0])))?;
        let rotation =
            So3::from_xyzw(v[3], v[4], v[5], v[6]).ok_or_else(|| bad("the quaternion is zero".into()))?;
        poses.push((stamp, Se3::new(rotation, Vec3::new(v[0], v[1], v[2]))));
    }
    if poses.is_empty() {
        return Err(SourceError::new(
            name,
            "holds no pose",
            "write eight numbers a line: t x y z qx qy qz qw",
        ));
    }
    Ok(poses)
}

/// Seconds to nanoseconds; plain decimals keep every digit.
fn stamp(s: &str) -> Option<Stamp> {
    if let Some((whole, part)) = s.split_once('.')
        && (1..=12).contains(&part.len())
        && whole.len() <= 10
        && whole.bytes().chain(part.bytes()).all(|b| b.is_ascii_digit())
        && !whole.is_empty()
    {
        let nanos: String = part.chars().chain("000000000".chars()).take(9).collect();
        return Some(Stamp(whole.parse::<i64>().ok()? * 1_000_000_000 + nanos.parse::<i64>().ok()?));
    }
    let v: f64 = s.parse().ok()?;
    (v.is_finite() && v.abs() < 9e9).then(|| Stamp::from_seconds(v))
}
