//! Exact Euclidean distance from every cell to the nearest obstacle cell, as whole squared distances in cells.
//!
//! Two passes: columns by counting, rows by the lower envelope of parabolas (Felzenszwalb and Huttenlocher, "Distance
//! Transforms of Sampled Functions", 2012, section 2.1; Meijster, Roerdink and Hesselink 2000 for the whole numbers).
//! Rows are cut at obstacles, since nothing beyond an obstacle can be nearer than it. Of a row's parabolas, only those
//! are used that are lower than both neighbours' anywhere except at their own cell, whose value is already known.
//!
//! [`DistanceField::update`] repairs the field after a few cells changed: the columns of those cells are counted again,
//! and the rows in which a count changed are computed again. The result is bit-identical to that of a full computation.

use crate::grid::{Cell, Grid, GridFrame};
use cairn_geometry::Vec2;

/// Squared distance where the grid holds no obstacle at all.
pub const NO_OBSTACLE: u32 = u32::MAX;
/// Count of a column without an obstacle: no grid has a side this long.
const FAR: u16 = 1 << 15;

/// Distance to the nearest obstacle, for each cell.
#[derive(Clone, Debug)]
pub struct DistanceField {
    frame: GridFrame,
    /// Distance in cells to the nearest obstacle of the same column, [`FAR`] or more where there is none.
    counts: Vec<u16>,
    squared: Vec<u32>,
    scratch: Scratch,
}

/// Working memory for one row.
#[derive(Clone, Debug, Default)]
struct Scratch {
    /// Cells whose parabola may matter, one bit each.
    sites: Vec<u64>,
    envelope: Vec<Parabola>,
}

/// A parabola of the lower envelope; it is the lowest one from `from` on.
#[derive(Clone, Copy, Debug)]
struct Parabola {
    at: i32,
    from: i32,
    height: u32,
}

impl DistanceField {
    /// From a grid that is true at obstacles.
    pub fn new(obstacles: &Grid<bool>) -> Self {
        let frame = *obstacles.frame();
        let mut field =
            Self { frame, counts: Vec::new(), squared: vec![0; frame.len()], scratch: Scratch::default() };
        field.recompute(obstacles.values());
        field
    }

    /// Computes everything again, without new memory: `obstacles` row by row, one value for each cell of the grid.
    ///
    /// Does nothing when the number of values is wrong.
    pub fn recompute(&mut self, obstacles: &[bool]) {
        let (width, height) = (self.frame.width(), self.frame.height());
        if obstacles.len() != width * height {
            return;
        }
        self.counts.clear();
        self.counts.extend(obstacles.iter().map(|&o| if o { 0 } else { FAR }));
        for y in 1..height {
            let (above, row) = self.counts.split_at_mut(y * width);
            carry(&mut row[..width], &above[(y - 1) * width..]);
        }
        for y in (0..height - 1).rev() {
            let (row, below) = self.counts.split_at_mut((y + 1) * width);
            carry(&mut row[y * width..], &below[..width]);
        }
        for (counts, squared) in self.counts.chunks_exact(width).zip(self.squared.chunks_exact_mut(width)) {
            row_distances(counts, squared, &mut self.scratch);
        }
    }

    /// Repairs the field after the cells `changed` of `obstacles` became or ceased to be obstacles. Returns the rows
    /// that had to be computed again. Cells outside are ignored; changes of cells that are not listed are not noticed.
    pub fn update(&mut self, obstacles: &Grid<bool>, changed: &[Cell]) -> Vec<usize> {
        let (width, height) = (self.frame.width(), self.frame.height());
        if obstacles.frame() != &self.frame {
            self.frame = *obstacles.frame();
            self.squared = vec![0; self.frame.len()];
            self.recompute(obstacles.values());
            return (0..self.frame.height()).collect();
        }
        let mut columns: Vec<usize> = changed.iter().map(|c| c.x as usize).filter(|&x| x < width).collect();
        columns.sort_unstable();
        columns.dedup();
        let mut stale = vec![false; height];
        let mut column = vec![0; height];
        for x in columns {
            count_column(&mut column, |y| obstacles.values()[y * width + x]);
            for (y, &count) in column.iter().enumerate() {
                let old = &mut self.counts[y * width + x];
                stale[y] |= *old != count;
                *old = count;
            }
        }
        let rows: Vec<usize> = (0..height).filter(|&y| stale[y]).collect();
        for &y in &rows {
            let row = y * width..(y + 1) * width;
            row_distances(&self.counts[row.clone()], &mut self.squared[row], &mut self.scratch);
        }
        rows
    }

    /// Size, resolution and pose of the grid.
    pub fn frame(&self) -> &GridFrame {
        &self.frame
    }

    /// Squared distances between cell centres, in cells, row by row; [`NO_OBSTACLE`] in a grid without any.
    pub fn squared(&self) -> &[u32] {
        &self.squared
    }

    /// Distance in metres from the centre of a cell to the centre of the nearest obstacle cell: 0 on an obstacle,
    /// infinite where there is none; `None` outside.
    pub fn distance_m(&self, cell: Cell) -> Option<f64> {
        let squared = self.frame.index(cell).map(|i| self.squared[i])?;
        Some(if squared == NO_OBSTACLE {
            f64::INFINITY
        } else {
            f64::from(squared).sqrt() * self.frame.resolution_m()
        })
    }

    /// A lower bound of the distance in metres from a point (metres, world) to the nearest obstacle: the distance from
    /// the centre of its cell, less the distance to that centre and half the diagonal of the obstacle's cell. 0
    /// outside, on obstacles and for NaN.
    pub fn clearance_m(&self, point: Vec2) -> f64 {
        let cells = self.frame.in_cells(point);
        let Some(cell) = self.frame.cell_at(point) else { return 0.0 };
        let (dx, dy) = (cells.x - f64::from(cell.x) - 0.5, cells.y - f64::from(cell.y) - 0.5);
        let slack = (dx.hypot(dy) + std::f64::consts::FRAC_1_SQRT_2) * self.frame.resolution_m();
        (self.distance_m(cell).unwrap_or(0.0) - slack).max(0.0)
    }

    /// Distance in metres from a point (metres, world) to the square of the nearest obstacle cell, searched among all
    /// cells near enough: exact, and slower than [`DistanceField::clearance_m`]. 0 outside, on obstacles and for NaN.
    pub fn distance_to_square_m(&self, point: Vec2) -> f64 {
        let (p, res) = (self.frame.in_cells(point), self.frame.resolution_m());
        let Some(cell) = self.frame.cell_at(point) else { return 0.0 };
        let to_middle = self.distance_m(cell).unwrap_or(0.0) / res;
        if !to_middle.is_finite() {
            return f64::INFINITY;
        }
        // The centre of the nearest square is no farther than this.
        let reach = to_middle.ceil() as i64 + 2;
        let (width, height) = (self.frame.width() as i64, self.frame.height() as i64);
        let (cx, cy) = (i64::from(cell.x), i64::from(cell.y));
        let gap = |p: f64, from: i64| (from as f64 - p).max(p - from as f64 - 1.0).max(0.0);
        let mut least = f64::INFINITY;
        for y in (cy - reach).max(0)..(cy + reach + 1).min(height) {
            let dy = gap(p.y, y);
            for x in (cx - reach).max(0)..(cx + reach + 1).min(width) {
                if self.squared[(y * width + x) as usize] == 0 {
                    least = least.min(dy.hypot(gap(p.x, x)));
                }
            }
        }
        least * res
    }

    /// The cells whose distance is at least `radius_m`: where a disc of that radius fits around the centre of a cell,
    /// measured to the centres of obstacle cells. Obstacles themselves are never among them.
    pub fn at_least(&self, radius_m: f64) -> Grid<bool> {
        let least = least_squared(radius_m, self.frame.resolution_m());
        let values = self.squared.iter().map(|&s| s >= least).collect();
        Grid::from_values(self.frame, values).unwrap_or_else(|_| Grid::filled(self.frame, false))
    }
}

/// Least squared distance in cells that is not below the radius; at least 1, since a free cell has no less.
pub(crate) fn least_squared(radius_m: f64, resolution_m: f64) -> u32 {
    let cells = radius_m / resolution_m;
    // A radius that is a whole number of cells must not be missed by a rounding error.
    ((cells * cells - 1e-9).ceil().max(1.0)) as u32
}

/// Continues the counts from the adjacent row.
#[inline]
fn carry(row: &mut [u16], beside: &[u16]) {
    row.iter_mut().zip(beside).for_each(|(c, &n)| *c = (*c).min(n.saturating_add(1)));
}

/// The counts of one column, equal to those of the row-wise passes.
fn count_column(counts: &mut [u16], obstacle: impl Fn(usize) -> bool) {
    let mut last = FAR;
    for (y, count) in counts.iter_mut().enumerate() {
        let here = if obstacle(y) { 0 } else { FAR };
        last = if y == 0 { here } else { here.min(last.saturating_add(1)) };
        *count = last;
    }
    for y in (0..counts.len().saturating_sub(1)).rev() {
        counts[y] = counts[y].min(counts[y + 1].saturating_add(1));
    }
}

/// Squared distances of a row from its column counts.
fn row_distances(counts: &[u16], squared: &mut [u32], scratch: &mut Scratch) {
    for (s, &c) in squared.iter_mut().zip(counts) {
        *s = if c >= FAR { NO_OBSTACLE } else { u32::from(c) * u32::from(c) };
    }
    mark_sites(counts, &mut scratch.sites);
    let envelope = &mut scratch.envelope;
    envelope.clear();
    // The start of the current run of free cells, if any.
    let mut run = (counts[0] != 0).then_some(0i32);
    for (k, &word) in scratch.sites.iter().enumerate() {
        let mut bits = word;
        while bits != 0 {
            let at = k * 64 + bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let count = u32::from(counts[at]);
            if count != 0 {
                push(envelope, at as i32, count * count, run.unwrap_or(0));
                continue;
            }
            if let Some(from) = run.take() {
                push(envelope, at as i32, 0, from);
                fill(envelope, squared, at);
            }
            envelope.clear();
            if counts.get(at + 1).is_some_and(|&next| next != 0) {
                run = Some(at as i32 + 1);
                envelope.push(Parabola { at: at as i32, from: at as i32 + 1, height: 0 });
            }
        }
    }
    if run.is_some() {
        fill(envelope, squared, counts.len());
    }
}

/// Whether a parabola may matter, judged by the counts of its cell and of the two beside it.
///
/// With heights `f`, `a = f(left) - f` and `b = f(right) - f`, it is below both neighbours' between `-(a + 1) / 2` and
/// `(b + 1) / 2`, relative to its cell. If the only whole number there is 0, it matters at its own cell only. The ends
/// of obstacles are marked too: they cut the row.
#[inline(always)]
fn is_site(left: u16, here: u16, right: u16) -> bool {
    let height = |count: u16| i32::from(count.min(FAR)).pow(2);
    let (a, b) = (height(left) - height(here), height(right) - height(here));
    let wins = here < FAR && a > -2 - b && (a > 1 || b > 1);
    wins | (here == 0 && (left | right) != 0)
}

/// Marks the cells of [`is_site`], one bit each.
#[inline(always)]
fn mark_sites(counts: &[u16], sites: &mut Vec<u64>) {
    sites.clear();
    sites.resize(counts.len().div_ceil(64), 0);
    let last = counts.len() - 1;
    let mut flags = [0u8; 64];
    for (k, word) in sites.iter_mut().enumerate() {
        let from = k * 64;
        if from > 0 && from + 65 <= counts.len() {
            let window = &counts[from - 1..from + 65];
            for (i, flag) in flags.iter_mut().enumerate() {
                *flag = u8::from(is_site(window[i], window[i + 1], window[i + 2]));
            }
            *word = flags.chunks_exact(8).enumerate().fold(0, |word, (i, eight)| {
                let eight = eight.first_chunk::<8>().map_or(0, |e| u64::from_le_bytes(*e));
                word | (eight.wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * i)
            });
        } else {
            for at in from..counts.len().min(from + 64) {
                // Beyond the ends there is no obstacle.
                let left = if at == 0 { FAR } else { counts[at - 1] };
                let right = if at == last { FAR } else { counts[at + 1] };
                *word |= u64::from(is_site(left, counts[at], right)) << (at - from);
            }
        }
    }
}

/// Adds the parabola of a site to the right of all others; `run` is the first cell that may be filled.
#[inline(always)]
fn push(envelope: &mut Vec<Parabola>, at: i32, height: u32, run: i32) {
    let mut from = run;
    while let Some(top) = envelope.last() {
        // Equation (1) of the paper, times 2 (at - top.at).
        let rise = i64::from(height) - i64::from(top.height);
        let gap = i64::from(at - top.at);
        let numerator = rise + gap * i64::from(at + top.at);
        from = if numerator < 0 { run } else { (numerator as f64 / (2 * gap) as f64) as i32 + 1 };
        if from > top.from {
            break;
        }
        envelope.pop();
        from = run;
    }
    envelope.push(Parabola { at, from: from.max(run), height });
}

/// Writes the envelope into the row up to `to`, where it is below the value already there.
#[inline(always)]
fn fill(envelope: &[Parabola], squared: &mut [u32], to: usize) {
    for (k, parabola) in envelope.iter().enumerate() {
        let end = envelope.get(k + 1).map_or(to, |next| (next.from as usize).min(to));
        let begin = parabola.from as usize;
        if begin >= end {
            continue;
        }
        for (x, s) in squared[begin..end].iter_mut().enumerate() {
            let gap = (begin + x) as i32 - parabola.at;
            *s = (*s).min((gap * gap) as u32 + parabola.height);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squared distances by brute force: every obstacle from every cell.
    fn by_all_pairs(obstacles: &Grid<bool>) -> Vec<u32> {
        let frame = obstacles.frame();
        let cells: Vec<Cell> =
            (0..frame.len()).filter(|&i| obstacles.values()[i]).map(|i| frame.cell(i)).collect();
        let to = |c: Cell, o: &Cell| c.x.abs_diff(o.x).pow(2) + c.y.abs_diff(o.y).pow(2);
        (0..frame.len())
            .map(|i| cells.iter().map(|o| to(frame.cell(i), o)).min().unwrap_or(NO_OBSTACLE))
            .collect()
    }

    fn random_grid(random: &mut cairn_random::Random) -> Grid<bool> {
        let (w, h) = (1 + random.below(150), 1 + random.below(60));
        let density = [0.0, 0.002, 0.02, 0.2, 0.6, 0.97][random.below(6)];
        let frame = GridFrame::unit(w, h).unwrap();
        let mut grid = Grid::filled(frame, false);
        grid.values_mut().iter_mut().for_each(|v| *v = random.chance(density));
        grid
    }

    #[test]
    fn equal_to_looking_at_every_obstacle() {
        let mut random = cairn_random::Random::new(1);
        for _ in 0..400 {
            let grid = random_grid(&mut random);
            assert!(DistanceField::new(&grid).squared() == by_all_pairs(&grid), "{:?}", grid.frame());
        }
    }

    #[test]
    fn an_update_is_equal_to_computing_everything() {
        let mut random = cairn_random::Random::new(2);
        for _ in 0..100 {
            let mut grid = random_grid(&mut random);
            let mut field = DistanceField::new(&grid);
            for _ in 0..5 {
                let changed: Vec<Cell> = (0..random.below(6))
                    .map(|_| grid.frame().cell(random.below(grid.frame().len())))
                    .collect();
                changed.iter().for_each(|&c| {
                    grid.set(c, random.chance(0.5));
                });
                field.update(&grid, &changed);
                assert!(field.squared() == DistanceField::new(&grid).squared());
            }
        }
    }

    #[test]
    fn clearance_is_never_more_than_it_is() {
        let mut random = cairn_random::Random::new(3);
        let frame = GridFrame::new(40, 30, 0.05, cairn_geometry::Se2::from_xy_angle(1.0, -2.0, 0.3)).unwrap();
        let mut grid = Grid::filled(frame, false);
        (0..9).for_each(|_| {
            grid.set(frame.cell(random.below(frame.len())), true);
        });
        let field = DistanceField::new(&grid);
        for _ in 0..2000 {
            let at = Vec2::new(random.uniform(0.0, 40.0), random.uniform(0.0, 30.0));
            let point = frame.world_from_grid() * (at * 0.05);
            let to_square = |i: usize| {
                let c = frame.cell(i);
                let outside =
                    |p: f64, from: u32| (f64::from(from) - p).max(p - f64::from(from) - 1.0).max(0.0);
                outside(at.x, c.x).hypot(outside(at.y, c.y)) * 0.05
            };
            let truth =
                (0..frame.len()).filter(|&i| grid.values()[i]).map(to_square).fold(f64::INFINITY, f64::min);
            let told = field.clearance_m(point);
            assert!(told <= truth + 1e-12, "{told} m told, {truth} m true");
            assert!(truth - told < 0.1 + 1e-12, "{told} m told, {truth} m true");
            let exact = field.distance_to_square_m(point);
            assert!((exact - truth).abs() < 1e-12, "{exact} m told, {truth} m true");
        }
        assert_eq!(field.clearance_m(Vec2::new(f64::NAN, 0.0)), 0.0);
        assert_eq!(field.clearance_m(Vec2::new(100.0, 0.0)), 0.0);
    }
}
