//! The covariance of a state that grows and shrinks, in one of two forms: the matrix itself, updated in Joseph form, or
//! its triangular square root.

mod joseph;
mod root;

pub use joseph::Joseph;
pub use root::SquareRoot;

use nalgebra::Matrix3;

/// The form in which the covariance is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// The matrix, updated as `(I - K H) P (I - K H)^T + K R K^T` (Bucy and Joseph, 1968).
    #[default]
    Joseph,
    /// A lower triangular `S` with `P = S S^T`: rounding costs half as many digits (Bierman, "Factorization methods",
    /// 1977).
    SquareRoot,
}

/// Up to three rows of a measurement's Jacobian: a few 3-column blocks, each with its position in the state. Rows past
/// `rows`, and columns past the width of a block, are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// Number of rows.
    pub rows: usize,
    /// First column, number of columns, and values of each block.
    pub blocks: Vec<(usize, usize, Matrix3<f64>)>,
}

impl Rows {
    /// The product of one row and a vector as long as the state.
    pub fn row_times(&self, row: usize, vector: &[f64]) -> f64 {
        let of = |(at, width, values): &(usize, usize, Matrix3<f64>)| -> f64 {
            vector[*at..at + width].iter().enumerate().map(|(k, v)| values[(row, k)] * v).sum()
        };
        self.blocks.iter().map(of).sum()
    }
}

/// A covariance in one of the forms.
#[derive(Clone, Debug, PartialEq)]
pub enum Covariance {
    /// The matrix itself.
    Joseph(Joseph),
    /// Its square root.
    SquareRoot(SquareRoot),
}

macro_rules! both {
    ($self:ident, $inner:ident => $call:expr) => {
        match $self {
            Covariance::Joseph($inner) => $call,
            Covariance::SquareRoot($inner) => $call,
        }
    };
}

impl Covariance {
    /// The covariance of an empty state.
    pub fn new(form: Form) -> Self {
        match form {
            Form::Joseph => Self::Joseph(Joseph::default()),
            Form::SquareRoot => Self::SquareRoot(SquareRoot::default()),
        }
    }

    /// From a symmetric positive semi-definite matrix of `n` rows, in column-major order.
    pub fn from_matrix(form: Form, n: usize, matrix: Vec<f64>) -> Self {
        match form {
            Form::Joseph => Self::Joseph(Joseph::from_matrix(n, matrix)),
            Form::SquareRoot => Self::SquareRoot(SquareRoot::from_matrix(n, matrix)),
        }
    }

    /// Size of the state.
    pub fn size(&self) -> usize {
        both!(self, c => c.size())
    }

    /// One entry.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        both!(self, c => c.at(row, column))
    }

    /// The block of this height and width, at most 3, at a row and a column; entries beyond are zero.
    pub fn block(&self, row: usize, height: usize, column: usize, width: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| if i < height && j < width { self.at(row + i, column + j) } else { 0.0 })
    }

    /// The whole matrix in column-major order.
    pub fn matrix(&self) -> Vec<f64> {
        let n = self.size();
        let mut values = Vec::with_capacity(n * n);
        for column in 0..n {
            values.extend((0..n).map(|row| self.at(row, column)));
        }
        values
    }

    /// `P H^T`, in column-major order.
    pub fn cross(&self, h: &Rows) -> Vec<f64> {
        both!(self, c => c.cross(h))
    }

    /// Propagates the pose at `at`: `P = F P F^T + Q`, where `f` and `q` are the blocks of the pose; elsewhere `F` is
    /// the identity and `Q` is zero. `F` is upper triangular.
    pub fn predict(&mut self, at: usize, f: &Matrix3<f64>, q: &Matrix3<f64>) {
        both!(self, c => c.predict(at, f, q));
    }

    /// Updates by a measurement: `gain` and `cross` (`P H^T`) in column-major order, `noise` its covariance.
    pub fn update(&mut self, h: &Rows, cross: &[f64], gain: &[f64], noise: &Matrix3<f64>) {
        match self {
            Self::Joseph(c) => c.update(h, cross, gain, noise),
            Self::SquareRoot(c) => c.update(h, noise),
        }
    }

    /// Adds `d` times the variable at `at` to all: `P = (I + d e^T) P (I + d e^T)^T`, where `d` is zero at `at` itself.
    ///
    /// In the square-root form `at` must be the third variable: the heading of the first pose.
    pub fn shear(&mut self, d: &[f64], at: usize) {
        both!(self, c => c.shear(d, at));
    }

    /// Appends as many variables (2 or 3) as `g` has rows: `G` times the present state, plus independent noise.
    pub fn augment(&mut self, g: &Rows, noise: &Matrix3<f64>) {
        both!(self, c => c.augment(g, noise));
    }

    /// Removes `size` variables from `at` on.
    pub fn remove(&mut self, at: usize, size: usize) {
        both!(self, c => c.remove(at, size));
    }
}

/// A lower triangular root of a symmetric positive semi-definite matrix; directions without variance give zero columns.
fn root3(m: &Matrix3<f64>) -> Matrix3<f64> {
    let mut l = Matrix3::zeros();
    for j in 0..3 {
        let d = m[(j, j)] - (0..j).map(|k| l[(j, k)] * l[(j, k)]).sum::<f64>();
        if d <= 1e-14 * m[(j, j)].abs() {
            continue;
        }
        l[(j, j)] = d.sqrt();
        for i in j + 1..3 {
            let v = m[(i, j)] - (0..j).map(|k| l[(i, k)] * l[(j, k)]).sum::<f64>();
            l[(i, j)] = v / l[(j, j)];
        }
    }
    l
}

#[cfg(test)]
mod tests;
