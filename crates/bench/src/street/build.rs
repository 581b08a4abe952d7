//! The map of a street, built by the changes that mapping would commit, with a drift that grows along the way.

use super::world::{OCTAVES, Street};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::bow::Vocabulary;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

/// Metres between two key frames.
pub const STEP_M: f64 = 0.5;
/// Walking speed, metres a second.
pub const SPEED_MPS: f64 = 1.4;
/// Drift for each metre of the way, metres.
const DRIFT: [f64; 3] = [8e-4, 1e-4, 5e-4];

/// How far off the map is at a distance along the way.
pub fn drift(along_m: f64) -> Se3 {
    Se3::new(cairn_geometry::So3::identity(), Vec3::from(DRIFT) * along_m)
}

/// A map under construction.
#[derive(Debug)]
pub struct Built {
    /// The map.
    pub atlas: Atlas,
    /// Seconds to commit each key frame.
    pub commit_s: Vec<f64>,
    /// The newest key frame.
    pub newest: Option<KeyFrameId>,
    /// Distance of the newest along the way, metres.
    pub along_m: f64,
}

/// The map of a stretch of a street, from one distance along the way to another; `seed` draws the noise.
pub fn build(street: &mut Street, from_m: f64, to_m: f64, seed: u64) -> Built {
    let mut built = Built {
        atlas: Atlas::new(Snapshot::with_octaves(OCTAVES)),
        commit_s: Vec::new(),
        newest: None,
        along_m: from_m,
    };
    let mut shown: HashMap<u64, (usize, LandmarkId)> = HashMap::new();
    let count = ((to_m - from_m) / STEP_M) as usize;
    for n in 0..count {
        let along_m = from_m + STEP_M * n as f64;
        let view = street.see(along_m, along_m / SPEED_MPS, seed);
        let snapshot = built.atlas.latest();
        let id = snapshot.next_key_frame_id();
        let mut next = snapshot.next_landmark_id().index();
        let bag = Vocabulary::embedded().bag(&view.frame.descriptors);
        let pose = drift(along_m) * street.pose(along_m);
        let key_frame = KeyFrame::new(id, view.frame.clone(), pose, built.newest).with_bag(Arc::new(bag));
        let mut changes = vec![Change::AddKeyFrame(Box::new(key_frame))];
        for (feature, point) in view.points.iter().enumerate() {
            let Some(point) = *point else { continue };
            let landmark = match shown.get(&point) {
                Some((_, landmark)) => *landmark,
                None => {
                    let Some(landmark) = LandmarkId::from_index(next) else { continue };
                    next += 1;
                    changes.push(Change::AddLandmark(landmark, drift(along_m) * street.position(point)));
                    landmark
                }
            };
            shown.insert(point, (n, landmark));
            changes.push(Change::Observe(landmark, id, feature as u16));
        }
        shown.retain(|_, (last, _)| *last + 20 > n);
        let start = Instant::now();
        built.atlas.commit(changes);
        built.commit_s.push(start.elapsed().as_secs_f64());
        (built.newest, built.along_m) = (Some(id), along_m);
        if (n + 1) % 1000 == 0 {
            eprintln!("{} key frames, {} landmarks", n + 1, built.atlas.latest().landmark_count());
        }
    }
    built
}
