//! Runs a scenario: each run in its turn or several beside each other, in this process or each in its own.

use super::{Bindings, Scenario, fill};
use crate::error::of;
use crate::inertial::exact_scale;
use crate::newcomers;
use crate::run::{Figures, RunOptions, measure};
use crate::source::{Conditions, Cover, fault, open_under, phone};
use crate::{MeasureError, Sensors};
use cairn_engine::{Config, Delays, Runner, with_found_lens};
use cairn_random::Random;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What of a scenario is run, and how.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Name or path of the scenario.
    pub name: String,
    /// Values of axes and bindings.
    pub set: Bindings,
    /// The folder of the recordings.
    pub data: PathBuf,
    /// Runs of each, instead of those that the scenario asks for.
    pub times: Option<usize>,
    /// Runs beside each other.
    pub jobs: usize,
    /// Configuration entries in TOML that differ from the defaults.
    pub config: String,
    /// Prints every frame on stderr.
    pub verbose: bool,
    /// Everything is run in this process, even where the scenario asks for one of its own.
    pub here: bool,
}

/// A run: its bindings, its figures, and what several of the same show.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// The bindings.
    pub bindings: Bindings,
    /// The figures as a tree of JSON; of several runs those of the fastest, which other load on the machine disturbed least.
    pub figures: Value,
    /// Whether several runs gave the same bits: yes, NO, or not run.
    pub bit_identical: String,
}

impl Row {
    /// A binding or a figure by its name, `map.loops`.
    ///
    /// # Errors
    /// When there is neither.
    pub fn value(&self, name: &str) -> Result<Value, MeasureError> {
        if let Some(text) = self.bindings.get(name) {
            return Ok(Value::String(text.clone()));
        }
        if name == "bit_identical" {
            return Ok(Value::String(self.bit_identical.clone()));
        }
        let mut at = &self.figures;
        for part in name.split('.') {
            at = match at {
                // A group of figures that this run does not have.
                Value::Null => return Ok(Value::Null),
                at => match part.parse::<usize>() {
                    Ok(index) => at.get(index),
                    Err(_) => at.get(part),
                }
                .ok_or_else(|| format!("there is no figure {name}"))?,
            };
        }
        Ok(at.clone())
    }

    /// The figures by their types.
    ///
    /// # Errors
    /// When they are not complete.
    pub fn figures(&self) -> Result<Figures, MeasureError> {
        Ok(serde_json::from_value(self.figures.clone())?)
    }

    /// A row for each part of the run.
    pub fn parts(&self) -> Vec<Row> {
        let parts = self.figures["parts"].as_array().cloned().unwrap_or_default();
        parts.into_iter().map(|figures| Row { figures, ..self.clone() }).collect()
    }
}

/// Runs what is chosen of a scenario; progress and missing recordings are reported on stderr.
///
/// # Errors
/// The first run that failed, in order.
pub fn run(scenario: &Scenario, chosen: &Chosen) -> Result<Vec<Row>, MeasureError> {
    let mut runs = scenario.runs(&chosen.set)?;
    for run in &mut runs {
        run.insert("data".into(), chosen.data.to_string_lossy().into_owned());
    }
    let work = |run: &Bindings| -> Result<Option<Row>, MeasureError> {
        let address = fill(&scenario.run.address, run)?;
        if !address.starts_with("sim:") && !Path::new(&address).exists() {
            eprintln!("skipped: {address} is not there");
            return Ok(None);
        }
        let row = repeated(scenario, chosen, run).map_err(|e| of(&address, e))?;
        match &row.figures["end"] {
            Value::String(end) => eprintln!("{address}: {end}"),
            _ => {
                let [ate_m, coverage] = ["ate_m", "coverage"].map(|name| &row.figures[name]);
                eprintln!("{address}: ATE {ate_m} m, coverage {coverage}");
            }
        }
        Ok(Some(row))
    };
    Ok(beside(&runs, chosen.jobs, work)?.into_iter().flatten().collect())
}

/// Does work on each of a list, several beside each other; results in order.
fn beside<T: Sync, R: Send>(
    list: &[T],
    jobs: usize,
    work: impl Fn(&T) -> Result<R, MeasureError> + Sync,
) -> Result<Vec<R>, MeasureError> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, 64) {
            scope.spawn(|| {
                while let Some((at, one)) = {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    list.get(at).map(|one| (at, one))
                } {
                    let result = work(one);
                    done.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((at, result));
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, result)| result).collect()
}

fn repeated(scenario: &Scenario, chosen: &Chosen, run: &Bindings) -> Result<Row, MeasureError> {
    let option = |name: &str| option(scenario, run, name);
    let times = chosen.times.or(option("times")?.parse().ok()).unwrap_or(1);
    let own_process = option("own_process")? == "yes" && !chosen.here;
    let mut rows = Vec::new();
    for _ in 0..times.max(1) {
        rows.push(if own_process { child(scenario, chosen, run)? } else { once(scenario, chosen, run)? });
    }
    let same = rows.windows(2).all(|w| w[0]["hash"] == w[1]["hash"]);
    let bit_identical = if rows.len() < 2 { "not run" } else { ["NO", "yes"][usize::from(same)] };
    let median = |figures: &Value| figures["times"]["step_ms"]["p50"].as_f64().unwrap_or(f64::INFINITY);
    let fastest = rows.into_iter().min_by(|a, b| median(a).total_cmp(&median(b)));
    Ok(Row {
        bindings: run.clone(),
        figures: fastest.unwrap_or_default(),
        bit_identical: bit_identical.into(),
    })
}

/// Runs in a process of its own, so that its peak memory is measured alone.
fn child(scenario: &Scenario, chosen: &Chosen, run: &Bindings) -> Result<Value, MeasureError> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["run", &chosen.name, "--here", "--times", "1", "--data"]).arg(&chosen.data);
    for axis in &scenario.axis {
        command.arg("--set").arg(format!("{}={}", axis.name, run[&axis.name]));
    }
    for (name, value) in chosen.set.iter().filter(|(name, _)| scenario.axis.iter().all(|a| a.name != **name))
    {
        command.arg("--set").arg(format!("{name}={value}"));
    }
    let out = command.output()?;
    if !out.status.success() {
        let said = String::from_utf8_lossy(&out.stderr).trim().to_owned();
        return Err(MeasureError::from(said));
    }
    let rows: Vec<Row> = serde_json::from_slice(&out.stdout)?;
    Ok(rows.into_iter().next().ok_or("the process ran nothing")?.figures)
}

/// The keys of a run beside address and sensors; without one it is empty.
const OPTIONS: [&str; 17] = [
    // Settings of the engine in TOML.
    "config",
    // See `Cover::parse`; a fault (`source::fault`), when it begins, and seconds for which it is dark from half a second before.
    "cover",
    "fault",
    "fault_at",
    "fault_dark",
    // A number, or none: the fault begins at a moment between `fault_from` and `fault_to` drawn from it.
    "fault_drawn",
    "fault_from",
    "fault_to",
    // A number, or none: latencies of mapping are drawn from it, up to so many frames, and frames are dropped.
    "delays",
    "most_frames",
    // Seconds that are used, and left out at the beginning; seconds of standing at the end.
    "seconds",
    "start",
    "still",
    // Costs are told for each so many seconds.
    "parts",
    // More words, separated by spaces: `phone-noise`, `as-cairn-run`, `turn`, `readout-told`, `exact-scale`; or
    // `newcomer` alone: who walks there has a phone that nobody knows.
    "also",
    // Runs of each, and whether each has a process of its own (yes).
    "times",
    "own_process",
];

fn option(scenario: &Scenario, run: &Bindings, name: &str) -> Result<String, MeasureError> {
    if let Some(unknown) = scenario.run.options.keys().find(|key| !OPTIONS.contains(&key.as_str())) {
        return Err(format!("a run has no {unknown}, it has {}", OPTIONS.join(", ")).into());
    }
    scenario.run.options.get(name).map_or(Ok(String::new()), |text| fill(text, run))
}

fn once(scenario: &Scenario, chosen: &Chosen, run: &Bindings) -> Result<Value, MeasureError> {
    let text = |name: &str| option(scenario, run, name);
    let number = |name: &str| -> Result<Option<f64>, MeasureError> {
        let text = text(name)?;
        let bad = |_| MeasureError::from(format!("{name}={text}: not a number"));
        if text.is_empty() { Ok(None) } else { text.parse().map(Some).map_err(bad) }
    };
    let also = text("also")?;
    let also = |word: &str| also.split(' ').any(|w| w == word);
    if also("newcomer") {
        return Ok(serde_json::to_value(newcomers::of(&fill(&scenario.run.address, run)?, chosen.verbose)?)?);
    }
    let sensors = fill(&scenario.run.sensors, run)?;
    let sensor: Sensors = sensors.parse().map_err(|e| format!("{e}"))?;
    let config = format!("{}\n{}", text("config")?, chosen.config);
    let mut options = RunOptions::new(sensor);
    options.config = Config::from_toml(&config).map_err(|e| format!("{config}: {e}"))?;
    options.verbose = chosen.verbose;
    options.seconds = number("seconds")?.unwrap_or(f64::INFINITY);
    options.parts_s = number("parts")?;
    options.still_s = number("still")?;
    options.turns = also("turn");
    let fault_name = text("fault")?;
    options.fault_at_s = number("fault_at")?.unwrap_or(0.0);
    if let (Some(drawn), Some(from), Some(to)) =
        (number("fault_drawn")?, number("fault_from")?, number("fault_to")?)
    {
        let stream = fault_name.bytes().map(u64::from).sum();
        options.fault_at_s = Random::stream(drawn as u64, stream).uniform(from, to);
    }
    let delays = number("delays")?.map(|seed| seed as u64);
    if let Some(seed) = delays {
        let most_frames = number("most_frames")?.unwrap_or(10.0) as u32;
        options.runner = Runner::Delayed(Delays { seed, most_frames });
    }
    if also("readout-told") {
        let seed = run.get("seed").and_then(|seed| seed.parse().ok()).ok_or("a phone has no seed")?;
        options.config.tracker.readout_s = phone(seed).readout_s;
    }
    let cover = text("cover")?;
    let mut cover =
        Cover::parse(&cover).ok_or_else(|| format!("cover={cover}: write A:B, last:S or corner:S"))?;
    if let Some(dark_s) = number("fault_dark")?.filter(|s| *s > 0.0) {
        let from_s = options.fault_at_s - 0.5;
        cover = Cover::Between(from_s, from_s + dark_s);
    }
    let fault = match fault_name.as_str() {
        "" | "none" => None,
        name => Some(fault(name, options.fault_at_s).ok_or_else(|| format!("there is no fault {name:?}"))?),
    };
    let states_phone = also("phone-noise");
    let start_s = number("start")?.unwrap_or(0.0);
    let conditions = Conditions { start_s, cover, fault, states_phone, drops: delays };
    let address = fill(&scenario.run.address, run)?;
    let mut source = open_under(&address, &conditions)?;
    if also("as-cairn-run") && source.info().assumed.is_some() {
        source = with_found_lens(source, &options.config)?;
        options.config.tracker.estimate_readout |= options.config.tracker.readout_s == 0.0;
        options.config.tracker.clocks_by_flow = true;
    }
    let mut figures = serde_json::to_value(measure(source.as_mut(), &options)?)?;
    if also("exact-scale") {
        figures["exact_scale"] = serde_json::to_value(exact_scale(&address)?)?;
    }
    Ok(figures)
}

/// What of the figures is beyond a limit of the scenario, one line each.
///
/// # Errors
/// When a limit names what is not there.
pub fn judge(scenario: &Scenario, rows: &[Row]) -> Result<Vec<String>, MeasureError> {
    let mut beyond = Vec::new();
    for (row, limit) in rows.iter().flat_map(|row| scenario.limit.iter().map(move |limit| (row, limit))) {
        let value = row.value(&limit.figure)?;
        let number = value.as_f64();
        for (bound, least) in [(&limit.most, false), (&limit.least, true)] {
            let bound = fill(bound, &row.bindings)?;
            if bound.is_empty() {
                continue;
            }
            let bound: f64 = bound.parse().map_err(|_| format!("limit {bound:?} is not a number"))?;
            if !number.is_some_and(|v| if least { v >= bound } else { v <= bound }) {
                let address = fill(&scenario.run.address, &row.bindings)?;
                let word = if least { "least" } else { "most" };
                beyond.push(format!(
                    "{address}: {} is {value}, at {word} {bound} ({})",
                    limit.figure, limit.why
                ));
            }
        }
    }
    Ok(beyond)
}
