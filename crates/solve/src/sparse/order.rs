//! The elimination order: approximate minimum degree.
//!
//! Source: Amestoy, Davis, Duff, "An approximate minimum degree ordering algorithm" (1996): quotient graph, element
//! absorption (aggressive too), mass elimination, supervariables, approximate external degrees.

/// An elimination order of the vertices of a graph, one for each weight; each edge counts both ways, loops and repeats
/// are ignored. The weight of a vertex, at least 1, is the number of scalar unknowns it stands for.
pub fn minimum_degree(weights: Vec<u32>, edges: impl Iterator<Item = (usize, usize)>) -> Vec<u32> {
    Quotient::new(weights, edges).eliminate()
}

const NONE: u32 = u32::MAX;

/// The quotient graph while it shrinks. A vertex is a variable, then perhaps an element, or part of another variable.
struct Quotient {
    /// Variables next to a variable.
    variables: Vec<Vec<u32>>,
    /// Elements next to a variable.
    elements: Vec<Vec<u32>>,
    /// Variables of an element.
    members: Vec<Vec<u32>>,
    /// Scalar unknowns that a variable stands for; 0 when it is an element or part of another.
    weight: Vec<u32>,
    /// Approximate external degree of a variable; weight of an element's members.
    degree: Vec<u32>,
    /// Whether a vertex is a living element.
    element: Vec<bool>,
    /// What each vertex became part of.
    part_of: Vec<u32>,
    buckets: Buckets,
    /// Marks; a vertex is marked when its entry equals `stamp`.
    mark: Vec<u32>,
    stamp: u32,
}

impl Quotient {
    fn new(weight: Vec<u32>, edges: impl Iterator<Item = (usize, usize)>) -> Self {
        let n = weight.len();
        let mut variables = vec![Vec::new(); n];
        for (a, b) in edges.filter(|(a, b)| a != b) {
            variables[a].push(b as u32);
            variables[b].push(a as u32);
        }
        for list in &mut variables {
            list.sort_unstable();
            list.dedup();
        }
        let weigh = |list: &Vec<u32>| list.iter().map(|i| weight[*i as usize]).sum();
        let degree: Vec<u32> = variables.iter().map(weigh).collect();
        let mut buckets = Buckets::new(n, weight.iter().sum());
        // From the back, so that of equal degrees the first comes first.
        for i in (0..n).rev() {
            buckets.insert(i as u32, degree[i]);
        }
        Self {
            variables,
            elements: vec![Vec::new(); n],
            members: vec![Vec::new(); n],
            weight,
            degree,
            element: vec![false; n],
            part_of: vec![NONE; n],
            buckets,
            mark: vec![0; n],
            stamp: 0,
        }
    }

    fn eliminate(mut self) -> Vec<u32> {
        let n = self.variables.len();
        let mut pivots = Vec::new();
        // Of each element, the weight of what it has outside the one being made, by stamp.
        let mut outside = vec![(0u32, 0u32); n];
        let mut hashes: Vec<(u64, u32)> = Vec::new();
        let mut left = self.weight.iter().sum();
        while let Some(p) = self.buckets.pop_least() {
            pivots.push(p);
            let lp = self.make_element(p, &mut left);
            let lp_weight: u32 = lp.iter().map(|i| self.weight[*i as usize]).sum();
            self.count_outside(&lp, &mut outside);
            hashes.clear();
            for &i in &lp {
                self.update(i, p, lp_weight, &mut left, &outside, &mut hashes);
            }
            self.join_indistinguishable(&mut hashes);
            let members: Vec<u32> = lp.into_iter().filter(|i| self.weight[*i as usize] > 0).collect();
            for &i in &members {
                let d = self.degree[i as usize].min(left.saturating_sub(self.weight[i as usize]));
                self.degree[i as usize] = d;
                self.buckets.insert(i, d);
            }
            self.degree[p as usize] = members.iter().map(|i| self.weight[*i as usize]).sum();
            self.element[p as usize] = !members.is_empty();
            self.members[p as usize] = members;
        }
        self.expand(&pivots)
    }

    /// Turns the variable `p` into an element: takes its remaining neighbours out of the buckets and returns them.
    fn make_element(&mut self, p: u32, left: &mut u32) -> Vec<u32> {
        let p = p as usize;
        self.stamp += 1;
        self.mark[p] = self.stamp;
        let mut lp = Vec::new();
        let variables = std::mem::take(&mut self.variables[p]);
        let elements = std::mem::take(&mut self.elements[p]);
        let (mark, weight, stamp) = (&mut self.mark, &self.weight, self.stamp);
        let mut take = |i: u32| {
            if weight[i as usize] > 0 && mark[i as usize] != stamp {
                mark[i as usize] = stamp;
                lp.push(i);
            }
        };
        variables.into_iter().for_each(&mut take);
        for e in elements {
            if std::mem::take(&mut self.element[e as usize]) {
                std::mem::take(&mut self.members[e as usize]).into_iter().for_each(&mut take);
            }
        }
        for &i in &lp {
            self.buckets.remove(i, self.degree[i as usize]);
        }
        *left -= self.weight[p];
        // The pivot's own weight is kept for those that join it; as a variable it is gone.
        self.weight[p] = 0;
        lp
    }

    /// For each element next to `lp`: the weight of its members that are not in `lp`.
    fn count_outside(&self, lp: &[u32], outside: &mut [(u32, u32)]) {
        for &i in lp {
            for &e in &self.elements[i as usize] {
                let e = e as usize;
                if self.element[e] {
                    if outside[e].0 != self.stamp {
                        outside[e] = (self.stamp, self.degree[e]);
                    }
                    outside[e].1 -= self.weight[i as usize];
                }
            }
        }
    }

    /// New lists and degree of the variable `i` next to the new element `p`; it joins `p` when it has no other neighbour.
    fn update(
        &mut self,
        i: u32,
        p: u32,
        lp_weight: u32,
        left: &mut u32,
        outside: &[(u32, u32)],
        hashes: &mut Vec<(u64, u32)>,
    ) {
        let at = i as usize;
        let mut elements = std::mem::take(&mut self.elements[at]);
        let mut variables = std::mem::take(&mut self.variables[at]);
        let mut reach = 0;
        elements.retain(|&e| {
            let w = outside[e as usize];
            // An element whose members all lie in the new one is absorbed.
            let keep = self.element[e as usize] && w.1 > 0;
            if keep {
                reach += w.1;
            }
            keep
        });
        variables.retain(|&j| {
            let keep = self.weight[j as usize] > 0 && self.mark[j as usize] != self.stamp;
            if keep {
                reach += self.weight[j as usize];
            }
            keep
        });
        if elements.is_empty() && variables.is_empty() {
            self.part_of[at] = p;
            *left -= self.weight[at];
            self.weight[at] = 0;
            return;
        }
        let within = lp_weight - self.weight[at];
        self.degree[at] =
            (*left).min(self.degree[at].saturating_add(within)).min(reach.saturating_add(within));
        elements.push(p);
        let hash = |list: &[u32]| list.iter().fold(0u64, |h, v| h.wrapping_add(spread(*v)));
        hashes.push((hash(&elements).wrapping_mul(3).wrapping_add(hash(&variables)), i));
        self.elements[at] = elements;
        self.variables[at] = variables;
    }

    /// Variables with the same neighbours become one.
    fn join_indistinguishable(&mut self, hashes: &mut [(u64, u32)]) {
        hashes.sort_unstable();
        for start in 0..hashes.len() {
            let (hash, i) = hashes[start];
            if self.weight[i as usize] == 0 {
                continue;
            }
            for k in start + 1..hashes.len() {
                let (other, j) = hashes[k];
                if other != hash {
                    break;
                }
                if self.weight[j as usize] > 0 && self.indistinguishable(i, j) {
                    self.weight[i as usize] += self.weight[j as usize];
                    self.degree[i as usize] = self.degree[i as usize].saturating_sub(self.weight[j as usize]);
                    self.weight[j as usize] = 0;
                    self.part_of[j as usize] = i;
                    self.variables[j as usize] = Vec::new();
                    self.elements[j as usize] = Vec::new();
                }
            }
        }
    }

    fn indistinguishable(&mut self, i: u32, j: u32) -> bool {
        let (i, j) = (i as usize, j as usize);
        if self.variables[i].len() != self.variables[j].len()
            || self.elements[i].len() != self.elements[j].len()
        {
            return false;
        }
        let same = |a: &[u32], b: &[u32], mark: &mut [u32], stamp: u32| {
            a.iter().for_each(|v| mark[*v as usize] = stamp);
            b.iter().all(|v| mark[*v as usize] == stamp)
        };
        self.stamp += 2;
        same(&self.variables[i], &self.variables[j], &mut self.mark, self.stamp - 1)
            && same(&self.elements[i], &self.elements[j], &mut self.mark, self.stamp)
    }

    /// The order: each pivot with what became part of it.
    fn expand(self, pivots: &[u32]) -> Vec<u32> {
        let n = self.part_of.len();
        let mut rank = vec![NONE; n];
        for (k, p) in pivots.iter().enumerate() {
            rank[*p as usize] = k as u32;
        }
        let mut order: Vec<(u32, u32)> = (0..n as u32)
            .map(|i| {
                let mut root = i;
                while self.part_of[root as usize] != NONE {
                    root = self.part_of[root as usize];
                }
                (rank[root as usize], i)
            })
            .collect();
        order.sort_unstable();
        order.into_iter().map(|(_, i)| i).collect()
    }
}

/// Spreads a number over 64 bits, for sums that distinguish sets.
fn spread(v: u32) -> u64 {
    let x = (v as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x ^ (x >> 29)
}

/// Variables by degree, in lists linked both ways.
struct Buckets {
    head: Vec<u32>,
    next: Vec<u32>,
    before: Vec<u32>,
    least: usize,
}

impl Buckets {
    fn new(n: usize, most: u32) -> Self {
        Self { head: vec![NONE; most as usize + 1], next: vec![NONE; n], before: vec![NONE; n], least: 0 }
    }

    fn insert(&mut self, i: u32, degree: u32) {
        let d = degree as usize;
        let old = self.head[d];
        self.next[i as usize] = old;
        self.before[i as usize] = NONE;
        if old != NONE {
            self.before[old as usize] = i;
        }
        self.head[d] = i;
        self.least = self.least.min(d);
    }

    fn remove(&mut self, i: u32, degree: u32) {
        let (before, next) = (self.before[i as usize], self.next[i as usize]);
        if before == NONE {
            self.head[degree as usize] = next;
        } else {
            self.next[before as usize] = next;
        }
        if next != NONE {
            self.before[next as usize] = before;
        }
    }

    fn pop_least(&mut self) -> Option<u32> {
        while self.least < self.head.len() {
            let i = self.head[self.least];
            if i != NONE {
                self.remove(i, self.least as u32);
                return Some(i);
            }
            self.least += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of the factor below the diagonal, by plain elimination.
    fn fill(n: usize, edges: &[(usize, usize)], order: &[u32]) -> usize {
        let mut next = vec![std::collections::BTreeSet::new(); n];
        for &(a, b) in edges.iter().filter(|(a, b)| a != b) {
            next[a].insert(b);
            next[b].insert(a);
        }
        let mut count = 0;
        for &p in order {
            let near: Vec<usize> = std::mem::take(&mut next[p as usize]).into_iter().collect();
            count += near.len();
            for &i in &near {
                next[i].remove(&(p as usize));
                next[i].extend(near.iter().filter(|j| **j != i));
            }
        }
        count
    }

    fn grid(side: usize) -> Vec<(usize, usize)> {
        let mut edges = Vec::new();
        for y in 0..side {
            for x in 0..side {
                let i = y * side + x;
                if x + 1 < side {
                    edges.push((i, i + 1));
                }
                if y + 1 < side {
                    edges.push((i, i + side));
                }
            }
        }
        edges
    }

    #[test]
    fn each_vertex_once_with_little_fill() {
        let edges = grid(24);
        let order = minimum_degree(vec![1; 576], edges.iter().copied());
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..576).collect::<Vec<u32>>());
        let natural: Vec<u32> = (0..576).collect();
        let (ours, plain) = (fill(576, &edges, &order), fill(576, &edges, &natural));
        assert!(ours * 2 < plain, "{ours} blocks, {plain} in natural order");
    }

    #[test]
    fn trees_have_no_fill() {
        let edges: Vec<_> = (1..200).map(|i| (i, (i * 7) / 11)).collect();
        let order = minimum_degree(vec![1; 200], edges.iter().copied());
        assert_eq!(fill(200, &edges, &order), 199);
    }

    #[test]
    fn self_loops_repeats_and_isolated_vertices() {
        let order = minimum_degree(vec![1; 5], [(0, 1), (1, 0), (2, 2), (0, 1), (1, 3)].into_iter());
        assert_eq!(order.len(), 5);
        assert!(minimum_degree(Vec::new(), std::iter::empty()).is_empty());
    }
}
