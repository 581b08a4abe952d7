//! UTIAS MRCLAM: several robots with odometry that see barcodes of landmarks and of each other.
//!
//! Source: Leung, Halpern, Barfoot, Liu, "The UTIAS multi-robot cooperative localization and mapping dataset",
//! IJRR 2011. In data set 1 the surveyed positions of landmarks 11 and 17 do not match their barcodes (18 and 61):
//! every robot sees each of them where the other was surveyed, 6.1 m away. The reader swaps them where it finds these
//! two positions.

use super::lines::{content, label, numbers};
use super::{Entry, Event, Log, LogError, Noise, Reading, RobotLog, Target};
use cairn_geometry::Vec2;
use std::collections::BTreeMap;

/// Positions of landmarks 11 and 17 in data set 1, to the millimetre.
const SWAPPED: [(u32, [f64; 2]); 2] =
    [(11, [3.150_719_99, 2.382_948_71]), (17, [0.035_961_56, -2.843_966_26])];

/// Name and text of a file.
pub type File<'a> = (&'a str, &'a str);

/// Reads a log from `Barcodes.dat`, `Landmark_Groundtruth.dat` (if there is one) and, for each robot, its number (from
/// 1), its `RobotN_Odometry.dat` and its `RobotN_Measurement.dat`. Times count from the first odometry of any robot.
///
/// # Errors
/// When a line has a wrong number of values, a value that is not finite, an unknown barcode, or a time that goes back
/// (the error names file and line); and when there is no robot or a file is empty.
pub fn parse_mrclam(
    barcodes: File<'_>,
    survey: Option<File<'_>>,
    robots: &[(u32, File<'_>, File<'_>)],
) -> Result<Log, LogError> {
    let subject_of = parse_barcodes(barcodes)?;
    let mut notes = Vec::new();
    let mut surveyed = survey.map(parse_survey).transpose()?.unwrap_or_default();
    mend(&mut surveyed, &mut notes);
    let place: BTreeMap<u32, usize> =
        robots.iter().enumerate().map(|(k, (number, ..))| (*number, k)).collect();
    let mut logs = Vec::new();
    for (number, odometry, sightings) in robots {
        let [odometry, sightings] = [(odometry, 3), (sightings, 4)]
            .map(|(file, columns)| without_torn_line(*file, columns, &mut notes));
        let mut entries = parse_odometry(odometry)?;
        entries.extend(parse_sightings(sightings, &subject_of, &place, &mut notes)?);
        // The sort is stable: odometry comes first where times are equal.
        entries.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        logs.push(RobotLog { name: format!("robot {number}"), entries });
    }
    let firsts = logs.iter().filter_map(|r: &RobotLog| r.entries.first());
    let start = firsts.map(|e| e.time_s).min_by(f64::total_cmp);
    let start = start.ok_or_else(|| LogError::whole(barcodes.0, "no robot has any entry"))?;
    for entry in logs.iter_mut().flat_map(|r| &mut r.entries) {
        entry.time_s -= start;
    }
    Ok(Log {
        name: "MRCLAM".into(),
        robots: logs,
        surveyed,
        truth: Vec::new(),
        noise: Noise::mrclam(),
        noise_known: true,
        unlabelled_noise: Noise::mrclam_unlabelled(),
        smoothing_noise: Noise::mrclam_smoothing(),
        gate_probability: 0.999,
        notes,
    })
}

fn parse_barcodes((file, text): File<'_>) -> Result<BTreeMap<u32, u32>, LogError> {
    let mut subject_of = BTreeMap::new();
    for (line, content) in content(text) {
        let [subject, barcode] = numbers(file, line, content.split_whitespace(), ["subject", "barcode"])?;
        let (subject, barcode) =
            (label(file, line, subject, "subject")?, label(file, line, barcode, "barcode")?);
        if subject_of.insert(barcode, subject).is_some() {
            return Err(LogError::at(file, line, format!("barcode {barcode} is there twice")));
        }
    }
    if subject_of.is_empty() {
        return Err(LogError::whole(file, "holds no barcode"));
    }
    Ok(subject_of)
}

fn parse_survey((file, text): File<'_>) -> Result<BTreeMap<u32, Vec2>, LogError> {
    let mut surveyed = BTreeMap::new();
    for (line, content) in content(text) {
        let names = ["subject", "x", "y", "deviation of x", "deviation of y"];
        let [subject, x, y, ..] = numbers(file, line, content.split_whitespace(), names)?;
        surveyed.insert(label(file, line, subject, "subject")?, Vec2::new(x, y));
    }
    Ok(surveyed)
}

fn mend(surveyed: &mut BTreeMap<u32, Vec2>, notes: &mut Vec<String>) {
    let at = |(id, [x, y]): (u32, [f64; 2])| {
        surveyed.get(&id).is_some_and(|p: &Vec2| (p - Vec2::new(x, y)).norm() < 1e-3)
    };
    if SWAPPED.into_iter().all(at) {
        let [(a, [ax, ay]), (b, [bx, by])] = SWAPPED;
        surveyed.insert(a, Vec2::new(bx, by));
        surveyed.insert(b, Vec2::new(ax, ay));
        notes.push(format!("landmarks {a} and {b} are swapped in the survey of this data set; swapped back"));
    }
}

/// The file without a last line that has no end and too few values: where a copy broke off.
fn without_torn_line<'a>((file, text): File<'a>, columns: usize, notes: &mut Vec<String>) -> File<'a> {
    let (whole, last) = text.rsplit_once('\n').unwrap_or(("", text));
    if last.trim().is_empty() || last.starts_with('#') || last.split_whitespace().count() >= columns {
        return (file, text);
    }
    let line = text.lines().count();
    notes
        .push(format!("{file}: breaks off in line {line}, which is left out; what came after it is missing"));
    (file, whole)
}

fn parse_odometry((file, text): File<'_>) -> Result<Vec<Entry>, LogError> {
    let mut entries: Vec<Entry> = Vec::new();
    for (line, content) in content(text) {
        let names = ["time", "forward velocity", "angular velocity"];
        let [time_s, speed_m_s, turn_rad_s] = numbers(file, line, content.split_whitespace(), names)?;
        in_order(file, line, entries.last(), time_s)?;
        entries.push(Entry { time_s, event: Event::Velocity { speed_m_s, turn_rad_s } });
    }
    if entries.is_empty() {
        return Err(LogError::whole(file, "holds no odometry"));
    }
    Ok(entries)
}

fn parse_sightings(
    (file, text): File<'_>,
    subject_of: &BTreeMap<u32, u32>,
    place: &BTreeMap<u32, usize>,
    notes: &mut Vec<String>,
) -> Result<Vec<Entry>, LogError> {
    let (mut entries, mut absent, mut unknown): (Vec<Entry>, usize, usize) = (Vec::new(), 0, 0);
    for (line, content) in content(text) {
        let [time_s, barcode, range, bearing] =
            numbers(file, line, content.split_whitespace(), ["time", "barcode", "range", "bearing"])?;
        in_order(file, line, entries.last(), time_s)?;
        if range < 0.0 {
            return Err(LogError::at(file, line, format!("the range of {range} m is negative")));
        }
        // Subjects 1 to 5 are the robots. A misread barcode belongs to no subject.
        let target = match subject_of.get(&label(file, line, barcode, "barcode")?) {
            None => {
                unknown += 1;
                continue;
            }
            Some(robot @ 1..=5) => match place.get(robot) {
                Some(place) => Target::Robot(*place),
                None => {
                    absent += 1;
                    continue;
                }
            },
            Some(landmark) => Target::Landmark(*landmark),
        };
        entries.push(Entry {
            time_s,
            event: Event::Seen { target, reading: Reading::RangeBearing(range, bearing) },
        });
    }
    if absent > 0 {
        notes.push(format!("{file}: {absent} sightings of robots that were not loaded"));
    }
    if unknown > 0 {
        notes.push(format!("{file}: {unknown} sightings of barcodes that nobody wears"));
    }
    Ok(entries)
}

fn in_order(file: &str, line: usize, last: Option<&Entry>, time_s: f64) -> Result<(), LogError> {
    match last {
        Some(last) if time_s < last.time_s => {
            let back = last.time_s - time_s;
            Err(LogError::at(file, line, format!("time goes back by {back:.3} s")))
        }
        _ => Ok(()),
    }
}
