//! The ordered merge: streams of images, depth and IMU, each with its own rate and delay, become instants in order.
//!
//! In go single images, depth images and IMU samples as they arrive; out come [`Merged`] instants whose stamps rise
//! strictly. An instant is complete when every camera has its image, the depth image is there or can not come any
//! more, and an IMU sample at or after it has come. What is missing is waited for no longer than
//! [`MergeConfig::wait_s`]: then a camera's instant is dropped, depth is left out, and the IMU sample is made up by
//! holding the last one, at most one period long and marked by its [`ImuSample::noise_scale`].
//!
//! Nothing here knows a thread or a clock: time is the newest stamp that any stream has shown, or what the caller
//! says with [`Merge::advance`].

mod lane;

use crate::{ImuSample, Stamp};
use lane::Lane;
pub use lane::{Dropped, Why};

/// Noise of a made-up sample against a real one. Held for one period of 5 ms at the 10 rad/s^2 of a hand in motion the
/// rate is wrong by 0.05 rad/s, some twenty times the white noise of a MEMS gyroscope; most motion is slower.
const HELD_NOISE: f64 = 10.0;

/// IMU samples older than this before the newest are given up when no image comes, seconds.
const MOST_PENDING_S: f64 = 60.0;

/// Which streams there are and how long they may let each other wait.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergeConfig {
    /// Cameras whose images make up an instant; at least one.
    pub cameras: usize,
    /// Whether depth images come.
    pub depth: bool,
    /// The period of the IMU in seconds, where there is one.
    pub imu_period_s: Option<f64>,
    /// Seconds to add to an IMU stamp to get the image clock: `t_imu + offset = t_image`.
    pub imu_offset_s: f64,
    /// Images (and depth) at most so far apart belong to one instant, seconds.
    pub same_instant_s: f64,
    /// An instant waits so long for what it lacks, seconds of the streams' time; infinite for recordings, where each
    /// stream tells its end.
    pub wait_s: f64,
    /// IMU samples are kept for so long before the first image, seconds.
    pub lead_s: f64,
}

impl Default for MergeConfig {
    fn default() -> Self {
        Self {
            cameras: 1,
            depth: false,
            imu_period_s: None,
            imu_offset_s: 0.0,
            same_instant_s: 0.005,
            wait_s: 0.1,
            lead_s: 1.0,
        }
    }
}

/// A stream, as [`Merge::end`] and [`Merge::lacks`] name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// A camera by its place in the rig.
    Camera(usize),
    /// The depth sensor.
    Depth,
    /// The inertial sensor.
    Imu,
}

/// All sensors at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged<I, D> {
    /// Time of the first camera's image.
    pub stamp: Stamp,
    /// One image per camera.
    pub images: Vec<I>,
    /// The depth image of this instant, if there is one.
    pub depth: Option<D>,
    /// See [`crate::FramePacket::imu`].
    pub imu: Vec<ImuSample>,
}

/// Two IMU samples with a hole between them, of more than two and a half periods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImuGap {
    /// The last sample before it.
    pub from: Stamp,
    /// The first after it.
    pub to: Stamp,
}

/// What the merge had to do without.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MergeCounts {
    /// IMU samples whose time went backwards, was repeated or jumped ahead, or whose numbers were not finite.
    pub imu_dropped: usize,
    /// IMU samples given up because no image came for a minute.
    pub imu_given_up: usize,
    /// Holes in the IMU's stream.
    pub imu_gaps: usize,
    /// The longest of them, seconds.
    pub longest_imu_gap_s: f64,
    /// Instants whose last IMU sample was made up.
    pub synthesised: usize,
    /// Instants without an IMU sample at or after the image, real or made up.
    pub without_imu: usize,
    /// Images whose time did not go forward.
    pub images_dropped: usize,
    /// Images without a partner in the other cameras.
    pub unpaired: usize,
    /// Depth images that belong to no instant, or whose time did not go forward.
    pub depth_dropped: usize,
}

/// The merge; see the head of this module.
pub struct Merge<I, D> {
    config: MergeConfig,
    cameras: Vec<Lane<I>>,
    depth: Lane<D>,
    imu: Lane<ImuSample>,
    /// The last real sample that was given.
    last_imu: Option<ImuSample>,
    now: Option<Stamp>,
    any_given: bool,
    counts: MergeCounts,
}

impl<I, D> Merge<I, D> {
    /// An empty merge.
    pub fn new(config: MergeConfig) -> Self {
        Self {
            config,
            cameras: (0..config.cameras.max(1)).map(|_| Lane::new(false)).collect(),
            depth: Lane::new(!config.depth),
            imu: Lane::new(config.imu_period_s.is_none()),
            last_imu: None,
            now: None,
            any_given: false,
            counts: MergeCounts::default(),
        }
    }

    /// What had to be done without so far.
    pub fn counts(&self) -> &MergeCounts {
        &self.counts
    }

    /// Takes an image of a camera, by its place in the rig.
    ///
    /// # Errors
    /// What was dropped for it: itself, or one before it that it proves wrong.
    pub fn push_image(&mut self, camera: usize, stamp: Stamp, image: I) -> Result<(), Dropped> {
        let result = match self.cameras.get_mut(camera) {
            Some(lane) => lane.push(stamp, image),
            None => Err(Dropped { stamp, why: Why::Unknown }),
        };
        self.counts.images_dropped += result.is_err() as usize;
        self.see(self.cameras.get(camera).and_then(Lane::last));
        result.map(|_| ())
    }

    /// Takes a depth image.
    ///
    /// # Errors
    /// As [`Merge::push_image`].
    pub fn push_depth(&mut self, stamp: Stamp, depth: D) -> Result<(), Dropped> {
        let result = self.depth.push(stamp, depth);
        self.counts.depth_dropped += result.is_err() as usize;
        self.see(self.depth.last());
        result.map(|_| ())
    }

    /// Takes an IMU sample, stamped by the IMU's clock; tells of a hole before it.
    ///
    /// # Errors
    /// As [`Merge::push_image`].
    pub fn push_imu(&mut self, sample: ImuSample) -> Result<Option<ImuGap>, Dropped> {
        let offset_ns = (self.config.imu_offset_s * 1e9).round() as i64;
        let stamp = Stamp(sample.stamp.0.saturating_add(offset_ns));
        let finite = sample.gyro.iter().chain(sample.accel.iter()).all(|v| v.is_finite());
        let result = match finite {
            true => self.imu.push(stamp, ImuSample { stamp, ..sample }),
            false => Err(Dropped { stamp, why: Why::NotFinite }),
        };
        self.counts.imu_dropped += result.is_err() as usize;
        self.see(self.imu.last());
        self.forget_old();
        let most = 2.5 * self.config.imu_period_s.unwrap_or(f64::INFINITY);
        let gap = result?.map(|(from, to)| ImuGap { from, to }).filter(|g| g.to - g.from > most);
        if let Some(g) = gap {
            self.counts.imu_gaps += 1;
            self.counts.longest_imu_gap_s = self.counts.longest_imu_gap_s.max(g.to - g.from);
        }
        Ok(gap)
    }

    /// Says that a stream has ended: nothing waits for it any more.
    pub fn end(&mut self, stream: Stream) {
        match stream {
            Stream::Camera(i) => {
                if let Some(lane) = self.cameras.get_mut(i) {
                    lane.end();
                }
            }
            Stream::Depth => self.depth.end(),
            Stream::Imu => self.imu.end(),
        }
    }

    /// Says what time it is in the images' clock, so that waiting ends although no stream moves.
    pub fn advance(&mut self, now: Stamp) {
        self.see(Some(now));
        self.cameras.iter_mut().for_each(|lane| lane.confirm(now));
        self.depth.confirm(now);
        self.imu.confirm(now);
    }

    /// What the next instant lacks; `None` when [`Merge::pop`] would give it.
    pub fn lacks(&mut self) -> Option<Stream> {
        self.drop_unpaired();
        let Some(stamp) = self.front() else {
            let empty = self.cameras.iter().position(|lane| lane.queue.is_empty());
            return Some(Stream::Camera(empty.unwrap_or(0)));
        };
        let late = self.is_late(stamp);
        let depth_passed =
            self.depth.last().is_some_and(|depth| depth - stamp >= -self.config.same_instant_s);
        if !late && !self.depth.ended && !depth_passed {
            return Some(Stream::Depth);
        }
        let imu_passed = self.imu.last().is_some_and(|imu| imu >= stamp);
        (!late && !self.imu.ended && !imu_passed).then_some(Stream::Imu)
    }

    /// The next instant, when it is complete or has waited long enough.
    pub fn pop(&mut self) -> Option<Merged<I, D>> {
        if self.lacks().is_some() {
            return None;
        }
        let stamp = self.front()?;
        let taken = self.cameras.iter_mut().filter_map(|lane| lane.queue.pop_front());
        let images = taken.map(|(_, image)| image).collect();
        let depth = self.depth_at(stamp);
        let imu = if self.config.imu_period_s.is_some() { self.imu_until(stamp) } else { Vec::new() };
        self.any_given = true;
        Some(Merged { stamp, images, depth, imu })
    }

    fn see(&mut self, stamp: Option<Stamp>) {
        self.now = self.now.max(stamp);
    }

    fn is_late(&self, stamp: Stamp) -> bool {
        self.now.is_some_and(|now| now - stamp > self.config.wait_s)
    }

    /// The stamp of the next instant, when every camera has an image for it.
    fn front(&self) -> Option<Stamp> {
        let all = self.cameras.iter().all(|lane| !lane.queue.is_empty());
        self.cameras.first().filter(|_| all)?.queue.front().map(|(stamp, _)| *stamp)
    }

    /// Drops images for which another camera has no partner and can not have one any more.
    fn drop_unpaired(&mut self) {
        loop {
            let fronts = || {
                let front = |(i, lane): (usize, &Lane<I>)| lane.queue.front().map(|(stamp, _)| (*stamp, i));
                self.cameras.iter().enumerate().filter_map(front)
            };
            let (Some((newest, _)), Some((oldest, camera))) = (fronts().max(), fronts().min()) else {
                return;
            };
            let hopeless =
                self.cameras.iter().any(|lane| lane.queue.is_empty() && (lane.ended || self.is_late(newest)));
            if !hopeless && newest - oldest <= self.config.same_instant_s {
                return;
            }
            self.cameras[camera].queue.pop_front();
            self.counts.unpaired += 1;
        }
    }

    /// The nearest depth image within the tolerance; those before it are dropped.
    fn depth_at(&mut self, stamp: Stamp) -> Option<D> {
        let tolerance = self.config.same_instant_s;
        while let Some((at, _)) = self.depth.queue.front() {
            let off = *at - stamp;
            if off > tolerance {
                return None;
            }
            let nearer = self.depth.queue.get(1).is_some_and(|(next, _)| (*next - stamp).abs() < off.abs());
            let (_, depth) = self.depth.queue.pop_front()?;
            if off >= -tolerance && !nearer {
                return Some(depth);
            }
            self.counts.depth_dropped += 1;
        }
        None
    }

    /// Samples up to the first at or after the stamp; where there is none, the last is held for at most a period.
    fn imu_until(&mut self, stamp: Stamp) -> Vec<ImuSample> {
        let mut out = Vec::new();
        if !self.any_given {
            let lead_s = self.config.lead_s;
            while self.imu.queue.front().is_some_and(|(s, _)| stamp - *s > lead_s) {
                self.imu.queue.pop_front();
            }
        }
        while self.last_imu.is_none_or(|last| last.stamp < stamp) {
            let Some((_, sample)) = self.imu.queue.pop_front() else { break };
            out.push(sample);
            self.last_imu = Some(sample);
        }
        match self.last_imu {
            Some(last) if last.stamp >= stamp => {}
            Some(last) if stamp - last.stamp <= self.config.imu_period_s.unwrap_or(0.0) => {
                out.push(ImuSample { stamp, noise_scale: HELD_NOISE, ..last });
                self.counts.synthesised += 1;
            }
            _ => self.counts.without_imu += 1,
        }
        out
    }

    fn forget_old(&mut self) {
        let Some(newest) = self.imu.last() else { return };
        while self.imu.queue.front().is_some_and(|(s, _)| newest - *s > MOST_PENDING_S) {
            self.imu.queue.pop_front();
            self.counts.imu_given_up += 1;
        }
    }
}
