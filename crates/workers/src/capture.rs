//! The capture process: reads the source and puts its frames into the ring.

use crate::message::{Failure, Frame, LeftOut, Opened, Order, Report, first_order, read, write};
use crate::{pixels, ring::Ring};
use cairn_sensor::{FramePacket, Rig, Skips, Source, SourceError, SourceInfo, Stamp};
use cairn_sources::Paced;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// Frames that the ring keeps: those that arrive while SLAM is being restarted, and more.
pub const SLOTS: u32 = 32;

/// What capture is told at its beginning.
struct Begin {
    ring: std::path::PathBuf,
    next: u64,
    delivered: Option<Delivered>,
    until: u64,
}

/// What a capture process before this one has delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delivered {
    /// The stamp of its first frame.
    pub first: Stamp,
    /// The stamp of its last frame.
    pub last: Stamp,
    /// How many frames.
    pub frames: u64,
}

/// Runs until the source has ended or the supervisor is gone. `open` opens the source and says which sensors are used, as
/// on the command line; its argument is what a process before has delivered, which the source should leave out ([`rest_of`]).
/// A recording is played in real time where `is_realtime` says so: frames that are overtaken are left out, and counted.
pub fn run<F>(
    mut from: impl Read + Send + 'static,
    mut to: impl Write + Send + 'static,
    is_realtime: bool,
    open: F,
) where
    F: FnOnce(Option<Delivered>) -> Result<(Box<dyn Source>, String), Failure>,
{
    let Some(Order::Capture { ring, next, delivered, until }) = first_order(&mut from, &mut to) else {
        return;
    };
    let delivered =
        delivered.map(|(first, last)| Delivered { first: Stamp(first), last: Stamp(last), frames: next });
    let begin = Begin { ring, next, delivered, until };
    let to = Arc::new(Mutex::new(to));
    let (credits, credit) = channel();
    let pings = to.clone();
    let listen = move || {
        // Pings are answered here, since the source may wait long for a packet.
        while let Ok(Some(order)) = read(&mut from) {
            let goes_on = match order {
                Order::Credit(until) => credits.send(until).is_ok(),
                Order::Ping => say(&pings, &Report::Pong),
                _ => false,
            };
            if !goes_on {
                return;
            }
        }
    };
    let said = match std::thread::Builder::new().name("cairn-orders".into()).spawn(listen) {
        Ok(_) => deliver(&begin, &credit, &to, is_realtime, open),
        Err(e) => Err(Failure::new("capture", e, "close other programs and try again")),
    };
    if let Err(why) = said {
        say(&to, &Report::Failed(why));
    }
}

/// `Ok` when the supervisor is gone or all is delivered.
fn deliver<F>(
    begin: &Begin,
    credit: &Receiver<u64>,
    to: &Mutex<impl Write>,
    is_realtime: bool,
    open: F,
) -> Result<(), Failure>
where
    F: FnOnce(Option<Delivered>) -> Result<(Box<dyn Source>, String), Failure>,
{
    let (source, sensor) = open(begin.delivered)?;
    let mut source = if is_realtime { Box::new(Paced::new(source)) } else { source };
    let (info, rig) = (source.info(), source.rig());
    let opened = Opened {
        name: info.name.clone(),
        frames: info.frames,
        rate_hz: info.rate_hz,
        rig: cairn_sources::write_rig(rig)?,
        sensor,
    };
    let ring = shared(&begin.ring, pixels::slot_bytes(rig))?;
    if !say(to, &Report::Opened(opened)) {
        return Ok(());
    }
    let (mut number, mut until, mut told) = (begin.next, begin.until, LeftOut::default());
    while let Some(packet) = source.next_packet()? {
        until = credit.try_iter().fold(until, u64::max);
        while number >= until {
            let Ok(further) = credit.recv() else { return Ok(()) };
            until = until.max(further);
        }
        let written = pixels::pieces(&packet, |pieces| ring.write(number, pieces));
        written.map_err(|e| Failure::new("capture", e, "run without --isolated"))?;
        if !tell_left_out(to, &*source, &mut told) || !say(to, &Report::Frame(Frame::of(number, &packet))) {
            return Ok(());
        }
        number += 1;
    }
    if !tell_left_out(to, &*source, &mut told) || !say(to, &Report::SourceEnded) {
        return Ok(());
    }
    // Until the supervisor is gone: an end before it would count as a death.
    while credit.recv().is_ok() {}
    Ok(())
}

/// Tells what was left out, where that is more than was told; false when the supervisor is gone.
fn tell_left_out(to: &Mutex<impl Write>, source: &dyn Source, told: &mut LeftOut) -> bool {
    let now = LeftOut::of(&source.skips(), source.dropped());
    if now == *told {
        return true;
    }
    *told = now.clone();
    say(to, &Report::LeftOut(now))
}

/// False when the supervisor is gone.
fn say(to: &Mutex<impl Write>, report: &Report) -> bool {
    write(&mut *to.lock().unwrap_or_else(PoisonError::into_inner), report).is_ok()
}

/// The packets of a source after those that were delivered.
///
/// # Errors
/// The source's error.
pub fn rest_of(mut source: Box<dyn Source>, delivered: &Delivered) -> Result<Box<dyn Source>, Failure> {
    while let Some(packet) = source.next_packet()? {
        if packet.stamp > delivered.last {
            let before = (source.skipped().len(), source.skips());
            return Ok(Box::new(Resumed { first: Some(packet), source, before }));
        }
    }
    Ok(source)
}

/// A source with a packet that was read before. What was left out until then was told by an earlier process.
struct Resumed {
    first: Option<FramePacket>,
    source: Box<dyn Source>,
    before: (usize, Skips),
}

impl Source for Resumed {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn rig(&self) -> &Rig {
        self.source.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        self.first.take().map_or_else(|| self.source.next_packet(), |packet| Ok(Some(packet)))
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped().get(self.before.0..).unwrap_or_default()
    }

    fn skips(&self) -> Skips {
        self.source.skips().since(&self.before.1)
    }
}

/// The ring of a run: made by its first capture process, opened by those after it.
fn shared(path: &Path, slot_bytes: u64) -> Result<Ring, Failure> {
    let ring = if path.exists() { Ring::open(path) } else { Ring::create(path, SLOTS, slot_bytes) };
    ring.map_err(|e| {
        Failure::new("the shared frames", e, "free some shared memory, or run without --isolated")
    })
}
