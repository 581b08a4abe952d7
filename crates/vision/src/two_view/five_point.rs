//! Essential matrices from five ray pairs.
//!
//! Nister, "An efficient solution to the five-point relative pose problem" (PAMI 2004): the four-dimensional null
//! space of the epipolar equations, ten cubic constraints, elimination to a polynomial of degree ten, its real roots.

use crate::roots::{null_space, real_roots};
use cairn_geometry::{Mat3, Vec3};

/// Linear form in x, y, z and 1.
type Linear = [f64; 4];
/// Quadratic form: products of two of x, y, z, 1.
type Quadratic = [f64; 10];
/// Cubic form: products of three, in the order of [`CUBIC`].
type Cubic = [f64; 20];

/// Index pairs of the quadratic monomials (0 is x, 1 is y, 2 is z, 3 is one).
const QUADRATIC: [[usize; 2]; 10] =
    [[0, 0], [0, 1], [0, 2], [0, 3], [1, 1], [1, 2], [1, 3], [2, 2], [2, 3], [3, 3]];

/// Cubic monomials in the order of the paper's elimination: x^3 y^3 x^2y xy^2 x^2z x^2 y^2z y^2 xyz xy, then those
/// of x, y and 1 with falling powers of z: xz^2 xz x, yz^2 yz y, z^3 z^2 z 1.
const CUBIC: [[usize; 3]; 20] = [
    [0, 0, 0],
    [1, 1, 1],
    [0, 0, 1],
    [0, 1, 1],
    [0, 0, 2],
    [0, 0, 3],
    [1, 1, 2],
    [1, 1, 3],
    [0, 1, 2],
    [0, 1, 3],
    [0, 2, 2],
    [0, 2, 3],
    [0, 3, 3],
    [1, 2, 2],
    [1, 2, 3],
    [1, 3, 3],
    [2, 2, 2],
    [2, 2, 3],
    [2, 3, 3],
    [3, 3, 3],
];

const LINEAR_LINEAR: [[usize; 4]; 4] = linear_linear();
const QUADRATIC_LINEAR: [[usize; 4]; 10] = quadratic_linear();

const fn linear_linear() -> [[usize; 4]; 4] {
    let mut table = [[0; 4]; 4];
    let mut m = 0;
    while m < 10 {
        let [i, j] = QUADRATIC[m];
        table[i][j] = m;
        table[j][i] = m;
        m += 1;
    }
    table
}

const fn quadratic_linear() -> [[usize; 4]; 10] {
    let mut table = [[0; 4]; 10];
    let mut q = 0;
    while q < 10 {
        let [i, j] = QUADRATIC[q];
        let mut k = 0;
        while k < 4 {
            // Sorts i <= j and k.
            let sorted = if k <= i {
                [k, i, j]
            } else if k <= j {
                [i, k, j]
            } else {
                [i, j, k]
            };
            let mut c = 0;
            while c < 20 {
                let [a, b, d] = CUBIC[c];
                if a == sorted[0] && b == sorted[1] && d == sorted[2] {
                    table[q][k] = c;
                }
                c += 1;
            }
            k += 1;
        }
        q += 1;
    }
    table
}

fn add_product(out: &mut Quadratic, a: &Linear, b: &Linear, sign: f64) {
    for i in 0..4 {
        for j in 0..4 {
            out[LINEAR_LINEAR[i][j]] += sign * a[i] * b[j];
        }
    }
}

fn add_cubic(out: &mut Cubic, a: &Quadratic, b: &Linear) {
    for (q, row) in QUADRATIC_LINEAR.iter().enumerate() {
        for (k, &c) in row.iter().enumerate() {
            out[c] += a[q] * b[k];
        }
    }
}

/// Calls `visit` with each of the at most ten essential matrices `E` with `second' * E * first = 0` for five pairs of
/// rays (of any length; unit length is best). Their Frobenius norm is the square root of two. None for degenerate rays.
pub fn five_point(first: &[Vec3; 5], second: &[Vec3; 5], mut visit: impl FnMut(Mat3)) {
    let mut rows = [[0.0; 9]; 5];
    for (row, (a, b)) in rows.iter_mut().zip(first.iter().zip(second)) {
        for i in 0..3 {
            for j in 0..3 {
                row[i * 3 + j] = b[i] * a[j];
            }
        }
    }
    let Some(basis) = null_space::<5, 9, 4>(rows) else { return };
    let entry = |i: usize, j: usize| -> Linear { std::array::from_fn(|k| basis[k][i * 3 + j]) };
    let e: [[Linear; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
    let Some(reduced) = eliminate(constraints(&e)) else { return };
    let (b, polynomial) = hidden_variable(&reduced);
    for &z in real_roots(&polynomial).as_slice() {
        let Some([x, y]) = back_substitute(&b, z) else { continue };
        let weights = [x, y, z, 1.0];
        let mut m = Mat3::zeros();
        for i in 0..3 {
            for j in 0..3 {
                m[(i, j)] = (0..4).map(|k| weights[k] * basis[k][i * 3 + j]).sum();
            }
        }
        m *= std::f64::consts::SQRT_2 / m.norm();
        // About one in a hundred samples is so badly conditioned that rounding corrupts the root; also drops NaN.
        let square = m * m.transpose();
        if (square * m - m * (0.5 * square.trace())).norm() < 1e-3 {
            visit(m);
        }
    }
}

/// The nine equations `(E E' - trace(E E') / 2) E = 0` and `det E = 0`.
fn constraints(e: &[[Linear; 3]; 3]) -> [Cubic; 10] {
    let mut square = [[[0.0; 10]; 3]; 3];
    for i in 0..3 {
        for j in i..3 {
            for k in 0..3 {
                add_product(&mut square[i][j], &e[i][k], &e[j][k], 1.0);
            }
            square[j][i] = square[i][j];
        }
    }
    let half_trace: Quadratic =
        std::array::from_fn(|q| 0.5 * (square[0][0][q] + square[1][1][q] + square[2][2][q]));
    for (i, row) in square.iter_mut().enumerate() {
        for (v, t) in row[i].iter_mut().zip(&half_trace) {
            *v -= t;
        }
    }
    let mut out = [[0.0; 20]; 10];
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                add_cubic(&mut out[i * 3 + j], &square[i][k], &e[k][j]);
            }
        }
    }
    for j in 0..3 {
        let (k, l) = ((j + 1) % 3, (j + 2) % 3);
        let mut minor = [0.0; 10];
        add_product(&mut minor, &e[1][k], &e[2][l], 1.0);
        add_product(&mut minor, &e[1][l], &e[2][k], -1.0);
        add_cubic(&mut out[9], &minor, &e[0][j]);
    }
    out
}

/// Gauss-Jordan elimination of the first ten columns with partial pivoting.
fn eliminate(mut a: [Cubic; 10]) -> Option<[Cubic; 10]> {
    for c in 0..10 {
        let pivot = (c..10).max_by(|&i, &j| a[i][c].abs().total_cmp(&a[j][c].abs()))?;
        a.swap(c, pivot);
        // Also true for NaN.
        if !(a[c][c].abs() > 1e-14) {
            return None;
        }
        let row = a[c].map(|v| v / a[c][c]);
        a[c] = row;
        for (r, other) in a.iter_mut().enumerate() {
            if r != c {
                let factor = other[c];
                for (v, p) in other[c..].iter_mut().zip(&row[c..]) {
                    *v -= factor * p;
                }
            }
        }
    }
    Some(a)
}

/// A polynomial in z, rising powers.
type InZ = [f64; 5];

/// The 3x3 matrix of polynomials in z whose null vector is (x, y, 1), and its determinant (Nister's equations 13 to
/// 25).
fn hidden_variable(a: &[Cubic; 10]) -> ([[InZ; 3]; 3], [f64; 11]) {
    // Rows of x^2 z and x^2, y^2 z and y^2, xyz and xy: the first minus z times the second.
    let b: [[InZ; 3]; 3] = [[4, 5], [6, 7], [8, 9]].map(|[with_z, without]| {
        let (p, q) = (&a[with_z], &a[without]);
        let three = |at: usize| {
            [p[at + 2], p[at + 1] - q[at + 2], p[at] - q[at + 1], -q[at], 0.0] // rising powers of z
        };
        let four = [p[19], p[18] - q[19], p[17] - q[18], p[16] - q[17], -q[16]];
        [three(10), three(13), four]
    });
    let mut determinant = [0.0; 11];
    for (j, k, l) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
        let mut minor = [0.0; 9];
        for s in 0..5 {
            for t in 0..5 {
                minor[s + t] += b[1][k][s] * b[2][l][t] - b[1][l][s] * b[2][k][t];
            }
        }
        for (s, p) in b[0][j].iter().enumerate() {
            for (t, m) in minor.iter().enumerate() {
                // Products beyond degree ten are zero: the x and y columns have degree three.
                if s + t < 11 {
                    determinant[s + t] += p * m;
                }
            }
        }
    }
    (b, determinant)
}

/// x and y for a root z: the null vector of the matrix, as the cross product of the best conditioned pair of rows.
fn back_substitute(b: &[[InZ; 3]; 3], z: f64) -> Option<[f64; 2]> {
    let rows =
        b.map(|row| Vec3::from(row.map(|p: InZ| p.iter().rev().fold(0.0, |sum, c| sum * z + c))).normalize());
    let mut best = Vec3::zeros();
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        let v = rows[i].cross(&rows[j]);
        if v.norm_squared() > best.norm_squared() {
            best = v;
        }
    }
    (best.z.abs() > 1e-12 * best.norm() && best.norm() > 0.0).then(|| [best.x / best.z, best.y / best.z])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::triangulate::essential;
    use cairn_geometry::{Se3, So3};
    use cairn_random::Random;

    #[test]
    fn true_motion_is_among_the_solutions() {
        let mut rng = Random::new(11);
        let (mut missed, mut solutions) = (0, 0);
        for trial in 0..500 {
            let t = Se3::new(
                So3::exp(
                    &(Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * 0.2),
                ),
                Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()).normalize(),
            );
            // Every other scene is a plane.
            let p: [Vec3; 5] = std::array::from_fn(|_| {
                let (x, y) = (rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0));
                let z = if trial % 2 == 0 { rng.uniform(3.0, 9.0) } else { 5.0 + 0.8 * x - 0.5 * y };
                Vec3::new(x * 2.0, y * 2.0, z)
            });
            let first = p.map(|p| p.normalize());
            let second = p.map(|p| (t * p).normalize());
            let truth = essential(&t);
            let mut best = f64::INFINITY;
            five_point(&first, &second, |e| {
                solutions += 1;
                best = best.min((e - truth).norm()).min((e + truth).norm());
                // Each is essential: two equal singular values and a zero one.
                let s = e.singular_values();
                assert!((s[0] - s[1]).abs() < 0.01 && s[2] < 0.01, "{s}");
                for (a, b) in first.iter().zip(&second) {
                    assert!(b.dot(&(e * a)).abs() < 1e-6);
                }
            });
            if best > 1e-4 {
                missed += 1;
            }
        }
        println!("{missed} of 500 missed, {:.2} solutions each", solutions as f64 / 500.0);
        assert!(missed <= 15, "{missed}");
    }

    #[test]
    fn degenerate_rays_give_no_solution() {
        five_point(&[Vec3::z(); 5], &[Vec3::z(); 5], |_| panic!("one ray five times"));
        five_point(&[Vec3::repeat(f64::NAN); 5], &[Vec3::z(); 5], |_| panic!("not a number"));
    }
}
