//! A walk on which a rule was broken, made smaller as long as the same rule is broken: fewer faults, fewer legs, less time.

use crate::rules::Rule;
use crate::scenario::{Fault, Scenario};
use crate::walk::walk;

/// The smallest walk found on which a rule is broken, if it is on this one.
pub fn shrink(scenario: &Scenario, rule: Rule) -> Option<Scenario> {
    let breaks = |s: &Scenario| walk(s).violations.iter().any(|v| v.rule == rule);
    if !breaks(scenario) {
        return None;
    }
    let mut smallest = *scenario;
    loop {
        let before = smallest;
        // Time first, so that the walks that follow are short.
        let times = [0.25, 0.5, 0.75].map(|share| (share * before.calm_s).round());
        let legs = 1..before.legs.min(before.shape().line.len() - 1);
        let shorter = times.map(|calm_s| Scenario { calm_s, ..before });
        smallest = shorter.into_iter().filter(|s| s.calm_s >= 1.0).find(breaks).unwrap_or(smallest);
        for fault in Fault::ALL.into_iter().filter(|fault| before.faults.has(*fault)) {
            let fewer = Scenario { faults: smallest.faults.without(fault), ..smallest };
            if breaks(&fewer) {
                smallest = fewer;
            }
        }
        smallest = legs.map(|legs| Scenario { legs, ..smallest }).find(breaks).unwrap_or(smallest);
        if smallest == before {
            return Some(smallest);
        }
    }
}
