//! Rooms rendered around real motions, with the real readings of their inertial sensors, as they are and made worse.

use super::ran::{Asked, Figures, run};
use crate::Sensor;
use crate::inertial::data::links;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{Bias, InitialiseConfig, Scale, Seen, SeenPose, initialise};
use cairn_sensor::{ImuNoise, Source, Stamp};
use cairn_sim::{Agreement, CameraPath, ImuConfig, ImuTroubles, SimConfig, SimSource, World, WorldKind};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// A recording, where its stretch begins (in motion), and its sensor.
pub struct Motion {
    /// Folder below `imu-truth`.
    pub name: &'static str,
    /// Seconds after its first true pose.
    start_s: f64,
    tumvi: bool,
}

/// All of them.
pub const MOTIONS: [Motion; 5] = [
    Motion { name: "MH_03_medium", start_s: 18.0, tumvi: false },
    Motion { name: "V1_02_medium", start_s: 3.0, tumvi: false },
    Motion { name: "V2_01_easy", start_s: 3.0, tumvi: false },
    Motion { name: "tumvi_room1", start_s: 3.0, tumvi: true },
    Motion { name: "tumvi_room3", start_s: 3.0, tumvi: true },
];

/// Seconds of a motion whose readings are made worse.
const WORSE_S: f64 = 20.0;

/// Seconds between the key frames from whose true poses scale is found.
const STEP_S: f64 = 0.25;

/// What is made worse.
#[derive(Clone, Copy, Debug)]
pub struct Condition {
    /// Name of the row.
    pub name: &'static str,
    /// What goes wrong.
    pub troubles: ImuTroubles,
}

/// All conditions.
pub fn conditions() -> [Condition; 6] {
    let plain = ImuTroubles::default();
    [
        Condition { name: "as recorded", troubles: plain },
        Condition { name: "half the rate", troubles: ImuTroubles { mean_of: 2, ..plain } },
        Condition { name: "+20 ms", troubles: ImuTroubles { offset_s: 0.02, ..plain } },
        Condition { name: "-20 ms", troubles: ImuTroubles { offset_s: -0.02, ..plain } },
        Condition { name: "1 % lost", troubles: ImuTroubles { lost: 0.01, ..plain } },
        Condition { name: "bias steps", troubles: ImuTroubles { bias_steps_s: 10.0, ..plain } },
    ]
}

/// How well poses and readings of a recording agree, as rendered.
#[derive(Clone, Debug, Serialize)]
pub struct Checked {
    /// Recording.
    pub name: String,
    /// Milliseconds added to the poses' clock, degrees taken out of their axes.
    pub clock_ms: f64,
    /// Likewise.
    pub axes_deg: f64,
    /// Poses against the gyroscope over 50 ms, degrees: as measured, as rendered.
    pub turn_deg: [f64; 2],
    /// Against the accelerometer, m/s^2, likewise.
    pub acceleration: [f64; 2],
    /// How far smoothing moved poses, millimetres, and turned them, degrees: root mean square, most.
    pub moved_mm: [f64; 2],
    /// Likewise.
    pub turned_deg: [f64; 2],
    /// The longest hole in the poses, seconds.
    pub hole_s: f64,
    /// What the readings alone make of scale, the rendered poses standing in place of one eye: how far it is from 1, percent,
    /// and its standard deviation.
    pub exact_scale: [f64; 2],
}

impl Checked {
    fn of(name: &str, a: &Agreement, exact: [f64; 2]) -> Self {
        Self {
            name: name.into(),
            clock_ms: 1e3 * a.offset_s,
            axes_deg: a.misaligned_rad.to_degrees(),
            turn_deg: a.turn_rms.map(f64::to_degrees),
            acceleration: a.acceleration_rms,
            moved_mm: a.moved_m.map(|m| 1e3 * m),
            turned_deg: a.turned_rad.map(f64::to_degrees),
            hole_s: a.longest_hole_s,
            exact_scale: exact,
        }
    }
}

/// Scale by the readings alone, from key frames at the true poses of what `source` will show.
fn exact_scale(data: &Path, motion: &Motion, source: &SimSource, seconds: f64) -> Result<[f64; 2], String> {
    let readings = crate::inertial::data::Motion::read(data, motion.name)?;
    let stamps: Vec<Stamp> =
        (0..(seconds / STEP_S) as usize).map(|k| source.epoch().plus_seconds(STEP_S * k as f64)).collect();
    let pose = |t: &Stamp| source.motion().pose(*t - source.epoch());
    let poses: Vec<SeenPose> =
        stamps.iter().map(|t| SeenPose { stamp: *t, world_from_camera: pose(t) }).collect();
    let links = links(&readings.buffer(), Bias::default(), &stamps).ok_or("readings are missing")?;
    let seen = Seen { poses: &poses, rotation_sigma: 1e-3, position_sigma: 1e-3 };
    let tried = initialise(&seen, &links, &Se3::identity(), Scale::Free, &InitialiseConfig::default());
    let found = tried.found.ok_or("scale is not found from true poses")?;
    Ok([100.0 * (found.scale - 1.0).abs(), 100.0 * found.scale_sigma])
}

/// The setting of a recording: its sensor's data sheet, a camera where its own sat, a room around it.
pub fn config(data: &Path, motion: &Motion, sensor: Sensor, seconds: Option<f64>) -> SimConfig {
    let folder = data.join("imu-truth").join(motion.name);
    let noise = match motion.tumvi {
        true => ImuNoise { gyro: 1.6e-4, gyro_walk: 2.2e-5, accel: 2.8e-3, accel_walk: 8.6e-4 },
        false => ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 },
    };
    SimConfig {
        sensor: sensor.simulated(),
        imu: Some(ImuConfig { rate_hz: 200.0, noise, noisy: true }),
        readings: Some(folder.join("imu.csv")),
        body_from_camera: body_from_camera(motion.tumvi),
        baseline_m: 0.11,
        route: CameraPath::File(folder.join("gt_tum.txt")),
        start_s: motion.start_s,
        duration_s: seconds,
        ..SimConfig::new(WorldKind::Arena, 1)
    }
}

/// Where the left cameras of the two data sets sit on the sensor, as their calibrations have it.
fn body_from_camera(tumvi: bool) -> Se3 {
    let (q, p) = match tumvi {
        true => (
            [-0.010_805_45, -0.694_580_22, 0.719_183_69, 0.014_651_63],
            [0.045_365_84, -0.071_100_17, 0.044_668_06],
        ),
        false => {
            ([-0.007_707_18, 0.010_499_32, 0.701_752_8, 0.712_301_5], [-0.021_640_1, -0.064_677, 0.009_810_7])
        }
    };
    let turn = So3::from_xyzw(q[0], q[1], q[2], q[3]).unwrap_or(So3::identity());
    Se3::new(turn, Vec3::new(p[0], p[1], p[2]))
}

/// Runs one recording under the conditions whose name holds a part; progress on stderr.
///
/// # Errors
/// When a file is not what it should be, or a run fails.
pub fn measure(
    data: &Path,
    motion: &Motion,
    asked: &[Asked],
    condition: Option<&str>,
    seconds: Option<f64>,
) -> Result<(Checked, Vec<Figures>), String> {
    let mut world: Option<Arc<World>> = None;
    let mut checked = None;
    let mut rows = Vec::new();
    for condition in conditions().iter().filter(|c| condition.is_none_or(|part| c.name.contains(part))) {
        for asked in asked {
            let worse = condition.troubles != ImuTroubles::default();
            let seconds = seconds.or(worse.then_some(WORSE_S));
            let mut config = config(data, motion, asked.sensor, seconds);
            config.troubles = condition.troubles;
            let source = match &world {
                Some(world) => SimSource::in_map(&config, world.clone()),
                None => SimSource::new(&config),
            };
            let mut source = source.map_err(|e| e.to_string())?;
            world.get_or_insert_with(|| source.world().clone());
            if checked.is_none() {
                let span = source.motion().end() - 1.0;
                let exact = exact_scale(data, motion, &source, seconds.unwrap_or(span).min(span))?;
                checked = source.agreement().map(|a| Checked::of(motion.name, a, exact));
            }
            let ran = run(&mut source as &mut dyn Source, asked)?;
            let name = format!("{}, {}", motion.name, condition.name);
            let figures = ran.figures(&name, asked, condition.troubles.offset_s)?;
            eprint!("{}", super::ran::row(&figures));
            rows.push(figures);
        }
    }
    Ok((checked.ok_or("nothing was asked for")?, rows))
}
