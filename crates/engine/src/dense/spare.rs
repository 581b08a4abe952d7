//! Which depth of removed key frames is superfluous, so that in one house it does not grow for ever.
//!
//! A key frame is removed once three others see its landmarks. Its depth stays, since it may show what they do not, unless as many
//! images as that were taken near it in about the same direction. So the images of removed key frames are bounded by the places and
//! directions there are, however long somebody walks there.

use cairn_atlas::{KeyFrameId, Mirror};
use std::collections::BTreeSet;

/// Images near one that make it superfluous.
const ENOUGH: usize = 3;
/// What is near: metres, and radians between the directions of view.
const NEAR_M: f64 = 0.5;
const NEAR_RAD: f64 = 0.35;

/// The key frames whose depth is kept, removed ones among them. What is dropped depends on the changes of the map alone: who
/// follows the same stream drops the same.
#[derive(Clone, Debug, Default)]
pub struct Views {
    kept: BTreeSet<KeyFrameId>,
}

impl Views {
    /// The depth of this key frame is kept.
    pub fn add(&mut self, id: KeyFrameId) {
        self.kept.insert(id);
    }

    /// Whether the depth of a key frame that has just been removed is superfluous; it counts as dropped then.
    pub fn drop_if_spare(&mut self, id: KeyFrameId, mirror: &Mirror) -> bool {
        let place = |id| {
            let (alive, alive_from_it) = mirror.surviving_ancestor(id)?;
            Some((alive.map, alive.world_from_here() * alive_from_it))
        };
        let Some((map, here)) = place(id).filter(|_| self.kept.contains(&id)) else { return false };
        let is_near = |other: &KeyFrameId| {
            *other != id
                && place(*other).is_some_and(|(its, there)| {
                    its == map
                        && (there.translation - here.translation).norm() <= NEAR_M
                        && (here.rotation.inverse() * there.rotation).log().norm() <= NEAR_RAD
                })
        };
        let is_spare = self.kept.iter().filter(|other| is_near(other)).take(ENOUGH).count() == ENOUGH;
        if is_spare {
            self.kept.remove(&id);
        }
        is_spare
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Atlas, Change, KeyFrame, Snapshot};
    use cairn_geometry::{Se3, So3, Vec3};
    use cairn_vision::Frame;
    use std::sync::Arc;

    /// Round and round a circle of 2 m radius, looking ahead, with a key frame each 0.4 m; from the second round on the
    /// newest is removed with each that comes.
    #[test]
    fn images_of_removed_key_frames_are_bounded_by_the_places() {
        let mut atlas = Atlas::new(Snapshot::new());
        let from = atlas.subscribe();
        let (mut mirror, mut views, mut alive) = (Mirror::of(&from.start), Views::default(), Vec::new());
        let mut counts = Vec::new();
        for round in 0..40 {
            for place in 0..31 {
                // Never twice at quite the same place.
                let angle = f64::from(place) * 0.2 + f64::from(round) * 0.037;
                let at = Vec3::new(2.0 * angle.cos(), 2.0 * angle.sin(), 0.0);
                let pose = Se3::new(So3::exp(&Vec3::new(0.0, 0.0, angle)), at);
                let id = atlas.latest().next_key_frame_id();
                let parent = alive.first().copied();
                let key_frame = KeyFrame::new(id, Arc::new(Frame::default()), pose, parent);
                atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
                alive.push(id);
                if alive.len() > 31 {
                    atlas.commit(vec![Change::RemoveKeyFrame(alive.remove(30))]);
                }
                for commit in from.changes.try_iter() {
                    mirror.take_with(&commit, |mirror, change, _| match change {
                        Change::AddKeyFrame(k) => views.add(k.id),
                        Change::RemoveKeyFrame(id) => drop(views.drop_if_spare(*id, mirror)),
                        _ => {}
                    });
                }
            }
            counts.push(views.kept.len());
        }
        // Of 1,240 key frames.
        assert!(alive.iter().all(|id| views.kept.contains(id)), "those of the map stay");
        assert!(counts[0] == 31 && counts[39] < 2 * 31, "{counts:?}");
        // Who has none, or is in no map, is not superfluous.
        let nobody = KeyFrameId::from_index(9_999).expect("a number");
        assert!(!views.drop_if_spare(nobody, &mirror));
    }

    /// Another direction of view, another floor and another map are no cover.
    #[test]
    fn only_what_looks_at_the_same_makes_an_image_superfluous() {
        let turned = |z: f64| Se3::new(So3::exp(&Vec3::new(0.0, z, 0.0)), Vec3::zeros());
        let up = |z: f64| Se3::new(So3::identity(), Vec3::new(0.0, 0.0, z));
        for (others, is_spare) in [
            ([up(0.1), up(0.2), turned(0.3)], true),
            ([up(0.1), up(0.2), turned(0.5)], false),
            ([up(0.1), up(0.2), up(0.6)], false),
        ] {
            for other_map in [false, true] {
                let mut atlas = Atlas::new(Snapshot::new());
                let from = atlas.subscribe();
                let root = atlas.latest().next_key_frame_id();
                let add = |atlas: &mut Atlas, pose, parent| {
                    let id = atlas.latest().next_key_frame_id();
                    let key_frame = KeyFrame::new(id, Arc::new(Frame::default()), pose, parent);
                    atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
                    id
                };
                add(&mut atlas, up(5.0), None);
                let gone = add(&mut atlas, up(0.0), Some(root));
                for (k, pose) in others.into_iter().enumerate() {
                    add(&mut atlas, pose, (!other_map || k > 0).then_some(root));
                }
                atlas.commit(vec![Change::RemoveKeyFrame(gone)]);
                let (mut mirror, mut views) = (Mirror::of(&from.start), Views::default());
                for commit in from.changes.try_iter() {
                    mirror.take(&commit);
                }
                (0..5).filter_map(KeyFrameId::from_index).for_each(|id| views.add(id));
                assert_eq!(views.drop_if_spare(gone, &mirror), is_spare && !other_map, "{others:?}");
                assert!(!views.drop_if_spare(gone, &mirror), "once");
            }
        }
    }
}
