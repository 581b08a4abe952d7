//! Devices that are not there: the interface of [`Kernel`] over frames and motion that the caller provides, with the faults of
//! real ones. What reads them is the code that reads real devices.

use super::device::{
    Dequeued, DeviceError, ExtensionControl, Kernel, KernelStamp, Mode, MotionFound, MotionNode, Reading,
    Trouble, Usb, VideoFound, VideoNode,
};
use super::projector::EMITTER;
use cairn_geometry::Vec3;
use cairn_sensor::Stamp;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The monotonic clock of a simulated machine begins here, seconds: it has been up for a while.
const UP_S: f64 = 5000.0;
/// How late data comes after it was measured, seconds.
const WAY_S: f64 = 0.002;
/// Frames that a driver keeps for a reader that is late.
const BUFFERS: u64 = 4;
/// What a projector is set to when its device is plugged in.
const PROJECTOR_ON: u8 = 1;

/// The bytes of a frame by its number, in the mode that was set; `None` at the end of what there is.
pub type FramesOf = Arc<dyn Fn(u64, &Mode) -> Option<Vec<u8>> + Send + Sync>;
/// A measured value by the time of the machine's clock, seconds.
pub type ValuesOf = Arc<dyn Fn(f64) -> Vec3 + Send + Sync>;

/// A video node.
#[derive(Clone)]
pub struct SimulatedVideo {
    /// Node, name and place.
    pub found: VideoFound,
    /// Its modes.
    pub modes: Vec<Mode>,
    /// What it delivers.
    pub frames: FramesOf,
    /// When its first frame is exposed after the start, seconds: sensors are not triggered together.
    pub phase_s: f64,
}

/// A motion node.
#[derive(Clone)]
pub struct SimulatedMotion {
    /// Node, kind and place.
    pub found: MotionFound,
    /// Readings per second.
    pub rate_hz: f64,
    /// Its clock, seconds: `t_device + offset = t_machine`.
    pub offset_s: f64,
    /// What it measures.
    pub values: ValuesOf,
}

#[derive(Default)]
struct World {
    videos: Vec<SimulatedVideo>,
    motions: Vec<SimulatedMotion>,
    /// Nodes that answer with this to being opened or started.
    refused: Vec<(PathBuf, Trouble)>,
    /// Nodes that deliver nothing.
    silent: Vec<PathBuf>,
    /// Ports of devices with a projector, and what it is set to.
    projectors: Vec<(String, u8)>,
    unplugged: bool,
    /// Counts how often everything was plugged in: nodes opened before are dead.
    plugged: u64,
}

/// A machine with simulated devices; clones are the same machine.
#[derive(Clone)]
pub struct Simulated {
    world: Arc<Mutex<World>>,
    began: Instant,
}

impl Default for Simulated {
    fn default() -> Self {
        Self::new()
    }
}

impl Simulated {
    /// A machine without devices.
    pub fn new() -> Self {
        Self { world: Arc::default(), began: Instant::now() }
    }

    /// Where a RealSense D435i would be plugged in.
    pub fn d435i(port: &str, serial: &str) -> Usb {
        Usb { port: port.into(), vendor: super::select::INTEL, product: 0x0b3a, serial: serial.into() }
    }

    /// Plugs in a video node.
    pub fn add_video(&self, video: SimulatedVideo) {
        self.lock().videos.push(video);
    }

    /// Plugs in a motion node.
    pub fn add_motion(&self, motion: SimulatedMotion) {
        self.lock().motions.push(motion);
    }

    /// Gives the device at a port a projector, which is on.
    pub fn add_projector(&self, port: &str) {
        self.lock().projectors.push((port.to_owned(), PROJECTOR_ON));
    }

    /// Whether the projector of the device at a port is on; `None` where it has none.
    pub fn projector_is_on(&self, port: &str) -> Option<bool> {
        self.lock().projectors.iter().find(|(p, _)| p == port).map(|(_, set)| *set != 0)
    }

    /// Unplugs everything, or plugs it in again; projectors are on then.
    pub fn unplug(&self, unplugged: bool) {
        let mut world = self.lock();
        world.projectors.iter_mut().for_each(|(_, set)| *set = PROJECTOR_ON);
        world.unplugged = unplugged;
        world.plugged += 1;
    }

    /// Lets a node refuse to be opened ([`Trouble::Denied`]) or started ([`Trouble::Busy`]); `None` for no longer.
    pub fn refuse(&self, node: &Path, trouble: Option<Trouble>) {
        let mut world = self.lock();
        world.refused.retain(|(n, _)| n != node);
        world.refused.extend(trouble.map(|t| (node.to_owned(), t)));
    }

    /// Lets a node deliver nothing, or go on.
    pub fn silence(&self, node: &Path, silent: bool) {
        let mut world = self.lock();
        world.silent.retain(|n| n != node);
        world.silent.extend(silent.then(|| node.to_owned()));
    }

    /// Gives a video node other modes, as a device has after an update or at a slower port.
    pub fn set_modes(&self, node: &Path, modes: Vec<Mode>) {
        let mut world = self.lock();
        world.videos.iter_mut().filter(|v| v.found.node == node).for_each(|v| v.modes.clone_from(&modes));
    }

    /// The clock of the machine, seconds.
    pub fn seconds(&self) -> f64 {
        UP_S + self.began.elapsed().as_secs_f64()
    }

    fn lock(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a node may be used, `doing` one of [`Trouble::Denied`] (opening) and [`Trouble::Busy`] (starting).
    fn check(&self, node: &Path, doing: Trouble, plugged: Option<u64>) -> Result<u64, DeviceError> {
        let world = self.lock();
        if world.unplugged || plugged.is_some_and(|p| p != world.plugged) {
            let trouble = if plugged.is_some() { Trouble::Gone } else { Trouble::Missing };
            return Err(DeviceError::new(trouble, node.display().to_string(), "is not there"));
        }
        if world.refused.iter().any(|(n, t)| n == node && *t == doing) {
            return Err(DeviceError::new(doing, node.display().to_string(), "refused"));
        }
        Ok(world.plugged)
    }

    fn is_silent(&self, node: &Path) -> bool {
        self.lock().silent.iter().any(|n| n == node)
    }

    /// Waits for a time of the clock, but no longer than this; true when it came.
    fn wait_for(&self, at_s: f64, wait: Duration) -> bool {
        let left = at_s - self.seconds();
        std::thread::sleep(wait.min(Duration::try_from_secs_f64(left).unwrap_or_default()));
        self.seconds() >= at_s
    }
}

impl Kernel for Simulated {
    fn videos(&self) -> Result<Vec<VideoFound>, DeviceError> {
        let world = self.lock();
        Ok(if world.unplugged { Vec::new() } else { world.videos.iter().map(|v| v.found.clone()).collect() })
    }

    fn motions(&self) -> Result<Vec<MotionFound>, DeviceError> {
        let world = self.lock();
        Ok(if world.unplugged { Vec::new() } else { world.motions.iter().map(|m| m.found.clone()).collect() })
    }

    fn video(&self, node: &Path) -> Result<Box<dyn VideoNode>, DeviceError> {
        let plugged = self.check(node, Trouble::Denied, None)?;
        let video = self.lock().videos.iter().find(|v| v.found.node == node).cloned();
        let missing = || DeviceError::new(Trouble::Missing, node.display().to_string(), "is not there");
        let machine = self.clone();
        Ok(Box::new(OpenVideo {
            machine,
            video: video.ok_or_else(missing)?,
            plugged,
            running: None,
            next: 0,
        }))
    }

    fn motion(&self, node: &Path) -> Result<Box<dyn MotionNode>, DeviceError> {
        let plugged = self.check(node, Trouble::Denied, None)?;
        let motion = self.lock().motions.iter().find(|m| m.found.node == node).cloned();
        let missing = || DeviceError::new(Trouble::Missing, node.display().to_string(), "is not there");
        let machine = self.clone();
        Ok(Box::new(OpenMotion {
            machine,
            motion: motion.ok_or_else(missing)?,
            plugged,
            began_s: 0.0,
            next: 0,
        }))
    }

    fn now(&self) -> Stamp {
        Stamp::from_seconds(self.seconds())
    }
}

struct OpenVideo {
    machine: Simulated,
    video: SimulatedVideo,
    plugged: u64,
    running: Option<(f64, Mode)>,
    next: u64,
}

impl VideoNode for OpenVideo {
    fn modes(&mut self) -> Result<Vec<Mode>, DeviceError> {
        Ok(self.video.modes.clone())
    }

    fn start(&mut self, wanted: &Mode) -> Result<Mode, DeviceError> {
        self.machine.check(&self.video.found.node, Trouble::Busy, Some(self.plugged))?;
        self.running = Some((self.machine.seconds() + self.video.phase_s, *wanted));
        Ok(*wanted)
    }

    fn dequeue(&mut self, wait: Duration, into: &mut Vec<u8>) -> Result<Option<Dequeued>, DeviceError> {
        self.machine.check(&self.video.found.node, Trouble::Gone, Some(self.plugged))?;
        let Some((began_s, mode)) = self.running else { return Ok(None) };
        let exposed_s = |k: u64| began_s + k as f64 / mode.rate_hz;
        // What the driver had no buffer for is gone.
        let newest = ((self.machine.seconds() - WAY_S - began_s) * mode.rate_hz).floor().max(0.0) as u64;
        self.next = self.next.max(newest.saturating_sub(BUFFERS - 1));
        if self.machine.is_silent(&self.video.found.node) {
            std::thread::sleep(wait);
            return Ok(None);
        }
        if !self.machine.wait_for(exposed_s(self.next) + WAY_S, wait) {
            return Ok(None);
        }
        let Some(bytes) = (self.video.frames)(self.next, &mode) else {
            std::thread::sleep(wait);
            return Ok(None);
        };
        *into = bytes;
        let stamp = KernelStamp::Monotonic(Stamp::from_seconds(exposed_s(self.next)));
        self.next += 1;
        Ok(Some(Dequeued { stamp, sequence: (self.next - 1) as u32, damaged: false }))
    }

    fn control(&mut self, control: ExtensionControl) -> Result<u8, DeviceError> {
        self.projector(control, |set| *set)
    }

    fn set_control(&mut self, control: ExtensionControl, value: u8) -> Result<(), DeviceError> {
        self.projector(control, |set| *set = value)
    }
}

impl OpenVideo {
    /// The projector of its device, read or set.
    fn projector<T>(
        &self,
        control: ExtensionControl,
        use_it: impl FnOnce(&mut u8) -> T,
    ) -> Result<T, DeviceError> {
        let node = &self.video.found.node;
        self.machine.check(node, Trouble::Gone, Some(self.plugged))?;
        let mut world = self.machine.lock();
        let port = self.video.found.usb.as_ref().map(|usb| usb.port.as_str());
        let found = world.projectors.iter_mut().find(|(p, _)| control == EMITTER && Some(p.as_str()) == port);
        let missing =
            || DeviceError::new(Trouble::Unsuitable, node.display().to_string(), "has no such control");
        found.map(|(_, set)| use_it(set)).ok_or_else(missing)
    }
}

struct OpenMotion {
    machine: Simulated,
    motion: SimulatedMotion,
    plugged: u64,
    began_s: f64,
    next: u64,
}

impl MotionNode for OpenMotion {
    fn start(&mut self, _: f64) -> Result<f64, DeviceError> {
        self.machine.check(&self.motion.found.node, Trouble::Busy, Some(self.plugged))?;
        self.began_s = self.machine.seconds();
        Ok(self.motion.rate_hz)
    }

    fn read(&mut self, wait: Duration, into: &mut Vec<Reading>) -> Result<(), DeviceError> {
        self.machine.check(&self.motion.found.node, Trouble::Gone, Some(self.plugged))?;
        let at_s = |k: u64| self.began_s + k as f64 / self.motion.rate_hz;
        if !self.machine.wait_for(at_s(self.next) + WAY_S, wait) {
            return Ok(());
        }
        let silent = self.machine.is_silent(&self.motion.found.node);
        while at_s(self.next) + WAY_S <= self.machine.seconds() {
            let t = at_s(self.next);
            let device_ns = ((t - self.motion.offset_s) * 1e9).round() as i64;
            into.extend((!silent).then(|| Reading { device_ns, value: (self.motion.values)(t) }));
            self.next += 1;
        }
        Ok(())
    }
}
