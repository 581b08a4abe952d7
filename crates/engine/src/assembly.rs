//! How an engine is put together: the stages for the sensors of a rig, around a front end and a map.

use crate::Config;
use crate::engine::Engine;
use crate::journal::Header;
use crate::mapping::{Mapping, Runner};
use crate::observers::{Observers, ScaleReport, StatusReport};
use crate::sensors::has_colours;
use crate::status::StatusTracker;
use cairn_atlas::Snapshot;
use cairn_geometry::Se3;
use cairn_mapping::{Closer, DepthViews, Mapper};
use cairn_sensor::{DepthSensor, Host, ImuSensor, Rig, RigError};
use cairn_tracking::Tracker;
use cairn_vision::{FrontEnd, RectifiedCamera, RegistrationCheck, SensorMode};

/// What an engine is made for.
#[derive(Clone, Copy)]
pub(crate) struct Setup<'a> {
    pub rig: &'a Rig,
    pub mode: SensorMode,
    pub rate_hz: f64,
    pub runner: Runner,
    pub config: &'a Config,
    pub host: &'a Host,
}

impl<'a> Setup<'a> {
    /// The depth sensor, where the mode uses one.
    fn depth(&self) -> Option<&'a DepthSensor> {
        self.rig.depth.as_ref().filter(|_| self.mode == SensorMode::Rgbd)
    }

    /// The IMU, where it is used.
    fn imu(&self) -> Option<&'a ImuSensor> {
        self.rig.imu.as_ref().filter(|_| self.config.inertial.enabled)
    }
}

impl Engine {
    /// An engine without a map, for packets at about `rate_hz`, with the clock and the threads of a host.
    ///
    /// # Errors
    ///
    /// [`RigError`] when the rig cannot serve the mode.
    pub fn new(
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
        host: &Host,
    ) -> Result<Self, RigError> {
        let front_end = FrontEnd::new(rig, mode, config.front_end_for(rig))?;
        let snapshot = Snapshot::with_octaves(front_end.octaves());
        Ok(Self::around(front_end, snapshot, Setup { rig, mode, rate_hz, runner, config, host }))
    }

    /// The stages around a front end and a map.
    pub(crate) fn around(front_end: FrontEnd, snapshot: Snapshot, setup: Setup) -> Self {
        let Setup { rig, mode, rate_hz, runner, config, host } = setup;
        let model = *front_end.model();
        let mut snapshot = snapshot.continued_by(config.robot);
        // Opened and checked before the first image rather than at it.
        cairn_vision::bow::Vocabulary::current();
        let mut stages = Stages::of(&setup, model);
        if let Some(sensor) = setup.depth() {
            stages = stages.with_depth(sensor, model.body_from_camera.inverse() * sensor.body_from_depth);
        }
        let period_s = setup.imu().map(|imu| 1.0 / imu.rate_hz);
        let status = StatusTracker::new(model.has_depth(), period_s, &snapshot);
        if let Some(imu) = setup.imu() {
            let stated = imu.body_from_imu.inverse() * model.body_from_camera;
            stages = stages.with_imu(imu, stated, config);
            let mount = config.inertial.mount(stated, snapshot.imu_from_camera());
            snapshot = snapshot.with_imu_from_camera(mount);
        }
        let Stages { tracker, mapper, closer, depth_views, .. } = stages;
        let registration = setup.depth().filter(|_| !config.tracker.dense);
        let registration = registration.and_then(|_| RegistrationCheck::of(rig));
        let scale = ScaleReport::new(model.has_depth());
        Self {
            front_end,
            tracker,
            mapping: Mapping::new(runner, mapper, closer, snapshot, host),
            observers: Observers::new(depth_views, scale, StatusReport::new(status)),
            mode,
            has_colours: has_colours(rig),
            registration,
            localize_only: false,
            find_by_depth_s: config.tracker.find_by_depth_s,
            header: Header::of(mode, rate_hz, rig, config),
            host: host.clone(),
        }
    }
}

/// Tracking, mapping and closing, not connected yet.
struct Stages {
    tracker: Tracker,
    mapper: Mapper,
    closer: Closer,
    /// Takes the depth of key frames, where it is aligned.
    depth_views: Option<DepthViews>,
    /// Poses stay where depth put them.
    hold_poses: bool,
}

impl Stages {
    /// For a camera alone.
    fn of(setup: &Setup, model: RectifiedCamera) -> Self {
        let Setup { rig, mode, rate_hz, config, .. } = *setup;
        let size = rig.cameras.first().map_or([0; 2], |c| [c.camera.width, c.camera.height]);
        let features = config.front_end_for(rig).orb.features;
        let tracker = Tracker::new(model, features, rate_hz, config.tracker).with_size(size);
        let mut mapper = config.mapper;
        if mode != SensorMode::Stereo {
            mapper.window.right_offset_sigma = 0.0;
        }
        mapper.window.hold_poses |= config.tracker.dense && mode == SensorMode::Rgbd;
        let hold_poses = mapper.window.hold_poses;
        let closer = Closer::new(model, config.closer, mapper.window);
        let mapper = Mapper::new(model, mapper);
        let closer = closer.with_motion_links(mapper.motion_links());
        Self { tracker, mapper, closer, depth_views: None, hold_poses }
    }

    fn with_depth(self, sensor: &DepthSensor, camera_from_depth: Se3) -> Self {
        let tracker = self.tracker.with_depth(sensor, camera_from_depth);
        // Poses that stay where depth put them are not aligned again.
        let views = if self.hold_poses { None } else { DepthViews::new(sensor, camera_from_depth) };
        let Some(views) = views else { return Self { tracker, ..self } };
        let mapper = self.mapper.with_depth_views(views.clone());
        let closer = self.closer.with_depth_views(views.clone());
        Self { tracker, mapper, closer, depth_views: Some(views), ..self }
    }

    fn with_imu(self, imu: &ImuSensor, imu_from_camera: Se3, config: &Config) -> Self {
        let inertial = config.inertial;
        Self {
            tracker: self.tracker.with_imu(imu, imu_from_camera),
            mapper: self.mapper.with_imu(imu, imu_from_camera, inertial),
            closer: self.closer.with_imu(imu, imu_from_camera, inertial),
            ..self
        }
    }
}
