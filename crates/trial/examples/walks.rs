//! Guides simulated walkers along random routes on poses, and prints the figures.
//!
//! `cargo run --release -p cairn-trial --example walks -- [--ways N] [--from SEED] [--row ROW] [--seed SEED] [--docs FOLDER]`:
//! a table of all rows (or one, from 0), the utterances by kind, and the worst seeds. `--seed` with `--row` replays one walk instead,
//! with its time line. Exits 1 where a rule is broken more often than its limit. `--docs` also writes the table into FOLDER/guide.md (docs/figures), between its marks, and the worst three
//! transcripts beside it.

use cairn_geometry::Vec2;
use cairn_guide::{Facing, Travel};
use cairn_trial::walk::{Noise, Outcome, Tally, TrialConfig, random_route, replay, run};
use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;
use std::process::ExitCode;

const ROWS: [(&str, Facing, Travel); 4] = [
    ("home, facing home", Facing::Home, Travel::Home),
    ("home, camera facing back", Facing::Back, Travel::Home),
    ("home, walking backwards", Facing::Backwards, Travel::Home),
    ("forward, another day", Facing::Home, Travel::Again),
];

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
    run(&line, &config)
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

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let after = |flag: &str| words.get(words.iter().position(|w| w == flag)? + 1).cloned();
    let number = |flag: &str| after(flag).and_then(|w| w.parse::<u64>().ok());
    if let (Some(seed), Some(row)) = (number("--seed"), number("--row")) {
        let (line, config) = setup(seed, (row as usize).min(3 * ROWS.len() - 1));
        print!("{}", replay(&line, &config).1);
        return ExitCode::SUCCESS;
    }
    let (first, routes) = (number("--from").unwrap_or(0), number("--ways").unwrap_or(200));
    let mut table = String::from(
        "| route | arrived within 1 m | error p50 / p95 / max | off the path per 50 m | wrong side | utterances per 100 m | of them corrections |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let mut kinds = String::new();
    let mut worst: Vec<(f64, u64, usize)> = Vec::new();
    let mut is_broken = false;
    let rows =
        number("--row").map_or(0..3 * ROWS.len(), |row| row as usize..(row as usize + 1).min(3 * ROWS.len()));
    for row in rows {
        let (mut tally, mut broken) = (Tally::default(), Vec::new());
        for (seed, o) in walks(first..first + routes, row) {
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
        print!("{line}");
        table += &line;
        let list: Vec<String> = tally.kinds.iter().map(|(k, n)| format!("{k} {:.1}", per_100(*n))).collect();
        println!("    per 100 m: {}", list.join(", "));
        let _ = writeln!(kinds, "| {} | {} |", name(row), list.join(", "));
        for (rule, n) in &tally.broken {
            let seeds = broken.iter().filter(|b| b.0 == *rule).map(|b| format!("{} at {:.1} s", b.1, b.2));
            println!("    {}: {n}, seeds {}", rule.name(), seeds.take(8).collect::<Vec<_>>().join(", "));
        }
        if tally.arrival_rate() < LEAST_ARRIVALS {
            is_broken = true;
            println!("    BROKEN arrivals: {:.1} %", 100.0 * tally.arrival_rate());
        }
        for (rule, n) in tally.broken_too_often() {
            is_broken = true;
            let most = rule.most_on_1000_walks();
            println!(
                "    BROKEN {}: {n} on {} walks, {most} on 1000 are the limit",
                rule.name(),
                tally.trials
            );
        }
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        let here = worst.iter().filter(|w| w.2 == row).take(5);
        println!("    worst seeds: {:?}", here.map(|w| w.1).collect::<Vec<_>>());
        if row == 0 {
            println!("    {} routes, {:.0} m", tally.trials, tally.metres);
        }
    }
    if let Some(folder) = after("--docs")
        && let Err(e) = write_docs(Path::new(&folder), &table, &kinds, &worst)
    {
        eprintln!("{folder}: {e}");
        return ExitCode::FAILURE;
    }
    if is_broken { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Writes the table between the marks of `guide.md`, and the worst three transcripts.
fn write_docs(
    folder: &Path,
    table: &str,
    kinds: &str,
    worst: &[(f64, u64, usize)],
) -> Result<(), std::io::Error> {
    let path = folder.join("guide.md");
    let page = std::fs::read_to_string(&path)?;
    let marks = (page.find("<!-- figures -->"), page.find("<!-- end of figures -->"));
    let (Some(from), Some(to)) = marks else {
        return Err(std::io::Error::other(
            "guide.md has no marks <!-- figures --> and <!-- end of figures -->",
        ));
    };
    let figures = format!(
        "<!-- figures -->\n\n{table}\nUtterances per 100 m by kind:\n\n| route | kinds |\n|---|---|\n{kinds}\n"
    );
    std::fs::write(&path, format!("{}{figures}{}", &page[..from], &page[to..]))?;
    for (k, (_, seed, row)) in worst.iter().take(3).enumerate() {
        let o = trial(*seed, *row);
        let text = format!(
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
        );
        std::fs::write(folder.join(format!("guide-worst-{}.txt", k + 1)), text)?;
    }
    Ok(())
}
