//! A live stream as a [`Source`]: the newest image wins, silence ends a connection, and a lost one is
//! re-established.
//!
//! Two threads: one reads the child and restarts it when it ends, one stops it when it falls silent. Times
//! are the stream's own, mapped to this machine's clock at the start of the connection.

use super::address::Address;
use super::child::{ChildCommand, Feed, Handle, WRONG_NAME};
use super::rig_for;
use super::rtmp_port::RtmpPort;
use super::slot::{LiveImage, Slot, State};
use crate::{Cancel, OpenOptions};
use cairn_sensor::{ClockReading, FramePacket, Live, Rig, Source, SourceError, SourceInfo, Stamp};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// How long a stream may take to deliver its first image.
const OPEN_TIMEOUT: Duration = Duration::from_secs(5);
/// How long it may take for each later one.
const READ_TIMEOUT: Duration = Duration::from_secs(1);
/// An image older than this is dropped.
const TOO_OLD: Duration = Duration::from_millis(150);
/// How often waiting for an image looks whether it was cancelled.
const LOOK: Duration = Duration::from_millis(50);
/// Initial delay before a connection is retried.
const RETRY_DELAY: Duration = Duration::from_millis(100);
/// Largest delay before a retry.
const MAX_RETRY_DELAY: Duration = Duration::from_secs(2);
/// Images over which the smallest delay is taken: the usual delay of the network does not count as age.
const DELAYS: usize = 300;
/// Jumps of the stream's own time larger than this restart the mapping to the machine's clock, seconds.
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
    cancel: Cancel,
}

impl Stream {
    /// Opens the stream and waits for its first image: five seconds, or, where we listen, until someone
    /// sends.
    pub fn open(address: &Address, options: &OpenOptions) -> Result<Self, SourceError> {
        let Some(place) = &address.listens else {
            return Self::start(&address.shown, ChildCommand::ffmpeg(address, &[]), None, options);
        };
        let port = RtmpPort::bind(place).map_err(|e| {
            let cure = "choose another port or an address of this machine, or stop the program that uses it";
            SourceError::new(&address.shown, format!("cannot be listened at ({e})"), cure)
        })?;
        let command = ChildCommand::ffmpeg(&address.listening_at(port.inner()), &[]);
        Self::start(&address.shown, command, Some(port), options)
    }

    fn start(
        shown: &str,
        command: ChildCommand,
        port: Option<RtmpPort>,
        options: &OpenOptions,
    ) -> Result<Self, SourceError> {
        let OpenOptions { frames, told, ref cancel, .. } = *options;
        let listens = port.is_some();
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
            cancel: cancel.clone(),
        };
        let spawn = |name: &str, work: Box<dyn FnOnce() + Send>| {
            std::thread::Builder::new().name(name.into()).spawn(work).map_err(|e| {
                SourceError::new(shown, format!("no thread to read it ({e})"), "close other programs")
            })
        };
        let (s, h, name) = (slot.clone(), handle.clone(), shown.to_owned());
        stream
            .threads
            .push(spawn("cairn-video", Box::new(move || read(&name, &command, listens, told, &s, &h)))?);
        if let Some(port) = port {
            let (s, name) = (slot.clone(), shown.to_owned());
            let refuse = move |s: &Slot, why: &str| report(s.change(|s| refused(&name, s, why)), told);
            let serve = move || port.serve(|| s.lock().closing, |why| refuse(&s, why));
            stream.threads.push(spawn("cairn-rtmp-port", Box::new(serve))?);
        }
        let (s, h) = (slot.clone(), handle);
        stream.threads.push(spawn("cairn-video-watch", Box::new(move || stop_when_silent(listens, &s, &h)))?);
        let limit = (!listens).then_some(OPEN_TIMEOUT + Duration::from_millis(500));
        let until = limit.map(|l| Instant::now() + l);
        let first = loop {
            let found = slot.wait(Some(LOOK), |s| match (&s.failed, s.known) {
                (Some(e), _) => Some(Err(SourceError::new(&e.what, &e.why, &e.cure))),
                (None, Some(known)) => Some(Ok(known)),
                (None, None) => None,
            });
            if cancel.is_cancelled() {
                return Err(SourceError::new(shown, "waiting for it was interrupted", "start again"));
            }
            if found.is_some() || until.is_some_and(|until| Instant::now() >= until) {
                break found;
            }
        };
        let late =
            || SourceError::new(shown, "sent no image within 5 s", "check the address, and that it sends");
        let (size, rate_hz) = first.unwrap_or_else(|| Err(late()))?;
        (stream.rig, stream.info.assumed) = rig_for(shown, size, options.rig.clone())?;
        stream.info.rate_hz = rate_hz;
        Ok(stream)
    }

    /// Takes over the lines of the threads, and adds one with the counts, which stays last.
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

const COUNTS: &str = "images dropped: ";

impl Source for Stream {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Waits for an image; while the connection is lost, until it is back. Once cancelled, the stream is at its end.
    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        if self.left == Some(0) {
            return Ok(None);
        }
        let image = loop {
            let found = self.slot.wait(Some(LOOK), |s| match (s.newest.take(), &s.failed) {
                (Some(p), _) if p.on_time.elapsed() > TOO_OLD => {
                    s.stale += 1;
                    None
                }
                (Some(p), _) => Some(Ok(p)),
                (None, Some(e)) => Some(Err(SourceError::new(&e.what, &e.why, &e.cure))),
                (None, None) => None,
            });
            if found.is_some() || self.cancel.is_cancelled() {
                break found;
            }
        };
        self.note();
        let Some(image) = image.transpose()? else { return Ok(None) };
        self.left = self.left.map(|n| n - 1);
        let decode_ms = image.on_time.elapsed().as_secs_f64() * 1e3;
        let images = vec![Arc::new(image.image)];
        Ok(Some(FramePacket { stamp: image.stamp, images, depth: None, imu: Vec::new(), decode_ms }))
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn live(&self) -> Option<Arc<dyn Live>> {
        Some(Arc::new(StreamLive(self.slot.clone())))
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

/// The reading thread: one connection after the other.
fn read(
    shown: &str,
    command: &ChildCommand,
    listens: bool,
    told: Option<fn(&str)>,
    slot: &Slot,
    handle: &Handle,
) {
    let mut size: Option<[usize; 2]> = None;
    let mut last = Stamp(i64::MIN);
    let mut retry_delay = RETRY_DELAY;
    let (mut tried, mut was_lost) = (0, false);
    while !slot.lock().closing {
        tried += 1;
        slot.change(|s| (s.started, s.last_image) = (Some(Instant::now()), None));
        let mut feed = match Feed::start(command, handle) {
            Ok(feed) => feed,
            Err(e) => return slot.change(|s| s.failed = Some(e)),
        };
        // Closed between the two: the child just started must be stopped as well.
        if slot.lock().closing {
            handle.end();
        }
        let mut clock = Clock::default();
        let mut delivered = 0;
        if let Some((found, rate)) = feed.header() {
            let wanted = *size.get_or_insert(found);
            if wanted != found {
                slot.change(|s| wrong_size(s, found, wanted));
            }
            while let Some((image, time)) = feed.next_image(found) {
                if wanted != found {
                    // The sender is told, not cut off: what it sends next may fit.
                    slot.change(|s| s.last_image = Some(Instant::now()));
                    continue;
                }
                let (stamp, on_time) = clock.stamp(time, Instant::now(), last);
                (last, delivered, retry_delay) = (stamp, delivered + 1, RETRY_DELAY);
                slot.put(LiveImage { stamp, image, on_time });
                slot.change(|s| {
                    s.known.get_or_insert((found, rate));
                    (s.least_delay_s, s.trouble) = (clock.least_s, None);
                    if std::mem::take(&mut was_lost) {
                        s.lines.push(format!("the stream is back after {tried} attempts"));
                    }
                });
                tried = 0;
            }
        }
        let why = feed.end();
        let news = slot.change(|s| {
            let lines = s.lines.len();
            ended(shown, s, listens, delivered, &why, &mut was_lost);
            s.lines.get(lines..).unwrap_or_default().to_vec()
        });
        report(news, told);
        if slot.wait(Some(retry_delay), |s| (s.closing || s.failed.is_some()).then_some(())).is_some() {
            return;
        }
        retry_delay = if listens { RETRY_DELAY } else { (2 * retry_delay).min(MAX_RETRY_DELAY) };
    }
}

/// Tells lines at once.
fn report(lines: Vec<String>, told: Option<fn(&str)>) {
    if let Some(told) = told {
        lines.iter().for_each(|line| told(line));
    }
}

/// Says once that somebody was refused: a browser, a scanner. Whoever it was, the sender may come next.
fn refused(shown: &str, s: &mut State, why: &str) -> Vec<String> {
    if std::mem::replace(&mut s.refused, true) {
        return Vec::new();
    }
    let line = format!("who connected sends no RTMP video and was refused ({why}); waiting on at {shown}");
    s.lines.push(line.clone());
    vec![line]
}

/// Tells that the images of this connection have another size than those of the first.
fn wrong_size(s: &mut State, [w, h]: [usize; 2], [first_w, first_h]: [usize; 2]) {
    let why = format!(
        "The stream sends {w} by {h} now, it was {first_w} by {first_h}. Set the sender back to that size."
    );
    if s.trouble.as_ref() != Some(&why) {
        s.lines.push(why.clone());
    }
    s.trouble = Some(why);
}

/// Handles the end of a connection: before the very first image that is a failure, afterwards it is retried.
fn ended(shown: &str, s: &mut State, listens: bool, delivered: usize, why: &str, was_lost: &mut bool) {
    if s.closing {
    } else if why == WRONG_NAME {
        s.lines.push(format!("{WRONG_NAME}; publish to the name in {shown}"));
    } else if listens && delivered == 0 && !cannot_listen(why) {
        refused(shown, s, why);
    } else if s.known.is_none() {
        let cure = match listens {
            true => "install an ffmpeg that can listen for RTMP",
            false => "check the address, and that it sends",
        };
        s.failed = Some(SourceError::new(shown, why, cure));
    } else if delivered > 0 {
        *was_lost = true;
        s.lines.push(format!("the stream is lost ({why}); reconnecting"));
    }
}

/// Whether a listener ended because it cannot listen, as ffmpeg says it, and not because of who connected.
fn cannot_listen(why: &str) -> bool {
    ["not found", "nrecognized option"].iter().any(|sign| why.contains(sign))
}

/// The watchdog thread: stops the child when it is silent for too long.
fn stop_when_silent(listens: bool, slot: &Slot, handle: &Handle) {
    while slot
        .wait(Some(Duration::from_millis(100)), |s| (s.closing || s.failed.is_some()).then_some(()))
        .is_none()
    {
        let silent = {
            let s = slot.lock();
            match (s.last_image, s.started) {
                (Some(t), _) => t.elapsed() > READ_TIMEOUT,
                (None, Some(t)) => !listens && t.elapsed() > OPEN_TIMEOUT,
                (None, None) => false,
            }
        };
        if silent {
            slot.change(|s| (s.started, s.last_image) = (None, None));
            handle.end();
        }
    }
}

/// Maps the stream's own times to this machine's clock.
#[derive(Default)]
struct Clock {
    /// The stream's time and the stamp at which the mapping started.
    started_at: Option<(f64, Stamp)>,
    last: f64,
    /// Recent delays in seconds: arrival minus stamp.
    delays: std::collections::VecDeque<f64>,
    /// The least of them.
    least_s: f64,
}

impl Clock {
    /// The stamp of an image, later than `after`, and when it would have arrived without delay.
    fn stamp(&mut self, time: Option<f64>, now: Instant, after: Stamp) -> (Stamp, Instant) {
        let arrived = unix_now();
        let stamp = match time {
            None => arrived,
            Some(t) => {
                if self.started_at.is_none() || t < self.last || t - self.last > JUMP_S {
                    self.started_at = Some((t, arrived));
                    self.delays.clear();
                }
                self.last = t;
                self.started_at.map_or(arrived, |(t0, stamp)| stamp.plus_seconds(t - t0))
            }
        };
        let delay = arrived - stamp;
        if self.delays.len() == DELAYS {
            self.delays.pop_front();
        }
        self.delays.push_back(delay);
        self.least_s = self.delays.iter().copied().fold(f64::INFINITY, f64::min);
        let late = Duration::try_from_secs_f64(delay - self.least_s).unwrap_or_default();
        let stamp = stamp.max(Stamp(after.0.saturating_add(1_000_000)));
        (stamp, now.checked_sub(late).unwrap_or(now))
    }
}

/// Now, as time since 1970, so that a recorded route knows when it was walked; it never jumps when the clock is set.
fn unix_now() -> Stamp {
    static BEGAN: OnceLock<(Instant, Duration)> = OnceLock::new();
    let (began, since) = *BEGAN
        .get_or_init(|| (Instant::now(), SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()));
    Stamp(i64::try_from((since + began.elapsed()).as_nanos()).unwrap_or(i64::MAX))
}

/// The stream as other threads see it.
struct StreamLive(Arc<Slot>);

impl Live for StreamLive {
    /// The sender's clock is not compared with ours: an image counts as old by its delay beyond the least one.
    fn clock(&self) -> Option<ClockReading> {
        let s = self.0.lock();
        s.known?;
        let now = unix_now().plus_seconds(-s.least_delay_s);
        Some(ClockReading { now, bound_s: 0.0, delivery_s: 0.0 })
    }

    fn trouble(&self) -> Option<String> {
        self.0.lock().trouble.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(script: &str, listens: bool) -> Result<Stream, SourceError> {
        let port = listens.then(|| RtmpPort::bind("127.0.0.1:0").unwrap());
        Stream::start("test", ChildCommand::shell(script), port, &OpenOptions::default())
    }

    /// A script that sends `images` images of 16x16, one every `every_s` seconds; the caller adds what
    /// comes before and after.
    fn sends(images: usize, every_s: f64) -> String {
        format!(
            "echo 'YUV4MPEG2 W16 H16 F25:1 Cmono'; for k in $(seq 1 {images}); do \
             echo \"showinfo pts_time:$(echo $k | awk '{{print $1 * {every_s}}}')\" >&2; echo FRAME; \
             head -c 256 /dev/zero; sleep {every_s}; done"
        )
    }

    #[test]
    fn newest_image_wins_and_old_ones_are_dropped() {
        let mut stream = open(&format!("{}; exec sleep 5", sends(40, 0.05)), false).unwrap();
        assert_eq!(stream.rig().cameras[0].camera.width, 16);
        let first = stream.next_packet().unwrap().unwrap();
        std::thread::sleep(Duration::from_millis(400));
        let asked = Instant::now();
        let next = stream.next_packet().unwrap().unwrap();
        assert!(next.stamp - first.stamp > 0.3, "{} s later only", next.stamp - first.stamp);
        assert!(next.decode_ms < 151.0, "{} ms old", next.decode_ms);
        // It does not wait for the end of the stream; how soon it answers depends on the load of the machine.
        assert!(asked.elapsed().as_secs_f64() < 1.5, "{:?}", asked.elapsed());
        let counts = stream.skipped().last().cloned().unwrap_or_default();
        assert!(counts.contains("overtaken"), "{counts}");
    }

    #[test]
    fn lost_stream_reconnects_with_increasing_stamps() {
        // Each connection sends five images and ends.
        let mut stream = open(&sends(5, 0.02), false).unwrap();
        let mut stamps = Vec::new();
        for _ in 0..12 {
            stamps.push(stream.next_packet().unwrap().unwrap().stamp);
        }
        assert!(stamps.windows(2).all(|w| w[0] < w[1]), "{stamps:?}");
        let lines = stream.skipped().join("\n");
        assert!(lines.contains("the stream is lost") && lines.contains("is back"), "{lines}");
    }

    #[test]
    fn silent_stream_is_restarted_within_two_seconds() {
        let mut stream = open(&format!("{}; exec sleep 60", sends(2, 0.02)), false).unwrap();
        let first = stream.next_packet().unwrap().unwrap().stamp;
        let asked = Instant::now();
        let mut last = first;
        while last - first < 0.5 {
            last = stream.next_packet().unwrap().unwrap().stamp;
        }
        assert!(asked.elapsed() < Duration::from_secs(3), "{:?}", asked.elapsed());
    }

    /// Waits until something holds.
    fn until(what: &str, mut holds: impl FnMut() -> bool) {
        let began = Instant::now();
        while !holds() {
            assert!(began.elapsed() < Duration::from_secs(8), "{what}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn sender_of_another_size_is_told_and_does_not_end_the_stream() {
        let folder = std::env::temp_dir().join(format!("cairn-size-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let count = folder.join("runs");
        // The second connection sends another size, the third the first one's again.
        let script = format!(
            "echo x >> {0}; n=$(wc -l < {0}); if [ $n = 2 ]; then W=32; else W=16; fi; \
             echo \"YUV4MPEG2 W$W H16 F25:1 Cmono\"; for k in 1 2 3 4 5 6 7 8 9 10; do echo FRAME; \
             head -c $((W * 16)) /dev/zero; sleep 0.03; done",
            count.display()
        );
        let mut stream = open(&script, false).unwrap();
        let live = stream.live().unwrap();
        let first = stream.next_packet().unwrap().unwrap().stamp;
        let age = live.clock().unwrap().oldest_s(first);
        assert!((0.0..0.5).contains(&age), "{age}");
        until("no word of the size", || {
            live.trouble().is_some_and(|t| t.contains("32 by 16 now, it was 16 by 16"))
        });
        until("it is not over", || live.trouble().is_none());
        assert!(stream.next_packet().unwrap().unwrap().stamp > first);
        assert!(stream.skipped().iter().any(|l| l.contains("32 by 16")), "{:?}", stream.skipped());
        drop(stream);
        let _ = std::fs::remove_dir_all(folder);
    }

    #[test]
    fn failure_to_open_says_why() {
        let error = open("echo 'rtmp: Connection refused' >&2; exit 1", false).err().unwrap().to_string();
        assert!(error.contains("Connection refused") && error.contains("check the address"), "{error}");
        let error = open("echo 'rtmp: Protocol not found' >&2", true).err().unwrap().to_string();
        assert!(error.contains("not found") && error.contains("install an ffmpeg"), "{error}");
        let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("rtmp-listen://{}/cairn", taken.local_addr().unwrap());
        let address = Address::of(&address).unwrap().unwrap();
        let error = Stream::open(&address, &OpenOptions::default()).err().unwrap().to_string();
        assert!(error.contains("in use") && error.contains("another port"), "{error}");
    }

    #[test]
    fn a_peer_that_sends_no_video_is_refused_once_and_the_sender_after_it_is_taken() {
        let folder = std::env::temp_dir().join(format!("cairn-stray-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let count = folder.join("runs");
        // As ffmpeg ends when a browser or a scanner connects, three times; then the sender comes.
        let script = format!(
            "echo x >> {0}; if [ $(wc -l < {0}) -lt 4 ]; then \
             echo 'Error opening input files: Input/output error' >&2; exit 1; fi; {1}; exec sleep 5",
            count.display(),
            sends(20, 0.05)
        );
        let mut stream = open(&script, true).unwrap();
        stream.next_packet().unwrap().unwrap();
        let refusals = stream.skipped().iter().filter(|l| l.contains("was refused (Error opening")).count();
        assert_eq!(refusals, 1, "{:?}", stream.skipped());
        drop(stream);
        let _ = std::fs::remove_dir_all(folder);
    }

    #[test]
    fn only_delay_beyond_the_usual_counts_as_age() {
        let mut clock = Clock::default();
        let now = Instant::now();
        let (a, _) = clock.stamp(Some(10.0), now, Stamp(0));
        // The stream's time advances little while ours goes on: the image is late.
        std::thread::sleep(Duration::from_millis(60));
        let (b, on_time) = clock.stamp(Some(10.01), now, a);
        assert!((b - a - 0.01).abs() < 1e-6);
        assert!(now - on_time > Duration::from_millis(40), "{:?}", now - on_time);
        // A jump restarts the mapping, and stamps increase all the same.
        let (c, on_time) = clock.stamp(Some(0.0), now, b);
        assert!(c > b && now - on_time < Duration::from_millis(5));
    }
}
