//! What `cairn run` is asked for on its command line.

use super::face::Say;
use super::sensor::Sensor;
use cairn_guide::{DirectionStyle, Facing, Unit};
use std::path::PathBuf;

/// SLAM on any source: poses, a map, a recorded way, a report.
///
/// SOURCE is the folder of a recording (EuRoC, TUM-VI, TUM RGB-D, KITTI, 7-Scenes), sim:WORLD, a video file, camera:N,
/// rtsp://..., rtmp://... or rtmp-listen://HOST:PORT/NAME; its kind is found by looking. On a terminal, in real time,
/// keys give commands: r record, s stop, l load, g guide home, b backwards, h halt, p repeat, i state, q quit.
#[derive(clap::Args)]
pub struct Arguments {
    /// The recording, the simulated world or the video.
    pub source: String,
    /// Which sensors to use; without it, all that the source has.
    #[arg(long, value_enum, value_name = "WHICH")]
    pub sensor: Option<Sensor>,
    /// A calibration in place of the source's own, or the name of a rig (phone-854x480).
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// Settings that differ from the default, see cairn config.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Writes every tracked frame, corrected at the end, in TUM form.
    #[arg(long, value_name = "OUT.tum")]
    pub trajectory: Option<PathBuf>,
    /// Writes the poses as they were given at the time, in TUM form.
    #[arg(long, value_name = "OUT.tum")]
    pub live_trajectory: Option<PathBuf>,
    /// Whose poses the trajectories hold.
    #[arg(long, value_enum, default_value = "body", value_name = "WHOSE")]
    pub frame: Whose,
    /// Records the way that was gone; an existing file is refused, but with --map-in it is gone on with if it hangs on
    /// that map.
    #[arg(long, value_name = "WAY")]
    pub record: Option<PathBuf>,
    /// Guides along this way, from its start to its end, as soon as there is a pose.
    #[arg(long, value_name = "WAY")]
    pub guide: Option<PathBuf>,
    /// Guides from the end of the way to its start.
    #[arg(long, requires = "guide")]
    pub back: bool,
    /// How the walker stands to the camera under guidance.
    #[arg(long, value_enum, default_value = "home")]
    pub facing: FacingArgument,
    /// How words are told: text, speech, wav:FILE or none; text where something can be said, else none.
    #[arg(long, value_name = "HOW")]
    pub say: Option<Say>,
    /// Rate of speech, 0.1 to 2.
    #[arg(long, default_value_t = 1.0, value_name = "R", value_parser = between(0.1, 2.0))]
    pub rate: f64,
    /// Loudness of speech and sounds, 0 to 1.
    #[arg(long, default_value_t = 1.0, value_name = "V", value_parser = between(0.0, 1.0))]
    pub volume: f64,
    /// The unit of distances.
    #[arg(long, value_enum, default_value = "metres")]
    pub unit: UnitArgument,
    /// How directions are told.
    #[arg(long, value_enum, default_value = "words")]
    pub directions: DirectionsArgument,
    /// Gives commands at times and places, a line each: "at 5 record", "near X Y Z WITHIN stop", "tracked 100 record",
    /// "arrived quit".
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// Takes commands from standard input, a line each ("record", "stop", "guide home"), for screen readers.
    #[arg(long)]
    pub lines: bool,
    /// Where ways are kept that are recorded on command.
    #[arg(long, alias = "ways", value_name = "DIR", default_value = "routes")]
    pub routes: PathBuf,
    /// Goes on in a saved map; tracking begins when a place is recognised.
    #[arg(long, value_name = "FILE")]
    pub map_in: Option<PathBuf>,
    /// Saves the map, now and then and at the end, however the run ends, with the ways recorded in it.
    #[arg(long, value_name = "FILE")]
    pub map_out: Option<PathBuf>,
    /// Seconds between saves of the map while the run goes on.
    #[arg(long, default_value_t = 30.0, value_name = "S", requires = "map_out")]
    pub map_every: f64,
    /// Only finds where it is in the map that --map-in gives; the map is never changed.
    #[arg(long, requires = "map_in", conflicts_with = "map_out")]
    pub localize_only: bool,
    /// One stage after the other, the same bits every time, whatever else the machine does (the default).
    #[arg(long, conflicts_with = "realtime")]
    pub lockstep: bool,
    /// Plays the source as a camera would; mapping has its own thread, frames that come too fast are dropped.
    #[arg(long)]
    pub realtime: bool,
    /// Tells how it stands on stderr, a whole line when that changes and every second: the phase (LOADING_VOCAB,
    /// WAIT_FRAMES, WAIT_IMU, WAIT_MOTION, INITIALIZING, TRACKING, COASTING, LOST, RESETTING, ERROR), pose, map, points,
    /// inertial sensor, what is waited for. No bar is drawn then.
    #[arg(long)]
    pub status: bool,
    /// Writes what happens to the map, a line of JSON each: worlds, loops, merges, key frames that move or go, and what
    /// closing says of places.
    #[arg(long, value_name = "FILE")]
    pub events: Option<PathBuf>,
    /// Writes what is needed to have the poses of this run again, bit for bit.
    #[arg(long, value_name = "FILE", requires = "realtime")]
    pub journal: Option<PathBuf>,
    /// Runs again as this journal tells, on one thread, and checks every pose against it.
    #[arg(long, value_name = "FILE", conflicts_with = "realtime")]
    pub replay: Option<PathBuf>,
    /// Begins so many seconds after the first image.
    #[arg(long, default_value_t = 0.0, value_name = "S")]
    pub start: f64,
    /// Takes at most so many frames.
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// Writes the report as JSON.
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
    /// Writes the report as one HTML file with its figures.
    #[arg(long, value_name = "OUT.html")]
    pub report_html: Option<PathBuf>,
}

/// Whose poses are written.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Whose {
    /// The rig's body (EuRoC: the IMU).
    Body,
    /// The first camera.
    Cam0,
}

/// A number within bounds.
fn between(low: f64, high: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| match text.parse::<f64>() {
        Ok(v) if (low..=high).contains(&v) => Ok(v),
        _ => Err(format!("must be a number from {low} to {high}")),
    }
}

/// The unit of distances.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum UnitArgument {
    /// Metres.
    Metres,
    /// Feet.
    Feet,
    /// Steps of 65 cm.
    Steps,
}

impl UnitArgument {
    /// As phrases take it.
    pub fn unit(self) -> Unit {
        match self {
            Self::Metres => Unit::Metres,
            Self::Feet => Unit::Feet,
            Self::Steps => Unit::Steps(0.65),
        }
    }
}

/// How directions are told.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum DirectionsArgument {
    /// "Turn left."
    Words,
    /// "Turn to 9 o'clock."
    Clock,
    /// "Turn left 90 degrees."
    Degrees,
}

impl DirectionsArgument {
    /// As phrases take it.
    pub fn style(self) -> DirectionStyle {
        match self {
            Self::Words => DirectionStyle::Words,
            Self::Clock => DirectionStyle::Clock,
            Self::Degrees => DirectionStyle::Degrees,
        }
    }
}

/// How the walker stands to the camera.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum FacingArgument {
    /// Walks where the camera looks.
    Home,
    /// Walks forwards while the camera looks back.
    Back,
    /// Walks backwards, the camera as on the way out.
    Backwards,
}

impl FacingArgument {
    /// As the guide takes it.
    pub fn facing(self) -> Facing {
        match self {
            Self::Home => Facing::Home,
            Self::Back => Facing::Back,
            Self::Backwards => Facing::Backwards,
        }
    }
}
