//! A rig in a world that is moved frame by frame by the caller: for closed loops, and the camera of
//! [`crate::SimSource`].

use crate::config::{SimConfig, SimSensor};
use crate::effects::Sensor;
use crate::render::Renderer;
use crate::world::{Figure, Passer, Thing, World};
use cairn_geometry::{Manifold, Se3};
use cairn_sensor::{DepthImage, FramePacket, GrayImage, Rig, RigCamera, SourceError, Stamp};
use std::sync::Arc;
use std::time::Instant;

/// One camera: its renderer and its sensor effects.
struct Lens {
    renderer: Renderer,
    sensor: Sensor,
    body_from_camera: Se3,
}

/// The scene that all cameras of a rig see in one frame.
struct Scene<'a> {
    pose_at: &'a (dyn Fn(f64) -> Se3 + Sync),
    /// Times of the sub-frames in seconds from the stamp.
    times: Vec<f64>,
    /// People at those times.
    figures: Vec<Vec<Figure>>,
    things: &'a [Thing],
    gain: f64,
    size: (usize, usize),
}

impl Lens {
    /// The image, and the depth where requested.
    fn see(&mut self, scene: &Scene, with_depth: bool) -> (GrayImage, Option<DepthImage>) {
        let (width, height) = scene.size;
        let mut depth = None;
        self.sensor.begin();
        for (i, (dt, people)) in scene.times.iter().zip(&scene.figures).enumerate() {
            let pose = (scene.pose_at)(*dt) * self.body_from_camera;
            self.sensor.add(self.renderer.draw(&pose, people, scene.things));
            if with_depth && i == scene.times.len() / 2 {
                let mut d = DepthImage::new(width, height);
                self.renderer.depth(&mut d);
                depth = Some(d);
            }
        }
        let mut image = GrayImage::new(width, height);
        self.sensor.develop(scene.times.len(), scene.gain, &mut image);
        if let Some(d) = &mut depth {
            self.sensor.depth(d);
        }
        (image, depth)
    }
}

/// The rig of a config, moved by the caller. It has no IMU: readings need a motion known in advance.
pub struct LiveRig {
    config: SimConfig,
    rig: Rig,
    world: Arc<World>,
    lenses: Vec<Lens>,
    passers: Vec<Passer>,
    /// People whom the caller moves.
    people: Vec<Figure>,
    things: Vec<Thing>,
    last: Option<(Stamp, Se3)>,
}

impl LiveRig {
    /// Builds the world of the config.
    ///
    /// # Errors
    /// When the config cannot be simulated.
    pub fn new(config: &SimConfig) -> Result<Self, SourceError> {
        config.check()?;
        let world = Arc::new(World::build(config.world, config.seed, &config.options));
        Self::in_world(config, world)
    }

    /// In an existing world (the config's own world, seed and options are ignored).
    ///
    /// # Errors
    /// When the config cannot be simulated.
    pub fn in_world(config: &SimConfig, world: Arc<World>) -> Result<Self, SourceError> {
        config.check()?;
        let rig = Rig { imu: None, ..config.rig() };
        let lens = |(i, camera): (usize, &RigCamera)| {
            let renderer = Renderer::new(&world, config.camera).map_err(|e| {
                SourceError::new(format!("sim:{}", config.world), e.to_string(), "correct the camera")
            })?;
            let sensor = Sensor::new(&config.camera, config.effects, config.seed, i as u64);
            Ok(Lens { renderer, sensor, body_from_camera: camera.body_from_camera })
        };
        let lenses = rig.cameras.iter().enumerate().map(lens).collect::<Result<_, SourceError>>()?;
        let passers = passers(&world, config.passers_by, config.seed);
        let (people, things) = (Vec::new(), Vec::new());
        Ok(Self { config: config.clone(), rig, world, lenses, passers, people, things, last: None })
    }

    /// The rig, without IMU.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The world it is in.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// Switches to another world from the next packet on: a door has been closed, for instance.
    pub fn set_world(&mut self, world: &Arc<World>) {
        self.world = Arc::clone(world);
        self.lenses.iter_mut().for_each(|lens| lens.renderer.set_world(world));
    }

    /// Places people for the next packets, beside the passers-by of the config.
    pub fn set_people(&mut self, people: &[Figure]) {
        self.people = people.to_vec();
    }

    /// Puts these things into the world, in place of those put in before.
    pub fn put(&mut self, things: Vec<Thing>) {
        self.things = things;
    }

    /// The packet seen from a body pose; blur follows the motion since the previous packet.
    ///
    /// # Errors
    /// When the pose is not finite or time does not increase.
    pub fn packet(&mut self, stamp: Stamp, world_from_body: &Se3) -> Result<FramePacket, SourceError> {
        let fail = |why: String| {
            SourceError::new(
                format!("sim:{}", self.config.world),
                why,
                "give finite poses in increasing time",
            )
        };
        if !world_from_body.is_finite() {
            return Err(fail(format!("the pose at {stamp} s is not finite")));
        }
        if let Some((before, _)) = self.last
            && stamp <= before
        {
            return Err(fail(format!("{stamp} s is not after {before} s")));
        }
        let twist = match &self.last {
            Some((before, pose)) if stamp - *before < 0.3 => pose.local(world_from_body) / (stamp - *before),
            _ => nalgebra::SVector::zeros(),
        };
        self.last = Some((stamp, *world_from_body));
        let pose = *world_from_body;
        Ok(self.packet_along(stamp, &|dt| pose.retract(&(twist * dt))))
    }

    /// The packet seen along a motion given around the stamp: `pose_at(seconds from the stamp)`. Each camera is
    /// rendered on a core of its own where available.
    pub(crate) fn packet_along(
        &mut self,
        stamp: Stamp,
        pose_at: &(dyn Fn(f64) -> Se3 + Sync),
    ) -> FramePacket {
        let begin = Instant::now();
        let times = self.sub_frames(pose_at);
        let gain = self.lenses.first_mut().map_or(1.0, |lens| lens.sensor.gain(stamp.seconds()));
        let people = |dt: &f64| {
            let passers = self.passers.iter().map(|p| p.figure(stamp.seconds() + dt));
            passers.chain(self.people.iter().copied()).collect()
        };
        let figures = times.iter().map(people).collect();
        let size = (self.config.camera.width, self.config.camera.height);
        let scene = Scene { pose_at, times, figures, things: &self.things, gain, size };
        let with_depth = self.config.sensor == SimSensor::Rgbd;
        let (mut images, mut depth) = (Vec::with_capacity(self.lenses.len()), None);
        if let Some((first, others)) = self.lenses.split_first_mut() {
            let scene = &scene;
            std::thread::scope(|scope| {
                let others: Vec<_> =
                    others.iter_mut().map(|lens| scope.spawn(move || lens.see(scene, false).0)).collect();
                let (image, d) = first.see(scene, with_depth);
                images.push(Arc::new(image));
                depth = d;
                for other in others {
                    match other.join() {
                        Ok(image) => images.push(Arc::new(image)),
                        Err(panic) => std::panic::resume_unwind(panic),
                    }
                }
            });
        }
        let decode_ms = begin.elapsed().as_secs_f64() * 1e3;
        FramePacket { stamp, images, depth: depth.map(Arc::new), imu: Vec::new(), decode_ms }
    }

    /// Times of the sub-frames in seconds from the stamp: an odd number, about one for each 1.5 pixels of motion.
    fn sub_frames(&self, pose_at: &(dyn Fn(f64) -> Se3 + Sync)) -> Vec<f64> {
        let blur = self.config.effects.blur_s;
        if blur <= 0.0 {
            return vec![0.0];
        }
        let moved = pose_at(-blur / 2.0).local(&pose_at(blur / 2.0));
        let pixels =
            self.config.camera.fx * (moved.fixed_rows::<3>(3).norm() + moved.fixed_rows::<3>(0).norm() / 1.5);
        let most = self.config.effects.blur_frames.clamp(1, 64);
        let n = ((pixels / 1.5).ceil() as usize).clamp(1, most) | 1;
        (0..n).map(|i| blur * ((i as f64 + 0.5) / n as f64 - 0.5)).collect()
    }
}

/// People who walk to and fro beside the straight legs of the world's first route.
fn passers(world: &World, count: usize, seed: u64) -> Vec<Passer> {
    let mut random = cairn_random::Random::stream(seed, 0x9A55);
    let Some(route) = world.routes().first() else { return Vec::new() };
    let legs: Vec<_> = route.points.windows(2).filter(|w| (w[1] - w[0]).norm() > 2.0).collect();
    if legs.is_empty() {
        return Vec::new();
    }
    (0..count)
        .map(|i| {
            let leg = legs[random.below(legs.len())];
            let d = (leg[1] - leg[0]).normalize();
            let side = cairn_geometry::Vec2::new(-d.y, d.x) * if random.chance(0.5) { 0.62 } else { -0.62 };
            Passer {
                line: vec![leg[0] + side, leg[1] + side],
                speed: random.uniform(0.7, 1.4),
                start: random.uniform(0.0, 30.0),
                clothes: i,
            }
        })
        .collect()
}
