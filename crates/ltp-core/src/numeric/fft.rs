//! The Fourier transform of real records, and the one place where its scaling is decided.
//!
//! `X[k] = sum_n x[n] e^{-2 pi j k n / N}` for `k = 0..=N/2`, without a factor; the inverse divides by `N`. Line `k` stands at
//! `k / (N dt)` Hz; `dt X[k]` approximates the Fourier integral, `2 X[k] / N` is the complex amplitude of a sine on line `k`.
//! Lines of negative frequency are the conjugates, and are not stored.

use super::Complex;
use rustfft::FftPlanner;

/// Lines `0..=N/2` of the transform of `x` (N).
pub fn forward(x: &[f64]) -> Vec<Complex> {
    if x.is_empty() {
        return Vec::new();
    }
    let mut lines: Vec<Complex> = x.iter().map(|&v| Complex::new(v, 0.0)).collect();
    FftPlanner::new().plan_fft_forward(x.len()).process(&mut lines);
    lines.truncate(x.len() / 2 + 1);
    lines
}

/// The record (n) whose transform has these lines; lines beyond the given ones are zero, and those beyond `n/2` are dropped.
///
/// The imaginary parts of line 0 and, for even `n`, of line `n/2` do not count: a real record has none.
pub fn inverse(lines: &[Complex], n: usize) -> Vec<f64> {
    if n == 0 {
        return Vec::new();
    }
    let mut full = vec![Complex::new(0.0, 0.0); n];
    for (k, line) in lines.iter().enumerate().take(n / 2 + 1) {
        full[k] += 0.5 * line;
        full[(n - k) % n] += 0.5 * line.conj();
    }
    // The line at n/2 is its own mirror image; every other one but zero was halved and mirrored, so it is doubled back.
    for (k, value) in full.iter_mut().enumerate() {
        if k != 0 && 2 * k != n {
            *value *= 2.0;
        }
    }
    FftPlanner::new().plan_fft_inverse(n).process(&mut full);
    full.into_iter().map(|v| v.re / n as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::rng::SplitMix64;
    use std::f64::consts::TAU;

    fn record(n: usize) -> Vec<f64> {
        let mut random = SplitMix64::new(3);
        (0..n).map(|_| random.normal()).collect()
    }

    #[test]
    fn forward_agrees_with_the_naive_sum() {
        for n in [1, 2, 15, 30] {
            let x = record(n);
            for (k, line) in forward(&x).iter().enumerate() {
                let sum: Complex = (0..n).map(|i| Complex::from_polar(x[i], -TAU * (k * i) as f64 / n as f64)).sum();
                assert!((line - sum).norm() < 1e-12, "n {n}, line {k}");
            }
        }
    }

    #[test]
    fn inverse_gives_the_record_back() {
        for n in [1, 2, 7, 8, 45] {
            let x = record(n);
            let back = inverse(&forward(&x), n);
            for (a, b) in x.iter().zip(&back) {
                assert!((a - b).abs() < 1e-13, "n {n}: {a} {b}");
            }
        }
    }
}
