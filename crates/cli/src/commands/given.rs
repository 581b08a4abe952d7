//! What a run and a server are given alike: a configuration, a rig.

use super::rig::noted_rig_for;
use crate::failure::Failure;
use cairn_engine::Config;
use cairn_files::MIB;
use cairn_sensor::Rig;
use cairn_session::FileConfig;
use cairn_sources::named_rig;
use std::path::Path;

/// Reads a configuration file; entries it leaves out keep their defaults.
///
/// # Errors
/// When the file cannot be read or an entry is unknown or invalid.
pub fn read_config(path: &Path) -> Result<FileConfig, Failure> {
    let shown = path.display().to_string();
    let text = cairn_files::read_text(path, 16 * MIB)
        .map_err(|e| Failure::new(&shown, e.to_string(), "check the path, or see cairn config"))?;
    FileConfig::from_toml(&text).map_err(|e| {
        let place = e.line.map_or_else(|| shown.clone(), |line| format!("{shown}, line {line}"));
        Failure::new(place, e.why, "run cairn config to see every entry with its meaning")
    })
}

/// A rig by name or file; a file that does not state the size of its images gets that of the source. A built-in rig also sets its number of features, unless the configuration sets one.
///
/// # Errors
/// When the file cannot be read or is invalid.
pub fn rig_of(path: &Path, source: &str, config: &mut Config) -> Result<Rig, Failure> {
    if let Some(named) = path.to_str().and_then(named_rig).filter(|_| !path.exists()) {
        if config.front_end.orb.features == 0 {
            config.front_end.orb.features = named.features;
        }
        return Ok(named.rig);
    }
    noted_rig_for(path, source)
}
