//! Loops between the key frames of two robots: by features of the other's candidates, verified as two saved maps are that become one.

use super::graph::pose_id;
use super::information;
use crate::merge::{MergeError, side_by_side};
use cairn_atlas::Snapshot;
use cairn_atlas::store::MapFile;
use cairn_engine::Config;
use cairn_geometry::Se3;
use cairn_mapping::{Agreement, Apart, Recognised};
use cairn_team::{Measurement, PoseId};
use cairn_vision::RectifiedCamera;
use nalgebra::Matrix6;
use std::collections::BTreeMap;

/// What all features of a key frame have in common does not average out: standard deviations of a recognised pose, metres for each metre of
/// depth and radians, beyond that of its points.
const IN_COMMON: [f64; 2] = [0.002, 0.001];

/// Of the few key frames that should show the map, the share that must: where all rooms look alike, six of eight and seven of nine did.
const SUPPORT: f64 = 0.95;

/// What came of comparing a map with another robot's candidates.
#[derive(Debug, Default)]
pub struct FoundLoops {
    /// The loops that agree with each other, one for each key frame.
    pub loops: Vec<Measurement<Se3, 6>>,
    /// Why there is none, where that was found out.
    pub apart: Option<String>,
}

/// The loops between a robot's map and key frames of another one. Which places agree is decided as when saved maps are joined
/// ([`cairn_mapping::Closer::compare_maps`]: pairwise consistent places at three positions, nothing that contradicts them), but that
/// all of the few key frames that should show the map must. Where several places were recognised in one key frame, that with most landmarks counts.
///
/// # Errors
/// [`MergeError`]: the maps do not fit each other.
pub fn loops_between(own: &MapFile, places: MapFile, config: &Config) -> Result<FoundLoops, MergeError> {
    let (ours, theirs) = ("own".to_owned(), "other".to_owned());
    let both = side_by_side(vec![(ours, own.clone()), (theirs, places)])?;
    let (snapshot, closer) = (&both.file.snapshot, both.closer(config));
    let roots: Vec<_> = both.maps.keys().copied().collect();
    let mut found = FoundLoops::default();
    for (n, from) in roots.iter().enumerate() {
        for into in &roots[..n] {
            match closer.compare_maps(snapshot, *into, *from).result {
                Ok(Agreement { support, .. })
                    if (support.shown as f64) < SUPPORT * support.expected as f64 =>
                {
                    found.apart = Some(Apart::Unsupported(support).to_string());
                }
                Ok(agreed) => found.loops.extend(best(snapshot, &both.file.about.camera, &agreed)),
                Err(why) => found.apart = Some(why.to_string()),
            }
        }
    }
    Ok(found)
}

/// One loop for each key frame in which places were recognised.
fn best(snapshot: &Snapshot, camera: &RectifiedCamera, agreed: &Agreement) -> Vec<Measurement<Se3, 6>> {
    let mut best: BTreeMap<PoseId, &(_, Recognised)> = BTreeMap::new();
    for found in &agreed.recognised {
        let held = best.entry(pose_id(snapshot, found.0)).or_insert(found);
        if found.1.inliers > held.1.inliers {
            *held = found;
        }
    }
    best.values().filter_map(|(here, place)| measured(snapshot, camera, *here, place)).collect()
}

fn measured(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    here: cairn_atlas::KeyFrameId,
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
