//! A phone whose browser sends images and motion data through a port; packets come out, newest first.
//!
//! In: a [`PhonePort`]. Out: a [`Source`] whose pictures have a known age. Images are decoded only when requested, so that
//! overtaken ones cost nothing.

use super::phone_port::{Arrived, PhonePort};
use super::resize::{resized, same_aspect};
use super::rig_for;
use crate::decode::gray_jpeg;
use cairn_sensor::{
    Camera, FramePacket, GrayImage, ImuSample, ImuSensor, Live, Merge, MergeConfig, Rig, Source, SourceError,
    SourceInfo, Stamp, Stream,
};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long an image waits for motion data at or after it: the page sends it in batches of a few readings.
const MOTION_TIMEOUT: Duration = Duration::from_millis(60);
/// Pictures of another page continue in the time of the ones before, unless they already do to within this, seconds.
const SAME_TIME_S: f64 = 2.0;

/// The phone as a source.
pub struct PhoneSource {
    port: PhonePort,
    info: SourceInfo,
    rig: Rig,
    first: Option<Arrived>,
    /// The last stamp, and when it was given.
    last: Option<(Stamp, Instant)>,
    merge: Merge<Arc<GrayImage>, ()>,
    /// The page of the last image, and the nanoseconds to add to its time, so that stamps go on increasing from page to page.
    page: u64,
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
        let image = gray_jpeg(&first.jpeg)
            .map_err(|why| SourceError::new(NAME, why.to_string(), "try another browser"))?;
        let given = rig.is_some();
        let (mut rig, mut assumed) = rig_for(NAME, [image.width(), image.height()], rig)?;
        // The motion sensor may come later than the camera, so it is always reckoned with.
        if !given {
            rig.imu = Some(ImuSensor::of_phone());
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
            page: first.page,
            first: Some(first),
            last: None,
            merge: Merge::new(config),
            offset: 0,
            skipped: Vec::new(),
        })
    }

    /// Takes another camera for that of the rig, such as one that was estimated earlier for the same phone; `None`, and a
    /// camera of another size, leave it as it is. True when it was taken.
    pub fn set_camera(&mut self, camera: Option<Camera>) -> bool {
        let (Some(camera), Some(own)) = (camera, self.rig.cameras.first_mut()) else { return false };
        let fits = [camera.width, camera.height] == [own.camera.width, own.camera.height];
        if fits && camera.validate().is_ok() {
            own.camera = camera;
            self.info.assumed = None;
            return true;
        }
        false
    }

    /// The stamp for a time of the page, later than the previous one. Another page's time continues the one before.
    fn stamp(&mut self, page: u64, ms: f64) -> Stamp {
        let plain = (ms * 1e6) as i64;
        let mut stamp = Stamp(plain.saturating_add(self.offset));
        if let Some((last, given)) = self.last {
            let expected = last.plus_seconds(given.elapsed().as_secs_f64());
            let other = std::mem::replace(&mut self.page, page) != page;
            if stamp <= last || (other && (stamp - expected).abs() > SAME_TIME_S) {
                stamp = expected.max(Stamp(last.0.saturating_add(1_000_000)));
                self.offset = stamp.0.saturating_sub(plain);
            }
        }
        self.last = Some((stamp, Instant::now()));
        self.port.set_offset(page, self.offset);
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
        let until = Instant::now() + if self.port.motion_flows() { MOTION_TIMEOUT } else { Duration::ZERO };
        while self.merge.lacks() == Some(Stream::Imu) {
            let motion = self.port.motion_before(self.page, until);
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
        self.port.set_trouble(Some(why));
    }

    /// The image in the size of the rig: a page on a slow link sends smaller ones.
    fn sized(&mut self, image: GrayImage) -> Option<GrayImage> {
        let camera = self.rig.cameras.first().map_or([0, 0], |c| [c.camera.width, c.camera.height]);
        let found = [image.width(), image.height()];
        if found == camera {
            return Some(image);
        }
        if same_aspect(found, camera) {
            return Some(resized(&image, camera));
        }
        let ([w, h], [iw, ih]) = (camera, found);
        self.refuse(format!("The picture is {iw} by {ih} now, it was {w} by {h}. Hold the phone as before."));
        None
    }
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
        loop {
            let Some(Arrived { page, ms, jpeg, at }) = self.first.take().or_else(|| self.port.wait()) else {
                return Ok(None);
            };
            let image = match gray_jpeg(&jpeg) {
                Ok(image) => image,
                Err(why) => {
                    self.refuse(format!("A picture cannot be read: {why}."));
                    continue;
                }
            };
            let Some(image) = self.sized(image) else { continue };
            let stamp = self.stamp(page, ms);
            if let Some(packet) = self.merged(stamp, image, || at.elapsed().as_secs_f64() * 1e3) {
                self.port.set_trouble(None);
                return Ok(Some(packet));
            }
        }
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn live(&self) -> Option<Arc<dyn Live>> {
        Some(Arc::new(self.port.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::super::phone_port::MotionReading;
    use super::*;
    use cairn_geometry::Vec3;

    /// The smallest baseline JPEG of a given side, all of one gray, built by hand: a DC coefficient alone in
    /// each 8x8 block.
    fn jpeg(side: u8) -> Vec<u8> {
        jpeg_of(side, side)
    }

    fn tall() -> Vec<u8> {
        jpeg_of(16, 32)
    }

    fn jpeg_of(width: u8, height: u8) -> Vec<u8> {
        let mut f = vec![0xff, 0xd8, 0xff, 0xdb, 0, 67, 0];
        f.extend([1; 64]);
        f.extend([0xff, 0xc0, 0, 11, 8, 0, height, 0, width, 1, 1, 0x11, 0]);
        // One code for DC: category 0 is "0"; one for AC: end of block is "0".
        f.extend([0xff, 0xc4, 0, 20, 0x00, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        f.extend([0xff, 0xc4, 0, 20, 0x10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        f.extend([0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0]);
        let bits = 2 * usize::from(width.div_ceil(8)) * usize::from(height.div_ceil(8));
        f.extend(vec![0; bits / 8]);
        if !bits.is_multiple_of(8) {
            f.push(0xff >> (bits % 8));
        }
        f.extend([0xff, 0xd9]);
        f
    }

    fn sample(ms: f64) -> MotionReading {
        MotionReading { ms, gyro: Vec3::zeros(), accel: Vec3::new(0.0, -9.8, 0.0) }
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
        // Another page, with an earlier clock: stamps increase all the same.
        port.page(2);
        assert!(port.picture(5.0, jpeg(16)));
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
    fn motion_of_a_page_whose_first_image_is_still_to_come_is_not_taken_for_that_of_the_page_before() {
        for clock_ms in [9e9, -9e9] {
            let port = PhonePort::default();
            port.motion((0..10).map(|k| sample(1000.0 + 10.0 * k as f64)));
            port.picture(1050.0, jpeg(16));
            let mut source = PhoneSource::open(&port, None).unwrap();
            source.next_packet().unwrap().unwrap();
            // The last image of the page waits for motion when another page comes, whose motion is first.
            port.picture(1200.0, jpeg(16));
            let other = port.clone();
            let sender = std::thread::spawn(move || {
                std::thread::sleep(Duration::from_millis(20));
                other.page(2);
                other.motion((0..20).map(|k| sample(clock_ms + 10.0 * k as f64)));
            });
            let last = source.next_packet().unwrap().unwrap();
            sender.join().unwrap();
            port.picture(clock_ms + 150.0, jpeg(16));
            let first = source.next_packet().unwrap().unwrap();
            assert!(first.stamp > last.stamp && first.stamp - last.stamp < 1.0, "{clock_ms}");
            port.motion((20..40).map(|k| sample(clock_ms + 10.0 * k as f64)));
            port.picture(clock_ms + 350.0, jpeg(16));
            let next = source.next_packet().unwrap().unwrap();
            assert!(next.imu.len() >= 19, "{clock_ms}: {} readings", next.imu.len());
            assert!((next.imu.last().unwrap().stamp - next.stamp).abs() < 0.02, "{clock_ms}");
        }
    }

    /// Compares the clocks: the page's shows `page_ms` now, to within a millisecond.
    fn compared(port: &PhonePort, page_ms: f64) {
        let now = Instant::now();
        port.round_trip(now - Duration::from_millis(2), now, page_ms - 1.0);
    }

    #[test]
    fn age_of_a_picture_is_known_once_the_clocks_are_compared() {
        let port = PhonePort::default();
        assert!(port.picture(7e9 + 20.0, jpeg(16)));
        let mut source = PhoneSource::open(&port, None).unwrap();
        let packet = source.next_packet().unwrap().unwrap();
        let live = source.live().unwrap();
        assert!(live.clock().is_none(), "nothing is known of the page's clock yet");
        compared(&port, 7e9 + 320.0);
        let reading = live.clock().unwrap();
        let age = reading.now - packet.stamp;
        assert!((age - 0.3).abs() < 0.05 && reading.bound_s < 0.01, "{age} {reading:?}");
        assert!(reading.oldest_s(packet.stamp) > age);
        assert!((port.page_ms(packet.stamp).unwrap() - (7e9 + 20.0)).abs() < 0.001);
        // Another page with another clock: its age is not known before its clock is compared; then it is, in the same time.
        port.page(9);
        assert!(live.clock().is_none());
        compared(&port, 50_000.0);
        assert!(port.picture(49_900.0, jpeg(16)));
        let next = source.next_packet().unwrap().unwrap();
        let reading = live.clock().unwrap();
        let age = reading.now - next.stamp;
        assert!((age - 0.1).abs() < 0.05 && next.stamp > packet.stamp, "{age}");
        assert!(next.stamp - packet.stamp < 5.0);
    }

    #[test]
    fn pictures_without_a_possible_time_are_refused() {
        let port = PhonePort::default();
        compared(&port, 1000.0);
        assert!(port.picture(900.0, jpeg(16)));
        for (ms, why) in [
            (f64::NAN, "without their time"),
            (f64::INFINITY, "without"),
            (1e300, "without"),
            (9000.0, "ahead"),
            (899.0, "backwards"),
            (900.0, "backwards"),
        ] {
            assert!(!port.picture(ms, jpeg(16)), "{ms}");
            assert!(port.trouble().unwrap().contains(why), "{ms}: {:?}", port.trouble());
        }
        assert!(port.picture(901.0, jpeg(16)));
    }

    #[test]
    fn late_motion_sensor_is_taken_up() {
        let port = PhonePort::default();
        port.picture(1000.0, jpeg(16));
        let mut source = PhoneSource::open(&port, None).unwrap();
        let began = Instant::now();
        assert!(source.next_packet().unwrap().unwrap().imu.is_empty());
        assert!(began.elapsed() < MOTION_TIMEOUT, "nothing is waited for where no sensor is");
        port.motion((0..20).map(|k| sample(1000.0 + 10.0 * f64::from(k))));
        port.picture(1100.0, jpeg(16));
        let packet = source.next_packet().unwrap().unwrap();
        assert_eq!(packet.imu.len(), 11, "{packet:?}");
        assert!(source.rig().imu.is_some());
    }

    #[test]
    fn wrong_size_and_invalid_data_are_refused_and_reported() {
        let port = PhonePort::default();
        port.picture(1.0, jpeg(16));
        let mut source = PhoneSource::open(&port, None).unwrap();
        source.next_packet().unwrap().unwrap();
        let (answer, told) = std::sync::mpsc::channel();
        let reader = std::thread::spawn(move || answer.send(source.next_packet().unwrap().unwrap().stamp));
        for (ms, bytes, why) in [(2.0, tall(), "16 by 32"), (3.0, b"rubbish".to_vec(), "neither JPEG")] {
            port.picture(ms, bytes);
            let began = Instant::now();
            while !port.trouble().is_some_and(|t| t.contains(why)) {
                assert!(began.elapsed() < Duration::from_secs(5), "{why}: {:?}", port.trouble());
                std::thread::yield_now();
            }
        }
        // A smaller picture of the same shape is taken, and ends the trouble.
        port.picture(4.0, jpeg(24));
        assert_eq!(told.recv().unwrap(), Stamp(4_000_000));
        reader.join().unwrap().unwrap();
        assert_eq!(port.trouble(), None);
        port.close();
        assert!(PhoneSource::open(&port, None).is_err());
    }
}
