//! `cairn-sim`: walks in virtual time in which everything may fail.

use cairn_faults::{Faults, Scenario, Tally, page, shrink, text, walks, watched};
use clap::Parser;
use std::ops::Range;
use std::path::PathBuf;
use std::process::ExitCode;

/// Walks in virtual time in which everything may fail. Ends with 1 where a rule was broken.
#[derive(Parser)]
#[command(name = "cairn-sim")]
struct Arguments {
    /// One walk, with its time line
    #[arg(long, value_name = "SEED", conflicts_with = "seeds", required_unless_present = "seeds")]
    seed: Option<u64>,
    /// Many walks: FROM..TO
    #[arg(long, value_name = "FROM..TO", value_parser = range)]
    seeds: Option<Range<u64>>,
    /// With only these faults, divided by commas
    #[arg(long, value_name = "FAULTS", value_parser = Faults::parse, requires = "seed")]
    faults: Option<Faults>,
    /// On only so many legs of the route
    #[arg(long, value_name = "N", requires = "seed")]
    legs: Option<usize>,
    /// Nothing fails after so many seconds of guidance
    #[arg(long, value_name = "SECONDS", requires = "seed")]
    calm: Option<f64>,
    /// Also write the time line as a page
    #[arg(long, value_name = "FILE", requires = "seed")]
    html: Option<PathBuf>,
    /// Look for the smallest walk on which the first rule that was broken still is
    #[arg(long)]
    shrink: bool,
    /// Stop at the first walk on which a rule is broken
    #[arg(long, requires = "seeds")]
    first: bool,
    /// Threads
    #[arg(long, value_name = "N", default_value_t = 2)]
    threads: usize,
}

fn range(text: &str) -> Result<Range<u64>, String> {
    let (from, to) = text.split_once("..").ok_or("two numbers are needed, as 0..1000")?;
    let number = |text: &str| text.parse::<u64>().map_err(|e| format!("{text}: {e}"));
    Ok(number(from)?..number(to)?)
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match (&arguments.seeds, arguments.seed) {
        (Some(seeds), _) => many(seeds.clone(), &arguments),
        (None, Some(seed)) => one(seed, &arguments),
        (None, None) => ExitCode::FAILURE,
    }
}

fn one(seed: u64, arguments: &Arguments) -> ExitCode {
    let drawn = Scenario::of(seed);
    let scenario = Scenario {
        seed,
        faults: arguments.faults.unwrap_or(drawn.faults),
        legs: arguments.legs.unwrap_or(drawn.legs),
        calm_s: arguments.calm.unwrap_or(drawn.calm_s),
    };
    let (outcome, lines) = watched(&scenario);
    print!("{}", text(&lines));
    println!("cairn-sim {scenario}");
    let arrived =
        outcome.arrived_m.map_or("not arrived".into(), |m| format!("arrived {m:.2} m from the end"));
    let refused = outcome.refused.as_ref().map_or(String::new(), |why| format!(", refused: {why}"));
    println!("{:.0} s, {} directions, {arrived}{refused}", outcome.seconds, outcome.directions);
    if let Some(file) = &arguments.html
        && let Err(e) = std::fs::write(file, page(&scenario, &lines))
    {
        eprintln!("{}: {e}", file.display());
        return ExitCode::FAILURE;
    }
    let Some(first) = outcome.violations.first() else { return ExitCode::SUCCESS };
    println!("BROKEN {:?} at {:.2} s: {}", first.rule, first.t_s, first.how);
    if arguments.shrink
        && let Some(smallest) = shrink(&scenario, first.rule)
    {
        println!("the same with less: cairn-sim {smallest}");
    }
    ExitCode::FAILURE
}

fn many(seeds: Range<u64>, arguments: &Arguments) -> ExitCode {
    let tally = walks(seeds, arguments.threads, arguments.first);
    print(&tally);
    for (rule, seeds) in tally.broken.iter().filter(|_| arguments.shrink) {
        if let Some(smallest) = seeds.first().and_then(|(seed, _)| shrink(&Scenario::of(*seed), *rule)) {
            println!("{rule:?} with less: cairn-sim {smallest}");
        }
    }
    if tally.broken.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn print(tally: &Tally) {
    println!(
        "{} walks, {} guided, {} arrived, {} directions, {:.0} h in {:.0} s of processors: {:.0} times real time a core",
        tally.walks,
        tally.guided,
        tally.arrived,
        tally.directions,
        tally.seconds / 3600.0,
        tally.busy_s,
        tally.times_real()
    );
    for (why, n) in &tally.refused {
        println!("refused {n}: {why}");
    }
    for (rule, seeds) in &tally.broken {
        println!("BROKEN {rule:?} on {} walks:", seeds.len());
        for (seed, how) in seeds.iter().take(8) {
            println!("    {seed} at {how}");
        }
    }
}
