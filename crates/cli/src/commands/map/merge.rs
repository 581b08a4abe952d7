//! `cairn map merge`: several saved maps in one file. They stay separate, unaligned maps; a later run joins them when
//! it recognises a place.

use super::{failed, open};
use crate::failure::Failure;
use crate::map_lock::MapLock;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn::ROUTE_PREFIX;
use cairn_atlas::Shift;
use cairn_atlas::store::MapFile;
use cairn_guide::Route;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Puts several saved maps of the same camera, with their recorded routes, into one file.
///
/// The maps stay separate and unaligned; a later run joins them when it recognises a place that they share.
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
    /// Notes for the user.
    notes: Vec<String>,
}

/// Merges the files.
///
/// # Errors
/// When a file cannot be read or written, or the maps are of different cameras.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let Some((first, others)) = a.files.split_first() else { return Ok(()) };
    let outputs = Outputs::new(a.overwrite);
    let outputs = a.files.iter().fold(outputs, |outputs, file| outputs.input("a map to merge", Some(file)));
    let outputs = outputs.output_map("--out", Some(&a.out)).checked()?;
    let out = outputs.file("--out").unwrap_or(&a.out);
    let _lock = MapLock::take(out)?;
    let mut into = open(first)?;
    let mut notes = Vec::new();
    for path in others {
        add(&mut into, open(path)?, path, &mut notes)?;
    }
    let bytes = into.save(out).map_err(|e| failed(&a.out, &e))?;
    let merged = Merged {
        out: a.out.clone(),
        bytes,
        key_frames: into.snapshot.key_frame_count(),
        landmarks: into.snapshot.landmark_count(),
        maps: into.snapshot.maps().count(),
        routes: into.attached.keys().filter(|name| name.starts_with(ROUTE_PREFIX)).count(),
        notes,
    };
    output.result(&merged, text)
}

fn add(into: &mut MapFile, other: MapFile, path: &Path, notes: &mut Vec<String>) -> Result<(), Failure> {
    let shown = path.display().to_string();
    let (a, b) = (&other.about, &into.about);
    let octaves = (other.snapshot.octaves(), into.snapshot.octaves());
    let fits = b.fits(octaves.1, a.sensor, &a.camera, octaves.0).map_err(|why| {
        let hint = "only maps made with the same camera can be put into one file";
        Failure::new(&shown, format!("does not fit the first map: {why}"), hint)
    })?;
    notes.extend(fits.into_iter().map(|note| format!("{shown}: {note}")));
    let offsets = (into.snapshot.right_offset(), other.snapshot.right_offset());
    if (offsets.0 - offsets.1).abs() > 0.05 {
        let (kept, left) = offsets;
        notes.push(format!(
            "{shown}: right-image offset {left:+.3} px replaced by the first map's {kept:+.3} px"
        ));
    }
    let (snapshot, shift) = into
        .snapshot
        .beside(&other.snapshot)
        .map_err(|why| Failure::new(&shown, why, "save the maps in several files"))?;
    into.snapshot = snapshot;
    for (name, bytes) in other.attached {
        let bytes =
            if name.starts_with(ROUTE_PREFIX) { shifted(&bytes, &shift, &shown, &name)? } else { bytes };
        let mut free = name.clone();
        let mut n = 2;
        while into.attached.contains_key(&free) {
            free = format!("{name}-{n}");
            n += 1;
        }
        into.attached.insert(free, bytes);
    }
    Ok(())
}

/// A route anchored to the same key frames under their new numbers.
fn shifted(bytes: &[u8], shift: &Shift, shown: &str, name: &str) -> Result<Vec<u8>, Failure> {
    let wrong = |why: String| Failure::new(shown, format!("{name}: {why}"), "record the route again");
    let mut route = Route::read(bytes).map_err(|e| wrong(e.to_string()))?;
    for point in &mut route.points {
        let seq = u32::try_from(point.anchor.seq as usize + shift.key_frames);
        point.anchor.seq = seq.map_err(|_| wrong("the number of a key frame is too large".into()))?;
    }
    route.to_bytes().map_err(|e| wrong(e.to_string()))
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
    for note in &m.notes {
        let _ = writeln!(text, "note      {note}");
    }
    text
}
