//! Eigenvalues of general real and complex matrices, and eigenvectors of complex ones, by faer.

use faer::Mat;

use super::Complex;
use crate::error::{Error, Result};

/// Eigenvalues of a real matrix (n, n), row-major, largest magnitude first; of a conjugate pair the one with positive
/// imaginary part comes first.
///
/// # Errors
/// `NoConvergence` when the QR iteration fails, as it does for entries that are not finite.
pub fn eigenvalues(a: &[f64], n: usize) -> Result<Vec<Complex>> {
    sorted(Mat::from_fn(n, n, |i, j| a[i * n + j]).eigenvalues().ok(), n)
}

/// Eigenvalues of a complex matrix (n, n), row-major, in the same order.
///
/// # Errors
/// As [`eigenvalues`].
pub fn eigenvalues_complex(a: &[Complex], n: usize) -> Result<Vec<Complex>> {
    sorted(Mat::from_fn(n, n, |i, j| a[i * n + j]).eigenvalues().ok(), n)
}

/// Eigenvalues (n) of a complex matrix (n, n), row-major, each with its right eigenvector (n) of length one; largest real part
/// first, then largest imaginary part.
///
/// # Errors
/// `NoConvergence` when the QR iteration fails, as it does for entries that are not finite.
pub fn eigenpairs(a: &[Complex], n: usize) -> Result<Vec<(Complex, Vec<Complex>)>> {
    let failed = || Error::NoConvergence {
        method: "eigenvectors".into(),
        iterations: 30 * n,
        residual: f64::NAN,
        advice: "check that all entries are finite".into(),
    };
    if a.iter().any(|v| !v.is_finite()) {
        return Err(failed());
    }
    let found = Mat::from_fn(n, n, |i, j| a[i * n + j]).eigen().map_err(|_| failed())?;
    let (values, vectors) = (found.S().column_vector(), found.U());
    let mut pairs: Vec<(Complex, Vec<Complex>)> = (0..n)
        .map(|k| {
            let vector: Vec<Complex> = (0..n).map(|i| vectors[(i, k)]).collect();
            let length = vector.iter().map(|v| v.norm_sqr()).sum::<f64>().sqrt();
            (values[k], vector.into_iter().map(|v| v / length).collect())
        })
        .collect();
    if pairs.iter().any(|(value, _)| !value.is_finite()) {
        return Err(failed());
    }
    pairs.sort_by(|a, b| b.0.re.total_cmp(&a.0.re).then(b.0.im.total_cmp(&a.0.im)));
    Ok(pairs)
}

fn sorted(found: Option<Vec<Complex>>, n: usize) -> Result<Vec<Complex>> {
    let Some(mut values) = found.filter(|v| v.iter().all(|v| v.is_finite())) else {
        let (method, advice) = ("eigenvalues".into(), "check that all entries are finite".into());
        return Err(Error::NoConvergence { method, iterations: 30 * n, residual: f64::NAN, advice });
    };
    // Magnitudes of a conjugate pair may differ in the last bit: compare them with that much patience.
    let size = |v: &Complex| (v.norm() * 1e12).round() / 1e12;
    values.sort_by(|a, b| size(b).total_cmp(&size(a)).then(b.im.total_cmp(&a.im)).then(b.re.total_cmp(&a.re)));
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_eigenvalues_in_order() {
        let a = [0.0, 1.0, 0.0, -2.0, -2.0, 0.0, 0.0, 0.0, 0.5];
        let found = eigenvalues(&a, 3).unwrap();
        for (f, e) in found.iter().zip([Complex::new(-1.0, 1.0), Complex::new(-1.0, -1.0), Complex::new(0.5, 0.0)]) {
            assert!((f - e).norm() < 1e-14, "{found:?}");
        }
        let j = Complex::new(0.0, 1.0);
        let found = eigenvalues_complex(&[j, Complex::new(3.0, 0.0), Complex::new(0.0, 0.0), -2.0 * j], 2).unwrap();
        assert!((found[0] + 2.0 * j).norm() < 1e-14 && (found[1] - j).norm() < 1e-14);
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        assert!(eigenvalues(&[f64::NAN, 0.0, 0.0, 1.0], 2).is_err());
    }

    #[test]
    fn pairs_satisfy_their_equation() {
        let c = Complex::new;
        let a = [
            c(1.0, 2.0),
            c(0.5, 0.0),
            c(0.0, -1.0),
            c(-3.0, 0.1),
            c(0.2, 0.2),
            c(1.0, 0.0),
            c(4.0, 0.0),
            c(0.0, 1.0),
            c(-1.0, 0.0),
        ];
        let pairs = eigenpairs(&a, 3).expect("pairs");
        for (value, v) in &pairs {
            for i in 0..3 {
                let image: Complex = (0..3).map(|j| a[i * 3 + j] * v[j]).sum();
                assert!((image - value * v[i]).norm() < 1e-13);
            }
        }
        assert!(pairs.windows(2).all(|p| p[0].0.re >= p[1].0.re));
        assert!(eigenpairs(&[c(f64::NAN, 0.0)], 1).is_err());
    }
}
