//! `cairn fleet fetch`: the tile of a published atlas that shows the place of an image or of the beginning of a recording.

use super::failed;
use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn_fleet::Fetched;
use std::fmt::Write;
use std::path::PathBuf;

/// Fetches the tile that shows the place of an image, or where a recording begins.
///
/// By visual words: only the parts of the index that the image needs are read. A recording is then tracked in the best tiles until one holds
/// it; for a single image only the words speak, and the score of the best other tile tells how much. The tile is a map for cairn run --map-in.
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
    let Some((fetched, bytes)) = cairn_fleet::fetch(&*store, &query).map_err(failed)? else {
        let hint = "walk on and try another stretch, or build the atlas with a recording of this place";
        return Err(Failure::new(&a.query, "no tile of the atlas shows this place", hint));
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
    let _ = match f.tracked {
        Some([held, of]) => writeln!(text, "tracked   {held} of {of} frames have a pose in it"),
        None => writeln!(text, "tracked   not tried: a single image; the words alone may be wrong"),
    };
    let _ = writeln!(
        text,
        "read      {:.1} kB of the index, {:.2} MB of tiles",
        f.index_bytes as f64 / 1e3,
        f.tile_bytes as f64 / 1e6
    );
    text
}
