//! nonlinear least squares: robust losses, Schur complement, Cholesky, RANSAC.
