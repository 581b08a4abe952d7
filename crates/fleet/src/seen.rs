//! Whether a tile shows what a single image shows, by geometry: as many landmarks of the tile as features of the image agree on one pose. Words say
//! where to look, never whether it is the place.

use cairn::adjust::{MatchFailure, RecogniseConfig, View, recognise};
use cairn::atlas::store::MapFile;
use cairn::geometry::Se3;
use cairn::vision::bow::BagOfWords;
use cairn::vision::{Features, Frame, RectifiedCamera};
use std::collections::BTreeSet;

/// Landmarks that must agree. In the test `an_unknown_place_is_said_to_be_unknown` of this crate 42 images of two rendered houses that were walked
/// have 235 or more; 207 images of other houses, and of a real kitchen, desk, road and two flats, have at most 66.
const LANDMARKS: usize = 80;
/// Landmarks that must agree on a pose before more are looked for, and the share of those that are found.
const SEED: usize = 12;
const SHARE: f64 = 0.4;
/// Places of a tile that are compared.
const PLACES: usize = 8;

/// An image without a calibration.
pub(crate) struct Image {
    pub(crate) bag: BagOfWords,
    pub(crate) features: Features,
    /// Width and height, pixels.
    pub(crate) size: [usize; 2],
}

/// What an image shows of a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Seen {
    /// Landmarks that agree on a pose.
    pub landmarks: usize,
    /// So many are needed.
    pub needed: usize,
    /// The position of the camera in the atlas, where enough agree.
    pub position: Option<[f64; 3]>,
}

impl Image {
    /// What it shows of a tile: the best of the places that look most like it. Its camera is taken to be that of the tile.
    pub(crate) fn in_tile(&self, tile: &MapFile) -> Seen {
        let camera = &tile.about.camera;
        let Some(frame) = self.frame(camera) else { return Seen { needed: LANDMARKS, ..Seen::default() } };
        let config = RecogniseConfig { seed: SEED, need: LANDMARKS, share: SHARE };
        let view = View::new(camera, &frame);
        let compared = tile.snapshot.similar_key_frames(&self.bag, PLACES, 1, &[], |_| true);
        let seen = compared.iter().map(|(id, _)| {
            let (landmarks, pose) = match recognise(&tile.snapshot, &view, *id, &BTreeSet::new(), &config, 0)
            {
                Ok(place) => (place.inliers, Some(place.world_from_camera)),
                // So many agree, but not by that margin, or not those that should be in view.
                Err(why @ (MatchFailure::Agree { .. } | MatchFailure::Missing { .. })) => {
                    (why.agreed(), None)
                }
                Err(_) => (0, None),
            };
            let position = pose.map(|pose: Se3| pose.translation.into());
            Seen { landmarks, needed: LANDMARKS, position }
        });
        let best = seen.max_by_key(|seen| (seen.position.is_some(), seen.landmarks));
        best.unwrap_or(Seen { needed: LANDMARKS, ..Seen::default() })
    }

    /// As the camera of a tile would have taken it; none for an image of another shape.
    fn frame(&self, camera: &RectifiedCamera) -> Option<Frame> {
        let [x0, y0, x1, y1] = camera.bounds;
        let [width, height] = self.size.map(|n| n as f64);
        let scale = (x1 - x0) / width;
        if !(scale.is_finite() && ((y1 - y0) / height / scale - 1.0).abs() < 0.2) {
            return None;
        }
        let mut frame = Frame::default();
        frame.raw.clone_from(&self.features.raw);
        let px =
            |p: &[f32; 2]| [(x0 + f64::from(p[0]) * scale) as f32, (y0 + f64::from(p[1]) * scale) as f32];
        frame.px = self.features.raw.iter().map(px).collect();
        frame.octave.clone_from(&self.features.octave);
        frame.angle.clone_from(&self.features.angle);
        frame.descriptors.clone_from(&self.features.descriptors);
        frame.depth = vec![f32::NAN; frame.px.len()];
        frame.right_x = vec![f32::NAN; frame.px.len()];
        frame.index(camera);
        Some(frame)
    }
}
