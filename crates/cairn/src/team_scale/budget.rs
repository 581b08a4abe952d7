//! What a robot has.

use serde::Serialize;
use std::fmt;

/// What may run out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Resource {
    /// Bytes that a robot sends in a second.
    Bandwidth,
    /// Memory of a robot's machine.
    Memory,
    /// Bytes of maps that a peer holds at most.
    Held,
    /// Time of a query for similar places.
    Query,
    /// Time to compare the words of all robots anew.
    Compare,
    /// Time to make the shared atlas anew.
    Atlas,
    /// Time to relax the pose graph of the whole atlas.
    Relax,
}

impl Resource {
    /// All, in the order of tables.
    pub const ALL: [Self; 7] =
        [Self::Bandwidth, Self::Memory, Self::Held, Self::Query, Self::Compare, Self::Atlas, Self::Relax];
}

impl fmt::Display for Resource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Bandwidth => "bandwidth",
            Self::Memory => "memory",
            Self::Held => "held maps",
            Self::Query => "query",
            Self::Compare => "words",
            Self::Atlas => "atlas",
            Self::Relax => "relax",
        })
    }
}

/// The budgets of a robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Budgets {
    /// Bytes sent in a second.
    pub bandwidth: f64,
    /// Bytes of memory.
    pub memory: f64,
    /// Bytes of maps that a peer holds.
    pub held: f64,
    /// Seconds for a query: key frames come no faster.
    pub query_s: f64,
    /// Seconds for the words of all, and for the atlas: after so long there are newer ones.
    pub renew_s: f64,
    /// Seconds to relax the pose graph.
    pub relax_s: f64,
}

impl Budgets {
    /// That of a resource.
    pub fn of(&self, resource: Resource) -> f64 {
        match resource {
            Resource::Bandwidth => self.bandwidth,
            Resource::Memory => self.memory,
            Resource::Held => self.held,
            Resource::Query => self.query_s,
            Resource::Compare | Resource::Atlas => self.renew_s,
            Resource::Relax => self.relax_s,
        }
    }
}
