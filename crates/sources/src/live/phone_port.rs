//! The entry of a phone's images and motion data: what its page sends is kept here until the source takes it.
//!
//! In: JPEGs and motion samples with the page's own times, and round trips that compare its clock with ours. The newest image
//! wins; one whose time cannot be true is refused with the reason.

use super::page_clock::PageClock;
use cairn_geometry::Vec3;
use cairn_sensor::{ClockReading, Live, Stamp};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Motion samples kept while no images arrive; older ones are dropped.
const MAX_MOTION: usize = 2000;
/// Motion data is waited for only while it flows: this long after the last.
const MOTION_FLOWS: Duration = Duration::from_millis(500);
/// Largest accepted JPEG, bytes.
const MAX_BYTES: usize = 8 << 20;
/// A picture's time may lie ahead of the page's clock by this much beyond the error of the comparison, milliseconds: cameras
/// state the time of exposure in their own clock.
const AHEAD_MS: f64 = 50.0;
/// What the way of the words is taken to be longer while the page finds them late, seconds.
const LATE_S: f64 = 1.0;

/// One reading of a phone's motion sensors, in the axes of its image: x right, y down, z into the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionReading {
    /// The page's time in milliseconds, in the clock of its images.
    pub ms: f64,
    /// Angular rate in rad/s.
    pub gyro: Vec3,
    /// Specific force in m/s^2 (about 9.8 upwards at rest).
    pub accel: Vec3,
}

/// An image as it came.
pub(super) struct Arrived {
    /// Its page; the time of another tells nothing of it.
    pub page: u64,
    /// When it was captured, in the page's time.
    pub ms: f64,
    pub jpeg: Vec<u8>,
    pub at: Instant,
}

struct State {
    newest: Option<Arrived>,
    motion: VecDeque<MotionReading>,
    /// When motion data arrived last.
    moved: Option<Instant>,
    overtaken: usize,
    /// Why the last image was refused.
    trouble: Option<String>,
    closed: bool,
    /// The page whose images are taken, and its clock.
    page: u64,
    clock: PageClock,
    /// The page's time of its last image, milliseconds.
    last_ms: Option<f64>,
    /// The page finds that words reach it too late.
    late: bool,
    /// Nanoseconds from the page's time to the stamps; `None` until the first image of the page is delivered.
    offset: Option<i64>,
}

impl Default for State {
    fn default() -> Self {
        Self {
            newest: None,
            motion: VecDeque::new(),
            moved: None,
            overtaken: 0,
            trouble: None,
            closed: false,
            page: 0,
            clock: PageClock::new(),
            last_ms: None,
            late: false,
            offset: None,
        }
    }
}

impl State {
    /// Why an image with this time cannot be taken, if so.
    fn refuses(&self, ms: f64, bytes: usize) -> Option<&'static str> {
        if !ms.is_finite() || ms.abs() > 8.64e15 {
            return Some(
                "The page's pictures come without their time, so nobody knows how old they are. Open the page again.",
            );
        }
        if bytes > MAX_BYTES {
            return Some("The page's pictures are too large.");
        }
        let latest = self.clock.at(Instant::now()).map(|now| now.ms + 1e3 * now.bound_s + AHEAD_MS);
        if latest.is_some_and(|latest| ms > latest) {
            return Some("The page's pictures come with times that lie ahead. Open the page again.");
        }
        // An earlier time that lay ahead was no time: nothing is compared with it.
        let last = self.last_ms.filter(|last| latest.is_none_or(|latest| *last <= latest));
        last.is_some_and(|last| ms <= last)
            .then_some("The times of the page's pictures run backwards. Open the page again.")
    }
}

/// The entry for images and motion data; clones refer to the same port.
#[derive(Clone, Default)]
pub struct PhonePort(Arc<(Mutex<State>, Condvar)>);

impl PhonePort {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The page whose images and motion data come from now on, by a number of its own. The same page after a new connection
    /// keeps its clock.
    pub fn page(&self, page: u64) {
        let mut s = self.lock();
        if s.page != page {
            let fresh = State {
                page,
                moved: s.moved,
                trouble: s.trouble.take(),
                closed: s.closed,
                overtaken: s.overtaken,
                ..State::default()
            };
            *s = fresh;
        }
    }

    /// Takes a round trip to the page: the question left at `sent`, the answer with the page's milliseconds came at `received`.
    pub fn round_trip(&self, sent: Instant, received: Instant, page_ms: f64) {
        self.lock().clock.round_trip(sent, received, page_ms);
    }

    /// The page, which knows its own clock, finds that what it is told is from pictures too old; or no longer.
    pub fn late(&self, late: bool) {
        self.lock().late = late;
    }

    /// Takes a JPEG and the page's time in milliseconds at which it was captured; false when it is refused, because it is too
    /// large or because its time is missing, lies ahead or before the last one's. The reason is [`Live::trouble`]. An image
    /// that cannot be read is refused later.
    pub fn picture(&self, ms: f64, jpeg: Vec<u8>) -> bool {
        let mut s = self.lock();
        if let Some(why) = s.refuses(ms, jpeg.len()) {
            s.trouble = Some(why.to_owned());
            return false;
        }
        s.last_ms = Some(ms);
        let arrived = Arrived { page: s.page, ms, jpeg, at: Instant::now() };
        s.overtaken += usize::from(s.newest.replace(arrived).is_some());
        self.0.1.notify_all();
        true
    }

    /// The page's milliseconds of a stamp; `None` before the first image of the page.
    pub fn page_ms(&self, stamp: Stamp) -> Option<f64> {
        let offset = self.lock().offset?;
        Some(stamp.0.saturating_sub(offset) as f64 * 1e-6)
    }

    /// Takes readings of the motion sensors.
    pub fn motion(&self, samples: impl IntoIterator<Item = MotionReading>) {
        let finite = |m: &MotionReading| {
            m.ms.is_finite() && m.gyro.iter().chain(m.accel.iter()).all(|v| v.is_finite())
        };
        let mut s = self.lock();
        s.motion.extend(samples.into_iter().filter(finite));
        s.moved = Some(Instant::now());
        while s.motion.len() > MAX_MOTION {
            s.motion.pop_front();
        }
        self.0.1.notify_all();
    }

    /// The motion data of a page since the last call; waits for some until the given instant. Empty after that, when the port
    /// is closed, and once the data is another page's: its time is not known before its first image.
    pub(super) fn motion_before(&self, page: u64, until: Instant) -> VecDeque<MotionReading> {
        let mut s = self.lock();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if s.page != page {
                return VecDeque::new();
            }
            if !s.motion.is_empty() || s.closed || left.is_zero() {
                return std::mem::take(&mut s.motion);
            }
            s = self.0.1.wait_timeout(s, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Stamps of this page are its times and `offset` nanoseconds; ignored when another page sends by now.
    pub(super) fn set_offset(&self, page: u64, offset: i64) {
        let mut s = self.lock();
        if s.page == page {
            s.offset = Some(offset);
        }
    }

    /// What keeps images from being used, in words; `None` when one was.
    pub(super) fn set_trouble(&self, trouble: Option<String>) {
        self.lock().trouble = trouble;
    }

    /// Closes the port: the source ends.
    pub fn close(&self) {
        self.lock().closed = true;
        self.0.1.notify_all();
    }

    /// Whether motion data is arriving.
    pub(super) fn motion_flows(&self) -> bool {
        let s = self.lock();
        !s.motion.is_empty() || s.moved.is_some_and(|t| t.elapsed() < MOTION_FLOWS)
    }

    /// Waits for an image; `None` when the port is closed.
    pub(super) fn wait(&self) -> Option<Arrived> {
        let mut s = self.lock();
        loop {
            if let Some(picture) = s.newest.take() {
                return Some(picture);
            }
            if s.closed {
                return None;
            }
            s = self.0.1.wait(s).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Live for PhonePort {
    fn clock(&self) -> Option<ClockReading> {
        let s = self.lock();
        let (page, offset) = (s.clock.at(Instant::now())?, s.offset?);
        let now = Stamp(((page.ms * 1e6) as i64).saturating_add(offset));
        let delivery_s = page.delivery_s + if s.late { LATE_S } else { 0.0 };
        Some(ClockReading { now, bound_s: page.bound_s, delivery_s })
    }

    fn trouble(&self) -> Option<String> {
        self.lock().trouble.clone()
    }
}
