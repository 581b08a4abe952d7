//! Victoria Park as a text graph: lines `ODOMETRY from to x y angle` and `LANDMARK from to x y`, each with the upper
//! triangle of its covariance; landmarks and poses share one numbering.
//!
//! Source: Guivant, Nebot, "Optimization of the simultaneous localization and map-building algorithm" (2001) for the
//! data; the text form is that of Kaess, Ranganathan, Dellaert, "iSAM" (2008). It has no times: each step counts as one
//! second.

use super::lines::{content, label, numbers};
use super::{Entry, Event, Log, LogError, Noise, Reading, RobotLog, Target};
use cairn_geometry::{Se2, Vec2};
use nalgebra::{Matrix2, Matrix3};
use std::collections::BTreeMap;

/// Reads a log from text; `file` is the name used in messages.
///
/// # Errors
/// When a line has an unknown word, a wrong number of values, a value that is not finite, a covariance that is not
/// positive, a pose out of order, or a landmark that is not seen from the last pose (the error names the line); and
/// when there is no odometry.
pub fn parse_victoria(file: &str, text: &str) -> Result<Log, LogError> {
    let mut entries = Vec::new();
    let (mut pose, mut time_s) = (None, 0.0);
    for (line, content) in content(text) {
        let mut words = content.split_whitespace();
        let tag = words.next().unwrap_or_default();
        let event = match tag {
            "ODOMETRY" => {
                let names = ["from", "to", "x", "y", "angle", "xx", "xy", "xa", "yy", "ya", "aa"];
                let [from, to, x, y, angle, xx, xy, xa, yy, ya, aa] = numbers(file, line, words, names)?;
                let (from, to) = (label(file, line, from, "from")?, label(file, line, to, "to")?);
                at_pose(file, line, pose, from)?;
                pose = Some(to);
                time_s += 1.0;
                let covariance = Matrix3::new(xx, xy, xa, xy, yy, ya, xa, ya, aa);
                if covariance.cholesky().is_none() {
                    return Err(LogError::at(file, line, "the covariance is not positive definite"));
                }
                Event::Relative { before_from_after: Se2::from_xy_angle(x, y, angle), covariance }
            }
            "LANDMARK" => {
                let [from, to, x, y, xx, xy, yy] =
                    numbers(file, line, words, ["from", "to", "x", "y", "xx", "xy", "yy"])?;
                at_pose(file, line, pose, label(file, line, from, "from")?)?;
                let covariance = Matrix2::new(xx, xy, xy, yy);
                if covariance.cholesky().is_none() {
                    return Err(LogError::at(file, line, "the covariance is not positive definite"));
                }
                let target = Target::Landmark(label(file, line, to, "to")?);
                Event::Seen { target, reading: Reading::Position(Vec2::new(x, y), covariance) }
            }
            _ => {
                let tag: String = tag.chars().take(40).collect();
                return Err(LogError::at(file, line, format!("{tag:?} is neither ODOMETRY nor LANDMARK")));
            }
        };
        entries.push(Entry { time_s, event });
    }
    if pose.is_none() {
        return Err(LogError::whole(file, "holds no ODOMETRY"));
    }
    // At every return to known trees the odometry is off by several standard deviations.
    let noise = Noise { relative_scale: 4.0, ..Noise::plaza() };
    Ok(Log {
        name: "Victoria Park".into(),
        robots: vec![RobotLog { name: "car".into(), entries }],
        surveyed: BTreeMap::new(),
        truth: Vec::new(),
        noise,
        noise_known: true,
        unlabelled_noise: noise,
        smoothing_noise: noise,
        // Its landmarks were matched carefully: a sighting that does not fit indicates an odometry error.
        gate_probability: 1.0,
        notes: vec!["the log has no times: a step counts as a second".into()],
    })
}

fn at_pose(file: &str, line: usize, pose: Option<u32>, from: u32) -> Result<(), LogError> {
    match pose {
        Some(pose) if pose != from => {
            Err(LogError::at(file, line, format!("begins at pose {from}, but the last pose is {pose}")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "ODOMETRY 0 1 1 0 0.1 0.01 0 0 0.01 0 0.001\nLANDMARK 1 2 5 1 0.4 0 0.4\nODOMETRY 1 3 1 0 0 0.01 0 0 0.01 0 0.001\n";

    #[test]
    fn reads_poses_and_landmarks() {
        let log = parse_victoria("v", TEXT).unwrap();
        assert_eq!(log.robots[0].entries.len(), 3);
        assert_eq!(log.robots[0].entries[2].time_s, 2.0);
        let steps = log.robots[0].steps(&log.noise, &[]).unwrap();
        assert_eq!(steps.len(), 2);
        assert_eq!(steps[0].sightings[0].target, Target::Landmark(2));
        assert_eq!(steps[1].motion.before_from_after.translation.x, 1.0);
    }

    #[test]
    fn says_where_it_is_wrong() {
        let wrong = |text: &str| parse_victoria("v", text).unwrap_err().to_string();
        assert_eq!(wrong(""), "v: holds no ODOMETRY");
        assert!(wrong("LANDMARK 0 2 5 1 0.4 0\n").starts_with("v, line 1: yy is missing"));
        assert!(wrong(&TEXT.replace("5 1", "nan 1")).starts_with("v, line 2: x is \"nan\""));
        assert!(
            wrong(&TEXT.replace("LANDMARK 1", "LANDMARK 7"))
                .contains("begins at pose 7, but the last pose is 1")
        );
        assert!(wrong(&TEXT.replace("0.4 0 0.4", "0.4 0 -0.4")).contains("not positive"));
        assert!(wrong("EDGE 1 2\n").contains("neither ODOMETRY nor LANDMARK"));
    }
}
