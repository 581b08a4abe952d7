//! The recording of a run: what every frame adds, and how often the map is drawn again.
//!
//! Each map of the atlas is an entity `map<N>` of its own, N being its first key frame, because the frames of two maps have
//! nothing in common; so is each segment of the odometry (`odom<N>`). A map that was merged into another is emptied.

use super::pipe::{Pipe, pose, similarity, single};
use super::shown::{self, MapView};
use crate::commands::run::sink::{Ended, Frame, Processed, Sink};
use crate::failure::Failure;
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_engine::{DenseMapper, Engine, FramePose, Output, Phase};
use cairn_rerun::{Colour, Level, Show};
use cairn_sensor::{Camera, Rig, Stamp};
use cairn_session::{Event, Session, anchor_in_map};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Seconds between images.
const IMAGE_STEP_S: f64 = 0.2;
/// The map is drawn again after this many seconds, and after this share of the run so far: so all drawings together are about
/// eleven times the last one, however long the run is.
const MAP_STEP_S: f64 = 5.0;
const MAP_STEP_SHARE: f64 = 0.1;

/// The recording while the run goes on.
pub struct Scene {
    to: Pipe,
    camera: Camera,
    frames: usize,
    first: Option<Stamp>,
    last: Stamp,
    image_at: Option<Stamp>,
    map_at: Option<Stamp>,
    phase: Option<Phase>,
    current: Option<MapId>,
    maps: BTreeSet<MapId>,
    submaps: BTreeMap<MapId, usize>,
}

impl Scene {
    /// Begins the recording if one is requested.
    ///
    /// # Errors
    /// When the program that writes it is not installed or cannot be started.
    pub fn begin(path: Option<&Path>, rig: &Rig, name: &str) -> Result<Option<Self>, Failure> {
        let (Some(path), Some(first)) = (path, rig.cameras.first()) else { return Ok(None) };
        Ok(Some(Self {
            to: Pipe::begin(path, name)?,
            camera: first.camera,
            frames: 0,
            first: None,
            last: Stamp::default(),
            image_at: None,
            map_at: None,
            phase: None,
            current: None,
            maps: BTreeSet::new(),
            submaps: BTreeMap::new(),
        }))
    }

    fn add(&mut self, here: &Processed, done: &Output) {
        let stamp = done.stamp;
        self.last = stamp;
        let first = *self.first.get_or_insert(stamp);
        self.to.at(stamp.0, self.frames);
        self.frames += 1;
        self.events(done);
        self.to.show("numbers/features", Show::Number(done.frame.len() as f64));
        self.to.show("numbers/extract_ms", Show::Number(done.timings.extract_ms));
        self.to.show("numbers/track_ms", Show::Number(done.timings.track_ms));
        let snapshot = here.session.engine().snapshot();
        let map = done.pose.as_ref().and_then(|pose| shown::map_of(&snapshot, pose.anchored.reference));
        self.current = map.or(self.current);
        self.poses(done, map);
        let due = |last: Option<Stamp>, step_s: f64| last.is_none_or(|last| stamp - last >= step_s);
        if let Some(image) = here.packet.images.first().filter(|_| due(self.image_at, IMAGE_STEP_S)) {
            self.image_at = Some(stamp);
            // What the camera sees is shown without a pose too: in the map of the last one, and beside any map before.
            let below = self.current.map_or("image".into(), |map| format!("{}/cam0/image", shown::root(map)));
            let size = [image.width() as u32, image.height() as u32];
            self.to.show(&below, Show::Image { size, gray: image.data().to_vec() });
            let pixels = Show::Pixels(done.frame.raw.clone(), Colour::GREEN);
            self.to.show(format!("{below}/features"), pixels);
        }
        if due(self.map_at, MAP_STEP_S.max(MAP_STEP_SHARE * (stamp - first))) {
            self.map_at = Some(stamp);
            self.maps(here.session, &snapshot, here.dense);
        }
    }

    fn events(&mut self, done: &Output) {
        for event in &done.status.events {
            self.to.show("events", Show::Text(Level::Info, event.to_string()));
        }
        if let Some(cause) = done.stage_failed() {
            self.to.show("events", Show::Text(Level::Warning, cause.to_owned()));
        }
        if self.phase.replace(done.status.phase) != Some(done.status.phase) {
            self.to.show("events", Show::Text(Level::Info, done.status.phase.to_string()));
        }
    }

    /// The poses of body and camera in their map, and of the body in the odometry frame.
    fn poses(&mut self, done: &Output, map: Option<MapId>) {
        let Some(FramePose { world_from_body, odometry, anchored, .. }) = &done.pose else { return };
        if let Some(map) = map {
            self.enter(map);
            let root = shown::root(map);
            self.to.show(format!("{root}/body"), pose(&world_from_body.se3));
            self.to.show(format!("{root}/cam0"), pose(&anchored.world_from_camera));
            self.to.show(format!("{root}/odom"), similarity(&odometry.world_from_odom.sim3));
        }
        let entity = format!("odom{}/body", odometry.segment);
        self.to.show(entity, pose(&odometry.odom_from_body.se3));
    }

    /// The lens of the camera, in a map that is new.
    fn enter(&mut self, map: MapId) {
        if self.maps.insert(map) {
            let c = &self.camera;
            let lens = Show::Lens {
                size: [c.width as u32, c.height as u32],
                focal: [c.fx as f32, c.fy as f32],
                centre: [c.cx as f32, c.cy as f32],
            };
            self.to.show(format!("{}/cam0/image", shown::root(map)), lens);
        }
    }

    /// Draws every map, and empties those that were merged into others.
    fn maps(&mut self, session: &Session, snapshot: &Snapshot, dense: Option<&DenseMapper>) {
        let existing: BTreeSet<MapId> = snapshot.maps().map(|(map, _)| map).collect();
        for gone in self.maps.difference(&existing).copied().collect::<Vec<_>>() {
            self.draw(gone, MapView::default(), None);
            self.maps.remove(&gone);
        }
        let mut paths = paths(session.engine(), snapshot);
        for map in existing {
            self.enter(map);
            let path = paths.remove(&map).unwrap_or_default();
            self.draw(map, MapView::of(snapshot, map, path), Some(snapshot.is_gravity_aligned(map)));
        }
        if let (Some(route), Some(map)) = (session.route(), self.current) {
            let placed = route.resolve(|a| anchor_in_map(snapshot, a));
            let line = placed.iter().map(|p| single(&p.frame_from_camera.translation)).collect();
            self.to.show(format!("{}/route", shown::root(map)), Show::Lines(vec![line], Colour::ORANGE));
        }
        if let Some(dense) = dense {
            shown::submaps(&mut self.to, dense, &mut self.submaps, snapshot);
        }
        for (segment, line) in session.engine().odometry_segments().into_iter().enumerate() {
            let line = line.iter().map(|(_, pose)| single(&pose.translation)).collect();
            self.to.show(format!("odom{segment}/trajectory"), Show::Lines(vec![line], Colour::BLUE));
        }
        self.to.show("numbers/landmarks", Show::Number(snapshot.landmark_count() as f64));
        self.to.show("numbers/key_frames", Show::Number(snapshot.key_frame_count() as f64));
    }

    fn draw(&mut self, map: MapId, view: MapView, z_is_up: Option<bool>) {
        let root = shown::root(map);
        if let Some(z_is_up) = z_is_up {
            self.to.show(&root, Show::Axes { z_is_up });
        }
        let below = |name: &str| format!("{root}/{name}");
        self.to.show(below("points"), Show::Points(view.points, Colour::GREY));
        self.to.show(below("key_frames"), Show::Points(view.key_frames, Colour::BLUE));
        self.to.show(below("spanning_tree"), Show::Lines(view.tree, Colour::BLUE));
        self.to.show(below("loops"), Show::Lines(view.loops, Colour::RED));
        self.to.show(below("trajectory"), Show::Lines(view.path, Colour::GREEN));
    }
}

impl Sink for Scene {
    fn frame(&mut self, frame: &Frame) {
        if let Some((here, done)) = frame.output() {
            self.add(here, done);
        }
    }

    fn event(&mut self, event: &Event) {
        let Event::Said(said) = event else { return };
        self.to.at(said.stamp.0, self.frames);
        let level = if said.priority == 0 { Level::Warning } else { Level::Info };
        self.to.show("said", Show::Text(level, said.text.clone()));
    }

    /// Draws the final map.
    fn end(mut self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        if let Some(here) = ended.run.here() {
            let snapshot = here.session.engine().snapshot();
            self.to.at(self.last.0, self.frames);
            self.maps(&here.session, &snapshot, here.dense.as_ref());
        }
        self.to.end()
    }
}

/// The corrected positions of the body by map: a line for each stretch of frames that follow each other in one map.
fn paths(engine: &Engine, snapshot: &Snapshot) -> BTreeMap<MapId, Vec<Vec<[f32; 3]>>> {
    let reference: BTreeMap<Stamp, KeyFrameId> =
        engine.log().frames().iter().filter_map(|f| Some((f.stamp, f.anchored?.reference))).collect();
    let mut lines: BTreeMap<MapId, Vec<Vec<[f32; 3]>>> = BTreeMap::new();
    let mut before = None;
    for (stamp, pose) in engine.trajectory() {
        let Some(map) = reference.get(&stamp).and_then(|k| shown::map_of(snapshot, *k)) else { continue };
        let of_map = lines.entry(map).or_default();
        if before != Some(map) {
            of_map.push(Vec::new());
        }
        before = Some(map);
        if let Some(line) = of_map.last_mut() {
            line.push(single(&pose.translation));
        }
    }
    lines
}
