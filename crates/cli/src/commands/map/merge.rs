//! `cairn map merge`: several saved maps in one file, joined where they show the same places.

use super::{failed, open};
use crate::failure::Failure;
use crate::map_lock::MapLock;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn::{Attempt, Config, Junction, MapOfFile, MergeError, MergedMaps, ROUTE_PREFIX, merge_maps};
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Puts several saved maps, of any cameras, with their recorded routes, into one file, and joins those that show the same
/// places.
///
/// Two maps become one when at least three places that are apart from each other are recognised, agree with each other,
/// and are not contradicted. Maps where that is not certain stay apart in the file, with the reason; a later run joins
/// them when it sees both.
#[derive(clap::Args)]
pub struct Arguments {
    /// The saved maps.
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The new file.
    #[arg(long, value_name = "OUT.map")]
    out: PathBuf,
    /// Replace the file if it exists.
    #[arg(long)]
    overwrite: bool,
}

#[derive(Serialize)]
struct Merged {
    out: PathBuf,
    bytes: u64,
    key_frames: usize,
    landmarks: usize,
    maps: usize,
    routes: usize,
    /// Maps that became one.
    joined: Vec<JoinedReport>,
    /// Maps of which it is not certain that they show the same places.
    apart: Vec<ApartReport>,
    /// Notes for the user.
    notes: Vec<String>,
}

/// A map: its file, and the number of its root key frame there.
#[derive(Serialize)]
struct MapReport {
    file: String,
    root: usize,
}

#[derive(Serialize)]
struct JoinedReport {
    from: MapReport,
    into: MapReport,
    /// Key frames in which a place of the other map was recognised, and that agree.
    seams: usize,
    /// Recognised places that were left out because they do not agree.
    left_out: usize,
    /// Key frames of the younger map that stand in the older one, and how many of them show it.
    covered: usize,
    shown: usize,
    /// Median number of landmarks that agree in a seam.
    inliers: usize,
    /// Root mean square distance between each seam and the agreed similarity, units of the older map; and to where the
    /// key frames are once these two are joined; of many maps all is adjusted after the last join.
    rms: f64,
    rms_after: f64,
    /// Length in the older map for each length in the younger.
    scale: f64,
    /// By what the lengths of the older and of the younger map were multiplied where both had metres, and the standard deviation of
    /// the logarithm of metres in a unit of the joined map.
    rescaled: [f64; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    scale_sigma_log: Option<f64>,
    /// Rotation from the younger to the older, degrees, and translation.
    rotation_deg: f64,
    translation: [f64; 3],
    /// Mean and greatest distance by which key frames of the younger and of the older map were moved by the adjustment.
    moved: [f64; 2],
    older_moved: [f64; 2],
    fused_landmarks: usize,
}

#[derive(Serialize)]
struct ApartReport {
    from: MapReport,
    into: MapReport,
    /// Key frames that were compared.
    compared: usize,
    why: String,
}

/// Merges the files.
///
/// # Errors
/// When a file cannot be read or written, or features of the maps cannot be compared.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let outputs = Outputs::new(a.overwrite);
    let outputs = a.files.iter().fold(outputs, |outputs, file| outputs.input("a map to merge", Some(file)));
    let outputs = outputs.output_map("--out", Some(&a.out)).checked()?;
    let out = outputs.file("--out").unwrap_or(&a.out);
    let _lock = MapLock::take(out)?;
    let files = a.files.iter().map(|path| Ok((path.display().to_string(), open(path)?)));
    let files = files.collect::<Result<Vec<_>, Failure>>()?;
    let merged = merge_maps(files, &Config::default()).map_err(unmerged)?;
    let bytes = merged.file.save(out).map_err(|e| failed(&a.out, &e))?;
    output.result(&report(a.out.clone(), bytes, merged), text)
}

fn unmerged(error: MergeError) -> Failure {
    match error {
        MergeError::Empty => Failure::new("map merge", error.to_string(), "name at least two maps"),
        MergeError::CombineError { name, why } => {
            let hint = "only maps made with the same front_end.orb.levels can be put into one file";
            Failure::new(name, format!("does not fit the first map: {why}"), hint)
        }
        MergeError::Depth { name, source } => {
            Failure::new(name, source.to_string(), "cairn map repair saves what is whole in a new file")
        }
        MergeError::Route { name, route, source } => {
            Failure::new(name, format!("route {route}: {source}"), "record the route again")
        }
    }
}

fn report(out: PathBuf, bytes: u64, merged: MergedMaps) -> Merged {
    let (file, mut joined, mut apart) = (&merged.file, Vec::new(), Vec::new());
    for attempt in &merged.attempts {
        match &attempt.join.result {
            Ok(junction) => joined.push(joined_report(attempt, junction)),
            Err(why) => apart.push(ApartReport {
                from: map(&attempt.from),
                into: map(&attempt.into),
                compared: attempt.join.compared,
                why: why.to_string(),
            }),
        }
    }
    Merged {
        out,
        bytes,
        key_frames: file.snapshot.key_frame_count(),
        landmarks: file.snapshot.landmark_count(),
        maps: file.snapshot.maps().count(),
        routes: file.attached.keys().filter(|name| name.starts_with(ROUTE_PREFIX)).count(),
        joined,
        apart,
        notes: merged.notes,
    }
}

fn map(of: &MapOfFile) -> MapReport {
    MapReport { file: of.name.clone(), root: of.root }
}

fn joined_report(attempt: &Attempt, j: &Junction) -> JoinedReport {
    let mut inliers: Vec<usize> = j.seams.iter().map(|s| s.inliers).collect();
    inliers.sort_unstable();
    JoinedReport {
        from: map(&attempt.from),
        into: map(&attempt.into),
        seams: j.seams.len(),
        left_out: j.left_out,
        covered: j.support.expected,
        shown: j.support.shown,
        inliers: inliers.get(inliers.len() / 2).copied().unwrap_or(0),
        rms: j.rms,
        rms_after: j.rms_after,
        scale: j.into_from.scale,
        rescaled: [j.scales.there, j.scales.here],
        scale_sigma_log: j.scales.sigma_log,
        rotation_deg: j.into_from.rotation.angle().to_degrees(),
        translation: j.into_from.translation.into(),
        moved: j.moved,
        older_moved: j.older_moved,
        fused_landmarks: j.fused,
    }
}

fn text(m: &Merged) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "written   {}, {:.3} MB", m.out.display(), m.bytes as f64 / 1e6);
    let _ = writeln!(
        text,
        "total     {} key frames, {} landmarks, {} maps, {} routes",
        m.key_frames, m.landmarks, m.maps, m.routes
    );
    let name = |map: &MapReport| match map.root {
        0 => map.file.clone(),
        root => format!("{} (map {root})", map.file),
    };
    for j in &m.joined {
        let _ = writeln!(text, "joined    {} into {}", name(&j.from), name(&j.into));
        let _ = writeln!(
            text,
            "          {} seams agree ({} left out), {} landmarks each in the median, {} landmarks fused",
            j.seams, j.left_out, j.inliers, j.fused_landmarks
        );
        let _ = writeln!(
            text,
            "          {} of {} key frames that stand in the older map show it",
            j.shown, j.covered
        );
        let _ = writeln!(
            text,
            "          {:.3} rms between the seams, {:.3} once joined; scale {:.4}, turned by {:.1} degrees",
            j.rms, j.rms_after, j.scale, j.rotation_deg
        );
        let _ = writeln!(
            text,
            "          moved by {:.3} in the mean, {:.3} at most; the older map by {:.3}, {:.3}",
            j.moved[0], j.moved[1], j.older_moved[0], j.older_moved[1]
        );
        if let Some(sigma) = j.scale_sigma_log {
            let [older, younger] = j.rescaled.map(|factor| 100.0 * (factor - 1.0));
            let _ = writeln!(
                text,
                "          metres with a standard deviation of {:.2} %; lengths of the older map changed by {older:+.2} %, of the other by {younger:+.2} %",
                100.0 * sigma
            );
        }
    }
    for a in &m.apart {
        let _ = writeln!(
            text,
            "apart     {} and {}: {} ({} key frames compared)",
            name(&a.from),
            name(&a.into),
            a.why,
            a.compared
        );
    }
    for note in &m.notes {
        let _ = writeln!(text, "note      {note}");
    }
    text
}
