//! Writes the ORB features of gray images to one file, to compare with other extractors.
//!
//! `orb_features FEATURES OUT IN.pgm...`: for each image a little-endian u32 count, then for each feature
//! x, y, angle, response (f32), level (u32) and the 32 bytes of the descriptor.

use cairn_vision::{Features, OrbConfig, OrbExtractor};
use std::error::Error;

mod pgm;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [count, out, images @ ..] = arguments.as_slice() else {
        return Err("usage: orb_features FEATURES OUT IN.pgm...".into());
    };
    let mut extractor = OrbExtractor::new(OrbConfig { features: count.parse()?, ..OrbConfig::default() });
    let mut features = Features::default();
    let mut bytes = Vec::new();
    for path in images {
        let image =
            pgm::read(&std::fs::read(path)?).ok_or_else(|| format!("{path}: not an 8-bit binary PGM"))?;
        extractor.extract(&image, &mut features);
        bytes.extend((features.len() as u32).to_le_bytes());
        for i in 0..features.len() {
            let [x, y] = features.raw[i];
            for value in [x, y, features.angle[i], features.response[i]] {
                bytes.extend(value.to_le_bytes());
            }
            bytes.extend((features.octave[i] as u32).to_le_bytes());
            bytes.extend(features.descriptors[i]);
        }
    }
    Ok(std::fs::write(out, bytes)?)
}
