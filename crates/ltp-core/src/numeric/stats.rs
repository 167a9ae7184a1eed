//! Averages that leave gaps out: mean, rms, standard deviation, quantiles, and the runs between gaps.
//!
//! NaN is a gap everywhere in this crate. Every function here skips it and returns NaN when nothing is left.

use std::ops::Range;

/// Arithmetic mean of the samples that are not NaN.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = present(values).fold((0.0, 0_usize), |(sum, count), v| (sum + v, count + 1));
    sum / count as f64
}

/// Root mean square of the samples that are not NaN.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    mean(values.into_iter().map(|v| v * v)).sqrt()
}

/// Standard deviation (divided by the number of samples, as `numpy.std`) of the samples that are not NaN.
pub fn std(values: impl IntoIterator<Item = f64>) -> f64 {
    let values: Vec<f64> = present(values).collect();
    let centre = mean(values.iter().copied());
    rms(values.iter().map(|v| v - centre))
}

/// Median of the samples that are not NaN.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// Quantile at `level` in [0, 1] of the samples that are not NaN, linear between order statistics (as
/// `numpy.quantile`).
pub fn quantile(values: &[f64], level: f64) -> f64 {
    let mut sorted: Vec<f64> = present(values.iter().copied()).collect();
    if sorted.is_empty() || level.is_nan() {
        return f64::NAN;
    }
    let place = level.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let (_, &mut low, above) = sorted.select_nth_unstable_by(place as usize, f64::total_cmp);
    let share = place.fract();
    if share == 0.0 {
        return low;
    }
    let high = above.iter().copied().fold(f64::INFINITY, f64::min);
    low + share * (high - low)
}

/// Index ranges of the runs without NaN or infinite samples, in order.
pub fn finite_runs(values: impl IntoIterator<Item = f64>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (i, value) in values.into_iter().enumerate() {
        if !value.is_finite() {
            continue;
        }
        match runs.last_mut() {
            Some(run) if run.end == i => run.end += 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}

/// The samples that are not NaN.
fn present(values: impl IntoIterator<Item = f64>) -> impl Iterator<Item = f64> {
    values.into_iter().filter(|v| !v.is_nan())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_values_and_gaps() {
        let values = [3.0, f64::NAN, 1.0, 2.0, 4.0];
        assert_eq!(mean(values), 2.5);
        assert_eq!(median(&values), 2.5);
        assert_eq!(quantile(&values, 0.0), 1.0);
        assert_eq!(quantile(&values, 1.0), 4.0);
        assert!((std(values) - 1.25_f64.sqrt()).abs() < 1e-15);
        assert!((rms(values) - 7.5_f64.sqrt()).abs() < 1e-15);
        assert!(median(&[f64::NAN]).is_nan() && std([]).is_nan());
        assert_eq!(finite_runs(values), [0..1, 2..5]);
        assert!(finite_runs([f64::NAN; 3]).is_empty());
    }

    #[test]
    fn a_large_offset_does_not_spoil_the_standard_deviation() {
        let values = (0..1000).map(|i| 1e9 + f64::from(i % 2));
        assert!((std(values) - 0.5).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn quantiles_agree_with_sorting(
            mut values in proptest::collection::vec(-1e3..1e3_f64, 1..80), level in 0.0..=1.0_f64,
        ) {
            let found = quantile(&values, level);
            values.sort_by(f64::total_cmp);
            let place = level * (values.len() - 1) as f64;
            let (low, high) = (values[place.floor() as usize], values[place.ceil() as usize]);
            prop_assert!((found - (low + place.fract() * (high - low))).abs() < 1e-9);
        }
    }
}
