//! Insertion of key frames: with the landmarks tracking matched, and with new ones from the frame's own
//! depth.

use cairn_adjust::depth;
use cairn_atlas::{Change, InertialState, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::bow::Vocabulary;
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

/// Allocates ids of new landmarks, in order.
pub(crate) struct NewLandmarks {
    next: usize,
    pub ids: Vec<LandmarkId>,
}

impl NewLandmarks {
    pub fn after(snapshot: &Snapshot) -> Self {
        Self { next: snapshot.next_landmark_id().index(), ids: Vec::new() }
    }

    /// The next id; `None` when all ids are used up.
    pub fn id(&mut self) -> Option<LandmarkId> {
        let id = LandmarkId::from_index(self.next)?;
        self.next += 1;
        self.ids.push(id);
        Some(id)
    }
}

/// A key frame about to be inserted.
pub(crate) struct Entry<'a> {
    pub id: KeyFrameId,
    pub frame: &'a Arc<Frame>,
    pub world_from_camera: Se3,
    /// The landmark that each feature shows, where known.
    pub observed: &'a [Option<LandmarkId>],
    /// Velocity, biases and IMU factor, where there is an IMU.
    pub motion: Option<InertialState>,
}

/// The changes that add a key frame with its bag of words and its observations.
pub(crate) fn add_key_frame(entry: &Entry, parent: Option<KeyFrameId>) -> Vec<Change> {
    let bag = Vocabulary::current().bag(&entry.frame.descriptors);
    let mut key_frame =
        KeyFrame::new(entry.id, entry.frame.clone(), entry.world_from_camera, parent).with_bag(Arc::new(bag));
    key_frame.motion = entry.motion.clone();
    let mut changes = vec![Change::AddKeyFrame(Box::new(key_frame))];
    let observed = entry.observed.iter().enumerate();
    changes.extend(observed.filter_map(|(i, l)| l.map(|l| Change::Observe(l, entry.id, i as u16))));
    changes
}

/// New landmarks for the features of a key frame that have depth and no landmark yet: all close ones, then the
/// nearest of the others until the count reaches `least`.
pub(crate) fn points_from_depth(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    entry: &Entry,
    least: usize,
    new_landmarks: &mut NewLandmarks,
) -> Vec<Change> {
    let frame = entry.frame;
    let mut by_depth: Vec<usize> = (0..frame.len()).filter(|i| frame.has_depth(*i)).collect();
    by_depth.sort_by(|a, b| frame.depth[*a].total_cmp(&frame.depth[*b]).then(a.cmp(b)));
    let mut changes = Vec::new();
    for (rank, i) in by_depth.into_iter().enumerate() {
        if frame.depth[i] as f64 > camera.close_depth && rank >= least {
            break;
        }
        if entry.observed[i].is_some() {
            continue;
        }
        let Some(landmark) = new_landmarks.id() else { break };
        let point: Vec3 =
            entry.world_from_camera * camera.unproject(frame.px[i], depth(snapshot, camera, frame, i));
        changes.push(Change::AddLandmark(landmark, point));
        changes.push(Change::Observe(landmark, entry.id, i as u16));
    }
    changes
}
