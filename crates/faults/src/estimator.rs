//! What an engine would make of the pictures of a walk: true poses with noise, drift, corrections, losses and lies.

use crate::scenario::{Fault, Scenario};
use crate::spells::{Since, Spells};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_guide::{Facing, camera_pose};
use cairn_random::Random;
use cairn_sensor::Stamp;
use std::f64::consts::PI;

/// A picture, and what is known of it that no engine knows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    pub stamp: Stamp,
    /// True position of the walker in metres, and heading in radians.
    pub walker: (f64, f64, f64),
    pub view: View,
    /// The pose is wrong, and says that it is good.
    pub is_false: bool,
    /// How far the map has the walker from where they truly are, metres.
    pub error_m: f64,
    /// For how long it has run away, faster than anyone walks, seconds.
    pub runaway_s: f64,
    /// For how long the walker has walked with the motion sensors alone, seconds.
    pub blind_s: f64,
}

/// What the engine finds in a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) enum View {
    Pose(PoseView),
    Lost,
    /// What tracks is being started again.
    Away,
    /// The engine panics.
    Dies,
}

/// A pose in the odometry, and that in a map, both in the unit of that map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PoseView {
    pub world_from_odom: Se3,
    pub odom_from_camera: Se3,
    pub segment: u32,
    /// Seconds since the map was last seen, where the motion sensors alone carry the pose.
    pub coasts_s: Option<f64>,
    /// The pose is in a map of its own that began with this pose.
    pub own_map: Option<Se3>,
    pub metric: bool,
    /// The unit of length rests on something.
    pub supported: bool,
}

/// What fails when.
struct Failures {
    short: Option<Spells>,
    long: Option<Spells>,
    coasting: Option<Spells>,
    outliers: Option<Spells>,
    runaway: Option<Spells>,
    own_unit: Option<Spells>,
    away: Option<Spells>,
    frozen: Option<Spells>,
    dies: Option<Stamp>,
}

impl Failures {
    fn new(scenario: &Scenario, begins: Stamp, calm: Stamp) -> Self {
        let spells = |fault: Fault, rests_s, lasts_s| {
            let random = || scenario.random(fault as u64);
            scenario.faults.has(fault).then(|| Spells::new(random(), begins, calm, rests_s, lasts_s))
        };
        let dies = |fault| begins.plus_seconds(scenario.random(fault as u64).uniform(1.0, 120.0));
        Self {
            short: spells(Fault::ShortLosses, [2.0, 40.0], [0.2, 3.0]),
            long: spells(Fault::LongLosses, [10.0, 60.0], [3.0, 40.0]),
            coasting: spells(Fault::Coasting, [3.0, 30.0], [0.2, 8.0]),
            outliers: spells(Fault::Outliers, [2.0, 20.0], [0.05, 0.12]),
            runaway: spells(Fault::Runaway, [10.0, 40.0], [1.0, 6.0]),
            own_unit: spells(Fault::OwnUnit, [10.0, 40.0], [3.0, 30.0]),
            away: spells(Fault::Away, [10.0, 60.0], [0.5, 10.0]),
            frozen: spells(Fault::Frozen, [10.0, 40.0], [0.5, 8.0]),
            dies: scenario.faults.has(Fault::Dies).then(|| dies(Fault::Dies)),
        }
    }
}

/// The model of an engine.
pub(crate) struct Estimator {
    failures: Failures,
    random: Random,
    facing: Facing,
    begins: Stamp,
    noise: f64,
    renews: bool,
    metric: bool,
    /// Metres in a unit of the map.
    unit_m: f64,
    /// Of the odometry, a metre walked: metres ahead and aside, radians.
    drift: Vec3,
    corrected_each_m: f64,
    corrected_m: f64,
    walked_m: f64,
    last: Option<(Stamp, (f64, f64, f64))>,
    /// The odometry frame as it is, and as the map knows it.
    odom_from_world: Se3,
    known_odom_from_world: Se3,
    segment: u32,
    /// The spell that was on at the picture before.
    before: (bool, bool, bool),
    /// Where the pose was when it was good last, its frozen copy, and where its own map began.
    held: Held,
}

/// What a spell holds on to.
#[derive(Clone, Copy, Default)]
struct Held {
    frozen: Option<(f64, f64, f64)>,
    runs_to: f64,
    outlier: Vec3,
    own_map: Option<OwnMap>,
    blind_s: f64,
}

/// A map that began where the map of the route had it, about so, with a guess of its unit.
#[derive(Clone, Copy)]
struct OwnMap {
    truth: Se3,
    root: Se3,
    /// Units of the map of the route in one of its.
    units: f64,
}

impl Estimator {
    /// Before the recording; failures happen between two times.
    pub fn new(scenario: &Scenario, facing: Facing, begins: Stamp, calm: Stamp) -> Self {
        let faults = scenario.faults;
        let mut random = scenario.random(1002);
        let (late, usual) = (faults.has(Fault::LateCorrections), faults.has(Fault::Drift));
        let (share, degrees, each_m) = match (late, usual) {
            (true, _) => (0.008, 0.1, 25.0),
            (false, true) => (0.004, 0.1, 10.0),
            _ => (0.0, 0.0, f64::INFINITY),
        };
        let mut normal = |sigma: f64, most: f64| random.normal(0.0, sigma).clamp(-most, most);
        let drift = Vec3::new(
            normal(share, 2.0 * share),
            normal(share, 2.0 * share),
            normal(degrees, 1.5 * degrees).to_radians(),
        );
        let metric = !faults.has(Fault::NoMetres);
        let unit_m = random.uniform(0.4, 2.5);
        Self {
            failures: Failures::new(scenario, begins, calm),
            facing,
            begins,
            noise: if faults.has(Fault::Noise) { 1.0 } else { 0.0 },
            renews: faults.has(Fault::NewSegments),
            metric,
            unit_m: if metric { 1.0 } else { unit_m },
            drift,
            corrected_each_m: each_m,
            corrected_m: 0.0,
            walked_m: 0.0,
            last: None,
            odom_from_world: Se3::identity(),
            known_odom_from_world: Se3::identity(),
            segment: 0,
            before: (false, false, false),
            held: Held::default(),
            random,
        }
    }

    /// Metres in a unit of the map of the route.
    pub fn unit_m(&self) -> f64 {
        self.unit_m
    }

    /// What is found in the picture that is taken now.
    pub fn look(&mut self, walker: (f64, f64, f64), now: Stamp) -> Reading {
        let guided = now >= self.begins;
        let f = &mut self.failures;
        let lost = f.short.since(now).is_some() | f.long.since(now).is_some();
        let away = f.away.since(now).is_some();
        let coasts = f.coasting.since(now).filter(|_| guided);
        let dies = f.dies.is_some_and(|at| now >= at);
        let is_false = self.lie(walker, now);
        self.moved(walker, now, coasts.is_some());
        self.change_frames((lost || away, coasts.is_some()), walker, now);
        let view = match () {
            () if dies => View::Dies,
            () if away => View::Away,
            () if lost => View::Lost,
            () => View::Pose(self.pose(walker, now, coasts)),
        };
        let off = self.known_odom_from_world.inverse() * self.odom_from_world;
        let at = Vec3::new(walker.0, walker.1, 0.0);
        let error_m = if self.held.own_map.is_some() { f64::INFINITY } else { (off * at - at).norm() };
        let runaway_s = self.failures.runaway.since(now).map_or(0.0, |since| now - since);
        Reading { stamp: now, walker, view, is_false, error_m, runaway_s, blind_s: self.held.blind_s }
    }

    /// Whether the pose will be wrong without saying so; prepares how.
    fn lie(&mut self, walker: (f64, f64, f64), now: Stamp) -> bool {
        let f = &mut self.failures;
        let frozen = f.frozen.since(now).is_some();
        self.held.frozen = frozen.then(|| self.held.frozen.unwrap_or(walker));
        let outlier = f.outliers.since(now).is_some();
        let runs = f.runaway.since(now);
        if runs.is_none() {
            self.held.runs_to = self.random.uniform(-PI, PI);
        }
        self.held.outlier = Vec3::zeros();
        if let Some(since) = runs {
            let far_m = 6.0 * (now - since);
            self.held.outlier =
                Vec3::new(far_m * self.held.runs_to.cos(), far_m * self.held.runs_to.sin(), 0.0);
        } else if outlier {
            let (to, far_m) = (self.random.uniform(-PI, PI), self.random.uniform(1.0, 3.0));
            self.held.outlier = Vec3::new(far_m * to.cos(), far_m * to.sin(), 0.0);
        }
        frozen || outlier || runs.is_some()
    }

    /// The walker has moved: the odometry drifts.
    fn moved(&mut self, walker: (f64, f64, f64), now: Stamp, coasts: bool) {
        let (then, before) = self.last.replace((now, walker)).unwrap_or((now, walker));
        let step_m = (walker.0 - before.0).hypot(walker.1 - before.1);
        let turned = cairn_guide::wrap(walker.2 - before.2).abs();
        if now < self.begins {
            return;
        }
        self.walked_m += step_m;
        let dt = now - then;
        let walks = dt > 0.0 && step_m / dt > 0.3 && turned / dt < 0.25;
        self.held.blind_s = if coasts { self.held.blind_s + if walks { dt } else { 0.0 } } else { 0.0 };
        let at = Vec3::new(walker.0, walker.1, 0.0);
        let twist = So3::exp(&(Vec3::z() * self.drift.z * step_m));
        let shift = Vec3::new(self.drift.x, self.drift.y, 0.0) * step_m;
        // An accelerometer that is off by 0.05 m/s^2.
        let glides = if coasts { 0.05 * dt * self.held.blind_s } else { 0.0 };
        let along = Vec3::new(glides, -glides, 0.0);
        self.odom_from_world = self.odom_from_world * Se3::new(twist, at - twist * at + shift + along);
    }

    /// The map is corrected, or another frame of odometry or another map begins.
    fn change_frames(&mut self, (lost, coasts): (bool, bool), walker: (f64, f64, f64), now: Stamp) {
        let own = self.failures.own_unit.since(now).is_some();
        let (was_lost, coasted, was_own) = std::mem::replace(&mut self.before, (lost, coasts, own));
        let is_new = was_lost && !lost && self.renews || own != was_own;
        if is_new {
            self.segment += 1;
            let turn = So3::exp(&(Vec3::z() * self.random.uniform(-PI, PI)));
            let shift = Vec3::new(self.random.uniform(-5.0, 5.0), self.random.uniform(-5.0, 5.0), 0.0);
            self.odom_from_world = Se3::new(turn, shift);
        }
        if own != was_own {
            let truth = self.camera(walker, now);
            let mut normal = |sigma: f64| self.random.normal(0.0, sigma);
            let off =
                Se3::new(So3::exp(&(Vec3::z() * normal(0.05))), Vec3::new(normal(0.3), normal(0.3), 0.0));
            let root = Se3::new(off.rotation * truth.rotation, truth.translation + off.translation);
            self.held.own_map = own.then(|| OwnMap { truth, root, units: normal(0.3).exp() });
        }
        let due = self.walked_m - self.corrected_m > self.corrected_each_m;
        if is_new || due && !coasts || coasted && !coasts {
            self.corrected_m = self.walked_m;
            self.known_odom_from_world = self.odom_from_world;
        }
    }

    /// Where the camera truly is. The chest sways, and the camera is tilted down.
    fn camera(&self, (x, y, heading): (f64, f64, f64), now: Stamp) -> Se3 {
        // The way out is recorded with the camera ahead.
        let back = self.facing == Facing::Back && now >= self.begins;
        let looks = heading + if back { PI } else { 0.0 };
        camera_pose(x, y, looks, 0.25 + 0.05 * (now.seconds() * 6.0).sin())
    }

    fn pose(&mut self, walker: (f64, f64, f64), now: Stamp, coasts: Option<Stamp>) -> PoseView {
        let truth = self.camera(self.held.frozen.unwrap_or(walker), now);
        let mut white = |sigma: f64| self.random.normal(0.0, sigma);
        let shake = Vec3::new(white(0.02), white(0.02), white(0.02)) * self.noise + self.held.outlier;
        let turn = Vec3::new(white(1.0), white(1.0), white(1.0)) * (self.noise * 0.5_f64.to_radians());
        let seen = Se3::new(truth.rotation * So3::exp(&turn), truth.translation + shake);
        let odom = self.odom_from_world * seen;
        let scaled = |pose: Se3, units: f64| Se3::new(pose.rotation, pose.translation / units);
        let known = self.known_odom_from_world.inverse();
        // The same bits until a correction.
        let (world_from_odom, odom) = match &self.held.own_map {
            Some(own) => (own.root * scaled(own.truth.inverse() * known, own.units), scaled(odom, own.units)),
            None => (known, odom),
        };
        let in_units = |pose: Se3| scaled(pose, self.unit_m);
        PoseView {
            world_from_odom: in_units(world_from_odom),
            odom_from_camera: in_units(odom),
            segment: self.segment,
            coasts_s: coasts.map(|since| now - since),
            own_map: self.held.own_map.as_ref().map(|own| in_units(own.root)),
            metric: self.metric && self.held.own_map.is_none(),
            supported: self.metric || coasts.is_none(),
        }
    }
}
