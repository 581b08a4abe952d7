//! What a robot gives others of its map: where its key frames stand, and features of some.
//!
//! Which ones others need features of is decided twice: of the key frames that look like one of the other's by words, a few along the way
//! (Lajoie et al., "DOOR-SLAM", 2020, exchange in this order); then those that the other asks for ([`super::checks`]).

use super::graph::pose_id;
use crate::{MapWords, OwnMapError, own_map};
use cairn_atlas::store::MapFile;
use cairn_atlas::store::pieces::Pieces;
use cairn_atlas::{KeyFrameId, KeyFrameName, RobotId, Snapshot};
use cairn_team::peer::Peer;
use cairn_team::{MAX_REQUESTED, Refused, RobotError, Viewpoint, Viewpoints};
use std::collections::{BTreeMap, BTreeSet};

/// Key frames whose features go to another robot at first, at most; places at three positions must agree.
const MOST_PLACES: usize = 6;
/// Further key frames that another robot may ask for, at most, as often as it is started.
const MOST_REQUESTED: usize = 3 * MAX_REQUESTED;
/// How far a key frame may be from where its viewpoint says, metres, and the cosine between both axes: what rounding leaves.
const NEAR: f64 = 0.02;
const ALONG: f64 = 0.999;

/// What another robot gave of its map.
pub struct Places {
    pub viewpoints: Viewpoints,
    /// A map of the key frames with features alone.
    pub file: MapFile,
}

/// Why what another robot gave cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PlacesError {
    #[error("they end early")]
    Cut,
    #[error(transparent)]
    Viewpoints(#[from] Refused),
    #[error(transparent)]
    Features(#[from] OwnMapError),
    #[error("key frame {0} stands elsewhere than it is said to")]
    Astray(u32),
}

impl Places {
    /// Reads what [`Given::publish`] made.
    pub fn read(robot: RobotId, bytes: &[u8]) -> Result<Self, PlacesError> {
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or(PlacesError::Cut)?;
        let (viewpoints, features) =
            rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or(PlacesError::Cut)?;
        let viewpoints = Viewpoints::decode(robot, viewpoints)?;
        let file = own_map(robot, features)?;
        for k in file.snapshot.key_frames() {
            let (seq, at) = (pose_id(&file.snapshot, k.id).seq, Viewpoint::of(&k.world_from_camera));
            let said = viewpoints.0.get(&seq).ok_or(PlacesError::Astray(seq))?;
            if (said.position - at.position).norm() > NEAR || said.axis.dot(&at.axis) < ALONG {
                return Err(PlacesError::Astray(seq));
            }
        }
        Ok(Self { viewpoints, file })
    }

    /// The numbers of the key frames with features.
    pub fn seqs(&self) -> BTreeSet<u32> {
        self.file.snapshot.key_frames().map(|k| pose_id(&self.file.snapshot, k.id).seq).collect()
    }
}

/// What a robot gives.
#[derive(Debug, Default)]
pub struct Given {
    /// The key frames whose features others get.
    pub seqs: BTreeSet<u32>,
    /// Those that each other robot asked for.
    requested: BTreeMap<RobotId, BTreeSet<u32>>,
    pieces: Pieces,
}

impl Given {
    /// Adds key frames that another robot needs first: of all that look like one of its, evenly chosen, and where there is a choice those
    /// whose features are given already.
    pub fn add_similar(&mut self, own: &MapWords, other: &MapWords) {
        let similar = own.similar_key_frames(other);
        let stretches = similar.chunks(similar.len().div_ceil(MOST_PLACES).max(1));
        let chosen: Vec<u32> = stretches
            .map(|stretch| {
                let middle = stretch[stretch.len() / 2];
                let given = stretch.iter().filter(|seq| self.seqs.contains(seq));
                given.copied().min_by_key(|seq| seq.abs_diff(middle)).unwrap_or(middle)
            })
            .collect();
        self.seqs.extend(chosen);
    }

    /// Adds key frames that another robot asks for; what a user should know where they are not given.
    pub fn add_requested(&mut self, own: &Viewpoints, by: RobotId, seqs: &BTreeSet<u32>) -> Option<String> {
        let requested = self.requested.entry(by).or_default();
        let (known, unknown): (BTreeSet<u32>, BTreeSet<u32>) =
            seqs.iter().partition(|seq| own.0.contains_key(seq));
        if requested.union(&known).count() > MOST_REQUESTED {
            return Some(format!(
                "robot {by} asks for more than {MOST_REQUESTED} key frames, which it does not get"
            ));
        }
        requested.extend(&known);
        self.seqs.extend(known);
        let unknown: Vec<String> = unknown.iter().map(u32::to_string).collect();
        let names = unknown.join(", ");
        (!unknown.is_empty())
            .then(|| format!("robot {by} asks for key frames that are not in this map: {names}"))
    }

    /// Publishes the viewpoints of all key frames and the features of those to be given.
    ///
    /// # Errors
    /// [`RobotError::TooMuch`].
    pub fn publish(&mut self, own: &Viewpoints, file: &MapFile, peer: &mut Peer) -> Result<(), RobotError> {
        let robot = peer.robot();
        let Some(snapshot) = only(&file.snapshot, robot, &self.seqs) else { return Ok(()) };
        let file = MapFile { snapshot, attached: BTreeMap::new(), ..file.clone() };
        let viewpoints = own.encode(robot).ok_or(RobotError::TooMuch(robot))?;
        self.pieces.add(&file).map_err(|_| RobotError::TooMuch(robot))?;
        let mut bytes = (viewpoints.len() as u32).to_le_bytes().to_vec();
        bytes.extend(viewpoints);
        let lengths = [&[bytes.len()], self.pieces.lengths()].concat();
        bytes.extend(self.pieces.bytes());
        peer.publish_places(&bytes, &lengths).map_err(|_| RobotError::TooMuch(robot))?;
        Ok(())
    }
}

/// A map of these key frames alone, with the landmarks that they show; `None` where there is none of them.
fn only(snapshot: &Snapshot, robot: RobotId, seqs: &BTreeSet<u32>) -> Option<Snapshot> {
    let id = |seq: &u32| snapshot.key_frame_named(KeyFrameName { robot, seq: *seq });
    let keep: BTreeSet<KeyFrameId> = seqs.iter().filter_map(id).collect();
    snapshot.cut(&keep)
}
