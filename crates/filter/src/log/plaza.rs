//! Plaza: a mower with wheel odometry and radios that measure ranges to beacons; beacons are identified by number.
//!
//! Source: Djugash, Hamner, Roth, "Navigating with ranging radios: five data sets with ground truth", Journal of Field
//! Robotics 26(9), 2009. `*_DR.txt` has time, distance and turn since the previous line; `*_TD.txt` has time, number of
//! the mower's radio, number of the beacon, range.

use super::lines::{content, label, numbers};
use super::{Entry, Event, Log, LogError, Noise, Reading, RobotLog, Target};
use std::collections::BTreeMap;

/// Reads a log from the odometry and the ranges, each given as the name and the text of a file. Ranges need not be in
/// order of time (in Plaza 1 they are not).
///
/// # Errors
/// When a line has a wrong number of values, a value that is not finite, a negative range, or an odometry time that
/// goes back (the error names file and line); and when either file is empty.
pub fn parse_plaza(odometry: (&str, &str), ranges: (&str, &str)) -> Result<Log, LogError> {
    let mut entries = Vec::new();
    let mut notes = Vec::new();
    if read(odometry, ["time", "travel", "turn"], &mut entries, |_, [time_s, way_m, turn_rad]| {
        Ok(Entry { time_s, event: Event::Travel { way_m, turn_rad } })
    })? > 0
    {
        return Err(LogError::whole(odometry.0, "time goes back: travel cannot be put in order"));
    }
    let names = ["time", "radio", "beacon", "range"];
    let back = read(ranges, names, &mut entries, |line, [time_s, _, beacon, range]| {
        if range < 0.0 {
            return Err(LogError::at(ranges.0, line, format!("the range of {range} m is negative")));
        }
        let target = Target::Landmark(label(ranges.0, line, beacon, "beacon")?);
        Ok(Entry { time_s, event: Event::Seen { target, reading: Reading::Range(range) } })
    })?;
    if back > 0 {
        notes.push(format!("{}: time goes back {back} times; ranges are put in order", ranges.0));
    }
    // The sort is stable: odometry comes first where times are equal.
    entries.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let start = entries.first().map_or(0.0, |e| e.time_s);
    entries.iter_mut().for_each(|e| e.time_s -= start);
    Ok(Log {
        name: "Plaza".into(),
        robots: vec![RobotLog { name: "mower".into(), entries }],
        surveyed: BTreeMap::new(),
        truth: Vec::new(),
        noise: Noise::plaza(),
        noise_known: true,
        unlabelled_noise: Noise::plaza(),
        smoothing_noise: Noise::plaza(),
        gate_probability: 0.999,
        notes,
    })
}

fn read<const N: usize>(
    (file, text): (&str, &str),
    names: [&str; N],
    entries: &mut Vec<Entry>,
    entry: impl Fn(usize, [f64; N]) -> Result<Entry, LogError>,
) -> Result<usize, LogError> {
    let (mut last, mut back) = (f64::NEG_INFINITY, 0);
    for (line, content) in content(text) {
        let values = numbers(file, line, content.split_whitespace(), names)?;
        back += usize::from(values[0] < last);
        last = values[0];
        entries.push(entry(line, values)?);
    }
    if last == f64::NEG_INFINITY { Err(LogError::whole(file, "holds no line of values")) } else { Ok(back) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_travel_and_ranges_in_order() {
        let log = parse_plaza(("d", "10 0.5 0.1\n11 0.5 0.0\n"), ("t", "10.5 2 7 12.5\n")).unwrap();
        let entries = &log.robots[0].entries;
        assert_eq!(entries.iter().map(|e| e.time_s).collect::<Vec<_>>(), [0.0, 0.5, 1.0]);
        assert!(matches!(entries[1].event, Event::Seen { target: Target::Landmark(7), .. }));
    }

    #[test]
    fn says_where_it_is_wrong() {
        let wrong = |d: &str, t: &str| parse_plaza(("d", d), ("t", t)).unwrap_err().to_string();
        assert_eq!(wrong("", "1 2 3 4"), "d: holds no line of values");
        assert_eq!(wrong("2 0 0\n1 0 0\n", "1 2 3 4"), "d: time goes back: travel cannot be put in order");
        assert_eq!(wrong("1 0 0\n", "1 2 3 -4\n"), "t, line 1: the range of -4 m is negative");
        assert!(wrong("1 0 0\n", "1 2 3.5 4\n").contains("beacon is 3.5, not a whole number"));
        assert!(wrong("1 0 0 9\n", "1 2 3 4\n").contains("more than the 3 values expected"));
    }
}
