//! The local map: the part of the map around a frame, matched by projection.

use crate::match_last::{LOOSE, Matches};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::{Frame, RectifiedCamera, Target, search};

/// The part of the map that a frame is matched with.
#[derive(Debug, Default)]
pub(crate) struct LocalMap {
    /// The key frame that shares most landmarks with the frame.
    pub reference: Option<KeyFrameId>,
    /// Key frames that share at least half as many.
    strongest: Vec<KeyFrameId>,
    landmarks: Vec<LandmarkId>,
    /// For each landmark index, the round in which it was collected.
    rounds: Vec<u32>,
    round: u32,
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
        self.landmarks.clear();
        for k in chosen.iter().filter_map(|id| snapshot.key_frame(*id)) {
            for id in k.landmarks.iter().flatten() {
                let i = id.index();
                if self.rounds.len() <= i {
                    self.rounds.resize(i + 1024, 0);
                }
                if self.rounds[i] != self.round {
                    self.rounds[i] = self.round;
                    self.landmarks.push(*id);
                }
            }
        }
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
        &self,
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        frame: &Frame,
        pose: &Se3,
        factor: f64,
        matches: &mut Matches,
    ) -> Vec<LandmarkId> {
        let octaves = snapshot.octaves();
        let camera_from_world = pose.inverse();
        let rotation = camera_from_world.rotation.matrix();
        let before: std::collections::BTreeSet<LandmarkId> =
            matches.landmarks.iter().flatten().copied().collect();
        let mut expected: Vec<LandmarkId> = before.iter().copied().collect();
        let mut owner: Vec<Option<(LandmarkId, u32)>> = vec![None; frame.len()];
        for id in &self.landmarks {
            if before.contains(id) {
                continue;
            }
            let Some(l) = snapshot.landmark(*id) else { continue };
            let q = rotation * l.position + camera_from_world.translation;
            let Some([u, v, right]) = camera.project(&q) else { continue };
            if !camera.contains(u, v) {
                continue;
            }
            let distance = q.norm();
            if distance < 0.8 * l.min_distance || distance > 1.2 * l.max_distance {
                continue;
            }
            let cosine = (l.position - pose.translation).dot(&l.normal) / distance;
            if cosine < 0.5 {
                continue;
            }
            expected.push(*id);
            let level = octaves.predict(l.max_distance, distance);
            // Seen from nearly the same direction as before: a small window is enough (Mur-Artal et al. 2015,
            // section V-D).
            let radius = factor * if cosine > 0.998 { 2.5 } else { 4.0 };
            let target = Target {
                pixel: [u as f32, v as f32],
                right_x: if camera.has_depth() { right as f32 } else { f32::NAN },
                radius: (radius * octaves.scale(level)) as f32,
                octaves: [level.saturating_sub(1), level],
                descriptor: &l.descriptor,
            };
            let Some(found) = search(frame, &target, |i| matches.landmarks[i].is_none()) else { continue };
            let same_level = found.second_octave == frame.octave[found.feature] && found.second != u32::MAX;
            let ambiguous = same_level && found.distance as f64 > 0.8 * found.second as f64;
            if found.distance > LOOSE || ambiguous {
                continue;
            }
            let slot = &mut owner[found.feature];
            if slot.is_none_or(|(_, d)| found.distance < d) {
                *slot = Some((*id, found.distance));
            }
        }
        for (feature, slot) in owner.iter().enumerate() {
            if let Some((id, _)) = slot {
                matches.landmarks[feature] = Some(*id);
            }
        }
        expected
    }
}
