//! Cairn's own CSV format for logs of wheeled robots: one event per line.

use super::lines::{content, cut, label, number, numbers};
use super::{Entry, Event, Log, LogError, Noise, Reading, RobotLog, Target};
use cairn_geometry::{Se2, Vec2};
use nalgebra::Matrix2;
use std::collections::BTreeMap;

/// Description of the format, for users.
pub const CSV_FORMAT: &str = "\
One event a line, by rising time in seconds; '#' begins a comment. SI units, angles in radians, counter-clockwise.
A label is a whole number from 0 on, or ? where a landmark has no name.
  TIME,velocity,FORWARD,TURN            from now on, m/s and rad/s
  TIME,travel,WAY,TURN                  up to now, m along the arc and rad
  TIME,range_bearing,LABEL,RANGE,BEARING
  TIME,range,LABEL,RANGE
  TIME,bearing,LABEL,BEARING
  TIME,position,LABEL,X,Y,DEVIATION     in the robot's frame, x forward, y left, m
  TIME,truth,X,Y,ANGLE                  the true pose, for judging
  0,landmark,LABEL,X,Y                  a surveyed landmark, for judging
  0,noise,NAME,VALUE                    range_m, range_by_range, bearing_rad, speed, speed_by_speed, speed_by_turn,
                                        turn, turn_by_speed, turn_by_turn (velocity: densities in units/sqrt(Hz)),
                                        way, turn_by_way, turn_by_root (travel: for each sqrt(m), sqrt(m), sqrt(rad));
                                        without any, they are estimated from labelled sightings";

/// Reads a log from text; `file` is the name used in messages.
///
/// # Errors
/// When a line has an unknown event, a wrong number of values, a value that is not finite, or a time that goes back
/// (the error names the line); and when there is no event of the robot.
pub fn parse_csv(file: &str, text: &str) -> Result<Log, LogError> {
    let mut log = Log {
        name: file.into(),
        robots: Vec::new(),
        surveyed: BTreeMap::new(),
        truth: Vec::new(),
        noise: Noise::plaza(),
        noise_known: false,
        unlabelled_noise: Noise::plaza(),
        smoothing_noise: Noise::plaza(),
        gate_probability: 0.999,
        notes: Vec::new(),
    };
    let (mut entries, mut last) = (Vec::new(), f64::NEG_INFINITY);
    for (line, content) in content(text) {
        let mut words = content.split(',').map(str::trim);
        let time_s = number(file, line, words.next().unwrap_or_default(), "the time")?;
        let kind = words.next().ok_or_else(|| LogError::at(file, line, "names no event"))?;
        let row = Row { file, line, time_s };
        if let Some(event) = row.event(kind, &mut log, words)? {
            if time_s < last {
                return Err(LogError::at(file, line, format!("time goes back by {:.3} s", last - time_s)));
            }
            last = time_s;
            entries.push(Entry { time_s, event });
        }
    }
    if entries.is_empty() {
        return Err(LogError::whole(
            file,
            "holds no event of a robot (velocity, travel, range_bearing, ...)",
        ));
    }
    (log.smoothing_noise, log.unlabelled_noise) = (log.noise, log.noise);
    log.robots.push(RobotLog { name: "robot".into(), entries });
    Ok(log)
}

struct Row<'a> {
    file: &'a str,
    line: usize,
    time_s: f64,
}

impl Row<'_> {
    /// The event of a line; `None` when the line describes the log as a whole.
    fn event<'w>(
        &self,
        kind: &str,
        log: &mut Log,
        mut words: impl Iterator<Item = &'w str>,
    ) -> Result<Option<Event>, LogError> {
        let (file, line) = (self.file, self.line);
        let event = match kind {
            "velocity" => {
                let [speed_m_s, turn_rad_s] =
                    numbers(file, line, words, ["forward velocity", "angular velocity"])?;
                Event::Velocity { speed_m_s, turn_rad_s }
            }
            "travel" => {
                let [way_m, turn_rad] = numbers(file, line, words, ["way", "turn"])?;
                Event::Travel { way_m, turn_rad }
            }
            "range_bearing" | "range" | "bearing" | "position" => {
                let target = self.target(words.next())?;
                Event::Seen { target, reading: self.reading(kind, words)? }
            }
            "truth" => {
                let [x, y, angle] = numbers(file, line, words, ["x", "y", "angle"])?;
                log.truth.push((self.time_s, Se2::from_xy_angle(x, y, angle)));
                return Ok(None);
            }
            "landmark" => {
                let [name, x, y] = numbers(file, line, words, ["label", "x", "y"])?;
                log.surveyed.insert(label(file, line, name, "label")?, Vec2::new(x, y));
                return Ok(None);
            }
            "noise" => {
                let name = words.next().unwrap_or_default();
                let [value] = numbers(file, line, words, ["value"])?;
                self.noise(&mut log.noise, name, value)?;
                log.noise_known = true;
                return Ok(None);
            }
            _ => return Err(LogError::at(file, line, format!("{:?} is no event", cut(kind)))),
        };
        Ok(Some(event))
    }

    fn target(&self, word: Option<&str>) -> Result<Target, LogError> {
        match word {
            None => Err(LogError::at(self.file, self.line, "the label is missing")),
            Some("?") => Ok(Target::Unlabelled),
            Some(word) => {
                let value = number(self.file, self.line, word, "label")?;
                Ok(Target::Landmark(label(self.file, self.line, value, "label")?))
            }
        }
    }

    fn reading<'w>(&self, kind: &str, words: impl Iterator<Item = &'w str>) -> Result<Reading, LogError> {
        let (file, line) = (self.file, self.line);
        let reading = match kind {
            "range_bearing" => {
                let [range, bearing] = numbers(file, line, words, ["range", "bearing"])?;
                Reading::RangeBearing(range, bearing)
            }
            "range" => Reading::Range(numbers::<1>(file, line, words, ["range"])?[0]),
            "bearing" => Reading::Bearing(numbers::<1>(file, line, words, ["bearing"])?[0]),
            _ => {
                let [x, y, deviation] = numbers(file, line, words, ["x", "y", "deviation"])?;
                if deviation <= 0.0 {
                    return Err(LogError::at(
                        file,
                        line,
                        format!("the deviation of {deviation} m is not positive"),
                    ));
                }
                Reading::Position(Vec2::new(x, y), Matrix2::identity() * deviation * deviation)
            }
        };
        match reading {
            Reading::RangeBearing(range, _) | Reading::Range(range) if range < 0.0 => {
                Err(LogError::at(file, line, format!("the range of {range} m is negative")))
            }
            reading => Ok(reading),
        }
    }

    fn noise(&self, noise: &mut Noise, name: &str, value: f64) -> Result<(), LogError> {
        let at = |reason: String| LogError::at(self.file, self.line, reason);
        if value < 0.0 {
            return Err(at(format!("the noise {} is negative", cut(name))));
        }
        let velocity = &mut noise.velocity;
        let place = match name {
            "range_m" => &mut noise.range_m,
            "range_by_range" => &mut noise.range_by_range,
            "bearing_rad" => &mut noise.bearing_rad,
            "speed" => &mut velocity.speed,
            "speed_by_speed" => &mut velocity.speed_by_speed,
            "speed_by_turn" => &mut velocity.speed_by_turn,
            "turn" => &mut velocity.turn,
            "turn_by_speed" => &mut velocity.turn_by_speed,
            "turn_by_turn" => &mut velocity.turn_by_turn,
            "way" => &mut noise.way,
            "turn_by_way" => &mut noise.turn_by_way,
            "turn_by_root" => &mut noise.turn,
            _ => return Err(at(format!("{:?} is no noise", cut(name)))),
        };
        *place = value;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_every_event() {
        let text = "# a log\n0,noise,range_m,0.2\n0,landmark,3,1,2\n0,velocity,0.5,0.1\n1,range_bearing,3,2.5,0.2\n\
                    1,bearing,?,0.3\n2,range,4,9\n2,position,5,1,2,0.1\n2,travel,0.5,0\n2,truth,1,1,0.1\n";
        let log = parse_csv("a.csv", text).unwrap();
        assert_eq!((log.robots[0].entries.len(), log.surveyed.len(), log.truth.len()), (6, 1, 1));
        assert_eq!(log.noise.range_m, 0.2);
        let steps = log.robots[0].steps(&log.noise, &[]).unwrap();
        assert_eq!(steps[0].sightings.len(), 2);
        assert_eq!(steps[0].sightings[1].target, Target::Unlabelled);
    }

    #[test]
    fn says_where_it_is_wrong() {
        let wrong = |text: &str| parse_csv("a.csv", text).unwrap_err().to_string();
        assert!(wrong("").contains("holds no event"));
        assert_eq!(wrong("x,velocity,1,1"), "a.csv, line 1: the time is \"x\", not a finite number");
        assert_eq!(wrong("0,hop,1"), "a.csv, line 1: \"hop\" is no event");
        assert_eq!(wrong("1,travel,1,1\n0,travel,1,1"), "a.csv, line 2: time goes back by 1.000 s");
        assert_eq!(wrong("0,range,1,-2"), "a.csv, line 1: the range of -2 m is negative");
        assert_eq!(wrong("0,range"), "a.csv, line 1: the label is missing");
        assert_eq!(wrong("0,noise,colour,1"), "a.csv, line 1: \"colour\" is no noise");
    }
}
