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

/// What gives a session its packets, and when.
pub enum Clock<'a> {
    /// Every packet of a source in order, as soon as the one before is done; time is the packets' own.
    Packets(&'a mut dyn Source),
    /// Every packet that a source gives in its own time, one after the other, and ticks of a wall clock while one is waited for: a
    /// recording that a loaded machine or a slow disk does not give says so in the status.
    Paced(&'a mut dyn Source),
    /// The newest packet whenever there is one, and ticks of a wall clock while there is none.
    Wall(&'a Inbox),
}

/// Drives a session until its source ends or a quit command comes.
///
/// # Errors
/// The source's error; with a paced one also that no thread can be started to read it.
pub fn drive<S: Slam>(
    session: &mut Session<S>,
    clock: Clock,
    script: &mut Script,
    observer: &mut dyn Observer<S>,
) -> Result<Ended, SourceError> {
    match clock {
        Clock::Packets(source) => each(session, script, observer, |_| item(source.next_packet())),
        Clock::Paced(source) => paced(session, source, script, observer),
        Clock::Wall(inbox) => {
            // Where the time of capture is not known, the age is judged from the time of arrival: the capture was no later.
            let arrivals = Arc::new(Arrivals::default());
            session.follow(inbox.live().unwrap_or_else(|| arrivals.clone()));
            each(session, script, observer, |session| next(session, inbox, &arrivals))
        }
    }
}

/// Does with each item what is to be done, until there are no more.
fn each<S: Slam>(
    session: &mut Session<S>,
    script: &mut Script,
    observer: &mut dyn Observer<S>,
    mut next: impl FnMut(&mut Session<S>) -> Item,
) -> Result<Ended, SourceError> {
    loop {
        let mut commands = Vec::new();
        match next(session) {
            Item::Packet(packet, _) => {
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

fn item(read: Result<Option<FramePacket>, SourceError>) -> Item {
    match read {
        Ok(Some(packet)) => Item::Packet(packet, Instant::now()),
        Ok(None) => Item::Ended(Ok(())),
        Err(e) => Item::Ended(Err(e)),
    }
}

/// The packets of a source that is read on a thread of its own, one when it is asked for; the session ticks until it comes.
fn paced<S: Slam>(
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
        let mut is_asked = false;
        each(session, script, observer, |session| {
            if !std::mem::replace(&mut is_asked, true) && ask.send(()).is_err() {
                return Item::Ended(Ok(()));
            }
            match given.recv_timeout(TICK) {
                Err(RecvTimeoutError::Timeout) => {
                    arrivals.now().into_iter().for_each(|now| session.tick(now));
                    Item::Nothing
                }
                Err(RecvTimeoutError::Disconnected) => Item::Ended(Ok(())),
                Ok(read) => {
                    is_asked = false;
                    let item = item(read);
                    if let Item::Packet(packet, at) = &item {
                        arrivals.put(packet.stamp, *at);
                    }
                    item
                }
            }
        })
    })
}

/// What a live source gives next; the session ticks while that is no packet.
fn next<S: Slam>(session: &mut Session<S>, inbox: &Inbox, arrivals: &Arrivals) -> Item {
    let item = inbox.take(TICK);
    match &item {
        Item::Packet(packet, put) => arrivals.put(packet.stamp, *put),
        _ => arrivals.now().into_iter().for_each(|now| session.tick(now)),
    }
    item
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
