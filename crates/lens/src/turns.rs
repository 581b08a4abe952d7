//! Whether a guessed focal length fits the gyroscope, from the first seconds of a map on.
//!
//! A lens that is taken for `a` times too short shows every turn across the view about `a` times too large; turns about the optical
//! axis it shows as they are. Least squares over the key frames, in the axes of the camera:
//! `seen = factor measured + bias t - offset (rate at the end - rate at the begin)`, where the factor is one about the optical axis, and
//! bias and offset of the clocks are solved for with it. A part of the turns is taken for motion by a map that was made with a wrong
//! lens: what is found is somewhat less than what the lens is off, but it is found in seconds, when [`LensProblem`](crate::LensProblem)
//! does not know anything yet.

use crate::joint::PRIOR;
use cairn_atlas::{MapId, Snapshot};
use cairn_geometry::{So3, Vec3};
use cairn_inertial::Bias;
use nalgebra::{SMatrix, SVector};

/// Key frames used at most: the newest.
const MOST_KEY_FRAMES: usize = 80;
/// Links that tell how certain the factor is, at least.
const LEAST_LINKS: usize = 8;
/// Stretches of the walk whose pulls on the factor are compared: links next to each other err alike.
const STRETCHES: usize = 10;
/// A guess is contradicted beyond so many standard deviations, since it is looked at again with every key frame; ...
const CONTRADICTS: f64 = 4.0;
/// ... where the logarithm of the factor is at least this: the distortion is not known either, and moves what is seen at the edge of a
/// picture by as much; ...
const LEAST_OFF: f64 = 0.1;
/// ... is known to this; ...
const MOST_SIGMA: f64 = 0.02;
/// ... and is what a lens can be off, in standard deviations of a guess. Beyond that it is no lens that is wrong.
const CREDIBLE: f64 = 3.0;

/// What a focal length is off that was corrected by it, as a share of the logarithm: what was taken for motion.
const TAKEN_FOR_MOTION: f64 = 0.2;

/// Unknowns: factor, bias (3), offset.
const N: usize = 5;

/// What is seen and measured between two key frames, in the axes of the camera.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// Rotation seen, and measured with a bias of zero, radians.
    seen: Vec3,
    measured: Vec3,
    /// The rate at the end less that at the begin, rad/s.
    rate_change: Vec3,
    seconds: f64,
}

/// Turns across the view as a map shows them, over those that the gyroscope measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnFactor {
    /// By what the focal length is to be multiplied, with which the map was made.
    pub factor: f64,
    /// Standard deviation of its logarithm: of independent residuals, or from how far the stretches of the walk pull it apart,
    /// whichever is larger.
    pub sigma: f64,
}

impl TurnFactor {
    /// That of the newest key frames of a map; `imu_from_camera` is the rotation from the camera's to the gyroscope's axes. `None` where
    /// they are too few, or the camera does not turn.
    pub fn of(snapshot: &Snapshot, map: MapId, imu_from_camera: &So3) -> Option<Self> {
        let camera_from_imu = imu_from_camera.inverse();
        let mut key_frames: Vec<_> = snapshot.key_frames_of(map).collect();
        key_frames.sort_by_key(|k| k.id);
        let newest = &key_frames[key_frames.len().saturating_sub(MOST_KEY_FRAMES)..];
        let turns = newest.iter().filter_map(|k| {
            let factor = k.motion.as_ref()?.imu_factor.as_ref()?;
            let before = snapshot.key_frame(factor.since).filter(|before| before.map == map)?;
            let (first, last) = (factor.sum.samples().first()?, factor.sum.samples().last()?);
            let turned = before.world_from_camera.rotation.inverse() * k.world_from_camera.rotation;
            Some(Turn {
                seen: turned.log(),
                measured: camera_from_imu * factor.sum.gained(&Bias::default()).0.log(),
                rate_change: camera_from_imu * (last.gyro - first.gyro),
                seconds: factor.sum.seconds(),
            })
        });
        Self::fitted(&turns.collect::<Vec<_>>())
    }

    fn fitted(turns: &[Turn]) -> Option<Self> {
        if turns.len() < LEAST_LINKS {
            return None;
        }
        let (mut normal, mut right) = (SMatrix::<f64, N, N>::zeros(), SVector::<f64, N>::zeros());
        for (row, value) in turns.iter().flat_map(equations) {
            normal += row * row.transpose();
            right += row * value;
        }
        let inverse = normal.try_inverse()?;
        let found = inverse * right;
        let (mut squares, mut pulls) = (0.0, [SVector::<f64, N>::zeros(); STRETCHES]);
        for (i, turn) in turns.iter().enumerate() {
            for (row, value) in equations(turn) {
                let residual = value - row.dot(&found);
                squares += residual * residual;
                pulls[i * STRETCHES / turns.len()] += row * residual;
            }
        }
        let freedom = (3 * turns.len() - N) as f64;
        let stretches = STRETCHES.min(turns.len()) as f64;
        let independent = squares / freedom * inverse[(0, 0)];
        let of_stretches: f64 = pulls.iter().map(|pull| (inverse * pull)[0].powi(2)).sum();
        let variance = independent.max(of_stretches * stretches / (stretches - 1.0));
        let (factor, sigma) = (found[0], variance.max(0.0).sqrt() / found[0]);
        (factor > 0.0 && sigma.is_finite()).then_some(Self { factor, sigma })
    }

    /// Standard deviation of the logarithm of a focal length that was multiplied by it.
    pub fn sigma_after(&self) -> f64 {
        self.sigma.hypot(TAKEN_FOR_MOTION * self.factor.ln())
    }

    /// Whether that contradicts a focal length whose logarithm is known to `known_sigma`, where it is more than a guess.
    pub fn contradicts(&self, known_sigma: Option<f64>) -> bool {
        let off = self.factor.ln().abs();
        let known = known_sigma.map_or(0.0, |known| CREDIBLE * known.hypot(self.sigma));
        self.sigma <= MOST_SIGMA
            && off > LEAST_OFF.max(CONTRADICTS * self.sigma).max(known)
            && off < CREDIBLE * PRIOR[0]
    }
}

/// The equations of a turn: the coefficients of the unknowns, and the value.
fn equations(turn: &Turn) -> [(SVector<f64, N>, f64); 3] {
    [0, 1, 2].map(|axis| {
        let is_across = axis < 2;
        let mut row = SVector::<f64, N>::zeros();
        row[0] = if is_across { turn.measured[axis] } else { 0.0 };
        row[1 + axis] = turn.seconds;
        row[N - 1] = -turn.rate_change[axis];
        (row, if is_across { turn.seen[axis] } else { turn.seen[axis] - turn.measured[axis] })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    /// Turns of a camera that sways as a walker does, between key frames a quarter of a second apart: pictures show those across the view
    /// `shown` times as large as they are, with errors that last for `alike` links each.
    fn swaying(seed: u64, shown: f64, count: usize, alike: usize) -> Vec<Turn> {
        let mut random = Random::new(seed);
        let sway =
            |t: f64| Vec3::new(0.03 * (11.0 * t).sin(), 0.04 * (5.5 * t).cos(), 0.02 * (5.5 * t).sin());
        let rate = |t: f64| (sway(t + 1e-4) - sway(t - 1e-4)) / 2e-4;
        let (bias, offset, step) = (Vec3::new(4e-3, -6e-3, 2e-3), 0.02, 0.27);
        let mut error = Vec3::zeros();
        (0..count)
            .map(|i| {
                let mut noise = |s: f64| Vec3::from_fn(|_, _| s * random.standard_normal());
                let (from, to) = (step * i as f64, step * (i + 1) as f64);
                // The readings between the same stamps are of so much later.
                let measured = sway(to + offset) - sway(from + offset);
                if i % alike == 0 {
                    error = noise(1e-3);
                }
                Turn {
                    seen: (sway(to) - sway(from)).component_mul(&Vec3::new(shown, shown, 1.0)) + error,
                    measured: measured + bias * step + noise(3e-4),
                    rate_change: rate(to + offset) - rate(from + offset),
                    seconds: step,
                }
            })
            .collect()
    }

    #[test]
    fn a_wrong_focal_length_is_found_within_seconds_and_a_right_one_is_left() {
        for seed in 0..20 {
            let right = TurnFactor::fitted(&swaying(seed, 1.0, 12, 1)).unwrap();
            assert!(!right.contradicts(None), "seed {seed}: {right:?}");
            for shown in [0.8, 0.86, 1.16, 1.25] {
                let wrong = TurnFactor::fitted(&swaying(seed, shown, 12, 1)).unwrap();
                let off = (wrong.factor / shown).ln();
                assert!(wrong.contradicts(None), "seed {seed}, {shown}: {wrong:?}");
                assert!(off.abs() < 5.0 * wrong.sigma, "seed {seed}, {shown}: {wrong:?}");
            }
        }
    }

    /// Looked at with each of a minute's key frames, while errors of pictures last.
    #[test]
    fn a_right_lens_is_not_contradicted_by_errors_that_last() {
        for seed in 0..40 {
            let turns = swaying(seed, 1.0, 200, 6);
            for n in LEAST_LINKS..turns.len() {
                let newest = &turns[n.saturating_sub(MOST_KEY_FRAMES)..n];
                let found = TurnFactor::fitted(newest);
                assert!(found.is_none_or(|f| !f.contradicts(None)), "seed {seed}, {n}: {found:?}");
            }
        }
    }

    #[test]
    fn nothing_is_said_by_one_who_stands_and_nothing_incredible_is_believed() {
        let still: Vec<Turn> = swaying(1, 1.2, 40, 1)
            .into_iter()
            .map(|t| Turn {
                seen: t.seen * 1e-3,
                measured: t.measured * 1e-3,
                rate_change: t.rate_change * 1e-3,
                ..t
            })
            .enumerate()
            .map(|(i, t)| Turn { seen: t.seen + Vec3::x() * 1e-3 * (1.7 * i as f64).sin(), ..t })
            .collect();
        assert!(TurnFactor::fitted(&still).is_none_or(|f| !f.contradicts(None)));
        assert!(TurnFactor::fitted(&swaying(1, 1.2, 7, 1)).is_none(), "too few");
        let degrees = TurnFactor::fitted(&swaying(1, 57.3, 40, 1)).unwrap();
        assert!(!degrees.contradicts(None), "{degrees:?}");
    }

    #[test]
    fn what_is_known_of_a_lens_counts_against_a_contradiction() {
        let off = TurnFactor { factor: 1.12, sigma: 0.01 };
        assert!(off.contradicts(None) && off.contradicts(Some(0.02)) && !off.contradicts(Some(0.04)));
        assert!(!TurnFactor { factor: 1.08, sigma: 1e-3 }.contradicts(None), "a distortion does as much");
        assert!(!TurnFactor { factor: 1.15, sigma: 0.03 }.contradicts(None), "it is not known yet");
    }
}
