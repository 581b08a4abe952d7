//! The local map: the part of the map around a frame, matched by projection.

use crate::match_last::{LOOSE, Matches};
use cairn_atlas::{KeyFrameId, Landmark, LandmarkId, Sighting, Snapshot, Viewpoint};
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
        expected.extend(visible.iter().map(|(landmark, _)| landmark.id));
        let mut owner: Vec<Option<(LandmarkId, u32)>> = vec![None; frame.len()];
        for (landmark, v) in &visible {
            // Seen from nearly the same direction as before: a small window is enough (Mur-Artal et al. 2015,
            // section V-D).
            let radius = factor * if v.cosine > 0.998 { 2.5 } else { 4.0 };
            let level = octaves.predict(v.farthest, v.distance);
            let target = Target {
                pixel: [v.pixel[0] as f32, v.pixel[1] as f32],
                right_x: if camera.has_depth() { v.pixel[2] as f32 } else { f32::NAN },
                radius: (radius * scales[level as usize]) as f32,
                octaves: [level.saturating_sub(1), level],
                descriptor: &landmark.descriptor,
            };
            let Some(found) = search(frame, &target, |i| matches.landmarks[i].is_none()) else { continue };
            let same_level = found.second_octave == frame.octave[found.feature] && found.second != u32::MAX;
            let ambiguous = same_level && found.distance as f64 > 0.8 * found.second as f64;
            if found.distance > LOOSE || ambiguous {
                continue;
            }
            let slot = &mut owner[found.feature];
            if slot.is_none_or(|(_, d)| found.distance < d) {
                *slot = Some((landmark.id, found.distance));
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
    fn visible<'a>(
        &self,
        snapshot: &'a Snapshot,
        camera: &RectifiedCamera,
        pose: &Se3,
    ) -> Vec<(&'a Landmark, Sighting)> {
        let viewpoint = Viewpoint::new(camera, pose);
        let unmatched = |id: &&LandmarkId| self.matched[id.index()] != self.searches;
        let landmarks: Vec<&Landmark> = self
            .landmarks
            .iter()
            .flatten()
            .filter(unmatched)
            .filter_map(|id| snapshot.landmark(*id))
            .collect();
        landmarks.iter().filter_map(|landmark| Some((*landmark, viewpoint.sees(landmark)?))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{World, off, pose, sideways, stereo};

    /// Of a view in the middle of a map, the first landmarks are matched already.
    #[test]
    fn search_finds_what_the_local_map_shows_and_tells_all_that_should_be_in_view() {
        let world = World::around(stereo(), 45);
        let (atlas, ids) = world.exact_map(&sideways(8, 0.2));
        let (snapshot, truth) = (atlas.latest(), pose(0.63, 0.0, 0.02));
        let view = world.see(&truth, 9.0);
        let truly = world.matches(snapshot, &view);
        let known = |landmarks: &[Option<LandmarkId>]| landmarks.iter().flatten().count();
        let mut matches = Matches::none(&view.frame);
        let some = truly.iter().enumerate().filter(|(_, l)| l.is_some()).take(20);
        some.for_each(|(i, l)| matches.landmarks[i] = *l);

        let mut local = LocalMap::default();
        local.gather(snapshot, &matches, ids[0], 6);
        assert!(local.reference.is_some_and(|id| ids[2..6].contains(&id)), "{:?}", local.reference);
        let expected = local.search(snapshot, &world.camera, &view.frame, &truth, 1.0, &mut matches);
        assert!(
            known(&matches.landmarks) * 10 > known(&truly) * 9,
            "{} of {}",
            known(&matches.landmarks),
            known(&truly)
        );
        let wrong =
            matches.landmarks.iter().zip(&truly).filter(|(found, truly)| found.is_some() && found != truly);
        assert_eq!(wrong.count(), 0);
        assert!(matches.landmarks.iter().flatten().all(|id| expected.contains(id)));
        let mut once = expected.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), expected.len(), "each is expected once");

        // The nearest of the key frames that share the view, and the fallback where nothing is matched.
        let nearest = local.nearest(snapshot, &truth.translation).unwrap();
        assert!(off(&snapshot.key_frame(nearest).unwrap().world_from_camera, &truth).0 < 0.11);
        local.gather(snapshot, &Matches::none(&view.frame), ids[7], 6);
        assert_eq!(local.reference, Some(ids[7]));
    }

    #[test]
    fn search_finds_nothing_where_the_guess_looks_elsewhere() {
        let world = World::around(stereo(), 46);
        let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
        let view = world.see(&pose(0.3, 0.0, 0.0), 9.0);
        let (mut local, mut matches) = (LocalMap::default(), Matches::none(&view.frame));
        local.gather(atlas.latest(), &matches, ids[0], 6);
        let expected =
            local.search(atlas.latest(), &world.camera, &view.frame, &pose(0.3, 0.0, 3.1), 1.0, &mut matches);
        assert!(expected.is_empty() && matches.count() == 0, "{} expected", expected.len());
    }
}
