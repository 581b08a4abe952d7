//! Timing statistics: percentiles of samples in milliseconds, for a whole step and for its named stages.

use serde::de::{Deserializer, MapAccess, Visitor};
use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::Duration;

/// Percentiles of samples, in milliseconds unless stated otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

impl Percentiles {
    /// Percentiles of samples in any order, with linear interpolation between ranks (numpy's default). Samples that are
    /// not finite are ignored; `None` when none remain.
    pub fn of(samples: &[f64]) -> Option<Self> {
        let mut sorted: Vec<f64> = samples.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let max = *sorted.last()?;
        let at = |fraction: f64| {
            let rank = fraction * (sorted.len() - 1) as f64;
            let low = rank.floor() as usize;
            let high = (low + 1).min(sorted.len() - 1);
            sorted[low] + (sorted[high] - sorted[low]) * (rank - low as f64)
        };
        Some(Self { p50: at(0.50), p95: at(0.95), p99: at(0.99), max })
    }
}

impl fmt::Display for Percentiles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "p50 {:.2}, p95 {:.2}, p99 {:.2}, max {:.2}", self.p50, self.p95, self.p99, self.max)
    }
}

/// Collects the durations of the named stages of a run, in order of first appearance.
#[derive(Clone, Debug, Default)]
pub struct StageTimes {
    stages: Vec<(String, Vec<f64>)>,
}

impl StageTimes {
    /// An empty collection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one sample.
    pub fn add(&mut self, stage: &str, took: Duration) {
        self.add_ms(stage, took.as_secs_f64() * 1e3);
    }

    /// Adds one sample in milliseconds.
    pub fn add_ms(&mut self, stage: &str, ms: f64) {
        match self.stages.iter_mut().find(|(name, _)| name == stage) {
            Some((_, samples)) => samples.push(ms),
            None => self.stages.push((stage.to_owned(), vec![ms])),
        }
    }

    /// The samples of a stage in milliseconds, in the order added; empty for an unknown stage.
    pub fn samples(&self, stage: &str) -> &[f64] {
        self.stages.iter().find(|(name, _)| name == stage).map_or(&[], |(_, samples)| samples)
    }

    /// The percentiles of all stages.
    pub fn summary(&self) -> Stages {
        let figures = self.stages.iter().filter_map(|(n, s)| Some((n.clone(), Percentiles::of(s)?)));
        Stages(figures.collect())
    }
}

/// Percentiles by stage, in order; in JSON an object `{"extract": {"p50": ..}, ..}`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stages(pub Vec<(String, Percentiles)>);

impl Stages {
    /// The percentiles of a stage.
    pub fn get(&self, stage: &str) -> Option<&Percentiles> {
        self.0.iter().find(|(name, _)| name == stage).map(|(_, p)| p)
    }
}

impl Serialize for Stages {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, figures) in &self.0 {
            map.serialize_entry(name, figures)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for Stages {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Stages;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of stages with their percentiles")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Stages, A::Error> {
                let mut stages = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    stages.push(entry);
                }
                Ok(Stages(stages))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_interpolated() {
        let samples: Vec<f64> = (0..=200).rev().map(f64::from).collect();
        let p = Percentiles::of(&samples).unwrap();
        assert_eq!((p.p50, p.p95, p.p99, p.max), (100.0, 190.0, 198.0, 200.0));
        let two = Percentiles::of(&[1.0, 2.0]).unwrap();
        assert_eq!((two.p50, two.max), (1.5, 2.0));
        assert!((two.p99 - 1.99).abs() < 1e-12);
        assert_eq!(Percentiles::of(&[f64::NAN]), None);
        assert_eq!(Percentiles::of(&[4.0]).unwrap().p99, 4.0);
    }

    #[test]
    fn stages_keep_their_order_through_json() {
        let mut times = StageTimes::new();
        for ms in [1.0, 3.0] {
            times.add_ms("extract", ms);
            times.add("track", Duration::from_millis(2));
            times.add_ms("map", ms * 2.0);
        }
        let stages = times.summary();
        let json = serde_json::to_string(&stages).unwrap();
        assert!(json.starts_with(r#"{"extract":{"p50":2.0,"#), "{json}");
        assert_eq!(serde_json::from_str::<Stages>(&json).unwrap(), stages);
        assert_eq!(times.samples("map"), [2.0, 6.0]);
        assert_eq!(stages.get("track").unwrap().max, 2.0);
        assert_eq!(stages.get("close"), None);
    }
}
