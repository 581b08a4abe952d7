//! `guide`: simulated walkers along random routes on poses: a table of all kinds of walks, the utterances by kind, the worst seeds, and
//! what is broken more often than its limit.

use cairn_geometry::Vec2;
use cairn_guide::{Facing, Travel};
use cairn_trial::walk::{Noise, Outcome, Tally, TrialConfig, random_route, replay};
use std::fmt::Write;
use std::ops::Range;

const ROWS: [(&str, Facing, Travel); 4] = [
    ("home, facing home", Facing::Home, Travel::Home),
    ("home, camera facing back", Facing::Back, Travel::Home),
    ("home, walking backwards", Facing::Backwards, Travel::Home),
    ("forward, another day", Facing::Home, Travel::Again),
];

/// All rows: exact and noisy poses, and long losses.
const ALL_ROWS: usize = 3 * ROWS.len();

/// At least this share arrives within 1 m.
const LEAST_ARRIVALS: f64 = 0.98;

/// What a row is made of: exact and noisy poses by turns, then long losses.
fn row_of(row: usize) -> ((&'static str, Facing, Travel), Noise, &'static str) {
    match row {
        8.. => (ROWS[row - 8], Noise::LongLosses, "long losses"),
        _ if row.is_multiple_of(2) => (ROWS[row / 2], Noise::None, "exact poses"),
        _ => (ROWS[row / 2], Noise::Usual, "noisy poses"),
    }
}

/// The route of a walk and how it is gone.
fn setup(seed: u64, row: usize) -> (Vec<Vec2>, TrialConfig) {
    let ((_, facing, travel), noise, _) = row_of(row);
    let crossing = seed % 4 == 3;
    let corridor_m = 1.5 + 0.1 * (seed % 16) as f64;
    let phrases = cairn_guide::PhraseConfig::default();
    let config = TrialConfig { facing, travel, noise, corridor_m, cut_detours: !crossing, phrases, seed };
    (random_route(seed, crossing), config)
}

fn trial(seed: u64, row: usize) -> Outcome {
    let (line, config) = setup(seed, row);
    cairn_trial::walk::run(&line, &config)
}

/// The walks of a row by seed, on all cores.
fn walks(seeds: Range<u64>, row: usize) -> Vec<(u64, Outcome)> {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let mut walks: Vec<(u64, Outcome)> = std::thread::scope(|scope| {
        let start = |core| {
            let mine = seeds.clone().filter(move |seed| seed % cores == core);
            scope.spawn(move || mine.map(|seed| (seed, trial(seed, row))).collect::<Vec<_>>())
        };
        let threads: Vec<_> = (0..cores).map(start).collect();
        threads
            .into_iter()
            .flat_map(|thread| thread.join().unwrap_or_else(|e| std::panic::resume_unwind(e)))
            .collect()
    });
    walks.sort_by_key(|(seed, _)| *seed);
    walks
}

fn name(row: usize) -> String {
    let (way, _, poses) = row_of(row);
    format!("{}, {poses}", way.0)
}

/// How bad a trial was: not arrived first, then wrong sides and broken rules, leaving the path, number of utterances.
fn badness(o: &Outcome) -> f64 {
    let missed = if o.arrived && o.error_m <= 1.0 { 0.0 } else { 1000.0 };
    let talk = o.said.len() as f64 / o.length_m.max(1.0);
    missed + 100.0 * o.broken.len() as f64 + 10.0 * o.off_path as f64 + o.error_m + talk
}

fn percentile(sorted: &[f64], share: f64) -> f64 {
    let k = (share * sorted.len() as f64) as usize;
    sorted.get(k.min(sorted.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

/// What came of the walks.
#[derive(Default)]
pub struct Figures {
    /// What is printed.
    pub text: String,
    /// The table, and the utterances by kind.
    pub table: String,
    /// What is broken more often than its limit.
    pub broken: Vec<String>,
    /// The transcripts of the worst three.
    pub worst: Vec<String>,
}

/// One walk with its time line; rows are counted from 0.
pub fn one(seed: u64, row: usize) -> String {
    let (line, config) = setup(seed, row.min(ALL_ROWS - 1));
    replay(&line, &config).1
}

/// Walks so many routes in each row, or in one of them; progress on stderr.
pub fn run(seeds: Range<u64>, row: Option<usize>) -> Figures {
    let mut out = Figures::default();
    out.table += "| route | arrived within 1 m | error p50 / p95 / max | off the path per 50 m | wrong side | utterances per 100 m | of them corrections |\n\
         |---|---|---|---|---|---|---|\n";
    let mut kinds = String::new();
    let mut worst: Vec<(f64, u64, usize)> = Vec::new();
    // Writing to a string cannot fail.
    for row in row.map_or(0..ALL_ROWS, |row| row..(row + 1).min(ALL_ROWS)) {
        let (mut tally, mut broken) = (Tally::default(), Vec::new());
        for (seed, o) in walks(seeds.clone(), row) {
            tally.add(&o);
            broken.extend(o.broken.iter().map(|(t, rule)| (*rule, seed, *t)));
            worst.push((badness(&o), seed, row));
        }
        let mut errors = tally.errors_m.clone();
        errors.sort_by(f64::total_cmp);
        let per_100 = |n: usize| 100.0 * n as f64 / tally.metres;
        let corrections = ["adjust", "off path", "rotate", "step aside", "wrong way", "end missed"];
        let corrected = corrections.iter().filter_map(|k| tally.kinds.get(k)).sum::<usize>();
        let line = format!(
            "| {} | {:.1} % | {:.2} / {:.2} / {:.2} m | {:.2} | {} of {} | {:.1} | {:.1} |\n",
            name(row),
            100.0 * tally.arrival_rate(),
            percentile(&errors, 0.5),
            percentile(&errors, 0.95),
            percentile(&errors, 1.0),
            tally.off_path_per_50_m(),
            tally.wrong_side,
            tally.said,
            tally.said_per_100_m(),
            per_100(corrected),
        );
        eprint!("{line}");
        out.text += &line;
        out.table += &line;
        let list: Vec<String> = tally.kinds.iter().map(|(k, n)| format!("{k} {:.1}", per_100(*n))).collect();
        let _ = writeln!(out.text, "    per 100 m: {}", list.join(", "));
        let _ = writeln!(kinds, "| {} | {} |", name(row), list.join(", "));
        for (rule, n) in &tally.broken {
            let seeds = broken.iter().filter(|b| b.0 == *rule).map(|b| format!("{} at {:.1} s", b.1, b.2));
            let _ = writeln!(
                out.text,
                "    {}: {n}, seeds {}",
                rule.name(),
                seeds.take(8).collect::<Vec<_>>().join(", ")
            );
        }
        if tally.arrival_rate() < LEAST_ARRIVALS {
            out.broken.push(format!("{}: arrivals {:.1} %", name(row), 100.0 * tally.arrival_rate()));
        }
        for (rule, n) in tally.broken_too_often() {
            let (name, rule, most) = (name(row), rule.name(), rule.most_on_1000_walks());
            out.broken
                .push(format!("{name}: {rule}: {n} on {} walks, {most} on 1000 are the limit", tally.trials));
        }
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        let here = worst.iter().filter(|w| w.2 == row).take(5);
        let _ = writeln!(out.text, "    worst seeds: {:?}", here.map(|w| w.1).collect::<Vec<_>>());
        if row == 0 {
            let _ = writeln!(out.text, "    {} routes, {:.0} m", tally.trials, tally.metres);
        }
    }
    let _ = write!(out.table, "\nUtterances per 100 m by kind:\n\n| route | kinds |\n|---|---|\n{kinds}");
    for (_, seed, row) in worst.iter().take(3) {
        let o = trial(*seed, *row);
        out.worst.push(format!(
            "{}, seed {seed}: {:.0} m in {:.0} s, {}, {:.2} m from the end, {} off-path events, {} directions to the \
             wrong side, {} utterances\n\n{}",
            name(*row),
            o.length_m,
            o.seconds,
            if o.arrived { "arrived" } else { "not arrived" },
            o.error_m,
            o.off_path,
            o.wrong_side,
            o.said.len(),
            o.transcript()
        ));
    }
    out
}
