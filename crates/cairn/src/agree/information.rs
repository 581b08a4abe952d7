//! What landmarks that two key frames show tell of how these lie to each other.
//!
//! A view of a landmark measures its position in the camera with the information `I = H' W H`, where `H` is the Jacobian of pixel and
//! disparity and `W` one pixel at the level of the feature, as in every adjustment. The difference of two views has the
//! information `I_a (I_a + I_b)^-1 I_b` (for one camera each, of rank one: the epipolar constraint). A landmark
//! that `m` key frames show determines `m - 1` of their `m (m - 1) / 2` differences, so that each counts with `2 / m`: for views that are
//! equally good this is, to the number, what is left between two key frames where landmarks are eliminated (the Schur complement;
//! Konolige and Agrawal, "FrameSLAM", 2008, make relative poses of a whole adjustment in this way).

use cairn_atlas::{KeyFrame, KeyFrameId, Landmark, Snapshot};
use cairn_geometry::{Mat3, Se3, Vec3, hat};
use cairn_vision::RectifiedCamera;
use nalgebra::{Matrix3, Matrix3x6, Matrix6};

/// The information of one view on the position of a landmark, in the axes of the camera; `position` is in the camera frame.
fn of_view(camera: &RectifiedCamera, position: &Vec3, variance: f64, has_right: bool) -> Mat3 {
    let (x, y, z) = (position.x, position.y, position.z);
    if z <= 1e-6 {
        return Mat3::zeros();
    }
    let (fx, fy) = (camera.fx / z, camera.fy / z);
    let right = if has_right { 1.0 } else { 0.0 };
    let h = Matrix3::new(
        fx,
        0.0,
        -fx * x / z,
        0.0,
        fy,
        -fy * y / z,
        right * fx,
        0.0,
        right * (camera.baseline_fx / z - fx * x) / z,
    );
    h.transpose() * h / variance
}

/// What a key frame tells of the position of a landmark that its feature shows, in the axes of the map.
pub fn of_feature(
    snapshot: &Snapshot,
    atlas: &RectifiedCamera,
    k: &KeyFrame,
    feature: usize,
    l: &Landmark,
) -> Mat3 {
    at_pose(snapshot, atlas, k, feature, &(k.world_from_camera.inverse() * l.position), &k.world_from_camera)
}

/// The same where the key frame is at another pose, and sees the landmark at this position in its camera frame.
pub fn at_pose(
    snapshot: &Snapshot,
    atlas: &RectifiedCamera,
    k: &KeyFrame,
    feature: usize,
    position: &Vec3,
    world_from_camera: &Se3,
) -> Mat3 {
    let (Some(level), Some(right)) = (k.frame.octave.get(feature), k.frame.right_x.get(feature)) else {
        return Mat3::zeros();
    };
    let camera = k.camera(atlas);
    let variance = snapshot.octaves().scale(*level).powi(2);
    let information = of_view(camera, position, variance, camera.has_depth() && right.is_finite());
    let turn = world_from_camera.rotation.matrix();
    turn * information * turn.transpose()
}

/// What all key frames that show a landmark tell of its position, in the axes of the map.
pub fn of_landmark(snapshot: &Snapshot, atlas: &RectifiedCamera, l: &Landmark) -> Mat3 {
    let views = l.observations.iter().filter_map(|o| {
        let k = snapshot.key_frame(o.key_frame)?;
        Some(of_feature(snapshot, atlas, k, usize::from(o.feature), l))
    });
    views.sum()
}

/// The information on the right perturbation of `a_from_b` (translation, rotation) by a point that both see: each with its own
/// information on it in the axes of the map, at this position in the frame of `b`.
pub fn of_point(in_a: &Mat3, in_b: &Mat3, world_from_b: &Se3, position: &Vec3) -> Matrix6<f64> {
    let sum = in_a + in_b;
    // Two views along one line leave a direction open, which no weight may come from.
    let Some(inverse) = (sum + Mat3::identity() * (1e-12 * sum.trace())).try_inverse() else {
        return Matrix6::zeros();
    };
    let between = in_a * inverse * in_b;
    let turn = world_from_b.rotation.matrix();
    let between = turn.transpose() * (between + between.transpose()) * turn / 2.0;
    let mut jacobian = Matrix3x6::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&Mat3::identity());
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-hat(position));
    jacobian.transpose() * between * jacobian
}

/// The information on the pose of `b` in the camera frame of `a` by the landmarks that both show; zero where there is none.
pub fn by_landmarks(
    snapshot: &Snapshot,
    atlas: &RectifiedCamera,
    a: KeyFrameId,
    b: KeyFrameId,
) -> Matrix6<f64> {
    let (Some(a), Some(b)) = (snapshot.key_frame(a), snapshot.key_frame(b)) else { return Matrix6::zeros() };
    let shown = b.landmarks.iter().enumerate().filter_map(|(feature, id)| {
        let l = snapshot.landmark((*id)?)?;
        let in_a = of_feature(snapshot, atlas, a, usize::from(l.feature_in(a.id)?), l);
        let in_b = of_feature(snapshot, atlas, b, feature, l);
        let share = 2.0 / l.observations.len() as f64;
        let position = b.world_from_camera.inverse() * l.position;
        Some(share * of_point(&in_a, &in_b, &b.world_from_camera, &position))
    });
    shown.sum()
}
