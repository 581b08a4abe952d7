//! `cairn team scale --fleet`: what it costs to build an atlas of many recorded walks.

use crate::failure::Failure;
use cairn::team_scale::Costs;
use cairn_files::MIB;
use cairn_fleet::{Built, City, StepLoad};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// The walks of the table, and how many of them become one atlas.
const WALKS: [f64; 3] = [1e3, 1e4, 1e5];
const TOGETHER: [f64; 3] = [10.0, 100.0, 1000.0];
/// A walk through a city, and how many others each shares a place with.
const WALK_S: f64 = 600.0;
const MEETS: f64 = 10.0;

/// What cities of walks cost.
#[derive(Serialize)]
pub struct Table {
    cities: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    city: City,
    steps: Vec<StepLoad>,
}

/// Reads what `cairn fleet build --json` printed.
///
/// # Errors
/// When it cannot be read, or has no costs.
pub fn built(path: &Path) -> Result<Built, Failure> {
    let hint = "save what cairn fleet build --json prints of a build into a new store";
    let fail = |why: String| Failure::new(path.display().to_string(), why, hint);
    let text = cairn_files::read_text(path, 256 * MIB).map_err(|e| fail(e.to_string()))?;
    let built: Built = serde_json::from_str(&text).map_err(|e| fail(e.to_string()))?;
    built.check().map_err(|why| fail(why.to_string()))?;
    Ok(built)
}

/// The table.
pub fn report(built: &Built, costs: &Costs) -> Table {
    let cities = WALKS.into_iter().flat_map(|walks| {
        TOGETHER.map(|together| City { walks, walk_s: WALK_S, meets: MEETS.min(together - 1.0), together })
    });
    Table { cities: cities.map(|city| Row { city, steps: city.load(built, costs) }).collect() }
}

/// As text: core hours and bytes of each step, and the longest task with its memory.
pub fn text(table: &Table) -> String {
    let mut text = String::new();
    for Row { city, steps } in &table.cities {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:.0} walks of {:.0} s, each shares places with {:.0} others, {:.0} become one atlas",
            city.walks, city.walk_s, city.meets, city.together
        );
        for s in steps {
            let memory = s.memory_bytes.map_or_else(|| "-".to_owned(), |m| format!("{:.2} GB", m / 1e9));
            let _ = writeln!(
                text,
                "  {:<8} {:>10.0} tasks {:>11.2} core hours, longest {:>9.3} h, {:>10.1} GB read, {:>9.1} GB written, memory {memory}",
                s.step,
                s.tasks,
                s.seconds / 3600.0,
                s.longest_s / 3600.0,
                s.read_bytes / 1e9,
                s.written_bytes / 1e9
            );
        }
        let hours: f64 = steps.iter().map(|s| s.seconds / 3600.0).sum();
        let chain: f64 = steps.iter().map(|s| s.longest_s / 3600.0).sum();
        let _ = writeln!(text, "  together {hours:.1} core hours; never shorter than {chain:.2} h");
    }
    text
}
