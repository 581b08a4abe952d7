//! Estimation of the constant disparity error of a stereo rig: whether the calibration can be trusted, and
//! how far it is off if not.
//!
//! Errors of disparity and of scale have similar effects. They are distinguished by how the disparities of near and
//! far points agree with the parallax of a moving camera, and small feature errors that do not average out (at the
//! outlines of near objects, for example) bias both. So the calibration is trusted until the windows refute it: until
//! then the error is held at zero, each window only reports where it would move it, and these reports are summed.
//! Afterwards the error is one more unknown of each window, until it is found to be negligible after all.

use cairn_adjust::WindowResult;
use cairn_atlas::Change;

/// Share of a window's information on the error that is independent of earlier windows: a key frame is in
/// about sixteen.
const SHARE: f64 = 1.0 / 16.0;
/// Lower bound of the standard deviation, pixels: rigs deform as they get warm.
const MIN_SIGMA_PX: f64 = 0.01;
/// Errors below this do not refute the calibration, pixels: feature errors alone bias it as much.
const NEGLIGIBLE_PX: f64 = 0.04;
/// The calibration is refuted by an error of this many standard deviations. Few, since the windows are
/// evaluated early, before the map has absorbed the error, and since a wrong decision is reversed later.
const REFUTED_SIGMAS: f64 = 1.5;

/// The information on the disparity error, summed over windows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DisparityError {
    /// Prior information before any window, 1/px^2.
    prior: f64,
    /// Information with the windows, 1/px^2.
    information: f64,
    /// Information of the windows in which the error was held at zero, scaled by their own residuals, 1/px^2.
    held_information: f64,
    /// Sum of the changes of the error they would have made, weighted with that information.
    pull: f64,
}

impl DisparityError {
    /// For a rig whose error has this prior standard deviation in pixels; `None` with zero: then it is not
    /// estimated.
    pub(crate) fn within(sigma: f64) -> Option<Self> {
        let prior = sigma.powi(-2);
        (sigma > 0.0).then_some(Self { prior, information: prior, held_information: prior, pull: 0.0 })
    }

    /// Standard deviation in pixels of the prior for the next window: while the error is held at zero, the
    /// prior before any window, so that each window is evaluated on its own.
    pub(crate) fn sigma(&self, held: bool) -> f64 {
        if held { self.prior.powf(-0.5) } else { self.current_sigma() }
    }

    /// Takes the result of a window, whose snapshot has the error at `found`; returns the change that
    /// calibrates the rig, when the windows refute the calibration, or confirm it after all.
    pub(crate) fn update(&mut self, found: f64, result: &WindowResult) -> Option<Change> {
        let held = found == 0.0;
        let window_prior = self.sigma(held).powi(-2);
        let added = SHARE * (result.right_offset_information - window_prior).max(0.0);
        self.information += added;
        // Features may be located more precisely than the one pixel that weights assume; the window's
        // residuals show how precisely.
        self.held_information += added / result.residual_variance;
        if !held {
            return (found.abs() < NEGLIGIBLE_PX).then(|| {
                self.pull = 0.0;
                Change::Calibrate(0.0)
            });
        }
        self.pull +=
            SHARE * result.right_offset_information * result.right_offset_pull / result.residual_variance;
        let (error, sigma) = (self.pull / self.held_information, self.held_information.powf(-0.5));
        (error.abs() > NEGLIGIBLE_PX.max(REFUTED_SIGMAS * sigma)).then_some(Change::Calibrate(error))
    }

    fn current_sigma(&self) -> f64 {
        self.information.powf(-0.5).max(MIN_SIGMA_PX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::ChangeSet;
    use cairn_solve::{Report, Stop};

    /// The result of a window whose observations alone would put the error at `at` with standard deviation
    /// `sigma`.
    fn window_result(error: &DisparityError, held: bool, at: f64, sigma: f64) -> WindowResult {
        let (own, prior) = (sigma.powi(-2), error.sigma(held).powi(-2));
        WindowResult {
            changes: ChangeSet { base: 0, changes: Vec::new() },
            report: Report {
                iterations: 1,
                cost_before: 0.0,
                cost_after: 0.0,
                inliers: 0,
                stop: Stop::Converged,
            },
            right_offset_pull: if held { own * at / (own + prior) } else { 0.0 },
            right_offset_information: own + prior,
            residual_variance: 0.1,
        }
    }

    #[test]
    fn calibration_is_trusted_until_refuted() {
        // Reports that all have the same sign, but are no larger than the usual error of a rig: 200 windows do not
        // make them certain.
        let mut error = DisparityError::within(0.2).unwrap();
        for _ in 0..200 {
            let window = window_result(&error, true, 0.025, 0.02);
            assert!(error.update(0.0, &window).is_none());
        }
        assert!((error.sigma(false) - MIN_SIGMA_PX).abs() < 1e-12);
        // A rig with an error of a third of a pixel is detected within a few windows.
        let mut error = DisparityError::within(0.2).unwrap();
        let refuted = (1..20).find_map(|n| {
            let window = window_result(&error, true, 0.33, 0.05);
            Some((n, error.update(0.0, &window)?))
        });
        let Some((n, Change::Calibrate(found))) = refuted else { panic!("{refuted:?}") };
        assert!(n < 10 && (0.2..0.34).contains(&found), "{found} after {n}");
        // From then on the windows estimate the error themselves, each with the current prior.
        assert!(error.sigma(false) < 0.2);
        let window = window_result(&error, false, 0.33, 0.05);
        assert!(error.update(0.33, &window).is_none());
        // An estimate that returns to nearly zero means there was no error.
        assert!(matches!(error.update(0.03, &window), Some(Change::Calibrate(0.0))));
    }

    #[test]
    fn zero_prior_sigma_disables_estimation() {
        assert!(DisparityError::within(0.0).is_none());
        // A window that was interrupted before its first step carries no information.
        let mut error = DisparityError::within(0.2).unwrap();
        let nothing = WindowResult { right_offset_information: 0.0, ..window_result(&error, true, 9.0, 1.0) };
        assert!(error.update(0.0, &nothing).is_none() && error.information == error.prior);
    }
}
