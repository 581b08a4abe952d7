//! The threads of a camera: each takes what one node delivers, and opens the node again when it is gone or silent.

use super::device::{
    DeviceError, Kernel, KernelStamp, Mode, MotionKind, MotionNode, Reading, Trouble, VideoNode,
};
use cairn_sensor::Stamp;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Streams by number: images, depth, gyroscope, accelerometer.
pub const STREAMS: usize = 4;
/// The stream of images.
pub const IMAGE: usize = 0;
/// The stream of depth.
pub const DEPTH: usize = 1;

/// Frames kept of a stream that nobody takes; the newest win.
const FRAMES_KEPT: usize = 4;
/// Readings kept: five seconds of 400 Hz and 250 Hz together.
const READINGS_KEPT: usize = 3250;
/// How long a step waits: an end is noticed after it.
const LOOK: Duration = Duration::from_millis(50);
/// A stream that delivers nothing for this long is told.
const SILENT: Duration = Duration::from_millis(1000);
/// And is opened again after this.
const RESTART: Duration = Duration::from_millis(2500);
/// Delays between attempts to open a device again.
const RETRY: Duration = Duration::from_millis(100);
const MAX_RETRY: Duration = Duration::from_secs(2);

/// A frame as the kernel gave it.
pub struct Frame {
    /// In the monotonic clock of this machine.
    pub stamp: Stamp,
    /// What its bytes mean.
    pub mode: Mode,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// A reading as the kernel gave it.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Of which sensor.
    pub kind: MotionKind,
    /// Counts how often the sensor was opened.
    pub session: usize,
    /// Time in its clock, and value.
    pub reading: Reading,
    /// When it came, in the monotonic clock of this machine.
    pub arrived: Stamp,
}

/// What was lost on the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames that a newer one overtook.
    pub overtaken: usize,
    /// Frames that the driver left out, by its own count.
    pub missed: usize,
    /// Frames that came with data missing.
    pub damaged: usize,
    /// Motion readings that nobody took in time.
    pub motion: usize,
}

/// What the threads of a camera share.
#[derive(Default)]
pub struct State {
    /// Images and depth.
    pub frames: [VecDeque<Frame>; 2],
    /// Both motion sensors, as they come.
    pub motion: VecDeque<Measured>,
    /// What keeps a stream from delivering, in words.
    pub trouble: [Option<String>; STREAMS],
    /// Streams that have delivered.
    pub heard: [bool; STREAMS],
    /// Events, for people.
    pub lines: Vec<String>,
    /// What was lost.
    pub counts: Counts,
    /// The source was dropped: end.
    pub closing: bool,
}

/// The state with its condition variable.
#[derive(Default)]
pub struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    /// Locks the state; a thread that panicked while holding it does not matter.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and wakes whoever waits.
    pub fn change<T>(&self, f: impl FnOnce(&mut State) -> T) -> T {
        let out = f(&mut self.lock());
        self.changed.notify_all();
        out
    }

    /// Waits until something is there to take, or for as long as this.
    pub fn wait(&self, limit: Duration, ready: impl Fn(&State) -> bool) {
        let state = self.lock();
        let waited = self.changed.wait_timeout_while(state, limit, |s| !ready(s));
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }
}

/// What one step of a thread took from its node.
pub enum Taken {
    /// A frame, none where it came damaged, and how many frames the driver left out before it.
    Image { frame: Option<Frame>, missed: usize },
    /// Motion readings.
    Motion(Vec<Measured>),
}

impl State {
    /// Keeps what a stream delivered; the newest win.
    fn keep(&mut self, stream: usize, taken: Taken) {
        match taken {
            Taken::Image { frame, missed } => {
                self.counts.missed += missed;
                let Some(frame) = frame else {
                    self.counts.damaged += 1;
                    return;
                };
                let ring = &mut self.frames[stream];
                if ring.len() == FRAMES_KEPT {
                    ring.pop_front();
                    self.counts.overtaken += 1;
                }
                ring.push_back(frame);
            }
            Taken::Motion(readings) => {
                for reading in readings {
                    if self.motion.len() == READINGS_KEPT {
                        self.motion.pop_front();
                        self.counts.motion += 1;
                    }
                    self.motion.push_back(reading);
                }
            }
        }
    }
}

/// An opened node from which a thread reads.
pub trait Feed: Send {
    /// What came within [`LOOK`], if anything did.
    ///
    /// # Errors
    /// [`DeviceError`] where the device is gone.
    fn step(&mut self, kernel: &dyn Kernel) -> Result<Option<Taken>, DeviceError>;
}

/// A video node being read.
pub struct VideoFeed {
    /// The node, started.
    pub node: Box<dyn VideoNode>,
    /// Its mode.
    pub mode: Mode,
    last_sequence: Option<u32>,
}

impl VideoFeed {
    /// A started node.
    pub fn new(node: Box<dyn VideoNode>, mode: Mode) -> Self {
        Self { node, mode, last_sequence: None }
    }
}

impl Feed for VideoFeed {
    fn step(&mut self, kernel: &dyn Kernel) -> Result<Option<Taken>, DeviceError> {
        let mut bytes = Vec::new();
        let Some(taken) = self.node.dequeue(LOOK, &mut bytes)? else { return Ok(None) };
        let step =
            self.last_sequence.replace(taken.sequence).map_or(1, |last| taken.sequence.wrapping_sub(last));
        // A driver that counts backwards, or not at all, tells nothing.
        let missed = if step <= u32::from(u16::MAX) { step.saturating_sub(1) as usize } else { 0 };
        let stamp = match taken.stamp {
            KernelStamp::Monotonic(stamp) => stamp,
            KernelStamp::Unknown => kernel.now(),
        };
        let frame = (!taken.damaged).then_some(Frame { stamp, mode: self.mode, bytes });
        Ok(Some(Taken::Image { frame, missed }))
    }
}

/// A motion node being read.
pub struct MotionFeed {
    /// What it measures.
    pub kind: MotionKind,
    /// The node, started.
    pub node: Box<dyn MotionNode>,
    /// Counts how often it was opened.
    pub session: usize,
}

impl Feed for MotionFeed {
    fn step(&mut self, kernel: &dyn Kernel) -> Result<Option<Taken>, DeviceError> {
        let mut readings = Vec::new();
        self.node.read(LOOK, &mut readings)?;
        let arrived = kernel.now();
        let (kind, session) = (self.kind, self.session);
        let measured: Vec<_> =
            readings.into_iter().map(|reading| Measured { kind, session, reading, arrived }).collect();
        Ok((!measured.is_empty()).then_some(Taken::Motion(measured)))
    }
}

/// The loop of a thread: reads, tells when nothing comes, and opens the device again. `name` begins its sentences ("The
/// camera"); `open` opens it for the given time of opening.
pub fn run(
    name: &str,
    stream: usize,
    first: Box<dyn Feed>,
    open: impl Fn(usize) -> Result<Box<dyn Feed>, DeviceError>,
    kernel: &Arc<dyn Kernel>,
    shared: &Shared,
) {
    let mut feed = Some(first);
    let (mut heard, mut session, mut retry, mut lost) = (Instant::now(), 0, RETRY, false);
    let tell = |sentence: String, lost: &mut bool| {
        shared.change(|s| {
            if !std::mem::replace(lost, true) {
                s.lines.push(sentence.clone());
            }
            s.trouble[stream] = Some(sentence);
        });
    };
    while !shared.lock().closing {
        let Some(open_feed) = &mut feed else {
            session += 1;
            match open(session) {
                Ok(again) => (feed, heard) = (Some(again), Instant::now()),
                Err(e) => {
                    tell(sentence(name, &e), &mut lost);
                    shared.wait(retry, |s| s.closing);
                    retry = (2 * retry).min(MAX_RETRY);
                }
            }
            continue;
        };
        match open_feed.step(kernel.as_ref()) {
            Ok(Some(taken)) => {
                (heard, retry) = (Instant::now(), RETRY);
                let back = std::mem::take(&mut lost);
                // In one change: whoever takes the frame finds the trouble gone.
                shared.change(|s| {
                    (s.heard[stream], s.trouble[stream]) = (true, None);
                    if back {
                        s.lines.push(format!("{name} is back."));
                    }
                    s.keep(stream, taken);
                });
            }
            Ok(None) if heard.elapsed() > SILENT => {
                tell(format!("{name} sends nothing."), &mut lost);
                if heard.elapsed() > RESTART {
                    feed = None;
                }
            }
            Ok(None) => {}
            Err(e) => {
                feed = None;
                tell(sentence(name, &e), &mut lost);
            }
        }
    }
}

/// What has happened, in a sentence that stays the same while it lasts.
fn sentence(name: &str, e: &DeviceError) -> String {
    match e.trouble {
        Trouble::Missing | Trouble::Gone => format!("{name} was unplugged. Plug it in again."),
        Trouble::Busy => format!("{name} is used by another program. Close that one."),
        Trouble::Denied => format!("{name} may not be used by this user."),
        Trouble::Unsuitable | Trouble::Other => format!("{name} cannot be used: {e}."),
    }
}
