//! One line about messages that were refused, not one for each.

use crate::Refused;
use std::collections::HashMap;
use std::mem::{Discriminant, discriminant};

/// Says why messages are refused: the first of a kind, then the 10th, the 100th and so on.
#[derive(Debug, Default)]
pub struct RefusalLog(HashMap<Discriminant<Refused>, u64>);

impl RefusalLog {
    /// What is to be said about this one, if anything.
    pub fn line(&mut self, why: &Refused) -> Option<String> {
        let count = self.0.entry(discriminant(why)).or_insert(0);
        *count += 1;
        match *count {
            1 => Some(format!("a message was refused: {why}")),
            n if n == 10u64.pow(n.ilog10()) => Some(format!("{n} messages were refused, lastly: {why}")),
            _ => None,
        }
    }

    /// Messages refused so far.
    pub fn count(&self) -> u64 {
        self.0.values().sum()
    }
}
