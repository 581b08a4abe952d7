//! `cairn map merge`: several sessions in one file. The worlds stand beside each other; where they meet is found when a
//! place is recognised in a later run.

use super::{WAY, failed, open};
use crate::failure::Failure;
use crate::output::Output;
use cairn_atlas::Shift;
use cairn_atlas::store::MapFile;
use cairn_guide::Route;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Puts several maps of one camera into one file, with the ways recorded in them.
///
/// The worlds stand beside each other unaligned; they are joined when a place is recognised in a later run.
#[derive(clap::Args)]
pub struct Arguments {
    /// The saved maps.
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The new file.
    #[arg(long, value_name = "OUT.map")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Merged {
    out: PathBuf,
    bytes: u64,
    key_frames: usize,
    landmarks: usize,
    maps: usize,
    routes: usize,
    /// What is worth knowing, in words.
    notes: Vec<String>,
}

/// Merges the files.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let Some((first, others)) = a.files.split_first() else { return Ok(()) };
    let mut into = open(first)?;
    let mut notes = Vec::new();
    for path in others {
        add(&mut into, open(path)?, path, &mut notes)?;
    }
    let bytes = into.save(&a.out).map_err(|e| failed(&a.out, &e))?;
    let merged = Merged {
        out: a.out.clone(),
        bytes,
        key_frames: into.snapshot.key_frame_count(),
        landmarks: into.snapshot.landmark_count(),
        maps: into.snapshot.maps().count(),
        routes: into.attached.keys().filter(|name| name.starts_with(WAY)).count(),
        notes,
    };
    output.result(&merged, text)
}

fn add(into: &mut MapFile, other: MapFile, path: &Path, notes: &mut Vec<String>) -> Result<(), Failure> {
    let shown = path.display().to_string();
    let (a, b) = (&other.about, &into.about);
    let octaves = (other.snapshot.octaves(), into.snapshot.octaves());
    let fits = b.fits(octaves.1, a.sensor, &a.camera, octaves.0).map_err(|why| {
        let hint = "only maps of one camera can stand in one file";
        Failure::new(&shown, format!("does not go with the first: {why}"), hint)
    })?;
    notes.extend(fits.into_iter().map(|note| format!("{shown}: {note}")));
    let offsets = (into.snapshot.right_offset(), other.snapshot.right_offset());
    if (offsets.0 - offsets.1).abs() > 0.05 {
        let (kept, left) = offsets;
        notes.push(format!("{shown}: right x was {left:+.3} px off, the first map's {kept:+.3} px are kept"));
    }
    let (snapshot, shift) = into
        .snapshot
        .beside(&other.snapshot)
        .map_err(|why| Failure::new(&shown, why, "save the maps in several files"))?;
    into.snapshot = snapshot;
    for (name, bytes) in other.attached {
        let bytes = if name.starts_with(WAY) { shifted(&bytes, &shift, &shown, &name)? } else { bytes };
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

/// A way that hangs on the same key frames under their new numbers.
fn shifted(bytes: &[u8], shift: &Shift, shown: &str, name: &str) -> Result<Vec<u8>, Failure> {
    let wrong = |why: String| Failure::new(shown, format!("{name}: {why}"), "record the way again");
    let mut route = Route::read(bytes).map_err(|e| wrong(e.to_string()))?;
    for point in &mut route.points {
        let seq = u32::try_from(point.anchor.seq as usize + shift.key_frames);
        point.anchor.seq = seq.map_err(|_| wrong("there are not enough numbers for key frames".into()))?;
    }
    route.to_bytes().map_err(|e| wrong(e.to_string()))
}

fn text(m: &Merged) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = writeln!(text, "written   {}, {:.3} MB", m.out.display(), m.bytes as f64 / 1e6);
    let _ = writeln!(
        text,
        "map       {} key frames, {} landmarks, {} worlds, {} ways",
        m.key_frames, m.landmarks, m.maps, m.routes
    );
    for note in &m.notes {
        let _ = writeln!(text, "note      {note}");
    }
    text
}
