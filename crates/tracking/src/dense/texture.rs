//! The shades on the surface in view, looked at where its shape leaves the pose free.

use cairn_dense::{DenseTracked, DepthPreparer, ShadedView, TrackConfig, track_photometric};
use cairn_geometry::Se3;
use cairn_sensor::{DepthImage, GrayImage};
use nalgebra::Matrix6;
use std::sync::Arc;

/// What the camera saw from somewhere: depth, and the gray image of its pixels.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub depth: Arc<DepthImage>,
    pub gray: Arc<GrayImage>,
}

/// The gray image of the present frame, and the view that frames are compared with.
#[derive(Default)]
pub(super) struct Texture {
    gray: Option<Arc<GrayImage>>,
    /// The depth image that it was made of tells which it is.
    before: Option<(Arc<DepthImage>, ShadedView)>,
}

impl Texture {
    /// The next frame comes, with this gray image.
    pub fn next(&mut self, gray: Option<Arc<GrayImage>>) {
        self.gray = gray;
    }

    /// The gray image of the present frame, to be remembered.
    pub fn take_gray(&mut self) -> Option<Arc<GrayImage>> {
        self.gray.take()
    }

    /// Compares the present frame with an earlier view at a pose in the field. `image` is the frame's depth, which was prepared last, and
    /// is so again afterwards.
    pub fn find(
        &mut self,
        (before, volume_from_before): (&View, &Se3),
        image: &DepthImage,
        preparer: &mut DepthPreparer,
        tracked: &DenseTracked,
        known: &Matrix6<f64>,
        config: &TrackConfig,
    ) -> Option<DenseTracked> {
        let now = ShadedView::new(preparer.frame(), &preparer.shades(self.gray.as_ref()?).ok()?).ok()?;
        if self.before.as_ref().is_none_or(|(depth, _)| !Arc::ptr_eq(depth, &before.depth)) {
            let shades = preparer.shades(&before.gray).ok()?;
            let view = preparer.prepare(&before.depth).and_then(|frame| ShadedView::new(frame, &shades));
            preparer.prepare(image).ok()?;
            self.before = Some((before.depth.clone(), view.ok()?));
        }
        let (_, before) = self.before.as_ref()?;
        track_photometric(before, volume_from_before, &now, tracked, known, config)
    }
}
