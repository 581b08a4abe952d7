//! The command line of `bench`: what is measured, and how much of it.

use bench::{Sensors, dense};
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Measures the whole engine.
#[derive(Parser)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
    /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
    #[arg(long, global = true)]
    pub data: Option<PathBuf>,
    /// Writes all figures as JSON here.
    #[arg(long, global = true)]
    pub json: Option<PathBuf>,
    /// Writes the tables into their pages in docs/.
    #[arg(long, global = true)]
    pub write: bool,
}

/// What is measured.
#[derive(Subcommand)]
pub enum Command {
    /// Runs a scenario: the engine over recordings or simulated walks, with tables of its figures. Without a name it lists them all.
    Run(RunArguments),
    /// Which build the tables of the documents were measured with, the oldest first: how many commits changed the code since.
    Figures,
    /// Pose graphs: known optima from odometry initialisation, times.
    Graphs {
        /// Only graphs whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Repetitions of each solve.
        #[arg(long, default_value_t = 15)]
        times: usize,
    },
    /// Whether the scale of one camera and an IMU is as uncertain as it says: errors over stated standard deviations in windows
    /// of several lengths, of real motions, recordings and simulated walks.
    ScaleSigma {
        /// Only those whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Seeds of the simulated walks.
        #[arg(long, default_value_t = 6)]
        seeds: u64,
    },
    /// Maps and saves the first half of each recording, and localizes the second half in it.
    Halves,
    /// Relocalisation in a map of another day, from starts in its middle: recall by distance and angle.
    NextDay {
        /// Number of seeds from 1; corridor, office, hall and street alternate.
        #[arg(long, default_value_t = 4)]
        seeds: u64,
        /// Sensors, separated by commas.
        #[arg(long, value_delimiter = ',', default_value = "mono,stereo,rgbd")]
        sensors: Vec<Sensors>,
        /// Starts per day half a metre beside the path.
        #[arg(long, default_value_t = 10)]
        starts: usize,
        /// Starts per day at each distance and angle of the table.
        #[arg(long, default_value_t = 2)]
        each: usize,
    },
    /// A drawn phone's walker who turns on the spot, or stands for long, and takes the first steps home: how far from the truth.
    Spot {
        /// Number of seeds.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// The first seed.
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Seeds of latencies of mapping and closing for each walk, beside lockstep.
        #[arg(long, default_value_t = 0)]
        delays: u64,
        /// Metres out.
        #[arg(long, default_value_t = 19.5)]
        metres: f64,
        /// Only every nth of the phone's 10 to 15 pictures a second comes.
        #[arg(long, default_value_t = 1)]
        every: usize,
        /// The engine is given a guess of the phone's lens, not the lens.
        #[arg(long)]
        guessed_lens: bool,
        /// Configuration entries in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Prints every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
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
    },
    /// A city of generated walks, with real recordings among them: what finding and verifying the pairs that share places costs by
    /// the number of walks, and whether they are the true ones.
    #[cfg(unix)]
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
    },
    /// Surfaces on the kitchen recording, one thread: times, quality and memory, each beside its goal. The peer on the
    /// same frames: tools/compare_dense.py.
    Dense {
        /// Only these sections, separated by commas.
        #[arg(long, value_delimiter = ',', value_enum, conflicts_with = "write")]
        only: Vec<dense::Section>,
    },
    /// An isolated run with depth whose processes are killed at random moments: times until they work again, what is lost.
    #[cfg(unix)]
    Kills {
        /// How often each process is killed.
        #[arg(long, default_value_t = 50)]
        times: usize,
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
        /// A vocabulary to use instead of the built-in one; may be given several times, to compare.
        #[arg(long)]
        vocab: Vec<PathBuf>,
        /// Only the photographs.
        #[arg(long)]
        loops: bool,
        /// Prints every geometrically verified pair on stderr.
        #[arg(long, short)]
        verbose: bool,
    },
    /// Real IMUs on real motion, ground-truth poses instead of a camera: drift, initialisation, time offset.
    Inertial {
        /// Only recordings whose name contains this.
        #[arg(long)]
        only: Option<String>,
        /// Only conditions whose name contains this.
        #[arg(long)]
        condition: Option<String>,
        /// Uses every n-th start.
        #[arg(long, default_value_t = 1)]
        every: usize,
    },
    /// The filter: real logs compared with smoothing and surveys, consistency over simulated runs, speed.
    Ekf {
        /// Only these sections, separated by commas.
        #[arg(long, value_delimiter = ',', default_value = "mrclam,noise,victoria,plaza,consistency,speed")]
        only: Vec<String>,
    },
    /// Simulated walkers guided along random routes on poses: arrivals, errors, utterances, and what breaks a rule too often.
    Guide {
        /// Routes of each kind of walk.
        #[arg(long, default_value_t = 200)]
        ways: u64,
        /// The first seed.
        #[arg(long, default_value_t = 0)]
        from: u64,
        /// Only this kind of walk, from 0.
        #[arg(long)]
        row: Option<usize>,
        /// Replays the walk of this seed in that row instead, with its time line.
        #[arg(long, requires = "row")]
        seed: Option<u64>,
    },
    /// Robots that explore apartments, one for each seed. With --write each has its row in docs/figures/plan.md.
    Robot {
        /// The first seed.
        #[arg(default_value_t = 1)]
        first: u64,
        /// Number of seeds.
        #[arg(default_value_t = 1)]
        count: u64,
    },
    /// The surface of a simulated walk with depth against the world's true one.
    Surface {
        /// The walk; seed=1-20 walks with each of these seeds, with a table.
        #[arg(default_value = "sim:corridor?sensor=rgbd&seed=1")]
        address: String,
        /// Edge of a voxel, metres.
        #[arg(long, default_value_t = 0.02)]
        voxel: f64,
        /// The camera is covered from one second to another.
        #[arg(long, value_delimiter = ',', value_name = "FROM,TO")]
        covered: Vec<f64>,
    },
    /// Latency of a live stream: from the publisher over RTMP to the pose, and from the pose to the announcement. Needs
    /// ffmpeg.
    Live {
        /// Duration, minutes.
        #[arg(long, default_value_t = 1.0)]
        minutes: f64,
    },
    /// Runs any source; prints JSON.
    One {
        /// A folder or file, or sim:WORLD.
        source: String,
        /// Sensors.
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

/// What of a scenario is run.
#[derive(Args)]
pub struct RunArguments {
    /// Its name (`crates/bench/scenarios`), or the path of a file in TOML.
    pub scenario: Option<String>,
    /// Values of an axis, as sensors=mono,stereo or seed=1..20, or of what the scenario gives, as seconds=6; may be given several times.
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// Runs of each, instead of as many as the scenario asks for.
    #[arg(long)]
    pub times: Option<usize>,
    /// Runs beside each other.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// Configuration entries in TOML that differ from the defaults.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Prints every frame on stderr.
    #[arg(long, short)]
    pub verbose: bool,
    /// In this process, with the rows as JSON on stdout.
    #[arg(long, hide = true)]
    pub here: bool,
}
