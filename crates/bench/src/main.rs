//! `bench`: measurements of the whole engine. Tables on stdout, progress on stderr.

mod arguments;

use arguments::{Arguments, Command};
use bench::MeasureError;
use bench::nextday::{self, Day};
use bench::recordings::{RECORDINGS, data_folder, recording};
use bench::revisit::{Revisit, Trial};
use bench::walks::{WORLDS, Walk};
use bench::{
    RunOptions, Sensors, accuracy, busy, city, dense, depth_scale, figures, graphs, halves, imu_faults,
    inertial, live, long, measure, phone, places, revisit, scale_sigma, store, street, visual_inertial,
    walks,
};
use cairn_engine::Config;
use cairn_sim::WorldKind;
use cairn_sources::{OpenOptions, open};
use clap::Parser;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn read_config(path: &Path) -> Result<Config, MeasureError> {
    let text = std::fs::read_to_string(path).map_err(MeasureError::file(path))?;
    Config::from_toml(&text).map_err(|e| MeasureError::of(path.display(), e.to_string()))
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

fn run(command: Command) -> Result<(), MeasureError> {
    match command {
        Command::Accuracy { data, only, times, json, write } => {
            let rows = accuracy::run(&data.unwrap_or_else(data_folder), only.as_deref(), times)?;
            print!("{}", accuracy::table(&rows));
            if write {
                save(
                    concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/figures/accuracy.md").into(),
                    &accuracy::page(&rows),
                )?;
                let readme: PathBuf = concat!(env!("CARGO_MANIFEST_DIR"), "/../../README.md").into();
                let text = std::fs::read_to_string(&readme).map_err(MeasureError::file(&readme))?;
                let text = accuracy::readme(&text, &rows)?;
                save(readme, &text)?;
            }
            json.map_or(Ok(()), |path| save(path, &text(&rows)?))
        }
        Command::Walks { seeds, from, worlds, sensors, seconds, all, drawn, write, jobs, json } => {
            let worlds = if worlds.is_empty() { WORLDS.to_vec() } else { worlds };
            let sensors = if sensors.is_empty() { Sensors::VISUAL.to_vec() } else { sensors };
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
            if let Some(number) = drawn {
                let others: Vec<Walk> = list.iter().map(|walk| walk.drawn(number)).collect();
                let table = walks::compared(&walked, &walks::run(&others, seconds, jobs)?);
                print!("\n{table}");
                if write {
                    let figures = format!("Seeds drawn from {number}:\n\n{table}");
                    put("figures/revisits.md", "walks", &figures)?;
                }
            }
            json.map_or(Ok(()), |path| save(path, &text(&walked)?))
        }
        Command::Figures => {
            let all = figures::run(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")))?;
            print!("{}", figures::table(&all));
            Ok(())
        }
        Command::Graphs { data, only, times, write } => {
            let rows = graphs::run(&data.unwrap_or_else(data_folder), only.as_deref(), times)?;
            print!("{}", graphs::table(&rows));
            if write {
                save(
                    concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/figures/graphs.md").into(),
                    &graphs::page(&rows),
                )?;
            }
            Ok(())
        }
        Command::Revisit { trials, seeds, from, worlds, sensors, verbose, config } => {
            let config = config.map_or_else(|| Ok(Config::default()), |path| read_config(&path))?;
            let sensors = if sensors.is_empty() { Sensors::VISUAL.to_vec() } else { sensors };
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
        Command::ScaleSigma { data, only, seeds } => {
            let data = data.unwrap_or_else(data_folder);
            print!("{}", scale_sigma::table(&scale_sigma::run(&data, only.as_deref(), seeds)?));
            Ok(())
        }
        Command::ImuFaults { data, recording, faults, sensors, seeds, from, dark, config, json } => {
            let config = config.map_or_else(|| Ok(Config::default()), |path| read_config(&path))?;
            let dark_s = dark;
            let chosen = imu_faults::Chosen { recording, faults, sensors, seeds, from, dark_s, config };
            let rows = imu_faults::run(&data.unwrap_or_else(data_folder), &chosen)?;
            print!("{}", imu_faults::table(&rows));
            json.map_or(Ok(()), |path| save(path, &text(&rows)?))
        }
        Command::Halves { data } => {
            let data = data.unwrap_or_else(data_folder);
            let rows: Result<Vec<_>, MeasureError> =
                RECORDINGS.iter().map(|r| halves::run(&data, r)).collect();
            print!("{}", halves::table(&rows?));
            Ok(())
        }
        Command::NextDay { seeds, sensors, starts, each } => {
            let sensors = if sensors.is_empty() { Sensors::VISUAL.to_vec() } else { sensors };
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
        Command::Long { world, route, sensor, minutes } => {
            let seconds = minutes * 60.0;
            // No lap takes less than half a minute.
            let (laps, sensor_name) = (2.0 * minutes.ceil() + 1.0, sensor.name());
            let address = format!(
                "sim:{world}?route={route}&laps={laps}&sensor={sensor_name}&rate=15&duration={seconds}"
            );
            let mut source = open(&address, OpenOptions::default())?;
            print!("{}", long::table(&long::run(source.as_mut(), sensor)?));
            Ok(())
        }
        Command::Phone { data, only, starts, config, verbose } => {
            let config = config.map_or_else(|| Ok(Config::default()), |path| read_config(&path))?;
            let chosen = phone::Chosen { only, starts, config, verbose };
            print!("{}", phone::table(&phone::run(&data.unwrap_or_else(data_folder), &chosen)?));
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
        Command::Street { metres, features, times, folder, json, write } => {
            let folder = folder.unwrap_or_else(std::env::temp_dir);
            let figures = street::run(&folder, metres, features, times)?;
            let table = street::table(&figures);
            print!("{table}");
            if write {
                put("figures/large-maps.md", "street", &format!("```text\n{table}```"))?;
            }
            json.map_or(Ok(()), |path| save(path, &text(&figures)?))
        }
        Command::City { walks, metres, meets, shards, among, words, folder } => {
            let folder = folder.unwrap_or_else(std::env::temp_dir);
            let mut rows = Vec::new();
            for walks in walks {
                let city = city::City { walks, metres, meets, shards, among: among.clone(), words };
                rows.push(city.build(&folder)?);
                print!("{}", city::table(&rows));
            }
            Ok(())
        }
        Command::Dense { data, only, json, write } => {
            let rows = dense::run(&data.unwrap_or_else(data_folder), &only)?;
            let table = dense::table(&rows);
            print!("{table}");
            if write {
                put("figures/dense.md", "dense", &table)?;
            }
            json.map_or(Ok(()), |path| save(path, &text(&rows)?))
        }
        #[cfg(unix)]
        Command::Kills { data, times, write } => {
            let table = bench::kills::table(&bench::kills::run(&data.unwrap_or_else(data_folder), times)?);
            print!("{table}");
            if write { put("figures/processes.md", "kills", &table) } else { Ok(()) }
        }
        #[cfg(unix)]
        Command::Worker { role } => bench::kills::work(&role),
        Command::Places { data, vocab, loops, verbose, write } => {
            let data = data.unwrap_or_else(data_folder);
            let text = places::run(&data, &vocab, loops, verbose)?;
            print!("{text}");
            let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/figures/places.md");
            if write { save(path.into(), &places::page::page(&text)) } else { Ok(()) }
        }
        Command::Inertial { data, only, condition, every, json, write } => {
            let chosen =
                inertial::Chosen { recording: only.as_deref(), condition: condition.as_deref(), every };
            let figures = inertial::run(&data.unwrap_or_else(data_folder), &chosen)?;
            print!("{}", inertial::tables(&figures));
            if write {
                let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/figures/inertial.md");
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
            every,
            guessed_lens,
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
                every,
                guessed_lens,
                times,
                config: config.map_or_else(|| Ok(Config::default()), |path| read_config(&path))?,
                verbose,
            };
            let measured = visual_inertial::run(&data.unwrap_or_else(data_folder), &chosen)?;
            print!("{}", visual_inertial::tables(&measured));
            if write {
                let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/figures/visual-inertial.md");
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
                    let config = RunOptions { frames, verbose, config, ..RunOptions::new(r.sensor) };
                    accuracy::run_here(&data.unwrap_or_else(data_folder), &r, &config)?
                }
                None => {
                    let mut source = open(&source, OpenOptions::default())?;
                    measure(
                        source.as_mut(),
                        &RunOptions { frames, verbose, config, ..RunOptions::new(sensor) },
                    )?
                }
            };
            println!("{}", text(&measured)?);
            Ok(())
        }
    }
}

fn text(value: &impl serde::Serialize) -> Result<String, MeasureError> {
    Ok(serde_json::to_string_pretty(value)?)
}

fn save(path: PathBuf, text: &str) -> Result<(), MeasureError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(MeasureError::file(folder))?;
    }
    std::fs::write(&path, text).map_err(MeasureError::file(&path))
}

/// Writes these figures into a page of `docs/`.
fn put(page: &str, name: &str, figures: &str) -> Result<(), MeasureError> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs")).join(page);
    let text = std::fs::read_to_string(&path).map_err(MeasureError::file(&path))?;
    save(path, &bench::pages::with_figures(&text, name, figures)?)
}
