//! What a time column means: a uniform grid, a uniform grid with samples missing, or jitter that has to be resampled.
//!
//! Clocks of real rigs write rounded times, skip samples and jitter. Three cases are told apart, by the distance of
//! every time from the nearest point of a fitted grid:
//!
//! 1. within 1e-4 of a step, or within the rounding of the digits written: the samples sit on the grid as they are;
//! 2. the same, with steps that are whole multiples of the grid step: samples are missing, and their rows become
//!    gaps;
//! 3. anything else is jitter: values are interpolated linearly onto a grid, and where the neighbours are more than
//!    1.5 steps apart nothing is invented.

use crate::error::{Error, Result};
use crate::numeric::stats::median;

/// Deviation from a grid that is no deviation, relative to the step.
const UNIFORM: f64 = 1e-4;
/// Neighbours farther apart than this many steps are not interpolated between.
const BRIDGE: f64 = 1.5;
/// A grid may have this many times more points than there are samples.
const SPARSE: usize = 20;

/// The time grid of a recording and where its samples lie on it.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    /// Grid times, s.
    pub t: Vec<f64>,
    /// Step, s.
    pub dt: f64,
    /// How the values get there.
    pub placement: Placement,
}

/// How samples reach the grid.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Placement {
    /// Sample `i` is grid row `rows[i]`; other rows had no sample.
    Rows(Vec<usize>),
    /// Linear interpolation; rms and largest deviation of the sampling steps from whole multiples of `dt`, s.
    Resample {
        /// Rms deviation, s.
        rms: f64,
        /// Largest deviation, s.
        largest: f64,
    },
}

/// Finds the grid of strictly increasing times `t` `(n,)`, `n >= 2`.
///
/// # Errors
/// [`Error::LongPause`] when a pause would leave the grid almost empty.
pub(crate) fn find(recording: &str, t: &[f64]) -> Result<Grid> {
    let steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    let typical = median(&steps);
    // The mean of the ordinary steps: rounded times (0, 2, 5, 7, 10 ms) have a median step that is not their grid's.
    let ordinary = steps.iter().filter(|s| (0.5 * typical..=BRIDGE * typical).contains(*s));
    let (sum, count) = ordinary.fold((0.0, 0), |(sum, count), s| (sum + s, count + 1));
    let step = if count > 0 { sum / f64::from(count) } else { typical };
    let multiples: Vec<f64> = steps.iter().map(|s| (s / step).round().max(1.0)).collect();
    if let Some(longest) = (0..steps.len()).max_by(|&a, &b| steps[a].total_cmp(&steps[b]))
        && multiples.iter().sum::<f64>() > (SPARSE * t.len()) as f64
    {
        let (previous, found) = (t[longest], t[longest + 1]);
        return Err(Error::LongPause { recording: recording.to_owned(), row: longest + 1, previous, found, dt: step });
    }
    let mut rows = vec![0_usize];
    multiples.iter().for_each(|m| rows.push(rows[rows.len() - 1] + *m as usize));
    let (start, dt, deviation) = fit_line(t, &rows);
    let last = rows[rows.len() - 1];
    let digits = written_digit(t);
    // Times in floating point cannot be better than a few units in the last place.
    let exact = (UNIFORM * dt).max(4.0 * f64::EPSILON * t[0].abs().max(t[t.len() - 1].abs()));
    if deviation <= exact {
        let mut grid = Vec::with_capacity(last + 1);
        for (pair, times) in rows.windows(2).zip(t.windows(2)) {
            let share = (times[1] - times[0]) / (pair[1] - pair[0]) as f64;
            grid.extend((0..pair[1] - pair[0]).map(|k| if k == 0 { times[0] } else { times[0] + k as f64 * share }));
        }
        grid.push(t[t.len() - 1]);
        return Ok(Grid { t: grid, dt, placement: Placement::Rows(rows) });
    }
    // Rounding leaves half a digit; the fitted line may take a little more. Digits as coarse as the step prove
    // nothing.
    if digits.is_some_and(|digit| deviation <= 0.75 * digit && digit <= 0.75 * dt) {
        let grid = (0..=last).map(|k| start + k as f64 * dt).collect();
        return Ok(Grid { t: grid, dt, placement: Placement::Rows(rows) });
    }
    let away = steps.iter().zip(&multiples).map(|(s, m)| (s - m * dt).abs());
    let (squares, largest) = away.fold((0.0, 0.0_f64), |(sum, most), e| (sum + e * e, most.max(e)));
    let rms = (squares / steps.len() as f64).sqrt();
    let points = ((t[t.len() - 1] - t[0]) / dt * (1.0 + 1e-12)).floor() as usize;
    let grid = (0..=points).map(|k| t[0] + k as f64 * dt).collect();
    Ok(Grid { t: grid, dt, placement: Placement::Resample { rms, largest } })
}

/// Least-squares line `start + row dt` through the times, moved so that it errs equally to both sides; and the
/// largest error.
fn fit_line(t: &[f64], rows: &[usize]) -> (f64, f64, f64) {
    let n = t.len() as f64;
    let (t0, span) = (t[0], rows[rows.len() - 1] as f64);
    // Relative to the chord, so that an exact grid gives an exact answer.
    let chord = (t[t.len() - 1] - t0) / span;
    let error: Vec<f64> = t.iter().zip(rows).map(|(t, &k)| (t - t0) - k as f64 * chord).collect();
    let middle = rows.iter().map(|&k| k as f64).sum::<f64>() / n;
    let mean = error.iter().sum::<f64>() / n;
    let (top, bottom) = rows.iter().zip(&error).fold((0.0, 0.0), |(top, bottom), (&k, e)| {
        let lever = k as f64 - middle;
        (top + lever * (e - mean), bottom + lever * lever)
    });
    let slope = top / bottom;
    let left: Vec<f64> = error.iter().zip(rows).map(|(e, &k)| e - slope * k as f64).collect();
    let (low, high) = left.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), e| (l.min(*e), h.max(*e)));
    (t0 + 0.5 * (low + high), chord + slope, 0.5 * (high - low))
}

/// The decimal unit all times are whole multiples of (0.001 for milliseconds); `None` when the digits are not
/// rounded.
fn written_digit(t: &[f64]) -> Option<f64> {
    (0..=9).find_map(|digits| {
        let unit = 10.0_f64.powi(digits);
        let whole = t.iter().all(|t| {
            let scaled = t * unit;
            (scaled - scaled.round()).abs() <= 8.0 * f64::EPSILON * scaled.abs().max(1.0)
        });
        whole.then_some(1.0 / unit)
    })
}

/// Values `y` `(n,)` at times `t` `(n,)`, interpolated linearly at the grid `(m,)`.
///
/// NaN where a neighbour is missing or, with `bridge` false, where the neighbours are more than 1.5 `dt` apart.
pub(crate) fn interpolate(t: &[f64], y: &[f64], grid: &[f64], dt: f64, bridge: bool) -> Vec<f64> {
    let mut left = 0;
    let value = |&at: &f64| {
        while left + 2 < t.len() && t[left + 1] <= at {
            left += 1;
        }
        let width = t[left + 1] - t[left];
        let share = ((at - t[left]) / width).clamp(0.0, 1.0);
        // A grid point on a sample takes that sample: a missing neighbour does not matter then.
        if share <= UNIFORM {
            y[left]
        } else if share >= 1.0 - UNIFORM {
            y[left + 1]
        } else if bridge || width <= BRIDGE * dt {
            y[left] + share * (y[left + 1] - y[left])
        } else {
            f64::NAN
        }
    };
    grid.iter().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(grid: &Grid) -> &[usize] {
        match &grid.placement {
            Placement::Rows(rows) => rows,
            other => panic!("expected rows, found {other:?}"),
        }
    }

    #[test]
    fn exact_grids_keep_their_bits() {
        let t: Vec<f64> = (0..500).map(|i| 3.0 + f64::from(i) * 0.005).collect();
        let grid = find("run", &t).expect("uniform");
        assert_eq!(grid.t, t);
        assert!((grid.dt - 0.005).abs() < 1e-15);
        assert_eq!(rows(&grid).len(), 500);
    }

    #[test]
    fn rounded_digits_are_a_grid() {
        // 60 Hz written with three decimals, and 400 Hz in whole milliseconds (steps of 2 and 3 ms).
        for (rate, unit) in [(60.0, 1e3), (400.0, 1e3)] {
            let t: Vec<f64> = (0..400).map(|i| (f64::from(i) / rate * unit).round() / unit).collect();
            let grid = find("run", &t).expect("uniform");
            assert_eq!(rows(&grid).len(), 400);
            assert_eq!(grid.t.len(), 400);
            assert!((grid.dt * rate - 1.0).abs() < 1e-5, "dt {}", grid.dt);
        }
    }

    #[test]
    fn missing_samples_keep_the_grid() {
        let t: Vec<f64> = (0..100).filter(|i| ![7, 8, 50].contains(i)).map(|i| f64::from(i) * 0.01).collect();
        let grid = find("run", &t).expect("a grid");
        assert_eq!(grid.t.len(), 100);
        let expected: Vec<usize> = (0..100).filter(|i| ![7, 8, 50].contains(i)).collect();
        assert_eq!(rows(&grid), expected);
        assert!((grid.t[8] - 0.08).abs() < 1e-12);
    }

    #[test]
    fn jitter_is_measured_and_resampled() {
        let t: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.01 + 0.001 * (f64::from(i) * 1.7).sin()).collect();
        let grid = find("run", &t).expect("a grid");
        let Placement::Resample { rms, largest } = grid.placement else { panic!("jitter not seen") };
        assert!(rms > 5e-4 && largest < 2e-3 && largest > rms, "rms {rms}, largest {largest}");
        assert!((grid.dt - 0.01).abs() < 1e-4);
    }

    #[test]
    fn interpolation_is_exact_on_lines_and_refuses_holes() {
        let t = [0.0, 1.0, 2.5, 5.0, 6.0];
        let y: Vec<f64> = t.iter().map(|t| 2.0 * t + 1.0).collect();
        let at = [0.0, 0.5, 2.0, 3.0, 5.0, 5.5, 6.0];
        let found = interpolate(&t, &y, &at, 1.0, false);
        for (x, y) in at.iter().zip(&found) {
            assert!(if *x == 3.0 { y.is_nan() } else { (y - 2.0 * x - 1.0).abs() < 1e-12 }, "at {x}: {y}");
        }
        assert!(interpolate(&t, &y, &at, 1.0, true).iter().all(|v| v.is_finite()));
    }

    #[test]
    fn a_day_between_two_samples_is_an_error() {
        let mut t: Vec<f64> = (0..50).map(|i| f64::from(i) * 0.01).collect();
        t.push(86_400.0);
        let error = find("run", &t).expect_err("pause");
        assert!(matches!(error, Error::LongPause { row: 50, .. }), "{error}");
    }
}
