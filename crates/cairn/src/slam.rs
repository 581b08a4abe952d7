//! SLAM: frames in; poses, the map and its changes out; save and load.

use crate::{Changes, Error, FrameError, Map, MapEvents, accuracy, map_file};
use cairn_atlas::store::MapFile;
use cairn_engine::{Engine, Finished, HintOutcome, MeasuredMotion, Output, PlaceHint, Status};
use cairn_eval::Evaluation;
use cairn_geometry::{Se3, Trajectory};
use cairn_sensor::{DepthImage, FramePacket, GrayImage, ImuSample, Stamp};
use cairn_session::Session;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Visual-inertial SLAM with one camera, two, or one with depth, with or without an IMU; and a recorder and a guide on
/// it.
///
/// Frames go in one by one ([`Slam::track`], [`Slam::track_images`]), each gives an [`Output`]. The map is read as an
/// immutable [`Map`], or followed change by change ([`Slam::changes`]).
pub struct Slam {
    pub(crate) session: Session,
    /// Named parts of the map file it was built with, kept when it is saved.
    pub(crate) attached: BTreeMap<String, Vec<u8>>,
    pub(crate) notes: Vec<String>,
    /// Time of the last frame that was processed.
    pub(crate) last: Option<Stamp>,
}

impl Slam {
    /// Processes a frame. A lost pose is no error: see [`Output::state`].
    ///
    /// # Errors
    /// [`Error::Frame`] when the images do not fit the rig, the frame is not later than the one before, or an IMU
    /// sample is not finite or out of order; the next frame can be processed, or this one again at the same time.
    pub fn track(&mut self, packet: &FramePacket) -> Result<Output, Error> {
        let refused = |why: FrameError| Error::Frame { stamp: packet.stamp, why };
        check(packet, self.last).map_err(refused)?;
        let output = self.session.on_packet(packet).map_err(|why| refused(why.into()))?;
        self.last = Some(packet.stamp);
        Ok(output)
    }

    /// Processes a frame given by its parts: one image per camera in the order of the rig, the depth image where there
    /// is a depth sensor, and the IMU samples since those of the frame before, up to the first at or after the image.
    /// `cairn::sensor::Merge` puts streams with rates and delays of their own in that order.
    ///
    /// # Errors
    /// As [`Slam::track`].
    pub fn track_images(
        &mut self,
        stamp: Stamp,
        images: Vec<GrayImage>,
        depth: Option<DepthImage>,
        imu: Vec<ImuSample>,
    ) -> Result<Output, Error> {
        let images = images.into_iter().map(Arc::new).collect();
        self.track(&FramePacket { stamp, images, depth: depth.map(Arc::new), imu, decode_ms: 0.0 })
    }

    /// Waits for mapping and adjusts the whole map a last time. Call it after the last frame, before
    /// [`Slam::trajectory`] and [`Slam::save`].
    pub fn finish(&mut self) -> Finished {
        self.session.engine_mut().finish()
    }

    /// What wheels or the like measured of the motion of the body since the frame before; for each frame, before it. See
    /// [`Engine::motion_measured`].
    pub fn motion_measured(&mut self, motion: &MeasuredMotion) {
        self.session.engine_mut().motion_measured(motion);
    }

    /// Says where the camera is, roughly: it is looked for there from the next frame on, and the place counts once an image confirms it.
    /// See [`Engine::hint`].
    pub fn hint(&mut self, hint: PlaceHint) {
        self.session.engine_mut().hint(hint);
    }

    /// What has become of the last hint; `None` where there was none.
    pub fn hint_outcome(&self) -> Option<HintOutcome> {
        self.engine().hint_outcome()
    }

    /// The latest map.
    pub fn map(&self) -> Map {
        Map::of(self.engine())
    }

    /// All changes of the map from now on.
    ///
    /// # Errors
    /// [`Error::MappingStopped`] when mapping has failed.
    pub fn changes(&mut self) -> Result<Changes, Error> {
        self.session.engine_mut().subscribe().map(Changes::new).ok_or(Error::MappingStopped)
    }

    /// The events that concern a whole map, from now on: created, gravity-aligned, rescaled, joined by a loop, merged.
    ///
    /// # Errors
    /// [`Error::MappingStopped`] when mapping has failed.
    pub fn events(&mut self) -> Result<MapEvents, Error> {
        self.changes().map(MapEvents::new)
    }

    /// `world_from_body` of every frame that was tracked, with all corrections of the map so far.
    ///
    /// # Errors
    /// [`Error::Trajectory`] when two frames have the same time.
    pub fn trajectory(&self) -> Result<Trajectory, Error> {
        trajectory(self.engine().trajectory())
    }

    /// `world_from_body` of every frame that was tracked, as it was estimated at the time.
    ///
    /// # Errors
    /// As [`Slam::trajectory`].
    pub fn live_trajectory(&self) -> Result<Trajectory, Error> {
        trajectory(self.engine().live_trajectory())
    }

    /// `odom_from_body` of every frame that was tracked, one trajectory for each segment of odometry: no correction of the
    /// map moves it (see [`cairn_engine::Odometry`]).
    ///
    /// # Errors
    /// As [`Slam::trajectory`].
    pub fn odometry(&self) -> Result<Vec<Trajectory>, Error> {
        self.engine().odometry_segments().into_iter().map(trajectory).collect()
    }

    /// Compares the trajectory with true poses `world_from_body`: aligned by SE3, or by Sim3 where lengths are not
    /// metres.
    ///
    /// # Errors
    /// As [`accuracy`].
    pub fn accuracy(&self, truth: &[(Stamp, Se3)]) -> Result<Evaluation, Error> {
        accuracy(self.engine(), truth)
    }

    /// Whether lengths are metres in the whole map.
    pub fn is_metric(&self) -> bool {
        self.engine().is_metric()
    }

    /// What the engine is doing and waiting for, in numbers and words.
    pub fn status(&self) -> &Status {
        self.engine().status()
    }

    /// Small differences between this camera and that of the map it was built with, one line each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Saves the map with the routes recorded in it; returns the size in bytes. A file of that name is replaced once
    /// the new one is complete.
    ///
    /// # Errors
    /// [`Error::EmptyMap`], and [`Error::MapFile`] when the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<u64, Error> {
        let file = map_file(&self.session, &self.attached).ok_or(Error::EmptyMap)?;
        Ok(file.save(path.as_ref())?)
    }

    /// Loads a saved map, for [`crate::Builder::map`] and [`crate::Builder::localize_in`].
    ///
    /// # Errors
    /// [`Error::MapFile`] when it cannot be read, is no map, or is damaged.
    pub fn load_map(path: impl AsRef<Path>) -> Result<MapFile, Error> {
        Ok(MapFile::load(path.as_ref())?)
    }

    /// The engine, for what has no method here.
    pub fn engine(&self) -> &Engine {
        self.session.engine()
    }

    /// The session, for what has no method here.
    pub fn session(&self) -> &Session {
        &self.session
    }
}

fn trajectory(poses: Vec<(Stamp, Se3)>) -> Result<Trajectory, Error> {
    Ok(Trajectory::from_unsorted(poses.into_iter().map(|(t, pose)| (t.0, pose)).collect())?)
}

/// What no source delivers but a caller may.
fn check(packet: &FramePacket, last: Option<Stamp>) -> Result<(), FrameError> {
    if let Some(before) = last.filter(|last| packet.stamp <= *last) {
        return Err(FrameError::NotLater { before });
    }
    let finite = |s: &ImuSample| s.gyro.iter().chain(s.accel.iter()).all(|v| v.is_finite());
    if let Some(bad) = packet.imu.iter().find(|s| !finite(s)) {
        return Err(FrameError::ImuNotFinite(bad.stamp));
    }
    if let Some([a, b]) = packet.imu.windows(2).find(|w| w[1].stamp <= w[0].stamp) {
        return Err(FrameError::ImuOrder { sample: b.stamp, before: a.stamp });
    }
    Ok(())
}
