//! The atlas that the robots of a team share: their maps in one, joined where they show the same places.

use crate::{MergeError, MergedMaps, merge_maps};
use cairn_atlas::RobotId;
use cairn_atlas::store::{MapFile, StoreError, pieces};
use cairn_engine::Config;
use std::collections::BTreeMap;

/// The atlas that robots share.
#[derive(Clone, Debug)]
pub struct SharedAtlas {
    /// The maps in one, by rising number of the robot; each is named `robot N`.
    pub merged: MergedMaps,
    /// Whose map is not in it, and why.
    pub left_out: BTreeMap<RobotId, String>,
}

/// The atlas of a team, made again each time that maps have changed; those that have not are not read again. It is the same, to the
/// last byte, as one that is made from nothing.
#[derive(Clone, Debug)]
pub struct TeamAtlas {
    config: Config,
    /// The maps as they were read last, or why they cannot be used.
    read: BTreeMap<RobotId, (Vec<u8>, Result<MapFile, String>)>,
}

impl TeamAtlas {
    /// Nothing is known yet.
    pub fn new(config: &Config) -> Self {
        Self { config: config.clone(), read: BTreeMap::new() }
    }

    /// Puts the maps of the robots of a team into one atlas. The same maps always give the same atlas, whatever came before, so that
    /// robots which have the same maps need not exchange what came of them. `None` when no map can be used.
    ///
    /// Robots may have different cameras. Left out are maps that are damaged, or that hold key frames of another robot than the one
    /// that published them.
    pub fn update(&mut self, parts: &BTreeMap<RobotId, Vec<u8>>) -> Option<SharedAtlas> {
        self.read(parts);
        let mut left_out = BTreeMap::new();
        let mut files: BTreeMap<RobotId, MapFile> = BTreeMap::new();
        for (robot, (_, map)) in &self.read {
            match map {
                Ok(file) => drop(files.insert(*robot, file.clone())),
                Err(why) => drop(left_out.insert(*robot, why.clone())),
            }
        }
        loop {
            let named = files.iter().map(|(robot, file)| (format!("robot {robot}"), file.clone())).collect();
            let (name, why) = match merge_maps(named, &self.config) {
                Ok(merged) => return Some(SharedAtlas { merged, left_out }),
                Err(MergeError::Empty) => return None,
                Err(MergeError::CombineError { name, why }) => {
                    (name, format!("it does not fit the first map: {why}"))
                }
                Err(MergeError::Route { name, route, source }) => (name, format!("route {route}: {source}")),
                Err(MergeError::Depth { name, source }) => (name, source.to_string()),
            };
            let robot = files.keys().copied().find(|robot| name == format!("robot {robot}"))?;
            files.remove(&robot);
            left_out.insert(robot, why);
        }
    }

    /// Reads what changed.
    fn read(&mut self, parts: &BTreeMap<RobotId, Vec<u8>>) {
        self.read.retain(|robot, (bytes, _)| parts.get(robot) == Some(bytes));
        for (robot, bytes) in parts {
            let read = || (bytes.clone(), own_map(*robot, bytes).map_err(|why| why.to_string()));
            self.read.entry(*robot).or_insert_with(read);
        }
    }
}

/// The same once: see [`TeamAtlas::update`].
pub fn shared_atlas(parts: &BTreeMap<RobotId, Vec<u8>>, config: &Config) -> Option<SharedAtlas> {
    TeamAtlas::new(config).update(parts)
}

/// Why a map is not one that a robot made by itself.
#[derive(Debug, thiserror::Error)]
pub enum OwnMapError {
    /// It cannot be read, or not be written again.
    #[error(transparent)]
    Damaged(#[from] StoreError),
    /// It holds what another robot made.
    #[error("it holds {key_frames} key frames of robot {robot}")]
    OtherRobot {
        /// So many.
        key_frames: usize,
        /// Whose they are.
        robot: RobotId,
    },
    /// Nothing of the robot is in it.
    #[error("it has no key frame of robot {0}")]
    Empty(RobotId),
}

/// The map that a robot made by itself: a saved map, or one in pieces ([`pieces`]).
///
/// # Errors
/// [`OwnMapError`].
pub fn own_map(robot: RobotId, bytes: &[u8]) -> Result<MapFile, OwnMapError> {
    let file = match pieces::is_in_pieces(bytes) {
        true => pieces::read(bytes),
        false => MapFile::read(bytes),
    };
    let file = file?;
    let robots = file.snapshot.robots();
    match robots.keys().find(|r| **r != robot) {
        Some(other) => Err(OwnMapError::OtherRobot { key_frames: robots[other], robot: *other }),
        None if robots.is_empty() => Err(OwnMapError::Empty(robot)),
        None => Ok(file),
    }
}

/// What a robot gives to its team of a saved map: all of a map that it made by itself; of one that it continued, as of the atlas that
/// the team shares, what it made itself ([`cairn_atlas::Snapshot::part_of`]), with all routes. The others give theirs.
///
/// # Errors
/// [`OwnMapError`]: it is damaged, or nothing of the robot is in it.
pub fn own_part(robot: RobotId, bytes: &[u8]) -> Result<MapFile, OwnMapError> {
    let mut file = MapFile::read(bytes)?;
    if file.snapshot.key_frame_count() == 0 {
        return Err(OwnMapError::Empty(robot));
    }
    if file.snapshot.robots().keys().any(|r| *r != robot) {
        file.snapshot = file.snapshot.part_of(robot).ok_or(OwnMapError::Empty(robot))?;
        let mut depth = file.take_depth()?;
        depth.retain(|part| part.submap.key_frame.robot == robot);
        for part in &mut depth {
            part.images.retain(|image| image.place.key_frame.robot == robot);
        }
        file.add_depth(&depth);
    }
    Ok(file)
}
