//! Condensed graphs: what is left after vertices are eliminated says the same about the others.

use cairn_geometry::{LieGroup, Manifold, Se2, Se3, So3};
use cairn_solve::Loss;
use cairn_solve::graph::{
    CondenseError, Condensed, CondensedError, GraphConfig, Method, Metric, PoseGraph, chordal_start,
};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

/// Numbers that look random, in -1 to 1.
fn noise(k: usize) -> f64 {
    let x = ((k as f64 + 1.0) * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

fn noises<const D: usize>(k: usize) -> SVector<f64, D> {
    SVector::from_fn(|i, _| noise(k * D + i))
}

fn information<const D: usize>(k: usize) -> SMatrix<f64, D, D> {
    let m = SMatrix::<f64, D, D>::from_fn(|i, j| noise(1000 + k * D * D + i * D + j));
    m.tr_mul(&m) * 40.0 + SMatrix::<f64, D, D>::identity() * 20.0
}

/// A walk with loops, every measurement a little off, every value a little off the walk.
fn walk<G: LieGroup<D>, const D: usize>(step: G, n: usize, loops: &[(usize, usize)]) -> PoseGraph<G, D> {
    let mut graph = PoseGraph::new();
    let mut truth = vec![G::identity()];
    for k in 1..n {
        truth.push(truth[k - 1].compose(&step.retract(&(noises(k) * 0.2))));
    }
    for (k, pose) in truth.iter().enumerate() {
        graph.add_vertex(pose.retract(&(noises(200 + k) * 0.02)), false);
    }
    let edges = (1..n).map(|k| (k - 1, k)).chain(loops.iter().copied());
    for (k, (a, b)) in edges.enumerate() {
        let measured = truth[a].inverse().compose(&truth[b]).retract(&(noises(400 + k) * 0.02));
        graph.add_edge(a, b, measured, &information(k), Loss::Squared).unwrap();
    }
    graph
}

/// The graph over the kept vertices alone: their edges, and what is left of the others.
fn reduced<G: LieGroup<D>, const D: usize>(graph: &PoseGraph<G, D>, keep: &[bool]) -> PoseGraph<G, D> {
    let mut small = PoseGraph::new();
    let mut to = vec![usize::MAX; keep.len()];
    for k in (0..keep.len()).filter(|k| keep[*k]) {
        to[k] = small.add_vertex(graph.values()[k], false);
    }
    for e in graph.edges().iter().filter(|e| keep[e.a] && keep[e.b]) {
        small.add_edge(to[e.a], to[e.b], e.a_from_b, &e.information, e.loss).unwrap();
    }
    for part in graph.condense(keep, Metric::Geodesic).unwrap() {
        small.add_condensed(part.renamed(&to)).unwrap();
    }
    small
}

fn flags(n: usize, kept: &[usize]) -> Vec<bool> {
    (0..n).map(|k| kept.contains(&k)).collect()
}

fn one_step<G: LieGroup<D>, const D: usize>(graph: &mut PoseGraph<G, D>) {
    let config = GraphConfig { method: Method::GaussNewton, iterations: 1, ..Default::default() };
    graph.solve(&config, || false);
}

fn step_is_the_same<G: LieGroup<D>, const D: usize>(mut graph: PoseGraph<G, D>, kept: &[usize]) {
    let keep = flags(graph.values().len(), kept);
    let mut small = reduced(&graph, &keep);
    assert!(!small.condensed().is_empty());
    one_step(&mut graph);
    one_step(&mut small);
    for (k, v) in kept.iter().enumerate() {
        let off = graph.values()[*v].local(&small.values()[k]).norm();
        assert!(off < 1e-9, "vertex {v} is off by {off}");
    }
}

fn se3_step() -> Se3 {
    Se3::new(So3::exp(&[0.1, -0.2, 0.4].into()), [1.0, 0.3, -0.2].into())
}

#[test]
fn a_gauss_newton_step_of_the_condensed_graph_is_that_of_the_whole_one() {
    let loops = [(0, 9), (3, 14), (5, 18), (2, 11)];
    // A chain with gaps of several lengths; then one where four kept vertices surround one part; and a tail that says nothing.
    step_is_the_same(walk(se3_step(), 20, &[(0, 12)]), &[0, 4, 5, 12, 19]);
    step_is_the_same(walk(se3_step(), 20, &loops), &[0, 9, 14, 18]);
    step_is_the_same(walk(se3_step(), 20, &loops), &[0, 2, 5, 6, 7]);
    step_is_the_same(walk(Se2::from_xy_angle(1.0, 0.2, 0.3), 30, &loops), &[0, 9, 14, 18, 25]);
}

#[test]
fn the_gradient_is_the_slope_of_the_cost_also_far_from_where_it_was_linearised() {
    let graph = walk(se3_step(), 16, &[(0, 9), (3, 14), (5, 12)]);
    let mut small = reduced(&graph, &flags(16, &[0, 5, 9, 14]));
    for (k, v) in small.values_mut().iter_mut().enumerate() {
        *v = v.retract(&(noises(700 + k) * 0.5));
    }
    let slope = small.gradient(Metric::Geodesic);
    let start = small.values().to_vec();
    for v in 1..start.len() {
        for d in 0..6 {
            let mut at = |h: f64| {
                small.values_mut()[v] = start[v].retract(&(SVector::<f64, 6>::ith(d, h)));
                let cost = small.cost(Metric::Geodesic);
                small.values_mut()[v] = start[v];
                cost
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            let scale = 1.0 + slope[v].norm();
            assert!((numeric - slope[v][d]).abs() < 1e-6 * scale, "{v} {d}: {numeric} {}", slope[v][d]);
        }
    }
}

#[test]
fn the_cost_does_not_change_when_everything_moves_as_one() {
    let graph = walk(se3_step(), 16, &[(0, 9), (3, 14)]);
    let mut small = reduced(&graph, &flags(16, &[0, 5, 9, 14]));
    let before = small.cost(Metric::Geodesic);
    let moved = Se3::new(So3::exp(&[2.0, -1.0, 0.7].into()), [50.0, -20.0, 7.0].into());
    small.values_mut().iter_mut().for_each(|v| *v = moved * *v);
    let after = small.cost(Metric::Geodesic);
    assert!(before > 0.1 && (before - after).abs() < 1e-9 * before, "{before} {after}");
}

#[test]
fn the_covariance_of_a_condensed_graph_is_that_of_the_whole_one() {
    let graph = walk(se3_step(), 12, &[(0, 9), (3, 11)]);
    let kept = [0, 5, 9, 11];
    let small = reduced(&graph, &flags(12, &kept));
    let whole = graph.covariance(&kept, Metric::Geodesic).unwrap();
    let part = small.covariance(&[0, 1, 2, 3], Metric::Geodesic).unwrap();
    assert!(whole.amax() > 1e-3 && (&whole - part).amax() < 1e-9 * whole.amax());
    assert_eq!(whole.view((0, 0), (6, 24)).amax(), 0.0, "the first vertex is held");
    // One edge: the covariance of its end is that of the measurement.
    let mut edge = PoseGraph::new();
    edge.add_vertex(Se3::identity(), false);
    edge.add_vertex(se3_step(), false);
    edge.add_edge(0, 1, se3_step(), &information(3), Loss::Squared).unwrap();
    let found = edge.covariance(&[1], Metric::Geodesic).unwrap();
    assert!((found * information::<6>(3) - DMatrix::<f64>::identity(6, 6)).amax() < 1e-9);
}

#[test]
fn the_chordal_start_sees_condensed_parts() {
    let graph = walk(se3_step(), 16, &[(0, 9), (3, 14)]);
    let mut small = reduced(&graph, &flags(16, &[0, 5, 9, 14]));
    let before = small.values().to_vec();
    small.values_mut()[1..].fill(Se3::identity());
    chordal_start(&mut small).unwrap();
    for (was, now) in before.iter().zip(small.values()) {
        assert!(was.local(now).norm() < 0.3, "{was:?} {now:?}");
    }
}

#[test]
fn what_cannot_be_condensed_or_added_is_refused() {
    let mut graph = walk(se3_step(), 6, &[]);
    let keep = flags(6, &[0, 3]);
    let parts = graph.condense(&keep, Metric::Geodesic).unwrap();
    assert_eq!(parts.len(), 1, "the tail after vertex 3 says nothing");
    let index = graph.add_condensed(parts[0].clone()).unwrap();
    assert_eq!((index, graph.condensed().len()), (0, 1));
    assert_eq!(graph.condense(&flags(6, &[0, 5]), Metric::Geodesic), Err(CondenseError::Nested(3)));
    let mut other = PoseGraph::new();
    other.add_vertex(Se3::identity(), false);
    assert_eq!(other.add_condensed(parts[0].clone()), Err(CondensedError::NoVertex(3)));
    let again = parts[0].clone().renamed(&[0, 0, 0, 0]);
    assert_eq!(other.add_condensed(again), Err(CondensedError::Twice(0)));
    let bad = |n, z| {
        let poses = vec![Se3::identity()];
        Condensed::new(vec![0, 1], poses, DMatrix::identity(n, n), DVector::from_element(6, z)).err()
    };
    assert_eq!(bad(6, 0.0), None);
    assert_eq!(bad(5, 0.0), Some(CondensedError::Size));
    assert_eq!(bad(6, f64::NAN), Some(CondensedError::NotFinite));
    let mut loose = PoseGraph::new();
    for _ in 0..3 {
        loose.add_vertex(Se3::identity(), false);
    }
    let weak = SMatrix::<f64, 6, 6>::from_diagonal(&[1.0, 1.0, 1.0, 0.0, 0.0, 0.0].into());
    loose.add_edge(0, 1, Se3::identity(), &weak, Loss::Squared).unwrap();
    loose.add_edge(1, 2, Se3::identity(), &weak, Loss::Squared).unwrap();
    let refused = loose.condense(&flags(3, &[0, 2]), Metric::Geodesic);
    assert_eq!(refused, Err(CondenseError::Undetermined(1)));
}
