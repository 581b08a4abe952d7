//! A phone whose browser sends pictures and motion: what comes in at the port goes out as packets, the newest first.
//!
//! In: JPEGs and motion samples with the page's own times. Out: a [`Source`]. Pictures are decoded only when asked for,
//! so that those overtaken cost nothing.

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

/// More waiting motion than this is forgotten: the page sends it, but no pictures.
const MOST_MOTION: usize = 2000;
/// A picture waits so long for motion at or after it: the page sends it in parcels of a few readings.
const WAITS: Duration = Duration::from_millis(60);
/// No phone's page sends larger pictures.
const MOST_BYTES: usize = 8 << 20;

/// One reading of a phone's motion sensors, in the axes of its picture: x right, y down, z into the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The page's time in milliseconds, in the clock of its pictures.
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

/// Where pictures and motion come in; clones are the same port.
#[derive(Clone, Default)]
pub struct PhonePort(Arc<(Mutex<State>, Condvar)>);

impl PhonePort {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a JPEG and the page's time in milliseconds. What is no picture is refused later, and told.
    pub fn picture(&self, ms: f64, jpeg: Vec<u8>) {
        if !ms.is_finite() || jpeg.len() > MOST_BYTES {
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
        while s.motion.len() > MOST_MOTION {
            s.motion.pop_front();
        }
        self.0.1.notify_all();
    }

    /// The motion that has come since it was asked for last; waits for it, but no longer than until an instant. Empty then, and
    /// when no more will come.
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

    /// No more will come: the source ends.
    pub fn close(&self) {
        self.lock().closed = true;
        self.0.1.notify_all();
    }

    /// Why the last picture was refused, once.
    pub fn refused(&self) -> Option<String> {
        self.lock().refused.take()
    }

    /// Waits for a picture; `None` when the port is closed.
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
    /// Nanoseconds to add to the page's time, so that stamps rise when the page begins anew.
    offset: i64,
    skipped: Vec<String>,
}

impl PhoneSource {
    /// Waits for the first picture, which tells the size; `rig` must fit it, and is guessed where there is none.
    ///
    /// # Errors
    /// When the picture can not be read or the rig does not fit; when the port was closed before.
    pub fn open(port: &PhonePort, rig: Option<Rig>) -> Result<Self, SourceError> {
        const NAME: &str = "the page's camera";
        let first = port.wait();
        let first = first.ok_or_else(|| SourceError::new(NAME, "was never opened", "open the page again"))?;
        let image = gray_jpeg(&first.1).map_err(|why| SourceError::new(NAME, why, "try another browser"))?;
        let given = rig.is_some();
        let (mut rig, mut assumed) = rig_for(NAME, [image.width(), image.height()], rig)?;
        if !given && !port.lock().motion.is_empty() {
            rig.imu = Some(phone_imu());
            assumed =
                assumed.map(|camera| camera + "; a cheap inertial sensor of 60 Hz in the camera's axes");
        }
        // What comes in has the page's clock already, so nothing is left to add.
        let imu_offset_s = rig.imu.as_mut().map_or(0.0, |imu| std::mem::take(&mut imu.offset_s));
        let imu_period_s = rig.imu.as_ref().map(|imu| 1.0 / imu.rate_hz);
        let config =
            MergeConfig { imu_period_s, imu_offset_s, wait_s: WAITS.as_secs_f64(), ..Default::default() };
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

    /// The stamp of a page's time, later than the one before.
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

    /// The picture with the motion since the one before; waits for motion at or after it, for [`WAITS`] at most.
    fn merged(&mut self, stamp: Stamp, image: GrayImage, decode_ms: impl Fn() -> f64) -> Option<FramePacket> {
        if let Err(dropped) = self.merge.push_image(0, stamp, Arc::new(image)) {
            self.refuse(format!("{dropped}, picture dropped"));
            return None;
        }
        // The page's clock goes on while it sends no pictures: that is no jump.
        self.merge.advance(stamp);
        let until = Instant::now() + WAITS;
        while self.merge.lacks() == Some(Stream::Imu) {
            let motion = self.port.motion_before(until);
            if motion.is_empty() {
                self.merge.advance(stamp.plus_seconds(1.01 * WAITS.as_secs_f64()));
                break;
            }
            for m in motion {
                let at = Stamp(((m.ms * 1e6) as i64).saturating_add(self.offset));
                if let Err(dropped) = self.merge.push_imu(ImuSample::new(at, m.gyro, m.accel))
                    && self.merge.counts().imu_dropped == 1
                {
                    self.skipped.push(format!("motion at {dropped}, dropped (told once)"));
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

/// A phone's inertial sensor as browsers give it: 60 Hz, noise of a cheap one, mounted in the camera's axes.
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

    /// Waits for a picture, for as long as the page sends none.
    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let camera = self.rig.cameras.first().map_or([0, 0], |c| [c.camera.width, c.camera.height]);
        loop {
            let Some((ms, jpeg, came)) = self.first.take().or_else(|| self.port.wait()) else {
                return Ok(None);
            };
            let image = match gray_jpeg(&jpeg) {
                Ok(image) if [image.width(), image.height()] == camera => image,
                Ok(image) => {
                    let ([w, h], (iw, ih)) = (camera, (image.width(), image.height()));
                    self.refuse(format!(
                        "the picture is {iw}x{ih} now, it was {w}x{h}: hold the phone as before"
                    ));
                    continue;
                }
                Err(why) => {
                    self.refuse(why);
                    continue;
                }
            };
            let stamp = self.stamp(ms);
            if let Some(packet) = self.merged(stamp, image, || came.elapsed().as_secs_f64() * 1e3) {
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

    /// A gray JPEG of 16x16, made by hand: one 8x8 block with its DC alone in each of four units would do; here the
    /// smallest baseline file, all of one gray.
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
    fn pictures_and_motion_come_out_as_packets_in_rising_time() {
        let port = PhonePort::default();
        port.motion((0..20).map(|k| sample(1000.0 + 10.0 * k as f64)));
        port.picture(1050.0, jpeg(16));
        let mut source = PhoneSource::open(&port, None).unwrap();
        assert!(source.rig().imu.is_some());
        let first = source.next_packet().unwrap().unwrap();
        assert_eq!(first.stamp, Stamp(1_050_000_000));
        assert_eq!(first.imu.last().unwrap().stamp, Stamp(1_050_000_000));
        assert_eq!(first.imu.len(), 6);
        // Overtaken: only the newest comes out.
        port.picture(1080.0, jpeg(16));
        port.picture(1100.0, jpeg(16));
        let second = source.next_packet().unwrap().unwrap();
        assert_eq!((second.stamp, second.imu.len()), (Stamp(1_100_000_000), 5));
        // The page begins anew with an earlier clock: stamps rise all the same.
        port.picture(5.0, jpeg(16));
        assert!(source.next_packet().unwrap().unwrap().stamp > second.stamp);
        // A pause of the page is no jump; motion that comes a little later than its picture is waited for.
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
        // Motion that never comes is made up for a period at most, and marked; without any the picture comes all the same.
        port.picture(last + 15.0, jpeg(16));
        let made_up = source.next_packet().unwrap().unwrap();
        assert!(made_up.imu.last().unwrap().is_synthesised(), "{made_up:?}");
        port.picture(last + 500.0, jpeg(16));
        assert!(source.next_packet().unwrap().unwrap().imu.iter().all(|s| !s.is_synthesised()));
        port.close();
        assert!(source.next_packet().unwrap().is_none());
    }

    #[test]
    fn pictures_of_another_size_and_rubbish_are_refused_and_told() {
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
