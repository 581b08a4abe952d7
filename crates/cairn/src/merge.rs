//! Several saved maps in one: put into one file, and joined where they show the same places.

use crate::ROUTE_PREFIX;
use cairn_atlas::store::{MapFile, StoreError};
use cairn_atlas::{ChangeSet, CombineError, MapId, RobotId, Shift, Snapshot};
use cairn_engine::Config;
use cairn_guide::{Route, RouteError};
use cairn_mapping::{Adjust, Agreement, Closer, CloserConfig, MapComparison, MapJoin};
use cairn_vision::SensorMode;
use std::collections::BTreeMap;

/// Largest difference of the disparity corrections of two stereo maps that needs no note, pixels.
const RIGHT_OFFSET_PX: f64 = 0.05;

/// Nobody waits for the next frame while maps are joined: they are adjusted as a whole up to so many key frames, which is faster than
/// around each place where they meet.
pub(crate) const WHOLE_KEY_FRAMES: usize = 10_000;

/// By how much a map has to grow until it is adjusted as a whole again, while more maps may follow. What that takes is then a sum
/// of terms of which each is at least so many times the one before, whatever the number of maps; adjusted at each join it would grow with the
/// square of their number.
pub(crate) const GROWN: f64 = 1.5;

/// Why maps cannot be put into one file.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// There is none.
    #[error("there is no map to merge")]
    Empty,
    /// Its features cannot be compared with those of the first, or there are not enough ids.
    #[error("{name}: does not fit the first map: {why}")]
    CombineError {
        /// Which, as it was given.
        name: String,
        /// What differs, with both numbers.
        why: String,
    },
    /// A recorded route in one of them cannot be read.
    #[error("{name}: {route}: {source}")]
    Route {
        /// Which map, as it was given.
        name: String,
        /// The route.
        route: String,
        /// Why not.
        source: RouteError,
    },
    /// The depth of key frames in one of them cannot be read.
    #[error("{name}: {source}")]
    Depth {
        /// Which map, as it was given.
        name: String,
        /// Why not.
        source: StoreError,
    },
}

/// A map of one of the files.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct MapOfFile {
    /// The file, as it was given.
    pub name: String,
    /// Number of the map's root in that file.
    pub root: usize,
}

/// An attempt to join two maps.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// The younger.
    pub from: MapOfFile,
    /// The older.
    pub into: MapOfFile,
    /// What came of it; its changes are already made.
    pub join: MapJoin,
}

/// Saved maps in one.
#[derive(Clone, Debug)]
pub struct MergedMaps {
    /// The maps, joined as far as they show the same places, with the recorded routes and the depth of all files.
    pub file: MapFile,
    /// For every two maps the last attempt to join them, in the order of the attempts.
    pub attempts: Vec<Attempt>,
    /// Where the maps that stay apart come from, by their root in the new file.
    pub maps: BTreeMap<MapId, Vec<MapOfFile>>,
    /// For each file the robots of its key frames, with their numbers in the new file.
    pub robots: BTreeMap<String, BTreeMap<RobotId, RobotId>>,
    /// What a user should know: small differences of the cameras.
    pub notes: Vec<String>,
}

/// Puts saved maps into one, and joins those that show the same places ([`Closer::join_maps`]). They may be of different
/// cameras and sensors: the atlas has the camera of the first that measures depth, if any does, and key frames of others carry
/// theirs ([`cairn_atlas::OtherCamera`]). Every
/// key frame keeps its name (robot and number), and so every recorded route stays anchored to the key frames that it was
/// recorded with and moves with them. Where two files have key frames of one name, as of the same robot that began twice
/// from nothing, the robot of the later file gets another number, in its attached routes too, and a note says so. Maps in which no place is recognised
/// with certainty stay apart, each in a frame of its own; a later run joins them when it sees both.
///
/// # Errors
/// [`MergeError`] when a map does not fit the first one, or one of its routes is damaged.
pub fn merge_maps(files: Vec<(String, MapFile)>, config: &Config) -> Result<MergedMaps, MergeError> {
    merge_maps_where(files, config, |_, _| true)
}

/// The same where it is known already which maps show the same places: of two maps of which `may` says no, neither is compared
/// with the other. Maps that became one are compared where any of those that they were may be; those of one file always.
///
/// # Errors
/// As [`merge_maps`].
pub fn merge_maps_where(
    files: Vec<(String, MapFile)>,
    config: &Config,
    may: impl Fn(&MapOfFile, &MapOfFile) -> bool,
) -> Result<MergedMaps, MergeError> {
    let mut merged = side_by_side(by_depth(files))?;
    merged.join(config, &may);
    Ok(merged)
}

/// A map of one file compared with one of another.
#[derive(Clone, Debug)]
pub struct FileComparison {
    /// The younger.
    pub from: MapOfFile,
    /// The older.
    pub into: MapOfFile,
    /// What agrees, or why that is not enough.
    pub comparison: MapComparison,
    /// Where they agree: how far the two key frames of the younger map are apart that are farthest from each other of those that stand
    /// within a metre of a key frame of the older one. `None` where lengths are metres in neither.
    pub overlap_m: Option<f64>,
}

/// Compares each map of a file with each of another, as [`merge_maps`] would, and changes nothing.
///
/// # Errors
/// As [`merge_maps`].
pub fn compare_files(
    a: (String, MapFile),
    b: (String, MapFile),
    config: &Config,
) -> Result<Vec<FileComparison>, MergeError> {
    let merged = side_by_side(by_depth(vec![a, b]))?;
    let closer = merged.closer(config);
    let own = |id: &MapId| merged.maps.get(id).and_then(|of| of.first());
    let mut compared = Vec::new();
    for (n, from) in merged.maps.keys().enumerate() {
        for into in merged.maps.keys().take(n) {
            let (Some(of_from), Some(of_into)) = (own(from), own(into)) else { continue };
            if of_from.name == of_into.name {
                continue;
            }
            let comparison = closer.compare_maps(&merged.file.snapshot, *into, *from);
            let overlap_m =
                comparison.result.as_ref().ok().and_then(|agreed| merged.overlap_m(*from, *into, agreed));
            compared.push(FileComparison {
                from: of_from.clone(),
                into: of_into.clone(),
                comparison,
                overlap_m,
            });
        }
    }
    Ok(compared)
}

/// Maps that measure depth come first: those whose lengths are not metres are scaled to them.
fn by_depth(mut files: Vec<(String, MapFile)>) -> Vec<(String, MapFile)> {
    files.sort_by_key(|(_, file)| !file.about.camera.has_depth());
    files
}

/// All maps in one file, each still in a frame of its own; those of the first file are the oldest.
pub(crate) fn side_by_side(files: Vec<(String, MapFile)>) -> Result<MergedMaps, MergeError> {
    let mut files = files.into_iter();
    let (name, first) = files.next().ok_or(MergeError::Empty)?;
    let own = |name: &str, id: MapId| MapOfFile { name: name.to_owned(), root: id.root().index() };
    let maps = first.snapshot.maps().map(|(id, _)| (id, vec![own(&name, id)])).collect();
    let robots = BTreeMap::from([(name, first.snapshot.robots().keys().map(|r| (*r, *r)).collect())]);
    let mut merged = MergedMaps { file: first, attempts: Vec::new(), maps, robots, notes: Vec::new() };
    for (name, other) in files {
        let roots: Vec<MapId> = other.snapshot.maps().map(|(id, _)| id).collect();
        let own_robots: Vec<RobotId> = other.snapshot.robots().into_keys().collect();
        let shift = merged.add(&name, other)?;
        let renamed = own_robots.into_iter().map(|r| (r, shift.robot(r))).collect();
        merged.robots.insert(name.clone(), renamed);
        for id in roots {
            if let Some(root) = shift.key_frame(id.root()) {
                merged.maps.insert(MapId(root), vec![own(&name, id)]);
            }
        }
    }
    Ok(merged)
}

/// The largest map that is adjusted as a whole; 0: none.
fn whole_key_frames(config: &Config) -> usize {
    match config.closer.whole_key_frames {
        0 => 0,
        whole => whole.max(WHOLE_KEY_FRAMES),
    }
}

impl MergedMaps {
    pub(crate) fn closer(&self, config: &Config) -> Closer {
        let closer = CloserConfig { whole_key_frames: whole_key_frames(config), ..config.closer };
        let closer = Closer::new(self.file.about.camera, closer, config.mapper.window);
        closer.with_imu_of(&self.file.snapshot, config.inertial)
    }

    /// See [`FileComparison::overlap_m`].
    fn overlap_m(&self, from: MapId, into: MapId, agreed: &Agreement) -> Option<f64> {
        let (snapshot, camera) = (&self.file.snapshot, &self.file.about.camera);
        // In metres of the older map, or else of the younger one.
        let metre = match (snapshot.is_metric_in(into, camera), snapshot.is_metric_in(from, camera)) {
            (true, _) => 1.0,
            (false, true) => agreed.into_from.scale,
            (false, false) => return None,
        };
        let at = |map| snapshot.key_frames_of(map).map(|k| k.world_from_camera.translation);
        let there: Vec<_> = at(into).collect();
        let near: Vec<_> = at(from)
            .map(|p| agreed.into_from * p)
            .filter(|p| there.iter().any(|q| (p - q).norm() < metre))
            .collect();
        let far = near.iter().flat_map(|p| near.iter().map(move |q| (p - q).norm())).fold(0.0, f64::max);
        Some(far / metre)
    }

    /// Whether any of what one map was may share a place with any of what the other was.
    fn may(&self, a: MapId, b: MapId, may: &impl Fn(&MapOfFile, &MapOfFile) -> bool) -> bool {
        let of = |id| self.maps.get(&id).into_iter().flatten();
        of(a).any(|a| of(b).any(|b| a.name == b.name || may(a, b)))
    }

    /// Puts another file beside what is there.
    fn add(&mut self, name: &str, other: MapFile) -> Result<Shift, MergeError> {
        let unfit =
            |why: CombineError| MergeError::CombineError { name: name.to_owned(), why: why.to_string() };
        let mut other = self.fitted(name, other).map_err(unfit)?;
        let (kept, left) = (self.file.snapshot.right_offset(), other.snapshot.right_offset());
        if (kept - left).abs() > RIGHT_OFFSET_PX {
            self.notes.push(format!(
                "{name}: right-image offset {left:+.3} px replaced by the first map's {kept:+.3} px"
            ));
        }
        let (snapshot, shift) = self.file.snapshot.combined_with(&other.snapshot).map_err(unfit)?;
        self.file.snapshot = snapshot;
        for (was, is) in &shift.robots {
            self.notes.push(format!(
                "{name}: its robot {was} is robot {is} in the new file; routes recorded with it: map export --routes"
            ));
        }
        let depth =
            other.take_depth().map_err(|source| MergeError::Depth { name: name.to_owned(), source })?;
        let depth: Vec<_> = depth.into_iter().map(|part| part.renamed(&shift)).collect();
        self.file.add_depth(&depth);
        for (part, bytes) in other.attached {
            let bytes = match part.strip_prefix(ROUTE_PREFIX) {
                Some(route) => renamed(bytes, &shift).map_err(|source| MergeError::Route {
                    name: name.to_owned(),
                    route: route.to_owned(),
                    source,
                })?,
                None => bytes,
            };
            // A robot that continued a shared map has the routes of the others, too.
            if self.file.attached.get(&part) == Some(&bytes) {
                continue;
            }
            let mut free = part.clone();
            let mut n = 2;
            while self.file.attached.contains_key(&free) {
                free = format!("{part}-{n}");
                n += 1;
            }
            self.file.attached.insert(free, bytes);
        }
        Ok(shift)
    }

    /// A file as it can be put beside what is there: as it is where its camera is that of the atlas, else with key frames that
    /// carry their camera.
    fn fitted(&mut self, name: &str, other: MapFile) -> Result<MapFile, CombineError> {
        let b = &self.file.about;
        let weighed = match (b.sensor, other.about.sensor) {
            (SensorMode::Rgbd, SensorMode::Rgbd) => other.with_depth_weighed_for(&b.camera).into_owned(),
            _ => other.clone(),
        };
        let a = &weighed.about;
        let octaves = (weighed.snapshot.octaves(), self.file.snapshot.octaves());
        let alone = weighed.snapshot.other_cameras().next().is_none();
        match b.fits(octaves.1, a.sensor, &a.camera, octaves.0) {
            Ok(notes) if alone => {
                self.notes.extend(notes.into_iter().map(|note| format!("{name}: {note}")));
                Ok(weighed)
            }
            _ => other.in_atlas_of(&self.file),
        }
    }

    /// Tries every two maps that may share a place, until no more of them become one.
    fn join(&mut self, config: &Config, may: &impl Fn(&MapOfFile, &MapOfFile) -> bool) {
        let closer = self.closer(config);
        let mut snapshot: Snapshot = self.file.snapshot.clone();
        let count = |snapshot: &Snapshot, map| snapshot.key_frames_of(map).count();
        // Key frames of each map when it was adjusted last: all are when they are saved.
        let mut adjusted: BTreeMap<MapId, usize> =
            self.maps.keys().map(|map| (*map, count(&snapshot, *map))).collect();
        let mut again = true;
        while again {
            again = false;
            let ids: Vec<MapId> = self.maps.keys().copied().collect();
            for (n, from) in ids.iter().enumerate() {
                for into in &ids[..n] {
                    if !self.maps.contains_key(into) || !self.may(*from, *into, may) {
                        continue;
                    }
                    let both = count(&snapshot, *into) + count(&snapshot, *from);
                    let grown = both as f64 >= GROWN * adjusted[into].max(adjusted[from]) as f64;
                    let now = grown || self.maps.len() == 2 || both > whole_key_frames(config);
                    let adjust = if now { Adjust::Now } else { Adjust::Later };
                    let mut join = closer.join_maps(&snapshot, *into, *from, adjust);
                    join.changes.clear();
                    let joined = join.joined.take();
                    self.note(join);
                    if let Some(joined) = joined {
                        snapshot = joined;
                        if now {
                            adjusted.insert(*into, both);
                        }
                        again = true;
                        break;
                    }
                }
            }
        }
        for map in self.maps.keys() {
            if adjusted[map] != count(&snapshot, *map) {
                let changes = closer.adjust_joined(&snapshot, *map);
                snapshot = snapshot.apply(&ChangeSet { base: snapshot.version(), changes }).0;
            }
        }
        // A file tells how the atlas's camera is mounted on an IMU, and no other one.
        self.file.snapshot = snapshot.without_other_imus();
    }

    fn note(&mut self, join: MapJoin) {
        let name = |id| self.maps.get(&id).and_then(|of| of.first()).cloned();
        let (Some(from), Some(into)) = (name(join.from), name(join.into)) else { return };
        if join.result.is_ok() {
            let moved = self.maps.remove(&join.from).unwrap_or_default();
            self.maps.entry(join.into).or_default().extend(moved);
        }
        self.attempts.retain(|a| a.join.result.is_ok() || (&a.from, &a.into) != (&from, &into));
        self.attempts.push(Attempt { from, into, join });
    }
}

/// A route anchored to the same key frames, where a robot has another number now.
fn renamed(bytes: Vec<u8>, shift: &Shift) -> Result<Vec<u8>, RouteError> {
    let mut route = Route::read(bytes.as_slice())?;
    if shift.robots.is_empty() {
        return Ok(bytes);
    }
    for point in &mut route.points {
        point.anchor.robot = shift.robot(point.anchor.robot);
    }
    route.to_bytes().map_err(|e| RouteError::Header(e.to_string()))
}
