//! The command line of `bench`: what is measured, and how much of it.

use bench::revisit::Trial;
use bench::{Sensors, dense, visual_inertial};
use cairn_sim::WorldKind;
use clap::{Parser, Subcommand};
use std::path::PathBuf;

/// Measures the whole engine.
#[derive(Parser)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

/// What is measured.
#[derive(Subcommand)]
pub enum Command {
    /// Real recordings: ATE, coverage, step times, memory; each runs twice.
    Accuracy {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only rows whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Runs of each recording.
        #[arg(long, default_value_t = 2)]
        times: usize,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Writes docs/figures/accuracy.md and the table of the README.
        #[arg(long)]
        write: bool,
    },
    /// Simulated walks: drift and coverage by world and sensor.
    Walks {
        /// Number of seeds from 0; the worlds alternate.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// The first seed.
        #[arg(long, default_value_t = 0)]
        from: u64,
        /// Worlds, separated by commas.
        #[arg(long, value_delimiter = ',')]
        worlds: Vec<WorldKind>,
        /// Sensors, separated by commas.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensors>,
        /// Duration of each walk, seconds.
        #[arg(long, default_value_t = 40.0)]
        seconds: f64,
        /// Runs every seed in every world.
        #[arg(long)]
        all: bool,
        /// Walks as many of seeds drawn from this number too, and marks what is better on the fixed ones by more than a fifth.
        #[arg(long)]
        drawn: Option<u64>,
        /// Writes the comparison into docs/figures/revisits.md.
        #[arg(long, requires = "drawn")]
        write: bool,
        /// Number of walks in parallel.
        #[arg(long, default_value_t = 1)]
        jobs: usize,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Which build the tables of the documents were measured with, the oldest first: how many commits changed the code since.
    Figures,
    /// Pose graphs: known optima from odometry initialisation, times.
    Graphs {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only graphs whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Repetitions of each solve.
        #[arg(long, default_value_t = 15)]
        times: usize,
        /// Writes docs/figures/graphs.md.
        #[arg(long)]
        write: bool,
    },
    /// Walks with revisits: laps with and without loop closing, a covered camera around a corner, rooms that look
    /// alike.
    Revisit {
        /// Trials, separated by commas.
        #[arg(long, value_delimiter = ',', value_enum)]
        trials: Vec<Trial>,
        /// Number of seeds.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// The first seed.
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Worlds, separated by commas; by default corridor, hall and street alternate.
        #[arg(long, value_delimiter = ',')]
        worlds: Vec<WorldKind>,
        /// Sensors, separated by commas.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensors>,
        /// Prints every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Configuration entries in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
    },
    /// RGB-D with structured light on simulated walks: by how much the maps are too large.
    DepthScale {
        /// Number of seeds; each is walked in four worlds.
        #[arg(long, default_value_t = 5)]
        seeds: u64,
        /// Configuration entries in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
    },
    /// Whether the scale of one camera and an IMU is as uncertain as it says: errors over stated standard deviations in windows
    /// of several lengths, of real motions, recordings and simulated walks.
    ScaleSigma {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only those whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Seeds of the simulated walks.
        #[arg(long, default_value_t = 6)]
        seeds: u64,
    },
    /// Faults of the IMU put into recordings: error, coverage, and whether each is told.
    ImuFaults {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only recordings whose name contains this.
        #[arg(long)]
        recording: Option<String>,
        /// Only faults whose name contains one of these, separated by commas (none: without a fault).
        #[arg(long, value_delimiter = ',')]
        faults: Vec<String>,
        /// Sensors, separated by commas.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensors>,
        /// Moments at which each fault begins.
        #[arg(long, default_value_t = 1)]
        seeds: u64,
        /// The first of them; 0 is a fixed one, others are random.
        #[arg(long, default_value_t = 0)]
        from: u64,
        /// Seconds for which the camera is covered, from half a second before each fault on.
        #[arg(long, default_value_t = 0.0)]
        dark: f64,
        /// A configuration of the engine.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Maps and saves the first half of each recording, and localizes the second half in it.
    Halves {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
    },
    /// Relocalisation in a map of another day, from starts in its middle: recall by distance and angle.
    NextDay {
        /// Number of seeds from 1; corridor, office, hall and street alternate.
        #[arg(long, default_value_t = 4)]
        seeds: u64,
        /// Sensors, separated by commas.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensors>,
        /// Starts per day half a metre beside the path.
        #[arg(long, default_value_t = 10)]
        starts: usize,
        /// Starts per day at each distance and angle of the table.
        #[arg(long, default_value_t = 2)]
        each: usize,
    },
    /// Long run of laps: step time, memory and map size, minute by minute.
    Long {
        /// The world.
        #[arg(long, default_value = "hall")]
        world: WorldKind,
        /// The route, which ends where it begins.
        #[arg(long, default_value = "loop")]
        route: String,
        /// The sensor.
        #[arg(long, default_value = "stereo")]
        sensor: Sensors,
        /// Duration, minutes.
        #[arg(long, default_value_t = 10.0)]
        minutes: f64,
    },
    /// How much full bundle adjustment of a map in parallel slows down tracking: threaded, in pairs of runs, in real
    /// time.
    Busy {
        /// Pairs of runs.
        #[arg(long, default_value_t = 5)]
        pairs: usize,
        /// Frames per run.
        #[arg(long, default_value_t = 400)]
        frames: usize,
        /// Seed of the world (a hall).
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// The sensor.
        #[arg(long, default_value = "stereo")]
        sensor: Sensors,
    },
    /// A large map: a street of kilometres, walked on generated frames through the real stages. Each figure beside its
    /// goal.
    Street {
        /// Length, metres.
        #[arg(long, default_value_t = 5110)]
        metres: usize,
        /// Features per frame, at most.
        #[arg(long, default_value_t = 1000)]
        features: usize,
        /// Repetitions of saving and opening.
        #[arg(long, default_value_t = 3)]
        times: usize,
        /// Folder to save in; default the system's temporary folder.
        #[arg(long)]
        folder: Option<PathBuf>,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Writes the figures into docs/figures/large-maps.md of this checkout.
        #[arg(long)]
        write: bool,
    },
    /// A city of generated walks, with real recordings among them: what finding and verifying the pairs that share places costs by
    /// the number of walks, and whether they are the true ones.
    City {
        /// Numbers of walks, separated by commas.
        #[arg(long, value_delimiter = ',', default_value = "10,30,100,300")]
        walks: Vec<usize>,
        /// Length of a walk, metres.
        #[arg(long, default_value_t = 40.0)]
        metres: f64,
        /// Other walks that each overlaps with, on average.
        #[arg(long, default_value_t = 10.0)]
        meets: f64,
        /// Shards of the index of places.
        #[arg(long, default_value_t = 1)]
        shards: usize,
        /// Real recordings that are no part of the street.
        #[arg(long)]
        among: Vec<PathBuf>,
        /// Stops before geometry verifies the pairs.
        #[arg(long)]
        words: bool,
        /// Folder to build in; default the system's temporary folder.
        #[arg(long)]
        folder: Option<PathBuf>,
    },
    /// Saves and opens a large map: seconds, and bytes by kind of part.
    Store {
        /// Key frames.
        #[arg(long, default_value_t = 1000)]
        key_frames: usize,
        /// Features per key frame.
        #[arg(long, default_value_t = 1000)]
        features: usize,
        /// Repetitions.
        #[arg(long, default_value_t = 5)]
        times: usize,
        /// Folder to save in; default the system's temporary folder.
        #[arg(long)]
        folder: Option<PathBuf>,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Surfaces on the kitchen recording, one thread: times, quality and memory, each beside its goal. The peer on the
    /// same frames: tools/compare_dense.py.
    Dense {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only these sections, separated by commas.
        #[arg(long, value_delimiter = ',', value_enum)]
        only: Vec<dense::Section>,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Writes the figures into docs/figures/dense.md of this checkout.
        #[arg(long, conflicts_with = "only")]
        write: bool,
    },
    /// An isolated run with depth whose processes are killed at random moments: times until they work again, what is lost.
    #[cfg(unix)]
    Kills {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// How often each process is killed.
        #[arg(long, default_value_t = 50)]
        times: usize,
        /// Writes the figures into docs/figures/processes.md of this checkout.
        #[arg(long)]
        write: bool,
    },
    /// What a process of Kills does.
    #[cfg(unix)]
    #[command(hide = true)]
    Worker {
        /// Its name.
        role: String,
    },
    /// Place recognition: photographs with a loop matrix, worlds and recordings with ground truth, costs.
    Places {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// A vocabulary to use instead of the built-in one; may be given several times, to compare.
        #[arg(long)]
        vocab: Vec<PathBuf>,
        /// Only the photographs.
        #[arg(long)]
        loops: bool,
        /// Prints every geometrically verified pair on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Writes docs/figures/places.md.
        #[arg(long)]
        write: bool,
    },
    /// Real IMUs on real motion, ground-truth poses instead of a camera: drift, initialisation, time offset.
    Inertial {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only recordings whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Only conditions whose name contains this.
        #[arg(long)]
        condition: Option<String>,
        /// Uses every n-th start.
        #[arg(long, default_value_t = 1)]
        every: usize,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Writes docs/figures/inertial.md.
        #[arg(long)]
        write: bool,
    },
    /// The whole engine with IMU: EuRoC MH_01, rendered rooms with real motion and real IMU data, a turn in front of
    /// plain walls, one minute of standing, costs.
    VisualInertial {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Trials, separated by commas.
        #[arg(long, value_delimiter = ',', value_enum, default_value = "recorded,semi-real,turn,rest,cost")]
        trials: Vec<visual_inertial::Trial>,
        /// Only real motions whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Only conditions whose name contains this ("as recorded", "half the rate", "20 ms", "lost", "bias").
        #[arg(long)]
        condition: Option<String>,
        /// Sensors, separated by commas; by default those of each trial. Without -imu the IMU is not used.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensors>,
        /// Seconds of each real motion; by default all of it with IMU data as recorded, 20 s with degraded data.
        #[arg(long)]
        seconds: Option<f64>,
        /// Number of seeds of the turns.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// The first seed.
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Seeds of latencies of mapping and closing for each walk of a phone, beside lockstep.
        #[arg(long, default_value_t = 1)]
        delays: u64,
        /// Longest time that a key frame keeps mapping busy in these, frames of 1/20 s.
        #[arg(long, default_value_t = 10)]
        most_frames: u32,
        /// The noise of the phone's readings.
        #[arg(long, value_enum, default_value = "overstated")]
        noise: visual_inertial::phone::Noise,
        /// Metres of the phone's route out.
        #[arg(long, default_value_t = 19.5)]
        metres: f64,
        /// Only every nth of a phone's 10 to 15 pictures a second comes (`--trials spot`).
        #[arg(long, default_value_t = 1)]
        every: usize,
        /// The engine is given a guess of the phone's lens, not the lens (`--trials spot`).
        #[arg(long)]
        guessed_lens: bool,
        /// Runs of each configuration for the cost.
        #[arg(long, default_value_t = 3)]
        times: usize,
        /// Configuration entries in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Prints every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Writes docs/figures/visual-inertial.md.
        #[arg(long)]
        write: bool,
    },
    /// The recordings of a real, uncalibrated phone, begun at every second: maps, metres, clocks, rows, lens.
    Phone {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only recordings whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Seconds to begin at, separated by commas; by default every one.
        #[arg(long, value_delimiter = ',')]
        starts: Vec<u32>,
        /// Configuration entries in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Prints every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
    },
    /// Latency of a live stream: from the publisher over RTMP to the pose, and from the pose to the announcement. Needs
    /// ffmpeg.
    Live {
        /// Duration, minutes.
        #[arg(long, default_value_t = 1.0)]
        minutes: f64,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Runs one recording by the name of its row, or any source with --sensor; prints JSON.
    One {
        /// Name of a row, a folder, or sim:WORLD.
        source: String,
        /// Folder of the recordings.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Sensors, if the source is not a row.
        #[arg(long, default_value = "stereo")]
        sensor: Sensors,
        /// Largest number of packets.
        #[arg(long, default_value_t = usize::MAX)]
        frames: usize,
        /// Prints every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Configuration entries in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
    },
}
