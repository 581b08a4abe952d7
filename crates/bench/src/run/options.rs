//! What a run uses, and what is asked of it.

use cairn_engine::{Config, Runner, Sensors};

/// Options of a run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Sensors to use.
    pub sensor: Sensors,
    /// Largest number of packets.
    pub frames: usize,
    /// Seconds of the source that are used.
    pub seconds: f64,
    /// How mapping runs beside tracking.
    pub runner: Runner,
    /// Prints every frame on stderr.
    pub verbose: bool,
    /// Configuration of the engine.
    pub config: Config,
    /// Costs are summed up for each of so many seconds too.
    pub parts_s: Option<f64>,
    /// The walker stands still for the last seconds.
    pub still_s: Option<f64>,
    /// The walk has a turn on the spot, and ends where it began.
    pub turns: bool,
    /// Seconds after the first image at which a fault begins.
    pub fault_at_s: f64,
}

impl RunOptions {
    /// Options for a whole source with these sensors, in lockstep.
    pub fn new(sensor: Sensors) -> Self {
        Self {
            sensor,
            frames: usize::MAX,
            seconds: f64::INFINITY,
            runner: Runner::Lockstep,
            verbose: false,
            config: Config::default(),
            parts_s: None,
            still_s: None,
            turns: false,
            fault_at_s: 0.0,
        }
    }
}
