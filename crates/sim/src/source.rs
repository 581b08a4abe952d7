//! A simulated recording as a [`Source`]: a rig carried along a motion, with exact ground truth.

use crate::config::{CameraPath, SimConfig};
use crate::imu_feed::{ImuFeed, Readings};
use crate::live::LiveRig;
use crate::walk::{Agreement, ContinuousTrajectory, ImuSim, Recorded, Troubled, read_readings, read_tum};
use crate::world::{NamedRoute, World, WorldKind};
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{FramePacket, ImuSample, Rig, Source, SourceError, SourceInfo, Stamp};
use std::sync::Arc;

/// Packets of a rig that moves through a world.
pub struct SimSource {
    live: LiveRig,
    rig: Rig,
    info: SourceInfo,
    motion: ContinuousTrajectory,
    imu_feed: Option<ImuFeed>,
    agreement: Option<Agreement>,
    epoch: Stamp,
    next: usize,
}

/// The stamp at which walks start; recorded trajectories keep their own stamps.
const EPOCH: Stamp = Stamp(1_000_000_000);

/// More than a day at 100 Hz.
const MOST_FRAMES: f64 = 1e7;

impl SimSource {
    /// Builds the world and the motion.
    ///
    /// # Errors
    /// When the config cannot be simulated, the route is unknown, or the trajectory cannot be read.
    pub fn new(config: &SimConfig) -> Result<Self, SourceError> {
        let config = fitted(config)?;
        Self::on(&config, LiveRig::new(&config)?)
    }

    /// In an existing world (worlds take long to build).
    ///
    /// # Errors
    /// As [`SimSource::new`].
    pub fn in_world(config: &SimConfig, world: Arc<World>) -> Result<Self, SourceError> {
        Self::on(config, LiveRig::in_world(config, world)?)
    }

    /// From `sim:WORLD?key=value`; see [`SimConfig::parse`].
    ///
    /// # Errors
    /// As [`SimSource::new`] and [`SimConfig::parse`].
    pub fn open(text: &str) -> Result<Self, SourceError> {
        Self::new(&SimConfig::parse(text)?)
    }

    fn on(config: &SimConfig, live: LiveRig) -> Result<Self, SourceError> {
        let name = format!("sim:{} seed {}", config.world, config.seed);
        let Path { motion, epoch, readings, agreement } = path(config, live.world())?;
        let start = config.start_s;
        let length = (motion.end() - start).min(config.duration_s.unwrap_or(f64::MAX));
        if length < 0.0 {
            let why = format!("start {start} s is past the end of the motion at {:.1} s", motion.end());
            return Err(SourceError::new(name, why, "choose an earlier start"));
        }
        if length * config.rate_hz > MOST_FRAMES {
            let why = format!("{length:.0} s at {} Hz are more than {MOST_FRAMES} frames", config.rate_hz);
            return Err(SourceError::new(name, why, "give a duration"));
        }
        let frames = (length * config.rate_hz + 1e-6).floor() as usize + 1;
        // Shifted so that the first frame is the motion's time `start`.
        let epoch = Stamp(epoch.0 + (start * 1e9).round() as i64);
        let motion = motion.shifted(-start);
        let truth = (0..frames)
            .map(|i| {
                let t = time(i, config.rate_hz);
                (Stamp(epoch.0 + t), motion.pose(t as f64 * 1e-9))
            })
            .collect();
        let info = SourceInfo { name, frames: Some(frames), rate_hz: config.rate_hz, truth, assumed: None };
        let rig = config.rig();
        let imu_feed = rig.imu.as_ref().zip(config.imu).map(|(sensor, imu)| {
            let readings = match readings {
                Some(list) => Readings::Recorded(list.into_iter()),
                None => Readings::Simulated(Box::new(ImuSim::new(imu, config.seed))),
            };
            ImuFeed::new(readings, Troubled::new(config.troubles, config.seed), sensor.rate_hz)
        });
        Ok(Self { live, rig, info, motion, imu_feed, agreement, epoch, next: 0 })
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        self.live.world()
    }

    /// How well recorded poses and recorded readings agree, where the motion comes from both.
    pub fn agreement(&self) -> Option<&Agreement> {
        self.agreement.as_ref()
    }

    /// The stamp of time 0 of [`SimSource::motion`].
    pub fn epoch(&self) -> Stamp {
        self.epoch
    }

    /// The motion of the body; its time 0 is the first frame.
    pub fn motion(&self) -> &ContinuousTrajectory {
        &self.motion
    }
}

/// Nanoseconds from the first frame to a later one.
fn time(i: usize, rate_hz: f64) -> i64 {
    (i as f64 * 1e9 / rate_hz).round() as i64
}

/// Metres from a recorded motion to the walls of the room built around it.
const AROUND_M: f64 = 2.5;
/// Metres from the lowest point of a recorded motion down to the floor, and from the highest up to the ceiling.
const BELOW_M: f64 = 0.7;
const ABOVE_M: f64 = 1.8;

/// The motion of the body and its IMU readings.
struct Path {
    motion: ContinuousTrajectory,
    /// The stamp of the motion's time 0.
    epoch: Stamp,
    readings: Option<Vec<ImuSample>>,
    agreement: Option<Agreement>,
}

impl Path {
    fn plain(motion: ContinuousTrajectory, epoch: Stamp) -> Self {
        Self { motion, epoch, readings: None, agreement: None }
    }
}

/// Gives an arena without a size that of the motion.
fn fitted(config: &SimConfig) -> Result<SimConfig, SourceError> {
    let mut config = config.clone();
    if let (WorldKind::Arena, None, CameraPath::File(path)) =
        (config.world, config.options.size_m, &config.route)
    {
        let [low, high] = extent(&read_tum(path)?);
        let size = high - low;
        let size = [size.x + 2.0 * AROUND_M, size.y + 2.0 * AROUND_M, size.z + BELOW_M + ABOVE_M];
        if size.iter().any(|s| *s > 100.0) {
            let why = format!("extends over {:.0} x {:.0} x {:.0} m", size[0], size[1], size[2]);
            return Err(SourceError::new(
                path.display().to_string(),
                why,
                "cut out a part that fits a room of 100 m",
            ));
        }
        config.options.size_m = Some([size[0], size[1], size[2].max(2.6)]);
    }
    Ok(config)
}

/// The corners of the bounding box of poses.
fn extent(poses: &[(Stamp, Se3)]) -> [Vec3; 2] {
    let fold = |f: fn(f64, f64) -> f64, from: f64| {
        let all = |v: Vec3, p: &(Stamp, Se3)| v.zip_map(&p.1.translation, f);
        poses.iter().fold(Vec3::repeat(from), all)
    };
    [fold(f64::min, f64::MAX), fold(f64::max, f64::MIN)]
}

/// A route walked several times over.
fn laps(route: &[Vec2], laps: usize, what: &str) -> Result<Vec<Vec2>, SourceError> {
    if laps > 1 && route.first() != route.last() {
        let why = format!("{laps} laps of a route that does not end where it begins");
        return Err(SourceError::new(what, why, "choose another route, or one lap"));
    }
    let again = route.get(1..).unwrap_or_default();
    Ok(route.iter().chain((1..laps).flat_map(|_| again)).copied().collect())
}

/// The path that a config asks for.
fn path(config: &SimConfig, world: &World) -> Result<Path, SourceError> {
    let what = format!("sim:{}", config.world);
    match &config.route {
        CameraPath::Route(name) => {
            let route = match name {
                Some(n) => world.route(n),
                None => world.routes().first(),
            };
            let route = route.ok_or_else(|| {
                let known: Vec<&str> = world.routes().iter().map(|w| w.name.as_str()).collect();
                let why = format!("there is no route \"{}\"", name.as_deref().unwrap_or(""));
                SourceError::new(&what, why, format!("choose one of {}", known.join(", ")))
            })?;
            let points = laps(&route.points, config.laps, &what)?;
            Ok(Path::plain(config.walker.motion(&points), EPOCH))
        }
        CameraPath::Points(points) => {
            if points.is_empty() || !points.iter().all(|p| p.x.abs() < 1e5 && p.y.abs() < 1e5) {
                return Err(SourceError::new(
                    what,
                    "the route has no points or a point farther than 100 km",
                    "give corners in metres",
                ));
            }
            Ok(Path::plain(config.walker.motion(points), EPOCH))
        }
        CameraPath::Poses(poses) => {
            Ok(Path::plain(ContinuousTrajectory::through(poses)?, poses.first().map_or(EPOCH, |p| p.0)))
        }
        CameraPath::File(file) => {
            let mut poses = read_tum(file)?;
            let place = middle_of(world.routes().first());
            let to = match config.world {
                WorldKind::Arena => {
                    let [low, high] = extent(&poses);
                    Vec3::new(place.x, place.y, BELOW_M)
                        - Vec3::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y), low.z)
                }
                _ => place - poses.iter().map(|p| p.1.translation).sum::<Vec3>() / poses.len() as f64,
            };
            poses.iter_mut().for_each(|(_, pose)| *pose = Se3::new(pose.rotation, pose.translation + to));
            let Some(readings) = config.readings.as_ref().filter(|_| config.imu.is_some()) else {
                return Ok(Path::plain(ContinuousTrajectory::through(&poses)?, poses[0].0));
            };
            let readings = read_readings(readings)?;
            let Recorded { motion, epoch, agreement } = Recorded::new(&poses, &readings)?;
            Ok(Path { motion, epoch, readings: Some(readings), agreement: Some(agreement) })
        }
    }
}

/// The middle of a route's bounding box, at 1.4 m.
fn middle_of(route: Option<&NamedRoute>) -> Vec3 {
    let Some(route) = route else { return Vec3::new(0.0, 0.0, 1.4) };
    let fold = |f: &dyn Fn(&Vec2) -> f64| {
        let low = route.points.iter().map(f).fold(f64::MAX, f64::min);
        let high = route.points.iter().map(f).fold(f64::MIN, f64::max);
        0.5 * (low + high)
    };
    Vec3::new(fold(&|p| p.x), fold(&|p| p.y), 1.4)
}

impl Source for SimSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some((stamp, _)) = self.info.truth.get(self.next) else { return Ok(None) };
        let (stamp, nanos) = (*stamp, time(self.next, self.info.rate_hz));
        let seconds = nanos as f64 * 1e-9;
        self.next += 1;
        let motion = &self.motion;
        let mut packet = self.live.packet_along(stamp, &|dt| motion.pose(seconds + dt));
        if let Some(imu_feed) = &mut self.imu_feed {
            packet.imu = imu_feed.until(motion, self.epoch, stamp);
        }
        Ok(Some(packet))
    }

    fn skipped(&self) -> &[String] {
        &[]
    }
}
