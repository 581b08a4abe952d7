//! From messages to packets: pictures of one instant with the IMU readings up to them, in order of time.
//!
//! Lost, late and repeated messages, wrong sizes, numbers that are not finite: counted and said once ([`Faults`]); the
//! next good picture goes on. A clock that goes backwards for good (a bag played again, a simulator set back) is
//! followed: the packets' own time goes on, with a gap in which no motion is believed, and the map is kept.

use crate::faults::Faults;
use crate::messages::Imu;
use crate::pictures::Picture;
use crate::setup::Role;
use cairn::sensor::{
    DepthImage, Dropped, FramePacket, GrayImage, ImuSample, Merge, MergeConfig, MergeCounts, Rig, SkipKind,
    Stamp,
};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// How long a picture waits for its partners, seconds.
const WAIT_S: f64 = 0.1;
/// Time that goes backwards by more than this is another time, not a late message, seconds.
const BACKWARDS_S: f64 = 1.0;
/// So many pictures in a row confirm it.
const CONFIRMED: usize = 3;
/// Gap between the last packet of one time and the first of the next, seconds: longer than any motion is extrapolated.
const GAP_S: f64 = 2.0;

/// One stretch of the messages' time.
#[derive(Clone, Copy)]
struct Period {
    /// The first packet of it.
    from: Stamp,
    /// Nanoseconds by which packets are later than their messages.
    offset: i64,
    number: usize,
}

/// Translates between the packets' time, which only goes on, and that of the messages, which may be set back.
#[derive(Clone, Default)]
pub struct Clock(Arc<Mutex<VecDeque<Period>>>);

impl Clock {
    /// The messages' time of a packet.
    pub fn of_messages(&self, packet: Stamp) -> Stamp {
        Stamp(packet.0.saturating_sub(self.at(packet).map_or(0, |period| period.offset)))
    }

    /// The packets' time of a message that comes now.
    pub fn of_packets(&self, message: Stamp) -> Stamp {
        Stamp(message.0.saturating_add(self.lock().back().map_or(0, |period| period.offset)))
    }

    /// How often the time had been set back before a packet.
    pub fn period(&self, packet: Stamp) -> usize {
        self.at(packet).map_or(0, |period| period.number)
    }

    fn at(&self, packet: Stamp) -> Option<Period> {
        self.lock().iter().rev().find(|period| period.from <= packet).copied()
    }

    /// From this packet on, packets are later than their messages by `offset` nanoseconds.
    fn begin(&self, from: Stamp, offset: i64) {
        let mut periods = self.lock();
        let number = periods.back().map_or(0, |period| period.number) + 1;
        // Packets of older times have long been dealt with.
        if periods.len() > 7 {
            periods.pop_front();
        }
        periods.push_back(Period { from, offset, number });
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Period>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A picture that can be used.
enum Pixels {
    Gray(Arc<GrayImage>),
    Depth(Arc<DepthImage>),
}

impl Pixels {
    fn size(&self) -> [usize; 2] {
        match self {
            Self::Gray(image) => [image.width(), image.height()],
            Self::Depth(depth) => [depth.width(), depth.height()],
        }
    }
}

/// Puts packets together.
pub struct Assembler {
    config: MergeConfig,
    merge: Merge<Arc<GrayImage>, Arc<DepthImage>>,
    counted: MergeCounts,
    sizes: Vec<[usize; 2]>,
    depth_size: Option<[usize; 2]>,
    faults: Faults,
    clock: Clock,
    /// The newest time of a picture of the first camera, in the packets' time, and how many since were far before it.
    newest: Option<Stamp>,
    backwards: usize,
    /// Milliseconds of decoding since the last packet.
    /// Bits in use of pixels of 16.
    bits: u32,
    decode_ms: f64,
}

impl Assembler {
    /// For the cameras, depth and IMU of a rig. `pair_within_s`: what pictures of one instant differ by at most.
    pub fn new(rig: &Rig, pair_within_s: f64, faults: Faults) -> Self {
        let config = MergeConfig {
            cameras: rig.cameras.len(),
            depth: rig.depth.is_some(),
            imu_period_s: rig.imu.as_ref().map(|imu| 1.0 / imu.rate_hz),
            imu_offset_s: rig.imu.as_ref().map_or(0.0, |imu| imu.offset_s),
            same_instant_s: pair_within_s,
            wait_s: WAIT_S,
            ..MergeConfig::default()
        };
        Self {
            config,
            merge: Merge::new(config),
            counted: MergeCounts::default(),
            sizes: rig.cameras.iter().map(|c| [c.camera.width, c.camera.height]).collect(),
            depth_size: rig.depth.as_ref().map(|d| [d.camera.width, d.camera.height]),
            faults,
            clock: Clock::default(),
            newest: None,
            backwards: 0,
            bits: 0,
            decode_ms: 0.0,
        }
    }

    /// The clock of the packets.
    pub fn clock(&self) -> Clock {
        self.clock.clone()
    }

    /// Takes a picture. One that cannot be used says nothing of the time either.
    pub fn picture(&mut self, role: Role, picture: &Picture) {
        let (kind, name) = match role {
            Role::Image => (SkipKind::Frame, "left pictures"),
            Role::Right => (SkipKind::Frame, "right pictures"),
            Role::Depth => (SkipKind::Depth, "depth images"),
        };
        let stamp = picture.header().stamp.stamp();
        if stamp == Stamp(0) {
            self.faults.count(kind, &format!("{name} without a time"), "the stamp of the header is 0");
            return;
        }
        let started = Instant::now();
        let pixels = match role {
            Role::Depth => picture.depth().map(|depth| Pixels::Depth(Arc::new(depth))),
            Role::Image | Role::Right => {
                picture.gray(&mut self.bits).map(|image| Pixels::Gray(Arc::new(image)))
            }
        };
        self.decode_ms += started.elapsed().as_secs_f64() * 1e3;
        let pixels = match pixels {
            Ok(pixels) => pixels,
            Err(why) => return self.faults.count(kind, &format!("{name} cannot be read"), &why.to_string()),
        };
        let (found, expected) = (pixels.size(), self.size_of(role));
        if expected.is_some_and(|expected| expected != found) {
            let details =
                format!("{found:?} pixels, the calibration is for {:?}", expected.unwrap_or_default());
            return self.faults.count(kind, &format!("{name} of another size"), &details);
        }
        if role == Role::Image {
            self.follow_clock(stamp);
        }
        let stamp = self.clock.of_packets(stamp);
        let taken = match pixels {
            Pixels::Gray(image) => self.merge.push_image(usize::from(role == Role::Right), stamp, image),
            Pixels::Depth(depth) => self.merge.push_depth(stamp, depth),
        };
        if let Err(dropped) = taken {
            self.dropped(kind, name, &dropped);
        }
    }

    /// Width and height by the calibration.
    fn size_of(&self, role: Role) -> Option<[usize; 2]> {
        match role {
            Role::Image => self.sizes.first().copied(),
            Role::Right => self.sizes.get(1).copied(),
            Role::Depth => self.depth_size,
        }
    }

    /// Takes a reading of the IMU.
    pub fn imu(&mut self, reading: &Imu) {
        let stamp = self.clock.of_packets(reading.header.stamp.stamp());
        let sample =
            ImuSample::new(stamp, reading.angular_velocity.vector(), reading.linear_acceleration.vector());
        if let Err(dropped) = self.merge.push_imu(sample) {
            self.dropped(SkipKind::Imu, "IMU readings", &dropped);
        }
    }

    fn dropped(&self, kind: SkipKind, name: &str, dropped: &Dropped) {
        let at = self.clock.of_messages(dropped.stamp);
        self.faults.count(kind, &format!("{name} dropped, {}", dropped.why), &format!("at {at} s"));
    }

    /// The next packet, when it is complete or has waited long enough.
    pub fn packet(&mut self) -> Option<FramePacket> {
        let merged = self.merge.pop();
        self.tell_counts();
        let merged = merged?;
        let decode_ms = std::mem::take(&mut self.decode_ms);
        let (stamp, images) = (merged.stamp, merged.images);
        Some(FramePacket { stamp, images, depth: merged.depth, imu: merged.imu, decode_ms })
    }

    /// Notices that the time of the messages went backwards, and begins anew with another offset.
    fn follow_clock(&mut self, stamp: Stamp) {
        let now = self.clock.of_packets(stamp);
        let Some(newest) = self.newest else {
            self.newest = Some(now);
            return;
        };
        if newest - now < BACKWARDS_S {
            self.backwards = 0;
            self.newest = Some(newest.max(now));
            return;
        }
        self.backwards += 1;
        if self.backwards < CONFIRMED {
            return;
        }
        let next = newest.plus_seconds(GAP_S);
        let details = format!("from {} s to {stamp} s; the map is kept", self.clock.of_messages(newest));
        self.faults.count(SkipKind::Other, "the time of the pictures went backwards", &details);
        self.clock.begin(next, next.0.saturating_sub(stamp.0));
        (self.merge, self.counted) = (Merge::new(self.config), MergeCounts::default());
        (self.newest, self.backwards) = (Some(next), 0);
    }

    /// What the merge left out by itself.
    fn tell_counts(&mut self) {
        let (now, before) = (*self.merge.counts(), self.counted);
        let lines: [(usize, usize, SkipKind, &str, &str); 4] = [
            (
                now.unpaired,
                before.unpaired,
                SkipKind::Frame,
                "pictures without a partner of the same time",
                "are the cameras triggered together? --pair-within-ms allows more",
            ),
            (
                now.synthesised,
                before.synthesised,
                SkipKind::Imu,
                "IMU readings that came too late were replaced",
                "",
            ),
            (now.without_imu, before.without_imu, SkipKind::Imu, "pictures without IMU readings", ""),
            (now.imu_gaps, before.imu_gaps, SkipKind::Imu, "gaps between IMU readings", ""),
        ];
        for (now, before, kind, reason, details) in lines {
            (before..now).for_each(|_| self.faults.count(kind, reason, details));
        }
        self.counted = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, Image, Time, Vector3};
    use cairn::geometry::Se3;
    use cairn::sensor::{Camera, ImuNoise, ImuSensor, RigCamera};

    const MS: i64 = 1_000_000;

    fn rig(cameras: usize, imu: bool) -> Rig {
        let mut rig = Rig::mono(Camera::pinhole(8, 6, 8.0, 8.0, 4.0, 3.0));
        if cameras == 2 {
            let mut pose = Se3::identity();
            pose.translation.x = 0.1;
            rig.cameras.push(RigCamera {
                name: "cam1".into(),
                body_from_camera: pose,
                ..rig.cameras[0].clone()
            });
        }
        let noise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-5, accel: 1e-2, accel_walk: 1e-4 };
        rig.imu =
            imu.then_some(ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise, offset_s: 0.0 });
        rig
    }

    fn picture(ms: i64, width: u32) -> Picture {
        let header = Header { stamp: Time::of(Stamp(ms * MS)), frame_id: "camera".into() };
        let data = vec![7; 6 * width as usize];
        Picture::Raw(Image {
            header,
            height: 6,
            width,
            encoding: "mono8".into(),
            is_bigendian: 0,
            step: width,
            data,
        })
    }

    fn reading(ms: i64, gyro: f64) -> Imu {
        let header = Header { stamp: Time::of(Stamp(ms * MS)), frame_id: "imu".into() };
        let angular_velocity = Vector3 { x: gyro, y: 0.0, z: 0.0 };
        let linear_acceleration = Vector3 { x: 0.0, y: 0.0, z: 9.8 };
        Imu { header, angular_velocity, linear_acceleration, ..Imu::default() }
    }

    fn drain(assembler: &mut Assembler) -> Vec<FramePacket> {
        std::iter::from_fn(|| assembler.packet()).collect()
    }

    #[test]
    fn pairs_by_approximate_time_and_what_is_lost() {
        let faults = Faults::default();
        let mut assembler = Assembler::new(&rig(2, false), 0.005, faults.clone());
        let mut packets = Vec::new();
        for k in 0..60 {
            let t = 1000 + 33 * k;
            if k != 10 {
                assembler.picture(Role::Image, &picture(t, 8));
            }
            if k != 20 {
                assembler.picture(Role::Right, &picture(t + 3, 8));
            }
            if k == 30 {
                assembler.picture(Role::Image, &picture(t, 8)); // twice
                assembler.picture(Role::Image, &picture(t - 33, 8)); // late
            }
            packets.extend(drain(&mut assembler));
        }
        assert_eq!(packets.len(), 58);
        assert!(packets.iter().all(|p| p.images.len() == 2));
        let counts = faults.counts();
        let of =
            |text: &str| counts.iter().filter(|s| s.reason.contains(text)).map(|s| s.count).sum::<usize>();
        assert_eq!((of("partner"), of("repeated"), of("backwards")), (2, 1, 1));
    }

    #[test]
    fn bad_pictures_and_readings_are_counted_and_the_next_goes_on() {
        let faults = Faults::default();
        let mut assembler = Assembler::new(&rig(1, true), 0.005, faults.clone());
        let mut packets = Vec::new();
        for k in 0..100 {
            let t = 1000 + 5 * k;
            assembler.imu(&reading(t, if k == 50 { f64::NAN } else { 0.1 }));
            if k % 10 == 5 {
                assembler.picture(Role::Image, &picture(t, if k == 45 { 9 } else { 8 }));
            }
            if k == 60 {
                let Picture::Raw(mut broken) = picture(t + 1, 8) else { unreachable!() };
                broken.data.truncate(20);
                assembler.picture(Role::Image, &Picture::Raw(broken.clone()));
                let bayer = Image { encoding: "bayer".into(), ..broken.clone() };
                // Nor do pictures that cannot be used set the clock back.
                let old = Image { header: Header::new(Stamp(7), "camera"), ..broken };
                (0..5).for_each(|_| assembler.picture(Role::Image, &Picture::Raw(old.clone())));
                assembler.picture(Role::Image, &Picture::Raw(bayer));
                assembler.picture(Role::Image, &picture(0, 8));
            }
            packets.extend(drain(&mut assembler));
        }
        assert_eq!(packets.len(), 9);
        let samples: Vec<_> = packets.iter().flat_map(|p| p.imu.iter()).collect();
        assert!(samples.iter().all(|s| s.gyro.x.is_finite()));
        let reasons: Vec<_> = faults.counts().iter().map(|s| (s.reason.clone(), s.count)).collect();
        let of = |text: &str| reasons.iter().filter(|(r, _)| r.contains(text)).map(|(_, n)| n).sum::<usize>();
        assert_eq!(
            (of("size"), of("cannot be read"), of("not finite"), of("without a time")),
            (1, 7, 1, 1),
            "{reasons:?}"
        );
    }

    #[test]
    fn a_clock_that_is_set_back_is_followed() {
        let faults = Faults::default();
        let mut assembler = Assembler::new(&rig(1, false), 0.005, faults.clone());
        let clock = assembler.clock();
        let mut packets = Vec::new();
        for round in 0..2 {
            for k in 0..60 {
                assembler.picture(Role::Image, &picture(50_000 + 33 * k, 8));
                packets.extend(drain(&mut assembler));
            }
            assert_eq!(clock.period(packets[packets.len() - 1].stamp), round);
        }
        // Two pictures confirm that it was set back.
        assert_eq!(packets.len(), 118);
        assert!(packets.windows(2).all(|w| w[0].stamp < w[1].stamp));
        assert!(packets[60].stamp - packets[59].stamp >= GAP_S - 1e-9);
        assert_eq!([0, 59, 60, 117].map(|k: usize| clock.period(packets[k].stamp)), [0, 0, 1, 1]);
        let times: Vec<i64> = packets.iter().map(|p| clock.of_messages(p.stamp).0 / MS).collect();
        assert_eq!((times[0], times[59], times[60], times[117]), (50_000, 51_947, 50_066, 51_947));
        // One picture of a wrong time is no other time.
        assembler.picture(Role::Image, &picture(1, 8));
        assembler.picture(Role::Image, &picture(51_980, 8));
        let more = drain(&mut assembler);
        assert_eq!((more.len(), clock.period(more[0].stamp)), (1, 1));
    }
}
