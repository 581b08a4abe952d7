//! The sparse Cholesky of `cairn-solve` beside faer's (MIT) on the patterns it is used for, symbolic part reused, one
//! thread: `cargo run --release --manifest-path tools/compare_cholesky/Cargo.toml [GRAPH.g2o ...]`. Prints the least
//! time of repetitions that alternate between the two, and the largest difference of their solutions.

use cairn_solve::g2o::{Graph, read};
use cairn_solve::sparse::{Analysis, Factor, UniformBlocks};
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Par, Side};
use std::sync::Arc;
use std::time::Instant;

const REPETITIONS: usize = 40;

fn main() {
    faer::set_global_parallelism(Par::Seq);
    println!(
        "| system | unknowns | factor ours / faer ms | solve ours / faer ms | analysis ours / faer ms | difference |"
    );
    println!("|---|---|---|---|---|---|");
    for path in std::env::args().skip(1) {
        let text = std::fs::read_to_string(&path).expect("a g2o file");
        let edges = |ends: Vec<(usize, usize)>| {
            ends.into_iter().filter_map(|(a, b)| Some((a.checked_sub(1)?, b.checked_sub(1)?)))
        };
        let name = path.rsplit('/').next().unwrap_or(&path).to_owned();
        match read(&text).expect("a g2o file").graph {
            Graph::Plane(g) => {
                let ends = g.graph.edges().iter().map(|e| (e.a, e.b)).collect();
                compare(&name, g.ids.len() - 1, 3, edges(ends));
            }
            Graph::Space(g) => {
                let ends = g.graph.edges().iter().map(|e| (e.a, e.b)).collect();
                compare(&name, g.ids.len() - 1, 6, edges(ends));
            }
        }
    }
    for (n, near, again) in [(40, 16, 0), (500, 20, 20), (2000, 20, 20)] {
        // Key frames share points with neighbours along the way, and with those of the lap before.
        let lap = n / 2;
        let along = (0..n).flat_map(|i| (1..=near).map(move |k| (i, i + k)));
        let back = (0..n).flat_map(|i| (0..again).map(move |k| (i, i + lap + k)));
        let pairs: Vec<_> = along.chain(back).filter(|(_, b)| *b < n).collect();
        compare(&format!("reduced camera system of {n} key frames"), n, 6, pairs.into_iter());
    }
}

fn compare(name: &str, n: usize, d: usize, pairs: impl Iterator<Item = (usize, usize)>) {
    let pairs: Vec<(usize, usize)> = pairs.collect();
    let analysis = Arc::new(Analysis::new(n, d, pairs.iter().copied()));
    let off: Vec<f64> = (0..analysis.pairs().len() * d * d).map(|k| (k as f64 * 0.37).sin()).collect();
    let mut diagonal = vec![0.0; n * d * d];
    let mut sums = vec![1.0; n * d];
    for (k, (a, b)) in analysis.pairs().iter().enumerate() {
        for (at, v) in off[k * d * d..(k + 1) * d * d].iter().enumerate() {
            sums[*a as usize * d + at % d] += v.abs();
            sums[*b as usize * d + at / d] += v.abs();
        }
    }
    (0..n * d).for_each(|i| diagonal[i / d * d * d + i % d * d + i % d] = sums[i]);
    let mut entries: Vec<Triplet<usize, usize, f64>> = Vec::new();
    for i in 0..n * d {
        entries.push(Triplet::new(i, i, sums[i]));
    }
    // The rest of a diagonal block is stored, as it is in a real system.
    for i in 0..n {
        for c in 0..d {
            entries.extend((c + 1..d).map(|r| Triplet::new(i * d + r, i * d + c, 0.0)));
        }
    }
    for (k, (a, b)) in analysis.pairs().iter().enumerate() {
        for (at, v) in off[k * d * d..(k + 1) * d * d].iter().enumerate() {
            entries.push(Triplet::new(*a as usize * d + at % d, *b as usize * d + at / d, *v));
        }
    }
    let matrix = SparseColMat::try_new_from_triplets(n * d, n * d, &entries).expect("indices in range");
    let right: Vec<f64> = (0..n * d).map(|i| (i as f64 * 0.11).cos()).collect();
    let column = Mat::from_fn(n * d, 1, |i, _| right[i]);

    let blocks = UniformBlocks { size: d, diagonal: &diagonal, off_diagonal: &off };
    let mut ours = Factor::new(Arc::clone(&analysis));
    let symbolic = SymbolicLlt::try_new(matrix.symbolic(), Side::Lower).expect("a pattern");
    let mut least = [f64::INFINITY; 6];
    let mut time = |slot: usize, run: &mut dyn FnMut()| {
        let from = Instant::now();
        run();
        least[slot] = least[slot].min(from.elapsed().as_secs_f64() * 1e3);
    };
    let (mut x, mut y) = (right.clone(), column.clone());
    for _ in 0..REPETITIONS {
        time(0, &mut || ours.factor(&blocks).expect("dominant"));
        let mut theirs = None;
        time(1, &mut || {
            theirs = Some(
                Llt::try_new_with_symbolic(symbolic.clone(), matrix.as_ref(), Side::Lower).expect("dominant"),
            );
        });
        let theirs = theirs.expect("a factor");
        x.copy_from_slice(&right);
        time(2, &mut || ours.solve(&mut x));
        time(3, &mut || y = theirs.solve(&column));
        time(4, &mut || drop(Analysis::new(n, d, pairs.iter().copied())));
        time(5, &mut || drop(SymbolicLlt::try_new(matrix.symbolic(), Side::Lower)));
    }
    let difference = (0..n * d).map(|i| (x[i] - y[(i, 0)]).abs()).fold(0.0, f64::max);
    let [a, b, c, e, f, g] = least;
    println!(
        "| {name} | {} | {a:.2} / {b:.2} | {c:.2} / {e:.2} | {f:.2} / {g:.2} | {difference:.0e} |",
        n * d
    );
}
