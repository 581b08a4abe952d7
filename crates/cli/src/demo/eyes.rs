//! The eyes of the demo: images rendered from where the walker truly is, and the engine that sees nothing else.
//!
//! In: the camera's true pose, frame by frame. Out: what the engine says. The truth is kept aside for the figures.

use crate::failure::Failure;
use cairn_atlas::{KeyFrameId, Map};
use cairn_engine::{Config, Engine, Output, Runner, SensorMode, record_input};
use cairn_eval::StageTimes;
use cairn_geometry::{Se3, Sim3, Trajectory};
use cairn_guide::{Anchor, RecordInput};
use cairn_sensor::Stamp;
use cairn_sim::{LiveRig, SimSensor, SimSetting};
use std::time::Instant;

/// A rig, an engine, and what is measured on the way.
pub struct Eyes {
    live: LiveRig,
    engine: Engine,
    /// True poses of the camera, one for each frame.
    pub truth: Trajectory,
    /// Milliseconds of each frame: "render", "see", "track", "step" (image to pose), "map" (of each key frame).
    pub times: StageTimes,
    /// Milliseconds from image to pose of each frame.
    pub step_ms: Vec<f64>,
    /// Stretches without a pose after the first one: seconds at which they begin, and frames.
    pub lost: Vec<(f64, usize)>,
    /// Whether the last frame had a pose; `None` before the first pose.
    seeing: Option<bool>,
}

impl Eyes {
    /// Eyes in a world; the sensors of the setting are the sensors of the engine.
    pub fn new(setting: &SimSetting) -> Result<Self, Failure> {
        let live = LiveRig::new(setting)?;
        let mode = match setting.sensor {
            SimSensor::Mono => SensorMode::Mono,
            SimSensor::Stereo => SensorMode::Stereo,
            SimSensor::Rgbd => SensorMode::Rgbd,
        };
        let engine = Engine::new(live.rig(), mode, setting.rate_hz, Runner::Lockstep, &Config::default())
            .map_err(|e| Failure::new("the rig of the demo", e.to_string(), "choose another --sensor"))?;
        Ok(Self {
            live,
            engine,
            truth: Trajectory::new(),
            times: StageTimes::new(),
            step_ms: Vec::new(),
            lost: Vec::new(),
            seeing: None,
        })
    }

    /// Looks once; gives the engine's pose as the recorder takes it.
    pub fn see(&mut self, stamp: Stamp, world_from_camera: &Se3) -> Result<RecordInput, Failure> {
        let begin = Instant::now();
        let packet = self.live.packet(stamp, world_from_camera)?;
        self.times.add("render", begin.elapsed());
        let fail = |why: String| Failure::new("the demo", why, "report this with the command line");
        self.truth.push(stamp.0, *world_from_camera).map_err(|e| fail(e.to_string()))?;
        let output = self.engine.on_packet(&packet).map_err(|e| fail(e.to_string()))?;
        if let Some(why) = &output.died {
            return Err(fail(format!("mapping died: {why}")));
        }
        self.note(&output);
        Ok(record_input(&output))
    }

    fn note(&mut self, output: &Output) {
        self.times.add_ms("see", output.see_ms);
        self.times.add_ms("track", output.track_ms);
        self.times.add_ms("step", output.see_ms + output.track_ms);
        self.step_ms.push(output.see_ms + output.track_ms);
        for ms in &output.map_ms {
            self.times.add_ms("map", *ms);
        }
        let seeing = output.placed.is_some();
        match (self.seeing, seeing) {
            (Some(true), false) => self.lost.push((output.stamp.seconds(), 1)),
            (Some(false), false) => self.lost.iter_mut().last().into_iter().for_each(|l| l.1 += 1),
            _ => {}
        }
        if seeing || self.seeing.is_some() {
            self.seeing = Some(seeing);
        }
    }

    /// The world that is seen.
    pub fn world(&self) -> &cairn_sim::World {
        self.live.world()
    }

    /// The map that the engine has made so far.
    pub fn map(&self) -> std::sync::Arc<Map> {
        self.engine.map()
    }

    /// Poses of the camera for every tracked frame, as the map sees them now.
    pub fn estimate(&mut self) -> Result<Trajectory, Failure> {
        for ms in self.engine.finish().map_ms {
            self.times.add_ms("map", ms);
        }
        let poses = self.engine.trajectory().into_iter().map(|(t, p)| (t.0, p)).collect();
        Trajectory::from_unsorted(poses)
            .map_err(|e| Failure::new("the demo", e.to_string(), "report this with the command line"))
    }
}

/// Where a key frame that a way hangs on stands in the map, with its unit of length.
pub fn standing(map: &Map, anchor: Anchor) -> Option<Sim3> {
    map.world_from_here(KeyFrameId::from_index(anchor.seq as usize)?)
}
