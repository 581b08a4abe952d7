//! `bench`: measurements of the whole engine. Tables on stdout, progress on stderr.

mod arguments;

use arguments::{Arguments, Command, RunArguments};
use bench::error::{file, of};
use bench::scenario::{Bindings, Chosen, Scenario};
use bench::{
    MeasureError, RunOptions, busy, data_folder, dense, ekf, figures, graphs, guide, halves, inertial, live,
    measure, nextday, pages, places, robot, scale_sigma, scenario, spot, store, street, surface,
};
use cairn_engine::Config;
use cairn_sources::{OpenOptions, open};
use clap::Parser;
use serde::Serialize;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// What a command measured.
#[derive(Default)]
struct Measured {
    /// What is printed.
    text: String,
    /// What `--write` puts where: a page below the root of the checkout, the name of the figures there, and their text.
    pages: Vec<(PathBuf, String, String)>,
    /// What `--json` writes, where the command has it.
    json: Option<Value>,
    /// What it puts beside them: files below the root of the checkout.
    files: Vec<(PathBuf, String)>,
    /// What is beyond a limit.
    beyond: Vec<String>,
}

impl Measured {
    fn new(text: String) -> Self {
        Self { text, ..Self::default() }
    }

    /// The text stands on a page too.
    fn on(mut self, page: &str, name: &str, text: String) -> Self {
        self.pages.push((Path::new("docs/figures").join(page), name.into(), text));
        self
    }

    fn json(mut self, value: &impl Serialize) -> Result<Self, MeasureError> {
        self.json = Some(serde_json::to_value(value)?);
        Ok(self)
    }
}

fn main() -> ExitCode {
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("bench: {why}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<(), MeasureError> {
    if let Command::Robot { first, count } = arguments.command {
        let page = Path::new(ROOT).join("docs/figures/plan.md");
        return robot::run(first..first + count, arguments.write.then_some(&*page));
    }
    let measured = measured(arguments.command, &arguments.data.unwrap_or_else(data_folder))?;
    print!("{}", measured.text);
    if let Some(path) = arguments.json {
        let json = measured.json.ok_or("this has no figures in JSON")?;
        std::fs::write(&path, serde_json::to_string_pretty(&json)?).map_err(file(&path))?;
    }
    if arguments.write {
        if measured.pages.is_empty() {
            return Err("these figures have no page in docs/".into());
        }
        for (page, name, text) in measured.pages {
            let path = Path::new(ROOT).join(page);
            let page = std::fs::read_to_string(&path).map_err(file(&path))?;
            let page = pages::with_figures(&page, &name, &text)?;
            std::fs::write(&path, page).map_err(file(&path))?;
        }
        for (path, text) in measured.files {
            let path = Path::new(ROOT).join(path);
            std::fs::write(&path, text).map_err(file(&path))?;
        }
    }
    match measured.beyond.is_empty() {
        true => Ok(()),
        false => Err(measured.beyond.join("\n").into()),
    }
}

fn measured(command: Command, data: &Path) -> Result<Measured, MeasureError> {
    let folder = |folder: Option<PathBuf>| folder.unwrap_or_else(std::env::temp_dir);
    match command {
        Command::Run(chosen) => run_scenario(chosen, data),
        Command::Figures => Ok(Measured::new(figures::table(&figures::run(Path::new(ROOT))?))),
        Command::Graphs { only, times } => {
            let table = graphs::table(&graphs::run(data, only.as_deref(), times)?);
            Ok(Measured::new(table.clone()).on("graphs.md", "graphs", table))
        }
        Command::ScaleSigma { only, seeds } => {
            let rows = scale_sigma::run(data, only.as_deref(), seeds)?;
            Measured::new(scale_sigma::table(&rows)).json(&rows)
        }
        Command::Halves => {
            let rows = halves::all(data)?;
            Measured::new(halves::table(&rows)).json(&rows)
        }
        Command::NextDay { seeds, sensors, starts, each } => {
            Ok(Measured::new(nextday::tables(seeds, &sensors, starts, each)?))
        }
        Command::Spot { seeds, from, delays, metres, every, guessed_lens, config, verbose } => {
            let chosen = spot::Chosen { seeds: from..from + seeds, delays, metres, every, guessed_lens };
            Ok(Measured::new(spot::table(&chosen, &read_config(config)?, verbose)?))
        }
        Command::Busy { pairs, frames, seed, sensor } => {
            Ok(Measured::new(busy::table(&busy::run(seed, sensor, pairs, frames)?)))
        }
        Command::Street { metres, features, times, folder: chosen } => {
            let figures = street::run(&folder(chosen), metres, features, times)?;
            let table = street::table(&figures);
            let on_page = format!("```text\n{table}```");
            Measured::new(table).on("large-maps.md", "street", on_page).json(&figures)
        }
        #[cfg(unix)]
        Command::City { walks, metres, meets, shards, among, words, folder: chosen } => {
            let mut rows = Vec::new();
            for walks in walks {
                let city = bench::city::City { walks, metres, meets, shards, among: among.clone(), words };
                rows.push(city.build(&folder(chosen.clone()))?);
                eprint!("{}", bench::city::table(&rows));
            }
            Ok(Measured::new(bench::city::table(&rows)))
        }
        Command::Store { key_frames, features, times, folder: chosen } => {
            let stored = store::run(&folder(chosen), key_frames, features, times)?;
            Measured::new(store::table(&stored)).json(&stored)
        }
        Command::Dense { only } => {
            let rows = dense::run(data, &only)?;
            let table = dense::table(&rows);
            Measured::new(table.clone()).on("dense.md", "dense", table).json(&rows)
        }
        #[cfg(unix)]
        Command::Kills { times } => {
            let rows = bench::kills::run(data, times)?;
            let table = bench::kills::table(&rows);
            Measured::new(table.clone()).on("processes.md", "kills", table).json(&rows)
        }
        #[cfg(unix)]
        Command::Worker { role } => bench::kills::work(&role).map(|()| Measured::default()),
        Command::Places { vocab, loops, verbose } => {
            let text = places::run(data, &vocab, loops, verbose)?;
            Ok(Measured::new(text.clone()).on("places.md", "places", text))
        }
        Command::Inertial { only, condition, every } => {
            let chosen =
                inertial::Chosen { recording: only.as_deref(), condition: condition.as_deref(), every };
            let figures = inertial::run(data, &chosen)?;
            let tables = inertial::tables(&figures);
            Measured::new(tables.clone()).on("inertial.md", "inertial", tables).json(&figures)
        }
        Command::Ekf { only } => {
            let mut measured = Measured::default();
            for name in only {
                let text = ekf::section(data, &name)?;
                measured.text += &format!("{text}\n");
                measured = measured.on("ekf.md", &name, text);
            }
            Ok(measured)
        }
        Command::Guide { row: Some(row), seed: Some(seed), .. } => Ok(Measured::new(guide::one(seed, row))),
        Command::Guide { ways, from, row, .. } => {
            let guide::Figures { text, table, broken, worst } = guide::run(from..from + ways, row);
            let mut measured =
                Measured { beyond: broken, ..Measured::new(text) }.on("guide.md", "guide", table);
            let name = |k: usize| Path::new("docs/figures").join(format!("guide-worst-{}.txt", k + 1));
            measured.files = worst.into_iter().enumerate().map(|(k, text)| (name(k), text)).collect();
            Ok(measured)
        }
        Command::Live { minutes } => {
            let figures = live::run(minutes)?;
            Measured::new(live::table(&figures)).json(&figures)
        }
        Command::Robot { .. } => Ok(Measured::default()),
        Command::Surface { address, voxel, covered } => {
            let covered_s = match covered[..] {
                [] => [0.0; 2],
                [from, to] => [from, to],
                _ => return Err("--covered: write FROM,TO in seconds".into()),
            };
            surface::run(&address, voxel, covered_s).map(|()| Measured::default())
        }
        Command::One { source, sensor, frames, verbose, config } => {
            let mut source = open(&source, OpenOptions::default())?;
            let config = read_config(config)?;
            let options = RunOptions { frames, verbose, config, ..RunOptions::new(sensor) };
            let figures = measure(source.as_mut(), &options)?;
            Measured::new(serde_json::to_string_pretty(&figures)? + "\n").json(&figures)
        }
    }
}

fn run_scenario(arguments: RunArguments, data: &Path) -> Result<Measured, MeasureError> {
    let RunArguments { scenario: name, set, times, jobs, config, verbose, here } = arguments;
    let Some(name) = name else {
        let all = Scenario::all()?;
        return Ok(Measured::new(all.iter().map(|(name, about)| format!("{name:<14} {about}\n")).collect()));
    };
    let pairs = set.iter().map(|pair| {
        let pair = pair.split_once('=').ok_or_else(|| format!("--set {pair}: write NAME=VALUE"))?;
        Ok((pair.0.to_owned(), pair.1.to_owned()))
    });
    let set = pairs.collect::<Result<Bindings, MeasureError>>()?;
    let config = config.map_or_else(|| Ok(String::new()), |path| read(&path))?;
    let scenario = Scenario::read(&name)?;
    let chosen = Chosen { name, set, data: data.to_owned(), times, jobs, config, verbose, here };
    let rows = scenario::run(&scenario, &chosen)?;
    if here {
        return Ok(Measured::new(serde_json::to_string(&rows)?));
    }
    let mut measured =
        Measured { beyond: scenario::judge(&scenario, &rows)?, ..Measured::default() }.json(&rows)?;
    let stem = Path::new(&chosen.name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    for (table, text) in scenario::tables(&scenario, &rows)? {
        measured.text += &format!("{text}\n");
        measured.pages.extend(table.page.clone().map(|page| (page, stem.clone(), text)));
    }
    Ok(measured)
}

fn read(path: &Path) -> Result<String, MeasureError> {
    std::fs::read_to_string(path).map_err(file(path))
}

fn read_config(path: Option<PathBuf>) -> Result<Config, MeasureError> {
    let Some(path) = path else { return Ok(Config::default()) };
    Config::from_toml(&read(&path)?).map_err(|e| of(path.display(), e.to_string()))
}
