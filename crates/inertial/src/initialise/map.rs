//! The maximum a posteriori of a [`Problem`]: from several guesses, by Levenberg-Marquardt, with the noise fitted too.
//!
//! How noisy the visual poses are, the caller can only state roughly (pixels and depth). Too large a number hides
//! what the readings tell of scale, so it is fitted: halved for as long as that makes the measurements more likely, all
//! unknowns integrated out (MacKay, "Bayesian interpolation", Neural Computation 1992, the evidence by Laplace's
//! approximation).

use super::chain::{Chain, Shared};
use super::estimate::{Initial, tilt_sigma};
use super::guess::{self, Guess};
use super::problem::{NORM_SIGMA, Problem, State};
use super::unmodelled;
use cairn_geometry::Vec3;
use cairn_sensor::GRAVITY_M_S2;
use cairn_solve::{Convergence, Damping, LevenbergMarquardt, Trial, pause};
use nalgebra::SMatrix;

/// How often the noise of the IMU is fitted to the residuals.
const ROUNDS: usize = 4;

/// How often the stated noise of the visual poses may be halved.
const HALVINGS: usize = 3;

/// Least factor on the covariance by the residuals.
const LEAST_FACTOR: f64 = 0.25;

/// A solve under way.
struct Search<'a> {
    problem: &'a mut Problem,
    state: State,
    trial: State,
    chain: Option<Chain>,
}

impl cairn_solve::Problem for Search<'_> {
    async fn linearise(&mut self) -> Option<f64> {
        self.problem.follow(&self.state);
        let (cost, chain) = self.problem.linearise(&self.state, NORM_SIGMA)?;
        self.chain = Some(chain);
        Some(cost)
    }

    async fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let step = self.chain.as_ref()?.solve(damping)?;
        self.trial = self.problem.moved(&self.state, &step);
        let cost = self.problem.cost(&self.trial)?;
        Some(Trial { cost, predicted_decrease: f64::NAN })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.state, &mut self.trial);
    }
}

/// The best solution from all guesses; `None` when none converges.
pub async fn solve(mut problem: Problem) -> Option<Initial> {
    let gyro = guess::gyro_bias(&problem.rotations, &mut problem.links, 6);
    let mut best: Option<(f64, State)> = None;
    pause().await;
    for guess in guess::guesses(&problem, gyro) {
        if let Some((cost, state)) = descend(&mut problem, start(&guess)).await
            && best.as_ref().is_none_or(|(least, _)| cost < *least)
        {
            best = Some((cost, state));
        }
    }
    let (cost, state) = fit_imu_noise(&mut problem, best?).await?;
    let mut best = (surprise(&mut problem, cost, &state)?, cost, state);
    for _ in 0..HALVINGS {
        let before = (problem.links.clone(), problem.noise_times);
        problem.position_sigma *= 0.5;
        problem.rotation_sigma *= 0.5;
        let mut found = descend(&mut problem, best.2.clone()).await;
        if let Some(descended) = found {
            found = fit_imu_noise(&mut problem, descended).await;
        }
        pause().await;
        let found =
            found.and_then(|(cost, state)| Some((surprise(&mut problem, cost, &state)?, cost, state)));
        match found {
            Some(found) if found.0 < best.0 => best = found,
            _ => {
                problem.position_sigma *= 2.0;
                problem.rotation_sigma *= 2.0;
                (problem.links, problem.noise_times) = before;
                break;
            }
        }
    }
    let (_, cost, state) = best;
    problem.follow(&state);
    pause().await;
    estimate(&problem, cost, &state)
}

/// Residuals beyond their share are attributed to the IMU: real ones err by more than their white noise.
async fn fit_imu_noise(problem: &mut Problem, (mut cost, mut state): (f64, State)) -> Option<(f64, State)> {
    for _ in 0..ROUNDS {
        let times = shares(problem, &state)?.map(|share| if share > 1.2 { share.sqrt() } else { 1.0 });
        if times == [1.0; 2] {
            break;
        }
        problem.noise_times = [0, 1].map(|i| problem.noise_times[i] * times[i]);
        problem.links = problem.links.iter().map(|link| link.worse(times)).collect();
        (cost, state) = descend(problem, state).await?;
    }
    Some((cost, state))
}

/// The negative logarithm of the evidence of the noise assumed now, up to a constant.
fn surprise(problem: &mut Problem, cost: f64, state: &State) -> Option<f64> {
    problem.follow(state);
    let half_log_det = problem.linearise(state, NORM_SIGMA)?.1.solve(0.0)?.half_log_det;
    let seen =
        3.0 * problem.places.len() as f64 * (problem.position_sigma.ln() + problem.rotation_sigma.ln());
    let mut measured = 0.0;
    for link in &problem.links {
        // Of the whitening, the inverse of the covariance's root.
        measured -= link.white()?.diagonal().iter().map(|x| x.abs().ln()).sum::<f64>();
    }
    Some(cost + half_log_det + seen + measured)
}

/// Weighted squared residual per degree of freedom: rows are 9 a link and 6 a key frame; unknowns 9 a key frame, and
/// the shared ones but gravity's norm.
fn variance_factor(problem: &Problem, cost: f64) -> f64 {
    let n = problem.places.len();
    let freedom = (9 * problem.links.len() + 6 * n) as f64 - (9 * n + 9) as f64;
    2.0 * cost / freedom.max(1.0)
}

/// The same for the part of the gyroscope (rotations) and of the accelerometer (velocities and positions).
fn shares(problem: &Problem, s: &State) -> Option<[f64; 2]> {
    let (n, links) = (problem.places.len() as f64, problem.links.len() as f64);
    let mut turns = s.turns.iter().map(Vec3::norm_squared).sum::<f64>() / problem.rotation_sigma.powi(2);
    let mut places = s.errors.iter().map(Vec3::norm_squared).sum::<f64>() / problem.position_sigma.powi(2);
    for k in 0..problem.links.len() {
        let white = problem.whitened(s, k)?;
        turns += white.fixed_rows::<3>(0).norm_squared();
        places += white.fixed_rows::<6>(3).norm_squared();
    }
    Some([turns / (3.0 * links - 3.0).max(1.0), places / (6.0 * links - 3.0 * n - 6.0).max(1.0)])
}

fn start(guess: &Guess) -> State {
    let n = guess.velocities.len();
    State {
        log_scale: guess.scale.ln(),
        gravity: guess.gravity,
        bias: guess.bias,
        offset_s: 0.0,
        lever_arm: Vec3::zeros(),
        errors: vec![Vec3::zeros(); n],
        turns: vec![Vec3::zeros(); n],
        velocities: guess.velocities.clone(),
    }
}

pub(super) async fn descend(problem: &mut Problem, state: State) -> Option<(f64, State)> {
    let solver = LevenbergMarquardt {
        iterations: problem.config.iterations,
        damping: Damping::Factors {
            first: 1e-4,
            least: 1e-9,
            most: 1e6,
            shrink: 0.1,
            grow: 10.0,
            restart: 0.0,
        },
        convergence: Convergence::Actual { relative: 1e-6 },
    };
    problem.follow(&state);
    let mut search = Search { problem, trial: state.clone(), state, chain: None };
    let cost = solver.minimise_in_slices(&mut search, || false).await.cost_after;
    cost.is_finite().then_some((cost, search.state))
}

fn estimate(problem: &Problem, cost: f64, state: &State) -> Option<Initial> {
    let n = problem.places.len();
    let residual = variance_factor(problem, cost);
    let (_, chain) = problem.linearise(state, NORM_SIGMA)?;
    // The a posteriori variance factor: poses are mostly better than stated.
    let white = chain.solve(0.0)?.covariance * residual.max(LEAST_FACTOR);
    let unmodelled = unmodelled::covariance(problem, state, &chain)?;
    let (_, free) = problem.linearise(state, 1.0)?;
    let free = free.solve(0.0)?;
    let norm = GRAVITY_M_S2 * (1.0 + free.shared[3]);
    let norm_sigma = GRAVITY_M_S2 * (free.covariance[(3, 3)] * residual.max(1.0)).sqrt();
    let offset_sigma_s = (white[(10, 10)] + unmodelled[(10, 10)]).sqrt();
    let kept = [0, 1, 2, 4, 5, 6, 7, 8, 9];
    let of = |all: &Shared| SMatrix::<f64, 9, 9>::from_fn(|i, j| all[(kept[i], kept[j])]);
    let noise_covariance = of(&white);
    let covariance = noise_covariance + of(&unmodelled);
    Some(Initial {
        scale: state.log_scale.exp(),
        scale_sigma: covariance[(0, 0)].sqrt(),
        gravity: state.gravity,
        gravity_sigma: tilt_sigma(&covariance),
        gravity_norm: [norm, norm_sigma],
        bias: state.bias,
        offset_s: state.offset_s,
        offset_sigma_s,
        lever_arm: problem.lever_arm(state),
        states: (0..n).map(|k| problem.nav(state, k)).collect(),
        covariance,
        noise_covariance,
        residual,
        noise_times: problem.noise_times,
        position_sigma: problem.position_sigma,
    })
}
