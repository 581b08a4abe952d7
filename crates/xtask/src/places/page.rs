//! `docs/places.md`.

use super::loops::{self, Gate, Pair, Walk};
use super::recall::{ALIKE_DEG, NEAR_M, PARTED_S, Recall};
use super::times::Times;
use cairn_vision::bow::VocabularyFacts;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Inliers of SIFT that no unmarked pair has: a pair of the matrix with as many overlaps enough to be verified at all. See
/// [`overlap`].
pub const ENOUGH: usize = 30;
/// A harder question: with as many, SIFT also takes pairs that are not marked.
pub const SOME: usize = 20;

/// Inliers that SIFT features and a fundamental matrix find in each pair of the loop matrix (`tools/loops_overlap.py`), by
/// later and earlier photograph from 0.
pub fn overlap() -> BTreeMap<(usize, usize), usize> {
    let lines = include_str!("overlap.txt").lines().filter(|l| !l.starts_with('#'));
    let numbers = lines.map(|l| l.split(' ').filter_map(|n| n.parse().ok()).collect::<Vec<usize>>());
    numbers.filter(|n| n.len() == 3 && n[0] > 0 && n[1] > 0).map(|n| ((n[0] - 1, n[1] - 1), n[2])).collect()
}

/// What is accepted and what should be.
#[derive(Clone, Debug, Serialize)]
pub struct Verdict {
    /// The gate.
    pub gate: Gate,
    /// Pairs accepted.
    pub accepted: usize,
    /// Of these, those in the matrix.
    pub right: usize,
    /// Pairs accepted that the matrix does not have: later and earlier, from 1, and inliers.
    pub wrong: Vec<(usize, usize, usize)>,
    /// Pairs of the matrix.
    pub all: usize,
    /// Pairs of the matrix that overlap enough.
    pub enough: usize,
    /// Of these, those accepted.
    pub enough_accepted: usize,
    /// Of these, those that were among the candidates by words.
    pub enough_candidates: usize,
}

impl Verdict {
    /// Judges pairs that geometry looked at.
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

    /// Share of the accepted pairs that the matrix has.
    pub fn precision(&self) -> f64 {
        self.right as f64 / self.accepted.max(1) as f64
    }

    /// Share of the pairs of enough overlap that are accepted.
    pub fn recall(&self) -> f64 {
        self.enough_accepted as f64 / self.enough.max(1) as f64
    }
}

/// Recall at 100 % precision, and the mean precision over all recalls, of the words alone.
pub fn words_alone(walk: &Walk) -> [f64; 2] {
    let total = walk.true_pairs().len() as f64;
    let (mut right, mut clean, mut area) = (0.0, None, 0.0);
    for (k, (_, truth, _)) in walk.likenesses().iter().enumerate() {
        if *truth {
            right += 1.0;
            area += right / (k + 1) as f64;
        } else {
            clean.get_or_insert(right);
        }
    }
    [clean.unwrap_or(right) / total, area / total]
}

/// Everything that is told.
pub struct Figures<'a> {
    /// The photographs, where they are there.
    pub walk: Option<&'a Walk>,
    /// Words and geometry on them.
    pub pairs: &'a [Pair],
    /// By true poses.
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
        let likenesses = walk.likenesses();
        let share = |below: usize| {
            let found = likenesses.iter().filter(|(_, truth, rank)| *truth && *rank < below).count();
            100.0 * found as f64 / walk.true_pairs().len() as f64
        };
        let _ = writeln!(t, "### Photographs of a walk (`loops`)\n");
        let _ = writeln!(
            t,
            "Words alone: recall {:.1} % at 100 % precision, mean precision {:.3}; of the marked pairs {:.1} % are among the first 5 \
             candidates of their query, {:.1} % among the first 10, {:.1} % among the first 20.\n",
            100.0 * clean,
            mean,
            share(5),
            share(10),
            share(20)
        );
        let _ = writeln!(t, "With geometry, {} candidates each:\n", loops::CANDIDATES);
        let _ = writeln!(
            t,
            "| inliers at least | accepted | precision | recall, enough overlap | some overlap | all marked pairs |\n|---|---|---|---|---|---|"
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
            "\nAccepted and not marked at {} inliers: {}. Most inliers of an unmarked pair: {}; of one at least 7 photographs \
             beside the marked ones: {}.\n",
            chosen.inliers,
            v.wrong.len(),
            most(0),
            most(7)
        );
        let focal: Vec<String> = walk.focals.iter().map(|(s, n)| format!("{s}: {n}")).collect();
        let _ = writeln!(
            t,
            "Focal length as a share of the width, and matches of next neighbours that agree under it: {}.\n",
            focal.join(", ")
        );
    }
    if !f.recalls.is_empty() {
        let _ = writeln!(
            t,
            "### By true poses, words alone\n\n| source | views | queries | recall@1 | recall@5 |\n|---|---|---|---|---|"
        );
        for r in f.recalls {
            let _ =
                writeln!(t, "| {} | {} | {} | {:.3} | {:.3} |", r.name, r.views, r.queries, r.at_1, r.at_5);
        }
        let mean = |of: fn(&Recall) -> f64| f.recalls.iter().map(of).sum::<f64>() / f.recalls.len() as f64;
        let _ = writeln!(t, "| mean | | | {:.3} | {:.3} |\n", mean(|r| r.at_1), mean(|r| r.at_5));
        let _ = writeln!(
            t,
            "One place: within {NEAR_M} m and {ALIKE_DEG} degrees, at least {PARTED_S} s apart in time.\n"
        );
    }
    if let Some(c) = f.times {
        let _ = writeln!(t, "### Costs\n\n| what | ms |\n|---|---|");
        for (what, ms) in [
            ("the embedded vocabulary is checked and ready", c.open_ms),
            ("words of 1,000 descriptors", c.bag_ms),
            ("one more key frame for an index of 1,000", c.insert_ms),
            ("the best ten of 1,000 key frames", c.query_ms),
            ("comparison of two bags", c.similarity_ms),
        ] {
            let _ = writeln!(t, "| {what} | {ms:.3} |");
        }
        let cpu = cairn_eval::process::cpu_model().unwrap_or_else(|| "a processor of unknown name".into());
        let _ = writeln!(t, "\nThe least of 20 to 100 repetitions, {cpu}.\n");
    }
    let v = f.facts;
    let _ = writeln!(
        t,
        "Vocabulary: branching {}, depth {}, {} words, matched at level {}, checksum {:08x}.",
        v.branching, v.depth, v.words, v.index_level, v.checksum
    );
    t
}

/// The whole page around the tables.
pub fn page(tables: &str) -> String {
    format!("{}{tables}", include_str!("page.md"))
}
