//! Tests of `lsq`: classical problems with known answers, bounds with known active sets, statistics of the fit.

use super::*;
use crate::numeric::rng::SplitMix64;
use proptest::prelude::*;

/// Residuals and the rows of their derivative, where they exist.
type Linearised = Option<(Vec<f64>, Vec<Vec<f64>>)>;

/// A problem from a function that returns all residuals and the rows of their derivative.
struct Residuals<F: FnMut(&[f64]) -> Linearised> {
    unknowns: usize,
    residuals: F,
    highest: f64,
}

fn problem<F: FnMut(&[f64]) -> Linearised>(unknowns: usize, residuals: F) -> Residuals<F> {
    Residuals { unknowns, residuals, highest: f64::INFINITY }
}

impl<F: FnMut(&[f64]) -> Linearised> LeastSquares for Residuals<F> {
    fn len(&self) -> usize {
        self.unknowns
    }

    fn evaluate(&mut self, x: &[f64], rows: Option<&mut RowQr>) -> Option<f64> {
        let (r, j) = (self.residuals)(x)?;
        let cost = r.iter().map(|v| v * v).sum();
        if let Some(rows) = rows {
            r.iter().zip(&j).for_each(|(r, row)| rows.push(row, *r));
            // Linearisations happen at the start and at accepted points only: the cost must not rise.
            assert!(cost <= self.highest, "the cost rose from {} to {cost}", self.highest);
            self.highest = cost;
        }
        Some(cost)
    }
}

fn rosenbrock(x: &[f64]) -> Linearised {
    Some((vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]], vec![vec![-20.0 * x[0], 10.0], vec![-1.0, 0.0]]))
}

#[test]
fn rosenbrock_valley_is_followed_to_its_end() {
    let fit = minimise(&mut problem(2, rosenbrock), &[-1.2, 1.0], &Settings::new(2));
    assert!(fit.converged, "{:?}", fit.stop);
    assert!((fit.x[0] - 1.0).abs() < 1e-7 && (fit.x[1] - 1.0).abs() < 1e-7, "{:?}", fit.x);
    assert!(fit.iterations <= 30, "{} iterations", fit.iterations);
}

#[test]
fn bounded_rosenbrock_stops_on_the_bound() {
    // With x0 <= 0.5 the minimum is (0.5, 0.25), the first variable held, the second free on the valley floor.
    let settings = Settings { upper: vec![0.5, f64::INFINITY], ..Settings::new(2) };
    let fit = minimise(&mut problem(2, rosenbrock), &[-1.2, 1.0], &settings);
    assert!(fit.converged);
    assert_eq!(fit.x[0], 0.5);
    assert!((fit.x[1] - 0.25).abs() < 1e-6);
    assert_eq!(fit.at_bound, [true, false]);
    assert_eq!(fit.sd(0), 0.0);
    assert!((fit.sd(1) - 0.1).abs() < 1e-12, "one row of slope 10 gives sd 0.1, found {}", fit.sd(1));
}

#[test]
fn bound_that_is_not_needed_is_left_again() {
    // Start on the bound: the gradient points inward, so the variable must not be frozen.
    let settings = Settings { lower: vec![-1.2, -5.0], ..Settings::new(2) };
    let fit = minimise(&mut problem(2, rosenbrock), &[-3.0, 1.0], &settings);
    assert!(fit.converged && (fit.x[0] - 1.0).abs() < 1e-7);
    assert_eq!(fit.at_bound, [false, false]);
}

#[test]
fn coupled_quadratic_with_known_active_set() {
    // min |A x - b|^2 over x >= 0 for a coupled A: non-negative least squares by hand gives (0, 0.8).
    let residuals = |x: &[f64]| {
        Some((
            vec![x[0] + 2.0 * x[1] - 1.0, x[1] - 2.0, 0.5 * x[0]],
            vec![vec![1.0, 2.0], vec![0.0, 1.0], vec![0.5, 0.0]],
        ))
    };
    let settings = Settings { lower: vec![0.0, 0.0], ..Settings::new(2) };
    let fit = minimise(&mut problem(2, residuals), &[5.0, 5.0], &settings);
    assert!(fit.converged);
    assert_eq!(fit.x[0], 0.0);
    assert!((fit.x[1] - 0.8).abs() < 1e-5, "{:?}", fit.x);
    assert_eq!(fit.at_bound, [true, false]);
}

/// Residuals of `a exp(-b t) + c` over 60 samples against `y`, in units of the noise.
fn decay(y: &[f64], sigma: f64) -> impl FnMut(&[f64]) -> Linearised + '_ {
    move |x| {
        let each = y.iter().enumerate().map(|(i, y)| {
            let t = i as f64 * 0.1;
            let e = (-x[1] * t).exp();
            ((x[0] * e + x[2] - y) / sigma, vec![e / sigma, -x[0] * t * e / sigma, 1.0 / sigma])
        });
        Some(each.unzip())
    }
}

#[test]
fn exponential_fit_recovers_truth_and_its_covariance_covers() {
    let (truth, sigma, runs) = ([2.0, 1.3, 0.5], 0.05, 400);
    let mut random = SplitMix64::new(11);
    let mut inside = [0; 3];
    for _ in 0..runs {
        let y: Vec<f64> = (0..60)
            .map(|i| truth[0] * (-truth[1] * i as f64 * 0.1).exp() + truth[2] + sigma * random.normal())
            .collect();
        let fit = minimise(&mut problem(3, decay(&y, sigma)), &[1.0, 0.5, 0.0], &Settings::new(3));
        assert!(fit.converged);
        for j in 0..3 {
            inside[j] += usize::from((fit.x[j] - truth[j]).abs() < fit.sd(j));
        }
    }
    for count in inside {
        // One sigma covers 68.3 %; the standard error of 400 runs is 2.3 %.
        let share = count as f64 / runs as f64;
        assert!((share - 0.683).abs() < 0.07, "coverage {share}");
    }
}

#[test]
fn badly_scaled_unknowns_change_nothing() {
    let y: Vec<f64> = (0..60).map(|i| 2.0 * (-0.13 * i as f64).exp() + 0.5 + 0.01 * (i as f64).sin()).collect();
    let plain = minimise(&mut problem(3, decay(&y, 0.05)), &[1.0, 0.5, 0.0], &Settings::new(3));
    let units = [1e8, 1e-7, 1e3];
    let mut inner = decay(&y, 0.05);
    let rescaled = move |x: &[f64]| {
        let physical: Vec<f64> = x.iter().zip(units).map(|(x, u)| x * u).collect();
        let (r, mut j) = inner(&physical)?;
        j.iter_mut().for_each(|row| row.iter_mut().zip(units).for_each(|(v, u)| *v *= u));
        Some((r, j))
    };
    let settings = Settings { scale: units.iter().map(|u| 1.0 / u).collect(), ..Settings::new(3) };
    let start = [1.0 / units[0], 0.5 / units[1], 0.0];
    let scaled = minimise(&mut problem(3, rescaled), &start, &settings);
    assert_eq!(scaled.iterations, plain.iterations);
    for (j, unit) in units.iter().enumerate() {
        assert!((scaled.x[j] * unit - plain.x[j]).abs() < 1e-9, "unknown {j}");
        assert!((scaled.sd(j) * unit / plain.sd(j) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn unidentifiable_unknowns_are_flagged_and_do_not_stop_the_fit() {
    // Only x0 + x1 and x2 are seen; x3 is not seen at all.
    let residuals = |x: &[f64]| {
        let rows = (0..20).map(|i| {
            let t = i as f64 * 0.1;
            ((x[0] + x[1]) * t + x[2] - 3.0 * t - 1.0, vec![t, t, 1.0, 0.0])
        });
        Some(rows.unzip())
    };
    let fit = minimise(&mut problem(4, residuals), &[0.0, 1.0, 0.0, 7.0], &Settings::new(4));
    assert!(fit.converged, "{:?}", fit.stop);
    assert!((fit.x[0] + fit.x[1] - 3.0).abs() < 1e-6 && (fit.x[2] - 1.0).abs() < 1e-6);
    assert_eq!(fit.x[3], 7.0);
    assert!(fit.sd(0).is_infinite() && fit.sd(1).is_infinite() && fit.sd(3).is_infinite());
    assert!(fit.sd(2).is_finite() && fit.sd(2) > 0.0);
}

#[test]
fn failing_and_exploding_trials_are_rejected() {
    // log needs x > 0 and the first full step leaves it; then the cost explodes beyond the limit near zero.
    let residuals = |x: &[f64]| {
        if x[0] <= 0.0 {
            return None;
        }
        Some((vec![x[0].ln() - 1.0, 1e-3 / x[0]], vec![vec![1.0 / x[0]], vec![-1e-3 / (x[0] * x[0])]]))
    };
    let fit = minimise(&mut problem(1, residuals), &[60.0], &Settings { initial_lambda: 1e-12, ..Settings::new(1) });
    assert!(fit.converged);
    assert!((fit.x[0] - std::f64::consts::E).abs() < 1e-3);
}

#[test]
fn endings_are_named() {
    let nowhere = |_: &[f64]| None;
    let fit = minimise(&mut problem(1, nowhere), &[1.0], &Settings::new(1));
    assert_eq!((fit.stop, fit.converged), (StopReason::StartFailed, false));
    let short = Settings { max_iterations: 3, ..Settings::new(2) };
    let fit = minimise(&mut problem(2, rosenbrock), &[-1.2, 1.0], &short);
    assert_eq!((fit.stop, fit.iterations), (StopReason::MaxIterations, 3));
    let wrong_derivative = |x: &[f64]| Some((vec![x[0] + 2.0], vec![vec![-1.0]]));
    let fit = minimise(&mut problem(1, wrong_derivative), &[1.0], &Settings::new(1));
    assert_eq!(fit.stop, StopReason::Stalled);
    assert_eq!(fit.x, [1.0]);
}

proptest! {
    #[test]
    fn linear_problems_end_inside_the_box_and_satisfy_the_optimality_conditions(
        entries in proptest::collection::vec(-3.0..3.0_f64, 15), goal in proptest::collection::vec(-3.0..3.0_f64, 5),
    ) {
        let rows: Vec<Vec<f64>> = entries.chunks(3).map(<[f64]>::to_vec).collect();
        let residual = |x: &[f64]| -> Vec<f64> {
            rows.iter().zip(&goal).map(|(row, g)| row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>() - g).collect()
        };
        let settings = Settings { lower: vec![-0.5; 3], upper: vec![0.5; 3], ftol: 1e-12, ..Settings::new(3) };
        let mut linear = problem(3, |x: &[f64]| Some((residual(x), rows.clone())));
        let fit = minimise(&mut linear, &[0.1, 0.2, -0.3], &settings);
        let r = residual(&fit.x);
        for j in 0..3 {
            let gradient: f64 = rows.iter().zip(&r).map(|(row, r)| row[j] * r).sum();
            prop_assert!((-0.5..=0.5).contains(&fit.x[j]));
            let presses_out = (fit.x[j] == -0.5 && gradient > -1e-3) || (fit.x[j] == 0.5 && gradient < 1e-3);
            prop_assert!(gradient.abs() < 1e-3 || presses_out, "gradient {gradient} of unknown {j} at {:?}", fit.x);
        }
    }
}
