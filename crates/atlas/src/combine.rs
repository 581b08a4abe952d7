//! Combining two snapshots: the maps of the second are added, unaligned, until a place is recognised.

use crate::{KeyFrameId, LandmarkId, MapId, MapPrior, Observation, RobotId, Snapshot};
use cairn_vision::Octaves;
use std::collections::BTreeMap;
use std::sync::Arc;

/// How ids were shifted when a snapshot was added to another, and names where both had the same ones.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shift {
    /// Added to the index of every key frame.
    pub key_frames: usize,
    /// Added to the index of every landmark.
    pub landmarks: usize,
    /// New numbers of robots of the other snapshot, whose names would have been those of other key frames here. What
    /// refers to names, such as a recorded route, has to follow.
    pub robots: BTreeMap<RobotId, RobotId>,
}

impl Shift {
    /// The id of a key frame after the shift; `None` when there are no more ids.
    pub fn key_frame(&self, id: KeyFrameId) -> Option<KeyFrameId> {
        KeyFrameId::from_index(id.index() + self.key_frames)
    }

    /// The number of a robot after it.
    pub fn robot(&self, robot: RobotId) -> RobotId {
        self.robots.get(&robot).copied().unwrap_or(robot)
    }

    /// The id of a landmark after the shift; `None` when there are no more ids.
    pub fn landmark(&self, id: LandmarkId) -> Option<LandmarkId> {
        LandmarkId::from_index(id.index() + self.landmarks)
    }

    fn map(&self, id: MapId) -> Option<MapId> {
        self.key_frame(id.root()).map(MapId)
    }
}

/// Why two maps cannot be in one atlas.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CombineError {
    /// Their pyramids differ: levels of features could not be compared.
    #[error("one map has {0:?}, the other {1:?}")]
    Octaves(Octaves, Octaves),
    /// Numbers of robots run out.
    #[error("there are not enough numbers for the robots of both maps")]
    Robots,
    /// Ids run out.
    #[error("there are not enough ids for both maps")]
    Ids,
}

impl Snapshot {
    /// This snapshot with all maps of another added, unaligned: what the other holds keeps its order and gets
    /// ids after those of this one; names stay, except of a robot that both have. The disparity correction stays that
    /// of this snapshot, and so does the camera of the atlas: the other one must be in an atlas of that camera, too. Of two mounts of that
    /// camera on an IMU the first stays; what an IMU measured that is mounted otherwise, or nobody knows how, is left out.
    ///
    /// # Errors
    /// [`CombineError`].
    pub fn combined_with(&self, other: &Snapshot) -> Result<(Snapshot, Shift), CombineError> {
        if self.octaves != other.octaves {
            return Err(CombineError::Octaves(self.octaves, other.octaves));
        }
        let robots = self.renamed_robots(other).ok_or(CombineError::Robots)?;
        let shift = Shift { key_frames: self.next_key_frame, landmarks: self.next_landmark, robots };
        let snapshot = match self.imu_from_camera.or(other.imu_from_camera) {
            Some(mount) => self.of_mount(mount).combined(&other.of_mount(mount), &shift),
            None => self.combined(other, &shift),
        };
        let snapshot = snapshot.ok_or(CombineError::Ids)?;
        Ok((snapshot, shift))
    }

    fn combined(&self, other: &Snapshot, shift: &Shift) -> Option<Snapshot> {
        let mut snapshot = self.clone();
        snapshot.version = self.version.max(other.version) + 1;
        snapshot.names = Arc::new(self.names_with(other, &shift.robots));
        snapshot.next_key_frame = shift.key_frames + other.next_key_frame;
        snapshot.next_landmark = shift.landmarks + other.next_landmark;
        // The ids that the next ones will have must be ids too.
        KeyFrameId::from_index(snapshot.next_key_frame)?;
        LandmarkId::from_index(snapshot.next_landmark)?;
        for k in other.key_frames() {
            let mut k = k.clone();
            k.id = shift.key_frame(k.id)?;
            k.map = shift.map(k.map)?;
            k.parent = match k.parent {
                Some(parent) => Some(shift.key_frame(parent)?),
                None => None,
            };
            for id in &mut k.links {
                *id = shift.key_frame(*id)?;
            }
            for relative in &mut k.relative_poses {
                relative.from = shift.key_frame(relative.from)?;
            }
            if let Some(imu_factor) = k.motion.as_mut().and_then(|m| m.imu_factor.as_mut()) {
                imu_factor.since = shift.key_frame(imu_factor.since)?;
            }
            for (id, _) in k.covisible.iter_mut().chain(k.shares.0.iter_mut().flatten()) {
                *id = shift.key_frame(*id)?;
            }
            for id in k.landmarks.iter_mut().flatten() {
                *id = shift.landmark(*id)?;
            }
            snapshot.places.insert(k.id, &k.bag.shared());
            snapshot.made_by.add(&k);
            snapshot.key_frames.insert(k.id.index(), k);
        }
        for l in other.landmarks() {
            let mut l = l.clone();
            l.id = shift.landmark(l.id)?;
            for Observation { key_frame, .. } in &mut l.observations {
                *key_frame = shift.key_frame(*key_frame)?;
            }
            snapshot.landmarks.insert(l.id.index(), l);
        }
        for (index, (parent, parent_from_it)) in other.removed.iter() {
            snapshot.removed.insert(index + shift.key_frames, (shift.key_frame(*parent)?, *parent_from_it));
        }
        let maps = Arc::make_mut(&mut snapshot.maps);
        for (map, map_prior) in other.maps() {
            let map_prior = match map_prior {
                Some(map_prior) => Some(MapPrior { to: shift.key_frame(map_prior.to)?, ..*map_prior }),
                None => None,
            };
            maps.insert(shift.map(map)?, map_prior);
        }
        let gravity_alignments = Arc::make_mut(&mut snapshot.gravity_alignments);
        for (map, times) in other.gravity_alignments.iter() {
            gravity_alignments.insert(shift.map(*map)?, *times);
        }
        let scale_sigmas = Arc::make_mut(&mut snapshot.scale_sigmas);
        for (map, sigma_log) in other.scale_sigmas.iter() {
            scale_sigmas.insert(shift.map(*map)?, *sigma_log);
        }
        let cameras = Arc::make_mut(&mut snapshot.other_cameras);
        for camera in other.other_cameras.iter() {
            if !cameras.contains(camera) {
                cameras.push(camera.clone());
            }
        }
        Some(snapshot)
    }
}
