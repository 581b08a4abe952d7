//! The node at work: messages become packets on one thread, packets become poses on another, results go out.

mod build;
mod diagnostics;
mod goal;
mod placing;

use crate::assemble::Clock;
use crate::faults::{Faults, Severity};
use crate::frames::FrameTree;
use crate::grid::{self, GroundGrid};
use crate::markers::markers;
use crate::messages::{Header, Text};
use crate::network::{MOST_WAITING, Network, NetworkError};
use crate::options::{NoPictures, Options, Topics};
use crate::planner::Planner;
use crate::results::{self, FrameNames};
use crate::service::Service;
use crate::setup::{Found, Setup};
use crate::time::Time;
use crate::worker::{Requests, SetupEvent, Worker};
use build::{HostClock, build, ground_grid, tree};
use cairn::atlas::MapId;
use cairn::geometry::Se3;
use cairn::guide::Facing;
use cairn::sensor::{FramePacket, SkipKind, Stamp};
use cairn::session::{Event, Inbox, Item};
use cairn::{Config, Output, Slam, StageEvent};
use diagnostics::Counts;
use placing::Placing;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel, sync_channel};
use std::time::{Duration, Instant};

/// How often the node looks around while no packet comes.
const TICK: Duration = Duration::from_millis(50);
/// Interval of diagnostics, and of path, points and grid.
const SLOW: Duration = Duration::from_secs(1);

/// Why the node cannot work.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// No topic of pictures was named.
    #[error(transparent)]
    Pictures(#[from] NoPictures),
    /// The configuration cannot be read.
    #[error("{}: {why}", path.display())]
    Config {
        /// Its file.
        path: PathBuf,
        /// Why.
        why: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The network.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// The thread that takes the messages has stopped by an error of the program.
    #[error("the thread that takes the messages has stopped by an error of the program")]
    Stopped,
    /// The library's error.
    #[error(transparent)]
    Slam(#[from] cairn::Error),
}

/// Why a service was refused.
#[derive(Debug, thiserror::Error)]
enum Refused {
    #[error("no map file was named: start with --map FILE, or set the parameter map")]
    NoMap,
    #[error(transparent)]
    Slam(#[from] cairn::Error),
    #[error(transparent)]
    Node(#[from] NodeError),
}

/// Runs the node until `stop` is set.
///
/// # Errors
/// When a file cannot be read, the network cannot be used, or the calibration is not possible.
pub fn run(options: &Options, stop: &AtomicBool) -> Result<(), NodeError> {
    let topics = options.topics()?;
    let rig = match &options.rig {
        Some(path) => Some(cairn::sources::read_rig(path).map_err(cairn::Error::from)?),
        None => None,
    };
    let config = match &options.config {
        Some(path) => read_config(path)?,
        None => Config::default(),
    };
    let faults = Faults::new(&options.log);
    options.notes.iter().for_each(|note| faults.say(Severity::Warn, note));
    let mut network = Network::join(options, &topics, &faults)?;
    let (to, messages) = sync_channel(MOST_WAITING);
    network.listen(to, &faults)?;
    network.answer_parameters(&options.parameters, &faults)?;
    network.watch_matches(&faults)?;
    let (inbox, requests) = (Inbox::new(), Requests::default());
    let time = if options.use_sim_time { Time::simulated() } else { Time::wall() };
    let setup = Setup::new(options, &topics, rig);
    let (tell, told) = channel();
    let worker = Worker {
        messages,
        inbox: inbox.clone(),
        requests: requests.clone(),
        time: time.clone(),
        faults: faults.clone(),
        pair_within_s: 1e-3
            * options.pair_within_ms.unwrap_or(if topics.depth.is_some() { 20.0 } else { 10.0 }),
    };
    let thread = std::thread::Builder::new().name("cairn-ros-assemble".into());
    let reader = thread.spawn(move || worker.run(setup, &tell));
    let reader = reader.map_err(NetworkError::from)?;
    let Some((found, clock)) = wait(&network, &told, &faults, stop)? else { return Ok(()) };
    for note in &found.notes {
        faults.say(Severity::Info, note);
    }
    let mut node = Node::new(options, &topics, network, found, clock, config, faults, requests, time)?;
    let until = options.for_s.and_then(|s| Duration::try_from_secs_f64(s).ok()).map(|d| Instant::now() + d);
    while !stop.load(Ordering::Relaxed) && until.is_none_or(|until| Instant::now() < until) {
        match inbox.take(TICK) {
            Item::Packet(packet, _) => node.packet(&packet, inbox.dropped()),
            _ if reader.is_finished() => return Err(NodeError::Stopped),
            Item::Ended(_) | Item::Command(_) | Item::Nothing => node.idle(),
        }
        node.step()?;
    }
    inbox.close();
    node.close();
    Ok(())
}

fn read_config(path: &Path) -> Result<Config, NodeError> {
    let fail = |why| NodeError::Config { path: path.to_owned(), why };
    let text = std::fs::read_to_string(path).map_err(|e| fail(e.into()))?;
    Config::from_toml(&text).map_err(|e| fail(e.into()))
}

/// Waits for the first messages; says what is missing. `None` when the node is to stop.
fn wait(
    network: &Network,
    told: &Receiver<SetupEvent>,
    faults: &Faults,
    stop: &AtomicBool,
) -> Result<Option<(Found, Clock)>, NodeError> {
    let mut failed = String::new();
    while !stop.load(Ordering::Relaxed) {
        match told.recv_timeout(TICK) {
            Ok(SetupEvent::Found(found, clock)) => return Ok(Some((*found, clock))),
            // The next calibration may be another: drivers send one that is empty until they are ready.
            Ok(SetupEvent::Failed(why)) if why.to_string() != failed => {
                failed = why.to_string();
                faults.say(Severity::Error, &failed);
            }
            Ok(SetupEvent::Failed(_)) | Err(RecvTimeoutError::Timeout) => {}
            Ok(SetupEvent::Missing(topics)) => {
                let line = |topic: &String| match network.publishers_of(topic) {
                    0 => format!("{topic} (nobody publishes it)"),
                    _ => format!("{topic} (no message yet)"),
                };
                let lines: Vec<String> = topics.iter().map(line).collect();
                faults.say(Severity::Info, &format!("waiting for {}", lines.join(", ")));
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(NodeError::Stopped);
            }
        }
    }
    Ok(None)
}

/// SLAM with its outputs.
struct Node<'a> {
    options: &'a Options,
    topics: &'a Topics,
    network: Network,
    found: Found,
    clock: Clock,
    config: Config,
    faults: Faults,
    requests: Requests,
    time: Time,
    names: FrameNames,
    slam: Slam,
    /// Whether the age of pictures is judged.
    knows_age: bool,
    tree: FrameTree,
    grid: Option<GroundGrid>,
    planner: Planner,
    placing: Placing,
    shown: Shown,
    /// The time of the last packet, in the packets' clock.
    last: Option<(Stamp, Instant)>,
    slow: Instant,
    counts: Counts,
}

/// What was published or said last.
#[derive(Default)]
struct Shown {
    /// Why there was no path to the goal.
    no_path: String,
    /// The map.
    map: Option<MapId>,
    /// Points of the route.
    route: Option<usize>,
    /// When a picture with features was.
    features: Option<Stamp>,
    /// What the markers show: version of the map, its place, the goal.
    marked: Option<(u64, Se3, Option<Se3>)>,
}

impl<'a> Node<'a> {
    #[allow(clippy::too_many_arguments)]
    fn new(
        options: &'a Options,
        topics: &'a Topics,
        network: Network,
        found: Found,
        clock: Clock,
        config: Config,
        faults: Faults,
        requests: Requests,
        time: Time,
    ) -> Result<Self, NodeError> {
        let map = options.map.as_deref().filter(|path| path.exists());
        let slam = build(options, topics, &found, &config, map)?;
        let tree = tree(options, &slam, &found);
        let planner = Planner::new(options.robot_radius_m);
        let grid = ground_grid(options, &found, planner.stood_m(), &faults);
        let names = FrameNames {
            map: options.map_frame.clone(),
            odom: options.odom_frame.clone(),
            base: options.base_frame.clone(),
        };
        let sensors = if found.rig.imu.is_some() { "with IMU" } else { "without IMU" };
        let line = match map {
            Some(path) => format!("{:?} {sensors}, in the map of {}", topics.mode(), path.display()),
            None => format!("{:?} {sensors}", topics.mode()),
        };
        faults.say(Severity::Info, &line);
        let counts = Counts { scale: 1.0, ..Counts::default() };
        let mut node = Self {
            options,
            topics,
            network,
            found,
            clock,
            config,
            faults,
            requests,
            time,
            names,
            slam,
            knows_age: false,
            tree,
            grid,
            planner,
            placing: Placing::default(),
            shown: Shown::default(),
            last: None,
            slow: Instant::now(),
            counts,
        };
        if map.is_some() {
            node.enter_saved_map();
        }
        Ok(node)
    }

    fn packet(&mut self, packet: &FramePacket, dropped: usize) {
        let started = Instant::now();
        self.counts.packets += 1;
        self.counts.dropped = dropped;
        if !self.knows_age && self.time.now().is_some() {
            self.slam.follow(Arc::new(HostClock(self.clock.clone(), self.time.clone())));
            self.knows_age = true;
        }
        self.give_wheels(self.clock.of_messages(packet.stamp));
        let output = match self.slam.track(packet) {
            Ok(output) => output,
            Err(e) => {
                self.faults.count(SkipKind::Frame, "a picture was refused", &e.to_string());
                return;
            }
        };
        let before = self.last.replace((packet.stamp, Instant::now()));
        let stamp = self.clock.of_messages(packet.stamp);
        let map = output.pose.map(|pose| pose.scale.map);
        let is_placed = map.is_some_and(|map| self.is_placed(map));
        let aligned = map.is_some_and(|map| self.slam.map().snapshot().is_gravity_aligned(map));
        let restarts = self.tree.restarts();
        if before.is_some_and(|(before, _)| self.clock.period(before) != self.clock.period(packet.stamp)) {
            self.tree.break_off();
        }
        if let Some(tracked) = results::tracked(&output, aligned) {
            let transforms = match is_placed {
                true => self.tree.step(&tracked),
                false => self.tree.step_elsewhere(&tracked),
            };
            let dt_s = before.map_or(0.0, |(before, _)| packet.stamp - before);
            self.network.odometry.publish(results::odometry(stamp, &self.names, &transforms, dt_s));
            if !self.options.no_tf {
                let with_base = !self.options.no_odom_tf;
                self.network.tf.publish(results::tf(stamp, &self.names, &transforms, with_base));
            }
            if let Some(pose) = results::pose(stamp, &self.names, &transforms) {
                self.network.pose.publish(pose);
                self.lay(packet, &output);
                self.watch_floor(packet.stamp, tracked.metric);
            }
            self.counts.tracked += 1;
            (self.counts.metric, self.counts.scale) = (tracked.metric, tracked.scale);
            if self.tree.restarts() > restarts {
                let line = "the odometry went on where it was after motion that was not observed";
                self.faults.count(SkipKind::Other, line, &format!("at {stamp} s"));
            }
        }
        self.report_hint();
        self.show_features(packet, &output, stamp);
        if let Some(now) = self.time.now() {
            self.counts.ages_ms.push((now.0.saturating_sub(stamp.0)) as f64 * 1e-6);
        }
        self.counts.steps_ms.push(started.elapsed().as_secs_f64() * 1e3);
        if let Some(found) = output.events.iter().find_map(StageEvent::misregistered) {
            self.faults.say(Severity::Warn, &format!("{found}: poses are taken from depth from here on"));
        }
        if let Some(why) = output.stage_failed() {
            self.faults.say(Severity::Error, &format!("mapping has stopped: {why}"));
        }
    }

    /// Lays the depth image into the grid.
    fn lay(&mut self, packet: &FramePacket, output: &Output) {
        let (Some(grid), Some(depth), Some(pose)) = (&mut self.grid, &packet.depth, output.pose) else {
            return;
        };
        let anchored = pose.anchored;
        let placed = self.tree.map_from_world().zip(self.tree.map_from_base());
        let Some((map_from_world, map_from_base)) = placed else { return };
        let map_from_key =
            map_from_world * anchored.world_from_camera * anchored.reference_from_camera.inverse();
        if let Err(why) = grid.observe(depth, anchored.reference, &map_from_key, &map_from_base) {
            self.faults.count(SkipKind::Depth, "a depth image was not laid into the grid", &why.to_string());
        }
    }

    /// No packet has come for a moment.
    fn idle(&mut self) {
        let Some((stamp, at)) = self.last else { return };
        let now = match self.time.now().filter(|_| self.time.is_simulated()) {
            // A simulator that stands still lets no time pass.
            Some(now) => self.clock.of_packets(now).max(stamp),
            None => stamp.plus_seconds(at.elapsed().as_secs_f64()),
        };
        self.slam.tick(now);
    }

    /// What is due after every packet and while none comes.
    fn step(&mut self) -> Result<(), NodeError> {
        for event in self.slam.heard() {
            if let Event::Said(said) = event {
                self.network.said.publish(Text { data: said.text });
            }
        }
        loop {
            let call = self.requests.lock().calls.pop_front();
            let Some((service, id)) = call else { break };
            let result = self.serve(service);
            let (success, words) = match result {
                Ok(words) => (true, words),
                Err(why) => (false, why.to_string()),
            };
            let refused = if success { "" } else { "refused: " };
            self.faults.say(Severity::Info, &format!("{}: {refused}{words}", service.name()));
            if let Err(why) = self.network.answer(service, id, success, words) {
                self.faults.count(SkipKind::Other, "an answer could not be sent", &why.to_string());
            }
        }
        let goal = self.requests.lock().goal.take();
        if let Some(goal) = goal {
            self.take_goal(&goal);
        }
        let initial_pose = self.requests.lock().initial_pose.take();
        if let Some(pose) = initial_pose {
            self.take_initial_pose(&pose);
        }
        if self.slow.elapsed() >= SLOW {
            self.slow = Instant::now();
            self.publish_map();
            self.plan();
            self.publish_diagnostics();
        }
        Ok(())
    }

    fn serve(&mut self, service: Service) -> Result<String, Refused> {
        match service {
            Service::SaveMap => {
                let path = self.options.map_file().ok_or(Refused::NoMap)?;
                let bytes = self.slam.save(&path)?;
                Ok(format!("{} written, {} kB", path.display(), bytes / 1000))
            }
            Service::LoadMap => {
                let path = self.options.map_file().ok_or(Refused::NoMap)?;
                self.begin_anew(Some(&path))?;
                Ok(format!("in the map of {}", path.display()))
            }
            Service::Reset => {
                self.begin_anew(None)?;
                Ok("begun anew".into())
            }
            Service::Record => Ok(self.slam.record(self.options.route_file())?),
            Service::StopRecording => {
                let points = self.slam.stop_recording()?.points.len();
                Ok(format!("{points} points recorded"))
            }
            Service::GuideHome => {
                self.with_route()?;
                Ok(self.slam.guide_home(Facing::Home)?)
            }
            Service::GuideAgain => {
                self.with_route()?;
                Ok(self.slam.guide_again(Facing::Home)?)
            }
            Service::Halt => Ok(self.slam.halt()?),
        }
    }

    /// The route at hand, else that of the file.
    fn with_route(&mut self) -> Result<(), Refused> {
        let file = self.options.route_file();
        if self.slam.route().is_none() && file.exists() {
            self.slam.load_route(file)?;
        }
        Ok(())
    }

    fn begin_anew(&mut self, map: Option<&Path>) -> Result<(), Refused> {
        let built = build(self.options, self.topics, &self.found, &self.config, map);
        let slam = built?;
        (self.slam, self.knows_age) = (slam, false);
        self.tree.begin_anew();
        self.grid = ground_grid(self.options, &self.found, self.planner.stood_m(), &self.faults);
        self.planner.set_goal(None);
        (self.placing, self.shown) = (Placing::default(), Shown::default());
        if map.is_some() {
            self.enter_saved_map();
        }
        Ok(())
    }

    fn publish_map(&mut self) {
        let (Some(id), Some((last, _))) = (self.shown.map, self.last) else { return };
        let (map, stamp) = (self.slam.map(), self.clock.of_messages(last));
        let time = |at: Stamp| self.clock.of_messages(at);
        self.network.path.publish(results::path(stamp, &self.names, &map, id, &self.tree, time));
        self.network.points.publish(results::points(stamp, &self.names, &map, id, &self.tree));
        let place = self.tree.map_from_world().unwrap_or_else(Se3::identity);
        let marked = Some((map.snapshot().version(), place, self.planner.goal().copied()));
        if self.shown.marked != marked {
            self.shown.marked = marked;
            let goal = self.planner.goal();
            self.network.markers.publish(markers(stamp, &self.names.map, &map, id, &self.tree, goal));
        }
        if let Some(route) = results::route(stamp, &self.names, &self.slam, id, &self.tree)
            && self.shown.route != Some(route.poses.len())
        {
            self.shown.route = Some(route.poses.len());
            self.network.route.publish(route);
        }
        let (Some(grid), Some(map_from_world)) = (&mut self.grid, self.tree.map_from_world()) else { return };
        if let Err(why) = grid.follow(map.snapshot(), &map_from_world) {
            self.faults.count(SkipKind::Other, "the occupancy grid stays as it was", &why.to_string());
        }
        if let Some(map) = grid.map() {
            self.network.grid.publish(grid::message(Header::new(stamp, &self.names.map), &map));
        }
    }

    /// Ends what is in progress.
    fn close(&mut self) {
        if !self.slam.session().is_recording() {
            return;
        }
        match self.serve(Service::StopRecording) {
            Ok(words) => self.faults.say(Severity::Info, &words),
            Err(why) => self.faults.say(Severity::Warn, &why.to_string()),
        }
    }
}
