//! Dense mapping beside the sparse one: the depth of key frames goes into submaps that follow every change of the map.
//!
//! In: depth images of the frames that may become key frames, and the stream of changes ([`crate::Engine::subscribe`]).
//! Out: a [`DenseMap`] whose submaps are where the map's key frames are. A loop, a merge or a new unit of length moves
//! submaps as soon as the change is read; key frames that moved inside their submap are fused again by
//! [`DenseMapper::step`], in slices that the caller bounds. The caller decides when that happens.
//!
//! A camera that is lost is looked for in the submaps by the shape of what it sees (`lost.rs`, `search.rs`), on a thread of its
//! own where the engine has threads.

mod lost;
mod offered;
mod saved;
mod search;
mod spare;

pub use offered::{Offered, OfferedDepth};
pub use saved::{Restored, SavedDepthError, saved_dense_map};
pub use search::{RefusedAttempts, SearchCounts};
pub use spare::Views;

use crate::sensors::has_colours;
use crate::{Engine, Output};
use cairn_atlas::{Change, KeyFrameId, MapId, Mirror, Published, Subscription};
use cairn_dense::{
    AnchorId, DenseError, DenseMap, Located, MapId as DenseMapId, Mesh, MeshConfig, Place, Progress,
    RegisterConfig, SubmapConfig, TsdfConfig,
};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{Camera, DepthImage, FramePacket, GrayImage, Rig, Stamp};
use cairn_tracking::State;
use lost::LostCamera;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::TryRecvError;

/// Why a dense mapper cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DenseSetupError {
    /// The rig has no depth sensor, or the engine does not use it.
    #[error("surfaces need depth: the engine runs without a depth sensor")]
    NoDepth,
    /// No image shows the pixels of the depth.
    #[error(
        "surfaces have colours only where the depth is registered to the first camera, with its size and lens"
    )]
    NoColours,
    /// Mapping has failed before.
    #[error("mapping is not running")]
    NoMapping,
    /// The search for a lost camera cannot begin; why.
    #[error("a lost camera cannot be looked for: {0}")]
    NoThread(String),
    /// The depth camera or the config cannot be used.
    #[error(transparent)]
    Dense(#[from] DenseError),
}

/// Counts of what a dense mapper did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DenseCounts {
    /// Key frames whose depth was fused.
    pub key_frames: usize,
    /// Key frames without depth: it was not offered, or too little of it was valid.
    pub without_depth: usize,
    /// Key frames that were removed from the map, whose depth is anchored to their parents now.
    pub removed: usize,
    /// Those of them whose depth was dropped, since enough others look at the same from near by.
    pub spare: usize,
    /// Maps that were merged into another.
    pub merges: usize,
    /// Changes that could not be followed, such as a pose that is not finite.
    pub refused: usize,
}

/// Submaps that follow the engine's map.
pub struct DenseMapper {
    map: DenseMap,
    mirror: Mirror,
    from: Subscription,
    camera_from_depth: Se3,
    offered: OfferedDepth,
    /// The depth is registered to the first camera's image, which has its colours.
    has_colours: bool,
    /// Key frames that moved since the dense map was last aligned.
    moved: BTreeMap<KeyFrameId, Se3>,
    counts: DenseCounts,
    /// Drops the depth of removed key frames that others make superfluous; `None` where somebody else decides.
    views: Option<Views>,
    /// The stream has ended: mapping is gone.
    ended: bool,
    /// Looks for the engine's camera when it is lost.
    lost: Option<LostCamera>,
}

/// Images that are fused with each packet while the camera is lost, at most: no mapping takes that time then.
const FUSED_WHILE_LOST: usize = 16;

impl DenseMapper {
    /// A dense mapper that follows an engine from now on.
    ///
    /// # Errors
    /// [`DenseSetupError`] without a depth sensor or without mapping, for a config out of range, and for colours where no image
    /// shows the pixels of the depth.
    pub fn new(engine: &mut Engine, rig: &Rig, config: SubmapConfig) -> Result<Self, DenseSetupError> {
        let model = *engine.front_end().model();
        let sensor = rig.depth.as_ref().filter(|_| engine.mode == crate::SensorMode::Rgbd);
        let sensor = sensor.ok_or(DenseSetupError::NoDepth)?;
        let has_colours = has_colours(rig);
        if config.tsdf.colour && !has_colours {
            return Err(DenseSetupError::NoColours);
        }
        let from = engine.subscribe().ok_or(DenseSetupError::NoMapping)?;
        let camera_from_depth = model.body_from_camera.inverse() * sensor.body_from_depth;
        let mut all =
            Self::following(from, sensor.camera, sensor.metres_per_unit, camera_from_depth, config)?;
        (all.has_colours, all.views) = (has_colours, Some(Views::default()));
        let locator = all.map.locator(RegisterConfig::default())?;
        let (after_s, threaded) = (engine.find_by_depth_s, engine.mapping.is_threaded());
        let link = engine.depth_link();
        let lost = LostCamera::new(link, locator, camera_from_depth, after_s, threaded, &engine.host);
        all.lost = Some(lost.map_err(|e| DenseSetupError::NoThread(e.to_string()))?);
        Ok(all)
    }

    /// A dense mapper that follows a stream of changes: depth images of `camera` in units of `metres_per_unit`, mounted
    /// at `camera_from_depth` on the camera whose poses key frames have. The depth of removed key frames stays until it is told to
    /// [`DenseMapper::forget`] it.
    ///
    /// # Errors
    /// An invalid camera or config.
    pub fn following(
        from: Subscription,
        camera: Camera,
        metres_per_unit: f64,
        camera_from_depth: Se3,
        config: SubmapConfig,
    ) -> Result<Self, DenseSetupError> {
        let mut map = DenseMap::new(config, camera, metres_per_unit)?;
        let mirror = Mirror::of(&from.start);
        for (id, k) in mirror.key_frames() {
            map.add_anchor(anchor(id), dense_map(k.map), k.world_from_camera)?;
        }
        let (offered, moved, counts) = (OfferedDepth::default(), BTreeMap::new(), DenseCounts::default());
        let (ended, has_colours, lost) = (false, false, None);
        let views = None;
        Ok(Self {
            map,
            mirror,
            from,
            camera_from_depth,
            offered,
            has_colours,
            moved,
            counts,
            views,
            ended,
            lost,
        })
    }

    /// Takes the depth of a packet that the engine has processed, where its frame may become a key frame, and follows
    /// the changes of the map so far.
    pub fn on_packet(&mut self, packet: &FramePacket, output: &Output) {
        if let Some(depth) = packet.depth.as_ref().filter(|_| output.key_frame_requested) {
            let gray = packet.images.first().filter(|_| self.has_colours).cloned();
            self.offer(packet.stamp, depth.clone(), gray);
        }
        self.follow();
        self.look_for_camera(packet, matches!(output.state, State::Lost { .. }));
    }

    /// Looks for a lost camera, once it has been lost for the time that is set and the submaps are fused.
    fn look_for_camera(&mut self, packet: &FramePacket, is_lost: bool) {
        let Some(mut lost) = self.lost.take() else { return };
        // What a saved map brings, and what was released, is fused when it is needed; key frames that moved by centimetres can wait.
        self.map.want_all(is_lost);
        if is_lost && !self.map.is_complete() {
            self.map.step(&Vec3::zeros(), FUSED_WHILE_LOST);
        }
        if lost.is_due(packet.stamp, is_lost) && self.map.is_complete() {
            let gravity_aligned = lost.gravity_aligned();
            let maps: Vec<MapId> = self.mirror.maps().map(|(map, _)| map).collect();
            let places =
                |map: MapId| self.map.places(dense_map(map), gravity_aligned.contains(&map).then(Vec3::z));
            let places: Vec<Place> = maps.into_iter().flat_map(places).collect();
            lost.begin(places);
        }
        if let Some(depth) = packet.depth.as_ref().filter(|_| is_lost) {
            lost.see(packet.stamp, depth);
        }
        self.lost = Some(lost);
    }

    /// What the searches for a lost camera did.
    pub fn search_counts(&self) -> SearchCounts {
        self.lost.as_ref().map(LostCamera::counts).unwrap_or_default()
    }

    /// Takes the depth image of a frame that may become a key frame, and the gray image of the same pixels.
    pub fn offer(&mut self, stamp: Stamp, depth: Arc<DepthImage>, gray: Option<Arc<GrayImage>>) {
        self.offered.offer(Offered { stamp, depth, gray });
    }

    /// Follows all changes of the map so far; submaps are at their new poses afterwards.
    pub fn follow(&mut self) {
        while !self.ended {
            match self.from.changes.try_recv() {
                Ok(published) => self.take(&published),
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => self.ended = true,
            }
        }
        align(&mut self.map, &mut self.moved, &mut self.counts);
    }

    fn take(&mut self, published: &Published) {
        let Self { map, mirror, camera_from_depth, offered, moved, counts, views, .. } = self;
        mirror.take_with(published, |mirror, change, removal| match change {
            Change::AddKeyFrame(k) => {
                let Some(known) = mirror.key_frame(k.id) else { return };
                let seen = offered.take(k.stamp);
                let (id, in_map, pose) = (anchor(k.id), dense_map(known.map), known.world_from_camera);
                // Also of depth that is not usable: who only keeps the images does not know.
                if let (Some(_), Some(views)) = (&seen, views.as_mut()) {
                    views.add(k.id);
                }
                let fused = seen.is_some_and(|o| {
                    map.insert(id, in_map, pose, *camera_from_depth, &o.depth, o.gray.as_deref()).is_ok()
                });
                counts.key_frames += usize::from(fused);
                counts.without_depth += usize::from(!fused);
                if !fused {
                    counts.refused += usize::from(map.add_anchor(id, in_map, pose).is_err());
                }
            }
            Change::MoveKeyFrame(id, pose) => drop(moved.insert(*id, *pose)),
            Change::AlignGravity(of, _) | Change::Rescale(of, _) => {
                let all = mirror.key_frames().filter(|(_, k)| k.map == *of);
                moved.extend(all.map(|(id, k)| (id, k.world_from_camera)));
            }
            Change::Merge { from, into, into_from, .. } => {
                align(map, moved, counts);
                counts.merges += 1;
                counts.refused +=
                    usize::from(map.merge(dense_map(*from), dense_map(*into), into_from).is_err());
            }
            Change::RemoveKeyFrame(id) => {
                align(map, moved, counts);
                counts.removed += 1;
                let done = removal.map(|r| map.remove(anchor(*id), anchor(r.parent)));
                counts.refused += usize::from(!matches!(done, Some(Ok(()))));
                if views.as_mut().is_some_and(|views| views.drop_if_spare(*id, mirror)) {
                    forget(map, *id, counts);
                }
            }
            _ => {}
        });
    }

    /// Drops the depth of a key frame, which may have been removed, as [`DenseMap::forget`]; for who follows a stream of changes and decides itself
    /// ([`Views`]).
    pub fn forget(&mut self, id: KeyFrameId) {
        forget(&mut self.map, id, &mut self.counts);
    }

    /// Fuses key frames again that moved inside their submap, at most about `images` fusions, starting nearest to a place
    /// of the map's frame. One fusion is the cost of one image.
    pub fn step(&mut self, near: &Vec3, images: usize) -> Progress {
        self.map.step(near, images)
    }

    /// The submaps.
    pub fn map(&self) -> &DenseMap {
        &self.map
    }

    /// What was done so far.
    pub fn counts(&self) -> DenseCounts {
        self.counts
    }

    /// The map with the most key frames, the oldest of these: the one whose surface is worth writing.
    pub fn largest_map(&self) -> Option<MapId> {
        let count = |map: MapId| self.mirror.key_frames().filter(|(_, k)| k.map == map).count();
        self.mirror
            .maps()
            .map(|(map, _)| (count(map), map))
            .max_by_key(|(n, map)| (*n, std::cmp::Reverse(*map)))
            .map(|(_, map)| map)
    }

    /// Looks for a depth image in the submaps of a map by the shape of its surface alone, for a camera that is lost where no
    /// words are found: `world_from_source` is the pose of the camera whose poses key frames have. `up` is the direction
    /// against gravity in that camera, where it is known and the map is aligned with gravity (z up): then only yaw and
    /// position are looked for. Some 15 ms for each submap, on the caller's thread. A refused pose comes with the
    /// numbers; `None` for a map without depth.
    ///
    /// # Errors
    /// Depth that cannot be used, a direction that is not one.
    pub fn locate(
        &mut self,
        map: MapId,
        depth: &DepthImage,
        up: Option<Vec3>,
    ) -> Result<Option<Located>, DenseError> {
        let depth_from_camera = self.camera_from_depth.inverse();
        self.map.want_all(true);
        while !self.map.is_complete() && self.map.step(&Vec3::zeros(), FUSED_WHILE_LOST).images > 0 {}
        let places = self.map.places(dense_map(map), up.map(|_| Vec3::z()));
        self.map.want_all(false);
        let up = up.map(|up| depth_from_camera.rotation * up);
        let found = self.map.locator(RegisterConfig::default())?.locate(&places, depth, up)?;
        Ok(found.map(|l| Located { world_from_source: l.world_from_source * depth_from_camera, ..l }))
    }

    /// The surface of a map, fused from the stored depth with the poses that key frames have now: without seams. What only one of them saw
    /// is in it.
    ///
    /// # Errors
    /// A config out of range, poses out of range.
    pub fn surface(&mut self, map: MapId, config: TsdfConfig) -> Result<Mesh, DenseError> {
        self.map.surface(dense_map(map), config, MeshConfig::of_key_frames())
    }
}

/// Drops the depth of a key frame.
fn forget(map: &mut DenseMap, id: KeyFrameId, counts: &mut DenseCounts) {
    match map.forget(anchor(id)) {
        Ok(dropped) => counts.spare += usize::from(dropped),
        Err(_) => counts.refused += 1,
    }
}

/// Moves the anchors of key frames.
fn align(map: &mut DenseMap, moved: &mut BTreeMap<KeyFrameId, Se3>, counts: &mut DenseCounts) {
    if moved.is_empty() {
        return;
    }
    let all: Vec<(AnchorId, Se3)> =
        std::mem::take(moved).into_iter().map(|(id, p)| (anchor(id), p)).collect();
    counts.refused += usize::from(map.align(&all).is_err());
}

fn anchor(id: KeyFrameId) -> AnchorId {
    AnchorId(id.index() as u64)
}

fn dense_map(map: MapId) -> DenseMapId {
    DenseMapId(map.root().index() as u64)
}
