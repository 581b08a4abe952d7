//! The inbox of the session's thread: the newest packet, all commands, the end of the source.

use crate::command::Command;
use cairn_sensor::{FramePacket, ImuSample, Live, Source, SourceError};
use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A packet that waited longer than this is dropped when a newer one may follow.
const TOO_OLD: Duration = Duration::from_millis(150);
/// But one is taken at least so often, however long it waited: beside load all of them do.
const AT_LEAST: Duration = Duration::from_millis(200);

/// What [`Inbox::take`] returns.
pub enum Item {
    /// The newest packet, and when it arrived.
    Packet(FramePacket, Instant),
    /// A command.
    Command(Command),
    /// The source has ended, or failed.
    Ended(Result<(), SourceError>),
    /// Nothing arrived within the time limit.
    Nothing,
}

#[derive(Default)]
struct State {
    packet: Option<(FramePacket, Instant)>,
    /// Inertial samples of packets that were dropped.
    orphans: Vec<ImuSample>,
    commands: VecDeque<Command>,
    ended: Option<Result<(), SourceError>>,
    closed: bool,
    dropped: usize,
    /// When a packet was taken last.
    taken: Option<Instant>,
    live: Option<Arc<dyn Live>>,
}

/// One slot for the newest packet and a queue for commands. A newer packet replaces one still waiting; the inertial
/// samples of dropped packets are kept.
#[derive(Default)]
pub struct Inbox {
    state: Mutex<State>,
    changed: Condvar,
}

impl Inbox {
    /// An empty inbox.
    pub fn new() -> Arc<Self> {
        Arc::default()
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a packet; false when the inbox is closed.
    pub fn put(&self, mut packet: FramePacket) -> bool {
        let mut s = self.lock();
        if let Some((overtaken, _)) = s.packet.take() {
            s.orphans.extend(overtaken.imu);
            s.dropped += 1;
        }
        if !s.orphans.is_empty() {
            let mut imu = std::mem::take(&mut s.orphans);
            imu.append(&mut packet.imu);
            packet.imu = imu;
        }
        s.packet = Some((packet, Instant::now()));
        self.changed.notify_all();
        !s.closed
    }

    /// Puts a command.
    pub fn command(&self, command: Command) {
        self.lock().commands.push_back(command);
        self.changed.notify_all();
    }

    /// The source has ended.
    pub fn end(&self, result: Result<(), SourceError>) {
        self.lock().ended = Some(result);
        self.changed.notify_all();
    }

    /// Closes the inbox: nothing more is taken from it.
    pub fn close(&self) {
        self.lock().closed = true;
    }

    /// What the source feeding it reports about itself, if it is live.
    pub fn live(&self) -> Option<Arc<dyn Live>> {
        self.lock().live.clone()
    }

    /// How many packets were replaced or too old.
    pub fn dropped(&self) -> usize {
        self.lock().dropped
    }

    /// The next item by importance: commands, the newest packet, the end; waits at most `limit`.
    pub fn take(&self, limit: Duration) -> Item {
        let until = Instant::now() + limit;
        let mut s = self.lock();
        loop {
            if let Some(command) = s.commands.pop_front() {
                return Item::Command(command);
            }
            if let Some((packet, put)) = s.packet.take() {
                let is_due = s.taken.is_some_and(|at| at.elapsed() >= AT_LEAST);
                if put.elapsed() <= TOO_OLD || is_due || s.ended.is_some() {
                    s.taken = Some(Instant::now());
                    return Item::Packet(packet, put);
                }
                s.orphans.extend(packet.imu);
                s.dropped += 1;
            }
            if let Some(result) = s.ended.take() {
                return Item::Ended(result);
            }
            let Some(left) = until.checked_duration_since(Instant::now()).filter(|d| !d.is_zero()) else {
                return Item::Nothing;
            };
            s = self.changed.wait_timeout(s, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// Reads a source on a thread of its own and puts its packets. The thread ends with the source, or with the first
/// packet after the inbox was closed.
///
/// # Errors
/// The system's error, when the thread cannot be started.
pub fn feed(mut source: Box<dyn Source>, inbox: Arc<Inbox>) -> io::Result<()> {
    inbox.lock().live = source.live();
    let work = move || {
        let result = loop {
            match source.next_packet() {
                Ok(Some(packet)) => {
                    if !inbox.put(packet) {
                        break Ok(());
                    }
                }
                Ok(None) => break Ok(()),
                Err(e) => break Err(e),
            }
        };
        // Closed before the end is reported, so that a waiting caller knows that a child process has ended.
        drop(source);
        inbox.end(result);
    };
    std::thread::Builder::new().name("cairn-feed".into()).spawn(work).map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec3;
    use cairn_sensor::Stamp;

    fn packet(n: i64) -> FramePacket {
        let imu = vec![ImuSample::new(Stamp(n), Vec3::zeros(), Vec3::zeros())];
        FramePacket { stamp: Stamp(n), images: Vec::new(), depth: None, imu, decode_ms: 0.0 }
    }

    #[test]
    fn newest_packet_replaces_older_and_keeps_imu_samples() {
        let inbox = Inbox::new();
        (1..=3).for_each(|n| assert!(inbox.put(packet(n))));
        inbox.command(Command::Stop);
        assert!(matches!(inbox.take(Duration::ZERO), Item::Command(Command::Stop)));
        let Item::Packet(p, _) = inbox.take(Duration::ZERO) else { panic!("no packet") };
        assert_eq!((p.stamp, p.imu.len(), inbox.dropped()), (Stamp(3), 3, 2));
        assert!(matches!(inbox.take(Duration::from_millis(5)), Item::Nothing));
        inbox.end(Ok(()));
        assert!(matches!(inbox.take(Duration::ZERO), Item::Ended(Ok(()))));
        inbox.close();
        assert!(!inbox.put(packet(6)));
    }

    #[test]
    fn a_packet_that_waited_too_long_is_dropped_unless_none_was_taken_for_200_ms() {
        let inbox = Inbox::new();
        inbox.put(packet(1));
        std::thread::sleep(TOO_OLD + Duration::from_millis(20));
        assert!(matches!(inbox.take(Duration::ZERO), Item::Nothing));
        // Its samples come with the next one.
        inbox.put(packet(2));
        let Item::Packet(p, _) = inbox.take(Duration::ZERO) else { panic!("no packet") };
        assert_eq!((p.stamp, p.imu.len(), inbox.dropped()), (Stamp(2), 2, 1));
        // Beside load each step takes so long that every packet waits.
        for n in 3..6 {
            inbox.put(packet(n));
            std::thread::sleep(AT_LEAST + Duration::from_millis(20));
            assert!(matches!(inbox.take(Duration::ZERO), Item::Packet(p, _) if p.stamp == Stamp(n)), "{n}");
        }
        assert_eq!(inbox.dropped(), 1);
    }
}
