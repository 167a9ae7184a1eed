//! How far a prediction is from what was measured: rms errors, gaps left out.
//!
//! Samples where either side is NaN are gaps and do not count; an infinite prediction counts as an infinite error.

use crate::numeric::stats;

/// Root mean square of `measured - predicted`, in the unit of the output; NaN when no pair of samples is there.
pub fn rms_error(measured: impl IntoIterator<Item = f64>, predicted: impl IntoIterator<Item = f64>) -> f64 {
    stats::rms(measured.into_iter().zip(predicted).map(|(y, f)| y - f))
}

/// `rms(measured - predicted) / std(measured)`: 0 is perfect, 1 is no better than the mean.
///
/// Both are taken over the samples where both sides are present. A constant output gives 0 for a perfect prediction
/// and infinity otherwise; NaN when no pair of samples is there.
pub fn relative_rms(measured: impl IntoIterator<Item = f64>, predicted: impl IntoIterator<Item = f64>) -> f64 {
    let (measured, predicted) = pairs(measured, predicted);
    let error = rms_error(measured.iter().copied(), predicted.iter().copied());
    if error == 0.0 { 0.0 } else { error / stats::std(measured.iter().copied()) }
}

/// `100 rms(measured - predicted) / rms(measured)`, percent: 0 is perfect, 100 is no better than zero.
///
/// The mean is not taken out of the measured signal, unlike in [`relative_rms`]: the outputs of periodic systems are
/// deviations from their orbit. Both are taken over the samples where both sides are present. A zero output gives 0 for a
/// perfect prediction and infinity otherwise; NaN when no pair of samples is there. Source: Uyanik et al. 2015,
/// equation (20).
pub fn e_rms(measured: impl IntoIterator<Item = f64>, predicted: impl IntoIterator<Item = f64>) -> f64 {
    let (measured, predicted) = pairs(measured, predicted);
    let error = rms_error(measured.iter().copied(), predicted.iter().copied());
    if error == 0.0 { 0.0 } else { 100.0 * error / stats::rms(measured) }
}

/// The samples where both sides are present.
fn pairs(measured: impl IntoIterator<Item = f64>, predicted: impl IntoIterator<Item = f64>) -> (Vec<f64>, Vec<f64>) {
    measured.into_iter().zip(predicted).filter(|(y, f)| !(y.is_nan() || f.is_nan())).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_errors() {
        let y = [1.0, -1.0, 1.0, -1.0];
        assert_eq!(rms_error(y, [0.0; 4]), 1.0);
        assert_eq!(relative_rms(y, [0.0; 4]), 1.0);
        assert_eq!(relative_rms(y, y), 0.0);
        assert_eq!(relative_rms([2.0; 3], [2.0; 3]), 0.0);
        assert_eq!(relative_rms([2.0; 3], [1.0; 3]), f64::INFINITY);
        assert_eq!(e_rms(y, [0.0; 4]), 100.0);
        assert_eq!(e_rms(y, y), 0.0);
        assert_eq!(e_rms([0.0; 3], [1.0; 3]), f64::INFINITY);
    }

    #[test]
    fn only_the_paper_s_error_sees_the_mean() {
        // 3 of 4 of a constant is missed by a quarter; against the spread of a constant every miss is infinite.
        assert_eq!(e_rms([4.0; 3], [3.0; 3]), 25.0);
        assert_eq!(relative_rms([4.0; 3], [3.0; 3]), f64::INFINITY);
    }

    #[test]
    fn gaps_do_not_count() {
        let y = [1.0, f64::NAN, -1.0, 1.0, -1.0];
        assert_eq!(rms_error(y, [0.0, 100.0, 0.0, 0.0, 0.0]), 1.0);
        assert_eq!(relative_rms(y, [0.0, 100.0, 0.0, 0.0, 0.0]), 1.0);
        assert_eq!(e_rms(y, [0.0, 100.0, 0.0, 0.0, 0.0]), 100.0);
        assert_eq!(e_rms([1.0, 9.0, 1.0], [1.0, f64::NAN, 1.0]), 0.0);
        assert!(rms_error([f64::NAN], [1.0]).is_nan() && e_rms([f64::NAN], [1.0]).is_nan());
        assert!(rms_error([1.0, 2.0], [f64::INFINITY, 2.0]).is_infinite());
    }
}
