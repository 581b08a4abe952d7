//! A recording in progress: the recorder, its patient file, and the announcements about it.

use crate::disk::{Disk, PatientFile, Trouble};
use crate::dwell::{Dwell, Warnings};
use crate::place::Place;
use crate::reference_path::{key_frame_of, map_of};
use crate::route_metres::length_in_map;
use cairn_atlas::Snapshot;
use cairn_geometry::{Pose, Se3, Sim3, So3, Vec3};
use cairn_guide::{
    Confidence, Ground, NoteError, RecordInput, Recorder, RecorderConfig, RecorderEvent, Route, RouteHeader,
    RouteNote, RouteWriter, Side, Stretch,
};
use cairn_sensor::Stamp;
use std::io;
use std::path::{Path, PathBuf};

/// What a recording says of itself in its file.
pub(crate) struct About<'a> {
    /// Whether lengths are metres.
    pub metric: bool,
    /// A description of the image source.
    pub source: &'a str,
    /// When it begins: seconds since 1970-01-01 00:00 UTC.
    pub recorded_s: Option<i64>,
    /// The identity of the atlas, where it is kept.
    pub atlas: Option<String>,
}

/// Why a note is not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum NoteRefusal {
    #[error("the route has {} notes, no more are kept", RouteNote::MOST)]
    TooMany,
    #[error(transparent)]
    Note(#[from] NoteError),
}

impl NoteRefusal {
    /// The id of the sentence that the walker hears.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::TooMany => "walk-note-too-many",
            Self::Note(_) => "walk-note-too-long",
        }
    }
}

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
    /// Without a `path` it is in memory only.
    pub fn begin(
        disk: &dyn Disk,
        path: Option<&Path>,
        map: &Snapshot,
        place: Option<&Place>,
        about: About,
        config: RecorderConfig,
    ) -> (Self, Option<String>) {
        let ground = ground_of(map, place);
        let header = RouteHeader {
            recorded_s: about.recorded_s,
            atlas: about.atlas,
            ..RouteHeader::new(about.metric, &ground, about.source)
        };
        let recorder = Recorder::new(config, about.metric, &ground, about.source).with_header(header.clone());
        let opened = path.map(|path| disk.create(path)).transpose().and_then(|file| {
            let Some(file) = file else { return Ok(None) };
            let file = PatientFile::new(file);
            let trouble = file.trouble();
            RouteWriter::new(Box::new(file), &header).map(|w| Some((w, trouble)))
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
            Ok(Some((writer, trouble))) => {
                (plain(recorder.with_writer(writer), trouble, path.map(Path::to_owned)), None)
            }
            Ok(None) => (plain(recorder, Trouble::default(), None), None),
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

    /// A recording that was resumed goes on from its last point, which is of this place, without a gap.
    pub fn goes_on_from(&mut self, place: &Place) {
        self.segment = Some(place.segment);
        self.unit = if self.route().header.metric { place.world_from_odom.sim3.scale } else { 1.0 };
        self.recorder.goes_on_in(place.segment);
        self.placed = true;
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

    /// Notes a landmark at this place.
    pub fn note(&mut self, text: &str, side: Option<Side>, place: &Place) -> Result<(), NoteRefusal> {
        if self.route().notes.len() >= RouteNote::MOST {
            return Err(NoteRefusal::TooMany);
        }
        let pose = place.odom_from_camera.se3;
        // As for the points: in metres where that is known, else in the unit of the odometry.
        let unit = if self.route().header.metric { place.world_from_odom.sim3.scale } else { self.unit };
        let note = RouteNote {
            text: text.to_owned(),
            side,
            stamp: place.stamp,
            anchor: place.anchor,
            anchor_from_camera: place.anchor_from_camera,
            odom_from_camera: Se3::new(pose.rotation, pose.translation * unit),
        };
        note.check()?;
        // The patient file keeps what it could not write.
        let _ = self.recorder.note(note);
        Ok(())
    }

    /// The scale of the map was initialised: lengths are metres from now on, including what was walked before.
    pub fn found_scale(&mut self, map: &Snapshot, place: Option<&Place>) {
        let unit = place.map_or(1.0, |place| place.world_from_odom.sim3.scale);
        let carried =
            Sim3::new(So3::identity(), Vec3::zeros(), unit / std::mem::replace(&mut self.unit, unit));
        // The patient file keeps what it could not write.
        let _ = self.recorder.found_scale(carried, &ground_of(map, place));
        self.length = length_in_map(map, self.route());
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
    let of = place.and_then(|place| map_of(map, key_frame_of(map, place.anchor)?));
    let is_level = of.map_or_else(|| map.is_gravity_aligned_throughout(), |of| map.is_gravity_aligned(of));
    let in_world = if is_level { Ground::z_up() } else { Ground::first_camera() };
    place.map_or(in_world, |place| in_world.rotated(&place.world_from_odom.sim3.rotation.inverse()))
}

/// Whether a frame counts as tracked.
pub(crate) fn tracked(input: &RecordInput) -> bool {
    input.confidence != Confidence::Lost
}
