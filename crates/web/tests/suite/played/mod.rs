//! A simulated walk as the camera of a server: what the tests of the page and of requests have in common.

use cairn_engine::SensorMode;
use cairn_sensor::Source;
use cairn_sim::{SimConfig, SimSource};
use cairn_sources::Paced;
use cairn_web::CameraSource;

/// A walk through a world, played in real time.
pub fn walk() -> CameraSource {
    let open = || {
        let config = SimConfig::parse("sim:demo?sensor=rgbd&rate=10&resolution=320x240")?;
        let source: Box<dyn Source> = Box::new(Paced::new(Box::new(SimSource::new(&config)?)));
        Ok((source, SensorMode::Rgbd, false))
    };
    CameraSource::Source { name: "sim:demo".into(), open: Box::new(open) }
}
