//! A live stream as a [`Source`]: the newest picture wins, silence ends a connection, and a lost one is made again.
//!
//! Two threads: one reads the child and makes it anew when it ends, one watches that it does not fall silent. Times
//! are the stream's own, laid onto this machine's clock where the connection begins.

use super::address::Address;
use super::child::{Feed, Handle, Recipe, STRANGER};
use super::rig_for;
use super::slot::{Picture, Slot, State};
use cairn_sensor::{FramePacket, Rig, Source, SourceError, SourceInfo, Stamp};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// How long a stream may take to give its first picture,
const OPENS_WITHIN: Duration = Duration::from_secs(5);
/// and each later one.
const READS_WITHIN: Duration = Duration::from_secs(1);
/// A picture older than this is dropped, not given.
const TOO_OLD: Duration = Duration::from_millis(150);
/// Rest before a connection is made again, growing to
const REST: Duration = Duration::from_millis(100);
/// this.
const LONGEST_REST: Duration = Duration::from_secs(2);
/// The least delay is looked for among so many pictures: the network's usual delay is no age.
const DELAYS: usize = 300;
/// Jumps of the stream's own time larger than this begin a new count, seconds.
const JUMP_S: f64 = 5.0;

/// A live stream.
pub(super) struct Stream {
    info: SourceInfo,
    rig: Rig,
    slot: Arc<Slot>,
    handle: Handle,
    threads: Vec<JoinHandle<()>>,
    skipped: Vec<String>,
    left: Option<usize>,
}

impl Stream {
    /// Opens the stream and waits for its first picture: five seconds, or, where we listen, for as long as nobody sends.
    pub fn open(address: &Address, rig: Option<Rig>, frames: Option<usize>) -> Result<Self, SourceError> {
        Self::start(&address.shown, Recipe::ffmpeg(address, &[]), address.listens, rig, frames)
    }

    fn start(
        shown: &str,
        recipe: Recipe,
        listens: bool,
        rig: Option<Rig>,
        frames: Option<usize>,
    ) -> Result<Self, SourceError> {
        let (slot, handle) = (Arc::new(Slot::default()), Handle::default());
        let mut stream = Self {
            info: SourceInfo {
                name: shown.to_owned(),
                frames,
                rate_hz: 30.0,
                truth: Vec::new(),
                assumed: None,
            },
            rig: Rig { cameras: Vec::new(), depth: None, imu: None },
            slot: slot.clone(),
            handle: handle.clone(),
            threads: Vec::new(),
            skipped: Vec::new(),
            left: frames,
        };
        let spawn = |name: &str, work: Box<dyn FnOnce() + Send>| {
            std::thread::Builder::new().name(name.into()).spawn(work).map_err(|e| {
                SourceError::new(shown, format!("no thread to read it ({e})"), "close other programs")
            })
        };
        let (s, h, name) = (slot.clone(), handle.clone(), shown.to_owned());
        stream.threads.push(spawn("cairn-video", Box::new(move || read(&name, &recipe, listens, &s, &h)))?);
        let (s, h) = (slot.clone(), handle);
        stream.threads.push(spawn("cairn-video-watch", Box::new(move || watch(listens, &s, &h)))?);
        // A listener that can not listen fails at once; one that can waits.
        let limit = (!listens).then_some(OPENS_WITHIN + Duration::from_millis(500));
        let first = slot.wait(limit, |s| match (&s.failed, s.known) {
            (Some(e), _) => Some(Err(SourceError::new(&e.what, &e.why, &e.cure))),
            (None, Some(known)) => Some(Ok(known)),
            (None, None) => None,
        });
        let late =
            || SourceError::new(shown, "gave no picture within 5 s", "check the address, and that it sends");
        let (size, rate_hz) = first.unwrap_or_else(|| Err(late()))?;
        (stream.rig, stream.info.assumed) = rig_for(shown, size, rig)?;
        stream.info.rate_hz = rate_hz;
        Ok(stream)
    }

    /// Lines of the threads, and one with the counts, which is kept last.
    fn note(&mut self) {
        let (lines, overtaken, stale) = {
            let mut s = self.slot.lock();
            (std::mem::take(&mut s.lines), s.overtaken, s.stale)
        };
        let counted = self.skipped.last().is_some_and(|l| l.starts_with(COUNTS));
        if counted && (!lines.is_empty() || overtaken + stale > 0) {
            self.skipped.pop();
        }
        self.skipped.extend(lines);
        if overtaken + stale > 0 {
            let count = format!("{COUNTS}{overtaken} overtaken by newer ones, {stale} older than 150 ms");
            self.skipped.push(count);
        }
    }
}

const COUNTS: &str = "pictures left out: ";

impl Source for Stream {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Waits for a picture; while the stream is gone, until it is back.
    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        if self.left == Some(0) {
            return Ok(None);
        }
        let picture = self.slot.wait(None, |s| match (s.newest.take(), &s.failed) {
            (Some(p), _) if p.born.elapsed() > TOO_OLD => {
                s.stale += 1;
                None
            }
            (Some(p), _) => Some(Ok(p)),
            (None, Some(e)) => Some(Err(SourceError::new(&e.what, &e.why, &e.cure))),
            (None, None) => None,
        });
        self.note();
        let Some(picture) = picture.transpose()? else { return Ok(None) };
        self.left = self.left.map(|n| n - 1);
        let decode_ms = picture.born.elapsed().as_secs_f64() * 1e3;
        let images = vec![Arc::new(picture.image)];
        Ok(Some(FramePacket { stamp: picture.stamp, images, depth: None, imu: Vec::new(), decode_ms }))
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        self.slot.change(|s| s.closing = true);
        self.handle.end();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// The reading thread: connections, one after the other.
fn read(shown: &str, recipe: &Recipe, listens: bool, slot: &Slot, handle: &Handle) {
    let mut size: Option<[usize; 2]> = None;
    let mut last = Stamp(i64::MIN);
    let mut rest = REST;
    let (mut tried, mut gone) = (0, false);
    while !slot.lock().closing {
        tried += 1;
        slot.change(|s| (s.started, s.heard) = (Some(Instant::now()), None));
        let mut feed = match Feed::start(recipe, handle) {
            Ok(feed) => feed,
            Err(e) => return slot.change(|s| s.failed = Some(e)),
        };
        // Closed between the two: the child just started must go as well.
        if slot.lock().closing {
            handle.end();
        }
        let mut clock = Clock::default();
        let mut given = 0;
        if let Some((found, rate)) = feed.head() {
            if *size.get_or_insert(found) != found {
                let why = format!("now gives pictures of {}x{}", found[0], found[1]);
                let cure = "let it send the size it began with, or start anew";
                return slot.change(|s| s.failed = Some(SourceError::new(shown, why, cure)));
            }
            while let Some((image, time)) = feed.picture(found) {
                let (stamp, born) = clock.stamp(time, Instant::now(), last);
                (last, given, rest) = (stamp, given + 1, REST);
                slot.put(Picture { stamp, image, born });
                slot.change(|s| {
                    s.known.get_or_insert((found, rate));
                    if std::mem::take(&mut gone) {
                        s.lines.push(format!("the stream is back after {tried} tries"));
                    }
                });
                tried = 0;
            }
        }
        let why = feed.end();
        slot.change(|s| ended(shown, s, listens, given, &why, &mut gone));
        if slot.wait(Some(rest), |s| (s.closing || s.failed.is_some()).then_some(())).is_some() {
            return;
        }
        rest = if listens { REST } else { (2 * rest).min(LONGEST_REST) };
    }
}

/// A connection has ended: before the first picture ever that is a failure, afterwards it is made again.
fn ended(shown: &str, s: &mut State, listens: bool, given: usize, why: &str, gone: &mut bool) {
    let quick = s.started.is_some_and(|t| t.elapsed() < Duration::from_secs(2));
    if s.closing {
    } else if why == STRANGER {
        s.lines.push(format!("{STRANGER}; publish to the name of {shown}"));
    } else if s.known.is_none() && (!listens || quick) {
        let cure = match listens {
            true => "choose another port, or end the program that has it",
            false => "check the address, and that it sends",
        };
        s.failed = Some(SourceError::new(shown, why, cure));
    } else if given > 0 {
        *gone = true;
        s.lines.push(format!("the stream is gone ({why}); waiting for it"));
    }
}

/// The watching thread: ends the child when it is silent for too long.
fn watch(listens: bool, slot: &Slot, handle: &Handle) {
    while slot
        .wait(Some(Duration::from_millis(100)), |s| (s.closing || s.failed.is_some()).then_some(()))
        .is_none()
    {
        let silent = {
            let s = slot.lock();
            match (s.heard, s.started) {
                (Some(t), _) => t.elapsed() > READS_WITHIN,
                (None, Some(t)) => !listens && t.elapsed() > OPENS_WITHIN,
                (None, None) => false,
            }
        };
        if silent {
            slot.change(|s| (s.started, s.heard) = (None, None));
            handle.end();
        }
    }
}

/// Lays the stream's own times onto this machine's clock.
#[derive(Default)]
struct Clock {
    /// The stream's time and the stamp that a count began with.
    began: Option<(f64, Stamp)>,
    last: f64,
    /// Delays of late, seconds: arrival less stamp.
    delays: std::collections::VecDeque<f64>,
}

impl Clock {
    /// Stamp of a picture, later than `after`, and when it would have come without delay.
    fn stamp(&mut self, time: Option<f64>, now: Instant, after: Stamp) -> (Stamp, Instant) {
        let arrived = unix_now();
        let stamp = match time {
            None => arrived,
            Some(t) => {
                if self.began.is_none() || t < self.last || t - self.last > JUMP_S {
                    self.began = Some((t, arrived));
                    self.delays.clear();
                }
                self.last = t;
                self.began.map_or(arrived, |(t0, stamp)| stamp.plus_seconds(t - t0))
            }
        };
        let delay = arrived - stamp;
        if self.delays.len() == DELAYS {
            self.delays.pop_front();
        }
        self.delays.push_back(delay);
        let least = self.delays.iter().copied().fold(f64::INFINITY, f64::min);
        let late = Duration::try_from_secs_f64(delay - least).unwrap_or_default();
        let stamp = stamp.max(Stamp(after.0.saturating_add(1_000_000)));
        (stamp, now.checked_sub(late).unwrap_or(now))
    }
}

/// Now, as time since 1970: a way that is recorded tells when it was walked.
fn unix_now() -> Stamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Stamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(script: &str, listens: bool) -> Result<Stream, SourceError> {
        Stream::start("test", Recipe::shell(script), listens, None, None)
    }

    /// `pictures` of 16x16, one each `every_s` seconds; what comes before and after is the caller's.
    fn sends(pictures: usize, every_s: f64) -> String {
        format!(
            "echo 'YUV4MPEG2 W16 H16 F25:1 Cmono'; for k in $(seq 1 {pictures}); do \
             echo \"showinfo pts_time:$(echo $k | awk '{{print $1 * {every_s}}}')\" >&2; echo FRAME; \
             head -c 256 /dev/zero; sleep {every_s}; done"
        )
    }

    #[test]
    fn the_newest_picture_wins_and_what_is_too_old_is_dropped() {
        let mut stream = open(&format!("{}; exec sleep 5", sends(40, 0.05)), false).unwrap();
        assert_eq!(stream.rig().cameras[0].camera.width, 16);
        let first = stream.next_packet().unwrap().unwrap();
        std::thread::sleep(Duration::from_millis(400));
        let asked = Instant::now();
        let next = stream.next_packet().unwrap().unwrap();
        assert!(next.stamp - first.stamp > 0.3, "{} s later only", next.stamp - first.stamp);
        assert!(next.decode_ms < 151.0, "{} ms old", next.decode_ms);
        // It does not wait for the end of the stream; how soon it answers depends on what else the machine does.
        assert!(asked.elapsed().as_secs_f64() < 1.5, "{:?}", asked.elapsed());
        let counts = stream.skipped().last().cloned().unwrap_or_default();
        assert!(counts.contains("overtaken"), "{counts}");
    }

    #[test]
    fn a_lost_stream_is_told_and_comes_back_with_rising_stamps() {
        // Each connection gives five pictures and ends.
        let mut stream = open(&sends(5, 0.02), false).unwrap();
        let mut stamps = Vec::new();
        for _ in 0..12 {
            stamps.push(stream.next_packet().unwrap().unwrap().stamp);
        }
        assert!(stamps.windows(2).all(|w| w[0] < w[1]), "{stamps:?}");
        let told = stream.skipped().join("\n");
        assert!(told.contains("the stream is gone") && told.contains("is back"), "{told}");
    }

    #[test]
    fn a_stream_that_falls_silent_is_made_anew_within_two_seconds() {
        let mut stream = open(&format!("{}; exec sleep 60", sends(2, 0.02)), false).unwrap();
        let first = stream.next_packet().unwrap().unwrap().stamp;
        let asked = Instant::now();
        let mut last = first;
        while last - first < 0.5 {
            last = stream.next_packet().unwrap().unwrap().stamp;
        }
        assert!(asked.elapsed() < Duration::from_secs(3), "{:?}", asked.elapsed());
    }

    #[test]
    fn what_does_not_open_says_why() {
        let error = open("echo 'rtmp: Connection refused' >&2; exit 1", false).err().unwrap().to_string();
        assert!(error.contains("Connection refused") && error.contains("check the address"), "{error}");
        let error = open("echo 'bind: Address already in use' >&2", true).err().unwrap().to_string();
        assert!(error.contains("in use") && error.contains("another port"), "{error}");
    }

    #[test]
    fn the_usual_delay_is_no_age_but_more_is() {
        let mut clock = Clock::default();
        let now = Instant::now();
        let (a, _) = clock.stamp(Some(10.0), now, Stamp(0));
        // The stream's time stands nearly still while ours goes on: the picture is late.
        std::thread::sleep(Duration::from_millis(60));
        let (b, born) = clock.stamp(Some(10.01), now, a);
        assert!((b - a - 0.01).abs() < 1e-6);
        assert!(now - born > Duration::from_millis(40), "{:?}", now - born);
        // A jump begins anew, and stamps rise all the same.
        let (c, born) = clock.stamp(Some(0.0), now, b);
        assert!(c > b && now - born < Duration::from_millis(5));
    }
}
