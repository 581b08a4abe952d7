//! The scales of two maps that are joined: what a match says of the scale between them is weighed against how well both units of
//! length are known.
//!
//! In: what is known of both scales, and the logarithm of the scale between the maps with its standard deviation. Out: by what each
//! map's lengths are multiplied, and how well the joined map's unit is known; or that the match contradicts both. Logarithms of
//! metres in a unit are Gaussian, with the mean 0 and the standard deviations that the maps state, and independent; the match
//! measures the difference of both. Conditioning on it (Maybeck, "Stochastic models, estimation, and control" (1979), volume 1,
//! section 5.3; with one measurement) gives, for an exact match, the mean of both scales weighted by information.

use cairn_atlas::{Change, MapId, MapScale, Snapshot};
use std::fmt;

/// Chi-square of one degree of freedom that is exceeded by one right match in ten thousand: 3.9 standard deviations.
const MOST_CHI2: f64 = 15.14;
/// A change of both scales by less than this share of what the joined one is known to is left out.
const NEGLIGIBLE: f64 = 0.1;
/// Standard deviation of the logarithm of scale as one place tells it, beyond the scatter of its points: the error of the recognised
/// pose along the view, as a share of the median depth.
const ONE_PLACE: f64 = 0.02;
/// Several places tell no better than this, however well they agree: what they have in common does not average out. Measured on six walks
/// in two parts, whose lengths where both were differ from those of the whole by up to a percent (docs/figures/team.md).
const LEAST: f64 = 5e-3;
/// From a median absolute deviation to a standard deviation, for Gaussian errors.
const MAD_TO_SIGMA: f64 = 1.4826;

/// The scale between two visits, by the depths of points known in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DepthRatio {
    /// Median of the natural logarithm: of depth there for each depth here.
    pub log: f64,
    /// Median absolute deviation.
    pub spread: f64,
    /// How many points.
    pub points: usize,
}

impl DepthRatio {
    /// By the logarithms of all points.
    pub fn of(mut logs: Vec<f64>) -> Self {
        let points = logs.len();
        let (log, spread) = median_and_spread(&mut logs);
        Self { log, spread, points }
    }
}

/// What a match says of the scale between two maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ScaleMatch {
    /// Natural logarithm of the length in the map of the place for each length in the map of the key frame.
    pub log_ratio: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

impl ScaleMatch {
    /// By the points of one place; `None` for fewer than `need`.
    pub fn of_place(ratio: &DepthRatio, need: usize) -> Option<Self> {
        let scatter = MAD_TO_SIGMA * ratio.spread / (ratio.points as f64).sqrt();
        (ratio.points >= need).then(|| Self { log_ratio: ratio.log, sigma: scatter.hypot(ONE_PLACE) })
    }

    /// By the logarithms that several places tell, of which so many are independent; `None` for fewer than three.
    pub fn of_places(mut logs: Vec<f64>, independent: usize) -> Option<Self> {
        if logs.len().min(independent) < 3 {
            return None;
        }
        let (log_ratio, spread) = median_and_spread(&mut logs);
        let sigma = MAD_TO_SIGMA * spread / (independent as f64).sqrt();
        Some(Self { log_ratio, sigma: sigma.hypot(LEAST) })
    }
}

/// The scales of two maps that become one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusedScales {
    /// By what lengths in the map of the place, the older of two whole maps, are multiplied.
    pub there: f64,
    /// By what lengths in the map of the key frame, the younger one, are multiplied.
    pub here: f64,
    /// Standard deviation of the natural logarithm of metres in a unit of the joined map, the greater of both parts; `None` where
    /// neither had metres.
    pub sigma_log: Option<f64>,
}

impl FusedScales {
    /// Length in the map of the place for each length in that of the key frame.
    pub fn ratio(&self) -> f64 {
        self.here / self.there
    }

    /// The changes that follow when the maps (of the place and of the key frame) of a snapshot were merged into `into`; `unit` is one
    /// of both factors, of the map whose unit of length the merged map has so far.
    pub(super) fn after_merge(
        &self,
        before: &Snapshot,
        [there, here]: [MapId; 2],
        into: MapId,
        unit: f64,
    ) -> Vec<Change> {
        let mut changes = Vec::new();
        for (map, factor) in [(there, self.there), (here, self.here)].into_iter().filter(|(_, f)| *f != 1.0) {
            let moving = before.key_frames_of(map).filter_map(|k| Some((k.id, k.motion.as_ref()?)));
            let scaled = moving.map(|(id, m)| Change::InertialState(id, m.velocity * factor, m.bias));
            changes.extend(scaled);
        }
        changes.extend((unit != 1.0).then_some(Change::Rescale(into, unit)));
        changes.extend(self.sigma_log.map(|sigma_log| Change::ScaleSigma(into, sigma_log)));
        changes
    }
}

/// A match whose scale contradicts what is known of both maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleConflict {
    /// Length in the map of the place for each length in that of the key frame, by the match.
    pub ratio: f64,
    /// Standard deviation of its logarithm, of both maps and of the match.
    pub sigma_log: f64,
}

impl fmt::Display for ScaleConflict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [ratio, sigma] = [self.ratio, self.sigma_log];
        write!(
            f,
            "a metre of one map would be {ratio:.3} m of the other: {:.1} standard deviations of {:.1} %",
            ratio.ln().abs() / sigma,
            100.0 * sigma
        )
    }
}

/// Weighs the scales of two maps by a match between them. Where only one of them has metres, or none, their lengths stay: what
/// gives the other its unit is the match.
///
/// # Errors
/// [`ScaleConflict`].
pub(super) fn fuse_scales(
    [there, here]: [MapScale; 2],
    measured: Option<ScaleMatch>,
) -> Result<FusedScales, ScaleConflict> {
    let unchanged = |sigma_log| FusedScales { there: 1.0, here: 1.0, sigma_log };
    let (a, b) = match (there.metric_sigma(), here.metric_sigma()) {
        (Some(a), Some(b)) => (a, b),
        (Some(sigma), None) | (None, Some(sigma)) => {
            return Ok(unchanged(measured.map(|m| m.sigma.hypot(sigma))));
        }
        (None, None) => return Ok(unchanged(None)),
    };
    let Some(ScaleMatch { log_ratio, sigma }) = measured else { return Ok(unchanged(Some(a.max(b)))) };
    let variance = a * a + b * b + sigma * sigma;
    if log_ratio * log_ratio > MOST_CHI2 * variance {
        return Err(ScaleConflict { ratio: log_ratio.exp(), sigma_log: variance.sqrt() });
    }
    let gain = [a * a / variance, b * b / variance];
    let sigma_log = (a * (1.0 - gain[0]).sqrt()).max(b * (1.0 - gain[1]).sqrt());
    let logs = [-gain[0] * log_ratio, gain[1] * log_ratio];
    if logs.iter().all(|log| log.abs() < NEGLIGIBLE * sigma_log) {
        return Ok(unchanged(Some(sigma_log)));
    }
    Ok(FusedScales { there: logs[0].exp(), here: logs[1].exp(), sigma_log: Some(sigma_log) })
}

/// Median and median absolute deviation; zeros for an empty slice.
fn median_and_spread(values: &mut [f64]) -> (f64, f64) {
    if values.is_empty() {
        return (0.0, 0.0);
    }
    let middle = values.len() / 2;
    let median = *values.select_nth_unstable_by(middle, f64::total_cmp).1;
    values.iter_mut().for_each(|v| *v = (*v - median).abs());
    (median, *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    fn metric(sigma_log: f64) -> MapScale {
        MapScale::Metric { sigma_log }
    }

    fn matched(log_ratio: f64, sigma: f64) -> Option<ScaleMatch> {
        Some(ScaleMatch { log_ratio, sigma })
    }

    #[test]
    fn an_exact_match_gives_the_mean_weighted_by_information() {
        let fused = fuse_scales([metric(0.02), metric(0.01)], matched(0.015, 1e-9)).unwrap();
        // Weights 1 and 4: the logarithms of both move towards each other by four fifths and one fifth.
        assert!(
            (fused.there.ln() + 0.012).abs() < 1e-9 && (fused.here.ln() - 0.003).abs() < 1e-9,
            "{fused:?}"
        );
        assert!((fused.ratio().ln() - 0.015).abs() < 1e-9);
        let sigma = (1.0 / (1.0 / 0.02f64.powi(2) + 1.0 / 0.01f64.powi(2))).sqrt();
        assert!((fused.sigma_log.unwrap() - sigma).abs() < 1e-6, "{fused:?}");
    }

    #[test]
    fn both_orders_give_the_same() {
        let one = fuse_scales([metric(0.02), metric(0.003)], matched(0.03, 0.004)).unwrap();
        let other = fuse_scales([metric(0.003), metric(0.02)], matched(-0.03, 0.004)).unwrap();
        assert!((one.there - other.here).abs() < 1e-12 && (one.here - other.there).abs() < 1e-12);
        assert_eq!(one.sigma_log, other.sigma_log);
    }

    /// Scales and matches drawn from what they state: what is fused has the errors that it states, is no worse than either was, and
    /// is as good as never refused.
    #[test]
    fn what_is_fused_is_as_uncertain_as_it_says() {
        let mut random = Random::new(7);
        let (runs, mut refused) = (20_000, 0);
        for (a, b, of_match) in [(0.015, 0.015, 0.002), (0.02, 0.008, 0.003), (0.003, 0.02, 0.004)] {
            let (mut there, mut here, mut greater) = (0.0, 0.0, 0.0);
            let mut kept = 0.0;
            for _ in 0..runs {
                // Logarithms of metres in a unit of each map.
                let truth = [a, b].map(|sigma| random.normal(0.0, sigma));
                let measured = matched(truth[1] - truth[0] + random.normal(0.0, of_match), of_match);
                let Ok(fused) = fuse_scales([metric(a), metric(b)], measured) else {
                    refused += 1;
                    continue;
                };
                kept += 1.0;
                let sigma = fused.sigma_log.unwrap();
                assert!(sigma <= a.max(b));
                let errors = [fused.there.ln() - truth[0], fused.here.ln() - truth[1]];
                let variance = a * a + b * b + of_match * of_match;
                there += errors[0].powi(2) / (a * a * (1.0 - a * a / variance));
                here += errors[1].powi(2) / (b * b * (1.0 - b * b / variance));
                greater += errors.iter().map(|e| e * e).fold(0.0, f64::max) / sigma.powi(2);
            }
            let nees = [there / kept, here / kept, greater / kept];
            println!("{a} and {b} by {of_match}: NEES {nees:?}");
            assert!(nees[..2].iter().all(|nees| (nees - 1.0).abs() < 0.05), "{nees:?}");
            // The greater error of both parts, over the greater variance.
            assert!((0.9..1.3).contains(&nees[2]), "{nees:?}");
        }
        assert!(refused < 30, "{refused} of {} right matches refused", 3 * runs);
    }

    #[test]
    fn a_match_beyond_what_both_allow_is_refused() {
        let scales = [metric(0.01), metric(0.01)];
        let sigma = (2e-4f64 + 1e-6).sqrt();
        assert!(fuse_scales(scales, matched(3.8 * sigma, 1e-3)).is_ok());
        let conflict = fuse_scales(scales, matched(-4.0 * sigma, 1e-3)).unwrap_err();
        let said = conflict.to_string();
        assert_eq!(
            said,
            "a metre of one map would be 0.945 m of the other: 4.0 standard deviations of 1.4 %"
        );
    }

    #[test]
    fn without_metres_in_both_lengths_stay() {
        let guessed = MapScale::Guessed { sigma_log: 0.15 };
        for scales in [[metric(0.01), guessed], [MapScale::Unknown, metric(0.01)]] {
            let fused = fuse_scales(scales, matched(0.7, 0.01)).unwrap();
            assert_eq!((fused.there, fused.here), (1.0, 1.0));
            assert!((fused.sigma_log.unwrap() - 0.01 * 2f64.sqrt()).abs() < 1e-12);
        }
        assert_eq!(fuse_scales([guessed, MapScale::Unknown], matched(0.7, 0.01)).unwrap().sigma_log, None);
        assert_eq!(fuse_scales([metric(0.003), metric(0.02)], None).unwrap().sigma_log, Some(0.02));
    }

    #[test]
    fn many_places_tell_the_scale_better_than_one() {
        let ratio = DepthRatio { log: 0.01, spread: 0.02, points: 100 };
        let one = ScaleMatch::of_place(&ratio, 10).unwrap();
        assert!(one.sigma > 0.02 && one.sigma < 0.021);
        assert_eq!(ScaleMatch::of_place(&ratio, 101), None);
        let logs = vec![0.008, 0.011, 0.010, 0.012, 0.009];
        let many = ScaleMatch::of_places(logs.clone(), 5).unwrap();
        assert!((many.log_ratio - 0.010).abs() < 1e-12 && many.sigma < 0.0055, "{many:?}");
        assert!(many.sigma < 0.3 * one.sigma);
        assert_eq!(ScaleMatch::of_places(logs, 2), None);
    }
}
