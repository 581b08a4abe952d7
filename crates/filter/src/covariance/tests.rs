//! Both forms compared with dense algebra.

use super::*;
use nalgebra::DMatrix;

fn dense(c: &Covariance) -> DMatrix<f64> {
    DMatrix::from_vec(c.size(), c.size(), c.matrix())
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
fn filled(form: Form) -> Covariance {
    let mut c = Covariance::from_matrix(form, 3, spread(1).as_slice().to_vec());
    for k in 0..4 {
        c.augment(&rows(2, 0, &random3(20 + k)), &spread(40 + k));
    }
    c.augment(&rows(3, 0, &random3(60)), &spread(70));
    c
}

#[test]
fn motions_updates_growth_and_removal_are_those_of_dense_algebra() {
    for form in [Form::Joseph, Form::SquareRoot] {
        let mut c = filled(form);
        let n = c.size();
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
            assert!((dense(&c) - &expected).norm() < 1e-9 * expected.norm(), "{form:?}");

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
            assert!((dense(&c) - &after).norm() < 1e-9 * expected.norm(), "{form:?}");
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
        let again = Covariance::from_matrix(form, c.size(), c.matrix());
        assert!((dense(&again) - dense(&c)).norm() < 1e-9 * p.norm());
    }
}

#[test]
fn the_root_stays_right_where_the_plain_update_loses_its_digits() {
    // A very exact measurement of very uncertain variables: the variance of the sum is 1e-8, next to 1e8. The textbook
    // form P - K H P loses all digits of it; the square root keeps it.
    let start = Matrix3::from_diagonal_element(1e8);
    let h = Rows { rows: 1, blocks: vec![(0, 3, Matrix3::new(1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))] };
    let noise = Matrix3::from_diagonal_element(1e-8);
    let (sum, s) = (Matrix3::from_row_slice(&[1.0; 9]), 3e8 + 1e-8);
    let textbook: f64 = (start - start * sum * start / s).sum();
    assert!((textbook - 1e-8).abs() > 1e-9, "{textbook:e}: the test shows nothing");
    let mut c = Covariance::from_matrix(Form::SquareRoot, 3, start.as_slice().to_vec());
    c.update(&h, &[], &[], &noise);
    // The variance of the sum computed from the root itself: |S^T h|^2.
    let Covariance::SquareRoot(root) = &c else { panic!("a root stays a root") };
    let variance = root.variance_of(&h);
    assert!((variance - 1e-8).abs() < 1e-12, "{variance:e}");
}
