//! Guides simulated walkers along random routes on poses, and prints the figures.
//!
//! `cargo run --release -p cairn-trial --example walks -- [--ways N] [--from SEED] [--show SEED ROW] [--docs FOLDER]`:
//! a table of all rows, the utterances by kind, and the worst seeds; `--show` prints one transcript instead (ROW
//! counts from 0); `--docs` also writes the table into FOLDER/guide.md (docs/figures), between its marks, and the worst three
//! transcripts beside it.

use cairn_guide::{Facing, Travel};
use cairn_trial::walk::{Noise, Outcome, Tally, TrialConfig, random_route, run};
use std::fmt::Write as _;
use std::path::Path;

const ROWS: [(&str, Facing, Travel); 4] = [
    ("home, facing home", Facing::Home, Travel::Home),
    ("home, camera facing back", Facing::Back, Travel::Home),
    ("home, walking backwards", Facing::Backwards, Travel::Home),
    ("forward, another day", Facing::Home, Travel::Again),
];

fn trial(seed: u64, row: usize) -> Outcome {
    let (_, facing, travel) = ROWS[row / 2];
    let noise = if row.is_multiple_of(2) { Noise::None } else { Noise::Usual };
    let crossing = seed % 4 == 3;
    let corridor_m = 1.5 + 0.1 * (seed % 16) as f64;
    let line = random_route(seed, crossing);
    run(
        &line,
        &TrialConfig {
            facing,
            travel,
            noise,
            corridor_m,
            cut_detours: !crossing,
            phrases: cairn_guide::PhraseConfig::default(),
            seed,
        },
    )
}

fn name(row: usize) -> String {
    format!("{}, {} poses", ROWS[row / 2].0, if row.is_multiple_of(2) { "exact" } else { "noisy" })
}

/// How bad a trial was: not arrived first, then wrong sides and broken rules, leaving the path, number of utterances.
fn badness(o: &Outcome) -> f64 {
    let missed = if o.arrived && o.error_m <= 1.0 { 0.0 } else { 1000.0 };
    let talk = o.said.len() as f64 / o.length_m.max(1.0);
    let broken = o.broken.values().sum::<usize>();
    missed + 100.0 * (o.wrong_side + broken) as f64 + 10.0 * o.off_path as f64 + o.error_m + talk
}

fn percentile(sorted: &[f64], share: f64) -> f64 {
    let k = (share * sorted.len() as f64) as usize;
    sorted.get(k.min(sorted.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let after = |flag: &str, k: usize| {
        let at = words.iter().position(|w| w == flag)?;
        words.get(at + k).cloned()
    };
    let number = |flag: &str, k: usize| after(flag, k).and_then(|w| w.parse::<u64>().ok());
    if let (Some(seed), Some(row)) = (number("--show", 1), number("--show", 2)) {
        print!("{}", trial(seed, (row as usize).min(2 * ROWS.len() - 1)).transcript());
        return;
    }
    let (first, routes) = (number("--from", 1).unwrap_or(0), number("--ways", 1).unwrap_or(200));
    let mut table = String::from(
        "| route | arrived within 1 m | error p50 / p95 / max | off the path per 50 m | wrong side | utterances per 100 m | of them corrections |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let mut kinds = String::new();
    let mut worst: Vec<(f64, u64, usize)> = Vec::new();
    for row in 0..2 * ROWS.len() {
        let (mut tally, mut broken) = (Tally::default(), Vec::new());
        for seed in first..first + routes {
            let o = trial(seed, row);
            tally.add(&o);
            if !o.broken.is_empty() {
                broken.push((seed, o.broken.clone()));
            }
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
        println!("    broken rules: {:?}, first by seed: {:?}", tally.broken, &broken[..broken.len().min(6)]);
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        let here = worst.iter().filter(|w| w.2 == row).take(5);
        println!("    worst seeds: {:?}", here.map(|w| w.1).collect::<Vec<_>>());
        if row == 0 {
            println!("    {} routes, {:.0} m", tally.trials, tally.metres);
        }
    }
    if let Some(folder) = after("--docs", 1)
        && let Err(e) = write_docs(Path::new(&folder), &table, &kinds, &worst)
    {
        eprintln!("{folder}: {e}");
        std::process::exit(1);
    }
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
