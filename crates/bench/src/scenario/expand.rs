//! The runs of a scenario: all combinations of the values of its axes, as bindings.

use super::{Axis, Scenario, Value};
use crate::MeasureError;
use cairn_random::Random;
use std::collections::BTreeMap;

/// Texts by name.
pub type Bindings = BTreeMap<String, String>;

/// So many names a text may have.
const MOST_NAMES: usize = 100;
/// After so many seeds worlds and difficulties of the simulated walks come again.
const SEEDS_PERIOD: u64 = 48;

/// A text with the bindings that it names in braces; what they are bound to may name others.
///
/// # Errors
/// When one is not bound.
pub fn fill(text: &str, bindings: &Bindings) -> Result<String, MeasureError> {
    let mut out = text.to_owned();
    for _ in 0..MOST_NAMES {
        let Some((begin, length)) = out.find('{').and_then(|b| Some((b, out[b..].find('}')?))) else {
            return Ok(out);
        };
        let name = &out[begin + 1..begin + length];
        let value =
            bindings.get(name).ok_or_else(|| format!("nothing is bound to {{{name}}} in {text:?}"))?;
        out.replace_range(begin..=begin + length, &value.clone());
    }
    Err(format!("{text:?} names itself").into())
}

impl Axis {
    /// The bindings of each of its values.
    fn values(&self) -> Vec<Bindings> {
        let named = |name: String| Bindings::from([(self.name.clone(), name)]);
        if let Some([first, last]) = self.numbers {
            return (first..=last).map(|n| named(n.to_string())).collect();
        }
        let of = |value: &Value| match value {
            Value::Plain(name) => named(name.clone()),
            Value::Named(all) => {
                let mut all = all.clone();
                let name = all.remove("name").unwrap_or_default();
                all.into_iter().chain(named(name)).collect()
            }
        };
        self.values.iter().map(of).collect()
    }

    /// Those that are chosen, in order: the names, or `A..B` (both included) of an axis of numbers. What it has no such value for is
    /// an error, except for a number: seeds go on beyond the usual ones.
    fn chosen(&self, wanted: Option<&String>) -> Result<Vec<Bindings>, MeasureError> {
        let all = self.values();
        let is = |value: &Bindings, name: &str| value[&self.name] == name;
        let Some(wanted) = wanted else {
            let usual = |value: &Bindings| self.usual.is_empty() || self.usual.contains(&value[&self.name]);
            return Ok(all.into_iter().filter(usual).collect());
        };
        if self.numbers.is_some() {
            let bad = || MeasureError::from(format!("{}={wanted}: write N, N,N or N..N", self.name));
            let mut numbers = Vec::new();
            for part in wanted.split(',') {
                let (from, to) = part.split_once("..").unwrap_or((part, part));
                let [from, to] = [from, to].map(|n| n.parse::<u64>().map_err(|_| bad()));
                numbers.extend(from?..=to?);
            }
            return Ok(numbers
                .into_iter()
                .map(|n| Bindings::from([(self.name.clone(), n.to_string())]))
                .collect());
        }
        let mut out = Vec::new();
        for name in wanted.split(',') {
            let found = all.iter().find(|value| is(value, name)).ok_or_else(|| {
                let names: Vec<&str> = all.iter().map(|value| value[&self.name].as_str()).collect();
                format!("{} has no value {name:?}, it has {}", self.name, names.join(", "))
            })?;
            out.push(found.clone());
        }
        Ok(out)
    }
}

impl Scenario {
    /// The bindings of each run, with what is set: values of axes, or bindings.
    ///
    /// # Errors
    /// When an axis has no such value, or nothing has such a name.
    pub fn runs(&self, set: &Bindings) -> Result<Vec<Bindings>, MeasureError> {
        let mut runs = vec![self.given.clone()];
        for axis in &self.axis {
            let values = axis.chosen(set.get(&axis.name))?;
            let with = |run: &Bindings, value: &Bindings| -> Bindings {
                run.clone().into_iter().chain(value.clone()).collect()
            };
            runs = runs.iter().flat_map(|run| values.iter().map(move |value| with(run, value))).collect();
        }
        for run in &mut runs {
            if let Some(seed) = run.get("seed").and_then(|seed| seed.parse::<u64>().ok()) {
                for (name, by_seed) in &self.by_seed {
                    let at = (seed / by_seed.every.max(1)) as usize % by_seed.of.len().max(1);
                    let value = by_seed.of.get(at).cloned().unwrap_or_default();
                    run.entry(name.clone()).or_insert(value);
                }
            }
            let is_axis = |name: &String| self.axis.iter().any(|axis| axis.name == *name);
            for (name, value) in set.iter().filter(|(name, _)| !is_axis(name)) {
                let known = run.get_mut(name).ok_or_else(|| format!("this scenario has no {name}"))?;
                known.clone_from(value);
            }
            let drawn = self.drawn(run);
            run.extend(drawn);
        }
        Ok(runs)
    }

    /// For walks with `seeds=drawn`: a seed of the same kind of walk, drawn from the number `drawn_from`.
    fn drawn(&self, run: &Bindings) -> Option<(String, String)> {
        let seed: u64 = run.get("seed")?.parse().ok()?;
        let seed = match run.get("seeds").map(String::as_str) {
            Some("drawn") => {
                let from = run.get("drawn_from")?.parse().ok()?;
                seed + SEEDS_PERIOD * (1 + Random::stream(from, seed).below(1_000_000) as u64)
            }
            _ => seed,
        };
        Some(("walk_seed".into(), seed.to_string()))
    }
}
