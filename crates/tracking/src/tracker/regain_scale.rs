//! Regaining scale: while it is unsupported, the places from before it lost its support are looked for again.
//!
//! A walker with one camera who turns on the spot, and then lets the camera look back, sees what was seen before the turn. The
//! landmarks of then have parallax, but an orientation that was carried through the turn is off by a degree or so, more
//! than the search around their projections bridges, and somebody who stands still asks for no key frame with
//! which loop closing could look.

use super::scale::UnitOfLength;
use crate::match_last::Matches;
use crate::recover::{GROUP, RECOGNISE_SEED, RECOGNISE_SHARE};
use crate::state::{Last, map_of};
use cairn_adjust::{RecogniseConfig, View, recognise};
use cairn_atlas::{KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::Frame;
use cairn_vision::bow::Vocabulary;
use std::collections::BTreeSet;

/// Seconds between two looks.
const EVERY_S: f64 = 0.5;
/// Places compared at each look.
const PLACES: usize = 2;
/// Key frames whose optical axis makes a larger angle with the camera's are not looked at: its cosine.
const FACING: f64 = 0.8;
/// By how much a pose that was carried without parallax may be off: standard deviations of its position, and radians of its
/// rotation. Rooms that look alike from another side are farther off.
const OFF_SIGMAS: f64 = 3.0;
const OFF_RAD: f64 = 0.3;

impl UnitOfLength {
    /// While scale is unsupported, every half second: the pose of a frame that was guessed at `guess` among key frames from
    /// before, with the landmarks that it shows. `None` where no place from before is in view. `last` is the last frame that had a
    /// pose.
    pub fn regain(
        &mut self,
        frame: &Frame,
        snapshot: &Snapshot,
        last: Option<&Last>,
        guess: &Se3,
    ) -> Option<(Se3, Matches)> {
        let since = self.support.assumed_since()?;
        if self.looked_for.is_some_and(|looked| frame.stamp - looked < EVERY_S) {
            return None;
        }
        self.looked_for = Some(frame.stamp);
        let (carried_since, _) = *self.unsupported.front()?;
        let reach = OFF_SIGMAS * self.on_the_spot_sigma(frame.stamp - carried_since);
        let map = map_of(snapshot, last?.anchored.reference)?;
        let distance = |at: &Se3| (at.translation - guess.translation).norm();
        let may_show = |k: &KeyFrame| {
            let (axis, ahead) = (k.world_from_camera.rotation * Vec3::z(), guess.rotation * Vec3::z());
            k.id < since
                && k.map == map
                && axis.dot(&ahead) > FACING
                && distance(&k.world_from_camera) < reach
        };
        let bag = Vocabulary::current().bag(&frame.descriptors);
        let places = snapshot
            .similar_key_frames(&bag, PLACES, GROUP, &[], |id| snapshot.key_frame(id).is_some_and(&may_show));
        let view = View::new(&self.setup.camera, frame);
        let need = self.setup.recovered_need();
        let config = RecogniseConfig { seed: RECOGNISE_SEED, need, share: RECOGNISE_SHARE };
        let seen = |id: KeyFrameId| {
            recognise(snapshot, &view, id, &BTreeSet::new(), &config, frame.stamp.0 as u64).ok()
        };
        places.into_iter().filter_map(|(id, _)| seen(id)).find_map(|place| {
            let pose = place.world_from_camera;
            let off_rad = (guess.rotation.inverse() * pose.rotation).angle();
            (distance(&pose) < reach && off_rad < OFF_RAD)
                .then(|| (pose, Matches { landmarks: place.landmarks, extra: Vec::new() }))
        })
    }
}
