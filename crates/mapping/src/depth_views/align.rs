//! The depth of one key frame aligned with that of another.

use super::pairs::Pair;
use super::view::View;
use cairn_atlas::{KeyFrameId, RelativePose, Snapshot};
use cairn_dense::{
    DenseTracked, DepthConfig, DepthFrame, DepthPreparer, TrackConfig, TsdfConfig, TsdfVolume, track,
};
use cairn_geometry::Se3;
use cairn_sensor::Camera;
use nalgebra::Matrix6;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The field of one image. Its band is as far as two poses may be apart along the surface's normal.
const FIELD: TsdfConfig = TsdfConfig { voxel_m: 0.025, band_voxels: 6.0, colour: false };
/// Points of the image that is aligned, about, at first and at last.
const POINTS: [usize; 2] = [800, 3000];
/// A direction counts where the surface gives it with this standard deviation, metres, and as much as that is. Where walls are four metres
/// away whole key frames are known no better than to a centimetre or two; along what is left free an alignment would stay where the map
/// has it, and bend the map that way. A wall leaves free what it leaves free, whatever this is.
const FIXED_M: f64 = 0.05;
/// Where an alignment ends on the way, which it does from far off, it goes on from there, at most so many times.
const GOES_ON: usize = 3;
/// Greatest root mean square distance of the points to the surface, metres.
const MOST_RMS_M: f64 = 0.03;
/// An alignment that leads farther away than this from where the map has it found something else, metres and radians.
const MOST_OFF: [f64; 2] = [0.25, 0.15];
/// Directions that a surface may leave free: along a wall, and about its normal.
const MOST_FREE: usize = 3;
/// No relative pose counts as more exact, metres and radians.
const FLOOR: f64 = 0.002;
/// Pairs that share so many landmarks lie well to each other by these alone: depth is compared with them.
const RELATED: u32 = 50;
/// Fewer such pairs tell nothing.
const LEAST_RELATED: usize = 8;
/// Median of chi-square with six degrees of freedom.
const MEDIAN: f64 = 5.35;

/// Aligns pairs, and remembers what it found.
#[derive(Debug)]
pub(super) struct Aligner {
    camera_from_depth: Se3,
    preparer: DepthPreparer,
    config: TrackConfig,
    /// By the earlier key frame and the later one, of which they are the poses.
    found: BTreeMap<[KeyFrameId; 2], RelativePose>,
    /// By how much variances are larger than the noise model says, 1 or more.
    variance: f64,
}

impl Aligner {
    pub fn new(camera: Camera, metres_per_unit: f64, camera_from_depth: Se3) -> Option<Self> {
        Some(Self {
            camera_from_depth,
            preparer: DepthPreparer::new(DepthConfig::default(), camera, metres_per_unit).ok()?,
            config: TrackConfig { points: POINTS, fixed_m: FIXED_M, ..TrackConfig::default() },
            found: BTreeMap::new(),
            variance: 1.0,
        })
    }

    /// The relative poses of pairs, each with the key frame whose it is, as far as `stop` lets it come.
    pub fn align(
        &mut self,
        snapshot: &Snapshot,
        views: &BTreeMap<KeyFrameId, Arc<View>>,
        pairs: &[Pair],
        stop: &mut dyn FnMut() -> bool,
    ) -> Vec<(KeyFrameId, RelativePose)> {
        self.found.retain(|pair, _| pair.iter().all(|id| views.contains_key(id)));
        let mut missing: BTreeMap<KeyFrameId, Vec<KeyFrameId>> = BTreeMap::new();
        for pair in pairs {
            let known = self.found.get(&[pair.from, pair.to]).map(|z| self.weighed(z));
            if known.is_none_or(|z| !agrees(snapshot, &z, pair.to)) {
                missing.entry(pair.from).or_default().push(pair.to);
            }
        }
        for (from, all) in missing {
            if stop() {
                break;
            }
            self.align_with(snapshot, views, from, &all);
        }
        self.compare(snapshot, pairs);
        let of = |pair: &Pair| Some((pair.to, self.weighed(self.found.get(&[pair.from, pair.to])?)));
        pairs.iter().filter_map(of).collect()
    }

    /// With the variance that depth was found to have.
    fn weighed(&self, z: &RelativePose) -> RelativePose {
        RelativePose { information: z.information / self.variance, ..*z }
    }

    /// Aligns key frames with the surface that another sees.
    fn align_with(
        &mut self,
        snapshot: &Snapshot,
        views: &BTreeMap<KeyFrameId, Arc<View>>,
        from: KeyFrameId,
        all: &[KeyFrameId],
    ) {
        let Some(field) = views.get(&from).and_then(|view| self.field(view)) else { return };
        let depth_from_camera = self.camera_from_depth.inverse();
        for to in all {
            let both = snapshot.key_frame(from).zip(snapshot.key_frame(*to));
            let (Some(view), Some((here, there))) = (views.get(to), both) else { continue };
            let guess = depth_from_camera * here.here_from(there) * self.camera_from_depth;
            let Ok(frame) = self.preparer.prepare_packed(&view.image) else { continue };
            if let Some(tracked) = aligned(&field, frame, &guess, &self.config) {
                self.found.insert([from, *to], self.in_camera(from, &tracked));
            }
        }
    }

    /// The field of one image, in its own frame.
    fn field(&mut self, view: &View) -> Option<TsdfVolume> {
        let frame = self.preparer.prepare_packed(&view.image).ok()?;
        let mut field = TsdfVolume::new(FIELD).ok()?;
        field.integrate(frame, None, &Se3::identity()).ok()?;
        Some(field)
    }

    /// From the depth sensor's pose to the camera's.
    fn in_camera(&self, from: KeyFrameId, tracked: &DenseTracked) -> RelativePose {
        let depth_from_camera = self.camera_from_depth.inverse();
        let mut kept = Matrix6::identity();
        tracked.free.iter().for_each(|free| kept -= free * free.transpose());
        let covariance = (tracked.covariance + tracked.covariance.transpose()) * 0.5;
        let information = (covariance + Matrix6::identity() * FLOOR * FLOOR).try_inverse();
        let information = kept * information.unwrap_or_default() * kept;
        // A perturbation of the camera is one of the sensor through the adjoint.
        let turn = depth_from_camera.adjoint();
        RelativePose {
            from,
            from_from_here: self.camera_from_depth * tracked.volume_from_camera * depth_from_camera,
            information: turn.transpose() * information * turn,
        }
    }

    /// Compares depth with landmarks where these are many: where the two differ by more than both can be off (a depth that is not registered to
    /// the picture, a lens that is not known well), depth counts for less. What it was found to be off stays: later the map follows it.
    fn compare(&mut self, snapshot: &Snapshot, pairs: &[Pair]) {
        let off = |pair: &Pair| {
            let z = self.found.get(&[pair.from, pair.to])?;
            Some(z.chi2(&Se3::identity(), &lies(snapshot, z, pair.to)?))
        };
        let mut all: Vec<f64> = pairs.iter().filter(|p| p.shared >= RELATED).filter_map(off).collect();
        if all.len() >= LEAST_RELATED {
            let middle = all.len() / 2;
            let median = *all.select_nth_unstable_by(middle, f64::total_cmp).1;
            self.variance = self.variance.max(median / MEDIAN);
        }
    }
}

/// How the map has the pose of a key frame that was aligned, in the camera frame and the unit of the other one.
fn lies(snapshot: &Snapshot, z: &RelativePose, to: KeyFrameId) -> Option<Se3> {
    Some(snapshot.key_frame(z.from)?.here_from(snapshot.key_frame(to)?))
}

/// Whether key frames lie as they were aligned.
fn agrees(snapshot: &Snapshot, z: &RelativePose, to: KeyFrameId) -> bool {
    lies(snapshot, z, to).is_some_and(|there| z.agrees(&Se3::identity(), &there))
}

/// A frame aligned with a field, where that finds the surface that was looked for.
fn aligned(
    field: &TsdfVolume,
    frame: &DepthFrame,
    guess: &Se3,
    config: &TrackConfig,
) -> Option<DenseTracked> {
    let mut tracked = track(field, frame, guess, config).ok()?;
    for _ in 0..GOES_ON {
        if fits(&tracked, guess) {
            break;
        }
        tracked = track(field, frame, &tracked.volume_from_camera, config).ok()?;
    }
    fits(&tracked, guess).then_some(tracked)
}

/// Whether an alignment found the surface that was looked for.
fn fits(tracked: &DenseTracked, guess: &Se3) -> bool {
    let off = guess.inverse() * tracked.volume_from_camera;
    tracked.converged
        && tracked.rms_m <= MOST_RMS_M
        && tracked.free.len() <= MOST_FREE
        && off.translation.norm() <= MOST_OFF[0]
        && off.rotation.angle() <= MOST_OFF[1]
}

#[cfg(test)]
mod tests {
    use super::super::tests::{CORNER, drift, map, viewpoints};
    use super::*;
    use cairn_geometry::Manifold;

    #[test]
    fn an_alignment_that_ends_on_the_way_goes_on() {
        let truth = viewpoints();
        let placed = [truth[0], truth[1].retract(&drift())];
        let (_, ids, views) = map(CORNER, &truth[..2], &placed);
        let shown = views.kept().views.clone();
        let mut aligner = views.aligner();
        let sensor = aligner.camera_from_depth;
        let between = |poses: &[Se3]| sensor.inverse() * poses[0].inverse() * poses[1] * sensor;
        let (guess, truth) = (between(&placed), between(&truth));
        let field = aligner.field(&shown[&ids[0]]).expect("a field");
        let few_steps = TrackConfig { iterations: [0, 0, 2], ..aligner.config };
        let frame = aligner.preparer.prepare_packed(&shown[&ids[1]].image).expect("an image");
        let once = track(&field, frame, &guess, &few_steps).expect("a pose");
        assert!(!fits(&once, &guess), "a few steps are not the end");
        let found = aligned(&field, frame, &guess, &few_steps).expect("it goes on");
        let off = truth.local(&found.volume_from_camera);
        assert!(off.norm() < 0.004, "{off}");
    }
}
