//! Whether a monocular camera has moved enough to observe depth: parallax since an earlier frame.
//!
//! While a walker turns on the spot, each view differs from the previous one by a rotation only. Landmarks
//! triangulated then take their depth from noise, and a map that continues from them changes its unit of length. So
//! an earlier frame is kept until the camera has seen parallax against it, or has turned away from it without any. As
//! long as rotation alone explains the change since then (the infinite homography; Hartley & Zisserman, section
//! 13.4), nothing is triangulated.

use crate::rotation::{Between, Conclusion, rotation_between};
use crate::state::{AnchoredPose, anchored_at};
use cairn_atlas::Snapshot;
use cairn_geometry::Se3;
use cairn_solve::PosePrior;
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::SMatrix;
use std::sync::Arc;

/// A camera that has moved by more than this share of the median depth has parallax; no test is needed.
const MOVED: f64 = 0.05;
/// Seconds between two tests.
const EVERY_S: f64 = 0.1;
/// A camera turned by less than this may be standing still; the landmarks it had are still in view then. Radians.
const TURNED_RAD: f64 = 0.1;
/// Uncertainty of the position while there is no parallax: standard deviation as a share of the median depth.
const HELD: f64 = 0.01;

/// The frame against which parallax is tested.
#[derive(Clone, Debug)]
struct Reference {
    frame: Arc<Frame>,
    anchored: AnchoredPose,
    /// The median depth of the landmarks in it, in the map's unit.
    median_depth: f64,
}

impl Reference {
    fn world_from_camera(&self, snapshot: &Snapshot) -> Option<Se3> {
        snapshot.resolve(self.anchored.reference, &self.anchored.reference_from_camera)
    }
}

/// Detects parallax. Only where neither depth nor an IMU gives the unit of length.
#[derive(Clone, Debug, Default)]
pub(crate) struct ParallaxWatch {
    reference: Option<Reference>,
    tested: Option<Arc<Frame>>,
    turning: bool,
}

impl ParallaxWatch {
    /// Takes a frame with its pose and the median depth of the landmarks in it, in the map's unit.
    pub fn update(
        &mut self,
        camera: &RectifiedCamera,
        snapshot: &Snapshot,
        frame: &Arc<Frame>,
        anchored: &AnchoredPose,
        median_depth: f64,
    ) {
        let here = || Reference { frame: frame.clone(), anchored: *anchored, median_depth };
        let before = self.reference.as_ref().and_then(|r| Some((r, r.world_from_camera(snapshot)?)));
        let Some((reference, before)) = before else {
            self.reference = Some(here());
            return;
        };
        let world_from_camera = &anchored.world_from_camera;
        let moved = (world_from_camera.translation - before.translation).norm();
        if moved > MOVED * median_depth {
            (self.reference, self.tested, self.turning) = (Some(here()), None, false);
            return;
        }
        if self.tested.as_ref().is_some_and(|tested| frame.stamp - tested.stamp < EVERY_S) {
            return;
        }
        let guess = before.rotation.inverse() * world_from_camera.rotation;
        match rotation_between(camera, &reference.frame, frame, &guess, Conclusion::NoParallax) {
            Between::Rotation { rotation, .. } => self.turning = rotation.angle() > TURNED_RAD,
            Between::Parallax => (self.reference, self.turning) = (Some(here()), false),
            // Turned away from it: the earlier tests have decided whether there was parallax. Without parallax the
            // camera is still at the same position.
            Between::TooFew => {
                let mut next = here();
                if self.turning {
                    let held = Se3::new(world_from_camera.rotation, before.translation);
                    let at = anchored_at(snapshot, anchored.reference, held);
                    next = Reference { anchored: at.unwrap_or(next.anchored), ..next };
                }
                self.reference = Some(next);
            }
        }
        self.tested = Some(frame.clone());
    }

    /// A position prior while the camera turns without parallax: it has not moved. The few landmarks at the edge of
    /// the view constrain the position less than that.
    pub fn position_prior(&self, snapshot: &Snapshot, guess: &Se3) -> Option<PosePrior> {
        let reference = self.reference.as_ref().filter(|_| self.turning)?;
        let held = reference.world_from_camera(snapshot)?;
        let sigma = HELD * reference.median_depth;
        let mut information = SMatrix::<f64, 6, 6>::zeros();
        (0..3).for_each(|k| information[(k, k)] = 1.0 / (sigma * sigma));
        Some(PosePrior { world_from_camera: Se3::new(guess.rotation, held.translation), information })
    }

    /// Whether the camera turns without parallax: depth cannot be observed now.
    pub fn is_turning(&self) -> bool {
        self.turning
    }
}
