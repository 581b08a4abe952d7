//! What became of the maps, as events: begun, gravity-aligned, rescaled, joined by a loop, merged.
//!
//! The stream of changes ([`crate::Changes`]) has every key frame and landmark; these are the few of them that move a whole
//! map, each with the similarity that it applies. They are for whoever keeps poses outside of the map.

use crate::Changes;
use cairn_atlas::{Change, KeyFrameId, MapId, Mirror, Published};
use cairn_geometry::{Sim3, So3};
use std::collections::VecDeque;

/// An event that concerns a whole map. Similarities map points: `p_after = scale * R * p_before + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum MapEvent {
    /// A map was created.
    Created {
        /// It, named after its first key frame.
        map: MapId,
    },
    /// A loop was closed.
    Loop {
        /// The map.
        map: MapId,
        /// The key frame that shows a place again.
        key_frame: KeyFrameId,
        /// The earlier key frame of that place.
        earlier: KeyFrameId,
        /// How the surroundings of `key_frame` were corrected, in the map's frame; key frames before it were corrected by
        /// a part of it.
        corrected_from_former: Sim3,
    },
    /// Two maps were merged.
    Merge {
        /// The younger; its name is retired.
        from: MapId,
        /// The older.
        into: MapId,
        /// From the younger map's frame to the older one's, with the ratio of their units of length.
        into_from: Sim3,
    },
    /// The unit of length of a map is better known: lengths are multiplied about its root. It does not become metric.
    Rescale {
        /// The map.
        map: MapId,
        /// From the frame before to the frame after.
        corrected_from_former: Sim3,
    },
    /// Gravity and scale of a map are known, or known better: z points up, lengths are metres.
    GravityAligned {
        /// The map.
        map: MapId,
        /// From the frame before to the frame after.
        aligned_from_former: Sim3,
    },
}

/// All events since [`crate::Slam::events`], in order, none left out.
///
/// As with [`Changes`], the iterator gives what has happened so far and then `None`, and can be used again after further
/// frames; what is not read stays in memory.
#[derive(Debug)]
pub struct MapEvents {
    changes: Changes,
    mirror: Mirror,
    ready: VecDeque<MapEvent>,
}

impl MapEvents {
    pub(crate) fn new(changes: Changes) -> Self {
        let mirror = Mirror::of(changes.start());
        Self { changes, mirror, ready: VecDeque::new() }
    }

    fn take(&mut self, published: &Published) {
        let before = loops_of(published, &self.mirror);
        let (mirror, changes) = (&self.mirror, &published.changes);
        self.ready.extend(changes.iter().filter_map(|change| event_of(change, mirror)));
        self.mirror.take(published);
        for (key_frame, earlier, world_from_former) in before {
            let Some(now) = self.mirror.key_frame(key_frame) else { continue };
            let corrected_from_former = now.world_from_here() * world_from_former.inverse();
            self.ready.push_back(MapEvent::Loop { map: now.map, key_frame, earlier, corrected_from_former });
        }
    }
}

impl Iterator for MapEvents {
    type Item = MapEvent;

    fn next(&mut self) -> Option<MapEvent> {
        while self.ready.is_empty() {
            let published = self.changes.next()?;
            self.take(&published);
        }
        self.ready.pop_front()
    }
}

/// The loops of a commit with the pose before it of the key frame that closed each. The link that a merge makes is no loop.
fn loops_of(published: &Published, before: &Mirror) -> Vec<(KeyFrameId, KeyFrameId, Sim3)> {
    let of = |change: &Change| match change {
        Change::Link(here, earlier) => {
            let (here_was, there_was) = (before.key_frame(*here)?, before.key_frame(*earlier)?);
            (here_was.map == there_was.map).then(|| (*here, *earlier, here_was.world_from_here()))
        }
        _ => None,
    };
    published.changes.iter().filter_map(of).collect()
}

fn event_of(change: &Change, before: &Mirror) -> Option<MapEvent> {
    match change {
        Change::AddKeyFrame(k) if k.parent.is_none() => Some(MapEvent::Created { map: MapId(k.id) }),
        Change::Merge { from, into, into_from, .. } => {
            Some(MapEvent::Merge { from: *from, into: *into, into_from: *into_from })
        }
        Change::Rescale(map, factor) => {
            let root = before.key_frame(map.root())?.world_from_camera.translation;
            let corrected_from_former = Sim3::new(So3::identity(), root * (1.0 - factor), *factor);
            Some(MapEvent::Rescale { map: *map, corrected_from_former })
        }
        Change::AlignGravity(map, aligned_from_former) => {
            Some(MapEvent::GravityAligned { map: *map, aligned_from_former: *aligned_from_former })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Atlas, KeyFrame, Snapshot};
    use cairn_geometry::{Se3, Vec3};
    use cairn_vision::Frame;
    use std::sync::Arc;

    fn id(n: usize) -> KeyFrameId {
        KeyFrameId::from_index(n).unwrap()
    }

    fn key_frame(n: usize, x: f64, parent: Option<usize>) -> Change {
        let pose = Se3::new(So3::exp(&Vec3::new(0.0, 0.1 * n as f64, 0.0)), Vec3::new(x, 0.0, 1.0));
        Change::AddKeyFrame(Box::new(KeyFrame::new(id(n), Arc::new(Frame::default()), pose, parent.map(id))))
    }

    fn at(atlas: &Atlas, n: usize) -> Vec3 {
        atlas.latest().key_frame(id(n)).unwrap().world_from_camera.translation
    }

    fn close(a: Vec3, b: Vec3) -> bool {
        (a - b).norm() < 1e-12
    }

    #[test]
    fn similarities_carry_what_was_there_to_where_it_is_now() {
        let mut atlas = Atlas::new(Snapshot::new());
        let mut events = MapEvents::new(Changes::new(atlas.subscribe()));
        atlas.commit(vec![key_frame(0, 0.0, None), key_frame(1, 1.0, Some(0)), key_frame(2, 2.0, Some(1))]);
        assert_eq!(events.next(), Some(MapEvent::Created { map: MapId(id(0)) }));
        assert_eq!(events.next(), None);

        // A loop moves the last key frame and changes its unit.
        let before = at(&atlas, 2);
        let moved = Se3::new(So3::exp(&Vec3::new(0.0, 0.5, 0.1)), Vec3::new(1.5, 0.2, 1.0));
        let changes =
            vec![Change::MoveKeyFrame(id(2), moved), Change::Scale(id(2), 1.1), Change::Link(id(2), id(0))];
        atlas.commit(changes);
        let Some(MapEvent::Loop { map, key_frame: k, earlier, corrected_from_former }) = events.next() else {
            panic!("a loop was closed");
        };
        assert_eq!((map, k, earlier), (MapId(id(0)), id(2), id(0)));
        assert!(close(corrected_from_former * before, at(&atlas, 2)));
        assert!((corrected_from_former.scale - 1.1).abs() < 1e-12);

        // Lengths grow about the root, which is not at the origin.
        let before = at(&atlas, 2);
        atlas.commit(vec![Change::Rescale(MapId(id(0)), 2.0)]);
        let Some(MapEvent::Rescale { corrected_from_former, .. }) = events.next() else {
            panic!("the map was rescaled");
        };
        assert!(close(corrected_from_former * before, at(&atlas, 2)));
        assert!(close(corrected_from_former * at(&atlas, 0), at(&atlas, 0)));

        let before = at(&atlas, 2);
        let upright = Sim3::new(So3::exp(&Vec3::new(-1.5, 0.0, 0.0)), Vec3::new(0.1, 0.2, 0.3), 0.5);
        atlas.commit(vec![Change::AlignGravity(MapId(id(0)), upright)]);
        let Some(MapEvent::GravityAligned { aligned_from_former, .. }) = events.next() else {
            panic!("the map was aligned");
        };
        assert!(close(aligned_from_former * before, at(&atlas, 2)));
        assert_eq!(events.next(), None);
    }

    #[test]
    fn merge_is_one_event_and_no_loop() {
        let mut atlas = Atlas::new(Snapshot::new());
        atlas.commit(vec![key_frame(0, 0.0, None), key_frame(1, 5.0, None)]);
        let mut events = MapEvents::new(Changes::new(atlas.subscribe()));
        let before = at(&atlas, 1);
        let into_from = Sim3::new(So3::exp(&Vec3::new(0.0, 0.3, 0.0)), Vec3::new(1.0, 2.0, 3.0), 1.2);
        let (from, into) = (MapId(id(1)), MapId(id(0)));
        atlas
            .commit(vec![Change::Merge { from, into, into_from, parent: id(0) }, Change::Link(id(1), id(0))]);
        assert_eq!(events.next(), Some(MapEvent::Merge { from, into, into_from }));
        assert_eq!(events.next(), None);
        assert!(close(into_from * before, at(&atlas, 1)));
    }
}
