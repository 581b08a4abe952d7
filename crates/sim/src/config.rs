//! What is simulated: world, route, sensors, effects; and its short form `sim:WORLD?key=value&...`.

use crate::effects::Effects;
use crate::walk::{ImuConfig, ImuTroubles, Walker};
use crate::world::{UnknownWorld, WorldKind, WorldOptions};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthSensor, ImuNoise, Rig, RigCamera, SourceError, Stamp};
use std::path::PathBuf;

/// The kind of cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimSensor {
    /// One camera.
    Mono,
    /// Two cameras side by side.
    Stereo,
    /// One camera with depth at each pixel.
    Rgbd,
}

/// The path of the body.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraPath {
    /// A route of the world by name; `None` takes the first.
    Route(Option<String>),
    /// Corners on the floor, metres.
    Points(Vec<Vec2>),
    /// Body poses in time, already in the world's frame.
    Poses(Vec<(Stamp, Se3)>),
    /// A TUM file of body poses (z up); it is translated (not rotated) so that its middle comes to the middle of the
    /// world's first route. With [`SimConfig::readings`] the poses are smoothed and transformed to the readings'
    /// clock.
    File(PathBuf),
}

/// The full config of a simulated recording; the same config gives the same bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct SimConfig {
    /// The kind of world.
    pub world: WorldKind,
    /// Seed of the world, of the noise and of the passers-by.
    pub seed: u64,
    /// Variants of the world.
    pub options: WorldOptions,
    /// The kind of cameras.
    pub sensor: SimSensor,
    /// The IMU, if any.
    pub imu: Option<ImuConfig>,
    /// Real IMU readings of the motion in [`CameraPath::File`], instead of simulated ones: a csv file, see
    /// [`crate::read_readings`].
    pub readings: Option<PathBuf>,
    /// Faults added to the readings, simulated or real.
    pub troubles: ImuTroubles,
    /// The camera; a pinhole.
    pub camera: Camera,
    /// Pose of the first camera on the body; identity: the body frame is the camera frame.
    pub body_from_camera: Se3,
    /// Metres between the two cameras.
    pub baseline_m: f64,
    /// Frames a second.
    pub rate_hz: f64,
    /// The path of the body.
    pub route: CameraPath,
    /// How often the route is walked; more than once only if it ends where it begins.
    pub laps: usize,
    /// Seconds of the motion to skip at its beginning.
    pub start_s: f64,
    /// Maximum duration in seconds.
    pub duration_s: Option<f64>,
    /// The gait and pace of the walker.
    pub walker: Walker,
    /// The image effects of the sensor.
    pub effects: Effects,
    /// How many people walk about.
    pub passers_by: usize,
}

impl SimConfig {
    /// A world with the usual rig: stereo, 640x480 at 20 Hz, IMU at 200 Hz.
    pub fn new(world: WorldKind, seed: u64) -> Self {
        Self {
            world,
            seed,
            options: WorldOptions::default(),
            sensor: SimSensor::Stereo,
            imu: Some(ImuConfig::default()),
            readings: None,
            troubles: ImuTroubles::default(),
            camera: Camera::pinhole(640, 480, 420.0, 420.0, 319.5, 239.5),
            body_from_camera: Se3::identity(),
            baseline_m: 0.12,
            rate_hz: 20.0,
            route: CameraPath::Route(None),
            laps: 1,
            start_s: 0.0,
            duration_s: None,
            walker: Walker::default(),
            effects: Effects::default(),
            passers_by: 0,
        }
    }

    /// The rig of this config.
    pub fn rig(&self) -> Rig {
        let camera = |name: &str, x: f64| RigCamera {
            name: name.into(),
            camera: self.camera,
            body_from_camera: self.body_from_camera * Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0)),
        };
        let mut cameras = vec![camera("cam0", 0.0)];
        if self.sensor == SimSensor::Stereo {
            cameras.push(camera("cam1", self.baseline_m));
        }
        let depth = (self.sensor == SimSensor::Rgbd).then_some(DepthSensor {
            camera: self.camera,
            body_from_depth: self.body_from_camera,
            metres_per_unit: 0.001,
            registered: true,
        });
        let mut imu = self.imu.as_ref().map(ImuConfig::sensor);
        if let Some(sensor) = &mut imu {
            sensor.rate_hz /= self.troubles.mean_of.max(1) as f64;
        }
        Rig { cameras, depth, imu }
    }

    /// Parses `sim:WORLD` or `sim:WORLD?key=value&key=value`; [`SimConfig::KEYS`] lists the keys.
    ///
    /// # Errors
    /// Names the part that is not understood and the possible values.
    pub fn parse(text: &str) -> Result<Self, SourceError> {
        let fail = |why: String, cure: String| SourceError::new(text, why, cure);
        let Some(rest) = text.strip_prefix("sim:") else {
            return Err(fail("does not begin with \"sim:\"".into(), "write sim:WORLD?key=value&...".into()));
        };
        let (name, query) = rest.split_once('?').unwrap_or((rest, ""));
        let world: WorldKind =
            name.parse().map_err(|e: UnknownWorld| fail(e.to_string(), "choose one of them".into()))?;
        let mut config = Self::new(world, 1);
        for pair in query.split('&').filter(|p| !p.is_empty()) {
            let Some((key, value)) = pair.split_once('=') else {
                return Err(fail(format!("\"{pair}\" has no \"=\""), "write key=value".into()));
            };
            config.set(key, value).map_err(|(why, cure)| fail(format!("{key}={value}: {why}"), cure))?;
        }
        config.check()?;
        Ok(config)
    }

    /// The keys of the short form and their meaning.
    pub const KEYS: [(&'static str, &'static str); 39] = [
        ("seed", "whole number, 1"),
        ("sensor", "mono, stereo, rgbd, mono-imu, stereo-imu, rgbd-imu (default stereo-imu)"),
        ("rate", "frames a second, 20"),
        ("route", "name of a route of the world, its first"),
        ("laps", "how often a route that ends where it begins is walked, 1"),
        ("trajectory", "TUM file of body poses to follow instead of a route"),
        (
            "imu",
            "csv file of real readings on that trajectory (ns, gyro xyz, accel xyz), instead of simulated ones",
        ),
        ("start", "seconds of the motion to skip, 0"),
        ("duration", "maximum duration in seconds"),
        ("speed", "m/s, 0.9"),
        ("gait", "size of the gait, 1"),
        ("height", "camera above the floor in m, 1.3"),
        ("pitch", "degrees that the camera looks down, 5"),
        ("look", "degrees by which the camera looks to the left of the walking direction, 0; 180 looks back"),
        ("pause", "seconds of standing at every third corner, 0"),
        ("resolution", "WIDTHxHEIGHT, 640x480 (the focal length follows the width)"),
        ("focal", "focal length in pixels, 420"),
        ("baseline", "metres between the cameras, 0.12"),
        ("effects", "none or default"),
        ("noise", "grey levels, 2"),
        ("vignette", "share of light lost in the corners, 0.15"),
        ("exposure", "share by which the exposure varies slowly, 0.06"),
        ("flicker", "share by which the light flickers, 0.01"),
        ("blur", "exposure time in ms, 0"),
        ("depth_noise", "metres at 1 m, 0.0012"),
        (
            "projector",
            "metres from the camera to a projector of structured light, 0: none; 0.075 is a Kinect's",
        ),
        ("mount", "pose of the camera on the body: x,y,z,qx,qy,qz,qw, metres; identity without it"),
        ("imu_noise", "0 or 1, 1"),
        ("imu_rate", "readings a second, 200"),
        ("imu_densities", "gyro, gyro walk, accel, accel walk as stated in the rig: 1.7e-4,1.9e-5,2e-3,3e-3"),
        ("imu_mean", "each output reading is the mean of this many, 1; 2 halves the rate"),
        ("imu_offset", "ms that the rig does not state: t_imu + offset = t_image, 0"),
        ("imu_lost", "percent of the readings that are lost, 0"),
        ("imu_steps", "seconds between jumps of the biases by 3 mrad/s and 0.05 m/s^2 an axis, 0: none"),
        ("passers", "how many people walk about, 0"),
        ("poor", "share of plain walls, 0"),
        ("size", "WIDTHxDEPTHxHEIGHT of an arena in m; without it that of the trajectory, else 10x8x4"),
        ("look_alike", "1: an office whose rooms look alike, 0"),
        ("detail", "texels a metre as a share of the usual, 1; less builds faster"),
    ];

    fn set(&mut self, key: &str, value: &str) -> Result<(), (String, String)> {
        let number = |low: f64, high: f64| -> Result<f64, (String, String)> {
            let v: f64 =
                value.parse().map_err(|_| ("not a number".to_string(), "write a number".to_string()))?;
            if v.is_finite() && v >= low && v <= high {
                Ok(v)
            } else {
                Err(("out of range".into(), format!("write a number from {low} to {high}")))
            }
        };
        match key {
            "seed" => {
                self.seed = value.parse().map_err(|_| {
                    ("not a whole number".to_string(), "write a whole number from 0".to_string())
                })?;
            }
            "sensor" => self.set_sensor(value)?,
            "rate" => self.rate_hz = number(0.5, 240.0)?,
            "route" | "way" => self.route = CameraPath::Route(Some(value.into())),
            "laps" => self.laps = number(1.0, 1000.0)? as usize,
            "trajectory" => self.route = CameraPath::File(value.into()),
            "imu" => self.readings = Some(value.into()),
            "start" => self.start_s = number(0.0, 86_400.0)?,
            "duration" => self.duration_s = Some(number(0.0, 86_400.0)?),
            "speed" => self.walker.speed = number(0.1, 3.0)?,
            "gait" => self.walker.gait = number(0.0, 5.0)?,
            "height" => self.walker.height = number(0.2, 2.2)?,
            "pitch" => self.walker.pitch_down = number(-60.0, 60.0)?.to_radians(),
            "look" => self.walker.look = number(-180.0, 180.0)?.to_radians(),
            "pause" => {
                self.walker.pause_s = number(0.0, 600.0)?;
                self.walker.pause_every = 3;
            }
            "resolution" => self.set_resolution(value)?,
            "focal" => {
                let f = number(20.0, 5000.0)?;
                (self.camera.fx, self.camera.fy) = (f, f);
            }
            "baseline" => self.baseline_m = number(0.005, 2.0)?,
            "effects" => match value {
                "none" => self.effects = Effects::none(),
                "default" => self.effects = Effects::default(),
                _ => return Err(("not known".into(), "write none or default".into())),
            },
            "noise" => self.effects.noise = number(0.0, 60.0)?,
            "vignette" => self.effects.vignette = number(0.0, 1.0)?,
            "exposure" => self.effects.exposure = number(0.0, 0.9)?,
            "flicker" => self.effects.flicker = number(0.0, 0.9)?,
            "blur" => self.effects.blur_s = number(0.0, 100.0)? / 1000.0,
            "depth_noise" => self.effects.depth_noise = number(0.0, 0.1)?,
            "projector" => self.effects.projector_m = Some(number(0.0, 1.0)?).filter(|m| *m > 0.0),
            "imu_noise" => {
                let noisy = number(0.0, 1.0)? > 0.5;
                self.imu = self.imu.map(|i| ImuConfig { noisy, ..i });
            }
            "mount" => {
                let [x, y, z, qx, qy, qz, qw] = numbers(value)?;
                let turn = So3::from_xyzw(qx, qy, qz, qw)
                    .ok_or(("the quaternion is zero".to_string(), "write 0,0,0,1 for none".to_string()))?;
                self.body_from_camera = Se3::new(turn, Vec3::new(x, y, z));
            }
            "imu_rate" => {
                let rate_hz = number(1.0, 20_000.0)?;
                self.imu = self.imu.map(|i| ImuConfig { rate_hz, ..i });
            }
            "imu_densities" => {
                let [gyro, gyro_walk, accel, accel_walk] = numbers(value)?;
                let noise = ImuNoise { gyro, gyro_walk, accel, accel_walk };
                self.imu = self.imu.map(|i| ImuConfig { noise, ..i });
            }
            "imu_mean" => self.troubles.mean_of = number(1.0, 100.0)? as usize,
            "imu_offset" => self.troubles.offset_s = number(-1000.0, 1000.0)? / 1000.0,
            "imu_lost" => self.troubles.lost = number(0.0, 100.0)? / 100.0,
            "imu_steps" => self.troubles.bias_steps_s = number(0.0, 1e6)?,
            "size" => self.options.size_m = Some(size(value)?),
            "passers" => self.passers_by = number(0.0, 50.0)? as usize,
            "poor" => self.options.poor_walls = number(0.0, 1.0)?,
            "detail" => self.options.detail = number(0.02, 4.0)?,
            "look_alike" => self.options.look_alike = number(0.0, 1.0)? > 0.5,
            _ => {
                let keys: Vec<&str> = Self::KEYS.iter().map(|k| k.0).collect();
                return Err(("unknown key".into(), format!("known keys are {}", keys.join(", "))));
            }
        }
        Ok(())
    }

    /// Checks keys that are valid only together with others.
    fn check_readings(&self) -> Result<(), SourceError> {
        let fail = |why: &str, cure: &str| Err(SourceError::new(format!("sim:{}", self.world), why, cure));
        if self.readings.is_some() && !matches!(self.route, CameraPath::File(_)) {
            return fail("real readings without the motion they were taken on", "give trajectory=FILE too");
        }
        if self.readings.is_some() && self.imu.is_none() {
            return fail(
                "readings for an IMU that the rig does not have",
                "write sensor=mono-imu, stereo-imu or rgbd-imu",
            );
        }
        let t = &self.troubles;
        let numbers = [t.offset_s.abs(), t.lost, t.bias_steps_s, t.bias_step[0], t.bias_step[1]];
        if !numbers.iter().all(|v| (0.0..1e7).contains(v)) || t.lost > 1.0 {
            return fail("a value of the IMU faults is out of range", "correct the imu_ keys");
        }
        if self.options.size_m.is_some_and(|s| !s.iter().all(|v| (2.6..=100.0).contains(v))) {
            return fail("the size of the arena is not from 2.6 to 100 m", "correct the size");
        }
        Ok(())
    }

    fn set_sensor(&mut self, value: &str) -> Result<(), (String, String)> {
        let (cameras, imu) = value.strip_suffix("-imu").map_or((value, false), |c| (c, true));
        self.sensor = match cameras {
            "mono" => SimSensor::Mono,
            "stereo" => SimSensor::Stereo,
            "rgbd" => SimSensor::Rgbd,
            _ => return Err(("not known".into(), "write mono, stereo or rgbd, with -imu or without".into())),
        };
        self.imu = imu.then(|| self.imu.unwrap_or_default());
        Ok(())
    }

    fn set_resolution(&mut self, value: &str) -> Result<(), (String, String)> {
        let parse = || {
            let (w, h) = value.split_once('x')?;
            let (w, h): (usize, usize) = (w.parse().ok()?, h.parse().ok()?);
            ((16..=4096).contains(&w) && (16..=4096).contains(&h)).then_some((w, h))
        };
        let (w, h) =
            parse().ok_or(("not a resolution".to_string(), "write for example 640x480".to_string()))?;
        let f = self.camera.fx * w as f64 / self.camera.width as f64;
        self.camera = Camera::pinhole(w, h, f, f, (w as f64 - 1.0) / 2.0, (h as f64 - 1.0) / 2.0);
        Ok(())
    }

    /// Checks the config.
    ///
    /// # Errors
    /// Names the value and its range.
    pub fn check(&self) -> Result<(), SourceError> {
        let fail = |why: String, cure: &str| Err(SourceError::new(format!("sim:{}", self.world), why, cure));
        if !(self.rate_hz > 0.0 && self.rate_hz <= 1000.0) {
            return fail(format!("rate {} Hz", self.rate_hz), "give a rate up to 1000 Hz");
        }
        if let Some(imu) = &self.imu
            && imu.rate_hz > 20_000.0
        {
            return fail(format!("IMU rate {} Hz", imu.rate_hz), "give a rate up to 20000 Hz");
        }
        let w = &self.walker;
        let numbers =
            [w.speed, w.height, w.pitch_down, w.gait, w.look, w.turn_rate, w.spot_turn, w.rest_s, w.pause_s];
        if !numbers.iter().all(|v| v.abs() < 1e4) {
            return fail("a value of the walker is not finite or too large".into(), "correct the walker");
        }
        let e = &self.effects;
        let numbers = [
            e.noise,
            e.vignette,
            e.exposure,
            e.flicker,
            e.blur_s,
            e.depth_noise,
            e.depth_range[0],
            e.depth_range[1],
            e.projector_m.unwrap_or(0.0),
        ];
        if numbers.iter().any(|v| !(0.0..1e4).contains(v)) {
            return fail(
                "a value of the effects is negative, not finite or too large".into(),
                "correct the effects",
            );
        }
        if self.camera.width > 4096 || self.camera.height > 4096 {
            return fail(
                format!("resolution {}x{}", self.camera.width, self.camera.height),
                "give 4096 at most",
            );
        }
        self.check_readings()?;
        if let Err(e) = self.rig().validate() {
            return fail(e.to_string(), "correct the rig");
        }
        if !((0.0..1e9).contains(&self.start_s) && self.duration_s.is_none_or(|d| d.is_finite() && d >= 0.0))
        {
            return fail("start or duration is not a number of seconds".into(), "give seconds from 0");
        }
        Ok(())
    }
}

/// Numbers separated by commas.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], (String, String)> {
    let parts: Option<Vec<f64>> =
        text.split(',').map(|p| p.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    parts
        .and_then(|p| p.try_into().ok())
        .ok_or((format!("not {N} numbers"), format!("write {N} numbers with commas between them")))
}

/// Metres as `WxDxH`.
fn size(text: &str) -> Result<[f64; 3], (String, String)> {
    let parts: Option<Vec<f64>> = text.split('x').map(|p| p.parse().ok()).collect();
    parts
        .and_then(|p| p.try_into().ok())
        .ok_or(("not a size".to_string(), "write for example 18x15x5".to_string()))
}
