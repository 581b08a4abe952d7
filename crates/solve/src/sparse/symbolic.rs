//! From a pattern to where each block of the matrix and of its factor lives.
//!
//! Source: Davis, "Direct methods for sparse linear systems" (2006), chapter 4 (elimination tree, column structure);
//! Ashcraft and Grimes, "The influence of relaxed supernode partitions on the multifrontal method" (1989) for joining
//! supernodes; Liu, "The multifrontal method for sparse matrix solution" (1992) for the fronts.

use super::order::minimum_degree;

/// The analysed pattern of a symmetric block matrix.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// Scalar unknowns of each block row, in the caller's numbering.
    pub(super) sizes: Vec<usize>,
    /// First scalar of each block row in the caller's numbering, and the number of scalars.
    pub(super) offset: Vec<usize>,
    /// The same in elimination order.
    pub(super) start: Vec<usize>,
    /// Place in the elimination order of each block row.
    pub(super) place: Vec<u32>,
    pub(super) supernodes: Vec<Supernode>,
    /// Off-diagonal blocks that the matrix holds, `(row, column)` with `row > column`, in the caller's numbering, sorted.
    pub(super) pairs: Vec<(u32, u32)>,
}

/// Columns of the factor with one structure, in elimination order.
#[derive(Clone, Debug, Default)]
pub(super) struct Supernode {
    /// First column.
    pub first: usize,
    /// Number of columns.
    pub width: usize,
    /// Row blocks of the front: first its columns, then those below, rising.
    pub rows: Vec<u32>,
    /// First scalar row of each of them in the front, and the number of scalar rows.
    pub row_start: Vec<usize>,
    /// Where its parent is, if there are rows below.
    pub parent: Option<usize>,
    /// Children, in the order in which their updates are added.
    pub children: Vec<u32>,
    /// For each row below the columns, its place among the parent's rows.
    pub into_parent: Vec<u32>,
    /// Diagonal blocks: (block row of the caller); its place in the front is its index.
    pub diagonal: Vec<u32>,
    /// Off-diagonal blocks: (index among the pairs, row in the front, column in the front, whether transposed).
    pub off_diagonal: Vec<(u32, u32, u32, bool)>,
}

impl Analysis {
    /// Of a matrix of `n` block rows of one size whose off-diagonal blocks stand at `pairs` (either triangle; repeats and
    /// the diagonal are ignored; every diagonal block is there).
    pub fn new(n: usize, size: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Self {
        Self::with_sizes(vec![size; n], pairs)
    }

    /// The same with block rows of different sizes, each at least 1: block `(a, b)` has `sizes[a]` rows and `sizes[b]`
    /// columns.
    pub fn with_sizes(sizes: Vec<usize>, pairs: impl Iterator<Item = (usize, usize)>) -> Self {
        let n = sizes.len();
        let mut sorted: Vec<(u32, u32)> = pairs
            .filter(|(a, b)| a != b && *a < n && *b < n)
            .map(|(a, b)| (a.max(b) as u32, a.min(b) as u32))
            .collect();
        sorted.sort_unstable();
        sorted.dedup();
        // Only the proportions count; where all sizes are the same, each is one.
        let uniform = sizes.windows(2).all(|w| w[0] == w[1]);
        let weights = sizes.iter().map(|s| if uniform { 1 } else { *s as u32 }).collect();
        let order = minimum_degree(weights, sorted.iter().map(|(a, b)| (*a as usize, *b as usize)));
        let order = postorder_of(&order, &sorted);
        let place = inverse(&order);
        let lower = lower_columns(&place, &sorted);
        let parent = elimination_tree(&lower);
        let columns = structures(&lower, &parent);
        let ordered: Vec<usize> = order.iter().map(|i| sizes[*i as usize]).collect();
        let mut supernodes = join_columns(&columns, &ordered);
        for s in &mut supernodes {
            s.row_start = offsets(s.rows.iter().map(|r| ordered[*r as usize]));
        }
        connect(&mut supernodes, n);
        let (offset, start) = (offsets(sizes.iter().copied()), offsets(ordered.iter().copied()));
        let mut analysis = Self { sizes, offset, start, place, supernodes, pairs: sorted };
        analysis.place_blocks(&order);
        analysis
    }

    /// Number of block rows.
    pub fn rows(&self) -> usize {
        self.place.len()
    }

    /// Scalar unknowns of a block row.
    pub fn size(&self, row: usize) -> usize {
        self.sizes[row]
    }

    /// First scalar of a block row in right-hand sides and solutions.
    pub fn offset(&self, row: usize) -> usize {
        self.offset[row]
    }

    /// Number of scalar unknowns.
    pub fn dimension(&self) -> usize {
        self.offset.last().copied().unwrap_or(0)
    }

    /// Off-diagonal blocks of the matrix: `(row, column)`, row greater than column, sorted.
    pub fn pairs(&self) -> &[(u32, u32)] {
        &self.pairs
    }

    /// Index among [`Analysis::pairs`] of the block at `(a, b)`, in either order.
    pub fn pair(&self, a: usize, b: usize) -> Option<usize> {
        self.pairs.binary_search(&(a.max(b) as u32, a.min(b) as u32)).ok()
    }

    fn place_blocks(&mut self, order: &[u32]) {
        let mut home = vec![0u32; order.len()];
        for (k, s) in self.supernodes.iter_mut().enumerate() {
            for c in s.first..s.first + s.width {
                home[c] = k as u32;
            }
            s.diagonal = order[s.first..s.first + s.width].to_vec();
        }
        for (index, &(a, b)) in self.pairs.iter().enumerate() {
            let (pa, pb) = (self.place[a as usize], self.place[b as usize]);
            let (row, column) = (pa.max(pb), pa.min(pb));
            let s = &mut self.supernodes[home[column as usize] as usize];
            let local = s.local(row);
            s.off_diagonal.push((index as u32, local, column - s.first as u32, pa < pb));
        }
    }
}

impl Supernode {
    /// Scalar rows of the front.
    pub fn height(&self) -> usize {
        self.row_start.last().copied().unwrap_or(0)
    }

    /// Scalar columns.
    pub fn columns(&self) -> usize {
        self.row_start.get(self.width).copied().unwrap_or(0)
    }

    /// Place of a row in the front.
    fn local(&self, row: u32) -> u32 {
        let row_at = row as usize;
        if row_at < self.first + self.width {
            return (row_at - self.first) as u32;
        }
        // Present by construction: the front holds the structure of each of its columns.
        (self.width + self.rows[self.width..].partition_point(|r| *r < row)) as u32
    }
}

/// Running sums, beginning with zero.
fn offsets(sizes: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sum = 0;
    let mut all = vec![0];
    all.extend(sizes.map(|s| {
        sum += s;
        sum
    }));
    all
}

fn inverse(order: &[u32]) -> Vec<u32> {
    let mut place = vec![0; order.len()];
    for (k, i) in order.iter().enumerate() {
        place[*i as usize] = k as u32;
    }
    place
}

/// For each column, in elimination order, the rows below it.
fn lower_columns(place: &[u32], pairs: &[(u32, u32)]) -> Vec<Vec<u32>> {
    let mut lower = vec![Vec::new(); place.len()];
    for &(a, b) in pairs {
        let (pa, pb) = (place[a as usize], place[b as usize]);
        lower[pa.min(pb) as usize].push(pa.max(pb));
    }
    lower
}

const ROOT: u32 = u32::MAX;

/// The parent of each column (Liu's algorithm with path compression).
fn elimination_tree(lower: &[Vec<u32>]) -> Vec<u32> {
    let n = lower.len();
    let mut upper = vec![Vec::new(); n];
    for (column, rows) in lower.iter().enumerate() {
        for &r in rows {
            upper[r as usize].push(column as u32);
        }
    }
    let (mut parent, mut ancestor) = (vec![ROOT; n], vec![ROOT; n]);
    for row in 0..n {
        for &column in &upper[row] {
            let mut k = column as usize;
            while k != row {
                let next = std::mem::replace(&mut ancestor[k], row as u32);
                if next == ROOT {
                    parent[k] = row as u32;
                    break;
                }
                k = next as usize;
            }
        }
    }
    parent
}

/// The order changed to a postorder of its elimination tree, in which the child with the tallest front comes last.
fn postorder_of(order: &[u32], pairs: &[(u32, u32)]) -> Vec<u32> {
    let n = order.len();
    let lower = lower_columns(&inverse(order), pairs);
    let parent = elimination_tree(&lower);
    let heights: Vec<usize> = structures(&lower, &parent).iter().map(Vec::len).collect();
    let mut children = vec![Vec::new(); n];
    for c in 0..n {
        if parent[c] != ROOT {
            children[parent[c] as usize].push(c as u32);
        }
    }
    for list in &mut children {
        list.sort_by_key(|c| heights[*c as usize]);
    }
    let mut result = Vec::with_capacity(n);
    for root in (0..n).filter(|c| parent[*c] == ROOT) {
        let mut stack = vec![(root as u32, 0usize)];
        while let Some((node, next)) = stack.last_mut() {
            match children[*node as usize].get(*next) {
                Some(&child) => {
                    *next += 1;
                    stack.push((child, 0));
                }
                None => {
                    result.push(order[*node as usize]);
                    stack.pop();
                }
            }
        }
    }
    result
}

/// The rows below the diagonal of each column of the factor, rising.
fn structures(lower: &[Vec<u32>], parent: &[u32]) -> Vec<Vec<u32>> {
    let n = lower.len();
    let mut children = vec![Vec::new(); n];
    for c in 0..n {
        if parent[c] != ROOT {
            children[parent[c] as usize].push(c);
        }
    }
    let mut mark = vec![ROOT; n];
    let mut columns: Vec<Vec<u32>> = Vec::with_capacity(n);
    for c in 0..n {
        let mut rows = Vec::new();
        mark[c] = c as u32;
        let below = children[c].iter().flat_map(|k| &columns[*k]).chain(&lower[c]);
        for &r in below {
            if mark[r as usize] != c as u32 {
                mark[r as usize] = c as u32;
                rows.push(r);
            }
        }
        rows.sort_unstable();
        columns.push(rows);
    }
    columns
}

/// Supernodes: columns of one structure together, and a last child into its parent where few zeros are stored for it.
fn join_columns(columns: &[Vec<u32>], sizes: &[usize]) -> Vec<Supernode> {
    /// A supernode and the block zeros that it stores.
    struct Part {
        node: Supernode,
        zeros: usize,
    }
    let mut parts: Vec<Part> = Vec::new();
    for (c, below) in columns.iter().enumerate() {
        let rows = std::iter::once(c as u32).chain(below.iter().copied()).collect();
        let mut part =
            Part { node: Supernode { first: c, width: 1, rows, ..Supernode::default() }, zeros: 0 };
        // The part before it in postorder is its last child where that child's first row below is this column.
        while let Some(child) = parts.last() {
            let (node, child_rows) = (&part.node, &child.node.rows);
            if child_rows.get(child.node.width) != Some(&(node.first as u32)) {
                break;
            }
            let width = child.node.width + node.width;
            let height = child.node.width + node.rows.len();
            let added = (height - child_rows.len()) * child.node.width;
            let zeros = child.zeros + part.zeros + added;
            let stored = width * height - width * (width - 1) / 2;
            let share = zeros as f64 / stored as f64;
            let scalars: usize = sizes[child.node.first..child.node.first + width].iter().sum();
            let worth = zeros == 0
                || scalars <= 12
                || (scalars <= 24 && share < 0.3)
                || (scalars <= 48 && share < 0.1)
                || share < 0.02;
            if !worth {
                break;
            }
            let mut rows: Vec<u32> =
                (child.node.first..child.node.first + child.node.width).map(|r| r as u32).collect();
            rows.extend(&node.rows);
            part = Part {
                node: Supernode { first: child.node.first, width, rows, ..Supernode::default() },
                zeros,
            };
            parts.pop();
        }
        parts.push(part);
    }
    parts.into_iter().map(|p| p.node).collect()
}

/// Parents, children, and where the rows of each go in its parent.
fn connect(supernodes: &mut [Supernode], n: usize) {
    let mut home = vec![0u32; n];
    for (k, s) in supernodes.iter().enumerate() {
        home[s.first..s.first + s.width].fill(k as u32);
    }
    for k in 0..supernodes.len() {
        let Some(&first_below) = supernodes[k].rows.get(supernodes[k].width) else { continue };
        let parent = home[first_below as usize] as usize;
        let into: Vec<u32> =
            supernodes[k].rows[supernodes[k].width..].iter().map(|r| supernodes[parent].local(*r)).collect();
        supernodes[k].into_parent = into;
        supernodes[k].parent = Some(parent);
        supernodes[parent].children.push(k as u32);
    }
}
