//! What a run begins with: its configuration, its source with the sensors that are used, its vocabulary.

use super::arguments::{Arguments, Kind, TrajectoryFrame};
use crate::commands::given::{read_config, rig_of};
use crate::failure::Failure;
use crate::interrupt;
use crate::output::{note, warn};
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, SensorMode, Sensors, with_found_lens};
use cairn_files::MIB;
use cairn_geometry::Se3;
use cairn_sensor::{Rig, Source};
use cairn_session::FileConfig;
use cairn_sources::{OpenOptions, Validator, is_live, open, waiting_for};
use cairn_vision::bow::Vocabulary;
use std::path::Path;
use tracing::debug;

/// The configuration that the arguments ask for.
///
/// # Errors
/// As [`read_config`].
pub fn config_of(a: &Arguments) -> Result<FileConfig, Failure> {
    let mut config = a.config.as_deref().map_or_else(|| Ok(FileConfig::default()), read_config)?;
    config.engine.robot = a.robot.unwrap_or(config.engine.robot);
    Ok(config)
}

/// Opens the source, and fits the configuration to what it has.
///
/// # Errors
/// When it cannot be opened, or lacks what is asked for.
pub fn fitted(
    a: &Arguments,
    config: &mut Config,
    map: Option<&MapFile>,
) -> Result<(Box<dyn Source>, Sensors), Failure> {
    let (source, sensor) = open_source(a, config, map)?;
    // A camera that nobody calibrated: its focal length is looked for, and its rows may be exposed one after the other.
    let is_guessed = source.info().assumed.is_some() && sensor == Sensors::MonoImu;
    let source = match is_guessed && !is_live(&a.source) && map.is_none() {
        true => with_found_lens(source, config)?,
        false => source,
    };
    let source: Box<dyn Source> = Box::new(Validator::new(source, warn));
    let info = source.info();
    debug!(source = %info.name, frames = ?info.frames, rate_hz = info.rate_hz, sensor = sensor.name(), "opened");
    config.inertial.enabled = sensor.has_imu();
    if is_guessed {
        config.expect_phone(false);
    }
    if sensor.has_imu() && source.rig().imu.is_none() {
        let why = format!("--sensor {} needs an IMU, but the rig has none", sensor.name());
        return Err(Failure::new(&a.source, why, "give a rig with an IMU using --rig, or leave out -imu"));
    }
    config.tracker.dense |= a.front_end.is_some();
    if config.tracker.dense && sensor.mode() != SensorMode::Rgbd {
        let why = format!("the dense front end needs a depth sensor, not --sensor {}", sensor.name());
        return Err(Failure::new(&a.source, why, "use --sensor rgbd, or leave out --front-end dense"));
    }
    Ok((source, sensor))
}

/// Opens the source and chooses its sensors: those of --sensor, those the map was made with if it has them, or all it has.
///
/// # Errors
/// When it cannot be opened.
pub fn open_source(
    a: &Arguments,
    config: &mut Config,
    map: Option<&MapFile>,
) -> Result<(Box<dyn Source>, Sensors), Failure> {
    open_part(a, (a.start, a.frames), config, map)
}

/// The same from another second on, and another number of frames.
///
/// # Errors
/// As [`open_source`].
pub fn open_part(
    a: &Arguments,
    (start_s, frames): (f64, Option<usize>),
    config: &mut Config,
    map: Option<&MapFile>,
) -> Result<(Box<dyn Source>, Sensors), Failure> {
    let options = |rig: Option<Rig>| OpenOptions {
        rig,
        kind: a.kind.map(Kind::kind),
        start_s,
        frames,
        topics: a.topics.clone(),
        number_frames_hz: a.number_frames,
        cancel: interrupt::cancel(),
        told: Some(note),
    };
    let given = a.rig.as_deref().map(|path| rig_of(path, &a.source, config)).transpose()?;
    let of_live = a.sensor.filter(|_| is_live(&a.source));
    let given = match of_live {
        Some(sensor) => given.map(|rig| sensor.live_rig(rig)),
        None => given,
    };
    if let Some(message) = waiting_for(&a.source) {
        note(&message);
    }
    let source = open(&a.source, options(given))?;
    let of_map = |map: &MapFile| Sensors::with(map.about.sensor, source.rig().imu.is_some());
    let of_map = map.map(of_map).filter(|sensor| sensor.is_in(source.rig()));
    let sensor = a.sensor.or(of_map).unwrap_or_else(|| Sensors::of(source.rig()));
    // A simulated world renders the sensors in its address, and a live source has one camera.
    let fewer = sensor.only(source.rig()).filter(|_| !a.source.starts_with("sim:") && !is_live(&a.source));
    match fewer {
        Some(rig) => {
            drop(source);
            Ok((open(&a.source, options(Some(rig)))?, sensor))
        }
        None => Ok((source, sensor)),
    }
}

/// Makes the words of this vocabulary those of the run.
///
/// # Errors
/// When the file cannot be read or is no vocabulary.
pub fn vocabulary(path: &Path) -> Result<(), Failure> {
    let fail = |why: String| {
        Failure::new(
            path.display().to_string(),
            why,
            "give a file of cairn vocab train or cairn vocab import",
        )
    };
    let bytes = cairn_files::read(path, 1024 * MIB).map_err(|e| fail(e.to_string()))?;
    let vocabulary = Vocabulary::open(bytes).map_err(|e| fail(e.to_string()))?;
    Vocabulary::install(vocabulary).map_err(|_| fail("another vocabulary is in use".into()))
}

/// Where the first camera is on the body, if poses are asked for of it.
pub fn cam0(a: &Arguments, rig: &Rig) -> Option<Se3> {
    rig.cameras.first().filter(|_| matches!(a.frame, TrajectoryFrame::Cam0)).map(|c| c.body_from_camera)
}
