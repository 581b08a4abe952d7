//! The session of a walk and the loop that drives it, as `cairn_session::drive` does with a wall clock: the newest picture whenever
//! there is one, and a tick where there is none for a while.

use crate::estimator::Reading;
use crate::modelled::{Modelled, packet};
use crate::scenario::{Fault, Scenario};
use crate::spells::{Since, Spells};
use cairn_random::Random;
use cairn_sensor::{ClockReading, Live, Stamp};
use cairn_session::Session;
use std::sync::{Arc, Mutex, PoisonError};

/// As in the inbox of a session: pictures that waited longer are dropped, but one is taken at least so often; and ticks.
const TOO_OLD_S: f64 = 0.15;
const AT_LEAST_S: f64 = 0.2;
pub(crate) const TICK_S: f64 = 0.05;

/// The clock of the pictures as the server knows it.
#[derive(Default)]
pub(crate) struct KnownClock(Mutex<Option<ClockReading>>);

impl KnownClock {
    /// Shows this from now on.
    pub fn set(&self, reading: Option<ClockReading>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = reading;
    }
}

impl Live for KnownClock {
    fn clock(&self) -> Option<ClockReading> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The server.
pub(crate) struct Server {
    pub session: Session<Modelled>,
    pub clock: Arc<KnownClock>,
    /// The newest picture, and when it came.
    inbox: Option<(Reading, Stamp)>,
    taken: Option<Stamp>,
    /// The last picture's time, and when it came.
    arrival: Option<(Stamp, Stamp)>,
    /// Busy until then.
    pub ready: Stamp,
    slow: Option<Spells>,
    random: Random,
}

impl Server {
    /// With a session that follows its clock.
    pub fn new(scenario: &Scenario, mut session: Session<Modelled>, begins: Stamp, calm: Stamp) -> Self {
        let clock = Arc::new(KnownClock::default());
        session.follow(clock.clone());
        let slow = scenario.faults.has(Fault::SlowEngine).then(|| {
            let random = scenario.random(Fault::SlowEngine as u64);
            Spells::new(random, begins, calm, [1.0, 30.0], [0.2, 4.0])
        });
        let random = scenario.random(1030);
        Self {
            session,
            clock,
            inbox: None,
            taken: None,
            arrival: None,
            ready: Stamp::default(),
            slow,
            random,
        }
    }

    /// A picture came.
    pub fn put(&mut self, reading: Reading, now: Stamp) {
        self.inbox = Some((reading, now));
    }

    /// Takes the picture that waits, where one does and is not too old; when its step will have ended.
    pub fn take(&mut self, now: Stamp) -> Option<(Reading, Stamp)> {
        let (reading, put) = self.inbox.take()?;
        let is_due = self.taken.is_some_and(|at| now - at >= AT_LEAST_S);
        if now - put > TOO_OLD_S && !is_due {
            return None;
        }
        self.taken = Some(now);
        self.arrival = Some((reading.stamp, put));
        let is_slow = self.slow.since(now).is_some();
        let step_s = if is_slow { self.random.uniform(0.1, 1.0) } else { self.random.uniform(0.01, 0.04) };
        self.ready = now.plus_seconds(step_s);
        Some((reading, self.ready))
    }

    /// Gives the session a picture.
    pub fn show(&mut self, reading: Reading) {
        self.session.engine_mut().show(reading);
        // Why it has no result is said by the session.
        let _ = self.session.on_packet(&packet(reading.stamp));
    }

    /// Time passes without a picture.
    pub fn tick(&mut self, now: Stamp) {
        if let Some((stamp, put)) = self.arrival {
            self.session.tick(stamp.plus_seconds(now - put));
        }
    }
}
