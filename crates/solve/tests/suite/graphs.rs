//! Random graphs of every group: truth is recovered, gradients are those of the cost, cancelling leaves a valid state.

use cairn_geometry::{LieGroup, Manifold, Se2, Se3, Sim3, So2, So3, Vec3, YawPose};
use cairn_random::Random;
use cairn_solve::graph::{
    GraphConfig, Method, Metric, PoseGraph, Rigid, Start, chordal_start, lowest_start, odometry_start,
};
use cairn_solve::{Loss, Stop};
use nalgebra::{SMatrix, SVector};
use proptest::prelude::*;

/// Numbers between -1 and 1.
struct Dice(Random);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0.uniform(-1.0, 1.0)
    }
    fn vec3(&mut self, scale: f64) -> Vec3 {
        Vec3::new(self.roll(), self.roll(), self.roll()) * scale
    }
}

/// A group with elements to draw.
trait Drawn<const D: usize>: LieGroup<D> + std::fmt::Debug {
    /// A step of about a metre with a turn of up to about half a radian.
    fn draw(dice: &mut Dice) -> Self;
}

impl Drawn<3> for Se2 {
    fn draw(dice: &mut Dice) -> Self {
        Se2::from_xy_angle(1.0, 0.2 * dice.roll(), 0.5 * dice.roll())
    }
}

impl Drawn<4> for YawPose {
    fn draw(dice: &mut Dice) -> Self {
        YawPose::new(So2::exp(0.5 * dice.roll()), Vec3::x() + dice.vec3(0.2))
    }
}

impl Drawn<6> for Se3 {
    fn draw(dice: &mut Dice) -> Self {
        Se3::new(So3::exp(&dice.vec3(0.4)), Vec3::x() + dice.vec3(0.2))
    }
}

impl Drawn<7> for Sim3 {
    fn draw(dice: &mut Dice) -> Self {
        let t = Se3::draw(dice);
        Sim3::new(t.rotation, t.translation, (0.1 * dice.roll()).exp())
    }
}

fn information<const D: usize>(dice: &mut Dice) -> SMatrix<f64, D, D> {
    let root = SMatrix::<f64, D, D>::from_fn(|r, c| if r == c { 4.0 } else { dice.roll() });
    root.tr_mul(&root) * 10.0
}

/// A walk of `n` poses with its true values: exact edges along it and `n` jumps between any two.
fn walk<G: Drawn<D>, const D: usize>(seed: u64, n: usize, noise: f64) -> (PoseGraph<G, D>, Vec<G>) {
    let mut dice = Dice(Random::new(seed));
    let mut truth = vec![G::draw(&mut dice)];
    for k in 1..n {
        truth.push(truth[k - 1].compose(&G::draw(&mut dice)));
    }
    let mut graph = PoseGraph::new();
    for (k, value) in truth.iter().enumerate() {
        let shake = SVector::<f64, D>::from_fn(|_, _| noise * dice.roll());
        graph.add_vertex(if k == 0 { *value } else { value.retract(&shake) }, k == 0);
    }
    let mut pairs: Vec<(usize, usize)> = (1..n).map(|k| (k - 1, k)).collect();
    let pick = |v: f64| (((v + 1.0) / 2.0 * n as f64) as usize).min(n - 1);
    for _ in 0..n {
        let (a, b) = (pick(dice.roll()), pick(dice.roll()));
        if a != b {
            pairs.push((a, b));
        }
    }
    for (a, b) in pairs {
        let information = information(&mut dice);
        let a_from_b = truth[a].inverse().compose(&truth[b]);
        graph.add_edge(a, b, a_from_b, &information, Loss::Squared).expect("a proper edge");
    }
    (graph, truth)
}

fn largest_error<G: LieGroup<D>, const D: usize>(graph: &[G], truth: &[G]) -> f64 {
    graph.iter().zip(truth).map(|(v, t)| v.local(t).norm()).fold(0.0, f64::max)
}

fn recovers<G: Drawn<D>, const D: usize>(seed: u64, n: usize) -> Result<(), TestCaseError> {
    for method in [Method::GaussNewton, Method::LevenbergMarquardt] {
        for metric in [Metric::Geodesic, Metric::Chordal] {
            let (mut graph, truth) = walk::<G, D>(seed, n, 0.1);
            let config = GraphConfig { method, metric, ..GraphConfig::default() };
            let report = graph.solve(&config, || false);
            prop_assert_eq!(report.stop, Stop::Converged, "{:?} {:?}: {:?}", method, metric, report);
            prop_assert!(largest_error(graph.values(), &truth) < 1e-6, "{method:?} {metric:?}: {report:?}");
            prop_assert_eq!(report.inliers, graph.edges().len());
        }
    }
    Ok(())
}

/// The steepest way down that a solve takes (damped without end it is the gradient) is that of the cost by differences.
fn descends<G: Drawn<D>, const D: usize>(seed: u64) -> Result<(), TestCaseError> {
    for (metric, loss) in [
        (Metric::Geodesic, Loss::Squared),
        (Metric::Chordal, Loss::Squared),
        (Metric::Geodesic, Loss::Huber(1.0)),
        (Metric::Chordal, Loss::Cauchy(1.0)),
    ] {
        let (mut graph, _) = walk::<G, D>(seed, 6, 0.2);
        graph.edges_mut().iter_mut().for_each(|e| e.loss = loss);
        let gradient = graph.gradient(metric);
        for (i, analytic) in gradient.iter().enumerate().skip(1) {
            for k in 0..D {
                let value = graph.values()[i];
                let mut cost = |h: f64| {
                    let mut d = SVector::<f64, D>::zeros();
                    d[k] = h;
                    graph.values_mut()[i] = value.retract(&d);
                    graph.cost(metric)
                };
                let numeric = (cost(1e-6) - cost(-1e-6)) / 2e-6;
                graph.values_mut()[i] = value;
                let slack = 1e-5 * (1.0 + analytic.norm());
                prop_assert!(
                    (analytic[k] - numeric).abs() < slack,
                    "{metric:?} {loss:?}: {} {numeric}",
                    analytic[k]
                );
            }
        }
    }
    Ok(())
}

fn starts_anywhere<G: Drawn<D> + Rigid<D>, const D: usize>(seed: u64) -> Result<(), TestCaseError> {
    // Exact measurements: both starts are the truth, wherever the values stood.
    let (graph, truth) = walk::<G, D>(seed, 40, 2.0);
    let (mut chained, mut relaxed) = (graph.clone(), graph);
    odometry_start(&mut chained);
    prop_assert!(largest_error(chained.values(), &truth) < 1e-9);
    prop_assert!(chordal_start(&mut relaxed).is_ok());
    prop_assert!(largest_error(relaxed.values(), &truth) < 1e-6);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn truth_is_recovered_in_the_plane(seed: u64, n in 2..60usize) { recovers::<Se2, 3>(seed, n)?; }
    #[test]
    fn truth_is_recovered_with_gravity(seed: u64, n in 2..60usize) { recovers::<YawPose, 4>(seed, n)?; }
    #[test]
    fn truth_is_recovered_in_space(seed: u64, n in 2..60usize) { recovers::<Se3, 6>(seed, n)?; }
    #[test]
    fn truth_is_recovered_with_scale(seed: u64, n in 2..60usize) { recovers::<Sim3, 7>(seed, n)?; }

    #[test]
    fn gradients_are_those_of_the_cost(seed: u64) {
        descends::<Se2, 3>(seed)?;
        descends::<YawPose, 4>(seed)?;
        descends::<Se3, 6>(seed)?;
        descends::<Sim3, 7>(seed)?;
    }

    #[test]
    fn starts_need_no_start(seed: u64) {
        starts_anywhere::<Se2, 3>(seed)?;
        starts_anywhere::<Se3, 6>(seed)?;
    }

    #[test]
    fn cancelling_leaves_a_valid_state(seed: u64, after in 0..12usize, newton: bool) {
        let (mut graph, _) = walk::<Se3, 6>(seed, 40, 0.6);
        graph.edges_mut().iter_mut().for_each(|e| e.a_from_b.translation.y += 0.05);
        let method = if newton { Method::GaussNewton } else { Method::LevenbergMarquardt };
        let before = graph.cost(Metric::Geodesic);
        let mut asked = 0;
        let report = graph.solve(&GraphConfig { method, ..GraphConfig::default() }, || {
            asked += 1;
            asked > after
        });
        prop_assert!(report.iterations <= after);
        prop_assert!(graph.values().iter().all(|v| v.is_finite()));
        prop_assert!(report.cost_after <= before);
        let left = graph.cost(Metric::Geodesic);
        prop_assert!((left - report.cost_after).abs() <= 1e-9 * left, "{left} {report:?}");
    }

    #[test]
    fn the_same_bits_every_time(seed: u64) {
        let run = || {
            let (mut graph, _) = walk::<Se3, 6>(seed, 50, 0.3);
            graph.solve(&GraphConfig::default(), || false);
            graph.values().to_vec()
        };
        prop_assert_eq!(run(), run());
    }
}

#[test]
fn fixed_vertices_stay_and_components_have_an_anchor_each() {
    let (mut graph, truth) = walk::<Se3, 6>(7, 20, 0.1);
    // A second walk that nothing ties to the first, and one vertex alone.
    let (first, second) = (graph.add_vertex(truth[3], false), graph.add_vertex(truth[4], false));
    let alone = graph.add_vertex(truth[5], false);
    let off = Se3::new(So3::exp(&Vec3::new(0.0, 0.1, 0.0)), Vec3::new(1.0, 2.0, 3.0));
    graph.add_edge(second, first, off, &SMatrix::identity(), Loss::Squared).expect("a proper edge");
    let before = graph.values().to_vec();
    let report = graph.solve(&GraphConfig::default(), || false);
    assert_eq!(report.stop, Stop::Converged);
    for still in [0, first, alone] {
        assert_eq!(graph.values()[still], before[still]);
    }
    let expected = before[first].compose(&off.inverse());
    assert!(graph.values()[second].local(&expected).norm() < 1e-6);
}

#[test]
fn a_robust_loss_lets_a_false_loop_go() {
    let (mut graph, truth) = walk::<Se3, 6>(11, 60, 0.05);
    let lie = Se3::new(So3::identity(), Vec3::new(5.0, 5.0, 0.0));
    graph.add_edge(3, 50, lie, &(SMatrix::identity() * 100.0), Loss::Squared).expect("a proper edge");
    let mut plain = graph.clone();
    plain.solve(&GraphConfig::default(), || false);
    graph.edges_mut().iter_mut().for_each(|e| e.loss = Loss::Cauchy(1.0));
    let report = graph.solve(&GraphConfig::default(), || false);
    let (robust, plain) = (largest_error(graph.values(), &truth), largest_error(plain.values(), &truth));
    assert!(robust < 0.02 && plain > 5.0 * robust, "{robust} {plain} {report:?}");
    assert_eq!(report.inliers, graph.edges().len() - 1);
}

#[test]
fn what_makes_no_sense_is_refused() {
    use cairn_solve::graph::EdgeError;
    let mut graph = PoseGraph::<Se3, 6>::new();
    assert_eq!(graph.solve(&GraphConfig::default(), || false).stop, Stop::Empty);
    let a = graph.add_vertex(Se3::identity(), false);
    let b = graph.add_vertex(Se3::identity(), false);
    let one = SMatrix::<f64, 6, 6>::identity();
    let mut add = |b, t: Se3, information, loss| graph.add_edge(a, b, t, &information, loss);
    let at = |x| Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0));
    assert_eq!(add(7, at(0.0), one, Loss::Squared), Err(EdgeError::NoVertex(7)));
    assert_eq!(add(a, at(0.0), one, Loss::Squared), Err(EdgeError::Loop(a)));
    assert_eq!(add(b, at(f64::NAN), one, Loss::Squared), Err(EdgeError::Measurement));
    assert_eq!(add(b, at(0.0), -one, Loss::Squared), Err(EdgeError::Information));
    assert_eq!(add(b, at(0.0), one * f64::NAN, Loss::Squared), Err(EdgeError::Information));
    assert_eq!(add(b, at(0.0), one, Loss::Huber(0.0)), Err(EdgeError::Width));
    // No information at all connects nothing: each vertex is a part of its own, and stays.
    assert!(add(b, at(1.0), one * 0.0, Loss::Squared).is_ok());
    let config = GraphConfig { method: Method::GaussNewton, ..GraphConfig::default() };
    assert_eq!((graph.components(), graph.solve(&config, || false).stop), (vec![a, b], Stop::Empty));
    assert!(chordal_start(&mut graph).is_ok());
    // Information along x alone: the system is singular, which is told.
    let along_x = SMatrix::<f64, 6, 6>::from_diagonal(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0].into());
    assert!(graph.add_edge(a, b, at(1.0), &along_x, Loss::Squared).is_ok());
    assert_eq!(graph.solve(&config, || false).stop, Stop::NoDescent);
    assert!(chordal_start(&mut graph).is_err());
}

#[test]
fn lowest_start_is_the_cheapest_and_the_graph_is_there() {
    // Values far off: the measurements alone are exact.
    let (mut graph, truth) = walk::<Se3, 6>(5, 30, 1.0);
    let own = graph.cost(Metric::Geodesic);
    let starts = lowest_start(&mut graph, true, Metric::Geodesic);
    assert_eq!(starts.len(), 3);
    assert!(starts.windows(2).all(|w| w[0].cost <= w[1].cost) && starts[2].cost == own, "{starts:?}");
    assert_eq!(starts[2].start, Start::Values);
    assert_eq!(graph.cost(Metric::Geodesic), starts[0].cost);
    assert!(largest_error(graph.values(), &truth) < 1e-6);
    // Already solved: its own values are the best, and without them they are not asked for.
    graph.values_mut().copy_from_slice(&truth);
    let (before, with) = (graph.clone(), lowest_start(&mut graph, true, Metric::Geodesic));
    assert!(with[0].cost <= before.cost(Metric::Geodesic) + 1e-12);
    let without = lowest_start(&mut graph, false, Metric::Geodesic);
    assert!(without.len() == 2 && without.iter().all(|s| s.start != Start::Values));
}
