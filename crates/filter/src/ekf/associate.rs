//! Data association: which landmark a sighting without a label belongs to.
//!
//! Nearest neighbour: by the likelihood of the innovation, with each landmark used at most once (Bar-Shalom, Li,
//! Kirubarajan 2001).
//! Joint compatibility branch and bound: Neira and Tardos, "Data association in stochastic mapping using the joint
//! compatibility test", IEEE TRA 17(6), 2001. The same search lists all likely pairings of an instant, for `hypotheses`.

use super::active::Active;
use super::config::Association;
use super::landmark::{LandmarkId, Verdict};
use super::state::EkfSlam;
use crate::chi2;
use crate::covariance::Rows;
use crate::log::{Sighting, Target};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::TAU;

/// Greatest number of pairings tried in one search; then the best one so far is used.
const MOST_PAIRINGS: usize = 20_000;

/// A landmark that a sighting might belong to.
#[derive(Clone, Debug)]
struct Candidate {
    id: LandmarkId,
    h: Rows,
    innovation: Vector3<f64>,
    noise: Matrix3<f64>,
    nis: f64,
    /// Negative log likelihood times two, up to a constant.
    cost: f64,
}

/// The sightings of an instant without labels, and what each might be.
#[derive(Clone, Debug)]
pub(super) struct Unlabelled {
    /// Those that can be used, by their index in the list.
    usable: Vec<usize>,
    /// For each of these the landmarks within the gate, by number.
    within: Vec<Vec<Candidate>>,
    /// For each of these the normalised innovation squared of the nearest landmark, with its bound for a new landmark.
    nearest: Vec<Option<(f64, f64)>>,
    /// Minus twice the logarithm of the density of each where it is of no landmark that is known.
    unknown: Vec<f64>,
}

/// Which landmark each sighting is of.
#[derive(Clone, Debug)]
pub(super) struct Pairing {
    /// Indices into [`Unlabelled`].
    pub chosen: Vec<Option<usize>>,
    /// Minus twice the logarithm of its likelihood.
    pub cost: f64,
    /// The same with each sighting counted by its weight.
    pub counted: f64,
}

impl EkfSlam {
    pub(super) fn observe_unlabelled(&mut self, robot: usize, sightings: &[Sighting]) -> Vec<Verdict> {
        let seen = self.unlabelled(robot, sightings);
        let chosen = match self.config.association {
            Association::Nearest => nearest(&seen.within),
            _ => Search::new(&self.active, &seen, self.config.gate_probability).run(),
        };
        self.pair(robot, sightings, &seen, &chosen)
    }

    /// What the sightings of an instant might be.
    pub(super) fn unlabelled(&self, robot: usize, sightings: &[Sighting]) -> Unlabelled {
        let is_landmark = |s: &Sighting| !matches!(s.target, Target::Robot(_)) && self.within_reach(s);
        let usable: Vec<usize> = (0..sightings.len()).filter(|k| is_landmark(&sightings[*k])).collect();
        let (mut within, mut nearest, mut unknown) = (Vec::new(), Vec::new(), Vec::new());
        let mut reach = self.reach;
        sightings.iter().for_each(|s| reach.learn(s));
        for k in &usable {
            let mut candidates = self.candidates(robot, &sightings[*k]);
            let first = candidates.iter().min_by(|a, b| a.nis.total_cmp(&b.nis));
            nearest.push(first.map(|c| (c.nis, chi2::quantile(self.config.new_probability, c.h.rows))));
            candidates.retain(|c| c.nis <= self.gates[c.h.rows]);
            within.push(candidates);
            unknown.push(reach.unknown(sightings[*k].measurement.kind()));
        }
        Unlabelled { usable, within, nearest, unknown }
    }

    /// The likeliest pairings, at most `most` of them, the best one first; a weight for each sighting of the instant.
    pub(super) fn pairings(&self, seen: &Unlabelled, most: usize, weights: &[f64]) -> Vec<Pairing> {
        Search::new(&self.active, seen, self.config.gate_probability).likeliest(most, weights)
    }

    /// Updates by sightings with their landmarks.
    pub(super) fn pair(
        &mut self,
        robot: usize,
        sightings: &[Sighting],
        seen: &Unlabelled,
        chosen: &[Option<usize>],
    ) -> Vec<Verdict> {
        let mut verdicts = vec![Verdict::Unusable; sightings.len()];
        for (k, sighting) in sightings.iter().enumerate() {
            if let Target::Robot(other) = sighting.target {
                verdicts[k] = self.observe_robot(robot, other, sighting);
            }
        }
        let mut taken = Vec::new();
        for (n, &k) in seen.usable.iter().enumerate() {
            let sighting = &sightings[k];
            if let Some(c) = chosen[n].map(|c| &seen.within[n][c]) {
                // The state has moved since: the measurement is linearised again, the pairing is kept.
                let place = self.record(c.id).and_then(|r| r.place);
                let linear = place
                    .and_then(|p| self.active.linear(self.robots[robot].place, p, &sighting.measurement));
                if linear.is_some_and(|l| self.active.update(&l)) {
                    verdicts[k] = Verdict::Taken { landmark: Some(c.id), nis: c.nis, dof: c.h.rows };
                    taken.push(c.id);
                    self.was_seen(robot, c.id);
                }
            } else if let Some((nis, _)) = seen.nearest[n].filter(|(nis, wide)| nis <= wide) {
                verdicts[k] = Verdict::Ambiguous { nis };
            } else {
                verdicts[k] = self.found(robot, sighting, None);
                if let Verdict::New { landmark } = verdicts[k] {
                    taken.push(landmark);
                }
            }
        }
        self.count_missed(robot, sightings, &taken);
        self.join_twins(&taken);
        verdicts
    }

    /// Candidates of a sighting: all landmarks that are not far outside the gate, by number.
    fn candidates(&self, robot: usize, sighting: &Sighting) -> Vec<Candidate> {
        let (observer, m) = (self.robots[robot].place, &sighting.measurement);
        let mut found = Vec::new();
        for record in &self.landmarks {
            let Some((h, innovation)) = record.place.and_then(|p| self.active.rows(observer, p, m)) else {
                continue;
            };
            let rows = h.rows;
            let s = self.active.between(&h, &h) + m.covariance();
            let s = Matrix3::from_fn(|i, j| if i < rows && j < rows { s[(i, j)] } else { f64::from(i == j) });
            let innovation = Vector3::from_fn(|i, _| if i < rows { innovation[i] } else { 0.0 });
            let Some(cholesky) = s.cholesky() else { continue };
            let nis = innovation.dot(&cholesky.solve(&innovation));
            let cost = nis + cholesky.determinant().ln();
            found.push(Candidate { id: record.id, h, innovation, noise: *m.covariance(), nis, cost });
        }
        found
    }
}

/// Assigns each sighting its most likely landmark, the likeliest pair first, each landmark once.
fn nearest(candidates: &[Vec<Candidate>]) -> Vec<Option<usize>> {
    let of = |(n, c): (usize, &Vec<Candidate>)| {
        c.iter().enumerate().map(move |(k, c)| (c.cost, n, k)).collect::<Vec<_>>()
    };
    let mut pairs: Vec<(f64, usize, usize)> = candidates.iter().enumerate().flat_map(of).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut chosen = vec![None; candidates.len()];
    let mut used: Vec<LandmarkId> = Vec::new();
    for (_, n, k) in pairs {
        let id = candidates[n][k].id;
        if chosen[n].is_none() && !used.contains(&id) {
            chosen[n] = Some(k);
            used.push(id);
        }
    }
    chosen
}

/// The search for the largest jointly compatible set; among equally large sets, the most compatible one.
struct Search<'a> {
    active: &'a Active,
    candidates: &'a [Vec<Candidate>],
    seen: &'a Unlabelled,
    probability: f64,
    /// Of the current set: chosen candidates, rows of the Cholesky factor of its innovation covariance, whitened
    /// innovation.
    chosen: Vec<Option<usize>>,
    factor: Vec<Vec<f64>>,
    white: Vec<f64>,
    bounds: Vec<f64>,
    best: Vec<Option<usize>>,
    best_pairs: usize,
    best_nis: f64,
    tried: usize,
    /// All sets found, where these are wanted.
    all: Option<Vec<Pairing>>,
    /// Of each sighting of the instant; empty where only the best set is wanted.
    weights: &'a [f64],
}

impl<'a> Search<'a> {
    fn new(active: &'a Active, seen: &'a Unlabelled, probability: f64) -> Self {
        let candidates = seen.within.as_slice();
        let best = vec![None; candidates.len()];
        Self {
            active,
            candidates,
            seen,
            probability,
            chosen: Vec::new(),
            factor: Vec::new(),
            white: Vec::new(),
            bounds: vec![0.0],
            best,
            best_pairs: 0,
            best_nis: f64::INFINITY,
            tried: 0,
            all: None,
            weights: &[],
        }
    }

    /// The most likely sets, the best one first.
    fn likeliest(mut self, most: usize, weights: &'a [f64]) -> Vec<Pairing> {
        (self.all, self.weights) = (Some(Vec::new()), weights);
        self.descend(0, 0, 0.0);
        let mut all = self.all.unwrap_or_default();
        all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        all.truncate(most);
        all
    }

    /// The current set, which is complete. Its likelihood is the product of those of its sightings, each given those before it.
    fn pairing(&self) -> Pairing {
        let mut pairing = Pairing { chosen: self.chosen.clone(), cost: 0.0, counted: 0.0 };
        let mut row = 0;
        for (n, chosen) in self.chosen.iter().enumerate() {
            let cost = match chosen {
                Some(c) => {
                    let rows = row..row + self.candidates[n][*c].h.rows;
                    row = rows.end;
                    let of = |r: usize| {
                        let pivot = self.factor[r].last().copied().unwrap_or(1.0);
                        self.white[r].powi(2) + 2.0 * pivot.ln() + TAU.ln()
                    };
                    rows.map(of).sum::<f64>()
                }
                None => self.seen.unknown[n],
            };
            pairing.cost += cost;
            pairing.counted += cost * self.weights.get(self.seen.usable[n]).copied().unwrap_or(1.0);
        }
        pairing
    }

    fn run(mut self) -> Vec<Option<usize>> {
        self.descend(0, 0, 0.0);
        self.best
    }

    fn descend(&mut self, n: usize, pairs: usize, nis: f64) {
        if n == self.candidates.len() {
            if self.all.is_some() {
                let pairing = self.pairing();
                self.all.iter_mut().for_each(|all| all.push(pairing.clone()));
                return;
            }
            if pairs > self.best_pairs || (pairs == self.best_pairs && nis < self.best_nis) {
                (self.best, self.best_pairs, self.best_nis) = (self.chosen.clone(), pairs, nis);
            }
            return;
        }
        let candidates = &self.candidates[n];
        let mut order: Vec<usize> = (0..candidates.len()).collect();
        order.sort_by(|a, b| candidates[*a].nis.total_cmp(&candidates[*b].nis));
        for k in order {
            if self.tried >= MOST_PAIRINGS {
                break;
            }
            self.tried += 1;
            let used = self
                .chosen
                .iter()
                .enumerate()
                .any(|(m, c)| c.is_some_and(|c| self.candidates[m][c].id == candidates[k].id));
            if used {
                continue;
            }
            let rows = self.factor.len();
            if let Some(more) = self.extend(&candidates[k]) {
                let total = nis + more;
                if total <= self.bound(self.factor.len()) {
                    self.chosen.push(Some(k));
                    self.descend(n + 1, pairs + 1, total);
                    self.chosen.pop();
                }
            }
            self.factor.truncate(rows);
            self.white.truncate(rows);
        }
        // Leaves this sighting out, if all sets are wanted or the remaining ones can still give an equally large set.
        let left = self.candidates.len() - n - 1;
        if self.all.is_some() || pairs + left >= self.best_pairs.max(1) || self.best_pairs == 0 {
            self.chosen.push(None);
            self.descend(n + 1, pairs, nis);
            self.chosen.pop();
        }
    }

    /// Adds the rows of a pairing to the factor; returns the increase of the joint NIS.
    fn extend(&mut self, c: &Candidate) -> Option<f64> {
        let own = self.active.between(&c.h, &c.h) + c.noise;
        let others: Vec<&Candidate> =
            self.chosen.iter().enumerate().filter_map(|(m, k)| k.map(|k| &self.candidates[m][k])).collect();
        let across: Vec<(usize, Matrix3<f64>)> =
            others.iter().map(|o| (o.h.rows, self.active.between(&c.h, &o.h))).collect();
        let mut added = 0.0;
        for i in 0..c.h.rows {
            let shared = across.iter().flat_map(|(rows, m)| (0..*rows).map(move |j| m[(i, j)]));
            let mut row: Vec<f64> = shared.chain((0..=i).map(|j| own[(i, j)])).collect();
            let last = row.len() - 1;
            for j in 0..last {
                let known: f64 = row[..j].iter().zip(&self.factor[j]).map(|(a, b)| a * b).sum();
                row[j] = (row[j] - known) / self.factor[j][j];
            }
            let pivot = row[last] - row[..last].iter().map(|v| v * v).sum::<f64>();
            if pivot.is_nan() || pivot <= 0.0 {
                return None;
            }
            row[last] = pivot.sqrt();
            let known: f64 = row[..last].iter().zip(&self.white).map(|(a, b)| a * b).sum();
            let white = (c.innovation[i] - known) / row[last];
            added += white * white;
            self.white.push(white);
            self.factor.push(row);
        }
        Some(added)
    }

    fn bound(&mut self, dof: usize) -> f64 {
        while self.bounds.len() <= dof {
            self.bounds.push(chi2::quantile(self.probability, self.bounds.len()));
        }
        self.bounds[dof]
    }
}
