//! What processes say to each other: small messages in pipes, in order.
//!
//! Every worker reads orders ([`Order`]) from its standard input and writes reports ([`Report`]) to its standard output; the
//! supervisor is at the other end of both. Images never pass here, only the number of their frame in the ring
//! ([`crate::ring`]). A message is its length, a checksum and its form in postcard. A pipe neither loses nor reorders; what
//! a worker had not acknowledged when it died is sent again to its successor by the supervisor.

pub use crate::anchored::Anchored;
use crate::anchored::{numbers, se3};
use crate::seen::Seen;
use crate::shown::Shown;
use crate::speech::Speech;
use cairn_engine::{Config, FlowClocks};
use cairn_geometry::{Pose, Se3, Sim3, Similarity, Vec3};
use cairn_guide::{Anchor, Confidence};
use cairn_sensor::{ImuSample, SkipCount, SkipKind, Skips, Stamp};
use cairn_session::{NotSaved, TrackedPlace};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::{self, Read, Write};
use std::path::PathBuf;

/// No message is longer: the IMU readings of a frame after a long gap.
const LONGEST: usize = 16 << 20;

/// All that a session's engine starts with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SlamSetup {
    /// What a file can set.
    config: Config,
    /// `clocks` of the tracker, which no file has.
    clocks: Option<FlowClocks>,
}

impl SlamSetup {
    /// Of this configuration.
    pub fn new(config: Config) -> Self {
        Self { clocks: config.tracker.clocks, config }
    }

    /// The configuration, with all that is known.
    pub fn into_config(mut self) -> Config {
        self.config.tracker.clocks = self.clocks;
        self.config
    }
}

/// To a worker.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Order {
    /// To capture, first.
    Capture {
        /// The ring to make, or to go on with.
        ring: PathBuf,
        /// The number of the next frame.
        next: u64,
        /// The stamps (ns) of the first and the last frame that a process before this one delivered.
        delivered: Option<(i64, i64)>,
        /// The first frame number that may not be written yet.
        until: u64,
    },
    /// To capture: frames below this number may be written.
    Credit(u64),
    /// To SLAM and dense, first.
    Map {
        /// The ring of frames.
        ring: PathBuf,
        /// The folder of the map's journal, and of the rig.
        folder: PathBuf,
        /// What was opened.
        opened: Opened,
        /// The number of this process among all of the run: odometry of another one is in another frame.
        start: u64,
        /// What surfaces need of key frames; `None` where there are none.
        surfaces: Option<SurfaceInput>,
        /// For a session that is in another process: the engine's configuration. Every frame is then told with all that
        /// a session needs (`Seen`).
        session: Option<Box<SlamSetup>>,
    },
    /// To the guide, first.
    Guide {
        /// The folder of the map's journal.
        folder: PathBuf,
        /// The stamp of the first frame of the run (ns), where there was one.
        began: Option<i64>,
        /// It takes the place of one that died: a recording goes on in its file.
        again: bool,
    },
    /// To the guide: SLAM has done a frame.
    Tracked(Box<Tracked>),
    /// To the guide that records: SLAM has done this frame before; nothing is to be said of it.
    Missed(Box<Tracked>),
    /// To the guide: whether poses come, or what makes them is late or dead.
    PosesCome(bool),
    /// A frame lies in the ring.
    Frame(Frame),
    /// Answer, and write what is due.
    Ping,
    /// To dense: tell what has changed of the surfaces, if it is time.
    Show {
        /// The columns too.
        columns: bool,
    },
    /// There are no more frames.
    End,
}

/// What surfaces need of key frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SurfaceInput {
    /// Their depth.
    Depth,
    /// Their depth and what its pixels look like.
    DepthAndGray,
}

/// From a worker.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Report {
    /// Capture has opened the source.
    Opened(Opened),
    /// Capture: a frame lies in the ring.
    Frame(Frame),
    /// Capture: what this process has left out until now; before the frame that follows it.
    LeftOut(LeftOut),
    /// Capture: the source has ended.
    SourceEnded,
    /// SLAM or dense has begun, in a map of so many key frames.
    Ready {
        /// Key frames of the map it goes on with; of dense, those whose depth it has.
        key_frames: usize,
        /// The version of that map.
        version: u64,
    },
    /// SLAM: a frame is done.
    Tracked(Box<Tracked>),
    /// Dense: it has followed all that was written.
    Followed,
    /// Dense: what has changed of the surfaces, for pages.
    Shown(Shown),
    /// SLAM: why the depth of key frames is written no longer; the map goes on without surfaces.
    NoSurfaces(Failure),
    /// SLAM: the pose of an earlier frame is known by now.
    Amended {
        /// Its number.
        number: u64,
        /// Its pose.
        pose: Anchored,
    },
    /// Guide: something is to be heard now.
    Said(Speech),
    /// Guide: the time of the last point of its recording (ns), where there is one; it waits for the frames since.
    RecordedUntil(Option<i64>),
    /// Guide: the recording has ended, or why its file does not hold all of it.
    Recorded(Result<usize, NotSaved>),
    /// The answer to a ping.
    Pong,
    /// All is done and written.
    Finished(Finished),
    /// The worker cannot go on: what, why and what to do. Starting it again would not help.
    Failed(Failure),
}

/// What capture has left out.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Frames that were overtaken before they could be delivered, in real time.
    pub dropped: usize,
    /// What the source left out.
    pub skips: Vec<Skip>,
}

/// How much a source left out for one reason, as [`cairn_sensor::SkipCount`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skip {
    /// What.
    #[serde(with = "Kind")]
    pub kind: SkipKind,
    /// Why.
    pub reason: String,
    /// How many.
    pub count: usize,
    /// The first of them, for people.
    pub first: String,
}

/// The form of [`SkipKind`] in a message.
#[derive(Serialize, Deserialize)]
#[serde(remote = "SkipKind")]
enum Kind {
    Frame,
    Repeat,
    Depth,
    Imu,
    Line,
    Other,
}

impl LeftOut {
    /// What a source has skipped, and how many frames were overtaken.
    pub fn of(skips: &Skips, dropped: usize) -> Self {
        let skip = |s: &SkipCount| Skip {
            kind: s.kind,
            reason: s.reason.clone(),
            count: s.count,
            first: s.first.clone(),
        };
        Self { dropped, skips: skips.iter().map(skip).collect() }
    }

    /// What the source has skipped.
    pub fn skips(&self) -> Skips {
        let mut skips = Skips::default();
        self.skips.iter().for_each(|s| skips.add_many(s.kind, &s.reason, s.count, &s.first));
        skips
    }

    /// With what another process has left out.
    pub fn and(&self, other: &Self) -> Self {
        let mut skips = self.skips();
        skips.add_all(&other.skips());
        Self::of(&skips, self.dropped + other.dropped)
    }
}

/// Why a worker cannot go on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[error("{what}: {why}; {cure}")]
pub struct Failure {
    /// File, folder or stream.
    pub what: String,
    /// What is wrong.
    pub why: String,
    /// What the user can do.
    pub cure: String,
}

impl Failure {
    /// From the three parts of a good message.
    pub fn new(what: impl Into<String>, why: impl ToString, cure: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.to_string(), cure: cure.into() }
    }
}

impl From<cairn_sensor::SourceError> for Failure {
    fn from(e: cairn_sensor::SourceError) -> Self {
        Self { what: e.what, why: e.why, cure: e.cure }
    }
}

/// What is known of the source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Opened {
    /// Kind and location.
    pub name: String,
    /// Number of packets, if known.
    pub frames: Option<usize>,
    /// Nominal rate, Hz.
    pub rate_hz: f64,
    /// The rig in Cairn's own format.
    pub rig: String,
    /// Which sensors are used, as on the command line (`stereo-imu`).
    pub sensor: String,
}

/// A frame in the ring.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Its number: the generation of its slot.
    pub number: u64,
    /// Time of exposure, ns.
    pub stamp: i64,
    /// Its IMU samples: stamp (ns), angular rate, specific force, factor on the noise.
    pub imu: Vec<(i64, [f64; 3], [f64; 3], f64)>,
    /// Milliseconds that reading and decoding took.
    pub decode_ms: f64,
}

/// A frame that SLAM has done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracked {
    /// Its number.
    pub number: u64,
    /// Its stamp, ns.
    pub stamp: i64,
    /// What became of it.
    pub outcome: Outcome,
    /// The pose, when it is known.
    pub pose: Option<Anchored>,
    /// Whether lengths are metres.
    pub metric: bool,
    /// From image to pose, ms.
    pub ms: f64,
    /// The pose as the guide needs it, when it is known.
    pub place: Option<Place>,
    /// All that a session needs, where SLAM works for one.
    pub seen: Option<Box<Seen>>,
}

/// A pose for the guide; the fields are those of `cairn_session::TrackedPlace`, poses as in [`Anchored`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Place {
    world_from_camera: [f64; 7],
    odom_from_camera: [f64; 7],
    world_from_odom: ([f64; 7], f64),
    segment: u32,
    anchor: Anchor,
    anchor_from_camera: [f64; 7],
    /// Good 0, low 1, lost 2.
    confidence: u8,
    quality: f32,
}

/// What became of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Outcome {
    /// It was tracked, or not; in words.
    State(String),
    /// Its images do not fit the rig; why.
    Refused(String),
    /// The ring no longer has it: it came too late.
    Overtaken,
    /// The ring has other bytes than were written.
    Torn,
}

/// The end of SLAM.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finished {
    /// Loops closed by this process.
    pub loops: usize,
    /// Maps merged by this process.
    pub merges: usize,
}

impl Frame {
    /// The number, stamp and IMU samples of a packet.
    pub fn of(number: u64, packet: &cairn_sensor::FramePacket) -> Self {
        let sample = |s: &ImuSample| (s.stamp.0, s.gyro.into(), s.accel.into(), s.noise_scale);
        Self {
            number,
            stamp: packet.stamp.0,
            imu: packet.imu.iter().map(sample).collect(),
            decode_ms: packet.decode_ms,
        }
    }

    /// The IMU samples.
    pub fn imu_samples(&self) -> Vec<ImuSample> {
        let sample = |(stamp, gyro, accel, noise_scale): &(i64, [f64; 3], [f64; 3], f64)| ImuSample {
            stamp: Stamp(*stamp),
            gyro: Vec3::from(*gyro),
            accel: Vec3::from(*accel),
            noise_scale: *noise_scale,
        };
        self.imu.iter().map(sample).collect()
    }
}

/// In order of the numbers of [`Place::confidence`].
const CONFIDENCES: [Confidence; 3] = [Confidence::Good, Confidence::Low, Confidence::Lost];

impl Place {
    /// Of a frame that SLAM's process number `start` has tracked: its odometry is a segment of its own.
    pub fn of(place: &TrackedPlace, start: u64) -> Self {
        let s = &place.world_from_odom.sim3;
        let confidence = CONFIDENCES.iter().position(|c| *c == place.confidence);
        Self {
            world_from_camera: numbers(&place.world_from_camera.se3),
            odom_from_camera: numbers(&place.odom_from_camera.se3),
            world_from_odom: (numbers(&Se3::new(s.rotation, s.translation)), s.scale),
            segment: (start as u32) << 16 | place.segment & 0xffff,
            anchor: place.anchor,
            anchor_from_camera: numbers(&place.anchor_from_camera),
            confidence: confidence.unwrap_or(2) as u8,
            quality: place.quality,
        }
    }

    /// Back; `None` when a pose is none.
    pub fn to_tracked(&self, stamp: Stamp, metric: bool) -> Option<TrackedPlace> {
        let (rigid, scale) = (se3(&self.world_from_odom.0)?, self.world_from_odom.1);
        Some(TrackedPlace {
            stamp,
            world_from_camera: Pose::new(se3(&self.world_from_camera)?),
            odom_from_camera: Pose::new(se3(&self.odom_from_camera)?),
            world_from_odom: Similarity::new(Sim3::new(rigid.rotation, rigid.translation, scale)),
            segment: self.segment,
            anchor: self.anchor,
            anchor_from_camera: se3(&self.anchor_from_camera)?,
            confidence: *CONFIDENCES.get(usize::from(self.confidence))?,
            quality: self.quality,
            metric,
        })
    }
}

/// Writes a message and flushes it.
///
/// # Errors
/// When the pipe fails: the other end is gone.
pub fn write<T: Serialize>(to: &mut impl Write, message: &T) -> io::Result<()> {
    let bytes = postcard::to_stdvec(message).map_err(io::Error::other)?;
    if bytes.len() > LONGEST {
        return Err(io::Error::other(format!("a message of {} bytes is longer than {LONGEST}", bytes.len())));
    }
    to.write_all(&(bytes.len() as u32).to_le_bytes())?;
    to.write_all(&crc32fast::hash(&bytes).to_le_bytes())?;
    to.write_all(&bytes)?;
    to.flush()
}

/// The next message; `None` where the pipe has ended, also within a message: the writer was killed.
///
/// # Errors
/// When the pipe fails, or what comes is no message.
pub fn read<T: DeserializeOwned>(from: &mut impl Read) -> io::Result<Option<T>> {
    let mut head = [0; 8];
    if !filled(from, &mut head)? {
        return Ok(None);
    }
    let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let (length, crc) = (u32_at(0) as usize, u32_at(4));
    if length > LONGEST {
        return Err(io::Error::other(format!("a message of {length} bytes is longer than {LONGEST}")));
    }
    let mut bytes = vec![0; length];
    if !filled(from, &mut bytes)? {
        return Ok(None);
    }
    if crc32fast::hash(&bytes) != crc {
        return Err(io::Error::other("a message has a wrong checksum: something else writes into the pipe"));
    }
    postcard::from_bytes(&bytes).map(Some).map_err(io::Error::other)
}

/// The first order of a worker; `None` where the supervisor is gone, and where it cannot be read, which is reported.
pub fn first_order(from: &mut impl Read, to: &mut impl Write) -> Option<Order> {
    read(from).unwrap_or_else(|e| {
        let failure = Failure::new("the first order", e, "use programs of one release");
        // Without a supervisor nobody reads this.
        let _ = write(to, &Report::Failed(failure));
        None
    })
}

/// Fills the buffer; false when the pipe ends before.
fn filled(from: &mut impl Read, buffer: &mut [u8]) -> io::Result<bool> {
    match from.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(e) => Err(e),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_arrives_as_it_was_sent() {
        for clocks in [None, Some(FlowClocks { offset_s: [0.03, 0.002], readout_s: [0.02, 0.004] })] {
            let mut config = Config::default();
            config.tracker.clocks = clocks;
            let mut pipe = Vec::new();
            write(&mut pipe, &SlamSetup::new(config.clone())).unwrap();
            let arrived: SlamSetup = read(&mut pipe.as_slice()).unwrap().unwrap();
            assert_eq!(arrived.into_config(), config);
        }
    }

    #[test]
    fn an_order_that_cannot_be_read_is_reported() {
        let (mut pipe, mut answer) = (Vec::new(), Vec::new());
        write(&mut pipe, &u8::MAX).unwrap();
        assert!(first_order(&mut pipe.as_slice(), &mut answer).is_none());
        let report = read(&mut answer.as_slice()).unwrap();
        assert!(matches!(report, Some(Report::Failed(why)) if why.what.contains("first order")));
    }
}
