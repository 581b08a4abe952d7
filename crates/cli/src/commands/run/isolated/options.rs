//! What the arguments ask for, for all processes.

use super::super::Arguments;
use crate::commands::given::read_config;
use crate::failure::Failure;
use cairn_session::FileConfig;

pub(super) fn config_of(a: &Arguments) -> Result<FileConfig, Failure> {
    let mut config = a.config.as_deref().map_or_else(|| Ok(FileConfig::default()), read_config)?;
    config.engine.robot = a.robot.unwrap_or(config.engine.robot);
    Ok(config)
}

pub(super) fn makes_surfaces(a: &Arguments) -> bool {
    a.mesh.is_some() || a.dense
}
