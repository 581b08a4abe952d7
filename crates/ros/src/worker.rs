//! The thread that takes messages: first for the setup, then as packets.

use crate::assemble::{Assembler, Clock};
use crate::faults::Faults;
use crate::messages::{Odometry, PoseStamped, PoseWithCovarianceStamped};
use crate::network::Incoming;
use crate::service::Service;
use crate::setup::{Found, Setup, SetupError};
use crate::time::Time;
use cairn::sensor::SkipKind;
use cairn::session::Inbox;
use ros2_client::RmwRequestId;
use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often the setup is looked at while no message comes.
const TICK: Duration = Duration::from_millis(50);
/// How long the place of the camera on the robot is waited for after all the rest is known.
const BASE_WAIT: Duration = Duration::from_secs(2);
/// Readings of the wheels that may wait.
const MOST_READINGS: usize = 1000;
/// How often it is said what is waited for.
const REMIND: Duration = Duration::from_secs(5);

/// What the node was asked for and has not dealt with.
#[derive(Default)]
pub struct PendingRequests {
    /// Calls of services that wait for their answer.
    pub calls: VecDeque<(Service, RmwRequestId)>,
    /// Readings of the wheels.
    pub wheels: VecDeque<Odometry>,
    /// The newest goal.
    pub goal: Option<PoseStamped>,
    /// The newest word on where the robot is.
    pub initial_pose: Option<PoseWithCovarianceStamped>,
}

/// The same for the worker and the node.
#[derive(Clone, Default)]
pub struct Requests(Arc<Mutex<PendingRequests>>);

impl Requests {
    /// All so far, or what came since.
    pub fn lock(&self) -> MutexGuard<'_, PendingRequests> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What the worker tells while the node is set up.
pub enum SetupEvent {
    /// What is waited for.
    Missing(Vec<String>),
    /// The rig, and the clock of the packets.
    Found(Box<Found>, Clock),
    /// Why the calibration cannot be used.
    Failed(SetupError),
}

/// Takes messages: first for the setup, then as packets.
pub struct Worker {
    /// What came in.
    pub messages: Receiver<Incoming>,
    /// Where packets go.
    pub inbox: Arc<Inbox>,
    /// Where calls of services and goals go.
    pub requests: Requests,
    /// The present time.
    pub time: Time,
    /// What is lost or refused.
    pub faults: Faults,
    /// What pictures of one instant differ by at most, seconds.
    pub pair_within_s: f64,
}

impl Worker {
    /// Waits until the rig is known, tells it, and puts packets into the inbox until that is closed.
    pub fn run(self, mut setup: Setup, tell: &Sender<SetupEvent>) {
        let Some(found) = self.set_up(&mut setup, tell) else { return };
        let mut assembler = Assembler::new(&found.rig, self.pair_within_s, self.faults.clone());
        let has_imu = found.rig.imu.is_some();
        if tell.send(SetupEvent::Found(Box::new(found), assembler.clock())).is_err() {
            return;
        }
        while let Ok(incoming) = self.messages.recv() {
            match incoming {
                Incoming::Picture(role, picture) => assembler.picture(role, &picture),
                Incoming::Imu(reading) if has_imu => assembler.imu(&reading),
                other => self.other(other),
            }
            while let Some(packet) = assembler.packet() {
                if !self.inbox.put(packet) {
                    return;
                }
            }
        }
    }

    /// Waits until the rig is known; `None` when the network has gone.
    fn set_up(&self, setup: &mut Setup, tell: &Sender<SetupEvent>) -> Option<Found> {
        let mut remind = Instant::now() + Duration::from_secs(2);
        let mut complete = None;
        loop {
            match self.messages.recv_timeout(TICK) {
                Ok(Incoming::Picture(role, picture)) => setup.picture(role, &picture.header().frame_id),
                Ok(Incoming::Info(role, info)) => setup.camera_info(role, info),
                Ok(Incoming::Static(message)) => setup.static_transforms(&message),
                Ok(Incoming::Imu(reading)) => setup.imu(reading),
                Ok(other) => self.other(other),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return None,
            }
            let missing = setup.missing();
            if missing.is_empty() {
                let since = *complete.get_or_insert_with(Instant::now);
                if setup.knows_base() || since.elapsed() > BASE_WAIT {
                    match setup.found() {
                        Ok(found) => return Some(found),
                        Err(why) => tell.send(SetupEvent::Failed(why)).ok()?,
                    }
                }
            } else if Instant::now() > remind {
                remind = Instant::now() + REMIND;
                tell.send(SetupEvent::Missing(missing.iter().map(|topic| (*topic).to_owned()).collect()))
                    .ok()?;
            }
        }
    }

    fn other(&self, incoming: Incoming) {
        match incoming {
            Incoming::ServiceCall(service, id) => {
                self.requests.lock().calls.push_back((service, id));
            }
            Incoming::Wheels(reading) => {
                let readings = &mut self.requests.lock().wheels;
                // While the node waits for the first picture nobody takes them.
                if readings.len() >= MOST_READINGS {
                    readings.pop_front();
                }
                readings.push_back(*reading);
            }
            Incoming::Goal(goal) => self.requests.lock().goal = Some(goal),
            Incoming::InitialPose(pose) => self.requests.lock().initial_pose = Some(pose),
            Incoming::Clock(clock) => self.time.set(clock.clock.stamp()),
            Incoming::Unreadable(topic, why) => {
                self.faults.count(SkipKind::Other, &format!("{topic}: a message cannot be read"), &why);
            }
            _ => {}
        }
    }
}
