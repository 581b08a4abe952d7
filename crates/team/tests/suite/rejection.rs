//! Loops that are wrong by construction, among robots with known ground truth: none of them is accepted.

use cairn_geometry::{LieGroup, Manifold, Se3, So3};
use cairn_random::Random;
use cairn_solve::Loss;
use cairn_solve::graph::PoseGraph;
use cairn_team::{Exchange, JudgeConfig, LoopId, Measurement, NetworkConfig, PoseId, RobotGraph, RobotId};
use nalgebra::{SMatrix, SVector};
use std::collections::{BTreeMap, BTreeSet};

/// Noise of a measurement.
fn noise(dice: &mut Random) -> SVector<f64, 6> {
    SVector::from_fn(|k, _| dice.standard_normal() * if k < 3 { 0.05 } else { 0.01 })
}

fn information() -> SMatrix<f64, 6, 6> {
    SMatrix::from_diagonal(&[400.0, 400.0, 400.0, 1e4, 1e4, 1e4].into())
}

const STEPS: usize = 120;

/// Kind of the wrong loops.
#[derive(Clone, Copy, Debug)]
enum Wrong {
    /// Each one has another error.
    Scattered,
    /// Several consecutive ones have the same error, as between two corridors that look the same.
    Alike,
}

/// Robots that walk around in one hall, each in its own frame, with loops where they come near each other; a fraction
/// of all loops is wrong. Returns the graphs and the wrong loops.
fn team(
    robots: usize,
    wrong: f64,
    kind: Wrong,
    shares: bool,
    seed: u64,
) -> (Vec<RobotGraph<Se3, 6>>, BTreeSet<LoopId>) {
    let mut dice = Random::new(seed);
    let mut ways: Vec<Vec<Se3>> = Vec::new();
    for r in 0..robots {
        let mut way = vec![Se3::new(So3::exp(&[0.0, 0.0, r as f64].into()), [r as f64, 0.0, 0.0].into())];
        for k in 1..STEPS {
            let turn = 0.3 * (k as f64 * 0.11 + r as f64).sin() + 0.1 * dice.standard_normal();
            let step = Se3::new(
                So3::exp(&[0.0, 0.0, turn].into()),
                [0.5, 0.0, 0.02 * dice.standard_normal()].into(),
            );
            way.push(way[k - 1] * step);
        }
        ways.push(way);
    }
    let id = |r: usize, k: usize| PoseId { robot: r as RobotId, seq: k as u32 };
    let mut graphs: Vec<RobotGraph<Se3, 6>> = (0..robots)
        .map(|r| RobotGraph { robot: r as RobotId, poses: BTreeMap::new(), measurements: Vec::new() })
        .collect();
    for (r, way) in ways.iter().enumerate() {
        let mut pose = Se3::identity();
        graphs[r].poses.insert(0, pose);
        for k in 1..STEPS {
            let a_from_b = (way[k - 1].inverse() * way[k]).retract(&noise(&mut dice));
            pose = pose * a_from_b;
            graphs[r].poses.insert(k as u32, pose);
            let (a, b) = (id(r, k - 1), id(r, k));
            graphs[r].measurements.push(Measurement { a, b, a_from_b, information: information() });
        }
    }
    let mut false_ones = BTreeSet::new();
    for r in 0..robots {
        for s in 0..r {
            let mut seen = BTreeSet::new();
            let right = if shares { 14 } else { 0 };
            for _ in 0..right {
                let (a, b) = (dice.below(STEPS), dice.below(STEPS));
                let measured = (ways[s][a].inverse() * ways[r][b]).retract(&noise(&mut dice));
                if seen.insert((a, b)) {
                    add(&mut graphs, id(s, a), id(r, b), measured);
                }
            }
            let count = if shares { (14.0 * wrong / (1.0 - wrong)).round() as usize } else { 14 };
            let mut left = count;
            while left > 0 {
                let (a, b) = (dice.below(STEPS - 8), dice.below(STEPS - 8));
                let offset = Se3::new(
                    So3::exp(
                        &[dice.standard_normal(), dice.standard_normal(), 2.0 * dice.standard_normal()]
                            .into(),
                    ),
                    [6.0 * dice.standard_normal(), 6.0 * dice.standard_normal(), dice.standard_normal()]
                        .into(),
                );
                let run = match kind {
                    Wrong::Scattered => 1,
                    Wrong::Alike => left.min(4),
                };
                for k in 0..run {
                    // What would be measured if the second robot were somewhere else.
                    let there = ways[s][a].compose(&offset) * ways[r][b].inverse();
                    let measured =
                        (ways[s][a + k].inverse() * there * ways[r][b + k]).retract(&noise(&mut dice));
                    if seen.insert((a + k, b + k)) {
                        add(&mut graphs, id(s, a + k), id(r, b + k), measured);
                        false_ones.insert((id(s, a + k), id(r, b + k)));
                    }
                }
                left -= run;
            }
        }
    }
    (graphs, false_ones)
}

fn add(graphs: &mut [RobotGraph<Se3, 6>], a: PoseId, b: PoseId, a_from_b: Se3) {
    let m = Measurement { a, b, a_from_b, information: information() };
    graphs[usize::from(a.robot)].measurements.push(m.clone());
    graphs[usize::from(b.robot)].measurements.push(m);
}

fn judged(graphs: &[RobotGraph<Se3, 6>]) -> Exchange<Se3, 6> {
    let mut exchange = Exchange::new(graphs, NetworkConfig::PERFECT, Some(JudgeConfig::default())).unwrap();
    (0..2).for_each(|_| drop(exchange.round(|| 0.0).unwrap()));
    exchange
}

#[test]
fn none_of_the_wrong_loops_is_believed_and_most_right_ones_are() {
    for wrong in [0.3, 0.6] {
        for kind in [Wrong::Scattered, Wrong::Alike] {
            let (mut believed, mut kept, mut right) = (0, 0, 0);
            for seed in 1..=3 {
                let (graphs, false_ones) = team(4, wrong, kind, true, seed);
                let exchange = judged(&graphs);
                let rejected = exchange.rejected();
                believed += false_ones.difference(&rejected).count();
                let loops = exchange.central_graph().loops.iter().flatten().count();
                right += loops - false_ones.len();
                kept += loops - rejected.union(&false_ones).count();
            }
            println!("{wrong} {kind:?}: believed {believed} wrong ones, kept {kept} of {right} right ones");
            assert_eq!(believed, 0, "{wrong} {kind:?}");
            assert!(kept as f64 > 0.9 * right as f64, "{wrong} {kind:?}: kept {kept} of {right}");
        }
    }
}

#[test]
fn robots_that_share_nothing_are_not_joined() {
    for seed in 1..=10 {
        let (graphs, false_ones) = team(3, 1.0, Wrong::Scattered, false, seed);
        let exchange = judged(&graphs);
        assert_eq!(exchange.rejected(), false_ones, "seed {seed}");
    }
}

#[test]
fn without_a_judge_everything_is_believed() {
    let (graphs, false_ones) = team(3, 0.3, Wrong::Scattered, true, 1);
    let mut exchange = Exchange::new(&graphs, NetworkConfig::PERFECT, None).unwrap();
    exchange.round(|| 0.0).unwrap();
    assert!(!false_ones.is_empty() && exchange.rejected().is_empty());
}

#[test]
fn one_loop_alone_joins_nobody() {
    let mut graph = PoseGraph::new();
    for k in 0..20 {
        graph.add_vertex(Se3::new(So3::identity(), [f64::from(k), 0.0, 0.0].into()), false);
    }
    for k in 0..19 {
        let step = Se3::new(So3::identity(), [1.0, 0.0, 0.0].into());
        graph.add_edge(k, k + 1, step, &information(), Loss::Squared).unwrap();
    }
    let graphs = cairn_team::split(&graph, 2).unwrap();
    assert_eq!(judged(&graphs).rejected().len(), 1);
}
