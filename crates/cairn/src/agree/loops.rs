//! Loops between the key frames of two robots: by features of the other's candidates, verified as two saved maps are that become one.

use super::graph::pose_id;
use super::information;
use crate::merge::{MergeError, side_by_side};
use cairn_atlas::store::MapFile;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_engine::Config;
use cairn_geometry::Se3;
use cairn_mapping::{Agreement, Recognised};
use cairn_team::{Measurement, PoseId};
use cairn_vision::RectifiedCamera;
use nalgebra::Matrix6;
use std::collections::BTreeMap;

/// What all features of a key frame have in common does not average out: standard deviations of a recognised pose, metres for each metre of
/// depth and radians, beyond that of its points.
const IN_COMMON: [f64; 2] = [0.002, 0.001];

/// What the own map and features of another robot say of each other.
#[derive(Debug)]
pub enum Compared {
    /// Why there is no loop.
    Apart(String),
    /// Places that agree with each other.
    Agreed(Agreed),
}

/// Places that agree with each other.
#[derive(Debug)]
pub struct Agreed {
    /// The key frames of the other robot in which an own place was recognised, and how its map lies to the own one by each.
    pub seams: Vec<(u32, Se3)>,
    /// Of the key frames with features those that should show the own map, and whether they do.
    pub expected: BTreeMap<u32, bool>,
    /// A loop for each of the key frames.
    pub loops: Vec<Measurement<Se3, 6>>,
}

/// Compares a robot's map with key frames of another one. Which places agree is decided as when saved maps are joined
/// ([`cairn_mapping::Closer::compare_maps`]: pairwise consistent places at three positions, nothing that contradicts them).
/// Where several places were recognised in one key frame, that with most landmarks counts.
///
/// # Errors
/// [`MergeError`]: the maps do not fit each other.
pub fn compare(own: &MapFile, places: MapFile, config: &Config) -> Result<Compared, MergeError> {
    let (ours, theirs) = ("own".to_owned(), "other".to_owned());
    let both = side_by_side(vec![(ours, own.clone()), (theirs, places)])?;
    let (snapshot, camera) = (&both.file.snapshot, &both.file.about.camera);
    let mut maps = both.maps.keys();
    let (Some(into), Some(from)) = (maps.next(), maps.next()) else { return Err(MergeError::Empty) };
    Ok(match both.closer(config).compare_maps(snapshot, *into, *from).result {
        Err(why) => Compared::Apart(why.to_string()),
        Ok(agreed) => {
            let seq = |id| pose_id(snapshot, id).seq;
            let best = best(snapshot, &agreed);
            let seam = |(here, place): &(KeyFrameId, Recognised)| {
                let k = snapshot.key_frame(*here)?;
                Some((seq(*here), place.world_from_camera * k.world_from_camera.inverse()))
            };
            Compared::Agreed(Agreed {
                seams: best.iter().filter_map(seam).collect(),
                expected: agreed.expected.iter().map(|(id, shows)| (seq(*id), *shows)).collect(),
                loops: best
                    .iter()
                    .filter_map(|(here, place)| measured(snapshot, camera, *here, place))
                    .collect(),
            })
        }
    })
}

/// The place with most landmarks of each key frame in which places were recognised.
fn best(snapshot: &Snapshot, agreed: &Agreement) -> Vec<(KeyFrameId, Recognised)> {
    let mut best: BTreeMap<PoseId, &(KeyFrameId, Recognised)> = BTreeMap::new();
    for found in &agreed.recognised {
        let held = best.entry(pose_id(snapshot, found.0)).or_insert(found);
        if found.1.inliers > held.1.inliers {
            *held = found;
        }
    }
    best.into_values().cloned().collect()
}

fn measured(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    here: KeyFrameId,
    place: &Recognised,
) -> Option<Measurement<Se3, 6>> {
    let (old, k) = (snapshot.key_frame(place.old)?, snapshot.key_frame(here)?);
    let (mut information, mut depths) = (Matrix6::zeros(), Vec::new());
    let camera_from_world = place.world_from_camera.inverse();
    for (feature, id) in place.landmarks.iter().enumerate() {
        let Some(l) = id.and_then(|id| snapshot.landmark(id)) else { continue };
        let position = camera_from_world * l.position;
        let known = information::of_landmark(snapshot, camera, l);
        let seen = information::at_pose(snapshot, camera, k, feature, &position, &place.world_from_camera);
        information += information::of_point(&known, &seen, &place.world_from_camera, &position);
        depths.push(position.z);
    }
    depths.sort_by(f64::total_cmp);
    let depth = *depths.get(depths.len() / 2)?;
    Some(Measurement {
        a: pose_id(snapshot, place.old),
        b: pose_id(snapshot, here),
        a_from_b: old.world_from_camera.inverse() * place.world_from_camera,
        information: with_common_errors(&information, depth)?,
    })
}

/// The information where what all points have in common is added to their covariance.
fn with_common_errors(information: &Matrix6<f64>, depth: f64) -> Option<Matrix6<f64>> {
    let [share, radians] = IN_COMMON;
    let (metres, turn) = ((share * depth).powi(2), radians.powi(2));
    let common = Matrix6::from_diagonal(&[metres, metres, metres, turn, turn, turn].into());
    let covariance = information.cholesky()?.inverse() + common;
    Some(covariance.cholesky()?.inverse())
}
