//! Compared with dense algebra.

use super::*;
use nalgebra::DMatrix;

fn dense(c: &Covariance) -> DMatrix<f64> {
    DMatrix::from_vec(c.n, c.n, c.matrix().to_vec())
}

fn wide(n: usize, h: &Rows) -> DMatrix<f64> {
    let mut m = DMatrix::zeros(h.rows, n);
    for (at, width, values) in &h.blocks {
        for r in 0..h.rows {
            for k in 0..*width {
                m[(r, at + k)] += values[(r, k)];
            }
        }
    }
    m
}

fn number(k: usize) -> f64 {
    ((k * 37 + 11) as f64 * 0.731).sin()
}

fn random3(seed: usize) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| number(seed + 3 * i + j))
}

fn spread(seed: usize) -> Matrix3<f64> {
    let m = random3(seed);
    m * m.transpose() + Matrix3::identity() * 0.01
}

fn rows(rows: usize, at: usize, values: &Matrix3<f64>) -> Rows {
    Rows { rows, blocks: vec![(at, 3, *values)] }
}

/// A pose, four landmarks, a second pose.
fn filled() -> Covariance {
    let mut c = Covariance::from_matrix(3, spread(1).as_slice().to_vec());
    for k in 0..4 {
        c.augment(&rows(2, 0, &random3(20 + k)), &spread(40 + k));
    }
    c.augment(&rows(3, 0, &random3(60)), &spread(70));
    c
}

#[test]
fn motions_updates_growth_and_removal_are_those_of_dense_algebra() {
    let mut c = filled();
    let n = c.n;
    assert_eq!(n, 14);
    for round in 0..30 {
        let p = dense(&c);
        let at = if round % 2 == 0 { 0 } else { 11 };
        let f = Matrix3::new(1.0, 0.0, number(round), 0.0, 1.0, number(round + 5), 0.0, 0.0, 1.0);
        let mut big = DMatrix::identity(n, n);
        big.fixed_view_mut::<3, 3>(at, at).copy_from(&f);
        let mut expected = &big * &p * big.transpose();
        let mut own = expected.fixed_view_mut::<3, 3>(at, at);
        own += spread(round) * 0.1;
        c.predict(at, &f, &(spread(round) * 0.1));
        assert!((dense(&c) - &expected).norm() < 1e-9 * expected.norm());

        let rows = 1 + round % 3;
        let cut = |m: Matrix3<f64>, w: usize| {
            Matrix3::from_fn(|i, j| if i < rows && j < w { m[(i, j)] } else { 0.0 })
        };
        let blocks =
            vec![(at, 3, cut(random3(round), 3)), (3 + 2 * (round % 4), 2, cut(random3(round + 9), 2))];
        let h = Rows { rows, blocks };
        let (r, w) = (spread(round + 3), wide(n, &h));
        let noise = DMatrix::from_fn(rows, rows, |i, j| r[(i, j)]);
        let cross = c.cross(&h);
        let innovation = &w * &expected * w.transpose() + noise;
        let gain = &expected * w.transpose() * innovation.clone().try_inverse().unwrap();
        assert!((DMatrix::from_column_slice(n, rows, &cross) - &expected * w.transpose()).norm() < 1e-9);
        c.update(&h, &cross, gain.as_slice(), &r);
        let after = &expected - &gain * innovation * gain.transpose();
        assert!((dense(&c) - &after).norm() < 1e-9 * expected.norm());
    }
    let p = dense(&c);
    let d: Vec<f64> = (0..n).map(|k| if k == 2 { 0.0 } else { number(k) }).collect();
    let mut shear = DMatrix::identity(n, n);
    shear.column_mut(2).iter_mut().zip(&d).for_each(|(s, d)| *s += d);
    c.shear(&d, 2);
    let expected = &shear * &p * shear.transpose();
    assert!((dense(&c) - &expected).norm() < 1e-9 * expected.norm());
    let p = expected;
    c.remove(5, 2);
    let kept = p.clone().remove_rows(5, 2).remove_columns(5, 2);
    assert!((dense(&c) - kept).norm() < 1e-10 * p.norm());
}
