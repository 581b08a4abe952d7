//! `robot`: robots that explore apartments, one for each seed. The table of `docs/figures/plan.md` has a row of each, with the build it is
//! of.

use crate::MeasureError;
use crate::build::commit;
use crate::error::file;
use cairn_engine::Host;
use cairn_trial::robot::{End, RobotConfig, Trial};
use std::ops::Range;
use std::path::Path;

/// The table on the page.
const BEGIN: &str = "<!-- figures: robot -->";
const END: &str = "<!-- end of figures -->";

/// Drives robots with these seeds, and prints a line for each. The row of each is put on the page at once where it is to be written: a run
/// over all seeds takes hours. One alone is told in detail, with a picture.
///
/// # Errors
/// When a robot cannot be simulated, or the page has no table of robots.
pub fn run(seeds: Range<u64>, page: Option<&Path>) -> Result<(), MeasureError> {
    let alone = seeds.end - seeds.start == 1;
    for seed in seeds {
        let began = std::time::Instant::now();
        let end = Trial::new(RobotConfig::new(seed), &Host::bare())?.run(|_| ())?;
        let goals: Vec<String> = end
            .goals
            .iter()
            .map(|g| {
                format!(
                    "{} {:.2} m {:.0} s {}",
                    g.state,
                    g.error_m,
                    g.seconds,
                    g.reason.as_deref().unwrap_or("")
                )
            })
            .collect();
        println!(
            "seed {seed}: {} collisions {:?}, clearance {:.2?}, explored {:.0} s, {:.0} s in all, {:.0} m, known {:.2}, error {:.3?}, lost {} coasted {} refused {}, loops {:?}, door {:?}, plans {}, goals {goals:?}, {:.1} s",
            end.collisions.len(),
            end.collisions.first(),
            end.clearance_m,
            end.explored_s,
            end.seconds,
            end.driven_m,
            end.known,
            end.position_error_m,
            end.lost,
            end.coasted,
            end.refused,
            end.loops,
            end.door_closed_s,
            end.plans,
            began.elapsed().as_secs_f64()
        );
        if let Some(path) = page {
            let page = with_row(&std::fs::read_to_string(path).map_err(file(path))?, seed, &row(seed, &end))?;
            std::fs::write(path, page).map_err(file(path))?;
        }
        if alone {
            for (t, at, cells) in &end.targets {
                println!("target {t:.1} {:.2} {:.2} {cells}", at.x, at.y);
            }
            for (t, state, reason) in &end.states {
                println!("{t:6.1} {state} {}", reason.as_deref().unwrap_or(""));
            }
            let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
            println!("step {:.1} ms, plan {:.1} ms", mean(&end.step_ms), mean(&end.plan_ms));
            for m in end.path.iter().step_by(50) {
                println!(
                    "at {:.0} s: off {:.3} m, {:.3} rad",
                    m.t_s,
                    (m.truth.translation - m.estimate.translation).norm(),
                    (m.truth.rotation.inverse() * m.estimate.rotation).log()
                );
            }
            if let Some(map) = &end.map {
                let truth: Vec<_> = end.path.iter().map(|m| m.truth.translation).collect();
                let estimate: Vec<_> = end.path.iter().map(|m| m.estimate.translation).collect();
                let colour = |v: i8| {
                    if v < 0 {
                        [200, 204, 210]
                    } else if v == 0 {
                        [250, 250, 247]
                    } else {
                        [40, 44, 52]
                    }
                };
                let picture = cairn_plan::picture::Picture::new(map, colour)
                    .points(&estimate, [240, 170, 60])
                    .points(&truth, [30, 90, 200]);
                std::fs::write(std::env::temp_dir().join("robot.png"), picture.png()?)?;
            }
        }
    }
    Ok(())
}

/// The row of a seed.
fn row(seed: u64, end: &End) -> String {
    let build = commit().unwrap_or_default();
    let reached = end.goals.iter().filter(|g| g.reached).count();
    let seconds: Vec<String> = end.goals.iter().map(|g| format!("{:.0}", g.seconds)).collect();
    let missed = end.goals.iter().filter(|g| !g.reached).map(|g| {
        let why = g.reason.as_deref().unwrap_or("");
        format!(
            "{}: {}, {:.2} m away{}{why}",
            g.name,
            g.state,
            g.error_m,
            if why.is_empty() { "" } else { ", " }
        )
    });
    let again = end
        .goals
        .iter()
        .filter(|g| g.reached && g.tries > 1)
        .map(|g| format!("{} in its second try", g.name));
    let touched = end.collisions.iter().map(|c| format!("touched a {:?} after {:.0} s", c.with, c.t_s));
    let remarks: Vec<String> = missed.chain(again).chain(touched).collect();
    let [wall_m, person_m] = end.clearance_m;
    let [rms_m, max_m] = end.position_error_m;
    format!(
        "| {seed} | {reached} of {} | {wall_m:.2} / {person_m:.2} | {:.0} m | {rms_m:.3} / {max_m:.3} | {} / {} | {:.0} | {} | {} | {build} |",
        end.goals.len(),
        end.driven_m,
        end.lost,
        end.refused,
        end.seconds,
        seconds.join(", "),
        remarks.join("; ")
    )
}

/// The page with the row of this seed, and the sums under the table.
fn with_row(page: &str, seed: u64, row: &str) -> Result<String, MeasureError> {
    let (before, rest) = page.split_once(BEGIN).ok_or("the page has no table of robots")?;
    let (table, after) = rest.split_once(END).ok_or("the table of robots has no end")?;
    let lines: Vec<&str> = table.lines().filter(|l| l.starts_with('|')).collect();
    let number = |line: &str| {
        line.trim_start_matches('|').split('|').next().and_then(|v| v.trim().parse::<u64>().ok())
    };
    let mut rows: Vec<(u64, &str)> = lines.iter().filter_map(|l| Some((number(l)?, *l))).collect();
    rows.retain(|(of, _)| *of != seed);
    rows.push((seed, row));
    rows.sort_unstable();
    let sum = |word: &str| rows.iter().filter(|(_, l)| l.contains(word)).count();
    let rooms: usize = (1..=3).map(|n| n * sum(&format!("| {n} of 3 |"))).sum();
    let sums = format!(
        "{rooms} of {} rooms, all three in {} of {} apartments, something touched in {}.",
        3 * rows.len(),
        sum("| 3 of 3 |"),
        rows.len(),
        sum("touched a ")
    );
    let head: Vec<&str> = lines.iter().copied().filter(|l| number(l).is_none()).collect();
    let body: Vec<&str> = rows.iter().map(|(_, l)| *l).collect();
    Ok(format!("{before}{BEGIN}\n{}\n{}\n\n{sums}\n{END}{after}", head.join("\n"), body.join("\n")))
}
