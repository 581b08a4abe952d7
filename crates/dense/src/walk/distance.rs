//! The exact Euclidean distance of each cell of a box to the nearest occupied one.
//!
//! Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions" (Theory of Computing 2012), section 2:
//! lower envelopes of parabolas, one axis after the other; linear in the number of cells.

/// Distances in metres, in the order of the cells (x fastest, then y, then z); infinite when none is occupied. `None`
/// when the count of cells is not the product of the sizes.
pub fn distance_field(occupied: &[bool], size: [usize; 3], cell_m: f64) -> Option<Vec<f32>> {
    let count = size.iter().try_fold(1usize, |n, &s| n.checked_mul(s))?;
    if occupied.len() != count {
        return None;
    }
    let mut squares: Vec<f64> = occupied.iter().map(|&o| if o { 0.0 } else { f64::INFINITY }).collect();
    let strides = [1, size[0], size[0] * size[1]];
    let mut line = Line::default();
    for axis in 0..3 {
        let (n, stride) = (size[axis], strides[axis]);
        for start in (0..count).filter(|i| (i / stride) % n == 0) {
            line.transform(&mut squares, start, stride, n);
        }
    }
    Some(squares.into_iter().map(|s| (s.sqrt() * cell_m) as f32).collect())
}

/// Working memory for one line of cells.
#[derive(Default)]
struct Line {
    from: Vec<f64>,
    /// Cells whose parabolas form the lower envelope, and where each begins.
    roots: Vec<usize>,
    begins: Vec<f64>,
}

impl Line {
    fn transform(&mut self, values: &mut [f64], start: usize, stride: usize, n: usize) {
        self.from.clear();
        self.from.extend((0..n).map(|i| values[start + i * stride]));
        self.roots.clear();
        self.begins.clear();
        for q in (0..n).filter(|&q| self.from[q].is_finite()) {
            let mut begin = f64::NEG_INFINITY;
            while let (Some(&p), Some(&at)) = (self.roots.last(), self.begins.last()) {
                let (fp, fq) = (self.from[p] + (p * p) as f64, self.from[q] + (q * q) as f64);
                begin = (fq - fp) / (2 * (q - p)) as f64;
                if begin > at {
                    break;
                }
                self.roots.pop();
                self.begins.pop();
                begin = f64::NEG_INFINITY;
            }
            self.roots.push(q);
            self.begins.push(begin);
        }
        let mut k = 0;
        for i in 0..n {
            while k + 1 < self.roots.len() && self.begins[k + 1] < i as f64 {
                k += 1;
            }
            if let Some(&q) = self.roots.get(k) {
                values[start + i * stride] = (i as f64 - q as f64).powi(2) + self.from[q];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_those_of_a_search(cells in proptest::collection::vec(prop::bool::weighted(0.06), 9 * 7 * 5)) {
            let size = [9, 7, 5];
            let at = |i: usize| [i % 9, i / 9 % 7, i / 63].map(|v| v as f64);
            let field = distance_field(&cells, size, 0.5).expect("as many cells");
            for (i, &d) in field.iter().enumerate() {
                let square = |j: usize| (0..3).map(|k| (at(i)[k] - at(j)[k]).powi(2)).sum::<f64>();
                let truth = (0..cells.len()).filter(|&j| cells[j]).map(square).fold(f64::INFINITY, f64::min);
                prop_assert!((f64::from(d) - truth.sqrt() * 0.5).abs() < 1e-5 || (d.is_infinite() && truth.is_infinite()));
            }
        }
    }

    #[test]
    fn sizes_must_fit() {
        assert_eq!(distance_field(&[true; 4], [2, 2, 2], 1.0), None);
        assert_eq!(distance_field(&[], [0, 2, 2], 1.0), Some(Vec::new()));
    }
}
