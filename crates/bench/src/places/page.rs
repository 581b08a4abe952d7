//! Tables of `docs/figures/places.md`.

use super::loops::{self, Gate, Pair, Walk};
use super::recall::{ALIKE_DEG, NEAR_M, PARTED_S, Recall};
use super::times::Times;
use cairn_vision::bow::VocabularyFacts;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// A number of SIFT inliers that no unmarked pair reaches: marked pairs with at least as many overlap enough to be
/// verified at all. See [`overlap`].
pub const ENOUGH: usize = 30;
/// A harder criterion: with this threshold SIFT also accepts pairs that are not marked.
pub const SOME: usize = 20;

/// Inliers found with SIFT features and a fundamental matrix in each pair of the loop matrix
/// (`tools/loops_overlap.py`), keyed by later and earlier photograph, counted from 0.
pub fn overlap() -> BTreeMap<(usize, usize), usize> {
    let lines = include_str!("overlap.txt").lines().filter(|l| !l.starts_with('#'));
    let numbers = lines.map(|l| l.split(' ').filter_map(|n| n.parse().ok()).collect::<Vec<usize>>());
    numbers.filter(|n| n.len() == 3 && n[0] > 0 && n[1] > 0).map(|n| ((n[0] - 1, n[1] - 1), n[2])).collect()
}

/// Accepted pairs compared with the ground truth.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    /// The gate.
    pub gate: Gate,
    /// Pairs accepted.
    pub accepted: usize,
    /// Accepted pairs that are in the matrix.
    pub right: usize,
    /// Accepted pairs that are not in the matrix: later and earlier photograph, counted from 1, and inliers.
    pub wrong: Vec<(usize, usize, usize)>,
    /// Pairs of the matrix.
    pub all: usize,
    /// Pairs of the matrix that overlap enough.
    pub enough: usize,
    /// Pairs with enough overlap that are accepted.
    pub enough_accepted: usize,
    /// Pairs with enough overlap that are among the candidates by words.
    pub enough_candidates: usize,
}

impl Verdict {
    /// Evaluates geometrically verified pairs.
    pub fn of(walk: &Walk, pairs: &[Pair], gate: Gate, enough: usize) -> Self {
        let overlap = overlap();
        let enough: BTreeSet<(usize, usize)> =
            overlap.iter().filter(|(_, n)| **n >= enough).map(|(p, _)| *p).collect();
        let accepted: Vec<&Pair> = pairs.iter().filter(|p| p.accepted(&gate)).collect();
        let overlaps = |p: &&&Pair| enough.contains(&(p.query, p.earlier));
        Self {
            gate,
            accepted: accepted.len(),
            right: accepted.iter().filter(|p| p.truth).count(),
            wrong: accepted
                .iter()
                .filter(|p| !p.truth)
                .map(|p| (p.query + 1, p.earlier + 1, p.inliers))
                .collect(),
            all: walk.true_pairs().len(),
            enough: enough.len(),
            enough_accepted: accepted.iter().filter(overlaps).count(),
            enough_candidates: pairs.iter().filter(|p| enough.contains(&(p.query, p.earlier))).count(),
        }
    }

    /// Share of the accepted pairs that are in the matrix.
    pub fn precision(&self) -> f64 {
        self.right as f64 / self.accepted.max(1) as f64
    }

    /// Share of the pairs with enough overlap that are accepted.
    pub fn recall(&self) -> f64 {
        self.enough_accepted as f64 / self.enough.max(1) as f64
    }
}

/// Recall at 100 % precision, and the mean precision over all recalls, with words alone.
pub fn words_alone(walk: &Walk) -> [f64; 2] {
    let total = walk.true_pairs().len() as f64;
    let (mut right, mut clean, mut area) = (0.0, None, 0.0);
    for (k, (_, truth, _)) in walk.similarities().iter().enumerate() {
        if *truth {
            right += 1.0;
            area += right / (k + 1) as f64;
        } else {
            clean.get_or_insert(right);
        }
    }
    [clean.unwrap_or(right) / total, area / total]
}

/// Everything the tables show.
pub struct Figures<'a> {
    /// The photographs, if available.
    pub walk: Option<&'a Walk>,
    /// Their geometrically verified pairs.
    pub pairs: &'a [Pair],
    /// Recall by ground-truth poses.
    pub recalls: &'a [Recall],
    /// Costs.
    pub times: Option<&'a Times>,
    /// The vocabulary.
    pub facts: &'a VocabularyFacts,
}

/// The tables in Markdown.
pub fn tables(f: &Figures) -> String {
    let mut t = String::new();
    if let Some(walk) = f.walk {
        let [clean, mean] = words_alone(walk);
        let similarities = walk.similarities();
        let share = |below: usize| {
            let found = similarities.iter().filter(|(_, truth, rank)| *truth && *rank < below).count();
            100.0 * found as f64 / walk.true_pairs().len() as f64
        };
        let _ = writeln!(t, "### Photographs of a walk (`loops`)\n");
        let _ = writeln!(
            t,
            "Words alone: recall {:.1} % at 100 % precision, mean precision {:.3}; of the marked pairs {:.1} % are among the top 5 \
             candidates of their query, {:.1} % among the top 10, {:.1} % among the top 20.\n",
            100.0 * clean,
            mean,
            share(5),
            share(10),
            share(20)
        );
        let _ = writeln!(t, "With geometric verification, {} candidates each:\n", loops::CANDIDATES);
        let _ = writeln!(
            t,
            "| minimum inliers | accepted | precision | recall, enough overlap | some overlap | all marked pairs |\n|---|---|---|---|---|---|"
        );
        let chosen = Gate::default();
        for inliers in [20, 30, 40, 50, 55, 60, 80] {
            let v = Verdict::of(walk, f.pairs, Gate { inliers, ..chosen }, ENOUGH);
            let some = Verdict::of(walk, f.pairs, v.gate, SOME);
            let mark = if inliers == chosen.inliers { "**" } else { "" };
            let share =
                |n: usize, of: usize| format!("{:.1} % ({n} of {of})", 100.0 * n as f64 / of.max(1) as f64);
            let _ = writeln!(
                t,
                "| {mark}{inliers}{mark} | {} | {:.1} % | {} | {} | {} |",
                v.accepted,
                100.0 * v.precision(),
                share(v.enough_accepted, v.enough),
                share(some.enough_accepted, some.enough),
                share(v.right, v.all)
            );
        }
        let v = Verdict::of(walk, f.pairs, chosen, ENOUGH);
        let most = |far: usize| {
            let unmarked = f.pairs.iter().filter(|p| !p.truth && walk.steps_from_truth(p) >= far);
            unmarked.map(|p| p.inliers).max().unwrap_or(0)
        };
        let _ = writeln!(
            t,
            "\nAccepted but not marked with at least {} inliers: {}. Most inliers of an unmarked pair: {}; of one at least 7 \
             photographs away from the marked ones: {}.\n",
            chosen.inliers,
            v.wrong.len(),
            most(0),
            most(7)
        );
        let focal: Vec<String> = walk.focals.iter().map(|(s, n)| format!("{s}: {n}")).collect();
        let _ = writeln!(
            t,
            "Focal length as a fraction of the image width, and inlier matches of consecutive photographs with it: {}.\n",
            focal.join(", ")
        );
    }
    if !f.recalls.is_empty() {
        let _ = writeln!(
            t,
            "### Evaluation by ground-truth poses, words alone\n\n| source | views | queries | recall@1 | recall@5 |\n|---|---|---|---|---|"
        );
        for r in f.recalls {
            let _ =
                writeln!(t, "| {} | {} | {} | {:.3} | {:.3} |", r.name, r.views, r.queries, r.at_1, r.at_5);
        }
        let mean = |of: fn(&Recall) -> f64| f.recalls.iter().map(of).sum::<f64>() / f.recalls.len() as f64;
        let _ = writeln!(t, "| mean | | | {:.3} | {:.3} |\n", mean(|r| r.at_1), mean(|r| r.at_5));
        let _ = writeln!(
            t,
            "The same place means: within {NEAR_M} m and {ALIKE_DEG} degrees, at least {PARTED_S} s apart in time.\n"
        );
    }
    if let Some(c) = f.times {
        let _ = writeln!(t, "### Costs\n\n| operation | ms |\n|---|---|");
        for (what, ms) in [
            ("check and open the built-in vocabulary", c.open_ms),
            ("bag of words of 1,000 descriptors", c.bag_ms),
            ("add a key frame to an index of 1,000", c.insert_ms),
            ("query the best ten of 1,000 key frames", c.query_ms),
            ("compare two bags of words", c.similarity_ms),
        ] {
            let _ = writeln!(t, "| {what} | {ms:.3} |");
        }
        let _ = writeln!(t, "\nMinimum of 20 to 100 repetitions, {}.\n", crate::build::measured_on());
    }
    let v = f.facts;
    let _ = writeln!(
        t,
        "Vocabulary: branching {}, depth {}, {} words, indexed at level {}, checksum {:08x}.",
        v.branching, v.depth, v.words, v.index_level, v.checksum
    );
    t
}
