//! Outlier rejection of loop closures between robots.
//!
//! There are three steps. First, of the loops between two robots only the largest set of pairwise consistent ones is
//! kept ([`cairn_solve::maximum_clique`]). Second, the graph of all shared poses is solved with weights that fall to zero for
//! loops that disagree with all the others together: graduated non-convexity with truncated least squares (Yang,
//! Antonante, Tzoumas, Carlone, "Graduated non-convexity for robust spatial perception", 2020, proposition 4 and
//! algorithm 1). Third, loops that were left out but agree with the result are accepted again.
//!
//! The covariances given with loops are often too small. The factor that corrects them is estimated from the loops
//! themselves, and is never less than one.

use crate::LoopId;
use crate::consistency::{LoopGroup, groups};
use crate::graphs::Measurement;
use crate::joint::{Joint, Team};
use cairn_geometry::LieGroup;
use cairn_solve::graph::{Metric, Rigid};
use cairn_solve::maximum_clique;
use std::collections::{BTreeMap, BTreeSet};

/// Greatest factor by which the given variances are assumed to be too small.
const MOST_SCALE: f64 = 100.0;
/// Factor by which the bound grows from step to step.
const SCALE_STEP: f64 = 1.2;

/// Configuration of the outlier rejection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JudgeConfig {
    /// Number of consistent loops between two robots that is needed before any of them is accepted.
    pub agreeing: usize,
    /// Fraction of pairs of correct loops that pass the consistency test, if the covariances are right.
    pub confidence: f64,
    /// Fraction of correct loops that agree with all the others together.
    pub joint_confidence: f64,
}

impl Default for JudgeConfig {
    fn default() -> Self {
        Self { agreeing: 3, confidence: 0.999, joint_confidence: 0.99999 }
    }
}

/// The decision about a loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// It is accepted; with its squared whitened residual.
    Accepted(f64),
    /// Too few loops between the two robots are consistent with it.
    Unsupported {
        /// Size of the consistent set, including the loop itself.
        agreeing: usize,
    },
    /// It disagrees with more loops between the two robots than it agrees with.
    Inconsistent,
    /// It disagrees with all other loops together.
    Outlier {
        /// Its squared whitened residual.
        chi2: f64,
        /// The largest value that would have been accepted.
        bound: f64,
    },
}

impl Verdict {
    /// Whether the loop is accepted.
    pub fn is_accepted(&self) -> bool {
        matches!(self, Self::Accepted(_))
    }
}

/// The decisions about all loops.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Judgement {
    /// Factor by which the given variances are too small.
    pub scale: f64,
    /// Every loop that was known.
    pub verdicts: BTreeMap<LoopId, Verdict>,
    /// Whether every clique is certainly a maximum one.
    pub is_exact: bool,
}

/// Quantile of chi-square with `d` degrees of freedom, where the normal distribution has the quantile `z` standard
/// deviations (Wilson and Hilferty, 1931).
fn chi2_quantile(d: usize, z: f64) -> f64 {
    let v = 2.0 / (9.0 * d as f64);
    d as f64 * (1.0 - v + z * v.sqrt()).powi(3)
}

/// Quantile of the normal distribution, within 4.5e-4 (Abramowitz and Stegun, 1964, formula 26.2.23).
fn normal_quantile(p: f64) -> f64 {
    let tail = p.min(1.0 - p).max(1e-12);
    let t = (-2.0 * tail.ln()).sqrt();
    let z = t
        - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
    if p < 0.5 { -z } else { z }
}

/// Judges all known loops between robots.
pub fn judge<G: Rigid<D>, const D: usize>(
    team: &Team<G, D>,
    loops: &BTreeMap<LoopId, Measurement<G, D>>,
    config: &JudgeConfig,
) -> Judgement {
    let groups = groups(team, loops);
    let Agreement { scale, cliques, is_exact } = agree::<D>(&groups, config);
    let mut verdicts = BTreeMap::new();
    for (group, clique) in groups.iter().zip(&cliques) {
        let agreeing = clique.len();
        for (k, id) in group.loops.iter().enumerate() {
            let verdict = match clique.binary_search(&k) {
                Err(_) => Verdict::Inconsistent,
                Ok(_) if agreeing < config.agreeing => Verdict::Unsupported { agreeing },
                Ok(_) => Verdict::Accepted(0.0),
            };
            verdicts.insert(*id, verdict);
        }
    }
    let bound = scale * chi2_quantile(D, normal_quantile(config.joint_confidence));
    let mut joint = graduate(team, loops, &mut verdicts, bound);
    for _ in 0..3 {
        if !take_back(&joint, loops, &mut verdicts, bound) {
            break;
        }
        joint = solved(team, loops, &verdicts, &joint.poses());
    }
    Judgement { scale, verdicts, is_exact }
}

/// The consistent loops of each group, for the covariance scale that fits them.
#[derive(Clone)]
struct Agreement {
    scale: f64,
    cliques: Vec<Vec<usize>>,
    is_exact: bool,
}

/// The consistent sets for bounds that grow step by step, up to [`MOST_SCALE`]: correct loops join when the bound makes
/// up for their too small covariances, wrong ones much later. Between the two, nothing changes; the scale is the start
/// of the longest range without a change (of equally long ranges, the first).
fn agree<const D: usize>(groups: &[LoopGroup], config: &JudgeConfig) -> Agreement {
    let bound = chi2_quantile(D, normal_quantile(config.confidence));
    let at = |step: u32| {
        let scale = SCALE_STEP.powi(step as i32);
        let joined = |g: &LoopGroup, a, b| g.distance(a, b) <= scale * bound;
        let found: Vec<_> =
            groups.iter().map(|g| maximum_clique(g.loops.len(), |a, b| joined(g, a, b))).collect();
        let is_exact = found.iter().all(|c| c.is_maximum);
        Agreement { scale, cliques: found.into_iter().map(|c| c.vertices).collect(), is_exact }
    };
    let mut best = at(0);
    let (mut longest, mut length) = (0, 0);
    let mut current = best.clone();
    for step in 1..=(MOST_SCALE.ln() / SCALE_STEP.ln()).ceil() as u32 {
        let next = at(step);
        if next.cliques == current.cliques {
            length += 1;
        } else {
            (current, length) = (next, 0);
        }
        if length > longest {
            (best, longest) = (current.clone(), length);
        }
    }
    best
}

fn solved<G: Rigid<D>, const D: usize>(
    team: &Team<G, D>,
    loops: &BTreeMap<LoopId, Measurement<G, D>>,
    verdicts: &BTreeMap<LoopId, Verdict>,
    from: &BTreeMap<crate::PoseId, G>,
) -> Joint<G, D> {
    let accepts = |id: &LoopId| verdicts.get(id).is_some_and(Verdict::is_accepted);
    let (mut joint, is_new) = Joint::new(team, loops, accepts, from);
    joint.solve(is_new);
    joint
}

/// Graduated non-convexity over the loops accepted so far: those beyond the bound become outliers.
fn graduate<G: Rigid<D>, const D: usize>(
    team: &Team<G, D>,
    loops: &BTreeMap<LoopId, Measurement<G, D>>,
    verdicts: &mut BTreeMap<LoopId, Verdict>,
    bound: f64,
) -> Joint<G, D> {
    let mut joint = solved(team, loops, verdicts, &BTreeMap::new());
    let first = joint.graph.edges().len() - joint.loops.len();
    let residuals = |joint: &Joint<G, D>| -> Vec<f64> {
        joint.loops.iter().map(|id| loops.get(id).map_or(f64::NAN, |m| chi2(joint, m))).collect()
    };
    let mut now = residuals(&joint);
    let largest = now.iter().copied().fold(0.0, f64::max);
    // If all residuals are within the bound, no graduation is needed.
    let mut mu = bound / (2.0 * largest - bound);
    let mut weights = vec![1.0; now.len()];
    while mu.is_finite() && mu > 0.0 && mu < 1e6 {
        for (weight, r2) in weights.iter_mut().zip(&now) {
            *weight = truncated(*r2, bound, mu);
        }
        for (k, (id, weight)) in joint.loops.iter().zip(&weights).enumerate() {
            if let Some(m) = loops.get(id) {
                joint.graph.edges_mut()[first + k].information = m.information * *weight;
            }
        }
        joint.solve(false);
        now = residuals(&joint);
        if weights.iter().all(|w| *w == 0.0 || *w == 1.0) {
            break;
        }
        mu *= 1.4;
    }
    for ((id, weight), chi2) in joint.loops.iter().zip(&weights).zip(&now) {
        let verdict =
            if *weight > 0.5 { Verdict::Accepted(*chi2) } else { Verdict::Outlier { chi2: *chi2, bound } };
        verdicts.insert(*id, verdict);
    }
    solved(team, loops, verdicts, &joint.poses())
}

/// Weight of truncated least squares at a stage of graduation (Yang et al., equation 14).
fn truncated(chi2: f64, bound: f64, mu: f64) -> f64 {
    if chi2 <= mu / (mu + 1.0) * bound {
        1.0
    } else if chi2 >= (mu + 1.0) / mu * bound || chi2.is_nan() {
        0.0
    } else {
        (bound / chi2 * mu * (mu + 1.0)).sqrt() - mu
    }
}

/// Squared whitened residual of a loop, whether the graph has it or not.
fn chi2<G: LieGroup<D>, const D: usize>(joint: &Joint<G, D>, m: &Measurement<G, D>) -> f64 {
    let (Ok(a), Ok(b)) = (joint.ids.binary_search(&m.a), joint.ids.binary_search(&m.b)) else {
        return f64::NAN;
    };
    let values = joint.graph.values();
    let relative = values[a].inverse().compose(&values[b]);
    let r = m.a_from_b.inverse().compose(&relative).coordinates();
    r.dot(&(m.information * r))
}

/// Accepts left-out loops that agree with the prediction of the other measurements, where there is one; updates
/// residuals. Returns true if any loop was accepted.
fn take_back<G: Rigid<D>, const D: usize>(
    joint: &Joint<G, D>,
    loops: &BTreeMap<LoopId, Measurement<G, D>>,
    verdicts: &mut BTreeMap<LoopId, Verdict>,
    bound: f64,
) -> bool {
    let components = joint.graph.components();
    let in_graph: BTreeSet<LoopId> = joint.loops.iter().copied().collect();
    let mut any = false;
    for (id, m) in loops {
        let now = chi2(joint, m);
        if in_graph.contains(id) {
            verdicts.insert(*id, Verdict::Accepted(now));
        } else if innovation(joint, m, &components).is_some_and(|d| d <= bound) {
            verdicts.insert(*id, Verdict::Accepted(now));
            any = true;
        }
    }
    any
}

/// Squared Mahalanobis distance of a loop that is not in the graph from the prediction of the graph, with the
/// covariances of both; `None` where the graph does not connect its ends.
fn innovation<G: LieGroup<D>, const D: usize>(
    joint: &Joint<G, D>,
    m: &Measurement<G, D>,
    components: &[usize],
) -> Option<f64> {
    let (a, b) = (joint.ids.binary_search(&m.a).ok()?, joint.ids.binary_search(&m.b).ok()?);
    if components[a] != components[b] {
        return None;
    }
    let values = joint.graph.values();
    let relative = values[a].inverse().compose(&values[b]);
    let error = m.a_from_b.inverse().compose(&relative);
    let covariance = joint.graph.covariance(&[a, b], Metric::Geodesic).ok()?;
    let block = |r: usize, c: usize| covariance.fixed_view::<D, D>(r * D, c * D).into_owned();
    let across = -relative.inverse().adjoint();
    let mixed = across * block(0, 1);
    let predicted = across * block(0, 0) * across.transpose() + mixed + mixed.transpose() + block(1, 1);
    // The error depends directly on the prediction, and on the measurement through the adjoint.
    let adjoint = error.inverse().adjoint();
    let measured = adjoint * m.information.cholesky()?.inverse() * adjoint.transpose();
    let r = error.coordinates();
    Some(r.dot(&(predicted + measured).cholesky()?.solve(&r)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_solve::CHI2_95;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for d in 1..=9 {
            let found = chi2_quantile(d, normal_quantile(0.95));
            assert!((found / CHI2_95[d - 1] - 1.0).abs() < 0.03, "{d}: {found}");
        }
        assert!((normal_quantile(0.1) + 1.2816).abs() < 1e-3);
        assert!((chi2_quantile(6, normal_quantile(0.999)) / 22.458 - 1.0).abs() < 0.01);
    }

    #[test]
    fn weights_fall_from_one_to_zero_around_the_bound_and_get_steeper() {
        assert_eq!(truncated(f64::NAN, 10.0, 1.0), 0.0);
        for mu in [0.01, 1.0, 100.0] {
            let weights: Vec<f64> = (0..400).map(|k| truncated(f64::from(k) * 0.1, 10.0, mu)).collect();
            assert!(weights.windows(2).all(|w| w[1] <= w[0] + 1e-12) && weights[0] == 1.0);
            assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
        }
        assert!(truncated(9.8, 10.0, 100.0) > 0.9 && truncated(10.2, 10.0, 100.0) < 0.1);
    }
}
