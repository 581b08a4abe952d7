//! The results as text: one line per leg, and the page in docs.

use crate::network::{Result, Trial};
use std::fmt::Write as _;

/// One line for each leg.
pub fn lines(results: &[Result]) -> String {
    let mut text = String::new();
    for r in results {
        let (t, l) = (&r.trial, &r.leg);
        let stall =
            t.stall.map_or_else(|| "no stall".into(), |(at, s)| format!("stall {s:.1} s after {at:.1} s"));
        let _ = writeln!(
            text,
            "{} Mbit/s, {} ms, loss {} and {} %, {stall}: guided {:.0} % of {:.1} s, walked {:.0} %, {:.1} pictures/s, said {} (oldest \
             {:.0} ms), given {} (oldest {:.0} ms), withheld {}, stops {}, connections {}",
            t.mbit_s,
            t.round_trip_ms,
            100.0 * t.loss[0],
            100.0 * t.loss[1],
            100.0 * l.guided_s / l.total_s.max(1e-3),
            l.total_s,
            100.0 * l.walked,
            l.pictures as f64 / l.took_s,
            r.said,
            r.oldest_said_ms,
            l.given,
            l.oldest_ms,
            l.withheld,
            l.stops,
            l.connections,
        );
    }
    text
}

/// The page: directions and their ages, and how much could be guided at each rate and delay.
pub fn page(results: &[Result], took_s: f64) -> String {
    let said: usize = results.iter().map(|r| r.said).sum();
    let given: usize = results.iter().map(|r| r.leg.given).sum();
    let withheld: usize = results.iter().map(|r| r.leg.withheld).sum();
    let oldest = |f: fn(&Result) -> f64| results.iter().map(f).fold(0.0, f64::max);
    let mut text = format!(
        "# Figures: guidance over bad networks\n\n\
         Written by `cargo test --release -p cairn-web --test suite network:: -- --ignored --nocapture` ({} legs, {:.0} minutes). What it \
         means: [Slow networks](../network.md).\n\n\
         A simulated phone is guided along a walk of 9 s with a corner, there and back, by the server on the same machine, \
         through a proxy. It sends 480x360 at 15 images a second; its clock has an offset and a drift. The proxy gives 4 to 0.2 \
         Mbit/s each way for all connections together and round trips of 50 to 500 ms. Up to 3 % of the segments are lost and \
         sent again as TCP does (`crates/web/tests/network/proxy.rs` says how). Every third leg has a stall of 1 to 10 s. The \
         phone has up to three connections, as the page: more than one where the link has room for them. Its walker stands when \
         the guide says stop. A judge beside the server knows the phone's clock.\n\n\
         - Directions that the server gave: {said}; the oldest pose that one was from: {:.0} ms, at most 500 ms and the delay of \
         the judge itself are allowed.\n\
         - Directions that the phone passed on: {given}; the oldest pose when it was heard: {:.0} ms. Withheld by the phone, \
         because they came too late: {withheld}.\n\n\
         ## Share of the time in which the walker was guided\n\n\
         Legs without a stall; in brackets the images a second. The rest of the time the guide said stop. The three walks side \
         by side share two cores.\n\n",
        results.len(),
        took_s / 60.0,
        oldest(|r| r.oldest_said_ms),
        oldest(|r| r.leg.oldest_ms),
    );
    text += "No segment lost:\n\n";
    text += &grid(results, |loss| loss == 0.0);
    text += "\n1 or 3 % of the segments lost:\n\n";
    text += &grid(results, |loss| loss > 0.0);
    let stalled: Vec<_> = results.iter().filter(|r| r.trial.stall.is_some()).collect();
    let resumed = stalled.iter().filter(|r| r.leg.connections > 0).count();
    let _ = writeln!(
        text,
        "\n{} legs had a stall; in {resumed} of them the phone opened a new connection, and had its walk back by itself.",
        stalled.len()
    );
    text
}

/// The share of guided time by rate and round trip, over legs without a stall whose loss satisfies the condition.
fn grid(results: &[Result], lossy: fn(f64) -> bool) -> String {
    let mut text = String::new();
    let trips = sorted(results.iter().map(|r| r.trial.round_trip_ms as f64));
    let rates = sorted(results.iter().map(|r| -r.trial.mbit_s));
    let _ = writeln!(
        text,
        "| rate | {} |",
        trips.iter().map(|t| format!("{t} ms")).collect::<Vec<_>>().join(" | ")
    );
    let _ = writeln!(text, "|---|{}", "---|".repeat(trips.len()));
    for rate in rates {
        let cell = |trip: &f64| {
            let here = |r: &&Result| {
                let Trial { mbit_s, round_trip_ms, loss, stall } = r.trial;
                mbit_s == -rate
                    && round_trip_ms as f64 == *trip
                    && stall.is_none()
                    && lossy(loss[0].max(loss[1]))
            };
            let legs: Vec<_> = results.iter().filter(here).map(|r| r.leg).collect();
            let sum = |f: fn(&crate::network::Leg) -> f64| legs.iter().map(f).sum::<f64>();
            let (total, took) = (sum(|l| l.total_s).max(1e-3), sum(|l| l.took_s));
            match legs.is_empty() {
                true => "-".to_owned(),
                false => format!(
                    "{:.0} % ({:.1})",
                    100.0 * sum(|l| l.guided_s) / total,
                    sum(|l| l.pictures as f64) / took
                ),
            }
        };
        let cells: Vec<_> = trips.iter().map(cell).collect();
        let _ = writeln!(text, "| {} Mbit/s | {} |", -rate, cells.join(" | "));
    }
    text
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}
