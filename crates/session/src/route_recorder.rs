//! Recording of one route from poses that another process tracks: the recording of a [`crate::Session`] without its engine.
//!
//! In: the map as the journal of changes tells it, and poses as they come. Out: the route's file, each point as soon as it is
//! known. A recorder that takes the place of one that died goes on in its file, without a gap where it is given the frames
//! since the last point.

use crate::disk::{Disk, OwnDisk};
use crate::place::Place;
use crate::recording::{About, Recording};
use crate::route_guide::TrackedPlace;
use crate::route_metres::{may_have_metres, settle_astray};
use crate::session::NotSaved;
use cairn_atlas::Snapshot;
use cairn_geometry::{Pose, Se3};
use cairn_guide::{
    Anchor, Confidence, RecordInput, Recorder, RecorderConfig, Route, RouteError, RouteWriter,
};
use cairn_sensor::Stamp;
use cairn_vision::RectifiedCamera;
use std::path::Path;

/// Records one route.
pub struct RouteRecorder {
    recording: Recording,
    place: Option<Place>,
}

impl RouteRecorder {
    /// Begins a new file; `map` is the one in which the run begins. Where the file cannot be created the route is kept in
    /// memory, and why is returned.
    pub fn begin(
        path: &Path,
        map: &Snapshot,
        camera: &RectifiedCamera,
        source: &str,
        config: RecorderConfig,
    ) -> (Self, Option<String>) {
        let metric = map.is_metric(camera);
        let about = About { metric, source, recorded_s: None, atlas: None };
        let (recording, trouble) = Recording::begin(&OwnDisk, Some(path), map, None, about, config);
        (Self { recording, place: None }, trouble)
    }

    /// Goes on in a file.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub fn resume(path: &Path, config: RecorderConfig) -> Result<Self, RouteError> {
        let (route, writer) = RouteWriter::resume(path)?;
        let recorder = Recorder::resume(config, route).with_writer(writer);
        Ok(Self { recording: Recording::resume(recorder, path), place: None })
    }

    /// The time of the last point.
    pub fn until(&self) -> Option<Stamp> {
        self.recording.route().points.last().map(|p| p.stamp)
    }

    /// The route so far.
    pub fn route(&self) -> &Route {
        self.recording.route()
    }

    /// Takes a frame that was tracked at `stamp`; without a place its pose is not known. Returns the id of a sentence for the
    /// walker, if one is due.
    pub fn tracked(
        &mut self,
        map: &Snapshot,
        camera: &RectifiedCamera,
        stamp: Stamp,
        place: Option<&TrackedPlace>,
    ) -> Option<&'static str> {
        if let Some(place) = place.filter(|_| self.until() == Some(stamp)) {
            // The frame of the last point: those after it are in its segment of odometry, so nothing is missing in between.
            self.recording.goes_on_from(&place.place());
            return None;
        }
        self.place = place.map(TrackedPlace::place).or(self.place);
        if place.is_some_and(|p| p.metric)
            && !self.route().header.metric
            && may_have_metres(map, camera, self.route())
        {
            self.recording.found_scale(map, self.place.as_ref());
        }
        let input = match place {
            Some(p) => RecordInput {
                stamp,
                odom_from_camera: p.odom_from_camera,
                segment: p.segment,
                anchor: p.anchor,
                anchor_from_camera: p.anchor_from_camera,
                confidence: p.confidence,
                quality: p.quality,
            },
            None => RecordInput {
                stamp,
                odom_from_camera: Pose::new(Se3::identity()),
                segment: 0,
                anchor: Anchor { robot: 0, seq: 0 },
                anchor_from_camera: Se3::identity(),
                confidence: Confidence::Lost,
                quality: 0.0,
            },
        };
        self.recording.observe(&input, self.place.as_ref())
    }

    /// Ends the recording in the last map, where there is one: how many points it has. Those that went astray are placed
    /// ([`Route::carry_over`]).
    ///
    /// # Errors
    /// [`NotSaved::Route`] when the file does not hold all of them.
    pub fn finish(self, last: Option<(&Snapshot, &RectifiedCamera)>) -> Result<usize, NotSaved> {
        let (mut route, path, mut whole) = self.recording.finish();
        if let (Ok(()), Some((map, camera))) = (&whole, last) {
            let file = path.as_deref().map(|path| (&OwnDisk as &dyn Disk, path));
            whole = settle_astray(map, camera, &mut route, file).map(|_| ());
        }
        let points = route.points.len();
        whole.map(|()| points).map_err(|e| NotSaved::Route(format!("{e}; {points} points were recorded")))
    }
}
