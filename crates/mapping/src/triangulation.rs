//! New landmarks from two views: features without a landmark are matched along epipolar lines and
//! triangulated.
//!
//! Source: Mur-Artal, Montiel, Tardós, "ORB-SLAM" (2015), section VI-C; epipolar geometry after Hartley & Zisserman.

use crate::insert::NewLandmarks;
use cairn_adjust::{depth, pixel};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::{Mat3, Se3, Vec3, hat};
use cairn_solve::{CHI2_2, CHI2_3, pause};
use cairn_vision::{Frame, Octaves, RectifiedCamera, hamming};

/// Largest Hamming distance between two views of a point, bits.
const TIGHT: u32 = 50;
/// Cosine of the smallest angle between two rays that are triangulated (about 1.1 degrees).
const LEAST_PARALLAX_COS: f64 = 0.9998;

/// Earlier key frames along the IMU factors that are searched too.
const EARLIER_IN_CHAIN: usize = 4;
/// Baseline in metres that is sufficient where no depth is known: the readings alone tell it, to some centimetres, and its error is
/// that of the depths.
const UNKNOWN_DEPTH_BASELINE_M: f64 = 0.15;

/// Creates landmarks of `centre` with its best `neighbours`; `camera` is that of the atlas.
pub(crate) async fn create_landmarks(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    centre: KeyFrameId,
    neighbours: usize,
    new_landmarks: &mut NewLandmarks,
    mut stop: impl FnMut() -> bool,
) -> Vec<Change> {
    let Some(here) = snapshot.key_frame(centre) else { return Vec::new() };
    let mut changes = Vec::new();
    let mut taken: Vec<bool> = here.landmarks.iter().map(Option::is_some).collect();
    let shared = here.covisible.iter().map(|(id, _)| *id).take(neighbours);
    for (nth, id) in shared.chain(earlier_in_chain(snapshot, here)).enumerate() {
        if nth > 0 && stop() {
            break;
        }
        pause().await;
        let Some(there) = snapshot.key_frame(id) else { continue };
        if !wide_enough(snapshot, camera, here, there) {
            continue;
        }
        let cameras = [here, there].map(|k| k.camera(camera));
        for (i, j) in match_along_epipolar_lines(cameras, snapshot.octaves(), here, there, &taken) {
            let Some(point) = triangulate(snapshot, cameras, here, i, there, j) else { continue };
            let Some(landmark) = new_landmarks.id() else { return changes };
            taken[i] = true;
            changes.push(Change::AddLandmark(landmark, point));
            changes.push(Change::Observe(landmark, centre, i as u16));
            changes.push(Change::Observe(landmark, id, j as u16));
        }
    }
    changes
}

/// Whether the baseline between two views is wide enough: more than the camera's own stereo baseline, or,
/// without one, a hundredth of the scene's depth.
fn wide_enough(snapshot: &Snapshot, camera: &RectifiedCamera, here: &KeyFrame, there: &KeyFrame) -> bool {
    let camera = here.camera(camera);
    let baseline = (here.world_from_camera.translation - there.world_from_camera.translation).norm();
    if camera.has_depth() {
        return baseline > camera.baseline_fx / camera.fx;
    }
    match median_depth(snapshot, there) {
        Some(depth) => baseline > 0.01 * depth,
        None => snapshot.is_gravity_aligned(there.map) && baseline > UNKNOWN_DEPTH_BASELINE_M,
    }
}

/// Earlier key frames along the IMU factors that share no landmark with this one: where the IMU has carried the pose
/// across views without landmarks, new ones are triangulated between them.
fn earlier_in_chain(snapshot: &Snapshot, here: &KeyFrame) -> Vec<KeyFrameId> {
    let before = |k: &KeyFrame| Some(k.motion.as_ref()?.imu_factor.as_ref()?.since);
    let chain = std::iter::successors(before(here), |id| snapshot.key_frame(*id).and_then(before));
    let gravity_aligned = snapshot.is_gravity_aligned(here.map);
    let unconnected = |id: &KeyFrameId| here.covisible.iter().all(|(shared, _)| shared != id);
    chain.take(if gravity_aligned { EARLIER_IN_CHAIN } else { 0 }).filter(unconnected).collect()
}

/// Median depth of the landmarks that a key frame observes, in map units; `None` without any.
pub(crate) fn median_depth(snapshot: &Snapshot, k: &KeyFrame) -> Option<f64> {
    let camera_from_world = k.world_from_camera.inverse();
    let mut depths: Vec<f64> = k
        .landmarks
        .iter()
        .flatten()
        .filter_map(|id| snapshot.landmark(*id))
        .map(|l| (camera_from_world * l.position).z)
        .filter(|z| *z > 0.0)
        .collect();
    if depths.is_empty() {
        return None;
    }
    let middle = depths.len() / 2;
    Some(*depths.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Pairs of unmatched features, one of each key frame, that lie on each other's epipolar line and have
/// matching descriptors; with the cameras of both.
fn match_along_epipolar_lines(
    cameras: [&RectifiedCamera; 2],
    octaves: Octaves,
    here: &KeyFrame,
    there: &KeyFrame,
    taken: &[bool],
) -> Vec<(usize, usize)> {
    let there_from_here = there.world_from_camera.inverse() * here.world_from_camera;
    let [inverse_here, inverse_there] = cameras
        .map(|c| Mat3::new(1.0 / c.fx, 0.0, -c.cx / c.fx, 0.0, 1.0 / c.fy, -c.cy / c.fy, 0.0, 0.0, 1.0));
    // Line in `there` of a pixel x in `here`: K'^-T [t]x R K^-1 x.
    let (rotation, translation) = (there_from_here.rotation.matrix(), hat(&there_from_here.translation));
    let fundamental = inverse_there.transpose() * translation * rotation * inverse_here;
    let epipole = cameras[1].project(&there_from_here.translation);
    let free = FreeFeatures::of(there, octaves);
    let mut owner: Vec<Option<(usize, u32)>> = vec![None; there.frame.len()];
    for i in (0..here.frame.len()).filter(|i| !taken[*i]) {
        let [u, v] = here.frame.px[i];
        let line = fundamental * Vec3::new(u as f64, v as f64, 1.0);
        let norm = line.x.hypot(line.y);
        if norm < 1e-12 {
            continue;
        }
        let [a, b, c] = [(line.x / norm) as f32, (line.y / norm) as f32, (line.z / norm) as f32];
        let mut best = (u32::MAX, usize::MAX);
        free.for_each_near([a, b, c], |j, [x, y]| {
            let has_depth = here.frame.has_depth(i) || there.frame.has_depth(j);
            if let (Some([eu, ev, _]), false) = (epipole, has_depth) {
                // Next to the epipole a pair constrains no depth.
                let (du, dv) = (eu - x as f64, ev - y as f64);
                if du * du + dv * dv < 100.0 * octaves.scale(there.frame.octave[j]) {
                    return;
                }
            }
            let distance = hamming(&here.frame.descriptors[i], &there.frame.descriptors[j]);
            if distance < best.0 {
                best = (distance, j);
            }
        });
        let (distance, j) = best;
        if distance <= TIGHT && owner[j].is_none_or(|(_, d)| distance < d) {
            owner[j] = Some((i, distance));
        }
    }
    let angle_changes: Vec<((usize, usize), f32)> = owner
        .iter()
        .enumerate()
        .filter_map(|(j, o)| o.map(|(i, _)| ((i, j), here.frame.angle[i] - there.frame.angle[j])))
        .collect();
    let mut matches = cairn_vision::consistent_rotation(angle_changes);
    matches.sort_unstable();
    matches
}

/// Features that are looked at together: enough for two vectors of any processor, and few enough that most lines miss them all.
const TOGETHER: usize = 16;

/// Features of a key frame that belong to no landmark, as columns, so that the distances of [`TOGETHER`] of them to a line are found at once.
/// Each line is compared with each of them, and misses nearly all.
struct FreeFeatures {
    index: Vec<usize>,
    x: Vec<f32>,
    y: Vec<f32>,
    /// The square of the farthest that a line may pass: 3.84 (chi squared, 95 %) times the variance of the octave, px^2.
    most: Vec<f32>,
}

impl FreeFeatures {
    fn of(key_frame: &KeyFrame, octaves: Octaves) -> Self {
        let frame = &key_frame.frame;
        let index: Vec<usize> = (0..frame.len()).filter(|j| key_frame.landmarks[*j].is_none()).collect();
        let column = |value: &dyn Fn(usize) -> f32, beyond: f32| {
            let mut column: Vec<f32> = index.iter().map(|j| value(*j)).collect();
            column.resize(index.len().next_multiple_of(TOGETHER), beyond);
            column
        };
        Self {
            x: column(&|j| frame.px[j][0], 0.0),
            y: column(&|j| frame.px[j][1], 0.0),
            // No line is near the features that only fill up the last columns.
            most: column(&|j| 3.84 * octaves.scale(frame.octave[j]).powi(2) as f32, -1.0),
            index,
        }
    }

    /// Calls `found` with index and pixel of each feature that lies on the line a x + b y + c = 0, in their order.
    fn for_each_near(&self, [a, b, c]: [f32; 3], mut found: impl FnMut(usize, [f32; 2])) {
        let near = |x: f32, y: f32, most: f32| {
            let off = a * x + b * y + c;
            off * off <= most
        };
        let columns = [&self.x, &self.y, &self.most].map(|column| column.as_chunks::<TOGETHER>().0);
        for (group, ((x, y), most)) in columns[0].iter().zip(columns[1]).zip(columns[2]).enumerate() {
            let mut any = 0;
            for lane in 0..TOGETHER {
                any += u32::from(near(x[lane], y[lane], most[lane]));
            }
            if any == 0 {
                continue;
            }
            for lane in (0..TOGETHER).filter(|lane| near(x[*lane], y[*lane], most[*lane])) {
                found(self.index[TOGETHER * group + lane], [x[lane], y[lane]]);
            }
        }
    }
}

/// The point that two features show, where it is well conditioned and agrees with both views.
fn triangulate(
    snapshot: &Snapshot,
    cameras: [&RectifiedCamera; 2],
    here: &KeyFrame,
    i: usize,
    there: &KeyFrame,
    j: usize,
) -> Option<Vec3> {
    let octaves = snapshot.octaves();
    let seen = |k: &KeyFrame, f: usize| {
        let [u, v, _] = k.frame.pixel_with(f, snapshot.readout().seconds);
        [u as f32, v as f32]
    };
    let [xa, xb] = [cameras[0].unproject(seen(here, i), 1.0), cameras[1].unproject(seen(there, j), 1.0)];
    let ray = |k: &KeyFrame, x: &Vec3| k.world_from_camera.rotation * x.normalize();
    let cosine = ray(here, &xa).dot(&ray(there, &xb));
    let stereo_cosine = |camera: &RectifiedCamera, frame: &Frame, f: usize| {
        if frame.has_depth(f) {
            let half = 0.5 * camera.baseline_fx / camera.fx / frame.depth[f] as f64;
            (2.0 * half.atan()).cos()
        } else {
            2.0
        }
    };
    let (ca, cb) = (stereo_cosine(cameras[0], &here.frame, i), stereo_cosine(cameras[1], &there.frame, j));
    let measured = |camera: &RectifiedCamera, k: &KeyFrame, f: usize| {
        k.world_from_camera * camera.unproject(k.frame.px[f], depth(snapshot, camera, &k.frame, f))
    };
    let point = if cosine > 0.0 && cosine < LEAST_PARALLAX_COS && cosine < ca.min(cb) {
        intersect(&here.world_from_camera, &xa, &there.world_from_camera, &xb)?
    } else if ca <= cb && ca < 2.0 {
        measured(cameras[0], here, i)
    } else if cb < ca {
        measured(cameras[1], there, j)
    } else {
        return None;
    };
    let distance = |camera: &RectifiedCamera, k: &KeyFrame, f: usize| {
        let q = k.world_from_camera.inverse() * point;
        let [u, v, right] = camera.project(&q)?;
        let [mu, mv, mr] = pixel(snapshot, &k.frame, f);
        let dr = if mr.is_nan() { 0.0 } else { mr - right };
        let chi2 = ((mu - u).powi(2) + (mv - v).powi(2) + dr * dr) / octaves.scale(k.frame.octave[f]).powi(2);
        (chi2 < if mr.is_nan() { CHI2_2 } else { CHI2_3 }).then(|| q.norm())
    };
    let (da, db) = (distance(cameras[0], here, i)?, distance(cameras[1], there, j)?);
    // A point looks smaller from farther away, and in a camera of shorter focal length: the ratio of distances must agree
    // with that of the pyramid scales.
    let by_range = db / da * (here.focal_ratio() / there.focal_ratio());
    let by_level = octaves.scale(here.frame.octave[i]) / octaves.scale(there.frame.octave[j]);
    let slack = 1.5 * octaves.factor;
    (by_range < by_level * slack && by_range * slack > by_level).then_some(point)
}

/// Linear triangulation (Hartley & Zisserman, section 12.2, inhomogeneous) of two normalised pixels.
fn intersect(world_from_a: &Se3, xa: &Vec3, world_from_b: &Se3, xb: &Vec3) -> Option<Vec3> {
    let mut h = Mat3::zeros();
    let mut g = Vec3::zeros();
    for (pose, x) in [(world_from_a, xa), (world_from_b, xb)] {
        let r = pose.rotation.matrix();
        // Camera axes in the world: columns of r. Row k of the projection: r.column(k) . (p - centre).
        let (rx, ry, rz) = (r.column(0), r.column(1), r.column(2));
        for row in [rz * x.x - rx, rz * x.y - ry] {
            h += row * row.transpose();
            g += row * row.dot(&pose.translation);
        }
    }
    let p = h.try_inverse()? * g;
    p.iter().all(|v| v.is_finite()).then_some(p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{World, mono, pose, sideways};
    use crate::tests::remove;
    use cairn_atlas::Atlas;

    /// Two views of a single camera, 0.6 m apart, in a map without landmarks.
    fn two_views(seed: u64) -> (World, Atlas, [KeyFrameId; 2]) {
        let world = World::around(mono(), seed);
        let (mut atlas, ids) = world.exact_map(&sideways(3, 0.3));
        remove(&mut atlas, |_| true);
        (world, atlas, [ids[2], ids[0]])
    }

    #[test]
    fn intersect_finds_the_point_where_two_rays_meet() {
        let (a, b, point) = (pose(0.0, 0.0, 0.0), pose(0.5, 0.1, -0.2), Vec3::new(0.7, -0.4, 4.0));
        let ray = |pose: &Se3| {
            let p = pose.inverse() * point;
            p / p.z
        };
        let found = intersect(&a, &ray(&a), &b, &ray(&b)).expect("a point");
        assert!((found - point).norm() < 1e-9, "{found:?}");
    }

    #[test]
    fn match_along_epipolar_lines_pairs_what_looks_alike_and_lies_on_the_line() {
        let (world, atlas, ids) = two_views(161);
        let snapshot = atlas.latest();
        let [here, there] = ids.map(|id| snapshot.key_frame(id).unwrap());
        let (cameras, octaves) = ([&world.camera; 2], snapshot.octaves());
        let free = vec![false; here.frame.len()];
        let matches = match_along_epipolar_lines(cameras, octaves, here, there, &free);
        assert!(matches.len() > 100, "{}", matches.len());
        for (i, j) in &matches {
            assert_eq!(here.frame.descriptors[*i], there.frame.descriptors[*j]);
        }
        let taken = vec![true; here.frame.len()];
        assert!(match_along_epipolar_lines(cameras, octaves, here, there, &taken).is_empty());
        // Lines of a camera that stood 0.3 m higher, which it did not.
        let mut elsewhere = there.clone();
        elsewhere.world_from_camera.translation.y += 0.3;
        let wrong = match_along_epipolar_lines(cameras, octaves, here, &elsewhere, &free);
        assert!(wrong.len() * 5 < matches.len(), "{} of {}", wrong.len(), matches.len());
    }

    #[test]
    fn triangulate_finds_the_true_point_and_refuses_what_no_point_explains() {
        let (world, atlas, ids) = two_views(162);
        let snapshot = atlas.latest();
        let [here, there] = ids.map(|id| snapshot.key_frame(id).unwrap());
        let cameras = [&world.camera; 2];
        let views = [pose(0.6, 0.0, 0.0), pose(0.0, 0.0, 0.0)].map(|pose| world.see(&pose, 0.0));
        let mut found = 0;
        for (i, point) in views[0].points.iter().enumerate() {
            let Ok(j) = views[1].points.binary_search(point) else { continue };
            let Some(at) = triangulate(snapshot, cameras, here, i, there, j) else { continue };
            assert!((at - world.points[*point]).norm() < 2e-3, "{at:?}");
            found += 1;
            // The feature of another point is on another line, or at another distance than its level says.
            let others = (0..views[1].points.len()).filter(|other| *other != j).step_by(20);
            let explained = others.filter(|o| triangulate(snapshot, cameras, here, i, there, *o).is_some());
            assert!(explained.count() <= 2, "feature {i}");
        }
        assert!(found > 100, "{found}");
        // Without a baseline no depth is known.
        assert!(triangulate(snapshot, cameras, here, 0, here, 0).is_none());
    }
}
