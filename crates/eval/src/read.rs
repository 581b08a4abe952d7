//! Parsing of trajectory files: TUM, KITTI and EuRoC, with detection of the format.
//!
//! Input: text. Output: poses `world_from_body` at exact nanoseconds, or an error that names file, line and remedy.
//!
//! | format | a line |
//! |---|---|
//! | TUM | `t x y z qx qy qz qw`, seconds; `t x y z` alone is positions only |
//! | KITTI | the 3x4 or 4x4 matrix by rows, no time; ORB-SLAM2 and others write the number of the frame before it |
//! | EuRoC | `ns,x,y,z,qw,qx,qy,qz,...`; `ns,x,y,z` alone is positions only |
//!
//! Lines that start with `#` and empty lines are skipped. A line with `nan` is an unknown pose: it is left out and
//! counted.

use crate::decimal;
use crate::error::FileError;
use crate::header::TrajectoryHeader;
use cairn_geometry::{Mat3, Se3, So3, Trajectory, Vec3};
use nalgebra::Matrix3x4;
use serde::{Deserialize, Serialize};

/// Format of a trajectory file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Time in seconds, position, quaternion with the scalar last.
    Tum,
    /// The 3x4 matrix by rows; no times.
    Kitti,
    /// Comma-separated: nanoseconds, position, quaternion with the scalar first.
    Euroc,
    /// A folder of files with one 4x4 matrix each (7-Scenes).
    Matrices,
}

/// What is wrong with a line; [`FileError`] says of which file, and which line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct LineError(String);

/// Nanoseconds between lines of a KITTI file without `times.txt`.
pub const KITTI_STEP_NS: i64 = 100_000_000;

/// A trajectory with the properties of its file.
#[derive(Clone, Debug)]
pub struct TrajectoryFile {
    /// Poses `world_from_body`; the rotations are the identity where [`Self::has_rotations`] is false.
    pub trajectory: Trajectory,
    /// Name of the file, for messages.
    pub name: String,
    /// Detected format.
    pub format: Format,
    /// False when the file has positions only.
    pub has_rotations: bool,
    /// True when the times are nominal, derived from the number of the line or frame.
    pub nominal_times: bool,
    /// True when each pose has the number of its frame.
    pub frame_numbers: bool,
    /// Number of lines left out because of `nan`.
    pub unknown_poses: usize,
    /// What the file itself says its poses are of.
    pub header: Option<TrajectoryHeader>,
}

/// Parses a trajectory; `name` is used in errors. The poses of a KITTI file get `times_ns`, or nominal times at 10 Hz
/// from zero.
///
/// # Errors
/// When the format is unknown, a line is invalid, the times decrease, or there is no pose; the error names the line.
pub fn parse_trajectory(
    text: &str,
    name: &str,
    times_ns: Option<&[i64]>,
) -> Result<TrajectoryFile, FileError> {
    let mut file: Option<TrajectoryFile> = None;
    let (mut columns, mut rows, mut fields) = (0, 0, Vec::new());
    let mut header = None;
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        if line.starts_with('#') {
            if file.is_none() {
                TrajectoryHeader::read(&mut header, line);
            }
            continue;
        }
        let fail = |reason: String| FileError::at(name, index + 1, reason);
        let wrong = |e: LineError| fail(e.0);
        fields.clear();
        fields.extend(split(line));
        if file.is_none() {
            columns = fields.len();
            let (format, has_rotations) = detect_format(line, &fields).map_err(wrong)?;
            file = Some(TrajectoryFile {
                trajectory: Trajectory::new(),
                name: name.to_owned(),
                format,
                has_rotations,
                nominal_times: format == Format::Kitti && times_ns.is_none(),
                frame_numbers: format == Format::Kitti && columns == 13,
                unknown_poses: 0,
                header: header.take(),
            });
        }
        let Some(file) = file.as_mut() else { continue };
        if fields.len() != columns {
            return Err(fail(format!(
                "{} numbers, but the previous lines have {columns}; is the line cut off?",
                fields.len()
            )));
        }
        let stamp_ns = match file.format {
            Format::Kitti | Format::Matrices => {
                let frame = if file.frame_numbers { frame_number(&mut fields).map_err(wrong)? } else { rows };
                match times_ns {
                    Some(times) => *times.get(frame).ok_or_else(|| {
                        fail(format!("there are more poses than the {} times", times.len()))
                    })?,
                    None => frame as i64 * KITTI_STEP_NS,
                }
            }
            Format::Euroc | Format::Tum => parse_time(file.format, fields[0]).map_err(wrong)?,
        };
        rows += 1;
        match parse_pose(file.format, file.has_rotations, &fields).map_err(wrong)? {
            Some(pose) => file.trajectory.push(stamp_ns, pose).map_err(|_| {
                fail("the time is earlier than that of the line before; sort the file by time".into())
            })?,
            None => file.unknown_poses += 1,
        }
    }
    let file =
        file.ok_or_else(|| FileError::whole(name, "no poses: the file is empty or has comments only"))?;
    if file.trajectory.is_empty() {
        return Err(FileError::whole(name, "no poses: every line is nan"));
    }
    Ok(file)
}

/// The time in nanoseconds and the pose of one line of a TUM or EuRoC file with rotations; `None` where a number is `nan`.
///
/// # Errors
/// When the line has too few numbers, or one that is none.
pub fn parse_stamped_pose(line: &str, format: Format) -> Result<Option<(i64, Se3)>, LineError> {
    let fields: Vec<&str> = split(line.trim()).collect();
    if fields.len() < 8 {
        return Err(LineError(format!("{} numbers; a time and a pose have 8", fields.len())));
    }
    let stamp_ns = parse_time(format, fields[0])?;
    Ok(parse_pose(format, true, &fields)?.map(|pose| (stamp_ns, pose)))
}

/// Splits a line at commas, or at white space if it has none.
fn split(line: &str) -> impl Iterator<Item = &str> {
    let commas = line.contains(',');
    line.split(move |c: char| if commas { c == ',' } else { c.is_ascii_whitespace() })
        .map(str::trim)
        .filter(move |field| commas || !field.is_empty())
}

/// Detects the format from the first line; also whether it has rotations.
fn detect_format(line: &str, fields: &[&str]) -> Result<(Format, bool), LineError> {
    if line.contains(',') {
        if fields[0].parse::<i64>().is_err() {
            return Err(LineError(format!(
                "comma-separated, but the first column '{}' is not whole nanoseconds as in EuRoC csv; TUM files \
                 are separated by spaces",
                fields[0]
            )));
        }
        return match fields.len() {
            4 => Ok((Format::Euroc, false)),
            8.. => Ok((Format::Euroc, true)),
            n => {
                Err(LineError(format!("{n} columns; EuRoC csv has 'ns,x,y,z' or 'ns,x,y,z,qw,qx,qy,qz,...'")))
            }
        };
    }
    match fields.len() {
        4 => Ok((Format::Tum, false)),
        8 => Ok((Format::Tum, true)),
        12 | 13 | 16 => Ok((Format::Kitti, true)),
        n => Err(LineError(format!(
            "{n} columns; TUM has 8 ('t x y z qx qy qz qw') or 4 ('t x y z'), KITTI has 12 (3x4 matrix), 13 (with the \
             number of the frame) or 16 (4x4 matrix), EuRoC is comma-separated"
        ))),
    }
}

/// Takes the number of the frame from the front of a line.
fn frame_number(fields: &mut Vec<&str>) -> Result<usize, LineError> {
    let field = fields.remove(0);
    // Ten digits are more than any recording has, and their nominal times still fit.
    let number = field.parse::<u32>().map(|n| n as usize);
    number
        .map_err(|_| LineError(format!("13 columns, but the first, '{field}', is not the number of a frame")))
}

/// The time of a line in nanoseconds.
fn parse_time(format: Format, field: &str) -> Result<i64, LineError> {
    match format {
        Format::Euroc => {
            field.parse().map_err(|_| LineError(format!("'{field}' is not a time in whole nanoseconds")))
        }
        _ => decimal::nanoseconds(field)
            .ok_or_else(|| LineError(format!("'{field}' is not a time in seconds"))),
    }
}

/// Parses the pose of a line; `None` when a number is `nan`.
fn parse_pose(format: Format, has_rotations: bool, fields: &[&str]) -> Result<Option<Se3>, LineError> {
    if format == Format::Kitti {
        return match fields.len() {
            16 => pose_from_matrix(&numbers::<16>(fields)?),
            _ => pose_from_matrix(&numbers::<12>(fields)?),
        }
        .map(Some);
    }
    let p = numbers::<3>(&fields[1..])?;
    let q = if has_rotations { numbers::<4>(&fields[4..])? } else { [0.0, 0.0, 0.0, 1.0] };
    if p.iter().chain(&q).any(|v| v.is_nan()) {
        return Ok(None);
    }
    let [x, y, z, w] = if format == Format::Euroc && has_rotations { [q[1], q[2], q[3], q[0]] } else { q };
    let rotation = So3::from_xyzw(x, y, z, w).ok_or_else(|| {
        LineError(format!("the quaternion ({x} {y} {z} {w}) has zero norm or is not finite"))
    })?;
    Ok(Some(Se3::new(rotation, Vec3::from(p))))
}

/// A pose from the 3x4 or 4x4 numbers of its matrix, row by row, as KITTI and 7-Scenes write them. The rotation may be
/// rounded, but must be close to one.
///
/// # Errors
/// When there are other than 12 or 16 numbers, or they are no pose.
pub fn pose_from_matrix(rows: &[f64]) -> Result<Se3, LineError> {
    if !matches!(rows.len(), 12 | 16) {
        return Err(LineError(format!("a matrix of a pose has 3x4 or 4x4 numbers, here are {}", rows.len())));
    }
    let m = Matrix3x4::from_row_slice(&rows[..12]);
    let (rotation, translation): (Mat3, Vec3) = (m.fixed_columns::<3>(0).into(), m.column(3).into());
    let error = (rotation.transpose() * rotation - Mat3::identity()).norm();
    if !(error < 0.05 && rotation.determinant() > 0.0 && translation.iter().all(|v| v.is_finite())) {
        let why = "the matrix is not a pose: its 3x3 block is not a rotation or a number is nan";
        return Err(LineError(why.into()));
    }
    if rows.len() == 16 && !rows[12..].iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(v, one)| (v - one).abs() < 1e-6)
    {
        return Err(LineError("the matrix is not a pose: its last row must be 0 0 0 1".into()));
    }
    Ok(Se3::new(So3::from_matrix(&rotation), translation))
}

fn numbers<const N: usize>(fields: &[&str]) -> Result<[f64; N], LineError> {
    let mut out = [0.0; N];
    for (value, field) in out.iter_mut().zip(fields) {
        *value = match field.parse::<f64>() {
            Ok(v) if !v.is_infinite() => v,
            _ => return Err(LineError(format!("'{field}' is not a number"))),
        };
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<TrajectoryFile, FileError> {
        parse_trajectory(text, "x.txt", None)
    }

    #[test]
    fn formats_are_detected() {
        let tum = parse("# t x y z qx qy qz qw\r\n1403636584.763555584 1 2 3 0 0 0 1\r\n").unwrap();
        assert_eq!((tum.format, tum.has_rotations), (Format::Tum, true));
        assert_eq!(tum.trajectory.stamps_ns(), [1_403_636_584_763_555_584]);
        let euroc = parse("#timestamp [ns],x,y,z,qw\n5, 1, 2, 3, 0.5, 0.5, 0.5, -0.5, 0, 0\n").unwrap();
        assert_eq!(euroc.format, Format::Euroc);
        let q = euroc.trajectory.poses()[0].rotation;
        assert_eq!((q.quaternion().w, q.quaternion().k), (0.5, -0.5), "the scalar comes first");
        let kitti = parse("1 0 0 4 0 1 0 5 0 0 1 6\n1 0 0 7 0 1 0 8 0 0 1 9").unwrap();
        assert_eq!((kitti.format, kitti.nominal_times), (Format::Kitti, true));
        assert_eq!(kitti.trajectory.stamps_ns(), [0, 100_000_000]);
        assert_eq!(kitti.trajectory.poses()[1].translation, Vec3::new(7.0, 8.0, 9.0));
        for positions in ["0.5 1 2 3\n", "500000000,1,2,3\n"] {
            let file = parse(positions).unwrap();
            assert!(!file.has_rotations);
            assert_eq!(file.trajectory.stamps_ns(), [500_000_000]);
            assert_eq!(file.trajectory.poses()[0].translation, Vec3::new(1.0, 2.0, 3.0));
        }
    }

    #[test]
    fn matrices_may_have_the_number_of_their_frame_or_four_rows() {
        let numbered = parse("3 1 0 0 4 0 1 0 5 0 0 1 6\n9 1 0 0 7 0 1 0 8 0 0 1 9").unwrap();
        assert!(numbered.frame_numbers && numbered.nominal_times);
        assert_eq!(numbered.trajectory.stamps_ns(), [300_000_000, 900_000_000]);
        let whole = parse("1 0 0 4 0 1 0 5 0 0 1 6 0 0 0 1").unwrap();
        assert_eq!(whole.trajectory.poses()[0].translation, Vec3::new(4.0, 5.0, 6.0));
        assert!(parse("0.5 1 0 0 4 0 1 0 5 0 0 1 6").unwrap_err().to_string().contains("number of a frame"));
        assert!(parse("1 0 0 4 0 1 0 5 0 0 1 6 0 0 1 1").is_err());
    }

    #[test]
    fn one_line_is_a_pose_as_in_its_file() {
        for (text, format) in [
            ("0.5 1 2 3 0.5 0.5 0.5 -0.5", Format::Tum),
            ("500000000,1,2,3,-0.5,0.5,0.5,0.5,9", Format::Euroc),
        ] {
            let file = parse(text).unwrap();
            let (stamp_ns, pose) = parse_stamped_pose(text, format).unwrap().unwrap();
            assert_eq!(
                (stamp_ns, pose),
                (file.trajectory.stamps_ns()[0], file.trajectory.poses()[0]),
                "{text}"
            );
        }
        assert_eq!(parse_stamped_pose("1 nan 0 0 0 0 0 1", Format::Tum), Ok(None));
        for wrong in ["", "1 0 0 0 0 0 1", "x 0 0 0 0 0 0 1", "1 0 0 0 0 0 0 0"] {
            assert!(parse_stamped_pose(wrong, Format::Tum).is_err(), "{wrong}");
        }
    }

    #[test]
    fn matrices_are_poses_row_by_row() {
        let rows = [0.0, -1.0, 0.0, 4.0, 1.0, 0.0, 0.0, 5.0, 0.0, 0.0, 1.0, 6.0, 0.0, 0.0, 0.0, 1.0];
        let pose = pose_from_matrix(&rows).unwrap();
        assert_eq!(pose_from_matrix(&rows[..12]), Ok(pose));
        let moved = pose * Vec3::new(1.0, 0.0, 0.0);
        assert!((moved - Vec3::new(4.0, 6.0, 6.0)).norm() < 1e-12, "{moved}");
        let with = |k: usize, v: f64| {
            pose_from_matrix(&std::array::from_fn::<_, 16, _>(|i| if i == k { v } else { rows[i] }))
        };
        for (k, v) in [(0, 1.0), (3, f64::NAN), (12, 1.0), (15, f64::NAN)] {
            assert!(with(k, v).is_err(), "{k}");
        }
        assert!(pose_from_matrix(&rows[..9]).is_err());
    }

    #[test]
    fn nan_lines_are_left_out() {
        let file = parse("1 0 0 0 0 0 0 1\n2 nan nan nan nan nan nan nan\n3 1 0 0 0 0 0 1\n").unwrap();
        assert_eq!((file.trajectory.len(), file.unknown_poses), (2, 1));
        assert!(parse("1 nan 0 0 0 0 0 1\n").unwrap_err().to_string().contains("every line is nan"));
    }

    #[test]
    fn errors_name_file_line_and_reason() {
        for (text, line, fragment) in [
            ("1 0 0 0 0 0 0 1\n\n2 0 0 0 0\n", "x.txt:3: ", "cut off"),
            ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "x.txt:2: ", "earlier than that of the line before"),
            ("1 0 0 0 0 0 0 0\n", "x.txt:1: ", "zero norm"),
            ("1 0 0 zero 0 0 0 1\n", "x.txt:1: ", "'zero' is not a number"),
            ("soon 0 0 0 0 0 0 1\n", "x.txt:1: ", "'soon' is not a time"),
            ("1 0 0 inf 0 0 0 1\n", "x.txt:1: ", "'inf' is not a number"),
            ("1 2 3\n", "x.txt:1: ", "TUM has 8"),
            ("1.5,0,0,0,1,0,0,0\n", "x.txt:1: ", "whole nanoseconds"),
            ("1,0,0,0,1\n", "x.txt:1: ", "5 columns"),
            ("1 0 0 4 0 1 0 5 0 0 -1 6\n", "x.txt:1: ", "not a pose"),
            ("nan 0 0 4 0 1 0 5 0 0 1 6\n", "x.txt:1: ", "not a pose"),
            ("", "x.txt: ", "empty"),
            ("# nothing\n", "x.txt: ", "comments only"),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.starts_with(line) && message.contains(fragment), "{text:?}: {message}");
        }
        let short = parse_trajectory("1 0 0 4 0 1 0 5 0 0 1 6\n1 0 0 4 0 1 0 5 0 0 1 6\n", "k", Some(&[3]));
        assert!(short.unwrap_err().to_string().contains("more poses than the 1 times"));
    }
}
