//! The ordered merge: synchronises streams of images, depth and IMU, each with its own rate and delay.
//!
//! Input: single images, depth images and IMU samples as they arrive. Output: [`Merged`] sets with strictly increasing
//! stamps. A set is complete when every camera has its image, the depth image has arrived or cannot arrive any more,
//! and an IMU sample at or after the image has arrived. Missing data is waited for no longer than
//! [`MergeConfig::wait_s`]: after that a set without all camera images is dropped, depth is left out, and the IMU
//! sample is synthesised by holding the last one, for at most one period and marked by its [`ImuSample::noise_scale`].
//!
//! The merge uses no thread and no clock: the current time is the newest stamp of any stream, or the time passed to
//! [`Merge::advance`].

mod queue;

use crate::{ImuSample, Stamp};
use queue::StreamQueue;
pub use queue::{DropReason, Dropped};

/// Noise of a synthesised sample relative to a real one. Holding a sample for one period of 5 ms, at the 10 rad/s^2 of
/// a moving hand, gives a rate error of 0.05 rad/s, some twenty times the white noise of a MEMS gyroscope; most motion
/// is slower.
const HELD_NOISE_SCALE: f64 = 10.0;

/// IMU samples older than this relative to the newest are discarded when no image arrives, seconds.
const MAX_PENDING_S: f64 = 60.0;

/// Which streams exist and how long they wait for each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergeConfig {
    /// Number of cameras whose images make up a set; at least one.
    pub cameras: usize,
    /// True with a stream of depth images.
    pub depth: bool,
    /// Period of the IMU in seconds; `None` without an IMU.
    pub imu_period_s: Option<f64>,
    /// Seconds to add to an IMU stamp to get the image clock: `t_imu + offset = t_image`.
    pub imu_offset_s: f64,
    /// Maximum time difference of images (and depth) of the same set, seconds.
    pub same_instant_s: f64,
    /// How long a set waits for missing data, seconds of stream time; infinite for recordings, where the end of each
    /// stream is known.
    pub wait_s: f64,
    /// How long before the first image IMU samples are kept, seconds.
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

/// Names a stream, for [`Merge::end`] and [`Merge::lacks`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// A camera by its index in the rig.
    Camera(usize),
    /// The depth sensor.
    Depth,
    /// The inertial sensor.
    Imu,
}

/// The synchronised data of all sensors.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged<I, D> {
    /// Time of the first camera's image.
    pub stamp: Stamp,
    /// One image per camera.
    pub images: Vec<I>,
    /// The depth image of this set, if any.
    pub depth: Option<D>,
    /// See [`crate::FramePacket::imu`].
    pub imu: Vec<ImuSample>,
}

/// A gap between two IMU samples of more than two and a half periods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImuGap {
    /// The last sample before the gap.
    pub from: Stamp,
    /// The first sample after the gap.
    pub to: Stamp,
}

/// Counts of dropped, missing and synthesised data.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MergeCounts {
    /// IMU samples dropped because their time went backwards, was repeated or jumped ahead, or a number was not finite.
    pub imu_dropped: usize,
    /// IMU samples discarded because no image came for a minute.
    pub imu_given_up: usize,
    /// Gaps in the IMU stream.
    pub imu_gaps: usize,
    /// Longest gap in the IMU stream, seconds.
    pub longest_imu_gap_s: f64,
    /// Sets whose last IMU sample was synthesised.
    pub synthesised: usize,
    /// Sets without an IMU sample at or after the image, real or synthesised.
    pub without_imu: usize,
    /// Images dropped because of their time stamp.
    pub images_dropped: usize,
    /// Images dropped because another camera had no image of the same time.
    pub unpaired: usize,
    /// Depth images without images of the same time, or dropped because of their time stamp.
    pub depth_dropped: usize,
}

/// The merge; see the documentation of this module.
pub struct Merge<I, D> {
    config: MergeConfig,
    cameras: Vec<StreamQueue<I>>,
    depth: StreamQueue<D>,
    imu: StreamQueue<ImuSample>,
    /// The last real IMU sample that was returned.
    last_imu: Option<ImuSample>,
    /// The current time: the newest stamp, or the time given to [`Merge::advance`].
    now: Option<Stamp>,
    any_returned: bool,
    counts: MergeCounts,
}

impl<I, D> Merge<I, D> {
    /// An empty merge.
    pub fn new(config: MergeConfig) -> Self {
        Self {
            config,
            cameras: (0..config.cameras.max(1)).map(|_| StreamQueue::new(false)).collect(),
            depth: StreamQueue::new(!config.depth),
            imu: StreamQueue::new(config.imu_period_s.is_none()),
            last_imu: None,
            now: None,
            any_returned: false,
            counts: MergeCounts::default(),
        }
    }

    /// Counts of dropped, missing and synthesised data so far.
    pub fn counts(&self) -> &MergeCounts {
        &self.counts
    }

    /// Adds an image of a camera, by its index in the rig.
    ///
    /// # Errors
    /// The item that was dropped: this one, or a previous one that it proves wrong.
    pub fn push_image(&mut self, camera: usize, stamp: Stamp, image: I) -> Result<(), Dropped> {
        let result = match self.cameras.get_mut(camera) {
            Some(stream) => stream.push(stamp, image),
            None => Err(Dropped { stamp, why: DropReason::Unknown }),
        };
        self.counts.images_dropped += result.is_err() as usize;
        self.advance_to(self.cameras.get(camera).and_then(StreamQueue::last));
        result.map(|_| ())
    }

    /// Adds a depth image.
    ///
    /// # Errors
    /// As [`Merge::push_image`].
    pub fn push_depth(&mut self, stamp: Stamp, depth: D) -> Result<(), Dropped> {
        let result = self.depth.push(stamp, depth);
        self.counts.depth_dropped += result.is_err() as usize;
        self.advance_to(self.depth.last());
        result.map(|_| ())
    }

    /// Adds an IMU sample, stamped by the IMU's clock; returns the gap before it, if any.
    ///
    /// # Errors
    /// As [`Merge::push_image`].
    pub fn push_imu(&mut self, sample: ImuSample) -> Result<Option<ImuGap>, Dropped> {
        let offset_ns = (self.config.imu_offset_s * 1e9).round() as i64;
        let stamp = Stamp(sample.stamp.0.saturating_add(offset_ns));
        let finite = sample.gyro.iter().chain(sample.accel.iter()).all(|v| v.is_finite());
        let result = match finite {
            true => self.imu.push(stamp, ImuSample { stamp, ..sample }),
            false => Err(Dropped { stamp, why: DropReason::NotFinite }),
        };
        self.counts.imu_dropped += result.is_err() as usize;
        self.advance_to(self.imu.last());
        self.discard_old_imu();
        let most = 2.5 * self.config.imu_period_s.unwrap_or(f64::INFINITY);
        let gap = result?.map(|(from, to)| ImuGap { from, to }).filter(|g| g.to - g.from > most);
        if let Some(g) = gap {
            self.counts.imu_gaps += 1;
            self.counts.longest_imu_gap_s = self.counts.longest_imu_gap_s.max(g.to - g.from);
        }
        Ok(gap)
    }

    /// Marks a stream as ended: nothing waits for it any more.
    pub fn end(&mut self, stream: Stream) {
        match stream {
            Stream::Camera(i) => {
                if let Some(stream) = self.cameras.get_mut(i) {
                    stream.end();
                }
            }
            Stream::Depth => self.depth.end(),
            Stream::Imu => self.imu.end(),
        }
    }

    /// Sets the current time in the image clock, so that waiting ends even when no stream delivers data.
    pub fn advance(&mut self, now: Stamp) {
        self.advance_to(Some(now));
        self.cameras.iter_mut().for_each(|stream| stream.confirm(now));
        self.depth.confirm(now);
        self.imu.confirm(now);
    }

    /// The stream that the next set is waiting for; `None` when [`Merge::pop`] would return the set.
    pub fn lacks(&mut self) -> Option<Stream> {
        self.drop_unpaired();
        let Some(stamp) = self.next_stamp() else {
            let empty = self.cameras.iter().position(|stream| stream.items.is_empty());
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

    /// The next set, when it is complete or has waited long enough.
    pub fn pop(&mut self) -> Option<Merged<I, D>> {
        if self.lacks().is_some() {
            return None;
        }
        let stamp = self.next_stamp()?;
        let taken = self.cameras.iter_mut().filter_map(|stream| stream.items.pop_front());
        let images = taken.map(|(_, image)| image).collect();
        let depth = self.depth_at(stamp);
        let imu = if self.config.imu_period_s.is_some() { self.imu_until(stamp) } else { Vec::new() };
        self.any_returned = true;
        Some(Merged { stamp, images, depth, imu })
    }

    /// Advances the current time.
    fn advance_to(&mut self, stamp: Option<Stamp>) {
        self.now = self.now.max(stamp);
    }

    /// True when a set of this time has waited long enough.
    fn is_late(&self, stamp: Stamp) -> bool {
        self.now.is_some_and(|now| now - stamp > self.config.wait_s)
    }

    /// The stamp of the next set, when every camera has an image for it.
    fn next_stamp(&self) -> Option<Stamp> {
        let all = self.cameras.iter().all(|stream| !stream.items.is_empty());
        self.cameras.first().filter(|_| all)?.items.front().map(|(stamp, _)| *stamp)
    }

    /// Drops images for which another camera has no image of the same time and cannot get one any more.
    fn drop_unpaired(&mut self) {
        loop {
            let fronts = || {
                let front = |(i, stream): (usize, &StreamQueue<I>)| {
                    stream.items.front().map(|(stamp, _)| (*stamp, i))
                };
                self.cameras.iter().enumerate().filter_map(front)
            };
            let (Some((newest, _)), Some((oldest, camera))) = (fronts().max(), fronts().min()) else {
                return;
            };
            let never_complete = self
                .cameras
                .iter()
                .any(|stream| stream.items.is_empty() && (stream.ended || self.is_late(newest)));
            if !never_complete && newest - oldest <= self.config.same_instant_s {
                return;
            }
            self.cameras[camera].items.pop_front();
            self.counts.unpaired += 1;
        }
    }

    /// The nearest depth image within the tolerance; earlier ones are dropped.
    fn depth_at(&mut self, stamp: Stamp) -> Option<D> {
        let tolerance = self.config.same_instant_s;
        while let Some((at, _)) = self.depth.items.front() {
            let difference = *at - stamp;
            if difference > tolerance {
                return None;
            }
            let nearer =
                self.depth.items.get(1).is_some_and(|(next, _)| (*next - stamp).abs() < difference.abs());
            let (_, depth) = self.depth.items.pop_front()?;
            if difference >= -tolerance && !nearer {
                return Some(depth);
            }
            self.counts.depth_dropped += 1;
        }
        None
    }

    /// Samples up to the first at or after the stamp; without one, the last sample is held for at most a period.
    fn imu_until(&mut self, stamp: Stamp) -> Vec<ImuSample> {
        let mut out = Vec::new();
        if !self.any_returned {
            let lead_s = self.config.lead_s;
            while self.imu.items.front().is_some_and(|(s, _)| stamp - *s > lead_s) {
                self.imu.items.pop_front();
            }
        }
        while self.last_imu.is_none_or(|last| last.stamp < stamp) {
            let Some((_, sample)) = self.imu.items.pop_front() else { break };
            out.push(sample);
            self.last_imu = Some(sample);
        }
        match self.last_imu {
            Some(last) if last.stamp >= stamp => {}
            Some(last) if stamp - last.stamp <= self.config.imu_period_s.unwrap_or(0.0) => {
                out.push(ImuSample { stamp, noise_scale: HELD_NOISE_SCALE, ..last });
                self.counts.synthesised += 1;
            }
            _ => self.counts.without_imu += 1,
        }
        out
    }

    /// Discards pending IMU samples that are too old.
    fn discard_old_imu(&mut self) {
        let Some(newest) = self.imu.last() else { return };
        while self.imu.items.front().is_some_and(|(s, _)| newest - *s > MAX_PENDING_S) {
            self.imu.items.pop_front();
            self.counts.imu_given_up += 1;
        }
    }
}
