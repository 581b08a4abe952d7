//! The command-line arguments of `cairn run`.

use super::foxglove::DEFAULT_ADDRESS;
use super::say::Say;
use super::sensor::sensors;
use crate::commands::team::member::Reach;
use crate::number::{between, positive};
use crate::speaking::Speaking;
use cairn_engine::Sensors;
use cairn_guide::Facing;
use cairn_sources::{NamedTopic, SourceKind};
use std::net::SocketAddr;
use std::path::PathBuf;

const SOURCE: &str = "Source and calibration";
const RESULTS: &str = "Results";
const MAPS: &str = "Maps";
const TEAM: &str = "Team";
const ROUTES: &str = "Routes and guidance";
const SPEECH: &str = crate::speaking::HEADING;
pub const RUNNING: &str = "How it runs";

/// Runs SLAM on a recording or a live source; records routes and guides along them.
///
/// SOURCE is the folder of a recording (EuRoC, TUM-VI, TUM RGB-D, KITTI, 7-Scenes, or just PNG or JPEG images), a ROS bag
/// (.bag, .db3 or the folder of ros2 bag, also of the RealSense SDK), an MCAP file, sim:WORLD, a video file, camera:N,
/// v4l2:/dev/videoN or realsense: (64-bit Linux), rtsp://..., rtmp://... or
/// rtmp-listen://HOST:PORT/NAME; its kind is detected automatically. On a terminal, in real time, keys give commands; they
/// are listed below.
#[derive(clap::Args)]
#[command(after_long_help = crate::speaking::keys())]
pub struct Arguments {
    /// The recording, live stream or simulated world; --help lists the kinds.
    pub source: String,
    /// Which sensors to use; by default all the source has.
    #[arg(help_heading = SOURCE, long, value_parser = sensors(), value_name = "WHICH")]
    pub sensor: Option<Sensors>,
    /// Take the pose of each frame from the shape of what the depth sensor sees (dense; only with a depth sensor), while features find
    /// places again. Without it so is done where the first seconds show that depth is not registered to the picture; elsewhere features
    /// give the pose, and depth where they do not suffice.
    #[arg(help_heading = SOURCE, long, value_enum, value_name = "WHICH")]
    pub front_end: Option<FrontEnd>,
    /// A calibration file to use instead of the source's own, or the name of a built-in
    /// rig; "list" shows their names.
    #[arg(help_heading = SOURCE, long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// The topic of a sensor of a bag, where it should not be found by its type and name: left (or the only camera), right,
    /// depth, imu, gyro and accel, or the camera_info of one: left-info, right-info, depth-info. May be repeated.
    #[arg(help_heading = SOURCE, long = "topic", value_name = "SENSOR=TOPIC")]
    pub topics: Vec<NamedTopic>,
    /// What the folder is taken for, where it could be two things.
    #[arg(help_heading = SOURCE, long = "as", value_enum, value_name = "KIND")]
    pub kind: Option<Kind>,
    /// The vocabulary of visual words for recognising places, in place of the built-in one (cairn vocab). A saved map is
    /// converted to it.
    #[arg(help_heading = SOURCE, long, value_name = "FILE")]
    pub vocabulary: Option<PathBuf>,
    /// Configuration entries that differ from the defaults; see cairn config.
    #[arg(help_heading = SOURCE, long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Writes the pose of every tracked frame, with all corrections made by the end, in TUM format.
    #[arg(help_heading = RESULTS, long, value_name = "OUT.tum")]
    pub trajectory: Option<PathBuf>,
    /// Writes the poses as they were output live, in TUM format.
    #[arg(help_heading = RESULTS, long, value_name = "OUT.tum")]
    pub live_trajectory: Option<PathBuf>,
    /// The frame whose poses the trajectories contain.
    #[arg(help_heading = RESULTS, long, value_enum, default_value = "body", value_name = "WHOSE")]
    pub frame: TrajectoryFrame,
    /// Records the route. An existing file is never overwritten; with --map-in it is continued if it was recorded in
    /// that map.
    #[arg(help_heading = ROUTES, long, value_name = "ROUTE")]
    pub record: Option<PathBuf>,
    /// Guides along this route, from its start to its end, as soon as the camera's pose is known.
    #[arg(help_heading = ROUTES, long, value_name = "ROUTE")]
    pub guide: Option<PathBuf>,
    /// Guides along the route in reverse, from its end back to its start.
    #[arg(help_heading = ROUTES, long, requires = "guide")]
    pub back: bool,
    /// How the walker faces relative to the camera during guidance.
    #[arg(help_heading = ROUTES, long, value_enum, default_value = "home")]
    pub facing: FacingArgument,
    /// How announcements are given: text, speech, wav:FILE or none. By default text if there is guidance, a script,
    /// --lines or a live source, else none.
    #[arg(help_heading = SPEECH, long, value_name = "HOW")]
    pub say: Option<Say>,
    /// Speed of the speech, 0.1 to 2; 1 is 180 words a minute. See also --words-per-minute.
    #[arg(help_heading = SPEECH, long, value_name = "R", value_parser = between(0.1, 2.0),
        conflicts_with = "words_per_minute")]
    pub rate: Option<f64>,
    /// Volume of speech and sounds, 0 to 1.
    #[arg(help_heading = SPEECH, long, default_value_t = 1.0, value_name = "V", value_parser = between(0.0, 1.0))]
    pub volume: f64,
    #[command(flatten)]
    pub speaking: Speaking,
    /// Executes the commands in this file at given times and places, one per line: "at 5 record",
    /// "near X Y Z WITHIN stop", "tracked 100 record", "arrived quit".
    #[arg(help_heading = ROUTES, long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// Reads commands from standard input, one per line ("record", "stop", "guide home"), for screen readers.
    #[arg(help_heading = ROUTES, long)]
    pub lines: bool,
    /// The folder for routes recorded on command.
    #[arg(help_heading = ROUTES, long, alias = "ways", value_name = "DIR", default_value = "routes")]
    pub routes: PathBuf,
    /// Continues in a saved map; tracking starts when a place of the map is recognised.
    #[arg(help_heading = MAPS, long, value_name = "FILE")]
    pub map_in: Option<PathBuf>,
    /// Saves the map with the routes recorded in it, periodically and at the end, however the run ends.
    #[arg(help_heading = MAPS, long, value_name = "FILE")]
    pub map_out: Option<PathBuf>,
    /// Names new key frames after this robot (phone, person): maps and routes of several can then be merged without
    /// renaming anything.
    #[arg(help_heading = MAPS, long, value_name = "N")]
    pub robot: Option<u16>,
    /// Shares the map with the other robots of this team while it grows, each time --map-out is saved; --team-map becomes
    /// the atlas of all. See cairn team status.
    #[arg(help_heading = TEAM, long, value_name = "NAME", requires_all = ["robot", "map_out", "team_map"])]
    pub team: Option<String>,
    /// With --team: the atlas of all robots; beside it OUT.team.json, which cairn team status shows.
    #[arg(help_heading = TEAM, long, value_name = "OUT.map", requires = "team")]
    pub team_map: Option<PathBuf>,
    #[command(flatten)]
    pub reach: Reach,
    /// Keeps the depth of key frames, and saves it with the map of --map-out: about 0.2 MB each at 640x480. A map that
    /// has depth goes on with it; --mesh keeps it too. See cairn mesh.
    #[arg(help_heading = MAPS, long)]
    pub dense: bool,
    /// Gives surfaces what the camera saw: for --mesh, and for what is kept with --dense (half as much again). Needs depth that is
    /// registered to the camera.
    #[arg(help_heading = MAPS, long)]
    pub colour: bool,
    /// Seconds between saves of the map during the run.
    #[arg(help_heading = MAPS, long, default_value_t = 30.0, value_name = "S", requires = "map_out")]
    pub map_every: f64,
    /// Only localizes in the map given by --map-in; the map is never changed.
    #[arg(help_heading = MAPS, long, requires = "map_in", conflicts_with = "map_out")]
    pub localize_only: bool,
    /// Runs the stages one after the other, so that results are bit-identical every time (the default for recordings).
    #[arg(help_heading = RUNNING, long, conflicts_with = "realtime")]
    pub lockstep: bool,
    /// Plays the source in real time; mapping has its own thread, and frames that arrive too fast are dropped.
    #[arg(help_heading = RUNNING, long)]
    pub realtime: bool,
    /// Prints the status on stderr, one line at every change and every second: the phase (LOADING_VOCAB, WAIT_FRAMES,
    /// WAIT_IMU, WAIT_MOTION, INITIALIZING, TRACKING, COASTING, LOST, RESETTING, ERROR), pose, map, points, IMU, and
    /// what it is waiting for. Replaces the progress bar.
    #[arg(help_heading = RUNNING, long)]
    pub status: bool,
    /// Writes the changes of the map as lines of JSON: new maps, loops, merges, key frames that are moved or removed,
    /// and the results of loop detection.
    #[arg(help_heading = RESULTS, long, value_name = "FILE")]
    pub events: Option<PathBuf>,
    /// Writes the run as MCAP with Foxglove's schemas, which Foxglove and tools for ROS 2 recordings read: poses, transforms,
    /// points, images with features, spoken words, events.
    #[arg(help_heading = RESULTS, long, value_name = "OUT.mcap")]
    pub mcap: Option<PathBuf>,
    /// Shows the same live in Foxglove, which connects to ws://ADDRESS; without an address, on this machine only. Recordings are
    /// best played with --realtime.
    #[arg(help_heading = RESULTS, long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = DEFAULT_ADDRESS)]
    pub foxglove: Option<SocketAddr>,
    /// Writes the run as a recording of the rerun viewer: poses, images with features, points, key frames, loops, routes,
    /// spoken words on one time line. Needs the program cairn-rerun. An address as rerun+http://127.0.0.1:9876/proxy shows it in
    /// a viewer that runs there, while it happens.
    #[arg(help_heading = RESULTS, long, value_name = "OUT.rrd|ADDRESS")]
    pub rerun: Option<PathBuf>,
    /// Watches the way of a guided walker with the depth sensor, and stops him for what is in it.
    #[arg(help_heading = RUNNING, long)]
    pub watch_way: bool,
    /// Writes the surface of what the depth sensor saw, from the final poses: .ply, .glb or .obj, or .pgm for a heightmap.
    #[arg(help_heading = RESULTS, long, value_name = "OUT.ply")]
    pub mesh: Option<PathBuf>,
    #[command(flatten)]
    pub isolated: Isolated,
    /// Writes what --replay needs to reproduce the poses of this run bit for bit.
    #[arg(help_heading = RUNNING, long, value_name = "FILE", requires = "realtime")]
    pub journal: Option<PathBuf>,
    /// Repeats the run that wrote this journal, on one thread, and checks every pose against it.
    #[arg(help_heading = RUNNING, long, value_name = "FILE", conflicts_with = "realtime")]
    pub replay: Option<PathBuf>,
    /// Skips the first S seconds.
    #[arg(help_heading = SOURCE, long, default_value_t = 0.0, value_name = "S")]
    pub start: f64,
    /// Numbers the images of a recording at this rate, in the order in which they are listed, instead of believing their
    /// times; an IMU and ground truth are then not used.
    #[arg(help_heading = SOURCE, long, value_name = "HZ", value_parser = positive())]
    pub number_frames: Option<f64>,
    /// Stops after N frames.
    #[arg(help_heading = SOURCE, long, value_name = "N")]
    pub frames: Option<usize>,
    /// Writes the report as JSON.
    #[arg(help_heading = RESULTS, long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
    /// Writes the report as one HTML file with figures.
    #[arg(help_heading = RESULTS, long, value_name = "OUT.html")]
    pub report_html: Option<PathBuf>,
    /// Replaces output files that exist already. The map of --map-in may be saved to the same file without it.
    #[arg(help_heading = RESULTS, long)]
    pub overwrite: bool,
}

/// What a folder is taken for.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// EuRoC or TUM-VI (mav0/ or cam0/).
    Euroc,
    /// TUM RGB-D (rgb.txt or associations.txt).
    Tum,
    /// KITTI odometry (image_0/).
    Kitti,
    /// 7-Scenes (frame-*.color.*).
    #[value(name = "7-scenes")]
    SevenScenes,
    /// Numbered frames of Replica, ScanNet, Stray Scanner or Record3D.
    Frames,
    /// UZH-FPV and the like (left_images.txt or images.txt).
    Uzh,
    /// An Android phone's camera and sensors (frames.csv, gyroscope.csv, accelerometer.csv).
    Android,
    /// Images of one camera, or of two side by side.
    Images,
}

impl Kind {
    /// The type that sources use.
    pub fn kind(self) -> SourceKind {
        match self {
            Self::Euroc => SourceKind::Euroc,
            Self::Tum => SourceKind::Tum,
            Self::Kitti => SourceKind::Kitti,
            Self::SevenScenes => SourceKind::SevenScenes,
            Self::Frames => SourceKind::Frames,
            Self::Uzh => SourceKind::Uzh,
            Self::Android => SourceKind::Android,
            Self::Images => SourceKind::Images,
        }
    }
}

/// The frame whose poses are written.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum TrajectoryFrame {
    /// The rig's body frame (EuRoC: the IMU).
    Body,
    /// The first camera.
    Cam0,
}

/// How the walker faces relative to the camera.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum FacingArgument {
    /// The walker walks in the direction of the camera.
    Home,
    /// The walker walks forwards while the camera looks back.
    Back,
    /// The walker walks backwards, with the camera as it was while recording.
    Backwards,
}

impl FacingArgument {
    /// The type that the guide uses.
    pub fn facing(self) -> Facing {
        match self {
            Self::Home => Facing::Home,
            Self::Back => Facing::Back,
            Self::Backwards => Facing::Backwards,
        }
    }
}

/// The arguments of a run as processes.
#[derive(clap::Args)]
pub struct Isolated {
    /// Runs capture, SLAM, surfaces and the guide as processes under a supervisor: one that dies or hangs is started again, the
    /// guide says stop meanwhile, and the run goes on in the map of a moment ago. Needs /dev/shm.
    #[arg(help_heading = RUNNING, long, conflicts_with_all = NOT_ISOLATED)]
    pub isolated: bool,
    /// Memory that each process may use, MB; one that needs more dies and is started again.
    #[arg(help_heading = RUNNING, long, default_value_t = 8000, value_name = "MB", requires = "isolated")]
    #[arg(value_parser = clap::value_parser!(u64).range(50..=1_000_000))]
    pub worker_memory: u64,
    /// What this process does for its supervisor.
    #[arg(long, hide = true)]
    pub worker: Option<String>,
}

/// What gives the pose of each frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum FrontEnd {
    /// Depth.
    Dense,
}

/// What only one process can do so far.
const NOT_ISOLATED: [&str; 15] = [
    "front_end",
    "frame",
    "script",
    "status",
    "lines",
    "events",
    "mcap",
    "foxglove",
    "rerun",
    "watch_way",
    "journal",
    "replay",
    "report_html",
    "localize_only",
    "lockstep",
];
