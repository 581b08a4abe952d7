//! One walk with a phone: images and motion in, poses and words out. No thread; time is the images' own, and files are where the
//! page puts them.

use crate::clock::PageClock;
use crate::report::Report;
use crate::setup::Setup;
use crate::shown::{Shown, Told};
use crate::start::Start;
use cairn_engine::Engine;
use cairn_geometry::Vec3;
use cairn_sensor::{FramePacket, GrayImage, ImuSample, Merge, MergeConfig, Stamp};
use cairn_session::lens_watch::LensWatch;
use cairn_session::{
    Command, LensKnowledge, LibraryError, MapKeeper, NotSaved, RoutesLock, Session, SessionConfig,
};
use std::collections::VecDeque;
use std::sync::Arc;

/// How long an image waits for motion at or after it, seconds: pages deliver motion in batches of a few readings.
const MOTION_WAIT_S: f64 = 0.06;

/// Seconds of the walk that are seen again with a lens that was found: in these newcomers turn left and right and know their metres
/// (`bench run newcomers`), and their pictures, 15 a second of 640x480, are 37 MB.
const SEEN_AGAIN_S: f64 = 8.0;
/// With a lens that is certain so much of it is enough for metres: what is left is done sooner (the same newcomers).
const SEEN_AGAIN_CERTAIN_S: f64 = 5.0;

/// A device on which images have come meanwhile is slow: of what it sees again images nearer to each other than this are left out, as the
/// page leaves them out while mapping has not caught up.
const SEEN_APART_S: f64 = 0.15;

/// Why something that a page sent cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PhoneError {
    /// The setup.
    #[error("the setup cannot be used: {0}")]
    Setup(String),
    /// An image that has not the size of the setup.
    #[error("an image of {width}x{height} has {} bytes, not {found}", width * height)]
    Size {
        /// Width of the setup.
        width: usize,
        /// Height of the setup.
        height: usize,
        /// Bytes that came.
        found: usize,
    },
    /// An image or a reading out of order or not finite.
    #[error("{0}")]
    Dropped(String),
    /// A command that nobody knows.
    #[error("{0}")]
    Command(String),
    /// What is not saved.
    #[error("{0}")]
    NotSaved(#[from] NotSaved),
}

/// What is to be seen again with a lens that was found.
#[derive(Default)]
struct Again {
    /// The last packets before SLAM began again, and those that have come since.
    packets: VecDeque<FramePacket>,
    /// When SLAM began again, and the image that was seen again last.
    began: Stamp,
    last: Stamp,
    /// Who has not caught up by then is too slow for that, and goes on with what is seen now.
    until: Stamp,
    /// The lens is known from when all has been seen.
    is_certain: bool,
}

impl Again {
    /// What is to be seen again once SLAM begins again, which it may while it still sees again what it had seen before: what was `seen`
    /// last, and what waits.
    fn after(self, seen: &VecDeque<FramePacket>, began: Stamp, is_certain: bool) -> Self {
        let last = seen.back().map(|packet| packet.stamp);
        let waiting = self.packets.into_iter().filter(|packet| last.is_none_or(|last| packet.stamp > last));
        let mut packets: VecDeque<FramePacket> = seen.iter().cloned().chain(waiting).collect();
        if is_certain {
            packets.retain(|packet| began - packet.stamp <= SEEN_AGAIN_CERTAIN_S);
        }
        let until = began.plus_seconds(2.0 * SEEN_AGAIN_S);
        Self { packets, began, last: Stamp::default(), until, is_certain }
    }

    /// The next packet, with the readings of those that are left out.
    fn next(&mut self) -> Option<FramePacket> {
        let mut packet = self.packets.pop_front()?;
        let is_slow = self.packets.back().is_some_and(|newest| newest.stamp > self.began);
        while is_slow && packet.stamp - self.last < SEEN_APART_S {
            let Some(next) = self.packets.pop_front() else { break };
            packet.imu.extend(next.imu);
            packet = FramePacket { imu: packet.imu, ..next };
        }
        self.last = packet.stamp;
        Some(packet)
    }
}

/// The engine and the guide of one walk.
pub struct Phone {
    session: Session<Engine>,
    merge: Merge<Arc<GrayImage>, ()>,
    size: [usize; 2],
    notes: Vec<String>,
    clock: Arc<PageClock>,
    told: Told,
    /// While the lens is a guess, or was kept and is not checked yet.
    lens: Option<LensWatch>,
    /// The last packets, while the lens is a guess.
    seen: VecDeque<FramePacket>,
    again: Again,
    start: Start,
}

impl Phone {
    /// A walk that begins with the next image.
    ///
    /// # Errors
    /// A setup without sense: sizes, focal lengths, rates, a language that is not there.
    pub fn new(setup: &Setup) -> Result<Self, PhoneError> {
        let fail = |why: String| PhoneError::Setup(why);
        let library = &setup.library;
        let phrases = library.phrases().map_err(|e| fail(e.to_string()))?;
        let (start, lens) = Start::of(setup);
        let is_known = setup.pinhole.is_some() || lens.as_ref().is_some_and(LensWatch::is_certain);
        let camera = start.camera(is_known).map_err(|e| fail(e.to_string()))?;
        let lock = RoutesLock::take(&library.folder).map_err(|e| fail(e.to_string()))?;
        let kept = MapKeeper::open_with(lock, None, &camera, |map| start.engine(map));
        let kept = kept.map_err(|e| fail(e.to_string()))?;
        let config = SessionConfig {
            folder: library.folder.clone(),
            source: "the phone's camera".into(),
            phrases,
            ..SessionConfig::default()
        };
        let clock = Arc::new(PageClock::default());
        let mut session = Session::new(kept.engine, config).keeping(kept.keeper.with_clock(library.clock()));
        session.follow(clock.clone());
        if setup.pinhole.is_none() {
            session.knows_of_lens(LensKnowledge::of(is_known, setup.motion));
        }
        let imu_period_s = start.rig().imu.as_ref().map(|imu| 1.0 / imu.rate_hz);
        let merge = MergeConfig { imu_period_s, wait_s: MOTION_WAIT_S, ..MergeConfig::default() };
        Ok(Self {
            session,
            merge: Merge::new(merge),
            notes: kept.notes,
            size: [setup.width, setup.height],
            clock,
            told: Told::default(),
            lens,
            seen: VecDeque::new(),
            again: Again::default(),
            start,
        })
    }

    /// A reading of the motion sensors: rad/s and m/s^2 with gravity, in the axes of the images.
    ///
    /// # Errors
    /// One that is not finite or goes back in time; it is left out.
    pub fn motion(&mut self, t_s: f64, gyro: [f64; 3], accel: [f64; 3]) -> Result<(), PhoneError> {
        let sample = ImuSample::new(stamp(t_s)?, Vec3::from(gyro), Vec3::from(accel));
        self.merge.push_imu(sample).map_err(|dropped| PhoneError::Dropped(dropped.to_string()))?;
        Ok(())
    }

    /// An image, in gray, row by row, with the time it was taken.
    ///
    /// # Errors
    /// One of another size, or that goes back in time; it is left out.
    pub fn image(&mut self, t_s: f64, gray: &[u8]) -> Result<(), PhoneError> {
        let [width, height] = self.size;
        let image = GrayImage::from_vec(width, height, gray.to_vec());
        let image = image.ok_or(PhoneError::Size { width, height, found: gray.len() })?;
        let stamp = stamp(t_s)?;
        self.clock.reached(stamp);
        let pushed = self.merge.push_image(0, stamp, Arc::new(image));
        pushed.map_err(|dropped| PhoneError::Dropped(dropped.to_string()))
    }

    /// Processes the images that have the motion up to them, or have waited for it long enough.
    pub fn step(&mut self) -> Vec<Report> {
        let mut reports = Vec::new();
        while let Some(set) = self.merge.pop() {
            let packet = FramePacket {
                stamp: set.stamp,
                images: set.images,
                depth: None,
                imu: set.imu,
                decode_ms: 0.0,
            };
            let Some(packet) = self.now_or_again(packet) else { continue };
            let output = self.session.on_packet(&packet);
            reports.push(Report::of(packet.stamp, &output, self.session.events()));
            self.keep(packet);
            self.watch_lens();
        }
        reports
    }

    /// Keeps a packet that was processed, while the lens is a guess.
    fn keep(&mut self, packet: FramePacket) {
        let is_new = self.seen.back().is_none_or(|last| last.stamp < packet.stamp);
        if !is_new || self.lens.as_ref().is_none_or(LensWatch::is_certain) {
            return;
        }
        while self.seen.front().is_some_and(|first| packet.stamp - first.stamp > SEEN_AGAIN_S) {
            self.seen.pop_front();
        }
        self.seen.push_back(packet);
    }

    /// A packet to be processed now, with the readings of those that are not seen again any more; `None` where it waits until those
    /// before it are.
    fn now_or_again(&mut self, mut packet: FramePacket) -> Option<FramePacket> {
        let Again { packets, until, .. } = &mut self.again;
        if packets.is_empty() {
            return Some(packet);
        }
        if packet.stamp <= *until {
            packets.push_back(packet);
            return None;
        }
        let mut readings: Vec<ImuSample> = packets.drain(..).flat_map(|packet| packet.imu).collect();
        readings.append(&mut packet.imu);
        self.caught_up();
        Some(FramePacket { imu: readings, ..packet })
    }

    /// Does the next slice of what can wait for the next image: the estimate of a lens, mapping, an image to be seen again. False when
    /// there was nothing to do.
    pub fn work(&mut self) -> bool {
        // The lens does not wait for mapping, which begins anew with it.
        let lens = self.lens.as_mut().is_some_and(LensWatch::work);
        if self.session.work() || lens {
            return true;
        }
        if let Some(packet) = self.again.next() {
            let newest = self.again.packets.back().map_or(packet.stamp, |last| last.stamp);
            self.session.see_again(&packet, newest);
            self.keep(packet);
            self.watch_lens();
            self.caught_up();
            return true;
        }
        false
    }

    /// Learns the lens while it is a guess, or checks one that was kept, while nothing hangs on the map; begins again with another.
    fn watch_lens(&mut self) {
        let Some(watch) = self.lens.as_mut().filter(|_| self.session.may_restart_slam()) else { return };
        let Some(found) = watch.step_here(self.session.engine(), self.session.now()) else { return };
        self.notes.extend(found.not_kept);
        let Some(next) = watch.with(found.lens) else { return };
        if found.is_in_use {
            *watch = next;
            self.seen = VecDeque::new();
            self.session.knows_of_lens(LensKnowledge::of(true, self.start.rig().imu.is_some()));
            return;
        }
        self.start.reads_with(&next, found.clocks);
        let camera = self.start.camera(found.is_certain).map_err(LibraryError::from);
        match camera.and_then(|camera| self.session.restart_slam(&camera, |map| self.start.engine(map))) {
            Ok(notes) => self.notes.extend(notes),
            Err(why) => {
                self.notes.push(why.to_string());
                return;
            }
        }
        *watch = next;
        let began = self.session.now();
        self.again = std::mem::take(&mut self.again).after(&self.seen, began, found.is_certain);
        if found.is_certain {
            self.seen = VecDeque::new();
        }
        self.caught_up();
    }

    /// Once all has been seen again, a lens that is certain is known: a route may be recorded.
    fn caught_up(&mut self) {
        if self.again.packets.is_empty() && std::mem::take(&mut self.again.is_certain) {
            self.session.knows_of_lens(LensKnowledge::of(true, self.start.rig().imu.is_some()));
        }
    }

    /// Time goes on without an image: after a while the guide says stop.
    ///
    /// # Errors
    /// A time that is none.
    pub fn tick(&mut self, t_s: f64) -> Result<Vec<Report>, PhoneError> {
        let now = stamp(t_s)?;
        self.clock.reached(now);
        self.merge.advance(now);
        let mut reports = self.step();
        self.session.tick(now);
        reports.extend(Report::of_events(now, self.session.events()));
        Ok(reports)
    }

    /// The page finds that directions reach the walker too late, or no longer: the guide says stop meanwhile.
    pub fn late(&self, is_late: bool) {
        self.clock.late(is_late);
    }

    /// What the page shows now, but for the map.
    pub fn shown(&mut self) -> Shown {
        self.told.shown(&self.session, std::mem::take(&mut self.notes))
    }

    /// The map as bytes (`cairn_session::Drawn`): what has changed since the last call, or the whole of it.
    pub fn map(&mut self, whole: bool) -> Vec<u8> {
        self.told.map(&self.session, whole)
    }

    /// The walk itself, to look at.
    pub fn session(&self) -> &Session<Engine> {
        &self.session
    }

    /// Carries out a command, as `cairn walk` takes it; what was done, in words.
    ///
    /// # Errors
    /// One that is unknown, or cannot be carried out now.
    pub fn command(&mut self, line: &str) -> Result<String, PhoneError> {
        let command = Command::parse(line).map_err(|e| PhoneError::Command(e.to_string()))?;
        self.session.command(&command).map_err(|why| PhoneError::Command(why.words))
    }

    /// Ends the walk: what is recorded is saved.
    ///
    /// # Errors
    /// What could not be saved.
    pub fn close(&mut self) -> Result<(), PhoneError> {
        Ok(self.session.close()?)
    }
}

/// A time as a page gives it.
fn stamp(t_s: f64) -> Result<Stamp, PhoneError> {
    let ns = t_s * 1e9;
    // Beyond 292 years of nanoseconds there is no stamp.
    if ns.is_nan() || ns.abs() >= i64::MAX as f64 {
        return Err(PhoneError::Dropped(format!("{t_s} s is no time")));
    }
    Ok(Stamp::from_seconds(t_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::Library;

    fn packet(t_s: f64) -> FramePacket {
        let image = Arc::new(GrayImage::new(64, 48));
        let imu = vec![ImuSample::new(Stamp::from_seconds(t_s), Vec3::zeros(), -Vec3::y() * 9.8)];
        FramePacket { stamp: Stamp::from_seconds(t_s), images: vec![image], depth: None, imu, decode_ms: 0.0 }
    }

    #[test]
    fn images_wait_for_those_that_are_seen_again_and_not_for_ever() {
        let folder = std::env::temp_dir().join(format!("cairn-phone-{}-again", std::process::id()));
        let setup = Setup {
            width: 64,
            height: 48,
            rate_hz: 15.0,
            pinhole: None,
            distortion: None,
            motion: true,
            phone: Some("one".into()),
            library: Library { folder: folder.clone(), ..Library::default() },
        };
        let mut phone = Phone::new(&setup).expect("a phone");
        let again = |t_s: [f64; 2]| Again {
            packets: t_s.map(packet).into(),
            began: Stamp::from_seconds(1.5),
            last: Stamp::default(),
            until: Stamp::from_seconds(3.0),
            is_certain: true,
        };
        phone.image(0.8, &[90; 64 * 48]).expect("an image");
        phone.motion(0.9, [0.0; 3], [0.0, -9.8, 0.0]).expect("a reading");
        assert_eq!(phone.step().len(), 1);
        phone.again = again([1.0, 1.2]);
        assert_eq!(phone.now_or_again(packet(2.9)).map(|packet| packet.stamp), None);
        for left in [2, 1, 0] {
            assert!(phone.again.is_certain && phone.work());
            assert_eq!(phone.again.packets.len(), left);
        }
        assert!(!phone.again.is_certain, "the lens is known once all has been seen");
        let reports = phone.tick(3.0).expect("a time");
        let said: Vec<_> = reports.iter().flat_map(|report| &report.said).collect();
        assert!(said.is_empty(), "images have come meanwhile: {said:?}");
        assert!(phone.now_or_again(packet(3.1)).is_some_and(|packet| packet.imu.len() == 1));
        phone.again = again([3.2, 3.3]);
        let late = phone.now_or_again(packet(3.4)).expect("it waits no longer");
        assert_eq!(late.imu.len(), 3, "no reading is lost");
        assert!(phone.again.packets.is_empty() && !phone.again.is_certain);
        let mut slow = Again {
            packets: [1.0, 1.05, 1.1, 1.2, 1.6].map(packet).into(),
            began: Stamp::from_seconds(1.5),
            ..Again::default()
        };
        let seen: Vec<_> = std::iter::from_fn(|| slow.next()).map(|p| (p.stamp, p.imu.len())).collect();
        let expected = [(1.0, 1), (1.2, 3), (1.6, 1)].map(|(t_s, n)| (Stamp::from_seconds(t_s), n));
        assert_eq!(seen, expected, "images have come since, and no reading is lost");
        drop(phone);
        let _ = std::fs::remove_dir_all(folder);
    }

    #[test]
    fn what_waits_to_be_seen_again_is_not_lost_when_slam_begins_again_once_more() {
        let seen: VecDeque<_> = [1.0, 2.0].map(packet).into();
        let stamps = |began: f64, is_certain: bool| {
            let waiting = Again { packets: [1.0, 2.0, 6.5, 7.0].map(packet).into(), ..Again::default() };
            let again = waiting.after(&seen, Stamp::from_seconds(began), is_certain);
            assert_eq!((again.is_certain, again.began.seconds()), (is_certain, began));
            again.packets.iter().map(|packet| packet.stamp.seconds()).collect::<Vec<_>>()
        };
        assert_eq!(stamps(7.0, false), [1.0, 2.0, 6.5, 7.0], "each of them once");
        assert_eq!(stamps(7.0, true), [2.0, 6.5, 7.0], "as much as metres take");
    }
}
