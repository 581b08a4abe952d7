//! What a walk begins with: the phone, the camera, and the route, which is recorded on the way out.

use crate::estimator::Estimator;
use crate::modelled::Modelled;
use crate::network::Line;
use crate::page::Page;
use crate::scenario::{Fault, Scenario, Shape};
use crate::server::Server;
use crate::spells::{Since, Spells};
use crate::storage::VirtualDisk;
use cairn_geometry::Se3;
use cairn_guide::{
    CleanConfig, Ground, ManeuverPlan, ManeuverPlanConfig, PhraseConfig, PlacedPoint, Route, clean,
};
use cairn_sensor::{ClockReading, Stamp};
use cairn_session::{Command, Session, SessionConfig};
use cairn_trial::walk::{STEP_S, walked_poses};
use std::path::{Path, PathBuf};

/// What the way of the words is taken to be longer while the page finds them late, seconds (`sources::live::phone_port`).
const LATE_S: f64 = 1.0;
/// The phone and its connection.
pub struct Phone {
    pub page: Page,
    pub up: Line,
    pub down: Line,
    pub in_flight: usize,
    pub late: bool,
    pub clock_s: f64,
    pub bound_s: f64,
    pub unknown: Option<Spells>,
    /// How long the last two ways took together.
    pub round_s: f64,
}

/// The camera.
pub struct Camera {
    pub each_s: f64,
    pub stops: Option<Spells>,
    pub calm: Stamp,
}

/// True places of who records the route, by time, and when that ends.
pub type WayOut = Vec<((f64, f64, f64), Stamp)>;

pub fn way_out(scenario: &Scenario, shape: &Shape) -> (WayOut, Stamp) {
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

pub fn new_session(scenario: &Scenario, shape: &Shape, disk: &VirtualDisk) -> Session<Modelled> {
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
pub fn record(
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
pub fn true_plan(route: &Route, shape: &Shape, unit_m: f64) -> Option<ManeuverPlan> {
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
    pub fn new(scenario: &Scenario, begins: Stamp, calm: Stamp) -> Self {
        let few = scenario.faults.has(Fault::FewPictures);
        let stops = scenario.faults.has(Fault::CameraStops).then(|| {
            let random = scenario.random(Fault::CameraStops as u64);
            Spells::new(random, begins, calm, [3.0, 40.0], [0.3, 15.0])
        });
        Self { each_s: if few { 0.33 } else { 0.1 }, stops, calm }
    }
}

impl Phone {
    pub fn new(scenario: &Scenario, shape: &Shape, begins: Stamp, calm: Stamp) -> Self {
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
    pub fn reading(&mut self, now: Stamp) -> Option<ClockReading> {
        if self.unknown.since(now).is_some() {
            return None;
        }
        let delivery_s = 0.5 * self.round_s + if self.late { LATE_S } else { 0.0 };
        Some(ClockReading { now: now.plus_seconds(self.clock_s), bound_s: self.bound_s, delivery_s })
    }
}
