//! Two motions explain two views of a plane about equally well; a third view tells which of them it was.
//!
//! Longuet-Higgins, "The reconstruction of a plane surface from two perspective projections" (1986): of the two
//! planes that two views leave, a third view taken from elsewhere leaves one. Here each motion with its points is adjusted
//! to all three views, and the costs are compared: whatever makes the two alike, not only planes, is decided the same way.

use crate::start::SIGMA_PX;
use cairn_adjust::pinhole;
use cairn_geometry::{Se3, Vec3};
use cairn_solve::{Bundle, BundleSetting, CHI2_2, Observation, PointMatch, PoseOnly, PoseOnlySetting};
use cairn_vision::{EyeModel, Frame, TwoView};
use std::sync::Arc;

/// Seconds after the second view that the third may come.
const OPEN_S: f64 = 1.0;
/// Points seen in all three views that are needed.
const LEAST: usize = 40;
/// What three views of a point may cost before it counts as a wrong match.
const WRONG: f64 = 3.0 * CHI2_2;
/// Of the points, the share that must not be wrong matches under the motion chosen.
const EXPLAINED: f64 = 0.8;
/// How many times the cost of the motion chosen every other must have, at least.
const CLEARLY: f64 = 1.25;
/// How much more it must cost besides, in units of the noise that the motion chosen leaves.
const MARGIN: f64 = 30.0;

/// Motions that explain the same two views.
#[derive(Debug)]
pub(crate) struct Rivals {
    second: Arc<Frame>,
    /// Features (first, second) that all motions have a point for.
    tracks: Vec<(usize, usize)>,
    motions: Vec<Motion>,
    /// Which motion the last view spoke for clearly.
    favourite: Option<usize>,
}

/// A motion with its points, adjusted to all that was seen at once so far.
#[derive(Clone, Debug)]
struct Motion {
    first_from_second: Se3,
    /// Where the last view stood.
    first_from_third: Se3,
    /// Of each track, in the first's frame.
    points: Vec<Vec3>,
}

/// What a further view tells.
#[derive(Debug, PartialEq)]
pub(crate) enum Verdict {
    /// The eye of this view stands here in the first's frame; one of the motions explains all views clearly better.
    Decided(Se3),
    /// Nothing yet.
    Open,
    /// Too late, too little is left of what the two views showed, or the motions have become one.
    Over,
}

/// Pixels of a track in the first, the second and, where it goes on, the third view.
type Sight = ([[f32; 2]; 2], Option<[f32; 2]>);

impl Rivals {
    /// `matches` are the features (first, second) that `motions` were found from.
    pub fn new(second: &Arc<Frame>, matches: &[(usize, usize)], motions: &[TwoView]) -> Self {
        let point = |m: &TwoView, k: usize| m.points.get(k).copied().flatten();
        let all = |k: &usize| motions.iter().all(|m| point(m, *k).is_some());
        let shared: Vec<usize> = (0..matches.len()).filter(all).collect();
        let motion = |m: &TwoView| Motion {
            first_from_second: m.second_from_first.inverse(),
            first_from_third: m.second_from_first.inverse(),
            points: shared.iter().filter_map(|k| point(m, *k)).collect(),
        };
        Self {
            second: second.clone(),
            tracks: shared.iter().map(|k| matches[*k]).collect(),
            motions: motions.iter().map(motion).collect(),
            favourite: None,
        }
    }

    /// Looks at a further view, with its matches (first, third). It is decided when two views in a row say the same.
    pub fn look(
        &mut self,
        eye: &EyeModel,
        first: &Frame,
        third: &Frame,
        matches: &[(usize, usize)],
    ) -> Verdict {
        let mut seen = vec![None; first.len()];
        for (i, k) in matches {
            seen[*i] = Some(third.px[*k]);
        }
        let sights: Vec<Sight> =
            self.tracks.iter().map(|(i, j)| ([first.px[*i], self.second.px[*j]], seen[*i])).collect();
        let goes_on = sights.iter().filter(|s| s.1.is_some()).count();
        if third.stamp - self.second.stamp > OPEN_S || goes_on < LEAST {
            return Verdict::Over;
        }
        // A plane has two poses that look alike too: each motion is tried from where the others believe the view stands.
        let guesses: Vec<Se3> = self.motions.iter().map(|m| m.first_from_third).collect();
        let costs: Vec<Vec<f64>> =
            self.motions.iter_mut().map(|m| adjust(eye, &sights, m, &guesses)).collect();
        let thirds: Vec<Se3> = self.motions.iter().map(|m| m.first_from_third).collect();
        // Where all have become one, what told them apart is lost: that it is the right one is not said by this.
        if thirds.iter().all(|third| !differ(third, &thirds[0])) {
            return Verdict::Over;
        }
        let clear = choose(&thirds, &costs);
        let before = std::mem::replace(&mut self.favourite, clear);
        match clear {
            Some(m) if before == clear => Verdict::Decided(thirds[m]),
            _ => Verdict::Open,
        }
    }
}

/// Locates a motion's points in the third view, adjusts all three views and the points, and tells what each track that is
/// seen in all three costs.
fn adjust(eye: &EyeModel, sights: &[Sight], motion: &mut Motion, guesses: &[Se3]) -> Vec<f64> {
    let camera = pinhole(eye);
    let weight = 1.0 / (SIGMA_PX * SIGMA_PX);
    let pixel = |p: [f32; 2]| [p[0] as f64, p[1] as f64, f64::NAN];
    let goes_on =
        |(s, point): (&Sight, &Vec3)| Some(PointMatch { point: *point, pixel: pixel(s.1?), weight });
    let matched: Vec<PointMatch> = sights.iter().zip(&motion.points).filter_map(goes_on).collect();
    let mut best = (0, motion.first_from_third);
    for guess in std::iter::once(&motion.first_from_third).chain(guesses) {
        let located = PoseOnly::solve(&camera, guess, &matched, None, &PoseOnlySetting::default());
        if located.report.inliers > best.0 {
            best = (located.report.inliers, located.world_from_eye);
        }
    }
    let mut observations = Vec::with_capacity(3 * sights.len());
    for (point, (two, third)) in sights.iter().enumerate() {
        for (pose, px) in two.iter().chain(third).enumerate() {
            observations.push(Observation {
                pose: pose as u32,
                point: point as u32,
                pixel: pixel(*px),
                weight,
            });
        }
    }
    let mut bundle = Bundle {
        camera,
        poses: vec![Se3::identity(), motion.first_from_second, best.1],
        fixed: vec![true, false, false],
        points: std::mem::take(&mut motion.points),
        observations,
        right_offset: 0.0,
        right_offset_sigma: 0.0,
    };
    bundle.solve(&BundleSetting { iterations: 20, ..BundleSetting::default() }, || false);
    let mut costs = vec![0.0; sights.len()];
    for o in &bundle.observations {
        costs[o.point as usize] += bundle.chi2(o);
    }
    let costs = sights.iter().zip(costs).filter(|(s, _)| s.1.is_some()).map(|(_, c)| c).collect();
    *motion = Motion {
        first_from_second: bundle.poses[1],
        first_from_third: bundle.poses[2],
        points: bundle.points,
    };
    costs
}

/// The motion that explains all views clearly better than each that puts the third (`thirds`) elsewhere.
fn choose(thirds: &[Se3], costs: &[Vec<f64>]) -> Option<usize> {
    let tracks = costs.first()?.len();
    // A track that no motion explains is a wrong match.
    let right: Vec<usize> = (0..tracks).filter(|&k| costs.iter().any(|c| c[k] < WRONG)).collect();
    // Also takes what is not a number for wrong.
    let total: Vec<f64> = costs.iter().map(|c| right.iter().map(|&k| c[k].min(WRONG)).sum()).collect();
    let best = (0..total.len()).min_by(|a, b| total[*a].total_cmp(&total[*b]))?;
    let explained = costs[best].iter().filter(|c| **c < WRONG).count();
    if (explained as f64) < EXPLAINED * tracks as f64 {
        return None;
    }
    // Six coordinates a track, less its point.
    let noise = total[best] / (3 * right.len()).max(1) as f64;
    let clear = |m: usize| total[m] > CLEARLY * total[best] && total[m] - total[best] > MARGIN * noise;
    let apart = |m: usize| differ(&thirds[m], &thirds[best]);
    (0..total.len()).all(|m| !apart(m) || clear(m)).then_some(best)
}

/// More than a degree of rotation or five of direction apart.
fn differ(a: &Se3, b: &Se3) -> bool {
    (a.rotation.inverse() * b.rotation).angle() > 1f64.to_radians()
        || a.translation.angle(&b.translation) > 5f64.to_radians()
}
