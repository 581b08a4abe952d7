//! The images of a walk, and a session that passes them and keeps what was said.

use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, FramePacket, Stamp};
use cairn_session::{Command, Event, Session, SessionConfig};
use cairn_sim::{LiveRig, SimConfig, SimSensor, Walker, WorldKind};
use std::path::PathBuf;
use std::sync::OnceLock;

pub const RATE_HZ: f64 = 10.0;

/// Images of a walk of eight metres with a turn, ten a second.
pub fn out() -> &'static [FramePacket] {
    static OUT: OnceLock<Vec<FramePacket>> = OnceLock::new();
    OUT.get_or_init(|| {
        let config = SimConfig {
            sensor: SimSensor::Rgbd,
            imu: None,
            camera: Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5),
            rate_hz: RATE_HZ,
            body_from_camera: Se3::identity(),
            walker: Walker { turn_rate: 0.8, ..Walker::default() },
            ..SimConfig::new(WorldKind::Demo, 3)
        };
        let mut rig = LiveRig::new(&config).unwrap();
        let route = rig.world().routes()[0].points.clone();
        let motion = config.walker.motion(&route);
        let frames = (motion.end().min(16.0) * RATE_HZ) as usize;
        (0..frames)
            .map(|k| {
                let t = k as f64 / RATE_HZ;
                rig.packet(Stamp::from_seconds(t), &motion.pose(t)).unwrap()
            })
            .collect()
    })
}

pub fn engine() -> Engine {
    let camera = Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5);
    let config =
        SimConfig { sensor: SimSensor::Rgbd, imu: None, camera, ..SimConfig::new(WorldKind::Demo, 3) };
    Engine::new(&config.rig(), SensorMode::Rgbd, RATE_HZ, Runner::Lockstep, &Config::default(), &Host::bare())
        .unwrap()
}

pub fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("cairn-session-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

/// A session with a clock, and its utterances with their times.
pub struct Walk {
    pub session: Session,
    pub now: f64,
    pub said: Vec<(f64, String)>,
    pub sounds: usize,
}

impl Walk {
    pub fn new(session: Session) -> Self {
        Self { session, now: 0.0, said: Vec::new(), sounds: 0 }
    }

    pub fn named(name: &str) -> Self {
        let config = SessionConfig { folder: folder(name), ..SessionConfig::default() };
        Self::new(Session::new(engine(), config))
    }

    pub fn hear(&mut self) {
        for event in self.session.events() {
            match event {
                Event::Said(said) => self.said.push((said.stamp.seconds(), said.text)),
                Event::Sound(_) => self.sounds += 1,
            }
        }
    }

    /// Passes images, one every tenth of a second.
    pub fn see<'a>(&mut self, pictures: impl IntoIterator<Item = &'a FramePacket>) {
        for picture in pictures {
            self.now += 1.0 / RATE_HZ;
            let packet = FramePacket { stamp: Stamp::from_seconds(self.now), ..picture.clone() };
            self.session.on_packet(&packet).unwrap();
            self.hear();
        }
    }

    /// Time passes without an image.
    pub fn wait(&mut self, seconds: f64) {
        let until = self.now + seconds;
        while self.now < until {
            self.now += 0.05;
            self.session.tick(Stamp::from_seconds(self.now));
            self.hear();
        }
    }

    pub fn ask(&mut self, line: &str) -> Result<String, String> {
        let done = self.session.command(&Command::parse(line).unwrap());
        self.hear();
        done.map_err(|why| why.words)
    }

    /// When an utterance with this beginning was first given after a time.
    pub fn when(&self, begins: &str, after: f64) -> Option<f64> {
        self.said.iter().find(|(t, words)| *t >= after && words.starts_with(begins)).map(|(t, _)| *t)
    }

    pub fn transcript(&self) -> String {
        self.said.iter().map(|(t, words)| format!("{t:6.1}  {words}\n")).collect()
    }
}
