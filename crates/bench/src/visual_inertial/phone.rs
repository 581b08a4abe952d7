//! A walk out and home with one camera and the motion sensors of a phone, whose rig states more noise than they have;
//! in lockstep, and with seeded latencies of mapping and closing.

use super::carried::Carried;
use super::drawn::DrawnPhone;
use super::live_scale::LiveScale;
use super::ran::{Figures, run_in};
use crate::MeasureError;
use crate::RunOptions;
use cairn_engine::{Delays, Runner};
use cairn_geometry::Vec2;
use cairn_random::Random;
use cairn_sensor::{Camera, FramePacket, ImuNoise, ImuSample, Rig, Skips, Source, SourceError, SourceInfo};
use cairn_sim::{CameraPath, ImuConfig, PhoneTraits, SimConfig, SimSource, Walker, WorldKind};
use serde::Serialize;

/// The noise that the rig of a phone states (`cairn_sources`, phones and bags without a calibration).
pub const STATED: ImuNoise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
/// Readings a second.
const IMU_HZ: f64 = 60.0;
/// One frame in so many is dropped in a delayed run.
const DROPPED: usize = 8;

/// Result of one walk.
#[derive(Clone, Debug, Serialize)]
pub struct Walked {
    /// The figures of the run.
    pub figures: Figures,
    /// Seed of the world and of the sensors.
    pub seed: u64,
    /// Seed of the latencies; `None` in lockstep.
    pub delays: Option<u64>,
    /// RMSE of the live poses from the first metric one on, metres.
    pub live_ate_m: Option<f64>,
    /// The scale of the live poses while it was called metric.
    pub live: LiveScale,
    /// The longest stretch in which the motion sensors carried the pose.
    pub carried: Option<Carried>,
    /// What the accepted initialisation stated: the scale's standard deviation.
    pub first_sigma: Option<f64>,
}

/// How the sensors are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Noise {
    /// The readings have the noise of an ADIS16448, the rig states [`STATED`].
    Overstated,
    /// The readings have the noise that is stated.
    AsStated,
    /// All is drawn by the seed as in [`PhoneTraits`], with a global shutter: noise, biases, rounding, jitter, late stamps and a
    /// late start, 10 to 15 pictures a second.
    Drawn,
    /// The same with the rolling shutter, of which the engine knows nothing.
    DrawnRolling,
    /// The same; the engine is told the readout time.
    DrawnRollingTold,
    /// The same; the engine estimates the readout time.
    DrawnRollingEstimated,
}

/// Walks the demo's route for `metres`, turns on the spot and walks home.
///
/// # Errors
/// When the run fails.
pub fn walk(
    seed: u64,
    delays: Option<Delays>,
    noise: Noise,
    metres: f64,
    options: &RunOptions,
) -> Result<Walked, MeasureError> {
    let mut config = SimConfig::new(WorldKind::Demo, seed);
    config.sensor = crate::run::simulated(options.sensor);
    config.camera = Camera::pinhole(480, 360, 315.0, 315.0, 239.5, 179.5);
    config.walker = Walker { turn_rate: 0.8, ..Walker::default() };
    let mut imu = ImuConfig { rate_hz: IMU_HZ, ..ImuConfig::default() };
    if noise == Noise::AsStated {
        imu.noise = STATED;
    }
    config.imu = Some(imu);
    let plain = SimSource::new(&config)?;
    let route = plain.world().routes().first().ok_or("the world has no route")?.points.clone();
    let out = super::walked::cut(&route, metres);
    let home = out.iter().rev().skip(1).copied();
    let corners = out.iter().copied().chain(home).collect::<Vec<Vec2>>();
    let traits = PhoneTraits::new(seed, 640, 480);
    let mut options = options.clone();
    match noise {
        Noise::DrawnRollingTold => options.config.tracker.readout_s = traits.readout_s,
        Noise::DrawnRollingEstimated => options.config.tracker.estimate_readout = true,
        _ => {}
    }
    let options = &options;
    let drops = delays.map(|d| Random::new(d.seed ^ 0xD0));
    let inner: Box<dyn Source> = match noise {
        Noise::Overstated | Noise::AsStated => {
            config.route = CameraPath::Points(corners);
            let inner = SimSource::in_world(&config, plain.world().clone());
            Box::new(inner?)
        }
        _ => {
            let mut traits = traits;
            if noise == Noise::Drawn {
                traits.readout_s = 0.0;
            }
            Box::new(DrawnPhone::new(&config, plain.world(), config.walker.motion(&corners), &traits, 1)?)
        }
    };
    let mut rig = inner.rig().clone();
    if let Some(imu) = &mut rig.imu {
        imu.noise = STATED;
    }
    let mut source = Phone { inner, rig, drops, delivered: 0 };
    let runner = delays.map_or(Runner::Lockstep, Runner::Delayed);
    let ran = run_in(&mut source, options, runner)?;
    let name = match delays {
        Some(d) => format!("phone, seed {seed}, delays {}", d.seed),
        None => format!("phone, seed {seed}, lockstep"),
    };
    let name = match ran.readout_s {
        [_, sigma] if sigma > 0.0 => {
            let [found, sigma, truth] = [ran.readout_s[0], sigma, traits.readout_s].map(|s| 1e3 * s);
            format!("{name}, rows {found:.1} +- {sigma:.1} ms (true {truth:.1})")
        }
        _ => name,
    };
    let live = ran.live_scale();
    Ok(Walked {
        figures: ran.figures(&name, options, 0.0)?,
        seed,
        delays: delays.map(|d| d.seed),
        live_ate_m: ran.live_ate()?,
        live,
        carried: ran.carried(),
        first_sigma: ran.first_sigma,
    })
}

/// Header of the table of [`row`]s.
pub const HEAD: &str = "| run | ATE m (after Sim3) | live ATE m | scale error % | live scale error %: first (sigma) | after 30 s | worst (at s) | s more than 10 % off: told, told to be unknown | carried: s, error m (sigma), deg; before: m/s, tilt deg, after | first metric pose s | coverage | maps |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";

/// One row of the table.
pub fn row(w: &Walked) -> String {
    let or = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    let carried = w.carried.map_or("-".to_owned(), |c| {
        let Carried { seconds, error_m, sigma_m, error_deg, before_m_s, tilt_deg: [tilt, after], .. } = c;
        format!("{seconds:.1}, {error_m:.3} ({sigma_m:.3}), {error_deg:.2}; {before_m_s:.3}, {tilt:.2}, {after:.2}")
    });
    let f = &w.figures;
    format!(
        "| {} | {} ({}) | {} | {} | {} ({}) | {} | {:.1} ({:.1}) | {:.1}, {:.1} | {carried} | {} | {:.3} | {} |\n",
        f.name,
        or(f.ate_m, 3),
        or(f.ate_sim3_m, 3),
        or(w.live_ate_m, 3),
        or(f.scale_percent, 2),
        or(w.live.first_percent, 1),
        or(w.first_sigma.map(|s| 100.0 * s), 1),
        or(w.live.after_percent, 1),
        w.live.worst_percent,
        w.live.worst_at_s,
        w.live.wrong_s,
        w.live.unknown_s,
        or(f.metric_s, 1),
        f.coverage,
        f.worlds
    )
}

/// How many of the walks were good.
pub fn summary(walks: &[Walked]) -> String {
    let count = |is: &dyn Fn(&Walked) -> bool| walks.iter().filter(|w| is(w)).count();
    format!(
        "\nScale within 2 %: {} of {n}, after 30 s {} of {n}; first error within 3 sigma: {} of {n}; metric within 6 s: {} of {n}; never more than 10 % off for over 2 s: {} of {n}.\n",
        count(&|w| w.figures.scale_percent.is_some_and(|s| s <= 2.0)),
        count(&|w| w.live.after_percent.is_some_and(|s| s.abs() <= 2.0)),
        count(&|w| w.first_sigma.zip(w.live.first_percent).is_some_and(|(s, p)| p.abs() <= 300.0 * s)),
        count(&|w| w.figures.metric_s.is_some_and(|s| s <= 6.0)),
        count(&|w| w.live.wrong_s <= 2.0),
        n = walks.len()
    )
}

/// The simulated source with the rig of a phone; drops frames where it is loaded, as a player in real time does.
struct Phone {
    inner: Box<dyn Source>,
    rig: Rig,
    drops: Option<Random>,
    delivered: usize,
}

impl Source for Phone {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some(mut packet) = self.inner.next_packet()? else { return Ok(None) };
        self.delivered += 1;
        while self.delivered > 1 && self.drops.as_mut().is_some_and(|rng| rng.below(DROPPED) == 0) {
            let Some(mut next) = self.inner.next_packet()? else { break };
            let mut imu: Vec<ImuSample> = std::mem::take(&mut packet.imu);
            // Samples synthesised for the image that is left out are no longer needed.
            imu.retain(|sample| !sample.is_synthesised());
            imu.append(&mut next.imu);
            next.imu = imu;
            packet = next;
        }
        Ok(Some(packet))
    }

    fn skipped(&self) -> &[String] {
        self.inner.skipped()
    }

    fn skips(&self) -> Skips {
        self.inner.skips()
    }
}
