//! When a lost depth camera is looked for, and where that runs: beside tracking on a thread of its own, or with each packet
//! where the engine runs in lockstep.

use super::search::{DepthQuery, SearchCounts, Seeker};
use crate::depth_link::Link;
use cairn_atlas::MapId;
use cairn_dense::{Locator, Place};
use cairn_geometry::Se3;
use cairn_sensor::{DepthImage, Host, Stamp, Work};
use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Images under way to the thread, at most: later ones are left out until it has caught up.
const MOST_WAITING: usize = 64;
/// Seconds between two images that are looked at.
const APART_S: f64 = 0.045;

enum Order {
    Begin(Vec<Place>),
    See(DepthQuery),
}

enum Worker {
    Inline(Box<Seeker>),
    Thread { orders: Sender<Order>, waiting: Arc<AtomicUsize> },
}

/// What the search did so far.
#[derive(Clone, Default)]
struct Counts(Arc<Mutex<SearchCounts>>);

impl Counts {
    fn lock(&self) -> MutexGuard<'_, SearchCounts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The search of an engine's lost camera.
pub(super) struct LostCamera {
    link: Link,
    counts: Counts,
    worker: Worker,
    depth_from_camera: Se3,
    /// Seconds without a pose after which it begins.
    after_s: f64,
    lost_since: Option<Stamp>,
    is_searching: bool,
    last_sent: Option<Stamp>,
}

impl LostCamera {
    /// For an engine at the other end of `link`; on a thread where `threaded`.
    ///
    /// # Errors
    /// When the host has no thread for it.
    pub fn new(
        link: Link,
        locator: Locator,
        camera_from_depth: Se3,
        after_s: f64,
        threaded: bool,
        host: &Host,
    ) -> io::Result<Self> {
        let depth_from_camera = camera_from_depth.inverse();
        let seeker = Box::new(Seeker::new(locator, depth_from_camera, host.clock.clone()));
        let counts = Counts::default();
        let worker = if threaded {
            let (orders, taken) = channel();
            let waiting = Arc::new(AtomicUsize::new(0));
            let (seen, to, done) = (waiting.clone(), link.clone(), counts.clone());
            // It ends when this is dropped, after the look it is at.
            let work = Work::new("cairn-search", move || run(*seeker, &taken, &seen, &to, &done));
            host.threads.spawn(work.in_background())?;
            Worker::Thread { orders, waiting }
        } else {
            Worker::Inline(seeker)
        };
        let (lost_since, is_searching, last_sent) = (None, false, None);
        Ok(Self { link, counts, worker, depth_from_camera, after_s, lost_since, is_searching, last_sent })
    }

    /// Whether the camera has been lost for so long that its place is to be looked for, and no search goes on.
    pub fn is_due(&mut self, stamp: Stamp, is_lost: bool) -> bool {
        if !is_lost {
            if std::mem::take(&mut self.is_searching) {
                self.order(Order::Begin(Vec::new()));
            }
            self.lost_since = None;
            return false;
        }
        let since = *self.lost_since.get_or_insert(stamp);
        !self.is_searching && stamp - since >= self.after_s && self.link.lock().is_of_use
    }

    /// The maps that are aligned with gravity.
    pub fn gravity_aligned(&self) -> Vec<MapId> {
        self.link.lock().gravity_aligned.clone()
    }

    /// Begins to look in these places.
    pub fn begin(&mut self, places: Vec<Place>) {
        self.is_searching = !places.is_empty();
        self.order(Order::Begin(places));
    }

    /// The depth image of a lost camera.
    pub fn see(&mut self, stamp: Stamp, image: &Arc<DepthImage>) {
        let is_near = self.last_sent.is_some_and(|last| (0.0..APART_S).contains(&(stamp - last)));
        if !self.is_searching || is_near {
            return;
        }
        self.last_sent = Some(stamp);
        let up = self.link.lock().up.map(|up| self.depth_from_camera.rotation * up);
        self.order(Order::See(DepthQuery { stamp, image: image.clone(), up }));
    }

    pub fn counts(&self) -> SearchCounts {
        let [taken, not_taken] = self.link.lock().taken;
        SearchCounts { taken, not_taken, ..*self.counts.lock() }
    }

    fn order(&mut self, order: Order) {
        match &mut self.worker {
            Worker::Inline(seeker) => obey(seeker, &order, true, &self.link, &self.counts),
            Worker::Thread { orders, waiting } => {
                let is_sight = matches!(order, Order::See(_));
                if is_sight && waiting.load(Ordering::Relaxed) >= MOST_WAITING {
                    return;
                }
                // A thread that has ended looks for nothing more.
                if orders.send(order).is_ok() && is_sight {
                    waiting.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
    }
}

/// Does what is ordered.
fn obey(seeker: &mut Seeker, order: &Order, is_newest: bool, link: &Link, counts: &Counts) {
    let found = match order {
        Order::Begin(places) => {
            seeker.begin(places.clone());
            None
        }
        Order::See(sight) => seeker.take(sight, is_newest),
    };
    *counts.lock() = seeker.counts;
    if found.is_some() || matches!(order, Order::Begin(_)) {
        link.lock().found = found;
    }
}

/// The thread: images one after the other while a place is followed, else the newest.
fn run(mut seeker: Seeker, orders: &Receiver<Order>, waiting: &AtomicUsize, link: &Link, counts: &Counts) {
    let mut next = orders.recv().ok();
    while let Some(order) = next.take() {
        waiting.fetch_sub(usize::from(matches!(order, Order::See(_))), Ordering::Relaxed);
        let behind = orders.try_recv();
        let is_newest = !matches!(behind, Ok(Order::See(_)));
        let is_overtaken = matches!((&order, &behind), (Order::See(_), Ok(_))) && !seeker.follows();
        if !is_overtaken {
            obey(&mut seeker, &order, is_newest, link, counts);
        }
        next = match behind {
            Ok(order) => Some(order),
            Err(TryRecvError::Empty) => orders.recv().ok(),
            Err(TryRecvError::Disconnected) => None,
        };
    }
}
