//! The Lie group laws, and the Jacobians against finite differences, on random elements.

use cairn_geometry::{LieGroup, Se2, Se3, Sim3, So2, So3, Vec3, YawPose};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

fn vec3(limit: f64) -> impl Strategy<Value = Vec3> {
    [-limit..limit, -limit..limit, -limit..limit].prop_map(|[x, y, z]| Vec3::new(x, y, z))
}

fn se2() -> impl Strategy<Value = Se2> {
    (-5.0..5.0, -5.0..5.0, -3.0..3.0).prop_map(|(x, y, a)| Se2::from_xy_angle(x, y, a))
}

fn yaw() -> impl Strategy<Value = YawPose> {
    (vec3(5.0), -3.0..3.0).prop_map(|(t, a)| YawPose::new(So2::exp(a), t))
}

/// Rotations of up to 2.9 rad on a logarithmic scale: small ones are as frequent as large ones.
fn se3() -> impl Strategy<Value = Se3> {
    (vec3(1.7), -9.0..0.0, vec3(5.0)).prop_map(|(w, size, t)| Se3::new(So3::exp(&(w * f64::exp(size))), t))
}

fn sim3() -> impl Strategy<Value = Sim3> {
    (se3(), -1.5..1.5).prop_map(|(t, s)| Sim3::new(t.rotation, t.translation, f64::exp(s)))
}

/// Derivative of `f(x.retract(d))` with respect to `d` at zero, by central differences.
fn differences<G: LieGroup<D>, const D: usize>(
    x: &G,
    f: impl Fn(&G) -> SVector<f64, D>,
) -> SMatrix<f64, D, D> {
    let mut j = SMatrix::<f64, D, D>::zeros();
    for k in 0..D {
        let mut d = SVector::<f64, D>::zeros();
        d[k] = 1e-6;
        let column = (f(&x.retract(&d)) - f(&x.retract(&-d))) / 2e-6;
        j.set_column(k, &column);
    }
    j
}

fn satisfies_the_group_laws<G: LieGroup<D>, const D: usize>(a: &G, b: &G) -> Result<(), TestCaseError> {
    let near = |x: &G, y: &G| (x.local(y)).norm();
    prop_assert!(near(&a.retract(&a.local(b)), b) < 1e-9);
    prop_assert!(near(&a.retract(&SVector::zeros()), a) < 1e-12);
    prop_assert!(near(&a.compose(b).compose(&b.inverse()), a) < 1e-9);
    prop_assert!(near(&a.compose(&a.inverse()), &G::identity()) < 1e-9);
    prop_assert!((G::identity().local(a) - a.coordinates()).norm() < 1e-9);
    prop_assert!(a.is_finite());
    let slack = 1e-6 * (1.0 + a.coordinates().norm());
    let error = a.coordinates_jacobian() - differences(a, |x| x.coordinates());
    prop_assert!(error.norm() < slack, "coordinates: {error}");
    let error = a.chordal_jacobian() - differences(a, |x| x.chordal());
    prop_assert!(error.norm() < slack, "chordal: {error}");
    // a * d == (adjoint d) * a, to first order.
    let conjugated = differences(&G::identity(), |d| a.compose(d).compose(&a.inverse()).coordinates());
    let error = a.adjoint() - conjugated;
    prop_assert!(error.norm() < slack, "adjoint: {error}");
    Ok(())
}

proptest! {
    #[test]
    fn se2_satisfies_the_group_laws(a in se2(), b in se2()) {
        satisfies_the_group_laws(&a, &b)?;
    }

    #[test]
    fn yaw_pose_satisfies_the_group_laws(a in yaw(), b in yaw()) {
        satisfies_the_group_laws(&a, &b)?;
    }

    #[test]
    fn se3_satisfies_the_group_laws(a in se3(), b in se3()) {
        satisfies_the_group_laws(&a, &b)?;
        prop_assert!((a.coordinates() - a.log()).norm() < 1e-9);
    }

    #[test]
    fn sim3_satisfies_the_group_laws(a in sim3(), b in sim3()) {
        satisfies_the_group_laws(&a, &b)?;
    }

    #[test]
    fn sim3_of_scale_one_is_se3(a in se3()) {
        let (sim, rigid) = (Sim3::from(a).coordinates(), a.coordinates());
        prop_assert!((sim.fixed_rows::<6>(0) - rigid).norm() < 1e-9);
        prop_assert!(sim[6].abs() < 1e-15);
    }

    #[test]
    fn chordal_norm_is_the_frobenius_norm(a in se3()) {
        let frobenius = (a.rotation.matrix() - nalgebra::Matrix3::identity()).norm_squared();
        prop_assert!((a.chordal().fixed_rows::<3>(3).norm_squared() - 0.5 * frobenius).abs() < 1e-12);
    }

    #[test]
    fn tilt_split_round_trips(a in se3(), b in se3()) {
        let ((level_a, tilt_a), (level_b, tilt_b)) = (YawPose::split(&a), YawPose::split(&b));
        let back = level_a.tilted(&tilt_a);
        prop_assert!(back.local_norm(&a) < 1e-9);
        // A measurement without error is preserved.
        let between = YawPose::between(&tilt_a, &(a.inverse() * b), &tilt_b);
        let error = between.inverse() * (level_a.inverse() * level_b);
        prop_assert!(error.coordinates().norm() < 1e-8, "{error:?}");
    }
}

trait LocalNorm {
    fn local_norm(&self, other: &Self) -> f64;
}

impl LocalNorm for Se3 {
    fn local_norm(&self, other: &Self) -> f64 {
        (self.inverse() * *other).coordinates().norm()
    }
}

#[test]
fn jacobians_are_finite_at_180_degrees() {
    use cairn_geometry::LieGroup as _;
    for axis in [Vec3::x(), Vec3::y(), Vec3::new(0.6, 0.0, 0.8)] {
        let t = Se3::new(So3::exp(&(axis * std::f64::consts::PI)), Vec3::new(1.0, 2.0, 3.0));
        assert!(t.coordinates_jacobian().iter().all(|v| v.is_finite()));
        assert!(t.chordal_jacobian().iter().all(|v| v.is_finite()));
    }
}
