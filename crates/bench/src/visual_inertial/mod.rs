//! `visual-inertial`: the whole engine with an IMU. A real recording; rendered rooms with real motion and real IMU
//! data; turning round in front of plain walls; one minute of standing still; cost.

pub mod carried;
mod drawn;
pub mod lens;
pub mod live_scale;
pub mod phone;
mod ran;
mod recorded;
mod semi_real;
pub mod spot;
mod walked;

use crate::MeasureError;
use crate::{RunOptions, Sensors};
use cairn_engine::Delays;
use ran::{Figures, HEAD, row};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// A kind of trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Trial {
    /// EuRoC MH_01.
    Recorded,
    /// Rendered rooms with real motion and real IMU data.
    SemiReal,
    /// 20 m out, turning round in front of plain walls, 20 m back.
    Turn,
    /// A minute of standing still.
    Rest,
    /// Out and home with a phone's rates and assumed noise.
    Phone,
    /// Out with a phone, a turn on the spot or a long stand, and the first steps home: how far from the truth.
    Spot,
    /// The lens of a phone.
    Lens,
    /// Times with and without IMU.
    Cost,
}

/// Selection of what is measured.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// The trials.
    pub trials: Vec<Trial>,
    /// Only semi-real recordings whose name contains this.
    pub only: Option<String>,
    /// Only conditions whose name contains this.
    pub condition: Option<String>,
    /// Sensors; if empty, each trial uses its own.
    pub sensors: Vec<Sensors>,
    /// Seconds of each semi-real motion; `None`: all of it as recorded, 20 s with degraded IMU data.
    pub seconds: Option<f64>,
    /// Seeds of the turns.
    pub seeds: std::ops::RangeInclusive<u64>,
    /// Seeds of latencies for each walk of a phone; 0: in lockstep alone.
    pub delays: u64,
    /// Longest time that a key frame keeps mapping busy in these, frames.
    pub most_frames: u32,
    /// The noise of the phone's readings.
    pub noise: phone::Noise,
    /// Metres of the phone's route out.
    pub metres: f64,
    /// Only every nth picture comes in a walk with a turn on the spot.
    pub every: usize,
    /// The engine is given a guess of the phone's lens in such a walk.
    pub guessed_lens: bool,
    /// Runs of each configuration for the cost.
    pub times: usize,
    /// Configuration of the engine.
    pub config: cairn_engine::Config,
    /// Print every frame on stderr.
    pub verbose: bool,
}

impl Chosen {
    fn latencies(&self) -> impl Iterator<Item = Delays> {
        let most_frames = self.most_frames;
        (1..=self.delays).map(move |seed| Delays { seed, most_frames })
    }
}

/// All that was measured.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Measured {
    recorded: Vec<recorded::Recorded>,
    checked: Vec<semi_real::Checked>,
    semi_real: Vec<Figures>,
    turns: Vec<walked::Turn>,
    rests: Vec<walked::Rest>,
    phones: Vec<phone::Walked>,
    #[serde(skip)]
    spots: Vec<spot::Walked>,
    costs: Vec<recorded::Cost>,
}

/// Measures; progress and missing recordings are reported on stderr.
///
/// # Errors
/// When a run fails.
pub fn run(data: &Path, chosen: &Chosen) -> Result<Measured, MeasureError> {
    let options = |usual: &[Sensors]| -> Vec<RunOptions> {
        let sensors = if chosen.sensors.is_empty() { usual } else { &chosen.sensors };
        let of = |s: &Sensors| RunOptions {
            config: chosen.config.clone(),
            verbose: chosen.verbose,
            ..RunOptions::new(*s)
        };
        sensors.iter().map(of).collect()
    };
    let mut out = Measured::default();
    for trial in &chosen.trials {
        match trial {
            Trial::Recorded => {
                out.recorded = recorded::measure(data, &options(&[Sensors::MonoImu, Sensors::StereoImu]))?
            }
            Trial::SemiReal => semi_real(data, chosen, &options(&Sensors::INERTIAL), &mut out)?,
            Trial::Turn => {
                for seed in chosen.seeds.clone() {
                    for options in options(&[Sensors::MonoImu]) {
                        let turn = walked::turn(seed, &options)?;
                        eprint!("{}", row(&turn.figures));
                        out.turns.push(turn);
                    }
                }
            }
            Trial::Rest => {
                for (options, dark) in
                    options(&Sensors::INERTIAL).iter().flat_map(|a| [(a, false), (a, true)])
                {
                    let rest = walked::rest(1, options, dark)?;
                    eprint!("{}", row(&rest.figures));
                    out.rests.push(rest);
                }
            }
            Trial::Phone => {
                for seed in chosen.seeds.clone() {
                    for delays in std::iter::once(None).chain(chosen.latencies().map(Some)) {
                        for options in options(&[Sensors::MonoImu]) {
                            let walked = phone::walk(seed, delays, chosen.noise, chosen.metres, &options)?;
                            eprint!("{}", phone::row(&walked));
                            out.phones.push(walked);
                        }
                    }
                }
            }
            Trial::Spot => spots(chosen, &mut out)?,
            Trial::Lens => {
                for seed in chosen.seeds.clone() {
                    lens::walk(seed, chosen.noise, chosen.metres, &chosen.config)?;
                }
            }
            Trial::Cost => {
                for pair in [[Sensors::Mono, Sensors::MonoImu], [Sensors::Stereo, Sensors::StereoImu]] {
                    out.costs.extend(recorded::cost(data, pair, chosen.times)?);
                }
            }
        }
    }
    Ok(out)
}

fn spots(chosen: &Chosen, out: &mut Measured) -> Result<(), MeasureError> {
    let metres = [chosen.metres, spot::BACK_M];
    for seed in chosen.seeds.clone() {
        for backwards_after_s in [None, Some(spot::STANDS_S)] {
            for delays in std::iter::once(None).chain(chosen.latencies().map(Some)) {
                let walk = spot::Walk {
                    seed,
                    metres,
                    backwards_after_s,
                    every: chosen.every,
                    guessed_lens: chosen.guessed_lens,
                    delays,
                };
                let walked = spot::walk(&walk, &chosen.config, chosen.verbose)?;
                eprint!("{}", walked.row());
                out.spots.push(walked);
            }
        }
    }
    Ok(())
}

fn semi_real(
    data: &Path,
    chosen: &Chosen,
    options: &[RunOptions],
    out: &mut Measured,
) -> Result<(), MeasureError> {
    let only = |name: &str| chosen.only.as_ref().is_none_or(|part| name.contains(part.as_str()));
    for motion in semi_real::MOTIONS.iter().filter(|m| only(m.name)) {
        if !data.join("imu-truth").join(motion.name).exists() {
            eprintln!("skipped: imu-truth/{} is not in {}", motion.name, data.display());
            continue;
        }
        let (checked, rows) =
            semi_real::measure(data, motion, options, chosen.condition.as_deref(), chosen.seconds)?;
        out.checked.push(checked);
        out.semi_real.extend(rows);
    }
    Ok(())
}

/// The figures as tables in Markdown; trials that were not run are left out.
pub fn tables(m: &Measured) -> String {
    let mut t = String::new();
    let or = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.3}"));
    // Writing to a string cannot fail.
    if !m.recorded.is_empty() {
        let _ = write!(t, "\n## EuRoC MH_01\n\n{HEAD}");
        m.recorded.iter().for_each(|r| t += &row(&r.figures));
        for r in &m.recorded {
            let [live, truth, relative] = r.still_m.map_or([None; 3], |w| w.map(Some));
            let _ = write!(
                t,
                "\n{}: in the last 5 s the live poses move by {} m, the ground truth by {} m, and one relative to the other by {} m.\n",
                r.figures.sensors,
                or(live),
                or(truth),
                or(relative)
            );
        }
    }
    if !m.semi_real.is_empty() {
        let _ = write!(
            t,
            "\n## Rendered rooms with real motion and real IMU data\n\n{}\n{HEAD}",
            checks(&m.checked)
        );
        m.semi_real.iter().for_each(|f| t += &row(f));
        let _ = write!(t, "\n{}", means(&m.semi_real));
    }
    if !m.turns.is_empty() {
        t += "\n## Turning round in front of plain walls\n\n| turn s | seed | sensors | maps | resets | end error m final / live | s without a pose from the turn on | coverage | scale error % |\n|---|---|---|---|---|---|---|---|---|\n";
        for r in &m.turns {
            let f = &r.figures;
            let _ = writeln!(
                t,
                "| {:.1} | {} | {} | {} | {} | {} / {} | {:.2} | {:.3} | {} |",
                r.turn_s,
                r.seed,
                f.sensors,
                f.worlds,
                f.resets,
                or(r.end_m[0]),
                or(r.end_m[1]),
                r.blind_s,
                f.coverage,
                or(f.scale_percent)
            );
        }
        let good =
            m.turns.iter().filter(|r| r.figures.worlds == 1 && r.end_m[0].is_some_and(|e| e <= 0.5)).count();
        let _ = write!(t, "\nOne map and an end error within 0.5 m: {good} of {}.\n", m.turns.len());
    }
    if !m.rests.is_empty() {
        t += "\n## One minute of standing still\n\n| sensors | camera | moves m | coverage | resets | scale error % |\n|---|---|---|---|---|---|\n";
        for r in &m.rests {
            let camera = if r.dark { "covered" } else { "open" };
            let (f, wanders) = (&r.figures, or(r.wanders_m));
            let _ = writeln!(
                t,
                "| {} | {camera} | {wanders} | {:.3} | {} | {} |",
                f.sensors,
                r.covered,
                f.resets,
                or(f.scale_percent)
            );
        }
    }
    if !m.phones.is_empty() {
        t += "\n## A phone's rates and assumed noise\n\n";
        t += phone::HEAD;
        m.phones.iter().for_each(|w| t += &phone::row(w));
        t += &phone::summary(&m.phones);
    }
    if !m.spots.is_empty() {
        t += "\n## A phone's walker who turns on the spot, or stands for long, and goes home\n\n";
        t += spot::HEAD;
        m.spots.iter().for_each(|w| t += &w.row());
    }
    if !m.costs.is_empty() {
        t += "\n## Cost\n\n| sensors | image to pose ms without / with IMU | increase % | features to pose ms without / with IMU | increase % |\n|---|---|---|---|---|\n";
        let more = |v: [f64; 2]| format!("{:.2} / {:.2} | {:+.1}", v[0], v[1], 100.0 * (v[1] / v[0] - 1.0));
        for c in &m.costs {
            let _ = writeln!(t, "| {} | {} | {} |", c.sensor, more(c.step_ms), more(c.track_ms));
        }
    }
    t
}

fn checks(list: &[semi_real::Checked]) -> String {
    let mut t = String::from(
        "| motion | clock ms | axes deg | poses to gyro over 50 ms deg, measured / rendered | to accel m/s^2 | moved mm rms / max | rotated deg rms / max | longest gap s | scale error with exact poses % |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for c in list {
        let _ = writeln!(
            t,
            "| {} | {:.2} | {:.3} | {:.4} / {:.4} | {:.2} / {:.2} | {:.2} / {:.1} | {:.3} / {:.2} | {:.2} | {:.2} +- {:.2} |",
            c.name,
            c.clock_ms,
            c.axes_deg,
            c.turn_deg[0],
            c.turn_deg[1],
            c.acceleration[0],
            c.acceleration[1],
            c.moved_mm[0],
            c.moved_mm[1],
            c.turned_deg[0],
            c.turned_deg[1],
            c.hole_s,
            c.exact_scale[0],
            c.exact_scale[1]
        );
    }
    t
}

/// Means over the motions, for each sensor mode and condition.
fn means(rows: &[Figures]) -> String {
    let condition = |f: &Figures| f.name.split_once(", ").map_or(String::new(), |n| n.1.to_owned());
    let mut kinds: Vec<(String, String)> = Vec::new();
    for f in rows {
        let kind = (f.sensors.clone(), condition(f));
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let mut t = String::from(
        "| sensors | condition | motions | mean ATE m | metric | min coverage | resets | max scale error % | max offset error ms |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    let or = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    for (sensors, name) in kinds {
        let these: Vec<&Figures> =
            rows.iter().filter(|f| f.sensors == sensors && condition(f) == name).collect();
        let ates: Vec<f64> = these.iter().filter_map(|f| f.ate_m).collect();
        let mean = (!ates.is_empty()).then(|| ates.iter().sum::<f64>() / ates.len() as f64);
        let most = |of: fn(&Figures) -> Option<f64>| these.iter().filter_map(|f| of(f)).reduce(f64::max);
        let _ = writeln!(
            t,
            "| {sensors} | {name} | {} | {} | {} | {:.3} | {} | {} | {} |",
            these.len(),
            or(mean, 4),
            ates.len(),
            these.iter().map(|f| f.coverage).fold(1.0, f64::min),
            these.iter().map(|f| f.resets).sum::<usize>(),
            or(most(|f| f.scale_percent), 2),
            or(most(|f| f.offset_ms), 2)
        );
    }
    t
}

/// The page `docs/figures/visual-inertial.md`.
pub fn page(m: &Measured) -> String {
    let head = include_str!("page.md");
    format!("{head}\n{}\nMeasured on {}.\n", tables(m), crate::build::measured_on())
}
