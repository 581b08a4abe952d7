//! Key frames enter the map: with what tracking matched, and with the points their own depth shows.

use cairn_adjust::depth;
use cairn_atlas::{Change, InertialState, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::bow::Vocabulary;
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

/// Ids of new landmarks, in order.
pub(crate) struct NewLandmarks {
    next: usize,
    pub born: Vec<LandmarkId>,
}

impl NewLandmarks {
    pub fn after(snapshot: &Snapshot) -> Self {
        Self { next: snapshot.next_landmark_id().index(), born: Vec::new() }
    }

    /// The next id; `None` when there are no more.
    pub fn id(&mut self) -> Option<LandmarkId> {
        let id = LandmarkId::from_index(self.next)?;
        self.next += 1;
        self.born.push(id);
        Some(id)
    }
}

/// A key frame about to enter the map.
pub(crate) struct Entry<'a> {
    pub id: KeyFrameId,
    pub frame: &'a Arc<Frame>,
    pub world_from_camera: Se3,
    /// The landmark that each feature is known to show.
    pub shown: &'a [Option<LandmarkId>],
    /// How the eye moved, where that was felt.
    pub motion: Option<InertialState>,
}

/// A key frame with its words and the landmarks it is known to show.
pub(crate) fn add_key_frame(entry: &Entry, parent: Option<KeyFrameId>) -> Vec<Change> {
    let bag = Vocabulary::embedded().bag(&entry.frame.descriptors);
    let mut key_frame =
        KeyFrame::new(entry.id, entry.frame.clone(), entry.world_from_camera, parent).with_bag(Arc::new(bag));
    key_frame.motion = entry.motion.clone();
    let mut changes = vec![Change::AddKeyFrame(Box::new(key_frame))];
    let shown = entry.shown.iter().enumerate();
    changes.extend(shown.filter_map(|(i, l)| l.map(|l| Change::Observe(l, entry.id, i as u16))));
    changes
}

/// New landmarks for the features of a key frame that have depth and show nothing yet: all that are close, and of
/// the others as many as bring the count of points to `least`, nearest first.
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
        if entry.shown[i].is_some() {
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
