//! Eigenvalues of a complex matrix with their right eigenvectors, by faer.

use faer::Mat;

use super::Complex;
use crate::error::{Error, Result};

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

#[cfg(test)]
mod tests {
    use super::*;

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
