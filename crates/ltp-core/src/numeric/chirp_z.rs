//! Lines of a record at any spacing: Bluestein's algorithm, for grids on which the Fourier transform does not stand.
//!
//! A record of `N` samples has Fourier lines at `k / (N dt)`. When the frequencies of interest are multiples of something
//! else, the sums `sum_n x[n] e^{-j k theta n}` are a convolution with a chirp, which three Fourier transforms do.
//!
//! Reference: L. R. Rabiner, R. W. Schafer and C. M. Rader, *The chirp z-transform algorithm*, IEEE Transactions on Audio and
//! Electroacoustics 17 (1969) 86-92.

use super::Complex;
use rustfft::FftPlanner;
use std::f64::consts::TAU;

/// Lines `k = 0..count` of `sum_n x[n] e^{-2 pi j k n step}`; `step` in cycles per sample (`1/N` gives [`super::fft::forward`]).
pub fn lines(x: &[f64], step: f64, count: usize) -> Vec<Complex> {
    if x.is_empty() || count == 0 {
        return Vec::new();
    }
    // k n = (k^2 + n^2 - (k - n)^2) / 2; the square is reduced to a fraction of a turn before the sine sees it.
    let chirp = |k: usize| {
        let square = (k as f64) * (k as f64) * 0.5;
        Complex::from_polar(1.0, -TAU * turn(square, step))
    };
    let size = (x.len() + count - 1).next_power_of_two();
    let mut planner = FftPlanner::new();
    let mut signal = vec![Complex::new(0.0, 0.0); size];
    x.iter().enumerate().for_each(|(n, &value)| signal[n] = value * chirp(n));
    let mut kernel = vec![Complex::new(0.0, 0.0); size];
    for k in 0..x.len().max(count) {
        let value = chirp(k).conj();
        if k < count {
            kernel[k] = value;
        }
        if k > 0 && k < x.len() {
            kernel[size - k] = value;
        }
    }
    let forward = planner.plan_fft_forward(size);
    forward.process(&mut signal);
    forward.process(&mut kernel);
    signal.iter_mut().zip(&kernel).for_each(|(s, k)| *s *= k);
    planner.plan_fft_inverse(size).process(&mut signal);
    (0..count).map(|k| signal[k] * chirp(k) / size as f64).collect()
}

/// Fractional part of `square * step`, with the rounding of the product put back by a fused multiplication.
fn turn(square: f64, step: f64) -> f64 {
    let product = square * step;
    product.fract() + square.mul_add(step, -product)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::{fft, rng::SplitMix64};

    #[test]
    fn lines_agree_with_the_naive_sum_at_any_spacing() {
        let mut random = SplitMix64::new(5);
        for (n, count, step) in [(1, 3, 0.2), (15, 40, 0.013), (64, 10, 0.0731)] {
            let x: Vec<f64> = (0..n).map(|_| random.normal()).collect();
            for (k, line) in lines(&x, step, count).iter().enumerate() {
                let sum: Complex = (0..n).map(|i| Complex::from_polar(x[i], -TAU * (k * i) as f64 * step)).sum();
                assert!((line - sum).norm() < 1e-12, "n {n}, line {k}");
            }
        }
    }

    #[test]
    fn long_records_keep_their_digits() {
        let mut random = SplitMix64::new(6);
        let x: Vec<f64> = (0..100_003).map(|_| random.normal()).collect();
        let (fourier, chirp) = (fft::forward(&x), lines(&x, 1.0 / x.len() as f64, 5000));
        let error = chirp.iter().zip(&fourier).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(error < 1e-9 * (x.len() as f64).sqrt(), "{error}");
    }
}
