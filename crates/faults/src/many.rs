//! Many walks, on some threads, and their sum.

use crate::rules::Rule;
use crate::scenario::Scenario;
use crate::walk::{Outcome, walk};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// The sum of many walks.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Walks.
    pub walks: u64,
    /// Of them with guidance, and of these those that arrived.
    pub guided: u64,
    /// Arrivals.
    pub arrived: u64,
    /// Directions.
    pub directions: u64,
    /// Virtual seconds.
    pub seconds: f64,
    /// Seconds of processors that the threads took together.
    pub busy_s: f64,
    /// Why there was no guidance, how often.
    pub refused: BTreeMap<String, u64>,
    /// The seeds on which a rule was broken first, with how.
    pub broken: BTreeMap<Rule, Vec<(u64, String)>>,
}

impl Tally {
    fn add(&mut self, seed: u64, outcome: Outcome) {
        self.walks += 1;
        self.seconds += outcome.seconds;
        self.directions += outcome.directions as u64;
        self.arrived += u64::from(outcome.arrived_m.is_some());
        match outcome.refused {
            None => self.guided += 1,
            Some(why) => *self.refused.entry(why).or_default() += 1,
        }
        for v in outcome.violations {
            let seeds = self.broken.entry(v.rule).or_default();
            if seeds.last().is_none_or(|(before, _)| *before != seed) {
                seeds.push((seed, format!("{:.2} s: {}", v.t_s, v.how)));
            }
        }
    }

    fn join(&mut self, other: Self) {
        self.walks += other.walks;
        self.guided += other.guided;
        self.arrived += other.arrived;
        self.directions += other.directions;
        self.seconds += other.seconds;
        self.busy_s += other.busy_s;
        other.refused.into_iter().for_each(|(why, n)| *self.refused.entry(why).or_default() += n);
        for (rule, seeds) in other.broken {
            let all = self.broken.entry(rule).or_default();
            all.extend(seeds);
            all.sort();
        }
    }

    /// How many times faster than in life, on one core.
    pub fn times_real(&self) -> f64 {
        self.seconds / self.busy_s.max(1e-9)
    }
}

/// Seconds that this thread has been on a processor, where the system says so.
fn processor_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split(' ').next()?.parse::<f64>().ok().map(|ns| 1e-9 * ns)
}

/// Goes the walks of some seeds on so many threads. Stops after the first walk on which a rule is broken where `first` says so.
pub fn walks(seeds: Range<u64>, threads: usize, first: bool) -> Tally {
    let next = AtomicU64::new(seeds.start);
    let work = || {
        let (began, processor) = (Instant::now(), processor_s());
        let mut tally = Tally::default();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= seeds.end {
                let on_processor = processor_s().zip(processor).map(|(now, then)| now - then);
                tally.busy_s = on_processor.unwrap_or_else(|| began.elapsed().as_secs_f64());
                return tally;
            }
            tally.add(seed, walk(&Scenario::of(seed)));
            if first && !tally.broken.is_empty() {
                next.store(seeds.end, Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(work)).collect();
        let mut all = Tally::default();
        for thread in threads {
            all.join(thread.join().unwrap_or_else(|e| std::panic::resume_unwind(e)));
        }
        all
    })
}
