//! `bench`: measurements of the whole engine. Tables on stdout, progress on stderr.

use bench::nextday::{self, Day};
use bench::recordings::{RECORDINGS, data_folder, recording};
use bench::revisit::{Revisit, Trial};
use bench::walks::{WORLDS, Walk};
use bench::{
    MeasureOptions, Sensor, accuracy, busy, dense, depth_scale, graphs, halves, inertial, live, long,
    measure, places, revisit, store, street, visual_inertial, walks,
};
use cairn_engine::Config;
use cairn_sim::WorldKind;
use cairn_sources::{OpenOptions, open};
use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Measures the whole engine.
#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
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
        /// Writes docs/accuracy.md.
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
        sensors: Vec<Sensor>,
        /// Duration of each walk, seconds.
        #[arg(long, default_value_t = 40.0)]
        seconds: f64,
        /// Runs every seed in every world.
        #[arg(long)]
        all: bool,
        /// Number of walks in parallel.
        #[arg(long, default_value_t = 1)]
        jobs: usize,
        /// Writes all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
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
        /// Writes docs/graphs.md.
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
        sensors: Vec<Sensor>,
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
        sensors: Vec<Sensor>,
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
        /// The sensor.
        #[arg(long, default_value = "stereo")]
        sensor: Sensor,
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
        sensor: Sensor,
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
        /// Writes docs/places.md.
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
        /// Writes docs/inertial.md.
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
        sensors: Vec<Sensor>,
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
        /// Writes docs/visual-inertial.md.
        #[arg(long)]
        write: bool,
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
        sensor: Sensor,
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

fn read_config(path: &Path) -> Result<Config, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Config::from_toml(&text).map_err(|e| format!("{}: {e}", path.display()))
}

fn main() -> ExitCode {
    match run(Arguments::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("bench: {why}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<(), String> {
    match command {
        Command::Accuracy { data, only, times, json, write } => {
            let rows = accuracy::run(&data.unwrap_or_else(data_folder), only.as_deref(), times)?;
            print!("{}", accuracy::table(&rows));
            if write {
                save(
                    concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/accuracy.md").into(),
                    &accuracy::page(&rows),
                )?;
            }
            json.map_or(Ok(()), |path| save(path, &text(&rows)?))
        }
        Command::Walks { seeds, from, worlds, sensors, seconds, all, jobs, json } => {
            let worlds = if worlds.is_empty() { WORLDS.to_vec() } else { worlds };
            let sensors = if sensors.is_empty() { Sensor::ALL.to_vec() } else { sensors };
            let mut list = Vec::new();
            for seed in from..seeds {
                let turn = seed as usize % worlds.len();
                let here = if all { &worlds[..] } else { &worlds[turn..=turn] };
                for world in here {
                    list.extend(sensors.iter().map(|s| Walk::new(*world, *s, seed)));
                }
            }
            let walked = walks::run(&list, seconds, jobs)?;
            print!("{}", walks::table(&walked));
            json.map_or(Ok(()), |path| save(path, &text(&walked)?))
        }
        Command::Graphs { data, only, times, write } => {
            let rows = graphs::run(&data.unwrap_or_else(data_folder), only.as_deref(), times)?;
            print!("{}", graphs::table(&rows));
            if write {
                save(
                    concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/graphs.md").into(),
                    &graphs::page(&rows),
                )?;
            }
            Ok(())
        }
        Command::Revisit { trials, seeds, from, worlds, sensors, verbose, config } => {
            let config = config.map_or_else(|| Ok(Config::default()), |path| read_config(&path))?;
            let sensors = if sensors.is_empty() { Sensor::ALL.to_vec() } else { sensors };
            let alternating = [WorldKind::Corridor, WorldKind::Hall, WorldKind::Street];
            for seed in from..from + seeds {
                for trial in &trials {
                    let world = match (*trial, worlds.is_empty()) {
                        (Trial::Alike, true) => WorldKind::Office,
                        (_, true) => alternating[seed as usize % alternating.len()],
                        (_, false) => worlds[seed as usize % worlds.len()],
                    };
                    for sensor in &sensors {
                        let walk = Revisit { trial: *trial, world, sensor: *sensor, seed };
                        println!("{}", revisit::line(&walk.run(&config, verbose)?));
                    }
                }
            }
            Ok(())
        }
        Command::DepthScale { seeds, config } => {
            let config = config.map_or_else(|| Ok(Config::default()), |path| read_config(&path))?;
            print!("{}", depth_scale::table(&depth_scale::run(seeds, &config)?));
            Ok(())
        }
        Command::Halves { data } => {
            let data = data.unwrap_or_else(data_folder);
            let rows: Result<Vec<_>, String> = RECORDINGS.iter().map(|r| halves::run(&data, r)).collect();
            print!("{}", halves::table(&rows?));
            Ok(())
        }
        Command::NextDay { seeds, sensors, starts, each } => {
            let sensors = if sensors.is_empty() { Sensor::ALL.to_vec() } else { sensors };
            for sensor in sensors {
                let mut all = Vec::new();
                for seed in 1..=seeds {
                    let world = WORLDS[seed as usize % WORLDS.len()];
                    let day = Day::walk(world, sensor, seed)?;
                    let found = nextday::starts(&day, seed, starts, each)?;
                    eprintln!("{world} seed {seed} {}:\n{}", sensor.name(), nextday::table(&found));
                    all.extend(found);
                }
                println!("{}:\n{}", sensor.name(), nextday::table(&all));
            }
            Ok(())
        }
        Command::Long { world, sensor, minutes } => {
            let seconds = minutes * 60.0;
            let address = format!("sim:{world}?way=long&sensor={}&rate=15&duration={seconds}", sensor.name());
            let mut source = open(&address, OpenOptions::default()).map_err(|e| e.to_string())?;
            print!("{}", long::table(&long::run(source.as_mut(), sensor)?));
            Ok(())
        }
        Command::Live { minutes, json } => {
            let measured = live::run(minutes)?;
            print!("{}", live::table(&measured));
            json.map_or(Ok(()), |path| save(path, &text(&measured)?))
        }
        Command::Busy { pairs, frames, seed, sensor } => {
            let walk = Revisit { trial: Trial::Laps, world: WorldKind::Hall, sensor, seed };
            print!("{}", busy::table(&busy::run(&walk, pairs, frames)?));
            Ok(())
        }
        Command::Store { key_frames, features, times, folder, json } => {
            let folder = folder.unwrap_or_else(std::env::temp_dir);
            let stored = store::run(&folder, key_frames, features, times)?;
            print!("{}", store::table(&stored));
            json.map_or(Ok(()), |path| save(path, &text(&stored)?))
        }
        Command::Street { metres, features, times, folder, json } => {
            let folder = folder.unwrap_or_else(std::env::temp_dir);
            let figures = street::run(&folder, metres, features, times)?;
            print!("{}", street::table(&figures));
            json.map_or(Ok(()), |path| save(path, &text(&figures)?))
        }
        Command::Dense { data, only, json } => {
            let rows = dense::run(&data.unwrap_or_else(data_folder), &only)?;
            print!("{}", dense::table(&rows));
            json.map_or(Ok(()), |path| save(path, &text(&rows)?))
        }
        Command::Places { data, vocab, loops, verbose, write } => {
            let data = data.unwrap_or_else(data_folder);
            let text = places::run(&data, &vocab, loops, verbose)?;
            print!("{text}");
            let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/places.md");
            if write { save(path.into(), &places::page::page(&text)) } else { Ok(()) }
        }
        Command::Inertial { data, only, condition, every, json, write } => {
            let chosen =
                inertial::Chosen { recording: only.as_deref(), condition: condition.as_deref(), every };
            let figures = inertial::run(&data.unwrap_or_else(data_folder), &chosen)?;
            print!("{}", inertial::tables(&figures));
            if write {
                let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/inertial.md");
                save(path.into(), &inertial::page(&figures))?;
            }
            json.map_or(Ok(()), |path| save(path, &text(&figures)?))
        }
        Command::VisualInertial {
            data,
            trials,
            only,
            condition,
            sensors,
            seconds,
            seeds,
            from,
            delays,
            most_frames,
            noise,
            metres,
            times,
            config,
            verbose,
            json,
            write,
        } => {
            let chosen = visual_inertial::Chosen {
                trials,
                only,
                condition,
                sensors,
                seconds,
                seeds: from..=from + seeds.saturating_sub(1),
                delays,
                most_frames,
                noise,
                metres,
                times,
                config: config.map_or_else(|| Ok(Config::default()), |path| read_config(&path))?,
                verbose,
            };
            let measured = visual_inertial::run(&data.unwrap_or_else(data_folder), &chosen)?;
            print!("{}", visual_inertial::tables(&measured));
            if write {
                let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/visual-inertial.md");
                save(path.into(), &visual_inertial::page(&measured))?;
            }
            json.map_or(Ok(()), |path| save(path, &text(&measured)?))
        }
        Command::One { source, data, sensor, frames, verbose, config } => {
            let config = match config {
                Some(path) => read_config(&path)?,
                None => Config::default(),
            };
            let measured = match recording(&source) {
                Some(r) => {
                    let config = MeasureOptions { frames, verbose, config, ..MeasureOptions::new(r.sensor) };
                    accuracy::run_here(&data.unwrap_or_else(data_folder), &r, &config)?
                }
                None => {
                    let mut source = open(&source, OpenOptions::default()).map_err(|e| e.to_string())?;
                    measure(
                        source.as_mut(),
                        &MeasureOptions { frames, verbose, config, ..MeasureOptions::new(sensor) },
                    )?
                }
            };
            println!("{}", text(&measured)?);
            Ok(())
        }
    }
}

fn text(value: &impl serde::Serialize) -> Result<String, String> {
    serde_json::to_string_pretty(value).map_err(|e| e.to_string())
}

fn save(path: PathBuf, text: &str) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", path.display());
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    std::fs::write(&path, text).map_err(failed)
}
