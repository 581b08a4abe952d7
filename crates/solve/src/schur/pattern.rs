//! Where the blocks of the reduced system stand.

use crate::sparse::Analysis;
use std::ops::Range;
use std::sync::Arc;

/// Where blocks stand.
#[derive(Debug)]
pub struct Pattern {
    pub analysis: Arc<Analysis>,
    pub cameras: usize,
    /// Pairs of two cameras; in the sorted list of pairs they come first.
    pub camera_pairs: usize,
    /// First pair of each row, and the number of pairs.
    pub row_start: Vec<u32>,
    /// Pairs of two cameras that share a factor beside points, rising.
    pub camera_links: Vec<u32>,
    /// First number of each further variable's diagonal block, and of each further pair's block.
    pub diagonal_start: Vec<usize>,
    pub off_start: Vec<usize>,
}

impl Pattern {
    pub fn new(analysis: Analysis, cameras: usize, linked: &[(usize, usize)]) -> Self {
        let pairs = analysis.pairs();
        let row_start = (0..=analysis.rows()).map(|a| pairs.partition_point(|p| (p.0 as usize) < a) as u32);
        let row_start: Vec<u32> = row_start.collect();
        let camera_pairs = row_start[cameras] as usize;
        let mut camera_links: Vec<u32> =
            linked.iter().filter_map(|(a, b)| analysis.pair(*a, *b)).map(|p| p as u32).collect();
        camera_links.retain(|p| (*p as usize) < camera_pairs);
        camera_links.sort_unstable();
        camera_links.dedup();
        let running = |sizes: &mut dyn Iterator<Item = usize>| {
            let mut all = vec![0];
            let mut sum = 0;
            for s in sizes {
                sum += s;
                all.push(sum);
            }
            all
        };
        let diagonal_start = running(&mut (cameras..analysis.rows()).map(|i| analysis.size(i).pow(2)));
        let block = |p: &(u32, u32)| analysis.size(p.0 as usize) * analysis.size(p.1 as usize);
        let off_start = running(&mut pairs[camera_pairs..].iter().map(block));
        let analysis = Arc::new(analysis);
        Self { analysis, cameras, camera_pairs, row_start, camera_links, diagonal_start, off_start }
    }

    /// Index of the block of two rows, the first of higher place; that there is one is the caller's business.
    pub fn pair(&self, a: usize, b: usize) -> usize {
        let row = self.row_start[a] as usize..self.row_start[a + 1] as usize;
        row.start + self.analysis.pairs()[row].partition_point(|p| (p.1 as usize) < b)
    }

    /// First of a further variable's entries in gradients and steps.
    pub fn gradient_start(&self, row: usize) -> usize {
        self.analysis.offset(row) - self.analysis.offset(self.cameras.min(row))
    }
}

/// For each camera, the cameras of lower place that share a point with it, rising.
pub fn covisible(cameras: usize, ranges: &[Range<usize>], slots: &[Option<u32>]) -> Vec<Vec<u32>> {
    const FEW: usize = 256;
    let mut shared: Vec<Vec<u32>> = vec![Vec::new(); cameras];
    // Repeats are dropped whenever a list has doubled, so that memory stays near what is kept.
    let mut limits = vec![FEW; cameras];
    for range in ranges {
        let seen = &slots[range.clone()];
        for a in seen.iter().flatten() {
            let list = &mut shared[*a as usize];
            list.extend(seen.iter().flatten().filter(|b| *b < a));
            let limit = &mut limits[*a as usize];
            if list.len() > *limit {
                list.sort_unstable();
                list.dedup();
                *limit = FEW.max(2 * list.len());
            }
        }
    }
    for list in &mut shared {
        list.sort_unstable();
        list.dedup();
        list.shrink_to_fit();
    }
    shared
}

/// Index of the block of any two cameras, or zero without one.
pub fn table_of(pattern: &Pattern) -> Vec<u32> {
    let n = pattern.cameras;
    let mut table = vec![0; n * n];
    for (k, (a, b)) in pattern.analysis.pairs()[..pattern.camera_pairs].iter().enumerate() {
        table[*a as usize * n + *b as usize] = k as u32;
    }
    table
}
