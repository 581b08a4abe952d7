//! Drives a session: from a recording frame by frame, or from a live source with a wall clock.

use crate::command::Command;
use crate::event::Event;
use crate::inbox::{Inbox, Item};
use crate::refused::Refused;
use crate::script::Script;
use crate::session::Session;
use crate::slam::{NotTracked, Slam};
use cairn_engine::{Engine, Output};
use cairn_sensor::{ClockReading, FramePacket, Live, Source, SourceError, Stamp};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Interval of the ticks while no packet arrives.
const TICK: Duration = Duration::from_millis(50);

/// The output side of a session: a terminal, the page, a voice.
pub trait Observer<S = Engine> {
    /// An utterance or an earcon starts now.
    fn on_event(&mut self, _session: &Session<S>, _event: &Event) {}
    /// A packet was processed; `Err` gives the reason why it was rejected.
    fn on_output(
        &mut self,
        _session: &Session<S>,
        _packet: &FramePacket,
        _output: &Result<Output, NotTracked>,
    ) {
    }
    /// A command was carried out, or the reason why it was not.
    fn on_command(&mut self, _session: &Session<S>, _command: &Command, _done: &Result<String, Refused>) {}
    /// Called after every packet and about twenty times a second.
    fn on_step(&mut self, _session: &mut Session<S>) {}
    /// Commands that have arrived meanwhile, for callers that drive without an inbox.
    fn take_commands(&mut self) -> Vec<Command> {
        Vec::new()
    }
}

/// Why driving ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The source has ended.
    Source,
    /// A quit command.
    Requested,
}

/// Processes every packet of a source in order; time is the packets' own.
///
/// # Errors
/// The source's error.
pub fn drive_lockstep<S: Slam>(
    session: &mut Session<S>,
    source: &mut dyn Source,
    script: &mut Script,
    observer: &mut dyn Observer<S>,
) -> Result<Ended, SourceError> {
    while let Some(packet) = source.next_packet()? {
        if step(session, &packet, script, observer) {
            return Ok(Ended::Requested);
        }
    }
    Ok(Ended::Source)
}

/// Processes every packet that a source gives in its own time, one after the other, and ticks while one is waited for: a
/// recording that a loaded machine or a slow disk does not give says so in the status.
///
/// # Errors
/// The source's error, or that no thread can be started to read it.
pub fn drive_paced<S: Slam>(
    session: &mut Session<S>,
    source: &mut dyn Source,
    script: &mut Script,
    observer: &mut dyn Observer<S>,
) -> Result<Ended, SourceError> {
    let name = source.info().name.clone();
    let arrivals = Arrivals::default();
    std::thread::scope(|scope| {
        let ((ask, asked), (give, given)) = (channel::<()>(), channel());
        let read = move || {
            while asked.recv().is_ok() {
                if give.send(source.next_packet()).is_err() {
                    return;
                }
            }
        };
        let reader = std::thread::Builder::new().name("cairn-paced".into()).spawn_scoped(scope, read);
        reader.map_err(|e| {
            SourceError::new(&name, format!("no thread to read it ({e})"), "close other programs")
        })?;
        while ask.send(()).is_ok() {
            let next = loop {
                match given.recv_timeout(TICK) {
                    Err(RecvTimeoutError::Timeout) => {}
                    next => break next,
                }
                if let Some(now) = arrivals.now() {
                    session.tick(now);
                }
                let commands = observer.take_commands();
                if carry_out(session, &commands, observer) {
                    return Ok(Ended::Requested);
                }
                after(session, observer);
            };
            let Some(packet) = next.unwrap_or(Ok(None))? else { break };
            arrivals.put(packet.stamp, Instant::now());
            if step(session, &packet, script, observer) {
                return Ok(Ended::Requested);
            }
        }
        Ok(Ended::Source)
    })
}

/// Processes the newest packet whenever there is one, and ticks while there is none. Ends with the source, or on a
/// quit command.
///
/// # Errors
/// The source's error.
pub fn drive_live<S: Slam>(
    session: &mut Session<S>,
    inbox: &Inbox,
    script: &mut Script,
    observer: &mut dyn Observer<S>,
) -> Result<Ended, SourceError> {
    let arrivals = Arc::new(Arrivals::default());
    // Where the time of capture is not known, the age is judged from the time of arrival: the capture was no later.
    session.follow(inbox.live().unwrap_or_else(|| arrivals.clone()));
    loop {
        let mut commands = Vec::new();
        let item = inbox.take(TICK);
        if let (false, Some(now)) = (matches!(item, Item::Packet(..)), arrivals.now()) {
            session.tick(now);
        }
        match item {
            Item::Packet(packet, put) => {
                arrivals.put(packet.stamp, put);
                let output = session.on_packet(&packet);
                observer.on_output(session, &packet, &output);
            }
            Item::Command(command) => commands.push(command),
            Item::Ended(result) => return result.map(|()| Ended::Source),
            Item::Nothing => {}
        }
        commands.extend(script.due(session));
        commands.extend(observer.take_commands());
        if carry_out(session, &commands, observer) {
            return Ok(Ended::Requested);
        }
        after(session, observer);
    }
}

/// The source's clock, estimated from the arrival of its packets.
#[derive(Default)]
struct Arrivals(Mutex<Option<(Stamp, Instant)>>);

impl Arrivals {
    fn put(&self, stamp: Stamp, at: Instant) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((stamp, at));
    }

    fn now(&self) -> Option<Stamp> {
        let (stamp, at) = (*self.0.lock().unwrap_or_else(PoisonError::into_inner))?;
        Some(stamp.plus_seconds(at.elapsed().as_secs_f64()))
    }
}

impl Live for Arrivals {
    fn clock(&self) -> Option<ClockReading> {
        self.now().map(|now| ClockReading { now, bound_s: 0.0, delivery_s: 0.0 })
    }
}

/// Processes a packet and what was asked meanwhile; true when that was quit.
fn step<S: Slam>(
    session: &mut Session<S>,
    packet: &FramePacket,
    script: &mut Script,
    observer: &mut dyn Observer<S>,
) -> bool {
    let output = session.on_packet(packet);
    observer.on_output(session, packet, &output);
    let mut commands = script.due(session);
    commands.extend(observer.take_commands());
    let quits = carry_out(session, &commands, observer);
    if !quits {
        after(session, observer);
    }
    quits
}

/// Carries out the commands; true when one of them was quit.
fn carry_out<S: Slam>(
    session: &mut Session<S>,
    commands: &[Command],
    observer: &mut dyn Observer<S>,
) -> bool {
    for command in commands {
        let done = session.command(command);
        observer.on_command(session, command, &done);
        if *command == Command::Quit {
            after(session, observer);
            return true;
        }
    }
    false
}

fn after<S: Slam>(session: &mut Session<S>, observer: &mut dyn Observer<S>) {
    for event in session.events() {
        observer.on_event(session, &event);
    }
    observer.on_step(session);
}
