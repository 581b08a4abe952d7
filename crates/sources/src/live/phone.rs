//! A phone whose browser sends images and motion data through a port; packets come out, newest first.
//!
//! In: JPEGs and motion samples with the page's own times. Out: a [`Source`]. Images are decoded only when
//! requested, so that overtaken ones cost nothing.

use super::rig_for;
use crate::decode::gray_jpeg;
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{
    FramePacket, GrayImage, ImuNoise, ImuSample, ImuSensor, Merge, MergeConfig, Rig, Source, SourceError,
    SourceInfo, Stamp, Stream,
};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Motion samples kept while no images arrive; older ones are dropped.
const MAX_MOTION: usize = 2000;
/// How long an image waits for motion data at or after it: the page sends it in batches of a few readings.
const MOTION_TIMEOUT: Duration = Duration::from_millis(60);
/// Largest accepted JPEG, bytes.
const MAX_BYTES: usize = 8 << 20;

/// One reading of a phone's motion sensors, in the axes of its image: x right, y down, z into the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The page's time in milliseconds, in the clock of its images.
    pub ms: f64,
    /// Angular rate in rad/s.
    pub gyro: Vec3,
    /// Specific force in m/s^2 (about 9.8 upwards at rest).
    pub accel: Vec3,
}

#[derive(Default)]
struct State {
    newest: Option<(f64, Vec<u8>, Instant)>,
    motion: VecDeque<Motion>,
    overtaken: usize,
    refused: Option<String>,
    closed: bool,
}

/// The entry for images and motion data; clones refer to the same port.
#[derive(Clone, Default)]
pub struct PhonePort(Arc<(Mutex<State>, Condvar)>);

impl PhonePort {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a JPEG and the page's time in milliseconds. Invalid data is refused later, and reported.
    pub fn picture(&self, ms: f64, jpeg: Vec<u8>) {
        if !ms.is_finite() || jpeg.len() > MAX_BYTES {
            return;
        }
        let mut s = self.lock();
        s.overtaken += usize::from(s.newest.replace((ms, jpeg, Instant::now())).is_some());
        self.0.1.notify_all();
    }

    /// Takes readings of the motion sensors.
    pub fn motion(&self, samples: impl IntoIterator<Item = Motion>) {
        let finite =
            |m: &Motion| m.ms.is_finite() && m.gyro.iter().chain(m.accel.iter()).all(|v| v.is_finite());
        let mut s = self.lock();
        s.motion.extend(samples.into_iter().filter(finite));
        while s.motion.len() > MAX_MOTION {
            s.motion.pop_front();
        }
        self.0.1.notify_all();
    }

    /// The motion data since the last call; waits for some until the given instant. Empty after that, and
    /// when the port is closed.
    fn motion_before(&self, until: Instant) -> VecDeque<Motion> {
        let mut s = self.lock();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if !s.motion.is_empty() || s.closed || left.is_zero() {
                return std::mem::take(&mut s.motion);
            }
            s = self.0.1.wait_timeout(s, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Closes the port: the source ends.
    pub fn close(&self) {
        self.lock().closed = true;
        self.0.1.notify_all();
    }

    /// Why the last image was refused; reported once.
    pub fn refused(&self) -> Option<String> {
        self.lock().refused.take()
    }

    /// Waits for an image; `None` when the port is closed.
    fn wait(&self) -> Option<(f64, Vec<u8>, Instant)> {
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

/// The phone as a source.
pub struct PhoneSource {
    port: PhonePort,
    info: SourceInfo,
    rig: Rig,
    first: Option<(f64, Vec<u8>, Instant)>,
    last: Option<Stamp>,
    merge: Merge<Arc<GrayImage>, ()>,
    /// Nanoseconds to add to the page's time, so that stamps increase when the page is reloaded.
    offset: i64,
    skipped: Vec<String>,
}

impl PhoneSource {
    /// Waits for the first image, which gives the size; `rig` must fit it, and is guessed where there is
    /// none.
    ///
    /// # Errors
    /// When the image cannot be read or the rig does not fit; when the port was closed before.
    pub fn open(port: &PhonePort, rig: Option<Rig>) -> Result<Self, SourceError> {
        const NAME: &str = "the page's camera";
        let first = port.wait();
        let first = first.ok_or_else(|| SourceError::new(NAME, "was never opened", "open the page again"))?;
        let image = gray_jpeg(&first.1).map_err(|why| SourceError::new(NAME, why, "try another browser"))?;
        let given = rig.is_some();
        let (mut rig, mut assumed) = rig_for(NAME, [image.width(), image.height()], rig)?;
        if !given && !port.lock().motion.is_empty() {
            rig.imu = Some(phone_imu());
            assumed = assumed.map(|camera| camera + "; a low-cost IMU of 60 Hz in the camera's axes");
        }
        // The data has the page's clock already, so no offset is left.
        let imu_offset_s = rig.imu.as_mut().map_or(0.0, |imu| std::mem::take(&mut imu.offset_s));
        let imu_period_s = rig.imu.as_ref().map(|imu| 1.0 / imu.rate_hz);
        let config = MergeConfig {
            imu_period_s,
            imu_offset_s,
            wait_s: MOTION_TIMEOUT.as_secs_f64(),
            ..Default::default()
        };
        let info = SourceInfo { name: NAME.into(), frames: None, rate_hz: 20.0, truth: Vec::new(), assumed };
        Ok(Self {
            port: port.clone(),
            info,
            rig,
            first: Some(first),
            last: None,
            merge: Merge::new(config),
            offset: 0,
            skipped: Vec::new(),
        })
    }

    /// The stamp for a time of the page, later than the previous one.
    fn stamp(&mut self, ms: f64) -> Stamp {
        let plain = (ms * 1e6) as i64;
        let stamp = Stamp(plain.saturating_add(self.offset));
        let stamp = match self.last {
            Some(last) if stamp <= last => {
                self.offset = last.0.saturating_add(1_000_000).saturating_sub(plain);
                Stamp(last.0.saturating_add(1_000_000))
            }
            _ => stamp,
        };
        self.last = Some(stamp);
        stamp
    }

    /// The image with the motion data since the previous one; waits for motion at or after it, for
    /// [`MOTION_TIMEOUT`] at most.
    fn merged(&mut self, stamp: Stamp, image: GrayImage, decode_ms: impl Fn() -> f64) -> Option<FramePacket> {
        if let Err(dropped) = self.merge.push_image(0, stamp, Arc::new(image)) {
            self.refuse(format!("{dropped}, image dropped"));
            return None;
        }
        // The page's clock runs on while it sends no images: that is not a jump.
        self.merge.advance(stamp);
        let until = Instant::now() + MOTION_TIMEOUT;
        while self.merge.lacks() == Some(Stream::Imu) {
            let motion = self.port.motion_before(until);
            if motion.is_empty() {
                self.merge.advance(stamp.plus_seconds(1.01 * MOTION_TIMEOUT.as_secs_f64()));
                break;
            }
            for m in motion {
                let at = Stamp(((m.ms * 1e6) as i64).saturating_add(self.offset));
                if let Err(dropped) = self.merge.push_imu(ImuSample::new(at, m.gyro, m.accel))
                    && self.merge.counts().imu_dropped == 1
                {
                    self.skipped.push(format!("motion at {dropped}, dropped (reported once)"));
                }
            }
        }
        let merged = self.merge.pop()?;
        let images = merged.images;
        Some(FramePacket {
            stamp: merged.stamp,
            images,
            depth: None,
            imu: merged.imu,
            decode_ms: decode_ms(),
        })
    }

    fn refuse(&mut self, why: String) {
        if self.skipped.last() != Some(&why) {
            self.skipped.push(why.clone());
        }
        self.port.lock().refused = Some(why);
    }
}

/// A phone's IMU as browsers provide it: 60 Hz, noise of a low-cost sensor, in the camera's axes.
fn phone_imu() -> ImuSensor {
    let noise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
    ImuSensor { body_from_imu: Se3::identity(), rate_hz: 60.0, noise, offset_s: 0.0 }
}

impl Source for PhoneSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Waits for an image, for as long as the page sends none.
    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let camera = self.rig.cameras.first().map_or([0, 0], |c| [c.camera.width, c.camera.height]);
        loop {
            let Some((ms, jpeg, arrived)) = self.first.take().or_else(|| self.port.wait()) else {
                return Ok(None);
            };
            let image = match gray_jpeg(&jpeg) {
                Ok(image) if [image.width(), image.height()] == camera => image,
                Ok(image) => {
                    let ([w, h], (iw, ih)) = (camera, (image.width(), image.height()));
                    self.refuse(format!(
                        "the image is {iw}x{ih} now, it was {w}x{h}: hold the phone as before"
                    ));
                    continue;
                }
                Err(why) => {
                    self.refuse(why);
                    continue;
                }
            };
            let stamp = self.stamp(ms);
            if let Some(packet) = self.merged(stamp, image, || arrived.elapsed().as_secs_f64() * 1e3) {
                return Ok(Some(packet));
            }
        }
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The smallest baseline JPEG of a given side, all of one gray, built by hand: a DC coefficient alone in
    /// each 8x8 block.
    fn jpeg(side: u8) -> Vec<u8> {
        let mut f = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
        f.extend([1; 64]);
        f.extend([0xff, 0xc0, 0, 11, 8, 0, side, 0, side, 1, 1, 0x11, 0]);
        // One code for DC: category 0 is "0"; one for AC: end of block is "0".
        f.extend([0xff, 0xc4, 0, 20, 0x00, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        f.extend([0xff, 0xc4, 0, 20, 0x10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        f.extend([0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0]);
        let bits = 2 * usize::from(side.div_ceil(8)).pow(2);
        f.extend(vec![0; bits / 8]);
        if !bits.is_multiple_of(8) {
            f.push(0xff >> (bits % 8));
        }
        f.extend([0xff, 0xd9]);
        f
    }

    fn sample(ms: f64) -> Motion {
        Motion { ms, gyro: Vec3::zeros(), accel: Vec3::new(0.0, -9.8, 0.0) }
    }

    #[test]
    fn images_and_motion_become_packets_in_increasing_time() {
        let port = PhonePort::default();
        port.motion((0..20).map(|k| sample(1000.0 + 10.0 * k as f64)));
        port.picture(1050.0, jpeg(16));
        let mut source = PhoneSource::open(&port, None).unwrap();
        assert!(source.rig().imu.is_some());
        let first = source.next_packet().unwrap().unwrap();
        assert_eq!(first.stamp, Stamp(1_050_000_000));
        assert_eq!(first.imu.last().unwrap().stamp, Stamp(1_050_000_000));
        assert_eq!(first.imu.len(), 6);
        // Overtaken: only the newest is delivered.
        port.picture(1080.0, jpeg(16));
        port.picture(1100.0, jpeg(16));
        let second = source.next_packet().unwrap().unwrap();
        assert_eq!((second.stamp, second.imu.len()), (Stamp(1_100_000_000), 5));
        // The page is reloaded with an earlier clock: stamps increase all the same.
        port.picture(5.0, jpeg(16));
        assert!(source.next_packet().unwrap().unwrap().stamp > second.stamp);
        // A pause of the page is not a jump; motion that arrives a little later than its image is waited for.
        let last = 5.0 + 3000.0;
        port.picture(last, jpeg(16));
        let late = port.clone();
        let sender = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(5));
            late.motion((0..4).map(|k| sample(last - 20.0 + 10.0 * k as f64)));
        });
        let packet = source.next_packet().unwrap().unwrap();
        sender.join().unwrap();
        assert!(packet.imu.last().unwrap().stamp >= packet.stamp, "{packet:?}");
        // Motion that never arrives is synthesised for at most one period, and marked; without any the image
        // is delivered all the same.
        port.picture(last + 15.0, jpeg(16));
        let synthesised = source.next_packet().unwrap().unwrap();
        assert!(synthesised.imu.last().unwrap().is_synthesised(), "{synthesised:?}");
        port.picture(last + 500.0, jpeg(16));
        assert!(source.next_packet().unwrap().unwrap().imu.iter().all(|s| !s.is_synthesised()));
        port.close();
        assert!(source.next_packet().unwrap().is_none());
    }

    #[test]
    fn wrong_size_and_invalid_data_are_refused_and_reported() {
        let port = PhonePort::default();
        port.picture(1.0, jpeg(16));
        let mut source = PhoneSource::open(&port, None).unwrap();
        source.next_packet().unwrap().unwrap();
        let (answer, told) = std::sync::mpsc::channel();
        let reader = std::thread::spawn(move || answer.send(source.next_packet().unwrap().unwrap().stamp));
        for (ms, bytes, why) in [(2.0, jpeg(24), "24x24"), (3.0, b"rubbish".to_vec(), "neither JPEG")] {
            port.picture(ms, bytes);
            let refused = loop {
                if let Some(why) = port.refused() {
                    break why;
                }
                std::thread::yield_now();
            };
            assert!(refused.contains(why), "{refused}");
        }
        port.picture(4.0, jpeg(16));
        assert_eq!(told.recv().unwrap(), Stamp(4_000_000));
        reader.join().unwrap().unwrap();
        port.close();
        assert!(PhoneSource::open(&port, None).is_err());
    }
}
