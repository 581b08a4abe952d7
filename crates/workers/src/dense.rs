//! The process of surfaces: the journal of the map and the depth of its key frames in, a surface and the depth of the saved map
//! out.
//!
//! It keeps nothing that is not in the files of the run, and nobody waits for it before the end: one that is killed or hangs is
//! started again and goes on from the same changes, while SLAM and the guide hear nothing of it.

use crate::depth_log::{DepthTail, KeyFrameDepth};
use crate::journal::{JournalError, Tail};
use crate::message::{Failure, Finished, Opened, Order, Report, first_order, read, write};
use crate::mode_of;
use crate::shown::Shown;
use crate::slam::FINAL_MAP;
use cairn_atlas::store::{DepthPart, MapFile, Place, SavedDepth};
use cairn_atlas::{Change, Feed, KeyFrameId, Published, Snapshot};
use cairn_dense::{ColumnChanges, PackedDepth, PackedGray, SubmapConfig, SurfaceChanges};
use cairn_engine::{DenseMapper, DenseSetupError, SensorMode, has_colours};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{DepthSensor, Rig};
use std::collections::{BTreeMap, VecDeque};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The surface at the end of the run, in the journal's folder.
pub const SURFACE: &str = "surface";
/// Work between two answers takes about so long.
const SLICE: Duration = Duration::from_millis(200);
/// Pages are told what has changed so often.
const SHOW_EVERY: Duration = Duration::from_millis(500);
/// Images that are fused again between two looks at the clock.
const FUSED_AGAIN: usize = 4;
/// Tiles of columns that are looked at each time, at most.
const TILES: usize = 12;

/// What is asked of the process.
pub struct Work<S> {
    /// How submaps are made.
    pub config: SubmapConfig,
    /// Depth of the map that the run began in; it goes on from it.
    pub saved: Vec<DepthPart>,
    /// The bytes of a surface's file, for a map that is aligned with gravity or not; `None` where none is wanted.
    pub surface: Option<S>,
}

/// Runs until the surface is written or the supervisor is gone. `open` says what to do.
pub fn run<F, S>(mut from: impl Read, mut to: impl Write, open: F)
where
    F: FnOnce() -> Result<Work<S>, Failure>,
    S: FnMut(&mut DenseMapper, bool) -> Result<Vec<u8>, Failure>,
{
    let Some(Order::Map { folder, opened, start, .. }) = first_order(&mut from, &mut to) else { return };
    let said = open()
        .and_then(|work| Dense::new(&folder, &opened, start, work))
        .and_then(|d| d.work(&mut from, &mut to));
    if let Err(why) = said {
        // Without a supervisor there is nobody to tell.
        let _ = write(&mut to, &Report::Failed(why));
    }
}

struct Dense<S> {
    folder: PathBuf,
    rig: Rig,
    work: Work<S>,
    /// `None` until SLAM has begun its journal.
    following: Option<Following>,
    /// Number of this process among those that made surfaces, and how often it has begun to follow the journal.
    start: u64,
    begun: u32,
}

/// The map as far as it was followed.
struct Following {
    tail: Tail,
    feed: Feed,
    depth: DepthTail,
    mapper: DenseMapper,
    /// Commits that were read and are not followed yet.
    commits: VecDeque<Published>,
    /// Depth of key frames that are still to come.
    ahead: BTreeMap<KeyFrameId, KeyFrameDepth>,
    /// Key frames whose depth is superfluous, once all commits that were read are followed.
    spare: Vec<KeyFrameId>,
    /// Depth of the saved map that is of another camera: saved as it is.
    others: Vec<DepthPart>,
    /// Images that it began with.
    restored: usize,
    /// Where the newest key frame was when it was added.
    newest: Vec3,
    /// What pages know, and when they were told.
    changes: SurfaceChanges,
    columns: ColumnChanges,
    told: Option<Instant>,
}

impl<S> Dense<S>
where
    S: FnMut(&mut DenseMapper, bool) -> Result<Vec<u8>, Failure>,
{
    fn new(folder: &Path, opened: &Opened, start: u64, work: Work<S>) -> Result<Self, Failure> {
        let rig = crate::rig_of(folder, opened)?;
        let (mode, _) = mode_of(&opened.sensor)?;
        if rig.depth.is_none() || mode != SensorMode::Rgbd {
            let cure = "give a source with depth and --sensor rgbd";
            return Err(Failure::new("surfaces", "the run has no depth sensor", cure));
        }
        if work.config.tsdf.colour && !has_colours(&rig) {
            return Err(Failure::new("surfaces", DenseSetupError::NoColours, "leave out --colour"));
        }
        Ok(Self { folder: folder.to_owned(), rig, work, following: None, start, begun: 0 })
    }

    /// `Ok` when all is done or the supervisor is gone.
    fn work(mut self, from: &mut impl Read, to: &mut impl Write) -> Result<(), Failure> {
        self.follow(SLICE)?;
        let key_frames = self.following.as_ref().map_or(0, |f| f.restored + f.mapper.counts().key_frames);
        let mut reports = vec![Report::Ready { key_frames, version: 0 }];
        loop {
            for report in reports.drain(..) {
                if write(to, &report).is_err() {
                    return Ok(());
                }
            }
            match read(from) {
                Ok(Some(Order::Ping)) => {
                    reports.extend(self.follow(SLICE)?.then_some(Report::Followed));
                    reports.push(Report::Pong);
                }
                Ok(Some(Order::Show { columns })) => reports.extend(self.show(columns)),
                Ok(Some(Order::End)) => reports.push(self.end()?),
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => return Ok(()),
            }
        }
    }

    /// Follows what was written since, for about as long as this; false where some is left.
    fn follow(&mut self, limit: Duration) -> Result<bool, Failure> {
        let failed = |e: JournalError| Failure::new("the journal of the map", e, "run without --isolated");
        if self.following.is_none() {
            let Some(tail) = Tail::open(&self.folder).map_err(failed)? else { return Ok(true) };
            self.following = Some(self.begin(tail).map_err(failed)??);
            self.begun += 1;
        }
        let Some(following) = &mut self.following else { return Ok(true) };
        let commits = &mut following.commits;
        if !following.tail.follow_each(|commit| commits.push_back(commit)).map_err(failed)? {
            // The journal was cut off behind this reader: from the newer base on.
            self.following = None;
            return self.follow(limit);
        }
        for depth in following.depth.follow().map_err(failed)? {
            if depth.is_spare() {
                following.spare.push(depth.id);
                continue;
            }
            // Its number may have been that of another, which was never committed.
            following.spare.retain(|id| *id != depth.id);
            following.ahead.insert(depth.id, depth);
        }
        Ok(following.apply(Instant::now() + limit))
    }

    /// Fuses again what has moved, and tells what has changed since pages were told; at first only once all of it is there.
    fn show(&mut self, with_columns: bool) -> Vec<Report> {
        let Some(f) = self.following.as_mut().filter(|f| f.commits.is_empty()) else { return Vec::new() };
        let until = Instant::now() + SLICE;
        while f.mapper.step(&f.newest, FUSED_AGAIN).waiting > 0 {
            if Instant::now() > until {
                if f.told.is_none() {
                    return Vec::new();
                }
                break;
            }
        }
        if f.told.is_some_and(|at| at.elapsed() < SHOW_EVERY) {
            return Vec::new();
        }
        f.told = Some(Instant::now());
        // No submap has the number that one had which was made before it from the same depth.
        let first = (self.start as u32 & 0xff) << 24 | (self.begun & 0xff) << 16;
        let mut change = f.changes.of(f.mapper.map());
        if with_columns {
            let is_level = f.tail.map().is_gravity_aligned_throughout();
            let up = if is_level { Vec3::z() } else { -Vec3::y() };
            // A map that is too high for columns is shown without.
            change.columns = f.columns.of(f.mapper.map(), None, &up, &f.newest, TILES).unwrap_or_default();
        }
        Shown::messages(change, first).into_iter().map(Report::Shown).collect()
    }

    /// Begins at the map as it is now, with the depth of all its key frames.
    fn begin(&self, tail: Tail) -> Result<Result<Following, Failure>, JournalError> {
        let map = Arc::new(tail.map().clone());
        let mut depth = DepthTail::new(&self.folder);
        let mut ahead: BTreeMap<_, _> = depth.follow()?.into_iter().map(|d| (d.id, d)).collect();
        // Removed ones too: their depth is anchored to their parents.
        let here = ahead.keys().filter(|id| map.surviving_ancestor(**id).is_some()).copied();
        let here: Vec<KeyFrameId> = here.collect();
        let is_its = |d: &KeyFrameDepth| map.key_frame(d.id).is_none_or(|k| k.stamp == d.stamp);
        let here = here.into_iter().filter_map(|id| ahead.remove(&id)).filter(is_its).collect();
        let Some(DepthSensor { camera, metres_per_unit, body_from_depth, .. }) = self.rig.depth else {
            return Ok(Err(Failure::new("surfaces", "the run has no depth sensor", "give one with depth")));
        };
        let camera_from_depth = tail.file().about.camera.body_from_camera.inverse() * body_from_depth;
        let (feed, from) = Feed::new(map.clone());
        let following =
            DenseMapper::following(from, camera, metres_per_unit, camera_from_depth, self.work.config);
        let mut mapper = match following {
            Ok(mapper) => mapper,
            Err(e) => return Ok(Err(Failure::new("surfaces", e, "correct the depth sensor with --rig"))),
        };
        let (restored, others) = mapper.restore(self.work.saved.clone());
        let template = |submap| DepthPart { camera, metres_per_unit, submap, images: Vec::new() };
        let own = submaps(&map, here, camera_from_depth, self.work.config.reach_m, &template);
        let restored = restored.images + mapper.restore_own(own).0.images;
        let (commits, spare) = (VecDeque::new(), Vec::new());
        let (newest, told) = (Vec3::zeros(), None);
        let (changes, columns) = (SurfaceChanges::new(), ColumnChanges::new());
        let following = Following {
            tail,
            feed,
            depth,
            mapper,
            commits,
            ahead,
            spare,
            others,
            restored,
            newest,
            changes,
            columns,
            told,
        };
        Ok(Ok(following))
    }

    /// Writes the depth into the final map, and the surface.
    fn end(&mut self) -> Result<Report, Failure> {
        while !self.follow(SLICE)? {}
        let none = || Failure::new("surfaces", "there is no map", "look at the report of the run");
        let following = self.following.as_mut().ok_or_else(none)?;
        let path = self.folder.join(FINAL_MAP);
        let failed = |e: &dyn std::fmt::Display| Failure::new("the map", e, "free some shared memory");
        let mut file = MapFile::load(&path).map_err(|e| failed(&e))?;
        // That of a process before this one, which died after it had written it.
        file.take_depth().map_err(|e| failed(&e))?;
        file.add_depth(&following.others);
        file.add_depth(&following.mapper.to_save(&file.snapshot));
        file.save(&path).map_err(|e| failed(&e))?;
        if let Some(surface) = &mut self.work.surface {
            let bytes = surface(&mut following.mapper, file.snapshot.is_gravity_aligned_throughout())?;
            let path = self.folder.join(SURFACE);
            let written = std::fs::write(&path, bytes);
            written.map_err(|e| Failure::new("the surface", e, "free some shared memory"))?;
        }
        Ok(Report::Finished(Finished::default()))
    }
}

impl Following {
    /// Follows the commits until `until`; false where some are left.
    fn apply(&mut self, until: Instant) -> bool {
        while let Some(commit) = self.commits.pop_front() {
            for change in &commit.changes {
                let Change::AddKeyFrame(k) = change else { continue };
                self.newest = k.world_from_camera.translation;
                // What is of earlier numbers is of no key frame.
                let later = self.ahead.split_off(&k.id);
                self.ahead = later;
                let depth = self.ahead.remove(&k.id).filter(|d| d.stamp == k.stamp);
                let (camera, _) = self.mapper.map().camera();
                let [width, height] = [camera.width, camera.height];
                let Some(depth) = depth else { continue };
                let gray = PackedGray::from_bytes(width, height, depth.gray.clone());
                let gray = if depth.gray.is_empty() { None } else { gray.unpack().ok() };
                if let Ok(image) = PackedDepth::from_bytes(width, height, depth.packed).unpack() {
                    self.mapper.offer(k.stamp, Arc::new(image), gray.map(Arc::new));
                }
            }
            self.feed.put(commit);
            self.mapper.follow();
            if Instant::now() > until {
                break;
            }
        }
        let has_all = self.commits.is_empty();
        if has_all {
            self.spare.drain(..).for_each(|id| self.mapper.forget(id));
        }
        has_all
    }
}

/// Depth of key frames as submaps: each goes into the first whose origin is within reach.
fn submaps(
    map: &Snapshot,
    depth: Vec<KeyFrameDepth>,
    camera_from_depth: Se3,
    reach_m: f64,
    template: &dyn Fn(Place) -> DepthPart,
) -> Vec<DepthPart> {
    let mut parts: Vec<(Se3, cairn_atlas::MapId, DepthPart)> = Vec::new();
    for d in depth.into_iter().filter(|d| !d.packed.is_empty()) {
        let in_map = map.surviving_ancestor(d.id).and_then(|(id, _)| Some(map.key_frame(id)?.map));
        let at = map.resolve(d.id, &camera_from_depth);
        let (Some(in_map), Some(at)) = (in_map, at) else { continue };
        let place = Place { key_frame: map.key_frame_name(d.id), key_frame_from_it: camera_from_depth };
        let image = SavedDepth { place, packed: d.packed, gray: d.gray };
        let is_near = |(origin, of, _): &&mut (Se3, _, _)| {
            *of == in_map && (origin.translation - at.translation).norm() <= reach_m
        };
        match parts.iter_mut().find(is_near) {
            Some((_, _, part)) => part.images.push(image),
            None => parts.push((at, in_map, DepthPart { images: vec![image], ..template(place) })),
        }
    }
    parts.into_iter().map(|(_, _, part)| part).collect()
}
