//! What a walk is made of: its shape and the faults that may happen on it, drawn from a seed.

use cairn_geometry::Vec2;
use cairn_guide::{Facing, Travel};
use cairn_phrases::Language;
use cairn_random::Random;
use cairn_trial::walk::random_route;
use std::fmt;

/// What can fail. The number of each says which random numbers are its own, so that it does the same whichever others there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// White noise of 2 cm and half a degree on each pose.
    Noise,
    /// The odometry drifts by half a per cent and 0.1 degrees a metre; the map is corrected every 10 m.
    Drift,
    /// It drifts by up to 1.5 per cent and 0.15 degrees a metre; the map is corrected every 25 m.
    LateCorrections,
    /// Tracking is lost for 0.2 to 3 s.
    ShortLosses,
    /// Tracking is lost for 3 to 40 s.
    LongLosses,
    /// The motion sensors alone carry the pose, and drift.
    Coasting,
    /// After a loss the odometry begins anew, in another frame.
    NewSegments,
    /// A single pose is off by one to three metres.
    Outliers,
    /// The pose runs away, faster than anyone walks.
    Runaway,
    /// One camera without motion sensors: lengths have a unit of their own.
    NoMetres,
    /// Tracking goes on for a while in a new map with a unit of its own.
    OwnUnit,
    /// What tracks is away and started again.
    Away,
    /// The engine fails for good.
    Dies,
    /// A step of the engine takes up to a second.
    SlowEngine,
    /// Camera and voice are a phone's, over a network.
    Phone,
    /// The network is slow, and its delay varies.
    SlowNetwork,
    /// Nothing gets through the network for up to 8 s.
    Stalls,
    /// The phone's clock is known only within a bound.
    ClockError,
    /// For a while the phone's clock is not known.
    ClockUnknown,
    /// The camera gives no pictures for a while.
    CameraStops,
    /// The camera gives the same picture again and again.
    Frozen,
    /// Three pictures a second.
    FewPictures,
    /// The walker follows late.
    Late,
    /// The walker takes one side for the other.
    OtherSide,
    /// The walker does not hear a sentence.
    Deaf,
    /// The walker stands still of their own accord.
    StandsStill,
    /// The walker wanders off.
    WandersOff,
    /// The walker gives commands.
    Commands,
    /// The disk is full while the route is recorded, or fails.
    DiskFails,
}

impl Fault {
    /// All.
    pub const ALL: [Self; 29] = [
        Self::Noise,
        Self::Drift,
        Self::LateCorrections,
        Self::ShortLosses,
        Self::LongLosses,
        Self::Coasting,
        Self::NewSegments,
        Self::Outliers,
        Self::Runaway,
        Self::NoMetres,
        Self::OwnUnit,
        Self::Away,
        Self::Dies,
        Self::SlowEngine,
        Self::Phone,
        Self::SlowNetwork,
        Self::Stalls,
        Self::ClockError,
        Self::ClockUnknown,
        Self::CameraStops,
        Self::Frozen,
        Self::FewPictures,
        Self::Late,
        Self::OtherSide,
        Self::Deaf,
        Self::StandsStill,
        Self::WandersOff,
        Self::Commands,
        Self::DiskFails,
    ];

    fn bit(self) -> u32 {
        1 << self as u32
    }

    /// How likely a walk has it: what most walks have, and what is rare.
    fn chance(self) -> f64 {
        match self {
            Self::Noise | Self::Phone => 0.6,
            Self::Dies => 0.03,
            Self::NoMetres | Self::OwnUnit => 0.1,
            _ => 0.2,
        }
    }
}

/// A set of faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(u32);

impl Faults {
    /// Whether it holds a fault.
    pub fn has(self, fault: Fault) -> bool {
        self.0 & fault.bit() != 0
    }

    /// The faults in it.
    pub fn each(self) -> impl Iterator<Item = Fault> {
        Fault::ALL.into_iter().filter(move |fault| self.has(*fault))
    }

    /// The same with another.
    pub fn with(self, fault: Fault) -> Self {
        Self(self.0 | fault.bit())
    }

    /// The same without one.
    pub fn without(self, fault: Fault) -> Self {
        Self(self.0 & !fault.bit())
    }

    /// Reads the names of some, divided by commas.
    ///
    /// # Errors
    /// A name that none has.
    pub fn parse(text: &str) -> Result<Self, String> {
        let named = |name: &str| Fault::ALL.into_iter().find(|fault| format!("{fault:?}") == name);
        let mut names = text.split(',').map(str::trim).filter(|name| !name.is_empty());
        names.try_fold(Self::default(), |faults, name| {
            let fault = named(name).ok_or_else(|| format!("no fault is called {name}"))?;
            Ok(faults.with(fault))
        })
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let names: Vec<String> = self.each().map(|fault| format!("{fault:?}")).collect();
        f.write_str(&names.join(","))
    }
}

/// A walk before it is gone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scenario {
    /// From which all is drawn.
    pub seed: u64,
    /// What may fail.
    pub faults: Faults,
    /// The route has at most so many straight legs.
    pub legs: usize,
    /// From so many seconds after guidance was asked for on, nothing fails any more.
    pub calm_s: f64,
}

/// How a route is gone.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    pub line: Vec<Vec2>,
    pub facing: Facing,
    pub travel: Travel,
    pub language: Language,
}

impl Scenario {
    /// The walk of a seed.
    pub fn of(seed: u64) -> Self {
        let mut random = Random::stream(seed, 1000);
        let faults = Fault::ALL.into_iter().filter(|fault| random.chance(fault.chance()));
        let faults = faults.fold(Faults::default(), Faults::with);
        // Without a phone there is no network.
        let on_the_way = [Fault::SlowNetwork, Fault::Stalls, Fault::ClockError, Fault::ClockUnknown];
        let faults = match faults.has(Fault::Phone) {
            true => faults,
            false => on_the_way.into_iter().fold(faults, Faults::without),
        };
        Self { seed, faults, legs: usize::MAX, calm_s: random.uniform(20.0, 120.0) }
    }

    /// Random numbers for one purpose.
    pub(crate) fn random(&self, purpose: u64) -> Random {
        Random::stream(self.seed, purpose)
    }

    /// The same walk on the same route each time.
    pub(crate) fn shape(&self) -> Shape {
        let mut random = self.random(1001);
        let crossing = random.chance(0.25);
        let mut line = random_route(self.seed, crossing);
        line.truncate(self.legs.saturating_add(1).max(2));
        let (facing, travel) = [
            (Facing::Home, Travel::Home),
            (Facing::Back, Travel::Home),
            (Facing::Backwards, Travel::Home),
            (Facing::Home, Travel::Again),
        ][random.below(4)];
        let language = Language::ALL[random.below(Language::ALL.len())];
        Shape { line, facing, travel, language }
    }
}

impl fmt::Display for Scenario {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "--seed {} --faults {}", self.seed, self.faults)?;
        if self.legs < usize::MAX {
            write!(f, " --legs {}", self.legs)?;
        }
        write!(f, " --calm {}", self.calm_s)
    }
}
