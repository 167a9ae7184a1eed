//! Periodogram and the noise floor of a record that also contains signal.
//!
//! Scaling: with `X[k] = sum w[n] x[n] e^(-2 pi i k n / N)`, a line is `P[k] = |X[k]|^2 / sum w^2`, so that white
//! noise of variance `s^2` has the expectation `s^2` on every line, whatever the length and the taper. Mechanical
//! signals fall off with frequency, measurement noise does not: the floor is read from the upper half of the band. A
//! line of Gaussian noise is exponentially distributed, its median is `ln 2` times its mean, and the median ignores
//! the few lines a signal still reaches.
//!
//! A Hann taper keeps a large slow signal, whose ends do not meet, from leaking into the upper half (its leakage
//! falls with the sixth power of the frequency instead of the second).
//!
//! References: P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73; R. Pintelon and J. Schoukens, *System
//! Identification: A Frequency Domain Approach*, 2nd ed., section 2.4 (statistics of DFT lines).

use super::stats;
use rustfft::{FftPlanner, num_complex::Complex};

/// Shorter runs have too few lines in the upper half to take a median of.
const SPECTRAL: usize = 32;

/// Lines `0..=N/2` of the periodogram of `x` `(N,)`, no taper; white noise of variance `s^2` has the expectation
/// `s^2` on each.
///
/// Line `k` stands at `k / (N dt)` Hz. `x` must be finite.
pub fn periodogram(x: &[f64]) -> Vec<f64> {
    tapered(x, |_| 1.0)
}

/// Standard deviation of the white part of `x` `(N,)`, from the upper half of its spectrum; NaN samples are gaps.
///
/// 0 for a constant or a straight line, and for fewer than three samples in a row. Runs of fewer than 32 samples are
/// judged together by their second differences instead, which a slow signal does not reach either.
pub fn noise_floor(x: &[f64]) -> f64 {
    let runs = stats::finite_runs(x.iter().copied());
    noise_floor_pooled(&runs.into_iter().map(|run| &x[run]).collect::<Vec<_>>())
}

/// As [`noise_floor`], over several finite segments: all lines of all segments share one median.
///
/// Segments may come from the runs between gaps and from different recordings of the same channel.
pub fn noise_floor_pooled(segments: &[&[f64]]) -> f64 {
    let mut lines = Vec::new();
    let mut scale = 0.0_f64;
    for segment in segments.iter().filter(|s| s.len() >= SPECTRAL) {
        let n = segment.len();
        let detrended = without_line(segment);
        scale = segment.iter().fold(scale, |m, v| m.max(v.abs()));
        let spectrum = tapered(&detrended, |i| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.5) / n as f64;
            0.5 - 0.5 * angle.cos()
        });
        // Without the line at the Nyquist frequency, which has one degree of freedom instead of two.
        lines.extend_from_slice(&spectrum[n / 4..n.div_ceil(2)]);
    }
    let floor = if lines.is_empty() {
        second_differences(segments)
    } else {
        (stats::median(&lines) / std::f64::consts::LN_2).sqrt()
    };
    // What is left of a straight line after subtraction is rounding, not noise.
    if floor <= 4.0 * f64::EPSILON * scale { 0.0 } else { floor }
}

/// Periodogram with the taper `w(i)`.
fn tapered(x: &[f64], w: impl Fn(usize) -> f64) -> Vec<f64> {
    if x.is_empty() {
        return Vec::new();
    }
    let mut power = 0.0;
    let mut spectrum: Vec<Complex<f64>> = Vec::with_capacity(x.len());
    for (i, value) in x.iter().enumerate() {
        let weight = w(i);
        power += weight * weight;
        spectrum.push(Complex::new(weight * value, 0.0));
    }
    FftPlanner::new().plan_fft_forward(x.len()).process(&mut spectrum);
    spectrum.iter().take(x.len() / 2 + 1).map(|line| line.norm_sqr() / power).collect()
}

/// `x` minus its least-squares straight line.
fn without_line(x: &[f64]) -> Vec<f64> {
    let middle = 0.5 * (x.len() as f64 - 1.0);
    let mean = stats::mean(x.iter().copied());
    let (top, bottom) = x.iter().enumerate().fold((0.0, 0.0), |(top, bottom), (i, v)| {
        let lever = i as f64 - middle;
        (top + lever * (v - mean), bottom + lever * lever)
    });
    let slope = if bottom > 0.0 { top / bottom } else { 0.0 };
    x.iter().enumerate().map(|(i, v)| v - mean - slope * (i as f64 - middle)).collect()
}

/// Noise of short runs: white noise of variance `s^2` has second differences of variance `6 s^2`.
fn second_differences(segments: &[&[f64]]) -> f64 {
    let differences = segments.iter().flat_map(|s| s.windows(3)).map(|w| w[0] - 2.0 * w[1] + w[2]);
    let rms = stats::rms(differences);
    if rms.is_nan() { 0.0 } else { rms / 6.0_f64.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::rng::SplitMix64;

    fn noise(n: usize, sigma: f64, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64::new(seed);
        (0..n).map(|_| sigma * random.normal()).collect()
    }

    /// Mean floor over several seeds, so that 3 % tests the method and not its luck.
    fn average(floor: impl Fn(u64) -> f64) -> f64 {
        (0..12).map(|seed| floor(seed * 7 + 1)).sum::<f64>() / 12.0
    }

    #[test]
    fn periodogram_agrees_with_the_naive_sum() {
        let x = noise(45, 1.0, 5);
        for (k, line) in periodogram(&x).iter().enumerate() {
            let sum: Complex<f64> =
                (0..45).map(|n| Complex::from_polar(x[n], -std::f64::consts::TAU * (k * n) as f64 / 45.0)).sum();
            assert!((line - sum.norm_sqr() / 45.0).abs() < 1e-12, "line {k}");
        }
    }

    #[test]
    fn white_noise_has_its_variance_on_every_line() {
        let lines = periodogram(&noise(8192, 0.3, 9));
        let mean = stats::mean(lines.iter().copied());
        assert!((mean / 0.09 - 1.0).abs() < 0.03, "mean line {mean}");
    }

    #[test]
    fn floor_of_white_noise() {
        let floor = average(|seed| noise_floor(&noise(4096, 0.2, seed)));
        assert!((floor / 0.2 - 1.0).abs() < 0.03, "floor {floor}");
    }

    #[test]
    fn floor_below_a_large_slow_signal() {
        // A drift, a slow oscillation that does not close, and a line in the upper half: 5000 times the noise.
        let floor = average(|seed| {
            let mut x = noise(4096, 1e-3, seed);
            for (i, x) in x.iter_mut().enumerate() {
                let t = i as f64 / 4096.0;
                *x += 40.0 * t + 5.0 * (23.3 * t).sin() + 2.0 * (1500.0 * std::f64::consts::TAU * t).sin();
            }
            noise_floor(&x)
        });
        assert!((floor / 1e-3 - 1.0).abs() < 0.03, "floor {floor}");
    }

    #[test]
    fn gaps_and_segments_are_pooled() {
        let floor = average(|seed| {
            let mut x = noise(4096, 0.5, seed);
            for start in [300, 1500, 1600, 3000] {
                x[start..start + 40].fill(f64::NAN);
            }
            noise_floor(&x)
        });
        assert!((floor / 0.5 - 1.0).abs() < 0.03, "floor {floor}");
    }

    #[test]
    fn constant_short_and_empty_series() {
        assert_eq!(noise_floor(&[2.5; 100]), 0.0);
        assert_eq!(noise_floor(&(0..100).map(|i| 0.1 * f64::from(i)).collect::<Vec<_>>()), 0.0);
        assert_eq!(noise_floor(&[]), 0.0);
        assert_eq!(noise_floor(&[1.0, f64::NAN, 2.0]), 0.0);
        let floor = average(|seed| noise_floor(&noise(31, 2.0, seed)));
        assert!((floor / 2.0 - 1.0).abs() < 0.15, "short floor {floor}");
    }
}
