//! `cairn fleet fetch`: the tile of a published atlas that shows the place of an image or of the beginning of a recording.

use super::failed;
use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn_fleet::{Answer, Evidence, Fetched};
use std::fmt::Write;
use std::path::PathBuf;

/// Fetches the tile that shows the place of an image, or where a recording begins.
///
/// By visual words: only the parts of the index that the image needs are read. Geometry decides: a recording is tracked in the best tiles
/// until one holds it, and a single image must show enough landmarks of one of them. Where none does, the place is unknown: exit code 3.
/// The tile is a map for cairn run --map-in.
#[derive(clap::Args)]
pub struct Arguments {
    /// The store of cairn fleet build.
    #[arg(value_name = "STORE")]
    store: String,
    /// A PNG or JPEG image, or a recording.
    #[arg(value_name = "IMAGE|RECORDING")]
    query: String,
    /// Writes the tile.
    #[arg(long, value_name = "OUT.map")]
    out: PathBuf,
    /// Replace the file if it exists.
    #[arg(long)]
    overwrite: bool,
}

/// Fetches.
///
/// # Errors
/// When nothing was published in the store, no tile is found, or a file cannot be read or written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let outputs = Outputs::new(a.overwrite).output_map("--out", Some(&a.out)).checked()?;
    let out = outputs.file("--out").unwrap_or(&a.out);
    let store = cairn_fleet::open(&a.store).map_err(failed)?;
    let query = cairn_fleet::query_of(&a.query).map_err(failed)?;
    let (fetched, bytes) = match cairn_fleet::fetch(&*store, &query).map_err(failed)? {
        Answer::Place(fetched, bytes) => (fetched, bytes),
        Answer::Unknown(most) => {
            let why = match most {
                Some(Evidence::Tracked([held, of])) => {
                    format!("at most {held} of {of} frames have a pose in a tile")
                }
                Some(Evidence::Seen(seen)) => {
                    format!("at most {} landmarks of a tile are seen, {} needed", seen.landmarks, seen.needed)
                }
                None => "no tile has any of its words".to_owned(),
            };
            let hint = "try another view, or build the atlas with a recording of this place";
            return Err(Failure::unknown_place(&a.query, format!("unknown place: {why}"), hint));
        }
    };
    std::fs::write(out, bytes).map_err(|e| {
        Failure::new(out.display().to_string(), e.to_string(), "check that its folder is writable")
    })?;
    output.result(&fetched, text)
}

fn text(f: &Fetched) -> String {
    let mut text = String::new();
    let cell = match f.tile.cell {
        Some([x, y, z]) => format!("cube {x} {y} {z}"),
        None => "whole, without metres".to_owned(),
    };
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "tile      atlas {}, {cell}: {} key frames, {:.2} MB",
        f.tile.atlas,
        f.tile.key_frames,
        f.tile.map.bytes as f64 / 1e6
    );
    let _ = writeln!(text, "words     score {:.3}, the best other tile {:.3}", f.tile.score, f.next_score);
    let _ = match f.evidence {
        Evidence::Tracked([held, of]) => writeln!(text, "tracked   {held} of {of} frames have a pose in it"),
        Evidence::Seen(seen) => {
            let [x, y, z] = seen.position.unwrap_or_default();
            writeln!(
                text,
                "seen      {} landmarks of it, {} needed; the camera is at {x:.2} {y:.2} {z:.2} in the atlas",
                seen.landmarks, seen.needed
            )
        }
    };
    let _ = writeln!(
        text,
        "read      {:.1} kB of the index, {:.2} MB of tiles",
        f.index_bytes as f64 / 1e3,
        f.tile_bytes as f64 / 1e6
    );
    text
}
