//! The local map: the part of the map around a frame, matched by projection.

use crate::match_last::{LOOSE, Matches};
use cairn_atlas::{KeyFrameId, Landmark, LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::{Frame, RectifiedCamera, Target, search};

/// The part of the map that a frame is matched with.
#[derive(Debug, Default)]
pub(crate) struct LocalMap {
    /// The key frame that shares most landmarks with the frame.
    pub reference: Option<KeyFrameId>,
    /// Key frames that share at least half as many.
    strongest: Vec<KeyFrameId>,
    landmarks: Vec<Option<LandmarkId>>,
    /// For each landmark index plus one, the round in which it was collected.
    rounds: Vec<u32>,
    round: u32,
    /// For each landmark index, the last search before which it was matched.
    matched: Vec<u32>,
    searches: u32,
}

impl LocalMap {
    /// Collects the key frames that observe the frame's landmarks, their neighbours, and all landmarks these
    /// observe.
    pub fn gather(
        &mut self,
        snapshot: &Snapshot,
        matches: &Matches,
        fallback: KeyFrameId,
        key_frames: usize,
    ) {
        let votes = snapshot.votes(matches.landmarks.iter().flatten());
        self.reference = votes.first().map(|(id, _)| *id).or(Some(fallback));
        let most = votes.first().map_or(0, |(_, n)| *n);
        self.strongest.clear();
        self.strongest.extend(votes.iter().take_while(|(_, n)| 2 * n >= most).map(|(id, _)| *id));
        let mut chosen: Vec<KeyFrameId> = votes.iter().map(|(id, _)| *id).take(key_frames * 2 / 3).collect();
        if chosen.is_empty() {
            chosen.push(fallback);
        }
        for i in 0..chosen.len() {
            let Some(k) = snapshot.key_frame(chosen[i]) else { continue };
            let neighbours = k.covisible.iter().map(|(id, _)| *id).take(5).chain(k.parent);
            for id in neighbours {
                if chosen.len() < key_frames && !chosen.contains(&id) {
                    chosen.push(id);
                    break;
                }
            }
        }
        self.round += 1;
        self.rounds.resize(snapshot.next_landmark_id().index() + 1, 0);
        // What has no landmark counts as collected.
        self.rounds[0] = self.round;
        let chosen = chosen.iter().filter_map(|id| snapshot.key_frame(*id));
        let features: usize = chosen.clone().map(|k| k.landmarks.len()).sum();
        self.landmarks.resize(features, None);
        let mut count = 0;
        // Whether a feature shows a landmark that is new here follows no pattern that a processor could foresee: no branches.
        for id in chosen.flat_map(|k| &k.landmarks) {
            let Some(round) = self.rounds.get_mut(id.map_or(0, |id| id.index() + 1)) else { continue };
            self.landmarks[count] = *id;
            count += usize::from(*round != self.round);
            *round = self.round;
        }
        self.landmarks.truncate(count);
    }

    /// Of the key frames that share many landmarks with the frame, the one nearest to a position. A pose
    /// anchored to a near key frame changes least when the map is adjusted.
    pub fn nearest(&self, snapshot: &Snapshot, position: &Vec3) -> Option<KeyFrameId> {
        let distance = |id: &KeyFrameId| {
            snapshot
                .key_frame(*id)
                .map_or(f64::INFINITY, |k| (k.world_from_camera.translation - position).norm_squared())
        };
        self.strongest.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Projects the collected landmarks and adds the matches found to `matches`; returns the landmarks that
    /// should be in view (including those matched before).
    pub fn search(
        &mut self,
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        frame: &Frame,
        pose: &Se3,
        factor: f64,
        matches: &mut Matches,
    ) -> Vec<LandmarkId> {
        let octaves = snapshot.octaves();
        let scales: Vec<f64> = (0..octaves.levels).map(|level| octaves.scale(level as u8)).collect();
        let mut expected: Vec<LandmarkId> = matches.landmarks.iter().flatten().copied().collect();
        expected.sort_unstable();
        expected.dedup();
        self.searches += 1;
        self.matched.resize(self.rounds.len(), 0);
        for id in &expected {
            if let Some(matched) = self.matched.get_mut(id.index()) {
                *matched = self.searches;
            }
        }
        // All are projected first: the landmarks lie scattered in memory, and without a search in between the processor
        // fetches several at a time.
        let visible = self.visible(snapshot, camera, pose);
        expected.extend(visible.iter().map(|v| v.landmark.id));
        let mut owner: Vec<Option<(LandmarkId, u32)>> = vec![None; frame.len()];
        for v in &visible {
            // Seen from nearly the same direction as before: a small window is enough (Mur-Artal et al. 2015,
            // section V-D).
            let radius = factor * if v.cosine > 0.998 { 2.5 } else { 4.0 };
            let level = octaves.predict(v.landmark.max_distance, v.distance);
            let target = Target {
                pixel: [v.projected[0] as f32, v.projected[1] as f32],
                right_x: if camera.has_depth() { v.projected[2] as f32 } else { f32::NAN },
                radius: (radius * scales[level as usize]) as f32,
                octaves: [level.saturating_sub(1), level],
                descriptor: &v.landmark.descriptor,
            };
            let Some(found) = search(frame, &target, |i| matches.landmarks[i].is_none()) else { continue };
            let same_level = found.second_octave == frame.octave[found.feature] && found.second != u32::MAX;
            let ambiguous = same_level && found.distance as f64 > 0.8 * found.second as f64;
            if found.distance > LOOSE || ambiguous {
                continue;
            }
            let slot = &mut owner[found.feature];
            if slot.is_none_or(|(_, d)| found.distance < d) {
                *slot = Some((v.landmark.id, found.distance));
            }
        }
        for (feature, slot) in owner.iter().enumerate() {
            if let Some((id, _)) = slot {
                matches.landmarks[feature] = Some(*id);
            }
        }
        expected
    }

    /// The collected landmarks that should be in view at a pose, without those that were matched before this search.
    fn visible<'a>(&self, snapshot: &'a Snapshot, camera: &RectifiedCamera, pose: &Se3) -> Vec<Visible<'a>> {
        let camera_from_world = pose.inverse();
        let rotation = camera_from_world.rotation.matrix();
        let unmatched = |id: &&LandmarkId| self.matched[id.index()] != self.searches;
        let landmarks: Vec<&Landmark> = self
            .landmarks
            .iter()
            .flatten()
            .filter(unmatched)
            .filter_map(|id| snapshot.landmark(*id))
            .collect();
        // Read all together, for the same reason as above.
        let positions: Vec<Vec3> = landmarks.iter().map(|landmark| landmark.position).collect();
        let of = |(landmark, position): (&&'a Landmark, &Vec3)| {
            let q = rotation * position + camera_from_world.translation;
            let projected = camera.project(&q)?;
            if !camera.contains(projected[0], projected[1]) {
                return None;
            }
            let distance = q.norm();
            if distance < 0.8 * landmark.min_distance || distance > 1.2 * landmark.max_distance {
                return None;
            }
            let cosine = (position - pose.translation).dot(&landmark.normal) / distance;
            (cosine >= 0.5).then_some(Visible { landmark, projected, distance, cosine })
        };
        landmarks.iter().zip(&positions).filter_map(of).collect()
    }
}

/// A landmark that should be in view.
struct Visible<'a> {
    landmark: &'a Landmark,
    /// Pixel and right x.
    projected: [f64; 3],
    /// From the camera.
    distance: f64,
    /// Of the angle between the view and the mean view so far.
    cosine: f64,
}
