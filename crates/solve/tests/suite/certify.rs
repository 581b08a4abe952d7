//! Certificates: a global optimum is told from a local one.

use cairn_geometry::{LieGroup, Manifold, Se2, Se3, So3};
use cairn_solve::Loss;
use cairn_solve::graph::{GraphConfig, Metric, PoseGraph, Rigid, certify};
use nalgebra::{Matrix3, SVector};

fn minimise<G: Rigid<D>, const D: usize>(graph: &mut PoseGraph<G, D>) -> f64 {
    let config = GraphConfig { metric: Metric::Chordal, tolerance: 1e-14, ..Default::default() };
    2.0 * graph.solve(&config, || false).cost_after
}

#[test]
fn a_global_optimum_is_certified_and_a_twisted_ring_is_not() {
    let n = 24;
    let ring = |turns: f64| {
        let mut graph = PoseGraph::new();
        for k in 0..n {
            let angle = turns * std::f64::consts::TAU * k as f64 / n as f64;
            graph.add_vertex(Se2::from_xy_angle(0.01 * k as f64, 0.0, angle), false);
        }
        for k in 0..n {
            let measured = Se2::from_xy_angle(0.001 * k as f64, 0.002, 0.01 * (k as f64).sin());
            let information = Se2::isotropic(&(Matrix3::identity() * 10.0));
            graph.add_edge(k, (k + 1) % n, measured, &information, Loss::Squared).unwrap();
        }
        graph
    };
    let (mut best, mut twisted) = (ring(0.0), ring(1.0));
    let (lowest, local) = (minimise(&mut best), minimise(&mut twisted));
    assert!(local > 2.0 * lowest, "the ring stays twisted: {local} {lowest}");
    let certificate = certify(&best).unwrap();
    assert!(certificate.gap() < 1e-4, "{certificate:?}");
    let doubt = certify(&twisted).unwrap();
    assert!(doubt.lower_bound <= lowest * (1.0 + 1e-9), "{doubt:?} {lowest}");
    assert!(doubt.gap() > 0.5);
}

#[test]
fn the_objective_is_that_of_the_isotropic_chordal_graph_and_the_bound_holds_away_from_the_optimum() {
    let mut graph = PoseGraph::new();
    let step = |k: usize| {
        let k = k as f64;
        Se3::new(So3::exp(&[0.3 * k.sin(), 0.2, 0.4 * k.cos()].into()), [1.0, 0.1 * k.cos(), 0.2].into())
    };
    let mut pose = Se3::identity();
    for k in 0..15 {
        graph.add_vertex(pose, false);
        pose = pose * step(k);
    }
    let noise = |k: usize| SVector::<f64, 6>::from_fn(|i, _| 0.03 * ((7 * k + 3 * i) as f64).sin());
    for (k, (a, b)) in (0..14).map(|k| (k, k + 1)).chain([(0, 7), (3, 12), (1, 14)]).enumerate() {
        let truth = graph.values()[a].inverse().compose(&graph.values()[b]);
        let information = Se3::isotropic(&nalgebra::SMatrix::from_diagonal_element(100.0));
        graph.add_edge(a, b, truth.retract(&noise(k)), &information, Loss::Squared).unwrap();
    }
    let mut best = graph.clone();
    let lowest = minimise(&mut best);
    let (there, here) = (certify(&best).unwrap(), certify(&graph).unwrap());
    assert!((there.objective / lowest - 1.0).abs() < 1e-9, "{there:?} {lowest}");
    assert!(there.gap() < 1e-6, "{there:?}");
    let cost = 2.0 * graph.cost(Metric::Chordal);
    assert!((here.objective / cost - 1.0).abs() < 1e-9 && here.lower_bound <= lowest * (1.0 + 1e-9));
}
