//! Reads any source ahead on a thread, through a bounded queue.

use crate::Cancel;
use cairn_sensor::{FramePacket, Rig, Skips, Source, SourceError, SourceInfo};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Packets decoded ahead of the reader: 6 MB of EuRoC stereo.
const QUEUE: usize = 8;
/// How often a wait looks whether it was cancelled.
const LOOK: Duration = Duration::from_millis(50);
/// How long a cancelled reading thread may take to end before it is left alone.
const LEAVE_AFTER: Duration = Duration::from_millis(300);

/// A source whose packets are produced on a separate thread, at most [`QUEUE`] ahead.
pub struct Prefetch {
    info: SourceInfo,
    rig: Rig,
    skipped: Vec<String>,
    skips: Skips,
    cancel: Cancel,
    packets: Option<Receiver<Step>>,
    reader: Option<JoinHandle<()>>,
}

/// One result of the source, and the lines it added to what it skipped: how many of the previous lines
/// remain, and the new ones.
struct Step {
    result: Result<Option<FramePacket>, SourceError>,
    kept: usize,
    skipped: Vec<String>,
    /// The counts, where they have changed.
    skips: Option<Skips>,
}

impl Prefetch {
    /// Starts reading.
    ///
    /// # Errors
    ///
    /// [`SourceError`] when no thread can be started.
    pub fn start(source: impl Source + 'static) -> Result<Self, SourceError> {
        let (info, rig) = (source.info().clone(), source.rig().clone());
        let (skipped, skips) = (source.skipped().to_vec(), source.skips());
        let (sender, receiver) = sync_channel(QUEUE);
        let thread = std::thread::Builder::new().name("cairn-reader".into());
        let reader = thread.spawn(move || read(source, &sender)).map_err(|e| {
            SourceError::new(&info.name, format!("no thread to read it ({e})"), "close other programs")
        })?;
        let cancel = Cancel::default();
        Ok(Self { info, rig, skipped, skips, cancel, packets: Some(receiver), reader: Some(reader) })
    }

    /// Once cancelled, the source is at its end, even where a disk or a network does not answer.
    pub fn cancelled_by(mut self, cancel: Cancel) -> Self {
        self.cancel = cancel;
        self
    }
}

/// The reading thread: runs until the source ends or fails, or the receiver is dropped.
fn read(mut source: impl Source, sender: &SyncSender<Step>) {
    let mut last_line: Vec<String> = source.skipped().last().cloned().into_iter().collect();
    let mut count = source.skipped().len();
    let mut counted = source.skips().total();
    loop {
        let result = source.next_packet();
        let lines = source.skipped();
        // The last line may be a running count: send it again when it has changed.
        let kept = match (count, last_line.last()) {
            (0, _) => 0,
            (n, last) if lines.get(n - 1) == last => n,
            (n, _) => n - 1,
        };
        let skipped = lines.get(kept..).unwrap_or_default().to_vec();
        count = lines.len();
        let skips = Some(source.skips()).filter(|skips| skips.total() != counted);
        counted = skips.as_ref().map_or(counted, Skips::total);
        last_line = source.skipped().last().cloned().into_iter().collect();
        let more = matches!(result, Ok(Some(_)));
        if sender.send(Step { result, kept, skipped, skips }).is_err() || !more {
            return;
        }
    }
}

impl Source for Prefetch {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some(packets) = &self.packets else { return Ok(None) };
        let step = loop {
            match packets.recv_timeout(LOOK) {
                Err(RecvTimeoutError::Timeout) if self.cancel.is_cancelled() => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break None,
                Ok(step) => break Some(step),
            }
        };
        if let Some(step) = step {
            self.skips = step.skips.unwrap_or_else(|| std::mem::take(&mut self.skips));
            self.skipped.truncate(step.kept);
            self.skipped.extend(step.skipped);
            if !matches!(step.result, Ok(Some(_))) {
                self.packets = None;
            }
            return step.result;
        }
        // The queue closed without an end: the thread has failed.
        self.packets = None;
        Err(SourceError::new(&self.info.name, "the reading thread failed", "report it with the recording"))
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn skips(&self) -> Skips {
        self.skips.clone()
    }
}

impl Drop for Prefetch {
    /// Closes the queue, which ends the thread after its current packet. One that was cancelled while its disk does
    /// not answer is left to the end of the process.
    fn drop(&mut self) {
        self.packets = None;
        let since = Instant::now();
        while self.cancel.is_cancelled() && self.reader.as_ref().is_some_and(|reader| !reader.is_finished()) {
            if since.elapsed() > LEAVE_AFTER {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        if let Some(reader) = self.reader.take() {
            // A panic there was already reported on standard error.
            let _ = reader.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sensor::{Camera, Stamp};

    /// Delivers `packets` packets, with a skipped line before each, then the result of `end`.
    struct Fake {
        info: SourceInfo,
        rig: Rig,
        skipped: Vec<String>,
        packets: usize,
        end: fn() -> Result<Option<FramePacket>, SourceError>,
    }

    impl Fake {
        fn new(packets: usize, end: fn() -> Result<Option<FramePacket>, SourceError>) -> Self {
            let info = SourceInfo {
                name: "fake".into(),
                frames: None,
                rate_hz: 1.0,
                truth: Vec::new(),
                assumed: None,
            };
            let rig = Rig::mono(Camera::pinhole(2, 2, 1.0, 1.0, 0.5, 0.5));
            Self { info, rig, skipped: vec!["at the start".into()], packets, end }
        }
    }

    impl Source for Fake {
        fn info(&self) -> &SourceInfo {
            &self.info
        }
        fn rig(&self) -> &Rig {
            &self.rig
        }
        fn skipped(&self) -> &[String] {
            &self.skipped
        }
        fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
            if self.packets == 0 {
                return (self.end)();
            }
            self.packets -= 1;
            self.skipped.push(format!("before {}", self.packets));
            if self.packets == 0 {
                // A running count replaces the last line.
                *self.skipped.last_mut().unwrap() = "and 1 more".into();
            }
            let stamp = Stamp(self.packets as i64);
            Ok(Some(FramePacket { stamp, images: Vec::new(), depth: None, imu: Vec::new(), decode_ms: 0.0 }))
        }
    }

    #[test]
    fn delivers_packets_and_skipped_lines_in_step() {
        let mut ahead = Prefetch::start(Fake::new(30, || Ok(None))).unwrap();
        assert_eq!(ahead.skipped(), ["at the start"]);
        for i in 1..=30 {
            assert_eq!(ahead.next_packet().unwrap().unwrap().stamp, Stamp(30 - i as i64));
            assert_eq!(ahead.skipped().len(), 1 + i);
        }
        assert_eq!(ahead.skipped()[30], "and 1 more");
        assert!(ahead.next_packet().unwrap().is_none() && ahead.next_packet().unwrap().is_none());
    }

    #[test]
    fn failures_and_panics_become_errors() {
        let mut ahead = Prefetch::start(Fake::new(1, || Err(SourceError::new("a", "b", "c")))).unwrap();
        assert!(ahead.next_packet().unwrap().is_some());
        assert_eq!(ahead.next_packet().unwrap_err().to_string(), "a: b; c");
        assert!(ahead.next_packet().unwrap().is_none());
        let mut ahead = Prefetch::start(Fake::new(1, || panic!("on purpose"))).unwrap();
        assert!(ahead.next_packet().unwrap().is_some());
        assert!(ahead.next_packet().unwrap_err().to_string().contains("the reading thread failed"));
        assert!(ahead.next_packet().unwrap().is_none());
    }
}
