//! A recording in progress: the recorder, its patient file, and the announcements about it.

use crate::disk::{Disk, PatientFile, Trouble};
use crate::dwell::{Dwell, Warnings};
use crate::guidance::Place;
use crate::reference_path::standing;
use cairn_atlas::Snapshot;
use cairn_geometry::{Pose, Se3, Sim3, So3, Vec3};
use cairn_guide::{
    Confidence, Ground, RecordInput, Recorder, RecorderConfig, RecorderEvent, Route, RouteHeader,
    RouteWriter, Stretch,
};
use cairn_sensor::Stamp;
use std::io;
use std::path::{Path, PathBuf};

/// A route being recorded.
pub(crate) struct Recording {
    recorder: Recorder,
    trouble: Trouble,
    trouble_announced: bool,
    /// The file; `None` where none could be created.
    pub path: Option<PathBuf>,
    length: f64,
    last: Option<(Stamp, Vec3)>,
    gaps: usize,
    /// The segment of odometry, and the length of its unit in the unit of the recorded poses.
    segment: Option<u32>,
    unit: f64,
    place: Dwell,
    /// There was a pose: before the first one nothing can be lost.
    placed: bool,
    warnings: Warnings,
}

impl Recording {
    /// Starts; when the file cannot be created, the recording continues in memory and the reason is returned.
    pub fn begin(
        disk: &dyn Disk,
        path: &Path,
        map: &Snapshot,
        place: Option<&Place>,
        metric: bool,
        source: &str,
    ) -> (Self, Option<String>) {
        let ground = ground_of(map, place);
        let header = RouteHeader::new(metric, &ground, source);
        let recorder = Recorder::new(RecorderConfig::default(), metric, &ground, source);
        let opened = disk.create(path).and_then(|file| {
            let file = PatientFile::new(file);
            let trouble = file.trouble();
            RouteWriter::new(Box::new(file), &header).map(|w| (w, trouble))
        });
        let plain = |recorder, trouble, path| Self {
            recorder,
            trouble,
            trouble_announced: false,
            path,
            length: 0.0,
            last: None,
            gaps: 0,
            segment: None,
            unit: 1.0,
            place: Dwell::default(),
            placed: false,
            warnings: Warnings::default(),
        };
        match opened {
            Ok((writer, trouble)) => {
                (plain(recorder.with_writer(writer), trouble, Some(path.to_owned())), None)
            }
            Err(e) => (plain(recorder, Trouble::default(), None), Some(e.to_string())),
        }
    }

    /// Continues a recording that has a file already; what cannot be written is kept in memory only.
    pub fn resume(recorder: Recorder, path: &Path) -> Self {
        let points = &recorder.route().points;
        let at = |p: &cairn_guide::RoutePoint| p.odom_from_camera.translation;
        let length = points.windows(2).map(|w| (at(&w[1]) - at(&w[0])).norm()).sum();
        let last = points.last().map(|p| (p.stamp, at(p)));
        let gaps = points.iter().filter(|p| p.stretch == Stretch::Gap).count();
        let (trouble, path) = (Trouble::default(), Some(path.to_owned()));
        Self {
            recorder,
            trouble,
            trouble_announced: false,
            path,
            length,
            last,
            gaps,
            place: Dwell::default(),
            placed: false,
            warnings: Warnings::default(),
            segment: None,
            unit: 1.0,
        }
    }

    /// Takes a frame's pose; returns the id of a sentence for the walker, if one is due. `place` is the last known one.
    pub fn observe(&mut self, input: &RecordInput, place: Option<&Place>) -> Option<&'static str> {
        if let Some(place) = place.filter(|place| self.segment != Some(place.segment)) {
            self.segment = Some(place.segment);
            // Recorded poses are in metres where that is known, else in the unit of the odometry.
            self.unit = if self.route().header.metric { place.world_from_odom.sim3.scale } else { 1.0 };
        }
        let pose = input.odom_from_camera.se3;
        let scaled = Se3::new(pose.rotation, pose.translation * self.unit);
        let input = &RecordInput { odom_from_camera: Pose::new(scaled), ..*input };
        let before = self.recorder.route().points.len();
        // The patient file keeps what it could not write, so no error reaches here and no point is lost.
        let event = self.recorder.observe(input).ok().flatten();
        if let Some(point) = self.recorder.route().points.get(before) {
            let at = point.odom_from_camera.translation;
            self.length += self.last.map_or(0.0, |(_, p)| (at - p).norm());
            self.last = Some((point.stamp, at));
            self.gaps += usize::from(point.stretch == Stretch::Gap);
        }
        match (self.trouble.now().is_some(), self.trouble_announced) {
            (true, false) => {
                self.trouble_announced = true;
                return Some("walk-disk-full");
            }
            (false, true) => {
                self.trouble_announced = false;
                return Some("walk-disk-again");
            }
            _ => {}
        }
        self.words(event, input)
    }

    /// A loss is announced at once, a return after it has lasted a second, and no warning is repeated too often.
    fn words(&mut self, event: Option<RecorderEvent>, input: &RecordInput) -> Option<&'static str> {
        const WEAK: &str = "guide-weak";
        self.placed |= tracked(input);
        let back = match tracked(input) {
            true => self.place.there(input.stamp),
            false => {
                self.place.missing();
                false
            }
        };
        match event {
            Some(RecorderEvent::Lost) => (self.placed && self.place.lost()).then_some("walk-lost"),
            Some(RecorderEvent::Bridging) => self.warnings.due(WEAK, input.stamp).then_some(WEAK),
            Some(RecorderEvent::Resumed { .. }) | None => back.then_some("guide-found"),
        }
    }

    /// The scale of the map was initialised: lengths are metres from now on, including what was walked before.
    pub fn found_scale(&mut self, map: &Snapshot, place: Option<&Place>) {
        let unit = place.map_or(1.0, |place| place.world_from_odom.sim3.scale);
        let carried =
            Sim3::new(So3::identity(), Vec3::zeros(), unit / std::mem::replace(&mut self.unit, unit));
        // The patient file keeps what it could not write.
        let _ = self.recorder.found_scale(carried, &ground_of(map, place));
        let at: Vec<Vec3> = (self.route().resolve(|a| standing(map, a)).iter())
            .map(|p| p.frame_from_camera.translation)
            .collect();
        self.length = at.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        self.last = self.last.map(|(stamp, last)| (stamp, carried * last));
    }

    /// The route recorded so far.
    pub fn route(&self) -> &Route {
        self.recorder.route()
    }

    /// Length as recorded, in units of the map.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Number of gaps, stretches of which only the two ends are known.
    pub fn gaps(&self) -> usize {
        self.gaps
    }

    /// Why data is waiting to be written, if it is.
    pub fn trouble(&self) -> Option<String> {
        self.trouble.now()
    }

    /// Ends the recording: the route, its file, and an error when the file does not hold all of it.
    pub fn finish(self) -> (Route, Option<PathBuf>, io::Result<()>) {
        let trouble = self.trouble.clone();
        let (route, synced) = self.recorder.finish();
        if route.points.is_empty()
            && let Some(path) = &self.path
        {
            let _ = std::fs::remove_file(path);
        }
        let whole = match (synced, trouble.now()) {
            (Err(e), _) => Err(e),
            (Ok(()), Some(why)) => Err(io::Error::other(why)),
            (Ok(()), None) => Ok(()),
        };
        (route, self.path, whole)
    }
}

/// The ground plane of the following poses, in the odometry frame: from gravity where the map is aligned, else from
/// the first camera's axes.
fn ground_of(map: &Snapshot, place: Option<&Place>) -> Ground {
    let in_world = if map.is_gravity_aligned_throughout() { Ground::z_up() } else { Ground::first_camera() };
    place.map_or(in_world, |place| in_world.rotated(&place.world_from_odom.sim3.rotation.inverse()))
}

/// Whether a frame counts as tracked.
pub(crate) fn tracked(input: &RecordInput) -> bool {
    input.confidence != Confidence::Lost
}

/// `route-0007.route`: one more than the highest number in the folder.
pub(crate) fn next_path(folder: &Path) -> PathBuf {
    let highest = routes_in(folder).into_iter().filter_map(|(n, _)| n).max().unwrap_or(0);
    folder.join(format!("route-{:04}.route", highest + 1))
}

/// The route written last: by its time, then by its number.
pub(crate) fn latest(folder: &Path) -> Option<PathBuf> {
    let written = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
    let mut routes = routes_in(folder);
    routes.sort_by(|(a, p), (b, q)| written(p).cmp(&written(q)).then(a.cmp(b)).then(p.cmp(q)));
    routes.pop().map(|(_, path)| path)
}

fn routes_in(folder: &Path) -> Vec<(Option<u32>, PathBuf)> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let number = |path: &Path| {
        let stem = path.file_stem()?.to_str()?;
        stem.strip_prefix("route-").or_else(|| stem.strip_prefix("way-"))?.parse::<u32>().ok()
    };
    (entries.flatten().map(|e| e.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "route" || e == "way") && p.is_file())
        .map(|p| (number(&p), p))
        .collect()
}
