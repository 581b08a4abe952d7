//! One walk in virtual time: a route is recorded, and the walker is guided along it, while things fail.
//!
//! All that happens is an event with a time; the earliest is next, and of two at one time the one that was planned first. Nothing
//! reads a clock, so a scenario is the same walk every time.

use crate::estimator::Estimator;
use crate::page::Sentence;
use crate::person::Person;
use crate::plan::{Happening, Plan};
use crate::rules::{Moment, Rules, Violation};
use crate::scenario::{Fault, Scenario, Shape};
use crate::server::{Server, TICK_S};
use crate::setup::{Camera, Phone, new_session, record, true_plan, way_out};
use crate::spells::Since;
use crate::storage::VirtualDisk;
use crate::time_line::{Line as TimeLine, Lines, What};
use cairn_guide::{Travel, speaking_time};
use cairn_random::Random;
use cairn_sensor::{ClockReading, Stamp};
use cairn_session::{Command, Event, earcon_name};
use cairn_trial::walk::{RouteTruth, STEP_S};
use std::collections::VecDeque;

/// After everything is calm a walk lasts at most so long, seconds.
const CALM_LASTS_S: f64 = 60.0;
/// Whoever has arrived is watched for so long, seconds.
const ARRIVED_S: f64 = 4.0;
/// The walker is at its place for so long before guidance is asked for, seconds.
const STANDS_S: f64 = 2.0;
/// Who has wandered off may be led back to the leg that was left, as long as that is this near, metres: the matcher of the guide waits for
/// five seconds beyond six metres.
const REACH_M: f64 = 9.0;
/// Pictures on their way at one time.
const IN_FLIGHT: usize = 3;

/// What came of a walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The rules that were broken.
    pub violations: Vec<Violation>,
    /// Virtual seconds, recording included.
    pub seconds: f64,
    /// Metres from the end where the guide said that it is reached.
    pub arrived_m: Option<f64>,
    /// Directions that were given.
    pub directions: usize,
    /// Why there was no guidance.
    pub refused: Option<String>,
    /// Of all that happened: equal walks have equal ones.
    pub digest: u64,
}

struct World {
    now: Stamp,
    plan: Plan,
    shape: Shape,
    calm: Stamp,
    estimator: Estimator,
    camera: Camera,
    person: Person,
    server: Server,
    /// `None` where camera and voice are at the server itself.
    phone: Option<Phone>,
    rules: Rules,
    lines: Lines,
    turn: u64,
    commands: Option<Random>,
    /// Commands that the server has not carried out yet.
    asked: VecDeque<Command>,
    is_paused: bool,
    ended: Option<Stamp>,
    directions: usize,
    refused: Option<String>,
}

/// Goes a walk.
pub fn walk(scenario: &Scenario) -> Outcome {
    gone(scenario, Lines::counting()).0
}

/// Goes a walk and keeps what happened.
pub fn watched(scenario: &Scenario) -> (Outcome, Vec<TimeLine>) {
    gone(scenario, Lines::kept())
}

fn gone(scenario: &Scenario, lines: Lines) -> (Outcome, Vec<TimeLine>) {
    let shape = scenario.shape();
    let (poses, ends) = way_out(scenario, &shape);
    let begins = ends.plus_seconds(STANDS_S);
    let calm = begins.plus_seconds(scenario.calm_s);
    let mut estimator = Estimator::new(scenario, shape.facing, begins, calm);
    let disk = VirtualDisk::new(scenario);
    let session = new_session(scenario, &shape, &disk);
    let mut server = Server::new(scenario, session, begins, calm);
    let unsaved = record(&mut server, &mut estimator, &poses, &disk);
    let Some(plan) = server.session.route().and_then(|route| true_plan(route, &shape, estimator.unit_m()))
    else {
        return (Outcome::refused("no route was recorded", ends), Vec::new());
    };
    let start = match shape.travel {
        Travel::Home => poses.last(),
        Travel::Again => poses.first(),
    };
    let at = start.map_or((0.0, 0.0, 0.0), |(walker, _)| *walker);
    let truth = RouteTruth::new(plan, shape.facing, REACH_M);
    let is_phone = scenario.faults.has(Fault::Phone);
    let mut world = World {
        now: ends,
        plan: Plan::default(),
        calm,
        camera: Camera::new(scenario, begins, calm),
        person: Person::new(scenario, at, shape.language, begins, calm),
        phone: is_phone.then(|| Phone::new(scenario, &shape, begins, calm)),
        rules: Rules::new(truth, &shape, is_phone, calm),
        lines,
        turn: 0,
        commands: scenario.faults.has(Fault::Commands).then(|| scenario.random(Fault::Commands as u64)),
        asked: VecDeque::new(),
        is_paused: false,
        ended: None,
        directions: 0,
        refused: None,
        estimator,
        server,
        shape,
    };
    if let Some(how) = unsaved {
        world.rules.lost(how, ends);
    }
    world.go(begins);
    world.finish()
}

impl Outcome {
    fn refused(why: &str, now: Stamp) -> Self {
        Self {
            violations: Vec::new(),
            seconds: now.seconds(),
            arrived_m: None,
            directions: 0,
            refused: Some(why.to_owned()),
            digest: 0,
        }
    }
}

impl World {
    fn go(&mut self, begins: Stamp) {
        let now = self.now;
        self.plan.at(now, Happening::Steps);
        self.plan.at(now, Happening::Picture);
        self.plan.at(now, Happening::Ready(self.turn));
        if self.phone.is_some() {
            self.plan.at(now, Happening::PageLooks);
        }
        let Shape { facing, travel, .. } = self.shape;
        let guide = Command::Guide { facing: Some(facing), again: travel == Travel::Again };
        self.plan.at(begins, Happening::Commands(guide));
        let last = self.calm.plus_seconds(CALM_LASTS_S);
        while let Some((at, what)) = self.plan.next() {
            self.now = at;
            let is_over = self.ended.is_some_and(|ended| at - ended > ARRIVED_S);
            if at > last || is_over || self.refused.is_some() || self.rules.violations().len() > 20 {
                return;
            }
            self.happens(what);
        }
    }

    fn happens(&mut self, what: Happening) {
        let now = self.now;
        match what {
            Happening::Steps => {
                self.person.step(STEP_S, now);
                self.rules.stepped(self.person.pose(), now);
                self.lines.walker(now, self.person.pose(), self.rules.place());
                self.plan.at(now.plus_seconds(STEP_S), Happening::Steps);
            }
            Happening::Picture => self.picture(),
            Happening::Arrives(reading) => {
                self.server.put(*reading, now);
                self.serve_if_ready();
            }
            Happening::Ready(turn) if turn == self.turn => self.serve(),
            Happening::Tick(turn) if turn == self.turn => {
                self.set_clock(now);
                self.server.tick(now);
                self.emit(now);
                self.serve();
            }
            Happening::Ready(_) | Happening::Tick(_) => {}
            Happening::Emits(events, pictured, guiding) => self.emitted(events, pictured, guiding),
            Happening::Words(sentence) => self.words(sentence),
            Happening::Sound(earcon) => {
                self.rules.heard(None, 0.0, now);
                self.lines.said(now, What::Sound, earcon_name(earcon));
            }
            Happening::Status(pictured, guiding) => {
                if let Some(phone) = &mut self.phone {
                    phone.page.status(pictured, guiding, now);
                }
            }
            Happening::PageLooks => self.page_looks(),
            Happening::Late(late) => {
                if let Some(phone) = &mut self.phone {
                    phone.late = late;
                }
            }
            Happening::Commands(command) => {
                self.asked.push_back(command);
                self.serve_if_ready();
            }
            Happening::Acknowledged => {
                if let Some(phone) = &mut self.phone {
                    phone.in_flight = phone.in_flight.saturating_sub(1);
                }
            }
        }
    }

    fn picture(&mut self) {
        let now = self.now;
        let each_s = if now < self.camera.calm { self.camera.each_s } else { 0.1 };
        self.plan.at(now.plus_seconds(each_s), Happening::Picture);
        if self.camera.stops.since(now).is_some() {
            self.lines.state(now, "the camera gives nothing");
            return;
        }
        if self.phone.as_ref().is_some_and(|phone| phone.in_flight >= IN_FLIGHT) {
            return;
        }
        let reading = self.estimator.look(self.person.pose(), now);
        self.lines.view(&reading);
        self.rules.pictured(&reading);
        let arrives = match &mut self.phone {
            None => now.plus_seconds(0.005),
            Some(phone) => {
                phone.in_flight += 1;
                let (there, back) = (phone.up.arrives(now), phone.down.arrives(now));
                phone.round_s = there - now + (back - now);
                self.plan.at(there.max(back), Happening::Acknowledged);
                there
            }
        };
        self.plan.at(arrives, Happening::Arrives(Box::new(reading)));
    }

    /// Sets what the server knows of the clock of the pictures.
    fn set_clock(&mut self, now: Stamp) {
        let reading = match &mut self.phone {
            None => Some(ClockReading { now, bound_s: 0.0, delivery_s: 0.0 }),
            Some(phone) => phone.reading(now),
        };
        self.server.clock.set(reading);
    }

    fn serve_if_ready(&mut self) {
        if self.now >= self.server.ready {
            self.turn += 1;
            self.serve();
        }
    }

    /// The server takes what waits, commands first, or waits itself.
    fn serve(&mut self) {
        let now = self.now;
        while let Some(command) = self.asked.pop_front() {
            self.command(&command);
        }
        let Some((reading, ready)) = self.server.take(now) else {
            self.plan.at(now.plus_seconds(TICK_S), Happening::Tick(self.turn));
            return;
        };
        self.set_clock(ready);
        self.server.show(reading);
        self.emit(ready);
        self.plan.at(ready, Happening::Ready(self.turn));
    }

    /// What the session has to say comes out of the server at a time.
    fn emit(&mut self, at: Stamp) {
        let session = &mut self.server.session;
        let events = session.events();
        let pictured = session.engine().pictured();
        let guiding = session.guide_state().is_some() && !self.is_paused;
        self.plan.at(at, Happening::Emits(events, pictured, guiding));
    }

    fn emitted(&mut self, events: Vec<Event>, pictured: Option<Stamp>, guiding: bool) {
        let now = self.now;
        let walker = self.person.pose();
        let session = &self.server.session;
        let has_arrived = session.has_arrived();
        let state = session.guide_state().filter(|_| guiding);
        let clock = session.now();
        self.rules.server(&Moment { state, is_paused: self.is_paused, has_arrived, walker, clock }, now);
        self.lines.guide(now, state);
        for event in events {
            match event {
                Event::Said(said) => {
                    let place = said.pose.and_then(|_| self.place());
                    self.rules.said(&said, walker, place.map(|(along_m, _)| along_m), now);
                    self.directions += usize::from(said.pose.is_some());
                    let taken =
                        place.map_or(String::new(), |(m, left)| format!(" [{m:.1} m, {left:.1} left]"));
                    self.lines.said(now, What::Sent, &format!("{}{taken}", said.text));
                    let sentence = Sentence::of(&said);
                    match &mut self.phone {
                        None => self.hear(&sentence, said.duration_s),
                        Some(phone) => {
                            let at = phone.down.arrives(now);
                            self.plan.at(at, Happening::Words(sentence));
                        }
                    }
                }
                Event::Sound(sound) => {
                    let at = self.phone.as_mut().map_or(now, |phone| phone.down.arrives(now));
                    self.plan.at(at, Happening::Sound(sound.earcon));
                }
            }
        }
        if let Some(phone) = &mut self.phone {
            let at = phone.down.arrives(now);
            self.plan.at(at, Happening::Status(pictured, guiding));
        }
        let session = &self.server.session;
        let has_ended = has_arrived || session.guide_state().is_none() && self.directions > 0;
        self.ended = if has_ended { self.ended.or(Some(now)) } else { None };
    }

    /// Where the guide takes the walker to be on the route: metres along it and to its left.
    fn place(&self) -> Option<(f64, f64)> {
        let status = self.server.session.status();
        status.guiding.filter(|_| status.metric).map(|guiding| (guiding.along_m, guiding.cross_m))
    }

    fn words(&mut self, sentence: Sentence) {
        let Some(phone) = &mut self.phone else { return };
        if phone.page.said(sentence, self.now) {
            let at = phone.up.arrives(self.now);
            self.plan.at(at, Happening::Late(true));
        }
        self.speak();
    }

    fn page_looks(&mut self) {
        let Some(phone) = &mut self.phone else { return };
        if let Some(late) = phone.page.look(self.now) {
            let at = phone.up.arrives(self.now);
            self.plan.at(at, Happening::Late(late));
        }
        self.plan.at(self.now.plus_seconds(0.1), Happening::PageLooks);
        self.speak();
    }

    fn speak(&mut self) {
        let begun = self.phone.as_mut().map_or_else(Vec::new, |phone| phone.page.begun());
        for sentence in begun {
            let duration_s = speaking_time(&sentence.text, 1.0);
            self.hear(&sentence, duration_s);
        }
    }

    fn hear(&mut self, sentence: &Sentence, duration_s: f64) {
        self.rules.heard(sentence.pose, duration_s, self.now);
        self.lines.said(self.now, What::Heard, &sentence.text);
        self.person.hear(&sentence.text, self.now);
    }

    fn command(&mut self, command: &Command) {
        let now = self.now;
        self.set_clock(now);
        let done = self.server.session.command(command);
        self.lines.said(now, What::Asked, &format!("{command:?}"));
        self.rules.commanded(now);
        if done.is_ok() {
            self.is_paused = match command {
                Command::Pause => true,
                Command::Resume => false,
                _ => self.is_paused,
            };
        }
        if let (Command::Guide { .. }, Err(why)) = (command, &done) {
            self.refused = Some(why.words.clone());
        }
        self.emit(now);
        let Some(random) = &mut self.commands else { return };
        let wait_s = random.uniform(4.0, 25.0);
        let next = match (command, random.below(4)) {
            (Command::Pause, _) => Command::Resume,
            (_, 0) => Command::Pause,
            (_, 1) => Command::Repeat,
            _ => Command::Status,
        };
        let at = now.plus_seconds(if next == Command::Resume { 0.3 * wait_s } else { wait_s });
        // Nobody is left paused.
        if at < self.calm || next == Command::Resume {
            self.plan.at(at.min(self.calm), Happening::Commands(next));
        }
    }

    fn finish(self) -> (Outcome, Vec<TimeLine>) {
        let arrived_m = self.rules.arrived_m();
        let violations = self.rules.finish();
        let (digest, lines) = self.lines.finish(&violations);
        let outcome = Outcome {
            violations,
            seconds: self.now.seconds(),
            arrived_m,
            directions: self.directions,
            refused: self.refused,
            digest,
        };
        (outcome, lines)
    }
}
