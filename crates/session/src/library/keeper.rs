//! Keeps the atlas that the routes of a folder are anchored in: opens it at the start of a session, saves it while routes
//! are recorded and at the end.
//!
//! A camera goes on in the atlas that holds key frames of it, else in one of other cameras where both know metres
//! ([`Engine::in_map`]), else it begins one. A place that is not recognised begins a new map in it, and maps are merged where a
//! place is recognised, so that routes of one building come to lie in one map. Once an atlas has key frames of several
//! cameras, only those of its maps are saved that are in metres: in others the next camera could do nothing.
//!
//! *After a crash* the saved atlas is older than the routes. Points that are anchored to key frames which were not saved
//! are anchored to the nearest saved ones before anything new is mapped, for the numbers of those key frames will be given
//! again. A route that no saved key frame carries is detached from the atlas: it can be listed, not walked. Until those
//! files are rewritten, the atlas is not saved.

use super::error::{KeepError, LibraryError};
use super::folder::{numbered, replace};
use super::{MOST_KEY_FRAMES, WallClock, WallTime};
use crate::disk::OwnDisk;
use crate::reference_path::unit_of;
use crate::slam::Slam;
use cairn_atlas::store::{MapFile, StoreError};
use cairn_atlas::{Atlas, Change, KeyFrameId, Snapshot};
use cairn_engine::{Config, Engine, Host, OpenMapError, Runner, SensorMode};
use cairn_guide::Route;
use cairn_sensor::{Rig, RigError, Stamp};
use cairn_vision::{FrontEnd, RectifiedCamera};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Instant, SystemTime};

/// Interval of the saves while a route is recorded, seconds.
const SAVE_EVERY_S: f64 = 10.0;
/// Saving takes at most this share of the time.
const SAVING_SHARE: f64 = 0.05;

/// The camera of a session: which atlases of a folder it goes on with.
#[derive(Clone, Debug)]
pub struct LibraryCamera {
    sensor: SensorMode,
    model: RectifiedCamera,
    /// Else its lens is a guess, and it goes on with maps of its own alone.
    is_calibrated: bool,
}

impl LibraryCamera {
    /// That of a rig.
    ///
    /// # Errors
    /// When the rig cannot serve the mode.
    pub fn of(rig: &Rig, sensor: SensorMode, config: &Config, is_calibrated: bool) -> Result<Self, RigError> {
        let model = *FrontEnd::new(rig, sensor, config.front_end_for(rig))?.model();
        Ok(Self { sensor, model, is_calibrated })
    }
}

/// An engine in the kept atlas, and its keeper.
pub struct Kept<S = Engine> {
    /// The engine.
    pub engine: S,
    /// The keeper, for [`crate::Session::keeping`].
    pub keeper: MapKeeper,
    /// What the user should know: damage, small differences of the camera.
    pub notes: Vec<String>,
}

/// A save: the bytes written or why not, and the seconds it took.
type Saved = (Result<u64, StoreError>, f64);

/// The keeper of an atlas.
pub struct MapKeeper {
    folder: PathBuf,
    id: String,
    /// Held while the session lasts: a folder has one writer.
    _lock: File,
    wall: WallClock,
    /// Rewritten routes that are not on disk yet.
    unwritten: Vec<(PathBuf, Route)>,
    /// Routes whose key frames were not saved.
    detached: BTreeSet<PathBuf>,
    /// The version that is on disk.
    saved: Option<u64>,
    /// The version that is being saved, on a thread.
    work: Option<(u64, JoinHandle<Saved>)>,
    last: Option<Stamp>,
    pause_s: f64,
    is_due: bool,
    trouble: Option<KeepError>,
}

impl MapKeeper {
    /// Opens the atlas of a folder that this camera can go on with, else begins one; the folder is created.
    ///
    /// # Errors
    /// [`LibraryError::Rig`] when the rig cannot serve the mode.
    pub fn open(
        folder: RoutesLock,
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
        host: &Host,
    ) -> Result<Kept, LibraryError> {
        let camera = LibraryCamera::of(rig, mode, config, true)?;
        Self::open_with(folder, None, &camera, |map| match map {
            Some(file) => Engine::in_map(rig, mode, rate_hz, runner, config, host, file),
            None => Ok((Engine::new(rig, mode, rate_hz, runner, config, host)?, Vec::new())),
        })
    }

    /// The same for what `begin` begins for this camera: in an atlas, with differences of the camera, or in none. `id` is that of
    /// the atlas of a session that died, which is followed where it goes on.
    ///
    /// # Errors
    /// What `begin` says where it is given no map.
    pub fn open_with<S: Slam>(
        folder: RoutesLock,
        id: Option<String>,
        camera: &LibraryCamera,
        begin: impl FnMut(Option<&MapFile>) -> Result<(S, Vec<String>), OpenMapError>,
    ) -> Result<Kept<S>, LibraryError> {
        let (lock, folder) = (folder.file, &*folder.folder);
        let (id, engine, notes) = opened(folder, id, camera, begin)?;
        let mut keeper = Self {
            folder: folder.to_owned(),
            id,
            _lock: lock,
            wall: Arc::new(WallTime::now),
            unwritten: Vec::new(),
            detached: BTreeSet::new(),
            saved: None,
            work: None,
            last: None,
            pause_s: SAVE_EVERY_S,
            is_due: false,
            trouble: None,
        };
        keeper.begins(&engine);
        Ok(Kept { engine, keeper, notes })
    }

    /// Keeps another atlas from now on: that of the folder which fits what is begun. What was not saved of the one so far is
    /// dropped.
    pub(crate) fn restart_slam<S: Slam>(
        &mut self,
        camera: &LibraryCamera,
        begin: impl FnMut(Option<&MapFile>) -> Result<(S, Vec<String>), OpenMapError>,
    ) -> Result<(S, Vec<String>), LibraryError> {
        self.wait();
        let (id, engine, notes) = opened(&self.folder, None, camera, begin)?;
        self.id = id;
        self.detached.clear();
        (self.last, self.pause_s, self.is_due) = (None, SAVE_EVERY_S, false);
        self.begins(&engine);
        Ok((engine, notes))
    }

    fn begins(&mut self, engine: &impl Slam) {
        let snapshot = engine.snapshot();
        self.saved = self.path().exists().then(|| snapshot.version());
        self.reanchor(&snapshot);
    }

    /// Takes the time of day from another clock.
    pub fn with_clock(mut self, wall: WallClock) -> Self {
        self.wall = wall;
        self
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The identity of the atlas.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Why the atlas is not on disk as it is, if so.
    pub fn trouble(&self) -> Option<&KeepError> {
        self.trouble.as_ref()
    }

    pub(crate) fn wall(&self) -> &WallClock {
        &self.wall
    }

    /// Whether a route in this file, with this header, is anchored in the atlas.
    pub(crate) fn holds(&self, path: &Path, atlas: Option<&str>) -> bool {
        atlas == Some(&self.id) && !self.detached.contains(path)
    }

    /// The next save is due as soon as possible: a route is complete.
    pub(crate) fn make_due(&mut self) {
        self.is_due = true;
    }

    /// Starts a save on a thread of its own where one is due; `recording` says that a route is being recorded. True when
    /// [`MapKeeper::trouble`] came or went.
    pub(crate) fn pass(&mut self, engine: &impl Slam, recording: bool, now: Stamp) -> bool {
        let mut changed = false;
        if self.work.as_ref().is_some_and(|(_, work)| work.is_finished()) {
            changed = self.wait();
        }
        let waited = self.last.is_none_or(|t| now - t >= self.pause_s);
        let retry = self.trouble.is_some() && waited;
        if self.work.is_none() && (self.is_due || retry || recording && waited) {
            self.last = Some(now);
            self.is_due = false;
            changed |= self.begin(engine);
        }
        changed
    }

    /// The file of the atlas.
    fn path(&self) -> PathBuf {
        self.folder.join(format!("atlas-{}.map", self.id))
    }

    /// Waits for the save in progress and saves once more where the map has changed; [`MapKeeper::trouble`] tells whether it
    /// is on disk.
    pub(crate) fn end(&mut self, engine: &impl Slam) {
        self.wait();
        self.begin(engine);
        self.wait();
    }

    /// Begins a save; true when trouble came.
    fn begin(&mut self, engine: &impl Slam) -> bool {
        let snapshot = engine.snapshot();
        let count = snapshot.key_frame_count();
        if count == 0 || self.saved == Some(snapshot.version()) {
            return false;
        }
        let before = self.trouble.is_some();
        if count > MOST_KEY_FRAMES {
            self.trouble = Some(KeepError::TooLarge(count));
            return !before;
        }
        if let Err(e) = self.write_routes() {
            self.trouble = Some(KeepError::Route(e));
            return !before;
        }
        let version = snapshot.version();
        let program = concat!("cairn ", env!("CARGO_PKG_VERSION"));
        let file = with_metres(engine.to_save(program, BTreeMap::new()));
        if file.snapshot.key_frame_count() == 0 {
            return false;
        }
        let path = self.path();
        let save = move || {
            let began = Instant::now();
            let saved = file.save(&path);
            (saved, began.elapsed().as_secs_f64())
        };
        // A page has no threads.
        if !cairn_atlas::store::HAS_THREADS {
            return self.take(version, save());
        }
        match std::thread::Builder::new().name("cairn-save".into()).spawn(save) {
            Ok(work) => self.work = Some((version, work)),
            Err(e) => self.trouble = Some(KeepError::Thread(e)),
        }
        self.trouble.is_some() != before
    }

    /// What came of a save; true when trouble came or went.
    fn take(&mut self, version: u64, (saved, took_s): Saved) -> bool {
        let before = self.trouble.is_some();
        match saved {
            Ok(_) => {
                self.saved = Some(version);
                self.trouble = None;
                self.pause_s = SAVE_EVERY_S.max(took_s / SAVING_SHARE);
            }
            Err(e) => self.trouble = Some(e.into()),
        }
        self.trouble.is_some() != before
    }

    /// Takes the result of the save in progress; true when trouble came or went.
    fn wait(&mut self) -> bool {
        let Some((version, work)) = self.work.take() else { return false };
        match work.join() {
            Ok(saved) => self.take(version, saved),
            Err(_) => self.trouble.replace(KeepError::Panicked).is_none(),
        }
    }

    /// Anchors the routes of the atlas to key frames that it holds.
    fn reanchor(&mut self, map: &Snapshot) {
        for (_, path) in numbered(&self.folder) {
            let Ok(mut route) = Route::load(&path) else { continue };
            if route.header.atlas.as_deref() != Some(&self.id) {
                continue;
            }
            match route.reanchor(|anchor| unit_of(map, anchor)) {
                Some(0) => continue,
                Some(_) => {}
                None => {
                    route.header.atlas = None;
                    self.detached.insert(path.clone());
                }
            }
            self.unwritten.push((path, route));
        }
        // What cannot be written now is tried again before the atlas is saved.
        let _ = self.write_routes();
    }

    fn write_routes(&mut self) -> io::Result<()> {
        while let Some((path, route)) = self.unwritten.last() {
            // A route that was deleted meanwhile needs no anchors.
            if path.exists() {
                replace(&OwnDisk, path, route)?;
            }
            self.unwritten.pop();
        }
        Ok(())
    }
}

/// What is saved of an atlas: where several cameras share it, the maps that are in metres.
fn with_metres(mut file: MapFile) -> MapFile {
    if file.snapshot.other_cameras().next().is_some() {
        let whole = &file.snapshot;
        file.snapshot = whole.without_maps(|map| !whole.is_metric_in(map, &file.about.camera));
    }
    file
}

/// An atlas, trimmed where it is large.
fn fitting(folder: &Path, path: &Path, mut file: MapFile) -> MapFile {
    if file.snapshot.key_frame_count() > MOST_KEY_FRAMES / 2 {
        file.snapshot = trimmed(file.snapshot, &needed(folder, id_of(path).as_deref()));
    }
    file
}

/// The key frames that the routes of an atlas are anchored to.
fn needed(folder: &Path, id: Option<&str>) -> BTreeSet<u32> {
    let routes = numbered(folder).into_iter().filter_map(|(_, path)| Route::load(&path).ok());
    let of_it = routes.filter(|route| route.header.atlas.as_deref() == id);
    of_it.flat_map(|route| route.points.into_iter().map(|p| p.anchor.seq)).collect()
}

/// A snapshot without the maps that no route is in; of each its root remains.
fn trimmed(snapshot: Snapshot, needed: &BTreeSet<u32>) -> Snapshot {
    let standing = needed.iter().filter_map(|seq| {
        let (id, _) = snapshot.surviving_ancestor(KeyFrameId::from_index(*seq as usize)?)?;
        snapshot.key_frame(id).map(|k| k.map)
    });
    let maps: BTreeSet<_> = standing.collect();
    let spare = snapshot.key_frames().filter(|k| !maps.contains(&k.map) && k.parent.is_some());
    let changes: Vec<Change> = spare.map(|k| Change::RemoveKeyFrame(k.id)).collect();
    let mut atlas = Atlas::new(snapshot);
    atlas.commit(changes);
    (**atlas.latest()).clone()
}

/// The content of an atlas. What is damaged is set aside, and what is whole of it is used.
fn read(path: &Path, notes: &mut Vec<String>) -> Option<MapFile> {
    let why = match MapFile::load(path) {
        Ok(file) => return (file.snapshot.key_frame_count() > 0).then_some(file),
        Err(e) => e.to_string(),
    };
    let bytes = cairn_atlas::store::read_file(path, cairn_atlas::store::Length::Any).ok();
    let whole = bytes.and_then(|bytes| MapFile::salvage(&bytes).ok());
    let aside = path.with_extension("map-damaged");
    let _ = std::fs::rename(path, &aside);
    let kept = if whole.is_some() { "what is whole of it is used" } else { "its routes cannot be walked" };
    notes.push(format!("the map is damaged ({why}); {kept}; it is kept as {}", aside.display()));
    whole.map(|(file, _)| file)
}

/// The identity of the atlas of a folder that a camera goes on with, or of a new one; what was begun in it; what the user should
/// know. Of those that hold key frames of the camera, or else of others that take it, the one written last.
fn opened<S>(
    folder: &Path,
    id: Option<String>,
    camera: &LibraryCamera,
    mut begin: impl FnMut(Option<&MapFile>) -> Result<(S, Vec<String>), OpenMapError>,
) -> Result<(String, S, Vec<String>), LibraryError> {
    let mut notes = Vec::new();
    let mut read_files = Vec::new();
    for path in atlases(folder) {
        if id.is_some() && id_of(&path) != id {
            continue;
        }
        read_files.extend(read(&path, &mut notes).map(|file| (path, file)));
    }
    let (own, others): (Vec<_>, Vec<_>) =
        read_files.into_iter().partition(|(_, file)| file.has_key_frames_of(camera.sensor, &camera.model));
    let others = others.into_iter().filter(|_| camera.is_calibrated);
    for (path, file) in own.into_iter().chain(others) {
        match begin(Some(&fitting(folder, &path, file))) {
            Ok((engine, differences)) => {
                notes.extend(differences);
                return Ok((id_of(&path).unwrap_or_default(), engine, notes));
            }
            Err(e @ (OpenMapError::Rig(_) | OpenMapError::Process(_))) => return Err(e.into()),
            Err(OpenMapError::OtherCamera { .. }) => {}
        }
    }
    let (engine, _) = begin(None)?;
    Ok((id.unwrap_or_else(|| new_id(folder)), engine, notes))
}

/// The right to write into a folder of routes; the system takes it back when the program ends, however it does.
pub struct RoutesLock {
    folder: PathBuf,
    file: File,
}

impl RoutesLock {
    /// Takes it; the folder is created.
    ///
    /// # Errors
    /// [`LibraryError`] when another program has it, or the folder cannot be written.
    pub fn take(folder: &Path) -> Result<Self, LibraryError> {
        locked(folder).map(|file| Self { folder: folder.to_owned(), file })
    }
}

fn locked(folder: &Path) -> Result<File, LibraryError> {
    let shown = folder.display().to_string();
    let fail = |source| LibraryError::Folder { path: shown.clone(), source };
    std::fs::create_dir_all(folder).map_err(fail)?;
    let path = folder.join(".lock");
    let file = File::options().write(true).create(true).truncate(false).open(path).map_err(fail)?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(LibraryError::Busy(shown)),
        // On file systems without locks there is no protection.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
    }
}

/// The atlases of a folder, the one written last first.
fn atlases(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut all: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| id_of(p).is_some()).collect();
    let written = |p: &PathBuf| std::fs::metadata(p).and_then(|m| m.modified()).ok();
    all.sort_by(|a, b| written(b).cmp(&written(a)).then(a.cmp(b)));
    all
}

/// The identity in the name of an atlas file.
fn id_of(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    name.strip_prefix("atlas-")?.strip_suffix(".map").map(str::to_owned)
}

/// A new identity: it must differ from those of all atlases that routes may name, also of deleted ones.
fn new_id(folder: &Path) -> String {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let mut id = since.as_nanos() as u64 ^ u64::from(cairn_atlas::store::process_id()).rotate_right(16);
    while folder.join(format!("atlas-{id:016x}.map")).exists() {
        id = id.wrapping_add(1);
    }
    format!("{id:016x}")
}
