//! `visual-inertial`: the whole engine with an inertial sensor. A real recording; rooms around real motions with their real
//! readings; a turn about before plain walls; a minute of standing still; what it costs.

pub mod connect;
mod ran;
mod recorded;
mod semi_real;
mod walked;

use crate::Sensor;
use ran::{Asked, Figures, HEAD, row};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// A kind of trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Trial {
    /// EuRoC MH_01.
    Recorded,
    /// Rooms around real motions.
    SemiReal,
    /// 20 m out, a turn about before plain walls, 20 m home.
    Turn,
    /// A minute of standing still.
    Rest,
    /// Times with the inertial sensor and without.
    Cost,
}

/// What is measured.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Which trials.
    pub trials: Vec<Trial>,
    /// Only semi-real recordings whose name holds this.
    pub only: Option<String>,
    /// Only conditions whose name holds this.
    pub condition: Option<String>,
    /// Sensors; each trial has some of its own where none are named.
    pub sensors: Vec<Sensor>,
    /// Seconds of each semi-real motion; none: whole as recorded, less with worse readings.
    pub seconds: Option<f64>,
    /// Seeds of the turns.
    pub seeds: std::ops::RangeInclusive<u64>,
    /// Runs of each for the cost.
    pub times: usize,
    /// Settings of the engine.
    pub config: cairn_engine::Config,
    /// Tell of every frame on stderr.
    pub verbose: bool,
}

/// All that was measured.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Measured {
    recorded: Vec<recorded::Recorded>,
    checked: Vec<semi_real::Checked>,
    semi_real: Vec<Figures>,
    turns: Vec<walked::Turn>,
    rests: Vec<walked::Rest>,
    costs: Vec<recorded::Cost>,
}

/// Measures; progress and what is missing on stderr.
///
/// # Errors
/// When a run fails.
pub fn run(data: &Path, chosen: &Chosen) -> Result<Measured, String> {
    let asked = |usual: &[Sensor]| -> Vec<Asked> {
        let sensors = if chosen.sensors.is_empty() { usual } else { &chosen.sensors };
        let of =
            |s: &Sensor| Asked { config: chosen.config.clone(), verbose: chosen.verbose, ..Asked::new(*s) };
        sensors.iter().map(of).collect()
    };
    let mut out = Measured::default();
    for trial in &chosen.trials {
        match trial {
            Trial::Recorded => {
                out.recorded = recorded::measure(data, &asked(&[Sensor::MonoImu, Sensor::StereoImu]))?
            }
            Trial::SemiReal => semi_real(data, chosen, &asked(&Sensor::INERTIAL), &mut out)?,
            Trial::Turn => {
                for seed in chosen.seeds.clone() {
                    for asked in asked(&[Sensor::MonoImu]) {
                        let turn = walked::turn(seed, &asked)?;
                        eprint!("{}", row(&turn.figures));
                        out.turns.push(turn);
                    }
                }
            }
            Trial::Rest => {
                for (asked, dark) in asked(&Sensor::INERTIAL).iter().flat_map(|a| [(a, false), (a, true)]) {
                    let rest = walked::rest(1, asked, dark)?;
                    eprint!("{}", row(&rest.figures));
                    out.rests.push(rest);
                }
            }
            Trial::Cost => {
                for pair in [[Sensor::Mono, Sensor::MonoImu], [Sensor::Stereo, Sensor::StereoImu]] {
                    out.costs.extend(recorded::cost(data, pair, chosen.times)?);
                }
            }
        }
    }
    Ok(out)
}

fn semi_real(data: &Path, chosen: &Chosen, asked: &[Asked], out: &mut Measured) -> Result<(), String> {
    let only = |name: &str| chosen.only.as_ref().is_none_or(|part| name.contains(part.as_str()));
    for motion in semi_real::MOTIONS.iter().filter(|m| only(m.name)) {
        if !data.join("imu-truth").join(motion.name).exists() {
            eprintln!("skipped: imu-truth/{} is not in {}", motion.name, data.display());
            continue;
        }
        let (checked, rows) =
            semi_real::measure(data, motion, asked, chosen.condition.as_deref(), chosen.seconds)?;
        out.checked.push(checked);
        out.semi_real.extend(rows);
    }
    Ok(())
}

/// The figures as tables in Markdown; what was not run is left out.
pub fn tables(m: &Measured) -> String {
    let mut t = String::new();
    let or = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.3}"));
    // Writing to a string does not fail.
    if !m.recorded.is_empty() {
        let _ = write!(t, "\n## EuRoC MH_01\n\n{HEAD}");
        m.recorded.iter().for_each(|r| t += &row(&r.figures));
        for r in &m.recorded {
            let [told, truth, off] = r.still_m.map_or([None; 3], |w| w.map(Some));
            let _ = write!(
                t,
                "\n{}: in the last 5 s the poses told wander {} m, the truth {} m, the one from the other {} m.\n",
                r.figures.sensors,
                or(told),
                or(truth),
                or(off)
            );
        }
    }
    if !m.semi_real.is_empty() {
        let _ = write!(t, "\n## Rooms around real motions\n\n{}\n{HEAD}", checks(&m.checked));
        m.semi_real.iter().for_each(|f| t += &row(f));
        let _ = write!(t, "\n{}", means(&m.semi_real));
    }
    if !m.turns.is_empty() {
        t += "\n## A turn about before plain walls\n\n| turn s | seed | sensors | worlds | begun again | end m final / told | s without a pose from the turn on | coverage | scale error % |\n|---|---|---|---|---|---|---|---|---|\n";
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
        let _ = write!(t, "\nOne world and the end within 0.5 m: {good} of {}.\n", m.turns.len());
    }
    if !m.rests.is_empty() {
        t += "\n## A minute of standing still\n\n| sensors | lens | wanders m | covered | resets | scale error % |\n|---|---|---|---|---|---|\n";
        for r in &m.rests {
            let lens = if r.dark { "black" } else { "open" };
            let (f, wanders) = (&r.figures, or(r.wanders_m));
            let _ = writeln!(
                t,
                "| {} | {lens} | {wanders} | {:.3} | {} | {} |",
                f.sensors,
                r.covered,
                f.resets,
                or(f.scale_percent)
            );
        }
    }
    if !m.costs.is_empty() {
        t += "\n## What it costs\n\n| sensors | image to pose ms without / with | more % | features to pose ms without / with | more % |\n|---|---|---|---|---|\n";
        let more = |v: [f64; 2]| format!("{:.2} / {:.2} | {:+.1}", v[0], v[1], 100.0 * (v[1] / v[0] - 1.0));
        for c in &m.costs {
            let _ = writeln!(t, "| {} | {} | {} |", c.sensor, more(c.step_ms), more(c.track_ms));
        }
    }
    t
}

fn checks(list: &[semi_real::Checked]) -> String {
    let mut t = String::from(
        "| motion | clock ms | axes deg | poses to gyro over 50 ms deg, measured / rendered | to accel m/s^2 | moved mm rms / most | turned deg rms / most | longest hole s | scale by exact poses off % |\n|---|---|---|---|---|---|---|---|---|\n",
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

/// Means over the motions, for each kind of sensors and condition.
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
        "| sensors | condition | motions | mean ATE m | in metres | least coverage | resets | greatest scale error % | greatest offset off ms |\n|---|---|---|---|---|---|---|---|---|\n",
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

/// The page `docs/visual-inertial.md`.
pub fn page(m: &Measured) -> String {
    format!("{INTRODUCTION}\n{}", tables(m))
}

const INTRODUCTION: &str = "# Eyes with an inertial sensor

`cargo run --release -p xtask -- visual-inertial --write` prints and writes this page. Recordings are looked for in
`CAIRN_DATA`, else in `../shared/data` beside the checkout. Lockstep, default configuration.

ATE is the RMSE of the final trajectory after turning and moving it onto the truth, without scale; in brackets after a
similarity, whose scale against 1 is the scale error. Where the engine has no metres at the end there is neither. *First
metres*: from the first frame to the first pose told while lengths are metres. *Resets*: worlds begun after the first. *Worlds*:
how many hold poses at the end. *Offset off*: the time offset that the engine found (0 where it
found none) against the true one.

*Standing still* at the end of MH_01: the greatest distance of the poses told in the last 5 s from the first of them; the same
of the truth, which moves a little; and of the one against the other, when all poses told are laid on the truth.

*Rooms around real motions*: the true poses of five recordings are made smooth and laid into the clock and the axes of the
readings taken on them (the first table: how far the poses turn otherwise than the gyroscope from image to image, before and
after), a room is rendered around them as three kinds of cameras see it, and the real readings come with the images: as
recorded, the whole motion; and 20 s of it as means of pairs; stamped 20 ms early or late, which the rig does not say; with one
in a hundred lost; with both biases jumping every 10 s by 3 mrad/s and 0.05 m/s^2 an axis.

What one eye can know of scale, the accelerometer bounds: *scale by exact poses* is how far the scale is off that the same readings
give (`cairn_inertial::initialise`) when the true poses of the whole stretch stand in place of the eye's.

*The turn*: a walker goes 20 m down a corridor, turns about on the spot within 2 to 4 s where walls and end are plain, and comes
home facing home; simulated readings with the noise of an ADIS16448. The end is told when the way out is laid on the truth.

*A minute of standing*, after 12 m of walking, with the lens open, and black from 1.5 s on: how far the poses told go from the
first of that minute.

*What it costs*: medians of the quietest of several runs of MH_01, with and without taking turns.
";
