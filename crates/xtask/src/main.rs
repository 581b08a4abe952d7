//! `xtask`: measurements of the whole engine. Tables on stdout, progress on stderr.

use cairn_engine::Config;
use cairn_sim::WorldKind;
use cairn_sources::{OpenOptions, open};
use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use xtask::nextday::{self, Day};
use xtask::recordings::{RECORDINGS, data_folder, recording};
use xtask::revisit::{Revisit, Trial};
use xtask::walks::{WORLDS, Walk};
use xtask::{
    MeasureOptions, Sensor, accuracy, busy, graphs, halves, inertial, live, long, measure, places, revisit,
    store, visual_inertial, walks,
};

/// Measures the whole engine.
#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The real recordings: ATE, coverage, step times, memory; each twice.
    Accuracy {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only rows whose name holds this.
        #[arg(long)]
        only: Option<String>,
        /// Runs of each.
        #[arg(long, default_value_t = 2)]
        times: usize,
        /// Write all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Write docs/accuracy.md.
        #[arg(long)]
        write: bool,
    },
    /// Simulated walks: drift and coverage per world and sensor.
    Walks {
        /// Seeds from 0; the worlds take turns.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// Leave out the seeds before this one.
        #[arg(long, default_value_t = 0)]
        from: u64,
        /// Worlds, with commas.
        #[arg(long, value_delimiter = ',')]
        worlds: Vec<WorldKind>,
        /// Sensors, with commas.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensor>,
        /// Seconds of each walk.
        #[arg(long, default_value_t = 40.0)]
        seconds: f64,
        /// Every seed in every world.
        #[arg(long)]
        all: bool,
        /// Walks at a time.
        #[arg(long, default_value_t = 1)]
        jobs: usize,
        /// Write all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// The pose graphs: known optima from the odometry start, times.
    Graphs {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only graphs whose name holds this.
        #[arg(long)]
        only: Option<String>,
        /// Repetitions of each solve.
        #[arg(long, default_value_t = 15)]
        times: usize,
        /// Write docs/graphs.md.
        #[arg(long)]
        write: bool,
    },
    /// Walks that come back: laps with closing and without, a black lens around a corner, rooms that look alike.
    Revisit {
        /// laps, laps-open, dark, alike; with commas.
        #[arg(long, value_delimiter = ',', value_enum)]
        trials: Vec<Trial>,
        /// How many seeds.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// The first of them.
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Worlds, with commas; corridor, hall and street take turns else.
        #[arg(long, value_delimiter = ',')]
        worlds: Vec<WorldKind>,
        /// Sensors, with commas.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensor>,
        /// Tell of every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Settings in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
    },
    /// The first half of each recording is mapped and saved, the second half found in it.
    Halves {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
    },
    /// A map of one walk, and starts in its middle on another day: recall by distance and angle.
    NextDay {
        /// Seeds from 1; corridor, office, hall and street take turns.
        #[arg(long, default_value_t = 4)]
        seeds: u64,
        /// Sensors, with commas.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensor>,
        /// Starts of each day half a metre beside the way.
        #[arg(long, default_value_t = 10)]
        starts: usize,
        /// Starts of each day at each distance and angle of the curve.
        #[arg(long, default_value_t = 2)]
        each: usize,
    },
    /// Minutes of laps: step time, memory and map, minute by minute.
    Long {
        /// World.
        #[arg(long, default_value = "hall")]
        world: WorldKind,
        /// Sensor.
        #[arg(long, default_value = "stereo")]
        sensor: Sensor,
        /// Minutes.
        #[arg(long, default_value_t = 10.0)]
        minutes: f64,
    },
    /// How much a tracking step is slowed by the adjustment of a whole world beside it: threaded, paired, at the camera's pace.
    Busy {
        /// Pairs of runs.
        #[arg(long, default_value_t = 5)]
        pairs: usize,
        /// Frames of each run.
        #[arg(long, default_value_t = 400)]
        frames: usize,
        /// Seed of the hall.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Sensor.
        #[arg(long, default_value = "stereo")]
        sensor: Sensor,
    },
    /// Saves and opens a large map: seconds, and bytes of each kind of part.
    Store {
        /// Key frames.
        #[arg(long, default_value_t = 1000)]
        key_frames: usize,
        /// Features of each.
        #[arg(long, default_value_t = 1000)]
        features: usize,
        /// Times to save and open.
        #[arg(long, default_value_t = 5)]
        times: usize,
        /// Folder to save in; default the system's for temporary files.
        #[arg(long)]
        folder: Option<PathBuf>,
        /// Write all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// How well places are recognised: photographs with a loop matrix, worlds and recordings with true poses, costs.
    Places {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Another vocabulary than the embedded one; may be given several times, for a comparison.
        #[arg(long)]
        vocab: Vec<PathBuf>,
        /// Only the photographs.
        #[arg(long)]
        loops: bool,
        /// Tell of every pair that geometry looked at on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Write docs/places.md.
        #[arg(long)]
        write: bool,
    },
    /// Real inertial sensors on real motion, true poses in place of an eye: drift, initialisation, time offset.
    Inertial {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Only recordings whose name holds this.
        #[arg(long)]
        only: Option<String>,
        /// Only conditions whose name holds this.
        #[arg(long)]
        condition: Option<String>,
        /// Every so-many-th start.
        #[arg(long, default_value_t = 1)]
        every: usize,
        /// Write all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Write docs/inertial.md.
        #[arg(long)]
        write: bool,
    },
    /// The whole engine with an inertial sensor: EuRoC MH_01, rooms around real motions with their real readings, a turn
    /// before plain walls, a minute of standing, costs.
    VisualInertial {
        /// Folder of the recordings; default CAIRN_DATA, else ../shared/data.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Which trials, with commas.
        #[arg(long, value_delimiter = ',', value_enum, default_value = "recorded,semi-real,turn,rest,cost")]
        trials: Vec<visual_inertial::Trial>,
        /// Only real motions whose name holds this.
        #[arg(long)]
        only: Option<String>,
        /// Only conditions whose name holds this ("as recorded", "half the rate", "20 ms", "lost", "bias").
        #[arg(long)]
        condition: Option<String>,
        /// Sensors, with commas; without it those of each trial. Without -imu the inertial sensor is left alone.
        #[arg(long, value_delimiter = ',')]
        sensors: Vec<Sensor>,
        /// So many seconds of each real motion; without it all of it with its readings as recorded, 20 s of it with worse ones.
        #[arg(long)]
        seconds: Option<f64>,
        /// Seeds of the turns.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// Leave out the seeds before this one.
        #[arg(long, default_value_t = 1)]
        from: u64,
        /// Runs of each for the cost.
        #[arg(long, default_value_t = 3)]
        times: usize,
        /// Settings in TOML that differ from the defaults.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Tell of every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Write all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Write docs/visual-inertial.md.
        #[arg(long)]
        write: bool,
    },
    /// A live stream: from the publisher over RTMP to the pose, and from the pose to words. Needs ffmpeg.
    Live {
        /// Minutes.
        #[arg(long, default_value_t = 1.0)]
        minutes: f64,
        /// Write all figures as JSON here.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// One recording by its row's name, or any source with --sensor; prints JSON.
    One {
        /// Name of a row, a folder, or sim:WORLD.
        source: String,
        /// Folder of the recordings.
        #[arg(long)]
        data: Option<PathBuf>,
        /// Sensors of a source that is no row.
        #[arg(long, default_value = "stereo")]
        sensor: Sensor,
        /// Packets at most.
        #[arg(long, default_value_t = usize::MAX)]
        frames: usize,
        /// Tell of every frame on stderr.
        #[arg(long, short)]
        verbose: bool,
        /// Settings in TOML that differ from the defaults.
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
            eprintln!("xtask: {why}");
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
            let turns = [WorldKind::Corridor, WorldKind::Hall, WorldKind::Street];
            for seed in from..from + seeds {
                for trial in &trials {
                    let world = match (*trial, worlds.is_empty()) {
                        (Trial::Alike, true) => WorldKind::Office,
                        (_, true) => turns[seed as usize % turns.len()],
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
