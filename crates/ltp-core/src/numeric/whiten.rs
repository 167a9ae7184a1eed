//! Autoregressive whitening: how much of a residual is new at every sample.
//!
//! A residual `x[t] = a1 x[t-1] + ... + ap x[t-p] + e[t]` that is coloured by noise keeps its innovations `e` when a
//! wrong effect is added; one that is coloured by missing physics loses them when the right effect is added.
//! Deviances of innovations therefore accept effects where deviances of raw residuals raise false alarms.
//! Coefficients by Burg's recursion, which is stable for every record (all reflection coefficients lie within one),
//! pooled over segments by adding their sums.
//!
//! References: J. P. Burg, *Maximum entropy spectral analysis*, thesis, Stanford 1975; S. de Waele and P. M. T.
//! Broersen, IEEE Trans. Signal Process. 48 (2000) 2876-2880 (Burg's recursion for segments).

/// Coefficients `(a1, ..., ap)` of the autoregression of `x`, `x[t] = a1 x[t-1] + ... + e[t]`, by Burg's recursion.
///
/// The mean is not removed. Fewer coefficients come back when `x` is shorter than `order + 1` or is predicted exactly
/// before.
pub fn ar_burg(x: &[f64], order: usize) -> Vec<f64> {
    ar_burg_pooled(&[x], order)
}

/// As [`ar_burg`], one set of coefficients for several finite segments of the same process.
pub fn ar_burg_pooled(segments: &[&[f64]], order: usize) -> Vec<f64> {
    let mut forward: Vec<Vec<f64>> = segments.iter().map(|s| s.to_vec()).collect();
    let mut backward = forward.clone();
    let start: f64 = forward.iter().flatten().map(|v| v * v).sum();
    let mut coefficients: Vec<f64> = Vec::with_capacity(order);
    for m in 1..=order {
        // Forward errors at t and backward errors at t-1 of the model of order m-1; both exist from t = m on.
        let (mut top, mut bottom) = (0.0, 0.0);
        for (f, b) in forward.iter().zip(&backward) {
            for t in m..f.len() {
                top += f[t] * b[t - 1];
                bottom += f[t] * f[t] + b[t - 1] * b[t - 1];
            }
        }
        if !(bottom.is_finite() && bottom > f64::EPSILON.powi(2) * start) {
            break;
        }
        let reflection = 2.0 * top / bottom;
        for (f, b) in forward.iter_mut().zip(&mut backward) {
            for t in (m..f.len()).rev() {
                let (ahead, behind) = (f[t], b[t - 1]);
                f[t] = ahead - reflection * behind;
                b[t] = behind - reflection * ahead;
            }
        }
        let previous = coefficients.clone();
        coefficients.iter_mut().zip(previous.iter().rev()).for_each(|(a, mirrored)| *a -= reflection * mirrored);
        coefficients.push(reflection);
    }
    coefficients
}

/// Innovations of `x` `(n,)` under `coefficients` `(p,)`: `(n - p,)`, from sample `p` on; empty when `n <= p`.
pub fn whiten(x: &[f64], coefficients: &[f64]) -> Vec<f64> {
    let p = coefficients.len();
    let innovation = |t: usize| x[t] - coefficients.iter().enumerate().map(|(i, a)| a * x[t - 1 - i]).sum::<f64>();
    (p..x.len()).map(innovation).collect()
}

/// Gaussian deviance `N ln(innovation variance)`, the variance concentrated out, of the autoregression fitted to
/// `segments` (finite).
///
/// `N` counts the samples from `order` on in every segment, so that residuals of two models over the same samples
/// compare: `deviance(nominal) - deviance(candidate)` is the whitened gain. Segments of at most `order` samples are
/// left out; 0 when none remain. An exactly predictable residual is held at a relative variance of 1e-30 instead of
/// minus infinity.
pub fn ar_deviance(segments: &[&[f64]], order: usize) -> f64 {
    let used: Vec<&[f64]> = segments.iter().copied().filter(|s| s.len() > order).collect();
    let coefficients = ar_burg_pooled(&used, order);
    let (mut squares, mut count, mut power) = (0.0, 0_usize, 0.0);
    for segment in used {
        // A model that needed fewer coefficients is still judged on the same samples.
        let innovations = whiten(&segment[order - coefficients.len()..], &coefficients);
        squares += innovations.iter().map(|e| e * e).sum::<f64>();
        power += segment[order..].iter().map(|v| v * v).sum::<f64>();
        count += innovations.len();
    }
    if count == 0 {
        return 0.0;
    }
    let floor = (1e-30 * power).max(f64::MIN_POSITIVE);
    count as f64 * (squares.max(floor) / count as f64).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::{rng::SplitMix64, stats};
    use proptest::prelude::*;

    /// An autoregression driven by unit normal noise, started far enough back to be stationary.
    fn process(a: &[f64], n: usize, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64::new(seed);
        let mut x: Vec<f64> = vec![0.0; a.len()];
        for _ in 0..n + 200 {
            let past: f64 = a.iter().enumerate().map(|(i, a)| a * x[x.len() - 1 - i]).sum();
            x.push(past + random.normal());
        }
        x.split_off(a.len() + 200)
    }

    #[test]
    fn coefficients_are_recovered() {
        let a = ar_burg(&process(&[0.8], 8000, 1), 1);
        assert!((a[0] - 0.8).abs() < 0.02, "{a:?}");
        let a = ar_burg(&process(&[1.5, -0.8], 8000, 2), 3);
        assert!((a[0] - 1.5).abs() < 0.04 && (a[1] + 0.8).abs() < 0.06 && a[2].abs() < 0.04, "{a:?}");
    }

    #[test]
    fn innovations_are_white_and_of_unit_variance() {
        let x = process(&[0.8], 8000, 3);
        let e = whiten(&x, &ar_burg(&x, 4));
        assert_eq!(e.len(), 8000 - 4);
        let variance = stats::rms(e.iter().copied()).powi(2);
        let neighbour = stats::mean(e.windows(2).map(|w| w[0] * w[1]));
        assert!((variance - 1.0).abs() < 0.05 && neighbour.abs() < 0.04, "variance {variance}, lag one {neighbour}");
    }

    #[test]
    fn pooled_segments_agree_with_the_whole() {
        let x = process(&[0.8], 6000, 4);
        let whole = ar_burg(&x, 2);
        let parts: Vec<&[f64]> = x.chunks(500).collect();
        let pooled = ar_burg_pooled(&parts, 2);
        assert!(whole.iter().zip(&pooled).all(|(a, b)| (a - b).abs() < 0.01));
        let (one, many) = (ar_deviance(&[&x], 2) / 5998.0, ar_deviance(&parts, 2) / (6000.0 - 24.0));
        assert!((one - many).abs() < 0.01, "{one} and {many} per sample");
    }

    #[test]
    fn slow_regressor_gains_in_raw_deviance_but_not_in_the_whitened_one() {
        // Regress AR(1) noise on slow sines that have nothing to do with it: white-noise deviance believes them.
        let n = 2000;
        let (mut raw, mut whitened) = (0.0_f64, 0.0_f64);
        for seed in 0..10 {
            let x = process(&[0.8], n, 50 + seed);
            let mut fitted = x.clone();
            for k in 1..4 {
                let shape: Vec<f64> = (0..n).map(|i| (0.003 * f64::from(k) * i as f64).sin()).collect();
                let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                let amplitude = dot(&fitted, &shape) / dot(&shape, &shape);
                fitted.iter_mut().zip(&shape).for_each(|(f, s)| *f -= amplitude * s);
            }
            let deviance = |x: &[f64]| n as f64 * stats::rms(x.iter().copied()).powi(2).ln();
            raw = raw.max(deviance(&x) - deviance(&fitted));
            whitened = whitened.max(ar_deviance(&[&x], 8) - ar_deviance(&[&fitted], 8));
        }
        assert!(raw > 25.0, "raw gain {raw}");
        assert!(whitened < 15.0, "whitened gain {whitened}");
    }

    #[test]
    fn degenerate_series() {
        assert!(ar_burg(&[0.0; 20], 3).is_empty());
        assert_eq!(ar_burg(&[1.0, -1.0], 5).len(), 1);
        assert_eq!(ar_deviance(&[&[1.0, 2.0]], 4), 0.0);
        assert_eq!(ar_deviance(&[], 4), 0.0);
        assert!(ar_deviance(&[&[0.0; 50]], 4).is_finite());
        assert!(ar_deviance(&[&[1.0; 50]], 4).is_finite());
    }

    proptest! {
        #[test]
        fn deviance_shifts_with_scale(seed in 0_u64..500, scale in 1e-6..1e6_f64) {
            let x = process(&[0.6], 200, seed);
            let scaled: Vec<f64> = x.iter().map(|v| v * scale).collect();
            let expected = ar_deviance(&[&x], 3) + 197.0 * 2.0 * scale.ln();
            prop_assert!((ar_deviance(&[&scaled], 3) - expected).abs() < 1e-6);
        }
    }
}
