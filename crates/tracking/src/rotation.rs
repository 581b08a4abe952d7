//! Whether two frames differ by a rotation alone, and by which: for a monocular camera that turns on the spot. Nobody else decides
//! that; who asks says what is concluded from it ([`Conclusion`]).
//!
//! Between two frames without parallax the bearings of a point differ by the camera's rotation alone (the infinite
//! homography; Hartley & Zisserman, section 13.4). It is found by RANSAC over pairs of bearings and refined over all
//! inliers by the closed form of Wahba's problem (Markley 1988, singular value decomposition). Once there is
//! parallax the model no longer fits, which the share of inliers reveals.

use crate::start::match_around;
use cairn_geometry::{Mat3, So3, Vec3};
use cairn_random::Random;
use cairn_vision::{Frame, RectifiedCamera};

/// Half of the search window around the position predicted by the previous rotation, pixels; the second where that
/// finds too little.
const RADII: [f32; 2] = [30.0, 90.0];
/// Matches that must agree; of the few features of a view that is nearly blank at least so many, and this share of the features.
const NEED: usize = 30;
const NEED_BLANK: usize = 12;
const BLANK_SHARE: f64 = 0.2;
/// Pixels within which a match agrees: covers corners of the fine levels, and the parallax of a camera held off the
/// rotation axis.
const AGREE_PX: f64 = 3.0;
/// RANSAC samples of two matches.
const SAMPLES: usize = 60;

/// What is concluded from two frames that differ by a rotation alone. The more a wrong conclusion spoils, and the farther apart the
/// frames are, the more must agree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Conclusion {
    /// The camera has turned by that from one frame to the next: the orientation is carried on, and checked by later frames.
    Turned,
    /// The camera has stood for a third of a second: the velocity that the readings predict is nearly zero.
    Stood,
    /// The views tell no depth: nothing is triangulated, and the position is held.
    NoParallax,
}

impl Conclusion {
    /// The share of all matches that must agree.
    fn share(self) -> f64 {
        match self {
            Self::Turned => 0.6,
            Self::Stood => 0.8,
            Self::NoParallax => 0.9,
        }
    }
}

/// How two frames differ.
pub(crate) enum Between {
    /// By a rotation: `first_from_second`, with the matches that agree and all there are.
    Rotation { rotation: So3, inliers: usize, matched: usize },
    /// By more than a rotation: there is parallax.
    Parallax,
    /// Too few matches between the two.
    TooFew,
}

/// Whether two frames differ by a rotation near `guess`, so surely that this can be concluded.
pub(crate) fn rotation_between(
    camera: &RectifiedCamera,
    first: &Frame,
    second: &Frame,
    guess: &So3,
    conclusion: Conclusion,
) -> Between {
    let features = first.len().min(second.len());
    let need = NEED.min(NEED_BLANK.max((BLANK_SHARE * features as f64) as usize));
    let back = guess.inverse();
    let expected: Vec<Option<[f32; 2]>> = (first.px.iter())
        .map(|px| {
            let [u, v, _] = camera.project(&(back * camera.unproject(*px, 1.0)))?;
            camera.contains(u, v).then_some([u as f32, v as f32])
        })
        .collect();
    let mut matches = Vec::new();
    for radius in RADII {
        matches = match_around(first, second, &expected, radius);
        if matches.len() >= 2 * need {
            break;
        }
    }
    if matches.len() < need {
        return Between::TooFew;
    }
    let bearing = |px: [f32; 2]| camera.unproject(px, 1.0).normalize();
    let pairs: Vec<(Vec3, Vec3)> =
        matches.iter().map(|(i, j)| (bearing(first.px[*i]), bearing(second.px[*j]))).collect();
    match ransac(&pairs, AGREE_PX / camera.fx, second.stamp.0 as u64) {
        Some((rotation, inliers))
            if inliers >= need && inliers as f64 >= conclusion.share() * pairs.len() as f64 =>
        {
            Between::Rotation { rotation, inliers, matched: pairs.len() }
        }
        _ => Between::Parallax,
    }
}

/// The rotation that aligns second bearings to first ones for most pairs, within an angle; with their count.
fn ransac(pairs: &[(Vec3, Vec3)], within_rad: f64, seed: u64) -> Option<(So3, usize)> {
    if pairs.len() < 3 {
        return None;
    }
    let mut random = Random::new(seed);
    let agrees = |r: &So3, (a, b): &(Vec3, Vec3)| (a - *r * *b).norm() < within_rad;
    let agree = |r: &So3| -> Vec<usize> { (0..pairs.len()).filter(|i| agrees(r, &pairs[*i])).collect() };
    // Whether more than `least` agree; asks no further pairs than that takes.
    let more_than = |r: &So3, least: usize| {
        let mut may_fail = pairs.len().saturating_sub(least);
        pairs.len() > least
            && pairs.iter().all(|pair| {
                may_fail -= usize::from(!agrees(r, pair));
                may_fail > 0
            })
    };
    let mut best: Vec<usize> = Vec::new();
    for _ in 0..SAMPLES {
        let (a, b) = (random.below(pairs.len()), random.below(pairs.len()));
        let Some(r) = wahba([a, b].iter().map(|i| &pairs[*i]).filter(|_| a != b)) else { continue };
        if more_than(&r, best.len()) {
            best = agree(&r);
        }
    }
    for _ in 0..2 {
        let refined = wahba(best.iter().map(|i| &pairs[*i]))?;
        best = agree(&refined);
    }
    let rotation = wahba(best.iter().map(|i| &pairs[*i]))?;
    Some((rotation, best.len()))
}

/// The rotation that aligns the second of each pair to the first with the least squared error.
fn wahba<'a>(pairs: impl Iterator<Item = &'a (Vec3, Vec3)>) -> Option<So3> {
    let (mut sum, mut count) = (Mat3::zeros(), 0);
    for (a, b) in pairs {
        sum += a * b.transpose();
        count += 1;
    }
    let svd = sum.try_svd(true, true, 1e-12, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    // Two different bearings determine a rotation.
    if count < 2 || svd.singular_values[1] < 1e-4 {
        return None;
    }
    let handed = Mat3::from_diagonal(&Vec3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    Some(So3::from_matrix(&(u * handed * v_t)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{World, mono, pose};

    fn bearings(count: usize) -> Vec<Vec3> {
        (0..count)
            .map(|k| Vec3::new((k as f64 * 0.7).sin() * 0.5, (k as f64 * 1.3).cos() * 0.4, 1.0).normalize())
            .collect()
    }

    #[test]
    fn rotation_is_found_among_outliers() {
        let turn = So3::exp(&Vec3::new(0.01, -0.06, 0.02));
        let pairs: Vec<(Vec3, Vec3)> = (bearings(100).into_iter().enumerate())
            .map(|(k, b)| (if k % 4 == 0 { Vec3::new(b.y, b.x, b.z) } else { turn * b }, b))
            .collect();
        let (found, inliers) = ransac(&pairs, 0.005, 3).unwrap();
        assert!((found.inverse() * turn).angle() < 1e-9, "{found:?}");
        assert!((75..85).contains(&inliers), "{inliers}");
    }

    #[test]
    fn parallax_is_no_rotation() {
        let moved = Vec3::new(0.3, 0.0, 0.0);
        // Points at 1 to 4 m, seen 0.3 m to the side.
        let pairs: Vec<(Vec3, Vec3)> = (bearings(100).into_iter().enumerate())
            .map(|(k, b)| (b, (b * (1.0 + (k % 7) as f64 * 0.5) - moved).normalize()))
            .collect();
        let found = ransac(&pairs, 0.005, 3);
        assert!(found.is_none_or(|(_, inliers)| inliers < 60), "{found:?}");
    }

    #[test]
    fn what_spoils_more_needs_more_matches_that_agree() {
        let world = World::around(mono(), 31);
        let (mut first, second) =
            (world.see(&pose(0.0, 0.0, 0.0), 0.0), world.see(&pose(0.0, 0.0, 0.02), 0.1));
        // A quarter of the features show something that has moved on by ten pixels meanwhile.
        let frame = std::sync::Arc::make_mut(&mut first.frame);
        (0..frame.len()).step_by(4).for_each(|i| frame.px[i][1] += 10.0);
        frame.index(&world.camera);
        let is_rotation = |conclusion| {
            let between =
                rotation_between(&world.camera, &first.frame, &second.frame, &So3::identity(), conclusion);
            matches!(between, Between::Rotation { .. })
        };
        assert!(is_rotation(Conclusion::Turned));
        assert!(!is_rotation(Conclusion::Stood) && !is_rotation(Conclusion::NoParallax));
    }

    #[test]
    fn one_bearing_fixes_nothing() {
        let b = Vec3::z();
        assert!(wahba([(b, b), (b, b)].iter()).is_none());
        assert!(ransac(&[], 0.01, 1).is_none());
    }
}
