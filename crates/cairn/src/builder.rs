//! What a [`Slam`] is built from: rig, sensors, configuration, and perhaps a saved map.

use crate::{Error, Slam};
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Engine, Runner, SensorMode, Sensors};
use cairn_guide::PhraseConfig;
use cairn_sensor::{Host, Rig, Source};
use cairn_session::{Session, SessionConfig};
use cairn_sources::std_host;

/// Frames a second where nothing else is said.
const RATE_HZ: f64 = 30.0;

/// Collects what a [`Slam`] needs; see [`Slam::builder`] for what is used where nothing is said.
#[derive(Clone)]
pub struct Builder {
    rig: Rig,
    mode: Option<SensorMode>,
    config: Config,
    rate_hz: f64,
    runner: Runner,
    with_imu: bool,
    map: Option<MapFile>,
    localize_only: bool,
    phrases: PhraseConfig,
    source: String,
    host: Host,
}

/// The mode that uses most of a rig's cameras: depth where there is a depth sensor, else stereo where there are
/// two cameras, else mono.
pub fn sensor_mode_of(rig: &Rig) -> SensorMode {
    Sensors::of(rig).mode()
}

impl Builder {
    pub(crate) fn new(rig: &Rig) -> Self {
        Self {
            rig: rig.clone(),
            mode: None,
            config: Config::default(),
            rate_hz: RATE_HZ,
            runner: Runner::Lockstep,
            with_imu: true,
            map: None,
            localize_only: false,
            phrases: PhraseConfig::default(),
            source: String::new(),
            host: std_host(),
        }
    }

    pub(crate) fn of(source: &dyn Source) -> Self {
        let info = source.info();
        Self { rate_hz: info.rate_hz, source: info.name.clone(), ..Self::new(source.rig()) }
    }

    /// Uses these cameras of the rig.
    pub fn sensor(self, mode: SensorMode) -> Self {
        Self { mode: Some(mode), ..self }
    }

    /// Leaves the rig's IMU unused.
    pub fn without_imu(self) -> Self {
        Self { with_imu: false, ..self }
    }

    /// Sets the configuration of the stages; whether the IMU is used is decided by the rig and
    /// [`Builder::without_imu`] alone.
    pub fn config(self, config: &Config) -> Self {
        Self { config: config.clone(), ..self }
    }

    /// Sets the nominal number of frames a second.
    pub fn rate_hz(self, rate_hz: f64) -> Self {
        Self { rate_hz, ..self }
    }

    /// Runs mapping and loop closing on threads of their own, so that tracking never waits for them: for live
    /// cameras. Without it all stages run one after the other, and two runs are bit-identical.
    pub fn threaded(self) -> Self {
        Self { runner: Runner::Threaded, ..self }
    }

    /// Takes time and threads from another host than this machine: a simulator on virtual time, a page without threads.
    pub fn host(self, host: Host) -> Self {
        Self { host, ..self }
    }

    /// Continues in a saved map: the pose is lost until a place is recognised, and mapping goes on from there. Another camera
    /// may have made the map: with depth or an IMU this one continues it where lengths are metres (and, without depth, the map is
    /// aligned with gravity), without both it only localises. [`Slam::notes`] tells which.
    pub fn map(self, map: MapFile) -> Self {
        Self { map: Some(map), localize_only: false, ..self }
    }

    /// Localises in a saved map, which stays unchanged.
    pub fn localize_in(self, map: MapFile) -> Self {
        Self { map: Some(map), localize_only: true, ..self }
    }

    /// Sets unit and form of the distances and directions in spoken words.
    pub fn phrases(self, phrases: PhraseConfig) -> Self {
        Self { phrases, ..self }
    }

    /// Builds it.
    ///
    /// # Errors
    /// [`Error::Rig`] when the rig is impossible or lacks a sensor of the mode, [`Error::Config`] for a number out of
    /// range, [`Error::Rate`], [`Error::EmptyMap`] and [`Error::OpenMap`] when the saved map is empty or of another
    /// camera.
    pub fn build(self) -> Result<Slam, Error> {
        self.rig.validate()?;
        if !(self.rate_hz.is_finite() && self.rate_hz > 0.0) {
            return Err(Error::Rate(self.rate_hz));
        }
        let (rig, mode) = (&self.rig, self.mode.unwrap_or_else(|| sensor_mode_of(&self.rig)));
        let mut config = self.config;
        config.inertial.enabled = self.with_imu && rig.imu.is_some();
        config.check()?;
        let (engine, notes) = match &self.map {
            None => (Engine::new(rig, mode, self.rate_hz, self.runner, &config, &self.host)?, Vec::new()),
            Some(file) if file.snapshot.key_frame_count() == 0 => return Err(Error::EmptyMap),
            Some(file) => {
                Engine::in_map_of_any_camera(rig, mode, self.rate_hz, self.runner, &config, &self.host, file)?
            }
        };
        let engine = if self.localize_only { engine.localize_only() } else { engine };
        let session = Session::new(
            engine,
            SessionConfig {
                source: self.source,
                map_is_loaded: self.map.is_some(),
                phrases: self.phrases,
                ..SessionConfig::default()
            },
        );
        let attached = self.map.map_or_else(Default::default, |file| file.attached);
        Ok(Slam { session, attached, notes, last: None })
    }
}

/// How a [`Slam`] comes to be.
impl Slam {
    /// SLAM with these cameras of a rig, and its IMU where it has one, in lockstep at about 30 frames a second;
    /// [`Slam::builder`] has the other choices.
    ///
    /// # Errors
    /// As [`Builder::build`].
    pub fn new(rig: &Rig, mode: SensorMode, config: &Config) -> Result<Self, Error> {
        Self::builder(rig).sensor(mode).config(config).build()
    }

    /// Builds from a rig. Where nothing else is said: all its sensors ([`crate::sensor_mode_of`]), 30 frames a second, the
    /// default configuration, lockstep, an empty map.
    pub fn builder(rig: &Rig) -> Builder {
        Builder::new(rig)
    }

    /// Builds from the rig and the frame rate of a source.
    pub fn for_source(source: &dyn Source) -> Builder {
        Builder::of(source)
    }
}
