//! The manifold laws and the Jacobians, on random elements.

use cairn_geometry::{Manifold, Se3, Sim3, So3, Vec3};
use nalgebra::SVector;
use proptest::prelude::*;

fn vec3(limit: f64) -> impl Strategy<Value = Vec3> {
    [-limit..limit, -limit..limit, -limit..limit].prop_map(|[x, y, z]| Vec3::new(x, y, z))
}

fn se3() -> impl Strategy<Value = Se3> {
    (vec3(1.7), vec3(10.0)).prop_map(|(w, t)| Se3::new(So3::exp(&w), t))
}

proptest! {
    #[test]
    fn exp_and_log_are_inverse(w in vec3(1.7)) {
        prop_assert!((So3::exp(&w).log() - w).norm() < 1e-12);
    }

    #[test]
    fn small_rotations_keep_their_precision(w in vec3(1e-6)) {
        prop_assert!((So3::exp(&w).log() - w).norm() < 1e-18 + 1e-12 * w.norm());
    }

    #[test]
    fn right_jacobian_matches_differences(w in vec3(1.7), d in vec3(1.0)) {
        let h = 1e-6;
        let difference = So3::exp(&w).local(&So3::exp(&(w + d * h))) / h;
        prop_assert!((So3::right_jacobian(&w) * d - difference).norm() < 1e-5);
        let product = So3::right_jacobian(&w) * So3::right_jacobian_inverse(&w);
        prop_assert!((product - nalgebra::Matrix3::identity()).norm() < 1e-9);
    }

    #[test]
    fn se3_retract_and_local_are_inverse(a in se3(), b in se3()) {
        let d = a.local(&b);
        let back = a.retract(&d);
        prop_assert!((back.translation - b.translation).norm() < 1e-9);
        prop_assert!(back.rotation.local(&b.rotation).norm() < 1e-9);
        prop_assert!((a.retract(&SVector::zeros()).translation - a.translation).norm() < 1e-12);
    }

    #[test]
    fn adjoint_moves_a_perturbation_to_the_left(a in se3(), v in vec3(0.5), w in vec3(0.5)) {
        let d = SVector::<f64, 6>::new(v.x, v.y, v.z, w.x, w.y, w.z);
        let left = a * Se3::exp(&d);
        let right = Se3::exp(&(a.adjoint() * d)) * a;
        prop_assert!(left.local(&right).norm() < 1e-9);
    }

    #[test]
    fn sim3_inverse_is_correct(t in se3(), s in 0.1..10.0f64, p in vec3(5.0)) {
        let sim = Sim3::new(t.rotation, t.translation, s);
        prop_assert!((sim.inverse() * (sim * p) - p).norm() < 1e-9);
        prop_assert!(((sim * sim.inverse()) * p - p).norm() < 1e-9);
    }
}
