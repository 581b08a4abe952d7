//! The map as a value: its maps, key frames and landmarks, of a running [`crate::Slam`] or of a file.

use cairn_atlas::store::MapFile;
use cairn_atlas::{KeyFrame, Landmark, MapId, Snapshot};
use cairn_engine::Engine;
use cairn_geometry::{Body, Pose, Trajectory, World};
use cairn_guide::{Route, RouteError};
use cairn_session::Session;
use cairn_vision::RectifiedCamera;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Prefix of the names of routes attached to a saved map.
pub const ROUTE_PREFIX: &str = "way/";

/// One immutable version of the map; cloning is cheap. It may hold several maps, each in a frame of its own, until
/// a place that they share is recognised.
#[derive(Clone, Debug)]
pub struct Map {
    snapshot: Arc<Snapshot>,
    camera: RectifiedCamera,
}

impl Map {
    /// The latest map of an engine.
    pub fn of(engine: &Engine) -> Self {
        Self { snapshot: engine.snapshot(), camera: *engine.front_end().model() }
    }

    /// The map of a file.
    pub fn of_file(file: &MapFile) -> Self {
        Self { snapshot: Arc::new(file.snapshot.clone()), camera: file.about.camera }
    }

    /// All key frames and landmarks, as the engine sees them.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// The camera that the features are seen with: the rectified first camera of the rig.
    pub fn camera(&self) -> &RectifiedCamera {
        &self.camera
    }

    /// The maps, oldest first.
    pub fn maps(&self) -> impl Iterator<Item = MapId> {
        self.snapshot.maps().map(|(id, _)| id)
    }

    /// The map with the most key frames, the oldest of equally large ones.
    pub fn largest(&self) -> Option<MapId> {
        self.maps().min_by_key(|id| (Reverse(self.snapshot.key_frames_of(*id).count()), *id))
    }

    /// Whether lengths in a map are metres.
    pub fn is_metric(&self, map: MapId) -> bool {
        self.snapshot.is_metric_in(map, &self.camera)
    }

    /// The key frames of a map in order of creation, with the pose of the body.
    pub fn key_frames(&self, map: MapId) -> impl Iterator<Item = (&KeyFrame, Pose<World, Body>)> {
        let metric = self.is_metric(map);
        let body = move |k: &KeyFrame| {
            Pose::new(k.camera(&self.camera).world_from_body(&k.world_from_camera, metric))
        };
        self.snapshot.key_frames_of(map).map(move |k| (k, body(k)))
    }

    /// The landmarks of a map in order of creation.
    pub fn landmarks(&self, map: MapId) -> impl Iterator<Item = &Landmark> {
        // A landmark is observed from one map only.
        let map_of = |l: &Landmark| Some(self.snapshot.key_frame(l.observations.first()?.key_frame)?.map);
        self.snapshot.landmarks().filter(move |l| map_of(l) == Some(map))
    }

    /// The poses of the body at a map's key frames in order of time; of two with the same time, as several sessions
    /// may have, the older one.
    pub fn trajectory(&self, map: MapId) -> Trajectory {
        let mut poses: Vec<_> = self.key_frames(map).map(|(k, pose)| (k.stamp.0, pose.se3)).collect();
        poses.sort_by_key(|(t, _)| *t);
        let mut trajectory = Trajectory::new();
        for (t, pose) in poses {
            // A pose that is not later than the one before is rejected and left out.
            let _ = trajectory.push(t, pose);
        }
        trajectory
    }
}

/// The file to save: a session's map with what was attached to it before and the routes recorded in the session; `None`
/// while the map has no key frames.
pub fn map_file(session: &Session, attached: &BTreeMap<String, Vec<u8>>) -> Option<MapFile> {
    let mut attached = attached.clone();
    for (path, route) in session.recorded().filter(|(_, route)| !route.points.is_empty()) {
        let stem = path.and_then(Path::file_stem);
        let name = stem.map_or_else(|| "in memory".into(), |s| s.to_string_lossy().into_owned());
        // Serialising to memory does not fail.
        if let Ok(bytes) = route.to_bytes() {
            attached.insert(format!("{ROUTE_PREFIX}{name}"), bytes);
        }
    }
    let file = session.engine().to_save(concat!("cairn ", env!("CARGO_PKG_VERSION")), attached);
    (file.snapshot.key_frame_count() > 0).then_some(file)
}

/// The routes attached to a saved map by name, as bytes to write to a file and as a route, or why it is damaged.
pub fn routes_of(file: &MapFile) -> impl Iterator<Item = (&str, &[u8], Result<Route, RouteError>)> {
    file.attached.iter().filter_map(|(name, bytes)| {
        Some((name.strip_prefix(ROUTE_PREFIX)?, bytes.as_slice(), Route::read(bytes.as_slice())))
    })
}
