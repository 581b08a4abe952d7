//! What is known of the disparity error of a stereo rig: whether its calibration is to be believed, and how far it is off else.
//!
//! Errors of disparity and of scale look much alike: what tells them apart is how the disparities of near and far points agree
//! with the parallax of moving eyes, and small faults of features that do not average out (at the outlines of near things, say)
//! pull at both together. So the calibration is believed until the windows refute it: until then the error is zero, each window
//! is only asked where it would move, and what they say is summed. Afterwards the error is one unknown more of each window, until it
//! is found to be next to nothing after all.

use cairn_adjust::WindowResult;
use cairn_atlas::Change;

/// Share of what a window says of the error that no window before has said: a key frame is in about sixteen.
const SHARE: f64 = 1.0 / 16.0;
/// Standard deviation below which the error is not held to be known, pixels: rigs bend as they get warm.
const LEAST_SIGMA: f64 = 0.01;
/// A calibration is not doubted for less, pixels: features' own faults pull as much.
const BELIEVED: f64 = 0.04;
/// So many standard deviations off zero refute it. Few, since the windows are heard early, before the map has taken on the
/// error, and since who is doubted wrongly is believed again.
const REFUTES: f64 = 1.5;

/// The sum of what windows say.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DisparityError {
    /// What is known before any window, 1/px^2,
    before: f64,
    /// and with the windows.
    information: f64,
    /// What the windows that were only asked are sure of, by their own residuals, 1/px^2,
    sure: f64,
    /// and where they would move it, each by that.
    pull: f64,
}

impl DisparityError {
    /// Of a rig whose error is known to so many pixels, one standard deviation; `None` with zero: then it is not looked for.
    pub(crate) fn within(sigma: f64) -> Option<Self> {
        let before = sigma.powi(-2);
        (sigma > 0.0).then_some(Self { before, information: before, sure: before, pull: 0.0 })
    }

    /// The prior of the next window, as a standard deviation in pixels: where it is held, what is known without any window, so
    /// that each is asked alone.
    pub(crate) fn sigma(&self, held: bool) -> f64 {
        if held { self.before.powf(-0.5) } else { self.known_to() }
    }

    /// Takes up what a window said of the error, which the map has at `found`; the change that calibrates the rig, when it refutes
    /// what was believed, or finds it true after all.
    pub(crate) fn hear(&mut self, found: f64, said: &WindowResult) -> Option<Change> {
        let held = found == 0.0;
        let prior = self.sigma(held).powi(-2);
        let more = SHARE * (said.right_offset_information - prior).max(0.0);
        self.information += more;
        // Features may be placed better than by the pixel that weights count with; how well, the window's residuals tell.
        self.sure += more / said.residual_variance;
        if !held {
            return (found.abs() < BELIEVED).then(|| {
                self.pull = 0.0;
                Change::Calibrate(0.0)
            });
        }
        self.pull += SHARE * said.right_offset_information * said.right_offset_pull / said.residual_variance;
        let (error, sigma) = (self.pull / self.sure, self.sure.powf(-0.5));
        (error.abs() > BELIEVED.max(REFUTES * sigma)).then_some(Change::Calibrate(error))
    }

    fn known_to(&self) -> f64 {
        self.information.powf(-0.5).max(LEAST_SIGMA)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::ChangeSet;
    use cairn_solve::{Report, Stop};

    /// What a window says whose observations alone would have the error at `at`, known to `sigma`.
    fn said(error: &DisparityError, held: bool, at: f64, sigma: f64) -> WindowResult {
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
    fn a_calibration_is_believed_until_it_is_refuted() {
        // Faults that all pull one way, by less than a rig may well be off: 200 windows do not make that sure.
        let mut error = DisparityError::within(0.2).unwrap();
        for _ in 0..200 {
            let window = said(&error, true, 0.025, 0.02);
            assert!(error.hear(0.0, &window).is_none());
        }
        assert!((error.sigma(false) - LEAST_SIGMA).abs() < 1e-12);
        // A rig that is off by a third of a pixel is found out within a few.
        let mut error = DisparityError::within(0.2).unwrap();
        let refuted = (1..20).find_map(|n| {
            let window = said(&error, true, 0.33, 0.05);
            Some((n, error.hear(0.0, &window)?))
        });
        let Some((n, Change::Calibrate(found))) = refuted else { panic!("{refuted:?}") };
        assert!(n < 10 && (0.2..0.34).contains(&found), "{found} after {n}");
        // From then on the windows move it themselves, each from what is known by then.
        assert!(error.sigma(false) < 0.2);
        let window = said(&error, false, 0.33, 0.05);
        assert!(error.hear(0.33, &window).is_none());
        // What comes back to nearly zero was no error.
        assert!(matches!(error.hear(0.03, &window), Some(Change::Calibrate(0.0))));
    }

    #[test]
    fn what_is_not_looked_for_is_not_found() {
        assert!(DisparityError::within(0.0).is_none());
        // A window that was interrupted before its first step says nothing.
        let mut error = DisparityError::within(0.2).unwrap();
        let nothing = WindowResult { right_offset_information: 0.0, ..said(&error, true, 9.0, 1.0) };
        assert!(error.hear(0.0, &nothing).is_none() && error.information == error.before);
    }
}
