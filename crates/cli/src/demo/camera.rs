//! The camera of the demo: renders images from the walker's true pose and feeds them, and nothing else, to the session.
//!
//! In: the camera's true pose, frame by frame, and commands. Out: the announcements. The ground truth is stored only
//! for the figures.

use super::config::DemoConfig;
use crate::failure::Failure;
use cairn_atlas::Snapshot;
use cairn_dense::SubmapConfig;
use cairn_engine::{Config, DenseMapper, Engine, Output, Runner};
use cairn_eval::StageTimes;
use cairn_geometry::{Se3, Trajectory};
use cairn_guide::Durable;
use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_session::{Command, Disk, Event, Medium, Said, Session, SessionConfig};
use cairn_sim::{LiveRig, SmoothRig, Thing};
use cairn_sources::std_host;
use std::io;
use std::path::Path;
use std::time::Instant;

/// A rendered rig, a session, and the measurements taken during the run.
pub struct DemoCamera {
    rendered: Rendered,
    session: Session,
    /// Surfaces, where they are wanted.
    pub dense: Option<DenseMapper>,
    /// True poses of the camera, one for each frame.
    pub truth: Trajectory,
    /// Milliseconds of each frame: "render", "extract" (feature extraction), "track", "step" (image to pose), and "map"
    /// (for each key frame).
    pub times: StageTimes,
    /// Milliseconds from image to pose of each frame.
    pub step_ms: Vec<f64>,
    /// Stretches without a pose after the first pose: start time in seconds, and number of frames.
    pub lost: Vec<(f64, usize)>,
    /// Whether the last frame had a pose; `None` before the first pose.
    tracked: Option<bool>,
}

/// The rig that is rendered: with an IMU its motion is a spline, and packets come two frames later.
enum Rendered {
    Camera(Box<LiveRig>),
    WithImu(Box<SmoothRig>),
}

impl Rendered {
    fn rig(&self) -> &Rig {
        match self {
            Self::Camera(live) => live.rig(),
            Self::WithImu(smooth) => smooth.rig(),
        }
    }

    fn put(&mut self, things: Vec<Thing>) {
        match self {
            Self::Camera(live) => live.put(things),
            Self::WithImu(smooth) => smooth.put(things),
        }
    }

    /// The next packet, with the body's true pose at its stamp.
    fn packet(&mut self, stamp: Stamp, pose: &Se3) -> Result<Option<(FramePacket, Se3)>, Failure> {
        Ok(match self {
            Self::Camera(live) => Some((live.packet(stamp, pose)?, *pose)),
            Self::WithImu(smooth) => smooth.packet(pose)?,
        })
    }
}

impl DemoCamera {
    /// Starts a session in a simulated world, with the sensors of the configuration.
    pub fn new(config: &DemoConfig) -> Result<Self, Failure> {
        let rig_failure = |e: String| Failure::new("the rig of the demo", e, "choose another --sensor");
        let sim = &config.sim;
        let rendered = match sim.imu {
            None => Rendered::Camera(Box::new(LiveRig::new(sim)?)),
            Some(_) => Rendered::WithImu(Box::new(SmoothRig::new(sim)?)),
        };
        let mode = config.sensor.mode();
        let mut settings = Config::default();
        settings.inertial.enabled = config.sensor.has_imu();
        let mut engine =
            Engine::new(rendered.rig(), mode, sim.rate_hz, Runner::Lockstep, &settings, &std_host())
                .map_err(|e| rig_failure(e.to_string()))?;
        let dense =
            config.dense.then(|| DenseMapper::new(&mut engine, rendered.rig(), SubmapConfig::default()));
        let dense = dense.transpose().map_err(|e| rig_failure(e.to_string()))?;
        let walk = SessionConfig {
            source: config.source(),
            record_to: Some("route".into()),
            phrases: config.speaking.phrases(),
            announcer: config.speaking.announcer(),
            ..SessionConfig::default()
        };
        let mut session = Session::new(engine, walk).on_disk(Box::new(NullDisk));
        if config.obstacles > 0 {
            session.watch_way(rendered.rig()).map_err(|e| rig_failure(e.to_string()))?;
        }
        Ok(Self {
            rendered,
            session,
            dense,
            truth: Trajectory::new(),
            times: StageTimes::new(),
            step_ms: Vec::new(),
            lost: Vec::new(),
            tracked: None,
        })
    }

    /// Renders and processes one frame; returns the announcements that start now, in order.
    pub fn see(&mut self, stamp: Stamp, world_from_camera: &Se3) -> Result<Vec<Said>, Failure> {
        let begin = Instant::now();
        let Some((packet, truth)) = self.rendered.packet(stamp, world_from_camera)? else {
            return Ok(Vec::new());
        };
        self.times.add("render", begin.elapsed());
        self.truth.push(packet.stamp.0, truth).map_err(|e| bug(e.to_string()))?;
        let output = self.session.on_packet(&packet).map_err(|why| bug(why.to_string()))?;
        if let Some(why) = output.stage_failed() {
            return Err(bug(format!("mapping has stopped: {why}")));
        }
        if let Some(dense) = &mut self.dense {
            dense.on_packet(&packet, &output);
        }
        self.note(&output);
        Ok(self.said())
    }

    /// Puts things into the world, in place of those put in before.
    pub fn put(&mut self, things: Vec<Thing>) {
        self.rendered.put(things);
    }

    /// Gives a command; returns the announcements that start now.
    pub fn ask(&mut self, command: &Command) -> Result<Vec<Said>, Failure> {
        self.session.command(command).map_err(|why| bug(why.words))?;
        Ok(self.said())
    }

    fn said(&mut self) -> Vec<Said> {
        let announcement = |event| match event {
            Event::Said(said) => Some(said),
            Event::Sound(_) => None,
        };
        self.session.events().into_iter().filter_map(announcement).collect()
    }

    /// The session.
    pub fn session(&self) -> &Session {
        &self.session
    }

    fn note(&mut self, output: &Output) {
        let timings = &output.timings;
        self.times.add_ms("extract", timings.extract_ms);
        self.times.add_ms("track", timings.track_ms);
        self.times.add_ms("step", timings.step_ms());
        if let Some(ms) = self.session.obstacles_ms() {
            self.times.add_ms("way ahead", ms);
        }
        self.step_ms.push(timings.step_ms());
        for ms in &timings.map_ms {
            self.times.add_ms("map", *ms);
        }
        let tracked = output.pose.is_some();
        match (self.tracked, tracked) {
            (Some(true), false) => self.lost.push((output.stamp.seconds(), 1)),
            (Some(false), false) => self.lost.iter_mut().last().into_iter().for_each(|l| l.1 += 1),
            _ => {}
        }
        if tracked || self.tracked.is_some() {
            self.tracked = Some(tracked);
        }
    }

    /// The simulated world.
    pub fn world(&self) -> &cairn_sim::World {
        match &self.rendered {
            Rendered::Camera(live) => live.world(),
            Rendered::WithImu(smooth) => smooth.world(),
        }
    }

    /// A snapshot of the engine's map.
    pub fn snapshot(&self) -> std::sync::Arc<Snapshot> {
        self.session.engine().snapshot()
    }

    /// Poses of the camera for every tracked frame, with all corrections of the map so far.
    pub fn estimate(&mut self) -> Result<Trajectory, Failure> {
        for ms in self.session.engine_mut().finish().timings.map_ms {
            self.times.add_ms("map", ms);
        }
        let poses = self.session.engine().trajectory().into_iter().map(|(t, p)| (t.0, p)).collect();
        Trajectory::from_unsorted(poses)
            .map_err(|e| Failure::new("the demo", e.to_string(), "report this with the command line"))
    }
}

fn bug(why: String) -> Failure {
    Failure::new("the demo", why, "report this with the command line")
}

/// A disk that stores nothing: the route stays in memory, the report writes it at the end of the demo.
struct NullDisk;

impl Disk for NullDisk {
    fn create(&self, _: &Path) -> io::Result<Box<dyn Medium>> {
        Ok(Box::new(NullDisk))
    }

    fn replace(&self, _: &Path, _: &[u8]) -> io::Result<()> {
        Ok(())
    }
}

impl Medium for NullDisk {
    fn cut(&mut self, _: u64) -> io::Result<()> {
        Ok(())
    }
}

impl io::Write for NullDisk {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        Ok(data.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Durable for NullDisk {
    fn make_durable(&mut self) -> io::Result<()> {
        Ok(())
    }
}
