//! Chooses the poses that a robot sends: the shared ones, and those whose elimination would make its messages longer.
//!
//! Eliminating a pose connects all poses around it in one dense block, whose size grows with the square of their
//! number. Poses are eliminated in minimum-degree order (Tinney and Walker, 1967; George and Liu, "The evolution of the
//! minimum degree ordering algorithm", 1989) in a quotient graph, and of all intermediate states the cheapest is taken.
//! In a chain that is the last one: only the shared poses remain.

use std::collections::{BTreeMap, BTreeSet};

/// Number of messages over which the bytes of a measurement, which is sent once, are spread when sizes are compared.
const MESSAGES: usize = 4;

/// Which poses to keep, among `shared.len()` with measurements between these `edges`; each pose has `D` unknowns. Measurements have so many
/// different information matrices, which are sent once each.
pub fn choose<const D: usize>(shared: &[bool], edges: &[(usize, usize)], informations: usize) -> Vec<bool> {
    let of_information = 8 * D * (D + 1) / 2 * informations / edges.len().max(1);
    let mut state = State::new(shared.len(), edges, 8 * D + 4 + of_information);
    let mut free: BTreeSet<usize> = (0..shared.len()).filter(|v| !shared[*v]).collect();
    let mut order = Vec::new();
    let (mut best, mut cheapest) = (0, state.bytes::<D>());
    while let Some(v) = free.iter().copied().min_by_key(|v| (state.next[*v].len(), *v)) {
        free.remove(&v);
        state.eliminate(v);
        order.push(v);
        let bytes = state.bytes::<D>();
        if bytes <= cheapest {
            (best, cheapest) = (order.len(), bytes);
        }
    }
    let mut keep = vec![true; shared.len()];
    order[..best].iter().for_each(|v| keep[*v] = false);
    keep
}

/// The graph during elimination.
struct State {
    /// Poses that each pose is connected to, by a measurement or through eliminated ones.
    next: Vec<BTreeSet<usize>>,
    /// Number of measurements to each remaining pose.
    measured: Vec<BTreeMap<usize, usize>>,
    left: usize,
    measurements: usize,
    /// Bytes of each of these.
    measurement_bytes: usize,
    /// Number of remaining poses around each connected part of eliminated ones.
    around: BTreeMap<usize, usize>,
    /// The eliminated parts next to each pose.
    parts: Vec<BTreeSet<usize>>,
}

impl State {
    fn new(n: usize, edges: &[(usize, usize)], measurement_bytes: usize) -> Self {
        let mut next = vec![BTreeSet::new(); n];
        let mut measured = vec![BTreeMap::new(); n];
        for &(a, b) in edges.iter().filter(|(a, b)| a != b) {
            for (a, b) in [(a, b), (b, a)] {
                next[a].insert(b);
                *measured[a].entry(b).or_insert(0) += 1;
            }
        }
        Self {
            next,
            measured,
            left: n,
            measurements: edges.len(),
            measurement_bytes,
            around: BTreeMap::new(),
            parts: vec![BTreeSet::new(); n],
        }
    }

    fn eliminate(&mut self, v: usize) {
        let around = std::mem::take(&mut self.next[v]);
        for merged in std::mem::take(&mut self.parts[v]) {
            self.around.remove(&merged);
            for u in &around {
                self.parts[*u].remove(&merged);
            }
        }
        for &u in &around {
            self.next[u].extend(around.iter().filter(|w| **w != u));
            self.next[u].remove(&v);
            self.parts[u].insert(v);
            self.measured[u].remove(&v);
        }
        self.around.insert(v, around.len());
        self.measurements -= std::mem::take(&mut self.measured[v]).values().sum::<usize>();
        self.left -= 1;
    }

    /// Approximate length of a message.
    fn bytes<const D: usize>(&self) -> usize {
        let part = |around: &usize| {
            let n = D * around.saturating_sub(1);
            4 * (n * (n + 1) / 2 + n)
        };
        let parts: usize = self.around.values().map(part).sum();
        parts + self.left * (4 * D + 1) + self.measurements * self.measurement_bytes / MESSAGES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_chain_only_the_shared_poses_stay() {
        let edges: Vec<(usize, usize)> = (1..40).map(|k| (k - 1, k)).collect();
        let shared: Vec<bool> = (0..40).map(|k| [3, 17, 18, 30].contains(&k)).collect();
        assert_eq!(choose::<6>(&shared, &edges, 1), shared);
    }

    #[test]
    fn a_pose_in_the_middle_of_many_shared_ones_stays() {
        // A star: without its centre, all of its 30 tips would be connected in one dense block.
        let edges: Vec<(usize, usize)> = (1..31).map(|k| (0, k)).collect();
        let mut shared = vec![true; 31];
        shared[0] = false;
        assert_eq!(choose::<6>(&shared, &edges, 1), vec![true; 31]);
        // A pose between only two others is eliminated.
        let chain = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6)];
        let ends = [true, false, false, false, false, false, true];
        assert_eq!(choose::<6>(&ends, &chain, 1), ends);
    }

    #[test]
    fn a_grid_keeps_less_than_everything_and_more_than_what_is_shared() {
        let side = 12;
        let at = |x: usize, y: usize| x * side + y;
        let mut edges = Vec::new();
        for x in 0..side {
            for y in 0..side {
                if x + 1 < side {
                    edges.push((at(x, y), at(x + 1, y)));
                }
                if y + 1 < side {
                    edges.push((at(x, y), at(x, y + 1)));
                }
            }
        }
        let shared: Vec<bool> = (0..side * side).map(|v| v % side == 0).collect();
        let keep = choose::<3>(&shared, &edges, 1);
        let kept = keep.iter().filter(|k| **k).count();
        assert!(shared.iter().zip(&keep).all(|(s, k)| !s || *k) && kept < side * side, "{kept}");
    }
}
