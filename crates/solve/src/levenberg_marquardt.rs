//! The one Levenberg-Marquardt loop: damping, acceptance of steps, stopping reasons, interruption.
//!
//! A [`Problem`] knows how to linearise itself, to solve its damped normal equations and to evaluate the state they lead
//! to; how it stores them (on the stack, block-sparse, with a Schur complement) is its own business.
//!
//! Source: Madsen, Nielsen, Tingleff, "Methods for non-linear least squares problems" (2004), sections 3.1 and 3.2;
//! Nielsen, "Damping parameter in Marquardt's method" (1999).

use crate::Stop;
use crate::slices::{pause, to_end};

/// Costs below this count as zero when a decrease is compared with the cost.
const ZERO_COST: f64 = 1e-12;

/// A nonlinear least-squares problem with its current state. Large ones pause within their work ([`pause`]).
#[expect(async_fn_in_trait, reason = "whether such work may move to another thread is known of each problem")]
pub trait Problem {
    /// Builds the normal equations at the current state; returns its cost (half the robust sum of squares). `None` when
    /// the state cannot be linearised, which ends the solve.
    async fn linearise(&mut self) -> Option<f64>;
    /// Solves the normal equations with this damping and evaluates the state that the step leads to, the trial state.
    /// `None` when they are singular.
    async fn attempt(&mut self, damping: f64) -> Option<Trial>;
    /// Makes the trial state the current one.
    fn accept(&mut self);
}

/// A trial state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// Its cost; infinite or NaN when the state is of no use.
    pub cost: f64,
    /// By how much the linear model lowers the cost. Only [`Damping::GainRatio`] and [`Convergence::Predicted`] read it;
    /// problems solved otherwise may leave it at NaN.
    pub predicted_decrease: f64,
}

/// How the damping changes between steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Damping {
    /// None: the full Gauss-Newton step each time, also where it raises the cost.
    GaussNewton,
    /// By the ratio of actual to predicted decrease (Nielsen's rule).
    GainRatio {
        /// Of the first step.
        first: f64,
        /// Beyond this no step lowers the cost any more.
        most: f64,
    },
    /// By constant factors.
    Factors {
        /// Of the first step.
        first: f64,
        /// Least damping.
        least: f64,
        /// Beyond this no step lowers the cost any more.
        most: f64,
        /// Factor after an accepted step.
        shrink: f64,
        /// Factor after a rejected step; doubled for each further rejection in a row.
        grow: f64,
        /// Least damping after a rejected step.
        restart: f64,
    },
}

/// When a solve has converged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Convergence {
    /// The linear model promises to lower the cost by less than this part of it, or by less than an absolute amount.
    Predicted {
        /// Part of the cost.
        relative: f64,
        /// Amount.
        absolute: f64,
    },
    /// An accepted step changed the cost by less than this part of it.
    Actual {
        /// Part of the cost.
        relative: f64,
    },
}

/// How a problem is solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevenbergMarquardt {
    /// Steps at most, rejected ones too.
    pub iterations: usize,
    /// How the damping changes.
    pub damping: Damping,
    /// When it has converged.
    pub convergence: Convergence,
}

/// How a solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Accepted and rejected steps together.
    pub iterations: usize,
    /// Cost of the first state; NaN when it could not be linearised.
    pub cost_before: f64,
    /// Cost of the last accepted state.
    pub cost_after: f64,
    /// Why it ended.
    pub stop: Stop,
}

impl LevenbergMarquardt {
    /// Lowers the cost of the problem; its state is the last accepted one afterwards. Asks `interrupted` before each step.
    pub fn minimise(&self, problem: &mut impl Problem, interrupted: impl FnMut() -> bool) -> Outcome {
        to_end(self.minimise_in_slices(problem, interrupted))
    }

    /// The same, with a pause after each linearisation and each step.
    pub async fn minimise_in_slices(
        &self,
        problem: &mut impl Problem,
        mut interrupted: impl FnMut() -> bool,
    ) -> Outcome {
        let mut outcome =
            Outcome { iterations: 0, cost_before: f64::NAN, cost_after: f64::NAN, stop: Stop::Iterations };
        let Some(mut cost) = problem.linearise().await else {
            outcome.stop = Stop::NoDescent;
            return outcome;
        };
        (outcome.cost_before, outcome.cost_after) = (cost, cost);
        let mut damper = Damper::new(self.damping);
        let mut is_linearised = true;
        pause().await;
        while outcome.iterations < self.iterations {
            if interrupted() {
                outcome.stop = Stop::Interrupted;
                break;
            }
            if !is_linearised {
                let Some(now) = problem.linearise().await else {
                    outcome.stop = Stop::NoDescent;
                    break;
                };
                // Not always that of the trial: a problem may have refined its measurements when it accepted.
                (cost, outcome.cost_after, is_linearised) = (now, now, true);
                pause().await;
            }
            outcome.iterations += 1;
            let trial = problem.attempt(damper.lambda).await;
            pause().await;
            let decrease = trial.map_or(f64::NAN, |t| cost - t.cost);
            let accepted = match self.damping {
                Damping::GaussNewton => trial.is_some_and(|t| t.cost.is_finite()),
                _ => decrease >= 0.0 && decrease.is_finite(),
            };
            let converged = self.has_converged(trial, decrease, cost, accepted);
            if let (true, Some(trial)) = (accepted, trial) {
                problem.accept();
                (outcome.cost_after, is_linearised) = (trial.cost, false);
                cost = trial.cost;
                damper.accepted(decrease / trial.predicted_decrease);
            }
            if converged {
                outcome.stop = Stop::Converged;
                break;
            }
            if !accepted && !damper.rejected() {
                outcome.stop = Stop::NoDescent;
                break;
            }
        }
        outcome
    }

    fn has_converged(&self, trial: Option<Trial>, decrease: f64, cost: f64, accepted: bool) -> bool {
        match self.convergence {
            Convergence::Predicted { relative, absolute } => {
                trial.is_some_and(|t| t.predicted_decrease <= relative * cost + absolute)
            }
            Convergence::Actual { relative } => accepted && decrease.abs() / cost.max(ZERO_COST) < relative,
        }
    }
}

/// The damping of the next step.
struct Damper {
    rule: Damping,
    lambda: f64,
    /// Doubles with each rejection in a row.
    growth: f64,
}

impl Damper {
    fn new(rule: Damping) -> Self {
        let lambda = match rule {
            Damping::GaussNewton => 0.0,
            Damping::GainRatio { first, .. } | Damping::Factors { first, .. } => first,
        };
        Self { rule, lambda, growth: 1.0 }
    }

    fn accepted(&mut self, gain_ratio: f64) {
        self.growth = 1.0;
        match self.rule {
            Damping::GaussNewton => {}
            Damping::GainRatio { .. } => {
                // The better the model predicted, the less damping.
                let factor = 1.0 - (2.0 * gain_ratio - 1.0).powi(3);
                self.lambda *= if factor.is_nan() { 2.0 } else { factor.clamp(0.1, 2.0) };
            }
            Damping::Factors { least, shrink, .. } => self.lambda = (self.lambda * shrink).max(least),
        }
    }

    /// Damps more; false when that is beyond what lowers any cost.
    fn rejected(&mut self) -> bool {
        let most = match self.rule {
            Damping::GaussNewton => return false,
            Damping::GainRatio { most, .. } => {
                self.lambda *= 2.0 * self.growth;
                most
            }
            Damping::Factors { most, grow, restart, .. } => {
                self.lambda = (self.lambda * grow * self.growth).max(restart);
                most
            }
        };
        self.growth *= 2.0;
        self.lambda <= most
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `0.5 (x^2 - 2)^2` by its one unknown: a minimum at the square root of two, a maximum at zero.
    struct Root {
        x: f64,
        trial: f64,
        accepted: Vec<f64>,
    }

    impl Root {
        fn at(x: f64) -> Self {
            Self { x, trial: x, accepted: Vec::new() }
        }

        fn cost(x: f64) -> f64 {
            0.5 * (x * x - 2.0).powi(2)
        }
    }

    impl Problem for Root {
        async fn linearise(&mut self) -> Option<f64> {
            Some(Self::cost(self.x))
        }

        async fn attempt(&mut self, damping: f64) -> Option<Trial> {
            let (r, j) = (self.x * self.x - 2.0, 2.0 * self.x);
            let h = j * j;
            let step = -j * r / (h + damping * h);
            self.trial = self.x + step;
            let predicted_decrease = 0.5 * step * (damping * h * step - j * r);
            step.is_finite().then(|| Trial { cost: Self::cost(self.trial), predicted_decrease })
        }

        fn accept(&mut self) {
            self.x = self.trial;
            self.accepted.push(Self::cost(self.x));
        }
    }

    const FACTORS: Damping =
        Damping::Factors { first: 1e-3, least: 1e-9, most: 1e6, shrink: 0.1, grow: 10.0, restart: 0.0 };
    const GAIN_RATIO: Damping = Damping::GainRatio { first: 1e-3, most: 1e10 };

    fn solver(damping: Damping) -> LevenbergMarquardt {
        LevenbergMarquardt { iterations: 60, damping, convergence: Convergence::Actual { relative: 1e-12 } }
    }

    #[test]
    fn every_damping_reaches_the_minimum_and_damped_ones_never_raise_the_cost() {
        for damping in [Damping::GaussNewton, FACTORS, GAIN_RATIO] {
            let mut root = Root::at(0.1);
            let outcome = solver(damping).minimise(&mut root, || false);
            assert_eq!(outcome.stop, Stop::Converged, "{damping:?}");
            assert!((root.x - 2f64.sqrt()).abs() < 1e-6, "{damping:?}: {}", root.x);
            assert_eq!(outcome.cost_after, Root::cost(root.x));
            let falls = root.accepted.windows(2).all(|w| w[1] <= w[0]);
            assert!(falls || damping == Damping::GaussNewton);
        }
    }

    #[test]
    fn singular_equations_end_without_descent() {
        for damping in [Damping::GaussNewton, FACTORS, GAIN_RATIO] {
            let outcome = solver(damping).minimise(&mut Root::at(0.0), || false);
            assert_eq!(outcome.stop, Stop::NoDescent);
            assert_eq!(outcome.cost_after, outcome.cost_before);
        }
    }

    #[test]
    fn an_interrupt_and_the_iteration_limit_keep_the_last_accepted_state() {
        let mut root = Root::at(0.1);
        let mut calls = 0;
        let asked = || {
            calls += 1;
            calls > 3
        };
        let outcome = solver(FACTORS).minimise(&mut root, asked);
        assert_eq!((outcome.stop, outcome.iterations), (Stop::Interrupted, 3));
        assert_eq!(outcome.cost_after, Root::cost(root.x));
        let few = LevenbergMarquardt { iterations: 2, ..solver(FACTORS) };
        assert_eq!(few.minimise(&mut Root::at(0.1), || false).stop, Stop::Iterations);
    }
}
