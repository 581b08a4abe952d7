//! Detects the format of a log from its path, and reads it.

use super::{Log, LogError, parse_csv, parse_mrclam, parse_plaza, parse_victoria};
use std::path::{Path, PathBuf};

/// The formats of logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A folder with `Barcodes.dat`.
    Mrclam,
    /// A file of `ODOMETRY` and `LANDMARK` lines.
    Victoria,
    /// A pair of files named `*_DR.txt` and `*_TD.txt`.
    Plaza,
    /// Cairn's own CSV.
    Csv,
}

/// Greatest number of robots in MRCLAM.
const MRCLAM_ROBOTS: u32 = 5;

/// Reads the log at this path; of MRCLAM all robots, or only the requested one.
///
/// # Errors
/// When there is no file, it is not a log, or [`parse_mrclam`] or one of the other parsers rejects it.
pub fn load(path: &Path, robot: Option<u32>) -> Result<(Format, Log), LogError> {
    let name = path.display().to_string();
    if path.is_dir() {
        return match path.join("Barcodes.dat").is_file() {
            true => Ok((Format::Mrclam, load_mrclam(path, robot)?)),
            false => Err(LogError::whole(
                &name,
                "a folder without Barcodes.dat is no log that is known (MRCLAM has one)",
            )),
        };
    }
    if let Some((odometry, ranges)) = plaza_pair(path) {
        let (o, r) = (text(&odometry)?, text(&ranges)?);
        let log = parse_plaza((&odometry.display().to_string(), &o), (&ranges.display().to_string(), &r))?;
        return Ok((Format::Plaza, log));
    }
    let content = text(path)?;
    if content.trim_start().starts_with("ODOMETRY") || content.trim_start().starts_with("LANDMARK") {
        return Ok((Format::Victoria, parse_victoria(&name, &content)?));
    }
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
        return Ok((Format::Csv, parse_csv(&name, &content)?));
    }
    let reason = "no log that is known: give an MRCLAM folder, a file of ODOMETRY and LANDMARK lines (Victoria Park), one of a \
                  pair _DR.txt and _TD.txt (Plaza), or a .csv";
    Err(LogError::whole(&name, reason))
}

/// Largest size of a log file.
const MAX_BYTES: u64 = 1024 * cairn_files::MIB;

fn text(path: &Path) -> Result<String, LogError> {
    cairn_files::read_text(path, MAX_BYTES)
        .map_err(|e| LogError::whole(&path.display().to_string(), e.to_string()))
}

/// Both files of a Plaza log, given either one.
fn plaza_pair(path: &Path) -> Option<(PathBuf, PathBuf)> {
    let name = path.file_name()?.to_str()?;
    let stem = name.strip_suffix("_DR.txt").or_else(|| name.strip_suffix("_TD.txt"))?;
    Some((path.with_file_name(format!("{stem}_DR.txt")), path.with_file_name(format!("{stem}_TD.txt"))))
}

fn load_mrclam(folder: &Path, robot: Option<u32>) -> Result<Log, LogError> {
    let file = |name: String| folder.join(name);
    let wanted = robot.map_or(1..=MRCLAM_ROBOTS, |r| r..=r);
    let there = |r: &u32| robot.is_some() || file(format!("Robot{r}_Odometry.dat")).is_file();
    let mut texts = Vec::new();
    for r in wanted.filter(there) {
        let (odometry, seen) =
            (file(format!("Robot{r}_Odometry.dat")), file(format!("Robot{r}_Measurement.dat")));
        let texts_of = (text(&odometry)?, text(&seen)?);
        texts.push((r, odometry.display().to_string(), seen.display().to_string(), texts_of));
    }
    if texts.is_empty() {
        return Err(LogError::whole(&folder.display().to_string(), "holds no RobotN_Odometry.dat"));
    }
    let robots: Vec<_> = texts
        .iter()
        .map(|(r, o, m, (ot, mt))| (*r, (o.as_str(), ot.as_str()), (m.as_str(), mt.as_str())))
        .collect();
    let (barcodes, survey) = (file("Barcodes.dat".into()), file("Landmark_Groundtruth.dat".into()));
    let barcode_text = text(&barcodes)?;
    let survey_text = if survey.is_file() { Some(text(&survey)?) } else { None };
    let (b, s) = (barcodes.display().to_string(), survey.display().to_string());
    parse_mrclam((&b, &barcode_text), survey_text.as_deref().map(|t| (s.as_str(), t)), &robots)
}
