//! Rooms rendered around real motions, with the real IMU data, as recorded and degraded.

use super::ran::{Figures, run};
use crate::MeasureError;
use crate::inertial::data::links;
use crate::{RunOptions, Sensors};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{Bias, InitialiseConfig, Scale, Seen, SeenPose, initialise};
use cairn_sensor::{ImuNoise, Source, Stamp};
use cairn_sim::{Agreement, CameraPath, ImuConfig, ImuTroubles, SimConfig, SimSource, World, WorldKind};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// A recording, the start of the stretch used (in motion), and its sensor.
pub struct MotionRecording {
    /// Folder below `imu-truth`.
    pub name: &'static str,
    /// Seconds after its first true pose.
    start_s: f64,
    tumvi: bool,
}

/// All recordings.
pub const MOTIONS: [MotionRecording; 5] = [
    MotionRecording { name: "MH_03_medium", start_s: 18.0, tumvi: false },
    MotionRecording { name: "V1_02_medium", start_s: 3.0, tumvi: false },
    MotionRecording { name: "V2_01_easy", start_s: 3.0, tumvi: false },
    MotionRecording { name: "tumvi_room1", start_s: 3.0, tumvi: true },
    MotionRecording { name: "tumvi_room3", start_s: 3.0, tumvi: true },
];

/// Seconds of a motion used with degraded IMU data.
const DEGRADED_S: f64 = 20.0;

/// Seconds between the key frames for scale from exact poses.
const STEP_S: f64 = 0.25;

/// How the IMU data are degraded.
#[derive(Clone, Copy, Debug)]
pub struct Condition {
    /// Name of the row.
    pub name: &'static str,
    /// The degradation.
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

/// Agreement of poses and IMU data of a recording, as rendered.
#[derive(Clone, Debug, Serialize)]
pub struct Checked {
    /// Recording.
    pub name: String,
    /// Correction of the poses' clock in milliseconds.
    pub clock_ms: f64,
    /// Correction of the poses' axes in degrees.
    pub axes_deg: f64,
    /// Difference of poses and gyroscope over 50 ms, degrees: as measured, as rendered.
    pub turn_deg: [f64; 2],
    /// Difference to the accelerometer, m/s^2: as measured, as rendered.
    pub acceleration: [f64; 2],
    /// How far smoothing moved the poses, millimetres: RMS, max.
    pub moved_mm: [f64; 2],
    /// How far smoothing rotated the poses, degrees: RMS, max.
    pub turned_deg: [f64; 2],
    /// The longest gap in the poses, seconds.
    pub hole_s: f64,
    /// Scale estimated from the IMU data and the exact rendered poses: deviation from 1, and standard deviation,
    /// percent.
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

/// Scale error from IMU data with key frames at the exact poses that `source` renders.
fn exact_scale(
    data: &Path,
    motion: &MotionRecording,
    source: &SimSource,
    seconds: f64,
) -> Result<[f64; 2], MeasureError> {
    let readings = crate::inertial::data::ImuRecording::read(data, motion.name)?;
    let stamps: Vec<Stamp> =
        (0..(seconds / STEP_S) as usize).map(|k| source.epoch().plus_seconds(STEP_S * k as f64)).collect();
    let pose = |t: &Stamp| source.motion().pose(*t - source.epoch());
    let poses: Vec<SeenPose> =
        stamps.iter().map(|t| SeenPose { stamp: *t, world_from_camera: pose(t) }).collect();
    let links = links(&readings.buffer(), Bias::default(), &stamps).ok_or("IMU samples are missing")?;
    let seen = Seen { poses: &poses, rotation_sigma: 1e-3, position_sigma: 1e-3 };
    let attempt = initialise(&seen, &links, &Se3::identity(), Scale::Free, &InitialiseConfig::default());
    let found = attempt.found.ok_or("initialisation with exact poses failed")?;
    Ok([100.0 * (found.scale - 1.0).abs(), 100.0 * found.scale_sigma])
}

/// Configuration for a recording: noise from the sensor's data sheet, a camera at the pose of the real one, a room
/// around it.
pub fn config(data: &Path, motion: &MotionRecording, sensor: Sensors, seconds: Option<f64>) -> SimConfig {
    let folder = data.join("imu-truth").join(motion.name);
    let noise = match motion.tumvi {
        true => ImuNoise { gyro: 1.6e-4, gyro_walk: 2.2e-5, accel: 2.8e-3, accel_walk: 8.6e-4 },
        false => ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 },
    };
    SimConfig {
        sensor: crate::run::simulated(sensor),
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

/// The extrinsics of the left cameras of the two data sets, from their calibrations.
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

/// Runs one recording under the conditions whose name contains `condition`; progress on stderr.
///
/// # Errors
/// When a file is invalid or a run fails.
pub fn measure(
    data: &Path,
    motion: &MotionRecording,
    options: &[RunOptions],
    condition: Option<&str>,
    seconds: Option<f64>,
) -> Result<(Checked, Vec<Figures>), MeasureError> {
    let mut world: Option<Arc<World>> = None;
    let mut checked = None;
    let mut rows = Vec::new();
    for condition in conditions().iter().filter(|c| condition.is_none_or(|part| c.name.contains(part))) {
        for options in options {
            let degraded = condition.troubles != ImuTroubles::default();
            let seconds = seconds.or(degraded.then_some(DEGRADED_S));
            let mut config = config(data, motion, options.sensor, seconds);
            config.troubles = condition.troubles;
            let source = match &world {
                Some(world) => SimSource::in_world(&config, world.clone()),
                None => SimSource::new(&config),
            };
            let mut source = source?;
            world.get_or_insert_with(|| source.world().clone());
            if checked.is_none() {
                let span = source.motion().end() - 1.0;
                let exact = exact_scale(data, motion, &source, seconds.unwrap_or(span).min(span))?;
                checked = source.agreement().map(|a| Checked::of(motion.name, a, exact));
            }
            let ran = run(&mut source as &mut dyn Source, options)?;
            let name = format!("{}, {}", motion.name, condition.name);
            let figures = ran.figures(&name, options, condition.troubles.offset_s)?;
            eprint!("{}", super::ran::row(&figures));
            rows.push(figures);
        }
    }
    Ok((checked.ok_or("no condition matches")?, rows))
}
