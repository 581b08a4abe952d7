//! The maximum clique of a graph: the largest set of vertices that are all connected to each other.
//!
//! Source: branch and bound with colourings as bounds, Tomita and Seki, "An efficient branch-and-bound algorithm for
//! finding a maximum clique" (2003); bit sets as in San Segundo et al., "An exact bit-parallel algorithm for the
//! maximum clique problem" (2011).

/// Greatest number of branches searched; then the best clique so far is returned.
const BRANCHES: usize = 200_000;

/// A clique, and whether it is certainly a largest one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clique {
    /// Its vertices, in rising order.
    pub vertices: Vec<usize>,
    /// Whether the search was complete. If not, a larger one may exist.
    pub is_maximum: bool,
}

/// The maximum clique of the graph in which `a` and `b` are connected where `joined(a, b)`; of several the first found.
pub fn maximum_clique(n: usize, joined: impl Fn(usize, usize) -> bool) -> Clique {
    let words = n.div_ceil(64);
    let mut rows = vec![vec![0u64; words]; n];
    for a in 0..n {
        for b in 0..a {
            if joined(a, b) {
                rows[a][b / 64] |= 1 << (b % 64);
                rows[b][a / 64] |= 1 << (a % 64);
            }
        }
    }
    let mut search = Search { rows, best: Vec::new(), current: Vec::new(), left: BRANCHES };
    let mut all = vec![0u64; words];
    (0..n).for_each(|v| all[v / 64] |= 1 << (v % 64));
    search.expand(&mut all);
    search.best.sort_unstable();
    Clique { vertices: search.best, is_maximum: search.left > 0 }
}

struct Search {
    rows: Vec<Vec<u64>>,
    best: Vec<usize>,
    current: Vec<usize>,
    left: usize,
}

impl Search {
    /// Tries all cliques that extend the current one by some of the candidates.
    fn expand(&mut self, candidates: &mut [u64]) {
        for (v, colours) in self.coloured(candidates).into_iter().rev() {
            if self.current.len() + colours <= self.best.len() || self.left == 0 {
                return;
            }
            self.left -= 1;
            self.current.push(v);
            let mut next: Vec<u64> = candidates.iter().zip(&self.rows[v]).map(|(c, r)| c & r).collect();
            if next.iter().any(|w| *w != 0) {
                self.expand(&mut next);
            } else if self.current.len() > self.best.len() {
                self.best.clone_from(&self.current);
            }
            self.current.pop();
            candidates[v / 64] &= !(1 << (v % 64));
        }
    }

    /// The candidates in order of their colour, each with the number of colours up to it, which bounds the size of
    /// their cliques.
    fn coloured(&self, candidates: &[u64]) -> Vec<(usize, usize)> {
        let mut left = candidates.to_vec();
        let mut order = Vec::new();
        let mut colours = 0;
        while left.iter().any(|w| *w != 0) {
            colours += 1;
            let mut free = left.clone();
            while let Some(v) = first(&free) {
                order.push((v, colours));
                left[v / 64] &= !(1 << (v % 64));
                free[v / 64] &= !(1 << (v % 64));
                free.iter_mut().zip(&self.rows[v]).for_each(|(f, r)| *f &= !r);
            }
        }
        order
    }
}

fn first(set: &[u64]) -> Option<usize> {
    let word = set.iter().position(|w| *w != 0)?;
    Some(64 * word + set[word].trailing_zeros() as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn small_graphs() {
        assert_eq!(maximum_clique(0, |_, _| true).vertices, []);
        assert_eq!(maximum_clique(3, |_, _| false).vertices.len(), 1);
        assert_eq!(maximum_clique(130, |_, _| true).vertices, (0..130).collect::<Vec<_>>());
        let odd = maximum_clique(200, |a, b| a % 2 == 1 && b % 2 == 1 && a < 150 && b < 150);
        assert_eq!(odd.vertices, (0..75).map(|k| 2 * k + 1).collect::<Vec<_>>());
        assert!(odd.is_maximum);
    }

    proptest! {
        #[test]
        fn as_large_as_the_largest_of_all_subsets(edges in proptest::collection::vec(any::<bool>(), 91)) {
            let n = 14;
            let joined = |a: usize, b: usize| {
                let (a, b) = (a.max(b), a.min(b));
                edges[a * (a - 1) / 2 + b]
            };
            let is_clique = |set: u32| {
                (0..n).filter(|a| set >> a & 1 == 1).all(|a| (0..a).all(|b| set >> b & 1 == 0 || joined(a, b)))
            };
            let largest = (0..1u32 << n).filter(|s| is_clique(*s)).map(u32::count_ones).max().unwrap();
            let found = maximum_clique(n, joined);
            prop_assert!(found.is_maximum && found.vertices.len() == largest as usize);
            prop_assert!(is_clique(found.vertices.iter().fold(0, |s, v| s | 1 << v)));
        }
    }
}
