//! Logarithm and exponential of a complex matrix.
//!
//! The logarithm is that of the triangular Schur factor: square roots until it is near the identity, then the Padé approximant
//! as a Gauss quadrature. References: N. J. Higham, *Functions of Matrices*, SIAM 2008, sections 6.2, 10.3 and 11.5;
//! L. Dieci, B. Morini, A. Papini, SIAM J. Matrix Anal. Appl. 17 (1996) (quadrature).

use nalgebra::{DMatrix, Schur};

use super::Complex;
use super::gauss::Gauss;
use crate::error::{Error, Result};

/// Distance from the identity at which twelve quadrature nodes give the logarithm to rounding.
const NEAR: f64 = 0.25;
/// An imaginary part this small beside its eigenvalue is rounding: a negative real eigenvalue has the argument +pi.
const REAL: f64 = 1e-11;

/// The principal logarithm of a matrix (n, n), row-major: eigenvalues with imaginary part in (-pi, pi].
///
/// # Errors
/// `NoConvergence` when the matrix has no Schur form by QR (entries that are not finite), `OutOfRange` when it is singular.
pub fn logarithm(a: &[Complex], n: usize) -> Result<Vec<Complex>> {
    let failed = || Error::NoConvergence {
        method: "logarithm of a matrix".into(),
        iterations: 100 * n,
        residual: f64::NAN,
        advice: "check that all entries are finite".into(),
    };
    if a.iter().any(|v| !v.is_finite()) {
        return Err(failed());
    }
    let schur = Schur::try_new(DMatrix::from_row_slice(n, n, a), f64::EPSILON, 100 * n.max(1)).ok_or_else(failed)?;
    let (q, mut t) = schur.unpack();
    let zero = Complex::new(0.0, 0.0);
    for i in 0..n {
        (0..i).for_each(|j| t[(i, j)] = zero);
        let own = &mut t[(i, i)];
        if own.re < 0.0 && own.im.abs() <= REAL * own.re.abs() {
            own.im = 0.0;
        }
        if own.norm() == 0.0 {
            let expected = "a nonsingular matrix: a zero eigenvalue has no logarithm".into();
            return Err(Error::OutOfRange { what: "eigenvalue".into(), found: 0.0, expected });
        }
    }
    let eigenvalues: Vec<Complex> = t.diagonal().iter().copied().collect();
    let one = DMatrix::<Complex>::identity(n, n);
    let mut doublings = 0;
    while (&t - &one).iter().map(|v| v.norm_sqr()).sum::<f64>().sqrt() > NEAR && doublings < 200 {
        t = triangular_root(&t);
        doublings += 1;
    }
    let x = &t - &one;
    let gauss = Gauss::new(12);
    let mut log = DMatrix::<Complex>::zeros(n, n);
    for (node, weight) in gauss.nodes.iter().zip(&gauss.weights) {
        let shifted = &one + &x * Complex::from(*node);
        log += shifted.lu().solve(&x).ok_or_else(failed)? * Complex::from(*weight);
    }
    log *= Complex::from(2.0_f64.powi(doublings));
    for (i, value) in eigenvalues.iter().enumerate() {
        log[(i, i)] = value.ln();
    }
    Ok(rows(&(&q * log * q.adjoint())))
}

/// Principal square root of an upper triangular matrix (Björck and Hammarling).
fn triangular_root(t: &DMatrix<Complex>) -> DMatrix<Complex> {
    let n = t.nrows();
    let mut r = DMatrix::<Complex>::zeros(n, n);
    for j in 0..n {
        r[(j, j)] = t[(j, j)].sqrt();
        for i in (0..j).rev() {
            let inner: Complex = (i + 1..j).map(|k| r[(i, k)] * r[(k, j)]).sum();
            r[(i, j)] = (t[(i, j)] - inner) / (r[(i, i)] + r[(j, j)]);
        }
    }
    r
}

/// The exponential of a matrix (n, n), row-major, by halving and its Taylor series.
pub fn exponential(a: &[Complex], n: usize) -> Vec<Complex> {
    let norm = a.iter().map(|v| v.norm_sqr()).sum::<f64>().sqrt();
    let halvings = if norm > 0.5 { (norm / 0.5).log2().ceil() as i32 } else { 0 };
    let a = DMatrix::from_row_slice(n, n, a) * Complex::from(0.5_f64.powi(halvings));
    let mut sum = DMatrix::<Complex>::identity(n, n);
    let mut term = sum.clone();
    for k in 1..=18 {
        term = &term * &a / Complex::from(f64::from(k));
        sum += &term;
    }
    (0..halvings).for_each(|_| sum = &sum * &sum);
    rows(&sum)
}

fn rows(m: &DMatrix<Complex>) -> Vec<Complex> {
    m.transpose().iter().copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::rng::SplitMix64;

    fn largest(a: &[Complex], b: &[Complex]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn the_one_undoes_the_other() {
        let mut rng = SplitMix64::new(3);
        for n in 1..7 {
            for scale in [0.1, 1.0] {
                let a: Vec<Complex> =
                    (0..n * n).map(|_| Complex::new(rng.uniform() - 0.5, rng.uniform() - 0.5) * scale).collect();
                let e = exponential(&a, n);
                assert!(largest(&logarithm(&e, n).expect("log"), &a) < 1e-12, "{n}");
                assert!(largest(&exponential(&logarithm(&e, n).expect("log"), n), &e) < 1e-12, "{n}");
            }
        }
    }

    #[test]
    fn rotations_blocks_and_negative_numbers_have_the_logarithm_of_the_book() {
        let c = |v: &[f64]| v.iter().map(|&v| Complex::from(v)).collect::<Vec<_>>();
        let (sin, cos) = 1.2_f64.sin_cos();
        let log = logarithm(&c(&[cos, -sin, sin, cos]), 2).expect("rotation");
        assert!(largest(&log, &c(&[0.0, -1.2, 1.2, 0.0])) < 1e-14, "{log:?}");
        let log = logarithm(&c(&[2.0, 3.0, 0.0, 2.0]), 2).expect("Jordan block");
        assert!(largest(&log, &c(&[2.0_f64.ln(), 1.5, 0.0, 2.0_f64.ln()])) < 1e-13, "{log:?}");
        let log = logarithm(&c(&[-3.0, 1.0, 0.0, -3.0]), 2).expect("negative Jordan block");
        assert!((log[0] - Complex::new(3.0_f64.ln(), std::f64::consts::PI)).norm() < 1e-13);
        assert!(largest(&exponential(&log, 2), &c(&[-3.0, 1.0, 0.0, -3.0])) < 1e-12);
        assert!(logarithm(&c(&[1.0, 1.0, 1.0, 1.0]), 2).is_err() || logarithm(&c(&[0.0]), 1).is_err());
        assert!(logarithm(&c(&[f64::NAN]), 1).is_err());
    }
}
