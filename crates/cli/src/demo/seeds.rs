//! Many demos with different seeds, one after the other, as a table.

use super::config::DemoConfig;
use super::once::{Figures, once};
use crate::failure::Failure;
use crate::output::Output;
use serde::Serialize;

/// The results of all runs.
#[derive(Serialize)]
struct Tally {
    runs: usize,
    arrived: usize,
    /// Walkers whose guide gave up directions and said why.
    stopped: usize,
    /// Walkers led far off the path, or told of an arrival elsewhere.
    misled: usize,
    arrival_error_m: Spread,
    ate_m: Spread,
    wall_s: Spread,
    each: Vec<Figures>,
}

/// Median and maximum of a figure.
#[derive(Serialize)]
struct Spread {
    median: f64,
    max: f64,
}

impl Spread {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut v: Vec<f64> = values.collect();
        v.sort_by(f64::total_cmp);
        let at = |i: usize| v.get(i).copied().unwrap_or(f64::NAN);
        Self { median: at(v.len() / 2), max: at(v.len().saturating_sub(1)) }
    }
}

/// Runs all demos and prints a row as each ends.
///
/// # Errors
/// When a demo fails or a walker did not arrive.
pub fn run(configs: impl Iterator<Item = DemoConfig>, output: &Output) -> Result<(), Failure> {
    let mut each = Vec::new();
    output.text(HEAD)?;
    for config in configs {
        let figures = once(&config)?.figures;
        output.text(&row(&figures))?;
        each.push(figures);
    }
    let tally = Tally {
        runs: each.len(),
        arrived: each.iter().filter(|f| f.arrived).count(),
        stopped: each.iter().filter(|f| !f.arrived && f.stopped.is_some()).count(),
        misled: each.iter().filter(|f| f.misled).count(),
        arrival_error_m: Spread::of(each.iter().map(|f| f.arrival_error_m)),
        ate_m: Spread::of(each.iter().map(|f| f.ate_m)),
        wall_s: Spread::of(each.iter().map(|f| f.wall_s)),
        each,
    };
    if tally.arrived == tally.runs {
        return output.result(&tally, summary);
    }
    output.text(&summary(&tally))?;
    let why = format!("{} of {} walkers arrived", tally.arrived, tally.runs);
    Err(Failure::new(
        "the demo",
        why,
        "run cairn demo --seed N with a seed that failed and look at its report",
    ))
}

const HEAD: &str = "seed  facing     arrived  error m  off m  route m  back m  said  /100 m  ATE m   coverage  lost  ms p50   p99  wall s";

fn row(f: &Figures) -> String {
    let (p50, p99) = f.ms.map_or((0.0, 0.0), |ms| (ms.p50, ms.p99));
    format!(
        "{:>4}  {:<9}  {:<7}  {:>7.2}  {:>5.2}  {:>7.1}  {:>6.1}  {:>4}  {:>6.1}  {:.4}  {:>8.4}  {:>4}  {:>6.1}  {:>4.1}  {:>6.1}",
        f.seed,
        f.facing,
        outcome(f),
        f.arrival_error_m,
        f.farthest_off_m,
        f.cleaned_m,
        f.walked_home_m,
        f.said.len(),
        100.0 * f.said.len() as f64 / f.cleaned_m.max(1e-9),
        f.ate_m,
        f.coverage,
        f.lost.len(),
        p50,
        p99,
        f.wall_s
    )
}

/// How a walk ended, in a word.
fn outcome(f: &Figures) -> &'static str {
    match (f.misled, f.arrived, &f.stopped) {
        (true, _, _) => "misled",
        (_, true, _) => "yes",
        (_, _, Some(_)) => "stopped",
        _ => "no",
    }
}

/// The last lines: all runs together, then each facing by itself.
fn summary(tally: &Tally) -> String {
    let mut lines = Vec::new();
    lines.push(line("all", &tally.each));
    for facing in ["home", "back", "backwards"] {
        let here: Vec<_> = tally.each.iter().filter(|f| f.facing == facing).cloned().collect();
        if !here.is_empty() && here.len() < tally.runs {
            lines.push(line(facing, &here));
        }
    }
    lines.extend(way(&tally.each));
    lines.join("\n")
}

/// What was in the way of all of them, where something was put there.
fn way(each: &[Figures]) -> Option<String> {
    let sum = |of: fn(&Figures) -> usize| each.iter().map(of).sum::<usize>();
    let metres: f64 = each.iter().map(|f| f.walked_home_m).sum();
    (sum(|f| f.obstacles) > 0 || sum(|f| f.way_stops) > 0).then(|| {
        format!(
            "in the way: {} things, touched {} times in {} of {} walks; {} stops, {} of them for nothing in {metres:.0} m",
            sum(|f| f.obstacles),
            sum(|f| f.touched),
            each.iter().filter(|f| f.touched > 0).count(),
            each.len(),
            sum(|f| f.way_stops),
            sum(|f| f.false_stops),
        )
    })
}

fn line(name: &str, each: &[Figures]) -> String {
    let error = Spread::of(each.iter().map(|f| f.arrival_error_m));
    let ate = Spread::of(each.iter().map(|f| f.ate_m));
    format!(
        "{name}: {} of {} arrived within 1 m, {} stopped with the reason, {} misled; arrival error median {:.2}, max {:.2} m; ATE median {:.4}, max {:.4} m; at most {:.0} s per run",
        each.iter().filter(|f| f.arrived).count(),
        each.len(),
        each.iter().filter(|f| !f.arrived && f.stopped.is_some()).count(),
        each.iter().filter(|f| f.misled).count(),
        error.median,
        error.max,
        ate.median,
        ate.max,
        Spread::of(each.iter().map(|f| f.wall_s)).max
    )
}
