//! `cairn map repair`: saves what is whole of a damaged map in a new file.

use super::{bytes_of, failed};
use crate::failure::Failure;
use crate::map_lock::MapLock;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn::ROUTE_PREFIX;
use cairn_atlas::store::MapFile;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Saves what is whole of a damaged or truncated map in a new file, and says what is lost.
///
/// Key frames whose features are damaged keep their poses but show nothing; words are computed again; points that no
/// key frame shows any more, and routes and depth that are damaged, are left out. The damaged file is not changed.
#[derive(clap::Args)]
pub struct Arguments {
    /// The damaged map.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The new file.
    #[arg(long, value_name = "OUT.map")]
    out: PathBuf,
    /// Replace the new file if it exists.
    #[arg(long)]
    overwrite: bool,
}

#[derive(Serialize)]
struct Repaired {
    out: PathBuf,
    bytes: u64,
    key_frames: usize,
    /// Key frames that show nothing any more.
    without_features: usize,
    landmarks: usize,
    routes: usize,
    /// Depth images of key frames.
    depth_images: usize,
    /// What was lost, one line each; empty where the map was whole.
    lost: Vec<String>,
}

/// Repairs the map.
///
/// # Errors
/// When the file cannot be read, nothing of it can be used, or the new one cannot be written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let outputs =
        Outputs::new(a.overwrite).input("the damaged map", Some(&a.file)).output_map("--out", Some(&a.out));
    let outputs = outputs.checked()?;
    let out = outputs.file("--out").unwrap_or(&a.out);
    let _lock = MapLock::take(out)?;
    let bytes = bytes_of(&a.file)?;
    let (file, lost) = MapFile::salvage(&bytes).map_err(|e| {
        let why = format!("nothing can be saved: {e}");
        Failure::new(a.file.display().to_string(), why, "use a backup, or walk there again")
    })?;
    let depth = file.depth().map_err(|e| failed(&a.file, &e))?;
    let bytes = file.save(out).map_err(|e| failed(&a.out, &e))?;
    let repaired = Repaired {
        out: a.out.clone(),
        bytes,
        key_frames: file.snapshot.key_frame_count(),
        without_features: file.snapshot.key_frames().filter(|k| k.frame.is_empty()).count(),
        landmarks: file.snapshot.landmark_count(),
        routes: file.attached.keys().filter(|name| name.starts_with(ROUTE_PREFIX)).count(),
        depth_images: depth.iter().map(|part| part.images.len()).sum(),
        lost,
    };
    output.result(&repaired, text)
}

fn text(r: &Repaired) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "written   {}, {:.3} MB", r.out.display(), r.bytes as f64 / 1e6);
    let _ = writeln!(
        text,
        "saved     {} key frames ({} without features), {} landmarks, {} routes",
        r.key_frames, r.without_features, r.landmarks, r.routes
    );
    if r.depth_images > 0 {
        let _ = writeln!(text, "          {} depth images", r.depth_images);
    }
    if r.lost.is_empty() {
        let _ = writeln!(text, "lost      nothing: the map was whole");
    }
    for lost in &r.lost {
        let _ = writeln!(text, "lost      {lost}");
    }
    text
}
