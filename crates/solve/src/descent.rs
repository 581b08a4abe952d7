//! The way down that graphs and bundles share: Gauss-Newton and Levenberg-Marquardt.
//!
//! Source: Madsen, Nielsen, Tingleff, "Methods for non-linear least squares problems" (2004), sections 3.1 and 3.2.

use crate::Stop;

/// First damping: nearly a Gauss-Newton step.
const FIRST_DAMPING: f64 = 1e-6;
/// With so much damping no step is worth the name.
const MOST_DAMPING: f64 = 1e10;

/// A problem between two steps.
pub trait Descend {
    /// The cost of the state.
    fn cost(&self) -> f64;
    /// Solves the linear system with this damping and tries the state that it leads to; `None` when it is singular.
    fn attempt(&mut self, damping: f64) -> Option<Attempt>;
    /// Makes the state that was tried the state.
    fn accept(&mut self);
}

/// A state that was tried.
pub struct Attempt {
    /// By how much the linear model lowers the cost.
    pub promise: f64,
    /// What the cost is; infinite or NaN when the state is of no use.
    pub cost: f64,
}

/// When to stop, and how to step.
pub struct Rule {
    /// Whole steps, also uphill.
    pub gauss_newton: bool,
    /// Steps at most.
    pub iterations: usize,
    /// Done when a step promises less than this part of the cost.
    pub tolerance: f64,
    /// Done when it promises less than this.
    pub noise: f64,
}

/// Goes down; gives the number of steps and why it ended. Asks `stop` before each step.
pub fn descend(problem: &mut impl Descend, rule: &Rule, stop: &mut impl FnMut() -> bool) -> (usize, Stop) {
    let (mut lambda, mut growth) = (FIRST_DAMPING, 2.0);
    for done in 0..rule.iterations {
        if stop() {
            return (done, Stop::Interrupted);
        }
        let attempt = problem.attempt(if rule.gauss_newton { 0.0 } else { lambda });
        let gain = attempt.as_ref().map_or(f64::NAN, |a| problem.cost() - a.cost);
        let small = |a: &Attempt| a.promise <= rule.tolerance * problem.cost() + rule.noise;
        let small = attempt.as_ref().is_some_and(small);
        match attempt {
            Some(a) if a.cost.is_finite() && (rule.gauss_newton || gain > 0.0) => {
                problem.accept();
                // Nielsen's rule: the better the model spoke, the less damping.
                let factor = 1.0 - (2.0 * gain / a.promise - 1.0).powi(3);
                (lambda, growth) = (lambda * factor.clamp(0.1, 2.0), 2.0);
            }
            _ if small => {}
            _ if rule.gauss_newton => return (done + 1, Stop::NoDescent),
            _ => (lambda, growth) = (lambda * growth, growth * 2.0),
        }
        if small {
            return (done + 1, Stop::Converged);
        }
        if lambda > MOST_DAMPING || lambda.is_nan() {
            return (done + 1, Stop::NoDescent);
        }
    }
    (rule.iterations, Stop::Iterations)
}
