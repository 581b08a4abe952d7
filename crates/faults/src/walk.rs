//! One walk in virtual time: a route is recorded, and the walker is guided along it, while things fail.
//!
//! All that happens is an event with a time; the earliest is next, and of two at one time the one that was planned first. Nothing
//! reads a clock, so a scenario is the same walk every time.

use crate::estimator::{Estimator, Reading};
use crate::modelled::Modelled;
use crate::network::Line;
use crate::page::{Page, Sentence};
use crate::person::Person;
use crate::rules::{Moment, Rules, Violation};
use crate::scenario::{Fault, Scenario, Shape};
use crate::server::{Server, TICK_S};
use crate::spells::{Since, Spells};
use crate::storage::VirtualDisk;
use crate::time_line::{Line as TimeLine, Lines, What};
use cairn_geometry::Se3;
use cairn_guide::{
    CleanConfig, Earcon, Ground, ManeuverPlan, ManeuverPlanConfig, PhraseConfig, PlacedPoint, Route, Travel,
    clean, speaking_time,
};
use cairn_random::Random;
use cairn_sensor::{ClockReading, Stamp};
use cairn_session::{Command, Event, Session, SessionConfig, earcon_name};
use cairn_trial::walk::{RouteTruth, STEP_S, walked_poses};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::path::{Path, PathBuf};

/// After everything is calm a walk lasts at most so long, seconds.
const CALM_LASTS_S: f64 = 60.0;
/// Whoever has arrived is watched for so long, seconds.
const ARRIVED_S: f64 = 4.0;
/// The walker is at its place for so long before guidance is asked for, seconds.
const STANDS_S: f64 = 2.0;
/// What the way of the words is taken to be longer while the page finds them late, seconds (`sources::live::phone_port`).
const LATE_S: f64 = 1.0;
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

/// What happens.
enum Happening {
    /// The walker goes on.
    Steps,
    /// The camera takes a picture.
    Picture,
    /// A picture has reached the server.
    Arrives(Box<Reading>),
    /// The server has time; the number says whether the plan still holds.
    Ready(u64),
    /// The server has had no picture for a while.
    Tick(u64),
    /// What the server had to say has come out of it.
    Emits(Vec<Event>, Option<Stamp>, bool),
    /// Words and sounds reach the phone.
    Words(Sentence),
    Sound(Earcon),
    Status(Option<Stamp>, bool),
    /// The phone looks round, each tenth of a second.
    PageLooks,
    /// The server hears whether words come late.
    Late(bool),
    /// A command of the walker.
    Commands(Command),
    /// A picture was acknowledged.
    Acknowledged,
}

struct Planned {
    at: Stamp,
    number: u64,
    what: Happening,
}

impl PartialEq for Planned {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number
    }
}

impl Eq for Planned {}

impl PartialOrd for Planned {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Planned {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.at, self.number).cmp(&(other.at, other.number))
    }
}

/// What is planned, in the order of time.
#[derive(Default)]
struct Plan {
    queue: BinaryHeap<Reverse<Planned>>,
    number: u64,
}

impl Plan {
    fn at(&mut self, at: Stamp, what: Happening) {
        self.number += 1;
        self.queue.push(Reverse(Planned { at, number: self.number, what }));
    }

    fn next(&mut self) -> Option<(Stamp, Happening)> {
        self.queue.pop().map(|Reverse(planned)| (planned.at, planned.what))
    }
}

/// The phone and its connection.
struct Phone {
    page: Page,
    up: Line,
    down: Line,
    in_flight: usize,
    late: bool,
    clock_s: f64,
    bound_s: f64,
    unknown: Option<Spells>,
    /// How long the last two ways took together.
    round_s: f64,
}

/// The camera.
struct Camera {
    each_s: f64,
    stops: Option<Spells>,
    calm: Stamp,
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

/// True places of who records the route, by time, and when that ends.
type WayOut = Vec<((f64, f64, f64), Stamp)>;

fn way_out(scenario: &Scenario, shape: &Shape) -> (WayOut, Stamp) {
    let phase = scenario.random(1003).uniform(0.0, 6.0);
    let ground = Ground::z_up();
    let place = |(tick, (pose, _)): (usize, (Se3, f64))| {
        let at = pose.translation;
        let heading = ground.heading(&pose).unwrap_or(0.0);
        ((at.x, at.y, heading), Stamp::from_seconds(STEP_S * tick as f64))
    };
    let poses: WayOut = walked_poses(&shape.line, phase).into_iter().enumerate().map(place).collect();
    let ends = poses.last().map_or(Stamp::default(), |(_, at)| *at).plus_seconds(0.1);
    (poses, ends)
}

fn new_session(scenario: &Scenario, shape: &Shape, disk: &VirtualDisk) -> Session<Modelled> {
    let config = SessionConfig {
        // Nothing is there, and nothing is made there: all files are on the virtual disk.
        folder: PathBuf::from("no-folder-of-routes"),
        facing: shape.facing,
        phrases: PhraseConfig { language: shape.language, ..PhraseConfig::default() },
        ..SessionConfig::default()
    };
    let engine = Modelled::new(!scenario.faults.has(Fault::NoMetres));
    Session::new(engine, config).on_disk(Box::new(disk.clone()))
}

/// Records the way out; what was said to be saved and is not.
fn record(
    server: &mut Server,
    estimator: &mut Estimator,
    poses: &WayOut,
    disk: &VirtualDisk,
) -> Option<String> {
    let file = Path::new("way-out.route");
    for (tick, (walker, at)) in poses.iter().step_by(2).enumerate() {
        server.clock.set(Some(ClockReading { now: *at, bound_s: 0.0, delivery_s: 0.0 }));
        server.show(estimator.look(*walker, *at));
        if tick == 0 {
            // What it answers is of no interest before guidance.
            let _ = server.session.record_to(file);
        }
        server.session.events();
    }
    let saved = server.session.command(&Command::Stop).is_ok();
    server.session.events();
    server.session.engine_mut().recorded();
    let points = server.session.route()?.points.len();
    // Recording goes on in memory where no file could be made, and this was said.
    let bytes = disk.after_power_cut(file).filter(|_| saved)?;
    match Route::read(bytes.as_slice()) {
        Ok(route) if route.points.len() == points => None,
        Ok(route) => Some(format!("{} of {points} points are saved", route.points.len())),
        Err(why) => Some(why.to_string()),
    }
}

/// The route in true metres.
fn true_plan(route: &Route, shape: &Shape, unit_m: f64) -> Option<ManeuverPlan> {
    let metres = |p: PlacedPoint| {
        let pose = p.frame_from_camera;
        PlacedPoint { frame_from_camera: Se3::new(pose.rotation, pose.translation * unit_m), ..p }
    };
    let placed: Vec<PlacedPoint> = route.as_recorded().into_iter().map(metres).collect();
    let ground = Ground::z_up();
    let cleaned = clean(&placed, 1.0, &ground, &CleanConfig::default());
    ManeuverPlan::from_route(&cleaned, shape.travel, &ground, &ManeuverPlanConfig::default()).ok()
}

impl Camera {
    fn new(scenario: &Scenario, begins: Stamp, calm: Stamp) -> Self {
        let few = scenario.faults.has(Fault::FewPictures);
        let stops = scenario.faults.has(Fault::CameraStops).then(|| {
            let random = scenario.random(Fault::CameraStops as u64);
            Spells::new(random, begins, calm, [3.0, 40.0], [0.3, 15.0])
        });
        Self { each_s: if few { 0.33 } else { 0.1 }, stops, calm }
    }
}

impl Phone {
    fn new(scenario: &Scenario, shape: &Shape, begins: Stamp, calm: Stamp) -> Self {
        let mut random = scenario.random(Fault::ClockError as u64);
        let bound_s = if scenario.faults.has(Fault::ClockError) { random.uniform(0.0, 0.2) } else { 0.01 };
        let unknown = scenario.faults.has(Fault::ClockUnknown).then(|| {
            let random = scenario.random(Fault::ClockUnknown as u64);
            Spells::new(random, begins, calm, [5.0, 60.0], [0.5, 10.0])
        });
        Self {
            page: Page::new(shape.language),
            up: Line::new(scenario, 0, begins, calm),
            down: Line::new(scenario, 1, begins, calm),
            in_flight: 0,
            late: false,
            clock_s: random.uniform(-bound_s, bound_s),
            bound_s,
            unknown,
            round_s: 0.02,
        }
    }

    /// What the server knows of the phone's clock when it truly shows this.
    fn reading(&mut self, now: Stamp) -> Option<ClockReading> {
        if self.unknown.since(now).is_some() {
            return None;
        }
        let delivery_s = 0.5 * self.round_s + if self.late { LATE_S } else { 0.0 };
        Some(ClockReading { now: now.plus_seconds(self.clock_s), bound_s: self.bound_s, delivery_s })
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
