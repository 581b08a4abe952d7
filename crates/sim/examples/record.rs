//! Writes a simulated recording: `cargo run --release -p cairn-sim --example record sim:WORLD?... DIR`, in TUM layout
//! when it has depth, else in EuRoC layout.

use cairn_sensor::Source;
use cairn_sim::{SimSource, write_euroc, write_tum};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, target] = arguments.as_slice() else { return Err("give sim:WORLD?... and a folder".into()) };
    let mut source = SimSource::open(what)?;
    let target = Path::new(target);
    let frames = if source.rig().depth.is_some() {
        write_tum(target, &mut source)?
    } else {
        write_euroc(target, &mut source)?
    };
    println!("{frames} frames in {}", target.display());
    Ok(())
}
