//! Factors and variables that a bundle is solved with beside its observations: IMU factors with velocities and biases,
//! say. They supply residuals and Jacobians; the one solver does the rest. Kinds of factors in a list are factors too.

use crate::Loss;
use crate::schur::Normal;
use cairn_geometry::Se3;
use nalgebra::{SMatrix, SVector};
use std::ops::Range;

/// A variable that a factor touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// A pose of the bundle, by its index: translation and rotation, perturbed on the right.
    Pose(usize),
    /// A free variable of the factors' own, by its place among [`Factors::sizes`].
    Own(usize),
}

/// Factors of one kind, over the poses of a bundle and, where they have some, variables of their own.
pub trait Factors {
    /// Calls `visit` with the variables of each factor.
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable]));
    /// Adds every factor at the current state to the equations; `None` when one of them cannot be linearised.
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()>;
    /// Moves the own variables by a step (all of them, one after the other) into a trial state; returns the cost of all
    /// factors there: half the sum of squares.
    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64;
    /// Makes the trial state of the own variables the current one.
    fn accept(&mut self) {}
    /// Unknowns of each free variable of their own.
    fn sizes(&self) -> Vec<usize> {
        Vec::new()
    }
    /// Components of own variables that stay as they are.
    fn held(&self) -> Vec<(usize, Range<usize>)> {
        Vec::new()
    }
    /// True when there is no factor.
    fn is_empty(&self) -> bool {
        let mut is_empty = true;
        self.scopes(&mut |_| is_empty = false);
        is_empty
    }
}

/// No factors.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoFactors;

impl Factors for NoFactors {
    fn scopes(&self, _: &mut dyn FnMut(&[Variable])) {}
    fn linearise(&mut self, _: &[Se3], _: &mut Equations) -> Option<()> {
        Some(())
    }
    fn attempt(&mut self, _: &[Se3], _: &[f64]) -> f64 {
        0.0
    }
}

/// Factors of several kinds. The own variables of the first come first.
impl<T: Factors + ?Sized> Factors for [Box<T>] {
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        let mut first = 0;
        for kind in self {
            let placed = |v: &Variable| match v {
                Variable::Own(i) => Variable::Own(first + i),
                pose => *pose,
            };
            kind.scopes(&mut |scope| visit(&scope.iter().map(placed).collect::<Vec<_>>()));
            first += kind.sizes().len();
        }
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        let first = equations.first_own;
        for kind in self.iter_mut() {
            kind.linearise(poses, equations)?;
            equations.first_own += kind.sizes().len();
        }
        equations.first_own = first;
        Some(())
    }
    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
        let (mut cost, mut rest) = (0.0, step);
        for kind in self.iter_mut() {
            let (own, others) = rest.split_at(kind.sizes().iter().sum::<usize>().min(rest.len()));
            cost += kind.attempt(poses, own);
            rest = others;
        }
        cost
    }
    fn accept(&mut self) {
        self.iter_mut().for_each(|kind| kind.accept());
    }
    fn sizes(&self) -> Vec<usize> {
        self.iter().flat_map(|kind| kind.sizes()).collect()
    }
    fn held(&self) -> Vec<(usize, Range<usize>)> {
        let (mut held, mut first) = (Vec::new(), 0);
        for kind in self {
            held.extend(kind.held().into_iter().map(|(own, components)| (first + own, components)));
            first += kind.sizes().len();
        }
        held
    }
}

/// The normal equations that factors add themselves to.
pub struct Equations<'a> {
    normal: &'a mut Normal<6>,
    /// Block row of each pose, when it is free.
    slot: &'a [Option<u32>],
    /// Place of the first own variable of the kind that adds itself.
    first_own: usize,
}

impl<'a> Equations<'a> {
    pub(crate) fn new(normal: &'a mut Normal<6>, slot: &'a [Option<u32>]) -> Self {
        Self { normal, slot, first_own: 0 }
    }

    /// Adds a factor: its whitened residual, the Jacobian, and for each variable which columns of it are its. Variables
    /// that are not free are `None` or fixed poses. Its variables were visited by [`Factors::scopes`].
    pub fn add<const R: usize, const C: usize>(
        &mut self,
        residual: &SVector<f64, R>,
        jacobian: &SMatrix<f64, R, C>,
        parts: &[(Option<Variable>, Range<usize>)],
    ) {
        let free = self.normal.cameras.len() + self.first_own;
        let row = |v: Option<Variable>| match v? {
            Variable::Pose(i) => self.slot.get(i).copied().flatten().map(|s| s as usize),
            Variable::Own(i) => Some(free + i),
        };
        let parts: Vec<_> = parts.iter().map(|(v, columns)| (row(*v), columns.clone())).collect();
        self.normal.add_factor(residual, jacobian, &parts);
    }

    /// The same with a robust loss: the factor's cost is half of [`Loss::of`] its squared residual.
    pub fn add_robust<const R: usize, const C: usize>(
        &mut self,
        residual: &SVector<f64, R>,
        jacobian: &SMatrix<f64, R, C>,
        parts: &[(Option<Variable>, Range<usize>)],
        loss: &Loss,
    ) {
        let chi2 = residual.norm_squared();
        let (cost, weight) = loss.of(chi2);
        self.add(&(residual * weight.sqrt()), &(jacobian * weight.sqrt()), parts);
        self.normal.cost += 0.5 * (cost - weight * chi2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bundle, BundleConfig, Freedom, Pinhole};
    use cairn_geometry::{So3, Vec3};

    /// Sensors that measure the x of a pose, each by a scale of its own.
    struct Scales {
        pose: usize,
        measured: Vec<f64>,
        values: Vec<f64>,
        trial: Vec<f64>,
    }

    impl Scales {
        fn boxed(pose: usize, measured: &[f64]) -> Box<dyn Factors> {
            let ones = vec![1.0; measured.len()];
            Box::new(Self { pose, measured: measured.to_vec(), values: ones.clone(), trial: ones })
        }

        fn residual(&self, poses: &[Se3], values: &[f64], i: usize) -> f64 {
            10.0 * (values[i] * poses[self.pose].translation.x - self.measured[i])
        }

        fn cost(&self, poses: &[Se3], values: &[f64]) -> f64 {
            (0..values.len()).map(|i| 0.5 * self.residual(poses, values, i).powi(2)).sum()
        }
    }

    impl Factors for Scales {
        fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
            (0..self.values.len()).for_each(|i| visit(&[Variable::Pose(self.pose), Variable::Own(i)]));
        }
        fn sizes(&self) -> Vec<usize> {
            vec![1; self.values.len()]
        }
        fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
            let pose = &poses[self.pose];
            for i in 0..self.values.len() {
                let mut jacobian = SMatrix::<f64, 1, 7>::zeros();
                let by_x = pose.rotation.matrix().fixed_view::<1, 3>(0, 0) * (10.0 * self.values[i]);
                jacobian.fixed_view_mut::<1, 3>(0, 0).copy_from(&by_x);
                jacobian[6] = 10.0 * pose.translation.x;
                let residual = SVector::<f64, 1>::new(self.residual(poses, &self.values, i));
                let parts = [(Some(Variable::Pose(self.pose)), 0..6), (Some(Variable::Own(i)), 6..7)];
                equations.add(&residual, &jacobian, &parts);
            }
            Some(())
        }
        fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
            self.trial = self.values.iter().zip(step).map(|(value, step)| value + step).collect();
            self.cost(poses, &self.trial)
        }
        fn accept(&mut self) {
            self.values.clone_from(&self.trial);
        }
        fn held(&self) -> Vec<(usize, Range<usize>)> {
            // The last one is known to be 1.
            vec![(self.values.len() - 1, 0..1)]
        }
    }

    #[test]
    fn kinds_of_factors_in_a_list_keep_their_own_variables_apart() {
        let pose = |x: f64| Se3::new(So3::exp(&Vec3::new(0.1, 0.4, -0.2)), Vec3::new(x, 1.0, 2.0));
        let mut bundle = Bundle {
            camera: Pinhole { fx: 400.0, fy: 400.0, cx: 320.0, cy: 240.0, baseline_fx: 0.0 },
            own_cameras: Vec::new(),
            poses: vec![pose(2.0), pose(3.0)],
            freedom: vec![Freedom::Free; 2],
            points: Vec::new(),
            observations: Vec::new(),
            calibrations: Vec::new(),
        };
        // Of the first pose, x is 4 by a scale of 1, so that the others are a half and a fourth; of the second one x is 5.
        let mut kinds = vec![Scales::boxed(0, &[2.0, 1.0, 4.0]), Scales::boxed(1, &[10.0, 5.0])];
        let kinds = kinds.as_mut_slice();
        assert_eq!((kinds.sizes(), kinds.held()), (vec![1; 5], vec![(2, 0..1), (4, 0..1)]));
        assert!(!Factors::is_empty(kinds) && Factors::is_empty(&[] as &[Box<dyn Factors>]));
        let config = BundleConfig { iterations: 60, tolerance: 1e-14, ..BundleConfig::default() };
        let report = bundle.solve_with(kinds, &config, || false);
        assert!(report.cost_after < 1e-9, "{report:?}");
        let x = [0, 1].map(|i| bundle.poses[i].translation.x);
        assert!((x[0] - 4.0).abs() < 1e-4 && (x[1] - 5.0).abs() < 1e-4, "{x:?}");
        // A step of one of them changes the cost of its own kind.
        let costs = [0, 3].map(|own| {
            let mut step = [0.0; 5];
            step[own] = 0.1;
            kinds.attempt(&bundle.poses, &step)
        });
        let expected = x.map(|x| 0.5 * (10.0 * 0.1 * x).powi(2));
        assert!((costs[0] - expected[0]).abs() < 1e-3 && (costs[1] - expected[1]).abs() < 1e-3, "{costs:?}");
    }

    /// One pose against a place that it should be at, robustly.
    struct Place(Loss);

    impl Factors for Place {
        fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
            visit(&[Variable::Pose(0)]);
        }
        fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
            let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
            jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&poses[0].rotation.matrix());
            let parts = [(Some(Variable::Pose(0)), 0..6)];
            equations.add_robust(&poses[0].translation, &jacobian, &parts, &self.0);
            Some(())
        }
        fn attempt(&mut self, poses: &[Se3], _: &[f64]) -> f64 {
            0.5 * self.0.of(poses[0].translation.norm_squared()).0
        }
    }

    #[test]
    fn a_robust_factor_costs_its_loss_and_pulls_by_its_slope() {
        let poses = [Se3::new(So3::exp(&Vec3::new(0.1, 0.4, -0.2)), Vec3::new(3.0, -1.0, 4.0))];
        for loss in [Loss::Squared, Loss::Huber(2.0), Loss::Cauchy(1.5)] {
            let schur =
                crate::schur::Schur::<6>::new(1, 0, std::iter::empty(), crate::schur::More::default());
            let mut normal = schur.normal();
            Place(loss).linearise(&poses, &mut Equations::new(&mut normal, &[Some(0)]));
            let cost = |x: f64| {
                let mut moved = poses;
                moved[0].translation += poses[0].rotation.matrix().column(0) * x;
                Place(loss).attempt(&moved, &[])
            };
            assert!((normal.cost - cost(0.0)).abs() < 1e-12, "{loss:?}");
            let slope = (cost(1e-6) - cost(-1e-6)) / 2e-6;
            assert!((normal.camera_gradients[0][0] - slope).abs() < 1e-6, "{loss:?}");
        }
    }
}
